"""Rows on many episodes at once, and on thresholds set by a network."""

from collections.abc import Iterator
from time import perf_counter, process_time

import gymnasium as gym
import numpy as np
from problems import scans
from rows import MISSING, STONE_SOUP_SCANS, estimated, mean_and_number, stone_soup, tracked
from timing import Plan, Row, Stopwatch, compared, timed

from gmr_gym.envs.registry import TUNING
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation import multi_target
from gmr_gym.simulation.single_target import draw

WIDE, MANY, TUNED = (1024, 4096), 64, 32  # environments side by side
CLUTTER = "gmr_gym/UnknownClutter-v0"
STEPS = 50  # of Stone Soup's in a turn
VECTOR = {"vectorization_mode": "vector_entry_point"}


def vector_rows(plan: Plan) -> Iterator[Row]:
    yield from _tracking_rows(plan)
    yield from _multi_target_rows(plan)
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

    # threads are what these rows are about: they are timed by the clock
    alone = timed(single, parts=len(truth), clock=perf_counter)
    rivals = [(n, "of a single one", alone) for n in WIDE]
    if stone_soup:
        simulated = timed(lambda: stone_soup.simulated(scenario, STEPS), parts=STEPS, clock=perf_counter)
        rivals.append((WIDE[0], STONE_SOUP_SCANS, simulated))
    what = "a scan of one of {} environments side by side, scored, by the clock"
    for n, name, watch in rivals:
        row = compared(plan, what.format(n), side_by_side(n), name, watch)
        yield row._replace(note=f"scans a second: {1 / row.ours:,.0f}")
    if not stone_soup:
        yield Row(what.format(WIDE[0]), STONE_SOUP_SCANS, note=MISSING)


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
    return timed(episodes, parts=len(truth) * n, clock=perf_counter)


def _multi_target_rows(plan: Plan) -> Iterator[Row]:
    env = gym.make(CLUTTER).unwrapped
    envs = gym.make_vec(CLUTTER, MANY, **VECTOR, copy=False)
    x = multi_target.draw(env.scenario, 0).x  # submitted, about right in every episode
    actions = np.zeros((len(x), *env.action_space.shape))
    actions[:, : x.shape[1], 0], actions[:, : x.shape[1], 1:] = ~np.isnan(x[..., 0]), np.nan_to_num(x)

    def single() -> None:
        env.reset(seed=0)
        for action in actions:
            env.step(action)

    def many() -> None:
        envs.reset(seed=0)
        for action in actions:
            envs.step(np.broadcast_to(action, envs.action_space.shape))

    many(), single()  # both compile
    what = f"a scan of one of {MANY} UnknownClutter side by side, scored"
    for clock, by in ((process_time, ""), (perf_counter, ", by the clock")):
        ours = timed(many, parts=MANY * len(x), clock=clock)
        theirs = timed(single, parts=len(x), clock=clock)
        row = compared(plan, what + by, ours, "of a single one", theirs)
        yield row._replace(note=f"scans a second: {1 / row.ours:,.0f}")


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
    ours, theirs = (timed(play, parts=steps, clock=perf_counter) for play in (many, single))
    what = f"a step of one of {TUNED} ReductionTuning side by side, by the clock"
    row = compared(plan, what, ours, "of a single one", theirs)
    yield row._replace(note=f"steps a second: {1 / row.ours:,.0f}")


def _learned_rows(plan: Plan) -> Iterator[Row]:
    scenario = turning_target(clutter_rate=150.0)
    seen = scans(scenario, 0, 100)
    learned, adaptive = (make_tracker(name, scenario.model) for name in ("learned-thresholds", "adaptive"))
    kept = [f"{estimated(tracker, seen, mean_and_number)[1]:.1f}" for tracker in (learned, adaptive)]
    note = f"hypotheses kept: {kept[0]}, theirs {kept[1]}"
    watches = tracked(learned, seen), tracked(adaptive, seen)
    yield compared(plan, "scan, learned-thresholds, clutter 150", watches[0], "adaptive", watches[1], note)
