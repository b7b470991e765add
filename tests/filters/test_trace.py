"""Traces: what became of every hypothesis, against the beliefs and reports of `step`."""

from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest

from gmr_gym.baselines.bank_of_mhts import mmae_of_mhts
from gmr_gym.baselines.mht import capping, runnalls
from gmr_gym.filters.registry import make_tracker, trackers
from gmr_gym.filters.trace import Trace, Tracing
from gmr_gym.filters.tracker import Report
from gmr_gym.linalg import root_determinants
from gmr_gym.mixture import matched
from gmr_gym.models.kalman import Sensor
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.zhang import jump_markov
from gmr_gym.simulation.single_target import draw, scan

SCENARIOS = jump_markov(), turning_target(), airborne_radar()
PRINTED = "imm-dcm-pda-printed"  # its printed covariance is no posterior's
NAMES = sorted(set(trackers()) - {PRINTED})
ONE_CHOICE = {"clairvoyant", "nearest-neighbour"}  # a detection or a miss, never both
MIXED = "imm-of-mhts"  # its hypotheses are predicted from several
POOLED = {MIXED, "mmae-of-mhts", "one-motion"}  # one MHT for each motion
each = pytest.mark.parametrize("name", NAMES)


class Played(NamedTuple):
    """A scan, and what `trace` and `step` give of it."""

    z: np.ndarray
    belief: Any
    report: Report
    trace: Trace
    stepped: tuple


def episode_for(name):
    """The tracker of that name, and five scans, of the first scenario whose model it takes."""
    for scenario in SCENARIOS:
        try:
            tracker = make_tracker(name, scenario.model)
        except ValueError:
            continue
        episode = draw(scenario, seed=2)
        seen = [scan(scenario, episode, t, scenario.centre(episode.x[t])) for t in range(5)]
        knows = getattr(tracker, "knows_origin", False)
        return tracker, [s.z[s.origin >= 0] if knows else s.z for s in seen]
    raise AssertionError(name)


@cache
def played(name):
    return traced(*episode_for(name))


def traced(tracker, scans):
    belief, out = tracker.init(), []
    for z in scans:
        stepped = tracker.step(belief, z)
        belief, report, trace = tracker.trace(belief, z)
        out.append(Played(z, belief, report, trace, stepped))
    return out


def same(one, other):
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(same, one, other))
    return np.array_equal(one, other)


@each
def test_belief_and_report_are_those_of_step(name):
    for now in played(name):
        assert same((now.belief, now.report), now.stepped)


@each
def test_every_hypothesis_is_accounted_for(name):
    for now in played(name):
        full, *rows = now.trace
        assert abs(full.w.sum() - 1) < 1e-12
        assert all(row.shape == full.w.shape and row.dtype == np.int64 for row in rows)
        assert set(now.trace.into) - {-1} == set(range(len(now.report.mixture.w)))


@each
def test_what_went_into_a_hypothesis_has_its_weight_and_moments(name):
    for now in played(name):
        kept = now.report.mixture
        q = matched(now.trace.full, now.trace.into, len(kept.w))
        scale = np.sqrt(np.einsum("ndd->nd", kept.P))
        went = now.trace.into >= 0
        normalised = np.zeros(len(kept.w), int)  # what each was normalised with, after the pruning
        if name in POOLED:
            normalised[now.trace.into[went]] = now.trace.mode[went]
        shares = [w / np.bincount(normalised, w)[normalised] for w in (q.w, kept.w)]
        np.testing.assert_allclose(*shares, rtol=1e-9)
        assert (np.abs(q.m - kept.m) <= 1e-9 * (scale + np.abs(kept.m))).all()
        assert (np.abs(q.P - kept.P) <= 1e-9 * scale[:, :, None] * scale[:, None, :]).all()


@each
def test_parents_are_of_the_scan_before_and_modes_of_the_model(name):
    tracker, _ = episode_for(name)
    for before, now in pairwise(played(name)):
        assert set(now.trace.parent) == ({-1} if name == MIXED else set(range(len(before.report.mixture.w))))
        assert set(now.trace.mode) <= set(range(len(tracker.model.motions)))


@each
def test_every_predicted_component_is_missed_once_and_updated_with_what_is_in_a_gate(name):
    tracker, _ = episode_for(name)
    updated = 0
    for now in played(name):
        _, parent, detection, _, mode = now.trace
        missed = detection < 0
        predicted = list(zip(mode[missed], parent[missed], strict=True))
        if name not in {*ONE_CHOICE, MIXED}:
            assert sorted(predicted) == sorted(set(zip(mode, parent, strict=True)))
        updated += (~missed).sum()
        if not isinstance(tracker.model.sensor, Sensor) or name == "clairvoyant":
            continue  # gates in space, or around nothing
        centres, S, threshold = now.report.gates
        nu = now.z[:, None] - centres
        d2 = np.einsum("knp,npq,knq->kn", nu, np.linalg.inv(S), nu)
        own = len(tracker.model.motions) == 1 and name != "one-motion"  # else all share their gates
        d2 = d2[detection, parent] if own else d2[detection].min(axis=1)
        assert (d2[~missed] <= threshold * (1 + 1e-9)).all()
    assert updated > 0


def test_a_hypothesis_goes_nowhere_where_it_weighs_too_little():
    tracker, scans = episode_for("runnalls")
    limit = 0.02
    for now in traced(runnalls(tracker.model, 5, prune_weight=limit, prune_density=0.0), scans):
        np.testing.assert_array_equal(now.trace.into < 0, now.trace.full.w < limit)


def test_a_hypothesis_goes_nowhere_beyond_the_cap_or_where_its_density_is_too_low():
    tracker, scans = episode_for("capping")
    for now in traced(capping(tracker.model, 4, prune_density=1e-4), scans):
        full, into = now.trace.full, now.trace.into
        heaviest = full.w >= np.sort(full.w)[-4:][0]
        density = full.w / full.w[heaviest].sum() / root_determinants(full.P)
        np.testing.assert_array_equal(into >= 0, heaviest & (density >= 1e-4))
        np.testing.assert_array_equal(now.report.mixture.m[into[into >= 0]], full.m[into >= 0])
    assert (density[heaviest] < 1e-4).any()


def test_nothing_goes_into_an_mht_that_is_reset_to_the_others():
    tracker, scans = episode_for("mmae-of-mhts")
    often = traced(mmae_of_mhts(tracker.model, 5, restart=1e-3), scans)
    empty = [set(now.trace.mode[now.trace.into >= 0]) != set(now.trace.mode) for now in often]
    assert any(empty) and not all(empty)


def test_a_tracker_without_a_posterior_has_no_trace():
    tracker, _ = episode_for(PRINTED)
    assert not isinstance(tracker, Tracing)
    assert all(isinstance(episode_for(name)[0], Tracing) for name in NAMES)
