"""The rows on scans of one target, on a single environment, and on workers."""

from collections.abc import Callable, Iterator
from importlib.util import find_spec
from time import perf_counter

import gymnasium as gym
import numpy as np
import plain
from problems import scans
from timing import Plan, Row, Stopwatch, compared, timed

from gmr_gym.evaluation import montecarlo
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.single_target import draw

if find_spec("stonesoup"):
    import stone_soup
else:
    stone_soup = None

MISSING = "stonesoup is not installed"
# weight and density below which we prune; scans; squared distances below which Stone Soup merges, its
# tutorial's and one at which it keeps about as many as we do
CUTS = (("pruned", 5e-4, 1e-10, 30, (5.0, 0.1)), ("unpruned", 0.0, 0.0, 20, (5.0,)))
STONE_SOUP_SCANS = "Stone Soup's simulator, scans alone"


def tracked(tracker, scans: list) -> Stopwatch:
    """Seconds of a scan, the tracker going through all of them."""

    def through() -> None:
        belief = tracker.init()
        for z in scans:
            belief, _ = tracker.step(belief, z)

    return timed(through, parts=len(scans))


def estimated(tracker, scans: list, estimate: Callable) -> tuple[np.ndarray, float]:
    """Estimates (t, d), and how many hypotheses were kept on average."""
    belief, said = tracker.init(), []
    for z in scans:
        belief, _ = tracker.step(belief, z)
        said.append(estimate(belief))
    return np.array([x for x, _ in said]), float(np.mean([kept for _, kept in said]))


def mean_and_number(belief) -> tuple[np.ndarray, int]:
    """Mean (d,) and number of components of a mixture, or of a belief that has one."""
    p = getattr(belief, "mixture", belief)
    return p.w @ p.m, len(p.w)


def scan_rows(plan: Plan) -> Iterator[Row]:
    scenario = turning_target(clutter_rate=150.0)
    seen, told = scans(scenario, 0, 30), scenario.model
    found = stone_soup.detections(seen) if stone_soup else []
    pda, what = make_tracker("pda", told), "scan, PDA, clutter 150"
    rivals = {"plain NumPy": (plain.Pda(told), seen)}
    if stone_soup:
        rivals["Stone Soup"] = (stone_soup.Pda(told), found)
    else:
        yield Row(what, "Stone Soup", note=MISSING)
    x, _ = estimated(pda, seen, mean_and_number)
    for name, (theirs, given) in rivals.items():
        apart = np.abs(x - estimated(theirs, given, theirs.estimate)[0]).max()
        note = f"estimates at most {apart:.0e} apart"
        yield compared(plan, what, tracked(pda, seen), name, tracked(theirs, given), note)
    for cut, prune_weight, prune_density, count, merging in CUTS:
        mht = make_tracker("runnalls-30", told, prune_weight=prune_weight, prune_density=prune_density)
        _, kept = estimated(mht, seen[:count], mean_and_number)
        what = f"scan, runnalls-30 {cut}, clutter 150"
        for distance in merging:
            name = f"Stone Soup's parts, cap 30, merging below {distance:g}"
            if not stone_soup:
                yield Row(what, name, note=MISSING)
                continue
            theirs = stone_soup.MultipleHypotheses(told, 30, prune_weight, distance)
            _, theirs_kept = estimated(theirs, found[:count], theirs.estimate)
            note = f"hypotheses kept: {kept:.1f}, theirs {theirs_kept:.1f}"
            watches = tracked(mht, seen[:count]), tracked(theirs, found[:count])
            yield compared(plan, what, watches[0], name, watches[1], note)


def environment_rows(plan: Plan) -> Iterator[Row]:
    env = gym.make("gmr_gym/TurningTarget-v0").unwrapped
    scenario = env.scenario
    actions = draw(scenario, 0).x  # the target's scripted path: the track is never lost
    seed = iter(range(10**9))

    def episode() -> None:
        env.reset(seed=next(seed))
        for action in actions:
            env.step(action)

    episode()
    rng, steps = np.random.default_rng(0), len(actions)
    rivals = {"plain NumPy loop, scans alone": lambda: plain.simulated(scenario, rng)}
    if stone_soup:
        rivals[STONE_SOUP_SCANS] = lambda: stone_soup.simulated(scenario, steps)
    what = "environment, a step, resets included"
    for name, theirs in rivals.items():
        row = compared(plan, what, timed(episode, parts=steps), name, timed(theirs, parts=steps))
        yield row._replace(note=f"steps a second: {1 / row.ours:,.0f}, theirs {1 / row.theirs:,.0f}")
    if not stone_soup:
        yield Row(what, STONE_SOUP_SCANS, note=MISSING)


def worker_rows(plan: Plan) -> Iterator[Row]:
    scenario = turning_target()
    trackers = {"runnalls-30": make_tracker("runnalls-30", scenario.model)}
    runs = 400  # fewer than those that are played by compiled calls, block by block
    two, one = (
        timed(lambda jobs=jobs: montecarlo.run(scenario, trackers, runs, jobs=jobs), clock=perf_counter)
        for jobs in (2, 1)
    )
    first = two()
    row = compared(plan, f"{runs} runs of runnalls-30, two workers, by the clock", two, "one worker", one)
    yield row._replace(note=f"workers running; their start took {first - row.ours:.1f} s more")
