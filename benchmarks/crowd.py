"""Rows on many targets: a PHD filter's scan, a scan fitted as a finite mixture, and learning the clutter."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import plain_crowd
from rows import MISSING, stone_soup
from timing import Plan, Row, compared, timed

from gmr_gym.baselines.gm_phd import GmPhd
from gmr_gym.filters.clutter_estimation import update_estimate
from gmr_gym.filters.finite_mixture import fit_em
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import MultiTargetTracker
from gmr_gym.models.clutter import no_components
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.simulation.multi_target import MultiTargetScenario, draw, scan

COMPONENTS = 100
FULL = 40  # scans, from which on a learner forgets as much as it learns
WORLDS = {"50 false detections": "groups", "155 false detections": "dense"}


def crowd_rows(plan: Plan) -> Iterator[Row]:
    yield from _phd_rows(plan)
    yield from _fit_rows(plan)
    yield from _lesson_rows(plan)
    yield from _learning_rows(plan)


def _steps(scenario: MultiTargetScenario, tracker: MultiTargetTracker) -> Iterator[tuple]:
    """Belief, detections that come next and belief after them, scan by scan of one episode."""
    episode, belief = draw(scenario, 0), tracker.init()
    for t in range(scenario.horizon):
        z = scan(episode, t).z
        before, (belief, _) = belief, tracker.step(belief, z)
        yield before, z, belief


def _phd_rows(plan: Plan) -> Iterator[Row]:
    scenario = unknown_clutter()
    met = _steps(scenario, make_tracker("gm-phd", scenario.model))
    full = [(belief, z) for belief, z, _ in met if len(belief.label) == COMPONENTS]
    given = full[::8]
    # Stone Soup has no spawning, and forgets who was born and not seen
    told = scenario.model._replace(births=no_components(6), spawn_weight=0.0)
    tracker = make_tracker("gm-phd", told, components=COMPONENTS)

    def plainly(belief, z):
        return plain_crowd.phd_scan(belief.intensity, told, z, COMPONENTS)

    apart = max(
        np.abs(np.sort(tracker.step(*one)[1].intensity.w) - np.sort(plainly(*one).w)).max() for one in given
    )
    what = f"scan, GM-PHD, {COMPONENTS} components, 50 false detections, no births"
    ours, note = timed(tracker.step, given), f"weights at most {apart:.0e} apart"
    yield compared(plan, what, ours, "plain NumPy", timed(plainly, given), note)
    few = given[:2]
    for name, gate in (("Stone Soup, its tutorial's gate", 3.0), ("Stone Soup, wide gate", 9.0)):
        if not stone_soup:
            yield Row(what, name, note=MISSING)
            continue
        parts = stone_soup.Phd(told, COMPONENTS, gate)
        theirs = timed(parts.step, few, prepare=partial(_stone_soups, parts))
        note = _expected_apart(parts, tracker, few)
        yield compared(plan, what, timed(tracker.step, few), name, theirs, note)


def _stone_soups(parts, belief, z: np.ndarray) -> tuple:
    return parts.intensity(belief.intensity), stone_soup.detections([z])[0]


def _expected_apart(parts, tracker: GmPhd, given: list[tuple]) -> str:
    every = replace(tracker, reduce=lambda p: (p, np.arange(len(p.w))), prune_weight=0.0)
    apart = []
    for belief, z in given:
        theirs = [
            sum(component.weight for component in stage(*_stone_soups(parts, belief, z)))
            for stage in (parts.update, parts.step)
        ]
        apart.append([one.step(belief, z)[1].expected_targets for one in (every, tracker)] - np.array(theirs))
    updated, merged = np.abs(apart).max(axis=0)
    return (
        f"expected numbers at most {updated:.0e} apart, {merged:.2g} after merging, which clips weights at 1"
    )


def _fit_rows(plan: Plan) -> Iterator[Row]:
    scenario, given = unknown_clutter(), []
    tracker = make_tracker("fmm-em", scenario.model, repaired=True)

    def recorded(z, parts, flat, how, rng):
        given.append((z, parts, flat, how))
        return tracker.fit(z, parts, flat, how, rng)

    for _ in _steps(scenario, replace(tracker, fit=recorded)):
        pass
    given = given[::20]
    apart = max(abs(fit_em(*one)[1] - plain_crowd.fit(*one)) for one in given)
    yield compared(
        plan, "a scan fitted by EM, 50 false detections", timed(fit_em, given), "plain NumPy",
        timed(plain_crowd.fit, given), f"log-likelihoods at most {apart:.0e} apart",
    )  # fmt: skip


def _lesson_rows(plan: Plan) -> Iterator[Row]:
    for what, clutter in WORLDS.items():
        scenario = unknown_clutter(clutter=clutter)
        tracker = make_tracker("learning-phd", scenario.model)
        given = []
        for t, (before, z, after) in enumerate(_steps(scenario, tracker)):
            if t >= FULL and t % 30 == 0:
                p_clutter = after.estimate.p_clutter[after.estimate.age == 0]
                given.append((scenario.model.clutter, before.estimate, z, p_clutter, tracker.options))
        apart = 0.0
        for one in given:
            ours, plainly = (
                c.density(one[2]) for c in (update_estimate(*one).clutter, plain_crowd.lesson(*one))
            )
            apart = max(apart, np.abs(plainly / ours - 1).max())
        ours, theirs = timed(update_estimate, given), timed(plain_crowd.lesson, given)
        note = f"intensities at the detections at most {apart:.0e} of ours apart"
        what = f"a lesson of clutter, {what} a scan, memory full"
        yield compared(plan, what, ours, "plain NumPy", theirs, note)


def _learning_rows(plan: Plan) -> Iterator[Row]:
    for what, clutter in WORLDS.items():
        scenario = unknown_clutter(clutter=clutter)
        for name, untaught in (("learning-phd", "gm-phd"), ("learning-pmb", "pmb")):
            tracker, same = (make_tracker(each, scenario.model) for each in (name, untaught))
            met = list(_steps(scenario, tracker))[FULL::30]
            ours = timed(tracker.step, [(belief, z) for belief, z, _ in met])
            theirs = timed(same.step, [(belief.targets, z) for belief, z, _ in met])
            theirs()  # compiles
            yield compared(
                plan, f"scan, {name}, {what}, memory full", ours, f"{untaught} on the same targets", theirs,
                "told of uniform clutter",
            )  # fmt: skip
