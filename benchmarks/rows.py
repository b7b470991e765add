"""The rows of the table that are timed in this process."""

from collections.abc import Callable, Iterator
from importlib.util import find_spec

import gymnasium as gym
import numpy as np
import plain
from problems import scans
from timing import Plan, Row, Stopwatch, Timing, interleaved, timed

from gmr_gym.evaluation import montecarlo
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.single_target import draw

if find_spec("stonesoup"):
    import stone_soup
else:
    stone_soup = None

MISSING = "stonesoup is not installed"
# weight and density below which we prune; squared distances below which Stone Soup merges, its tutorial's and
# one at which it keeps about as many as we do
CUTS = (("pruned", 5e-4, 1e-10, (5.0, 0.1)), ("unpruned", 0.0, 0.0, (5.0,)))
STONE_SOUP_SCANS = "Stone Soup's simulator, scans alone"


class Tracked:
    """A tracker through the scans of every seed; what it estimated and kept is remembered."""

    def __init__(self, tracker, seen: list[list], estimate, clock):
        self.tracker, self.seen, self.estimate, self.clock = tracker, seen, estimate, clock
        self.x: dict[int, np.ndarray] = {}
        self.kept: dict[int, float] = {}
        for z in seen[0][:3]:  # compiles
            tracker.step(tracker.init(), z)

    def __call__(self, seed: int) -> list[float]:
        """Seconds for each scan of the seed."""
        belief, seconds, said = self.tracker.init(), [], []
        for z in self.seen[seed]:
            started = self.clock()
            belief, _ = self.tracker.step(belief, z)
            seconds.append(self.clock() - started)
            said.append(self.estimate(belief))
        self.x[seed] = np.array([x for x, _ in said])
        self.kept[seed] = float(np.mean([kept for _, kept in said]))
        return seconds


def scan_rows(plan: Plan) -> Iterator[Row]:
    seeds, count = (2, 30) if plan.quick else (6, 100)
    scenario = turning_target(clutter_rate=150.0)
    seen = [scans(scenario, seed, count) for seed in range(seeds)]
    told, clock = scenario.model, plan.clock

    def ours(name, **parameters):
        tracker = make_tracker(name, told, **parameters)
        return Tracked(tracker, seen, lambda p: (p.w @ p.m, len(p.w)), clock)

    pda, plainly = ours("pda"), Tracked(plain.Pda(told), seen, plain.Pda.estimate, clock)
    alternatives = {"ours": pda, "plain NumPy": plainly}
    if stone_soup:
        detections = [stone_soup.detections(z) for z in seen]
        parts = stone_soup.Pda(told)
        alternatives["Stone Soup"] = Tracked(parts, detections, parts.estimate, clock)
    timings = interleaved(alternatives, seeds, rounds=1)
    for name in ("plain NumPy", "Stone Soup"):
        note = _apart(pda, alternatives[name]) if name in alternatives else MISSING
        yield Row("scan, PDA, clutter 150", timings["ours"], name, timings.get(name), note)
    for what, prune_weight, prune_density, merging in CUTS:
        mht = ours("runnalls-30", prune_weight=prune_weight, prune_density=prune_density)
        alternatives = {"ours": mht}
        if stone_soup:
            for distance in merging:
                parts = stone_soup.MultipleHypotheses(told, 30, prune_weight, distance)
                alternatives[f"{distance:g}"] = Tracked(parts, detections, parts.estimate, clock)
        timings = interleaved(alternatives, seeds, rounds=1)
        for distance in merging:
            theirs = alternatives.get(f"{distance:g}")
            yield Row(
                f"scan, runnalls-30 {what}, clutter 150",
                timings["ours"],
                f"Stone Soup's parts, cap 30, merging below {distance:g}",
                timings.get(f"{distance:g}"),
                f"hypotheses kept: {_kept(mht)}, theirs {_kept(theirs)}" if theirs else MISSING,
            )


def _apart(ours: Tracked, theirs: Tracked) -> str:
    apart = max(float(np.abs(ours.x[seed] - theirs.x[seed]).max()) for seed in ours.x)
    return f"estimates at most {apart:.0e} apart"


def _kept(tracked: Tracked) -> str:
    return f"{np.mean(list(tracked.kept.values())):.1f}"


def environment_rows(plan: Plan) -> Iterator[Row]:
    rounds = 5 if plan.quick else 30
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
        "ours": _per_step(episode, steps, plan),
        "plain NumPy loop, scans alone": _per_step(lambda: plain.simulated(scenario, rng), steps, plan),
    }
    if stone_soup:
        simulated = _per_step(lambda: stone_soup.simulated(scenario, steps), steps, plan)
        alternatives[STONE_SOUP_SCANS] = simulated
    episode()
    timings = interleaved(alternatives, 1, rounds)
    for name in list(alternatives)[1:] + [STONE_SOUP_SCANS] * (not stone_soup):
        theirs = timings.get(name)
        note = f"steps a second: {_rates(timings['ours'])}, theirs {_rates(theirs)}" if theirs else MISSING
        yield Row("environment, a step, resets included", timings["ours"], name, theirs, note)


def _rates(timing: Timing) -> str:
    return f"{1 / timing.median:,.0f} ({1 / timing.best:,.0f})"


def _per_step(episode: Callable[[], object], steps: int, plan: Plan) -> Stopwatch:
    stopwatch = timed(episode, clock=plan.clock)
    return lambda i: stopwatch(i) / steps


def worker_rows(plan: Plan) -> Iterator[Row]:
    if plan.quick:
        return
    scenario = turning_target()
    trackers = {"runnalls-30": make_tracker("runnalls-30", scenario.model)}
    runs = 400  # fewer than those that are played by compiled calls, block by block
    one = timed(lambda: montecarlo.run(scenario, trackers, runs, jobs=1))
    two = timed(lambda: montecarlo.run(scenario, trackers, runs, jobs=2))
    first = two(0)
    timings = interleaved({"two": two, "one": one}, 1, 3)
    note = f"workers running; their start took {first - timings['two'].median:.1f} s more"
    yield Row(f"{runs} runs of runnalls-30, two workers", timings["two"], "one worker", timings["one"], note)
