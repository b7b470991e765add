"""The rows of the table that are timed in this process."""

from collections.abc import Iterator
from time import perf_counter
from types import ModuleType

import gymnasium as gym
import numpy as np
import plain
from problems import drawn, partition, posteriors, scans
from timing import Row, Stopwatch, Timing, each, interleaved, timed

from gmr_gym import montecarlo
from gmr_gym.ise import integral_squared_error
from gmr_gym.reduction import runnalls
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulate import draw
from gmr_gym.tracker import make_tracker

try:
    import stone_soup
except ImportError:
    stone_soup: ModuleType | None = None  # type: ignore[no-redef]

MISSING = "stonesoup is not installed"
SIZES = ((50, 5, 300.0), (150, 30, 150.0), (400, 50, 300.0))  # components, target, clutter a scan


def reduction_rows(quick: bool) -> Iterator[Row]:
    rounds = 2 if quick else 10
    for n, components, clutter_rate in SIZES:
        mixtures = {
            "tracker posteriors": posteriors(n, components, clutter_rate, 8),
            "random mixtures": drawn(n, 4, 8),
        }
        for source, given in mixtures.items():
            yield from _runnalls_rows(f"Runnalls 4-D {n} to {components}, {source}", given, components, rounds)
    given = drawn(150, 6, 1 if quick else 3, concentration=100.0)
    timing = interleaved({"ours": each(lambda p: integral_squared_error(p, 15), given)}, min(rounds, 5))
    yield Row(
        "Williams ISE 6-D 150 to 15, random mixtures, weights nearly equal", timing["ours"], "-", None
    )


def _runnalls_rows(what: str, given: list, components: int, rounds: int) -> Iterator[Row]:
    alternatives = {"plain, compiled": plain.runnalls_compiled, "plain, NumPy": plain.runnalls_in_numpy}
    merges = [partition(runnalls(p, components)[1]) for p in given]
    same = {
        name: sum(partition(reduce(p, components)) == merged for p, merged in zip(given, merges, strict=True))
        for name, reduce in alternatives.items()
    }
    timings = interleaved(
        {
            name: each(lambda p, reduce=reduce: reduce(p, components), given)
            for name, reduce in {"ours": runnalls, **alternatives}.items()
        },
        rounds,
    )
    for name in alternatives:
        note = f"same merges in {same[name]} of {len(given)}"
        yield Row(what, timings["ours"], name, timings[name], note)


class Tracked:
    """A tracker through the scans of every seed; what it estimated and kept is remembered."""

    def __init__(self, tracker, seen: list[list], estimate):
        self.tracker, self.seen, self.estimate = tracker, seen, estimate
        self.x: dict[int, np.ndarray] = {}
        self.kept: dict[int, float] = {}
        for z in seen[0][:3]:  # compiles
            tracker.step(tracker.init(), z)

    def __call__(self, seed: int) -> float:
        """Seconds for one scan, the median over those of the seed."""
        belief, seconds, said = self.tracker.init(), [], []
        for z in self.seen[seed]:
            started = perf_counter()
            belief, _ = self.tracker.step(belief, z)
            seconds.append(perf_counter() - started)
            said.append(self.estimate(belief))
        self.x[seed] = np.array([x for x, _ in said])
        self.kept[seed] = float(np.mean([kept for _, kept in said]))
        return float(np.median(seconds))


def scan_rows(quick: bool) -> Iterator[Row]:
    seeds, count = (2, 30) if quick else (6, 100)
    scenario = turning_target(clutter_rate=150.0)
    seen = [scans(scenario, seed, count) for seed in range(seeds)]
    told = scenario.model

    def ours(name, **parameters):
        return Tracked(make_tracker(name, told, **parameters), seen, lambda p: (p.w @ p.m, len(p.w)))

    pda, plainly = ours("pda"), Tracked(plain.Pda(told), seen, plain.Pda.estimate)
    alternatives = {"ours": pda, "plain NumPy": plainly}
    if stone_soup:
        detections = [stone_soup.detections(z) for z in seen]
        alternatives["Stone Soup"] = Tracked(stone_soup.Pda(told), detections, stone_soup.Pda.estimate)
    timings = interleaved(alternatives, seeds)
    for name in ("plain NumPy", "Stone Soup"):
        note = _apart(pda, alternatives[name]) if name in alternatives else MISSING
        yield Row("scan, PDA, clutter 150", timings["ours"], name, timings.get(name), note)
    for what, prune_weight, prune_density in (("pruned", 5e-4, 1e-10), ("unpruned", 0.0, 0.0)):
        mht = ours("runnalls-30", prune_weight=prune_weight, prune_density=prune_density)
        alternatives = {"ours": mht}
        if stone_soup:
            tracker = stone_soup.MultipleHypotheses(told, 30, prune_weight)
            alternatives["Stone Soup"] = Tracked(tracker, detections, tracker.estimate)
        timings = interleaved(alternatives, seeds)
        note = f"hypotheses kept: {_kept(mht)}; theirs {_kept(alternatives['Stone Soup'])}" if stone_soup else MISSING
        against = "Stone Soup, its own reducer, cap 30"
        yield Row(f"scan, runnalls-30 {what}, clutter 150", timings["ours"], against, timings.get("Stone Soup"), note)


def _apart(ours: Tracked, theirs: Tracked) -> str:
    apart = max(float(np.abs(ours.x[seed] - theirs.x[seed]).max()) for seed in ours.x)
    return f"estimates at most {apart:.0e} apart"


def _kept(tracked: Tracked) -> str:
    return f"{np.mean(list(tracked.kept.values())):.1f}"


def environment_rows(quick: bool) -> Iterator[Row]:
    rounds = 2 if quick else 10
    env = gym.make("gmr_gym/TurningTarget-v0").unwrapped
    scenario = env.scenario
    actions = draw(scenario, 0).x  # the target's scripted path: the track is never lost
    seed = iter(range(10**9))

    def episode():
        env.reset(seed=next(seed))
        for action in actions:
            env.step(action)

    rng = np.random.default_rng(0)
    steps = len(actions)
    alternatives = {
        "ours": _per_step(timed(episode), steps),
        "plain NumPy loop, scans alone": _per_step(timed(lambda: plain.simulated(scenario, rng)), steps),
    }
    if stone_soup:
        simulated = timed(lambda: stone_soup.simulated(scenario, steps))
        alternatives["Stone Soup's simulator, scans alone"] = _per_step(simulated, steps)
    episode()
    timings = interleaved(alternatives, rounds)
    for name, timing in timings.items():
        if name != "ours":
            note = f"steps a second: {1 / timings['ours'].median:,.0f}; theirs {1 / timing.median:,.0f}"
            yield Row("environment, a step, resets included", timings["ours"], name, timing, note)
    if not stone_soup:
        yield Row("environment, a step, resets included", timings["ours"], "Stone Soup's simulator", None, MISSING)


def _per_step(stopwatch: Stopwatch, steps: int) -> Stopwatch:
    return lambda i: stopwatch(i) / steps


def worker_rows(quick: bool) -> Iterator[Row]:
    if quick:
        return
    scenario = turning_target()
    trackers = {"runnalls-30": make_tracker("runnalls-30", scenario.model)}
    run = {jobs: timed(lambda jobs=jobs: montecarlo.run(scenario, trackers, 80, jobs=jobs)) for jobs in (1, 2)}
    first = run[2](0)
    timings = interleaved({"two": run[2], "one": run[1]}, 5)
    note = f"workers running; their start took {first - timings['two'].median:.1f} s more"
    yield Row("80 runs of runnalls-30, two workers", timings["two"], "one worker", timings["one"], note)
