"""Mixing of motions of unlike state: closed forms, the sequences of motions written out, and trackers that
must agree."""

from functools import partial

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from test_imm_pda import about_the_truth, general, turning

from gmr_gym.filters.filter_bank import FilterBank, as_bank, imm_mix, predict_bank
from gmr_gym.filters.imm import mix_and_predict
from gmr_gym.filters.mixing import MIXINGS, borrowed_states
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import Mixture, gaussian
from gmr_gym.models.kalman import motion, position_sensor
from gmr_gym.models.model import model
from gmr_gym.models.motions import constant_velocity, singer, with_accelerations
from gmr_gym.models.switching import sticky_switching
from gmr_gym.scenarios.li import airborne_radar

THAT_MIX = ("imm", "imm-pda", "imm-dcm-pda", "imm-ekf-pda", "imm-dcm-pda-printed", "imm-mht", "imm-of-mhts")
PERIOD, FORGOTTEN = 0.5, 1e-9  # s; m/s^2, of the acceleration that constant velocity is left
SLOW = constant_velocity(PERIOD, 2.0, 1)
SHARP = singer(PERIOD, 5.0, 30.0, 1)
PAIR = (with_accelerations(SLOW, FORGOTTEN), SHARP)
SWITCHING = np.array([[0.9, 0.3], [0.1, 0.7]])


def by_kernel(bank, switching, motions, mixing):
    """Mixed and carried forward as `ImmPda` does it."""
    moves = map(np.array, zip(*motions, strict=True))
    parts = bank.w[:, 0], bank.m[:, 0], bank.P[:, 0]
    return Mixture(*mix_and_predict(*parts, switching, borrowed_states(motions, mixing), *moves))


def by_bank(bank, switching, motions, mixing):
    """Mixed and carried forward as `MhtOfBanks` does it."""
    return predict_bank(imm_mix(bank, switching, borrowed_states(motions, mixing)), motions)


def random_bank(seed, modes, n, d):
    return as_bank(Mixture(*reference.random_mixture(np.random.default_rng(seed), modes * n, d)), modes)


@pytest.mark.parametrize("ahead", [by_kernel, by_bank])
def test_singer_at_50_with_constant_velocity_90_per_cent_likely_predicts_33_augmented_and_49_unbiased(ahead):
    told = airborne_radar("far").model
    m, P = np.zeros((2, 1, 9)), np.tile(np.diag(np.repeat([100.0, 25.0, 1e-6], 3)), (2, 1, 1, 1))
    m[1, 0, 6], P[1, 0, 6:, 6:] = 50.0, 4.0 * np.eye(3)
    bank = FilterBank(np.array([[0.9], [0.1]]), m, P)
    # of Singer's own: 0.95 of what it weighed, beside 0.05 of what constant velocity did
    own = 0.95 * 0.1 / (0.95 * 0.1 + 0.05 * 0.9)
    kept = np.exp(-0.1 / 5.0)  # of an acceleration, over a period
    for mixing, share, wanted in (("augmented", own, 33.3), ("unbiased", 1.0, 49.0)):
        predicted = ahead(bank, told.switching, told.motions, mixing)
        assert predicted.m[1, 6] == pytest.approx(share * 50.0 * kept, rel=1e-12)
        assert predicted.m[1, 6] == pytest.approx(wanted, abs=0.05)
        before = share * 4.0 + (1 - share) * 1e-6 + share * (1 - share) * 50.0**2
        fresh = told.motions[1].Q[6, 6]
        assert predicted.P[1, 6, 6] == pytest.approx(kept**2 * before + fresh, rel=1e-12)


def handed_over(mixing, before, after, m, P, own):
    """State of a filter that followed motion `before`, of 2 states or 3, as one of motion `after`; `own` is
    the mean and covariance of the filter that followed `after`."""
    if before == after:
        return m, P
    if before == 1:
        return m[:2], P[:2, :2]
    m, P = np.append(m, 0.0), np.pad(P, (0, 1))
    if mixing == "unbiased":
        m[2], P[2, 2] = own[0][2], own[1][2, 2]
    return m, P


@pytest.mark.parametrize("mixing", MIXINGS)
def test_two_scans_ahead_are_the_moments_of_all_sequences_of_motions(mixing):
    sensor, z = position_sensor(3.0, 1, 2), np.array([[12.0]])
    prior = gaussian([3.0, 20.0, 15.0], [[40.0, 5.0, 0.0], [5.0, 30.0, 0.0], [0.0, 0.0, 25.0]])
    told = model(PAIR, sensor, 1.0, 1.0, 1e-12, prior, SWITCHING, [0.6, 0.4])
    tracker = make_tracker("imm", told, mixing=mixing)
    belief, _ = tracker.step(tracker.init(), z)
    ahead = by_kernel(belief, SWITCHING, PAIR, mixing)

    # written out, constant velocity with no acceleration at all
    first = []
    for q, move in enumerate((SLOW, SHARP)):
        d = len(move.F)
        H = sensor.H[:, :d]
        m, P = reference.kalman_predict(prior.m[0, :d], prior.P[0, :d, :d], *move)
        weight = SWITCHING[q] @ told.mode_prior
        weight *= reference.gaussian_density(z[0], H @ m, H @ P @ H.T + sensor.R)
        first.append((weight, *reference.kalman_update(m, P, H, sensor.R, z[0])))
    whole = sum(weight for weight, _, _ in first)
    for q, move in enumerate((SLOW, SHARP)):
        d = len(move.F)
        sequences = []
        for p, (weight, m, P) in enumerate(first):
            m, P = handed_over(mixing, p, q, m, P, first[q][1:])
            sequences.append((SWITCHING[q, p] * weight / whole, *reference.kalman_predict(m, P, *move)))
        weight, m, P = reference.moment_match(*map(np.array, zip(*sequences, strict=True)))
        assert ahead.w[q] == pytest.approx(weight, rel=1e-9)
        np.testing.assert_allclose(ahead.m[q, :d], m, rtol=1e-9)
        np.testing.assert_allclose(ahead.P[q, :d, :d], P, rtol=1e-8, atol=1e-9)


@given(st.integers(0, 10**6), st.sampled_from([by_kernel, by_bank]))
@settings(max_examples=30, deadline=None)
def test_what_all_motions_have_is_mixed_alike_and_covariances_stay_definite(seed, ahead):
    bank = random_bank(seed, 2, 1, 3)
    one, other = (imm_mix(bank, SWITCHING, borrowed_states(PAIR, mixing)) for mixing in MIXINGS)
    np.testing.assert_array_equal(one.w, other.w)
    np.testing.assert_allclose(other.m[..., :2], one.m[..., :2], rtol=1e-13)
    np.testing.assert_allclose(other.P[..., :2, :2], one.P[..., :2, :2], rtol=1e-13)
    assert (other.P == np.swapaxes(other.P, -1, -2)).all()
    np.linalg.cholesky(other.P)
    np.linalg.cholesky(ahead(bank, SWITCHING, PAIR, "unbiased").P)


def test_of_three_motions_each_borrows_from_the_one_it_is_mixed_into():
    still = motion(np.diag([1.0, 0.0, 0.0]), np.diag([1.0, 4.0, 9.0]))
    motions = (still, PAIR[0], SHARP)
    lacks = ({1, 2}, {2}, set())
    borrowed = borrowed_states(motions, "unbiased")
    wanted = [[[s in lacks[p] - lacks[q] for s in range(3)] for p in range(3)] for q in range(3)]
    assert borrowed.tolist() == wanted
    bank, switching = random_bank(4, 3, 2, 3), sticky_switching(0.6, 3)
    got = imm_mix(bank, switching, borrowed)
    for j in range(2):
        for q in range(3):
            means, covariances = bank.m[:, j].copy(), bank.P[:, j].copy()
            for p in range(3):
                for s in lacks[p] - lacks[q]:
                    means[p, s] = bank.m[q, j, s]
                    covariances[p, s], covariances[p, :, s] = 0.0, 0.0
                for s in lacks[p] - lacks[q]:
                    for t in lacks[p] - lacks[q]:
                        covariances[p, s, t] = bank.P[q, j, s, t]
            total, mean, covariance = reference.moment_match(switching[q] * bank.w[:, j], means, covariances)
            assert got.w[q, j] == pytest.approx(total, rel=1e-13)
            np.testing.assert_allclose(got.m[q, j], mean, rtol=1e-12)
            np.testing.assert_allclose(got.P[q, j], covariance, rtol=1e-11, atol=1e-13)


def test_an_acceleration_that_is_kept_is_no_missing_one():
    frozen = with_accelerations(SLOW)
    frozen.F[2, 2] = 1.0
    assert not borrowed_states((frozen, SHARP), "unbiased").any()
    assert not borrowed_states(PAIR, "augmented").any()


def flown(tracker, scans):
    belief = tracker.init()
    for z in scans:
        belief, report = tracker.step(belief, z)
        yield report


def apart(ours, theirs):
    return max(np.abs(a.x - b.x).max() for a, b in zip(ours, theirs, strict=True))


@pytest.mark.parametrize("name", THAT_MIX)
def test_every_tracker_that_mixes_takes_the_mixing(name):
    scenario = turning("far")
    scans = about_the_truth(scenario, 0, 25)
    unlike = partial(make_tracker, name, scenario.model)
    unless_told, as_given, other = (
        list(flown(unlike(**how), scans)) for how in ({}, *({"mixing": mixing} for mixing in MIXINGS))
    )
    assert apart(unless_told, as_given) == 0 and apart(as_given, other) > 0.1
    like = scenario.model._replace(motions=(singer(0.1, 5.0, 30.0), singer(0.1, 2.0, 5.0)))
    both = (flown(make_tracker(name, like, mixing=mixing), scans[:8]) for mixing in MIXINGS)
    assert apart(*both) == 0
    with pytest.raises(ValueError, match="mixing must be one of 'augmented', 'unbiased', got 'shared'"):
        unlike(mixing="shared")


@pytest.mark.parametrize("name", ["mmg", "gpb1", "gpb2", "b-best", "mmae", "mmae-pda", "mmae-of-mhts"])
def test_a_tracker_that_does_not_mix_takes_none(name):
    with pytest.raises(ValueError, match="takes no parameter 'mixing'"):
        make_tracker(name, turning("far").model, mixing="unbiased")


@pytest.mark.parametrize("mixing", MIXINGS)
def test_where_there_is_one_hypothesis_all_of_them_mix_alike(mixing):
    scenario = turning("near", clutter_rate=0.0)
    told = scenario.model
    scans = [z for z in about_the_truth(scenario, 3, 25) if len(z)]
    imm = list(flown(make_tracker("imm", told, mixing=mixing), scans))
    banks = general(told)
    object.__setattr__(banks, "before", partial(imm_mix, borrowed=borrowed_states(told.motions, mixing)))
    others = banks, *(make_tracker(name, told, mixing=mixing) for name in ("imm-mht", "imm-of-mhts"))
    for other in others:
        for a, b in zip(imm, flown(other, scans), strict=True):
            np.testing.assert_allclose(b.x, a.x, rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(b.P, a.P, rtol=1e-6, atol=1e-6)
            np.testing.assert_allclose(b.modes, a.modes, rtol=1e-6, atol=1e-9)
