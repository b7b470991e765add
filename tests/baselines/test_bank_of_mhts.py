"""Banks of MHTs against Maybeck's formulae in plain NumPy, and the filters they must equal."""

from functools import partial

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from gmr_gym.baselines.bank_of_mhts import (
    BankOfMhts,
    equivalent_residual,
    imm_of_mhts,
    mmae_of_mhts,
    single_model_mht,
)
from gmr_gym.baselines.imm_pda import ImmPda
from gmr_gym.baselines.mht import Mht
from gmr_gym.baselines.mht_of_banks import mmae_pda
from gmr_gym.filters.association import expand
from gmr_gym.filters.filter_bank import floored
from gmr_gym.filters.joint_gating import Limits
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import Report
from gmr_gym.mixture import Mixture, moments, normalised
from gmr_gym.models.gating import Gates, gates
from gmr_gym.models.kalman import predict
from gmr_gym.reduction.ise import integral_squared_error
from gmr_gym.reduction.pruning import prune
from gmr_gym.reduction.registry import reducer
from gmr_gym.scenarios.maybeck import agile_flight
from gmr_gym.simulation.single_target import draw


def flight(tracker, scans):
    belief = tracker.init()
    for z in scans:
        belief, report = tracker.step(belief, z)
        yield belief, report


def keep(p):
    return p, np.arange(len(p.w))


def by_hand(told, scans, mixing, floor, restart):
    """Every hypothesis of every motion's MHT as (weight, mean, covariance), nothing pruned, and merged
    by mixing alone; the motions' probabilities and the estimate after each scan, and how many MHTs began
    anew until then."""
    H, R = told.sensor
    prior = list(zip(*told.prior, strict=True))
    chances, each, restarts = told.mode_prior, [prior for _ in told.motions], 0
    for z in scans:
        if mixing:
            joint = told.switching * chances
            pools = [
                [(a * w / row.sum(), m, P) for a, p in zip(row, each, strict=True) for w, m, P in p]
                for row in joint
            ]
            each = [
                list(
                    zip(*reference.runnalls(*map(np.array, zip(*pool, strict=True)), len(p))[1], strict=True)
                )
                for pool, p in zip(pools, each, strict=True)
            ]
            chances = joint.sum(axis=1)
        density, new = [], []
        for p, move in zip(each, told.motions, strict=True):
            grown, residuals = [], []
            for w, m, P in p:
                m, P = reference.kalman_predict(m, P, *move)
                S = H @ P @ H.T + R
                grown.append((w * (1 - told.detection_probability), m, P))
                for point in z:
                    likelihood = reference.gaussian_density(point, H @ m, S)
                    share = w * told.detection_probability * likelihood / told.clutter_density
                    grown.append((share, *reference.kalman_update(m, P, H, R, point)))
                    residuals.append((share, point - H @ m, S))
            _, r, A = reference.moment_match(*map(np.array, zip(*residuals, strict=True)))
            density.append(reference.gaussian_density(r, np.zeros(len(r)), A))
            total = sum(w for w, _, _ in grown)
            new.append([(w / total, m, P) for w, m, P in grown])
        chances = chances * density / (chances @ density)
        bad = np.array(density) < restart
        each = new
        if bad.any() and not bad.all():
            restarts += bad.sum()
            rest = chances[~bad].sum()
            fresh = [(chances[i] / rest * w, m, P) for i in np.flatnonzero(~bad) for w, m, P in new[i]]
            each = [fresh if lost else p for lost, p in zip(bad, new, strict=True)]
        chances = floored(chances, floor)
        whole = [(a * w, m, P) for a, p in zip(chances, each, strict=True) for w, m, P in p]
        _, mean, covariance = reference.moment_match(*map(np.array, zip(*whole, strict=True)))
        yield chances, mean, covariance, restarts


@pytest.mark.parametrize(("mixing", "restart"), [(None, 0.0), (None, 0.1), ("augmented", 0.0)])
def test_unreduced_but_by_mixing_it_is_maybecks_filter_written_out(mixing, restart):
    told = reference.jumping_model(2, 2, axes=1, detection_probability=0.9)._replace(gate_probability=1.0)
    scans = reference.flown(told, 3, np.random.default_rng(8), clutter=1)
    tracker = BankOfMhts(told, keep, mixing, 0.05, restart, Limits(0.0, 10**6, np.inf))
    hand = list(by_hand(told, scans, mixing, 0.05, restart))
    for (_, report), (chances, mean, covariance, _) in zip(flight(tracker, scans), hand, strict=True):
        np.testing.assert_allclose(report.modes, chances, rtol=1e-8)
        np.testing.assert_allclose(report.x[0], mean, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(report.P[0], covariance, rtol=1e-7, atol=1e-8)
    assert bool(hand[-1][-1]) == (restart > 0)


@pytest.mark.parametrize(
    ("of_mhts", "alone"), [(mmae_of_mhts, mmae_pda), (imm_of_mhts, ImmPda)], ids=["mmae", "imm"]
)
@pytest.mark.parametrize("reduction", ["runnalls", "ise"])
def test_without_clutter_it_is_the_filter_bank_alone(of_mhts, alone, reduction):
    world = agile_flight(clutter_density=0.0)
    scans = [one[None] for one in draw(world, 0).z]
    both = flight(of_mhts(world.model, 15, reduction), scans), flight(alone(world.model), scans)
    for (_, a), (_, b) in zip(*both, strict=True):
        np.testing.assert_allclose(a.x, b.x, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(a.P, b.P, rtol=1e-8, atol=1e-6)
        np.testing.assert_allclose(a.modes, b.modes, rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("gate_probability", [0.9, 1.0])
def test_with_one_motion_every_architecture_is_the_plain_mht(gate_probability):
    told = reference.jumping_model(7, 1, axes=2, detection_probability=0.9)
    told = told._replace(gate_probability=gate_probability)
    scans = reference.flown(told, 6, np.random.default_rng(7), clutter=3)
    plain = list(plain_mht(told, scans, 6))
    own = [report for _, report in flight(Mht(told, reducer("ise", 6), 1e-5, 0.0), scans)]
    apart = max(np.abs(a.x - b.x).max() for a, b in zip(own, plain, strict=True))
    assert (apart < 1e-8) == (gate_probability == 1)  # else a gate of its own leaves something out
    for name in ("one-motion-6", "mmae-mht-6", "imm-mht-6", "mmae-of-mhts-6", "imm-of-mhts-6", "mmg-6"):
        tracker = make_tracker(name, told, reduction="ise")
        for (_, report), expected in zip(flight(tracker, scans), plain, strict=True):
            np.testing.assert_allclose(report.x, expected.x, rtol=1e-8, atol=1e-8, err_msg=name)
            np.testing.assert_allclose(report.P, expected.P, rtol=1e-7, atol=1e-8, err_msg=name)


def plain_mht(told, scans, components):
    """The plain MHT that looks for every detection in all its gates together."""
    p = told.prior
    for z in scans:
        p = predict(p, told.motion)
        own = gates(p, told.sensor, told.gate_probability)
        listed = z[
            [any(mahalanobis(point, own, i) <= own.threshold for i in range(len(own.z))) for point in z]
        ]
        p = expand(
            p, own._replace(threshold=np.inf), told.sensor, listed,
            told.detection_probability, told.gate_probability, told.clutter_density,
        ).mixture  # fmt: skip
        p = normalised(integral_squared_error(normalised(prune(p, 1e-5)[0]), components)[0])
        mean, covariance = moments(p)
        yield Report(mean[None], covariance[None], own, p)


def mahalanobis(point, gates, i):
    return reference.mahalanobis_squared(point, gates.z[i], gates.S[i])


def test_of_one_motion_is_the_mht_that_knows_no_other():
    told = agile_flight(horizon=30).model._replace(gate_probability=1.0)
    alone = agile_flight(horizon=30, jerks=[4.0]).model._replace(gate_probability=1.0)
    scans = [
        z + 30 * np.random.default_rng(i).standard_normal((4, 2))
        for i, z in enumerate(draw(agile_flight(), 1).z[:30])
    ]
    mine = flight(single_model_mht(told, 10, mode=1, prune_weight=1e-3), scans)
    theirs = flight(Mht(alone, reducer("runnalls", 10), 1e-3, 0.0), scans)
    for (_, a), (_, b) in zip(mine, theirs, strict=True):
        np.testing.assert_allclose(a.x, b.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(a.P, b.P, rtol=1e-8, atol=1e-9)


@given(st.integers(0, 10**6), st.integers(1, 6), st.integers(1, 4))
@settings(max_examples=50, deadline=None)
def test_the_equivalent_residual_is_that_of_the_hypotheses_with_a_detection(seed, n, k):
    rng = np.random.default_rng(seed)
    predicted = Mixture(*reference.random_mixture(rng, n, 4))
    sensor = reference.jumping_model(0, 2, axes=2).sensor
    z = 3 * rng.standard_normal((k, 2))
    S = sensor.H @ predicted.P @ sensor.H.T + sensor.R
    gates = Gates(predicted.m @ sensor.H.T, S, np.inf)
    expansion = expand(predicted, gates, sensor, z, 0.7, 1.0, 0.1)
    log_density = equivalent_residual(
        predicted, expansion, sensor.predict_detections(predicted, *gates[:2], z)
    )
    w = [
        predicted.w[i] * reference.gaussian_density(point, gates.z[i], S[i]) for i in range(n) for point in z
    ]
    residuals = [point - gates.z[i] for i in range(n) for point in z]
    _, r, A = reference.moment_match(np.array(w), np.array(residuals), np.repeat(S, k, axis=0))
    assert log_density == pytest.approx(np.log(reference.gaussian_density(r, 0 * r, A)), rel=1e-7, abs=1e-9)


def test_a_filter_that_has_lost_its_target_is_not_taken_for_the_best():
    """A miss weighs far more than a point a kilometre off; still it is the point that says how well a
    motion does."""
    told = agile_flight().model
    predicted = told.prior
    S = told.sensor.H @ predicted.P @ told.sensor.H.T + told.sensor.R
    gates = Gates(predicted.m @ told.sensor.H.T, S, np.inf)
    z = gates.z + np.array([1000.0, 0.0])
    expansion = expand(predicted, gates, told.sensor, z, 1.0, 0.99, 1e-4)
    assert expansion.mixture.w[expansion.detection >= 0].sum() < 1e-300
    wanted = -0.5 * 1000.0**2 / S[0, 0, 0] - np.log(2 * np.pi * S[0, 0, 0])
    look = told.sensor.predict_detections(predicted, *gates[:2], z)
    assert equivalent_residual(predicted, expansion, look) == pytest.approx(wanted)
    nothing = expand(predicted, gates, told.sensor, z[:0], 1.0, 0.99, 1e-4)
    assert (
        equivalent_residual(predicted, nothing, told.sensor.predict_detections(predicted, *gates[:2], z[:0]))
        == 0.0
    )


@pytest.mark.parametrize(
    ("build", "wrong", "message"),
    [
        (mmae_of_mhts, {"floor": 0.5}, r"floor must lie in \[0, 1 / 2\) for 2 modes, got 0.5"),
        (mmae_of_mhts, {"restart": np.nan}, "restart must be a density, 0 for never, got nan"),
        (imm_of_mhts, {"reduction": "isse"}, "unknown reduction 'isse'; did you mean 'ise'"),
        (imm_of_mhts, {"components": 0}, "components must be"),
        (imm_of_mhts, {"max_hypotheses": 0}, "max_hypotheses must be a whole number, at least 1, got 0"),
        (partial(single_model_mht, mode=2), {}, "mode must be one of the 2 motions, counted from 0, got 2"),
        *(
            (partial(single_model_mht, mode=mode), {}, "mode must be one of the 2 motions")
            for mode in (-1, 1.0, True, "x")
        ),
    ],
)
def test_a_wrong_parameter_is_refused_when_the_tracker_is_made(build, wrong, message):
    with pytest.raises(ValueError, match=message):
        build(agile_flight().model, **wrong)


def test_filters_that_diverge_begin_anew_even_from_motions_called_impossible():
    told = agile_flight().model._replace(mode_prior=np.array([1.0, 0.0]), detection_probability=0.9)
    z = told.sensor.H @ told.prior.m[0] + 110.0 + np.array([[27.0, 0.0]])
    belief, alone = mmae_of_mhts(told, floor=0.0).init(), single_model_mht(told, mode=1)
    belief, _ = mmae_of_mhts(told, floor=0.0, restart=0.0).step(belief, z)
    # between the two motions' densities: the benign one diverges, the other has no probability
    densities = [told_density(told, p, belief.each[p], z) for p in (0, 1)]
    tracker = mmae_of_mhts(told, floor=0.0, restart=np.exp(np.mean(densities)))
    assert densities[0] < densities[1]
    after, report = tracker.step(belief, z)
    assert np.isfinite(report.x).all() and after.each[0].m.shape == after.each[1].m.shape
    np.testing.assert_array_equal(after.each[0].m, after.each[1].m)
    assert alone.step(alone.init(), z)[1].alive


def told_density(told, mode, p, z):
    predicted = predict(p, told.motions[mode])
    looked = gates(predicted, told.sensor, told.gate_probability)._replace(threshold=np.inf)
    expansion = expand(predicted, looked, told.sensor, z, 0.9, told.gate_probability, told.clutter_density)
    return equivalent_residual(
        predicted, expansion, told.sensor.predict_detections(predicted, *looked[:2], z)
    )
