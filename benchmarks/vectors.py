"""Rows on many episodes at once, and on thresholds set by a network."""

from collections.abc import Iterator
from importlib.util import find_spec

import gymnasium as gym
import numpy as np
from problems import scans
from rows import MISSING, STONE_SOUP_SCANS, Tracked
from timing import Plan, Row, Stopwatch, interleaved, timed

from gmr_gym.envs.registry import TUNING
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.single_target import draw

if find_spec("stonesoup"):
    import stone_soup
else:
    stone_soup = None

WIDE, TUNED = 1024, 32  # environments side by side
STEPS = 50  # of Stone Soup's in a turn
VECTOR = {"vectorization_mode": "vector_entry_point"}


def vector_rows(plan: Plan) -> Iterator[Row]:
    yield from _tracking_rows(plan)
    yield from _tuning_rows(plan)
    yield from _learned_rows(plan)


def _tracking_rows(plan: Plan) -> Iterator[Row]:
    env = gym.make("gmr_gym/TurningTarget-v0").unwrapped
    scenario = env.scenario
    truth = draw(scenario, 0).x  # submitted, so that no track is lost

    def single() -> None:
        env.reset(seed=0)
        for x in truth:
            env.step(x)

    # threads are what this row is about: it is timed by the clock
    alternatives = {
        "ours": side_by_side(WIDE),
        "single": _each(timed(single), len(truth)),
    }
    if stone_soup:
        alternatives["Stone Soup"] = _each(timed(lambda: stone_soup.simulated(scenario, STEPS)), STEPS)
    timings = interleaved(alternatives, 1, 3 if plan.quick else 10)
    what = f"a scan of one of {WIDE} environments side by side, scored, by the clock"
    ours = timings["ours"]
    note = f"scans a second: {1 / ours.median:,.0f} ({1 / ours.best:,.0f})"
    yield Row(what, ours, "of a single one", timings["single"], note)
    yield Row(what, ours, STONE_SOUP_SCANS, timings.get("Stone Soup"), note if stone_soup else MISSING)


def side_by_side(n: int) -> Stopwatch:
    """Seconds for a scan of one of n turning targets, the truth submitted, over whole episodes."""
    envs = gym.make_vec("gmr_gym/TurningTarget-v0", n, **VECTOR, copy=False)
    truth = draw(envs.scenario, 0).x  # scripted: the same in all of them
    estimates = np.repeat(truth[:, None], n, axis=1)

    def episodes() -> None:
        for x in estimates:
            envs.step(x)
        envs.step(estimates[0])  # begins the next ones, whatever is submitted

    envs.reset(seed=0)
    episodes()  # compiles
    return _each(timed(episodes), len(truth) * n)


def _tuning_rows(plan: Plan) -> Iterator[Row]:
    # the same episodes, one after another and side by side
    env = gym.make(TUNING).unwrapped
    envs = gym.make_vec(TUNING, TUNED, **VECTOR, autoreset_mode="Disabled")
    action = np.full(env.action_space.shape, 0.5, np.float32)
    actions = np.tile(action, (TUNED, 1))

    def single() -> int:
        steps = 0
        for seed in range(TUNED):
            env.reset(seed=seed)
            over = False
            while not over:
                _, _, terminated, truncated, _ = env.step(action)
                over, steps = terminated or truncated, steps + 1
        return steps

    def many() -> None:
        envs.reset(seed=0)
        over = np.zeros(TUNED, bool)
        while not over.all():
            _, _, terminated, truncated, _ = envs.step(actions)
            over |= terminated | truncated

    many()
    steps = single()  # both compile
    alternatives = {"ours": _each(timed(many), steps), "single": _each(timed(single), steps)}
    timings = interleaved(alternatives, 1, 3 if plan.quick else 20)
    note = f"steps a second: {1 / timings['ours'].median:,.0f}"
    what = f"a step of one of {TUNED} ReductionTuning side by side, by the clock"
    yield Row(what, timings["ours"], "of a single one", timings["single"], note)


def _learned_rows(plan: Plan) -> Iterator[Row]:
    scenario, count = turning_target(clutter_rate=150.0), 30 if plan.quick else 100
    seen = [scans(scenario, seed, count) for seed in range(2)]
    names = ("learned-thresholds", "adaptive")
    trackers = {
        name: Tracked(make_tracker(name, scenario.model), seen, _estimate, plan.clock) for name in names
    }
    timings = interleaved(trackers, len(seen), 1 if plan.quick else 3)
    kept = [f"{np.mean(list(tracker.kept.values())):.1f}" for tracker in trackers.values()]
    yield Row(
        "scan, learned-thresholds, clutter 150", timings[names[0]], "adaptive", timings[names[1]],
        f"hypotheses kept: {kept[0]}, theirs {kept[1]}",
    )  # fmt: skip


def _estimate(belief) -> tuple[np.ndarray, int]:
    p = getattr(belief, "mixture", belief)
    return p.w @ p.m, len(p.w)


def _each(stopwatch: Stopwatch, parts: int) -> Stopwatch:
    return lambda i: stopwatch(i) / parts
