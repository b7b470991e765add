"""Multiple model adaptive estimation against Maybeck's formulae in plain NumPy, and its known limits."""

import numpy as np
import pytest
import reference
from scipy.stats import multivariate_normal

from gmr_gym.baselines.imm_pda import ImmPda
from gmr_gym.baselines.mht import Mht
from gmr_gym.baselines.mht_of_banks import MhtOfBanks, imm_mht, mmae_mht, mmae_pda
from gmr_gym.filters.filter_bank import as_bank, imm_output, no_interaction, restart_and_floor
from gmr_gym.filters.joint_gating import Limits
from gmr_gym.mixture import Mixture, moments
from gmr_gym.reduction.registry import reducer
from gmr_gym.scenarios.maybeck import agile_flight
from gmr_gym.simulation.single_target import draw


def random_bank(seed, modes=3, n=4, d=2):
    rng = np.random.default_rng(seed)
    return as_bank(Mixture(*reference.random_mixture(rng, modes * n, d)), modes)


def flight(tracker, scans):
    belief = tracker.init()
    for z in scans:
        belief, report = tracker.step(belief, z)
        yield belief, report


def detections(told, count, seed):
    """One detection a scan of a target that switches as the model says."""
    return reference.flown(told, count, np.random.default_rng(seed), clutter=0)


def test_tending_leaves_a_bank_alone_where_nothing_diverges_and_nothing_is_low():
    bank = random_bank(0)
    got = restart_and_floor(bank, np.full((3, 4), -2.0), floor=0.0, restart=np.exp(-9.0))
    np.testing.assert_array_equal(got.m, bank.m)
    np.testing.assert_array_equal(got.P, bank.P)
    np.testing.assert_allclose(got.w, bank.w, rtol=1e-12)


def test_a_filter_that_diverges_begins_anew_from_the_others_of_its_hypothesis():
    bank, log_density = random_bank(1), np.zeros((3, 4))
    log_density[0, 1], log_density[:, 2] = (
        -9.1,
        -50.0,
    )  # one filter of the second hypothesis, all of the third
    got = restart_and_floor(bank, log_density, floor=0.0, restart=np.exp(-9.0))
    others = [bank.w[1:, 1], bank.m[1:, 1], bank.P[1:, 1]]
    _, mean, covariance = reference.moment_match(*others)
    np.testing.assert_allclose(got.m[0, 1], mean, rtol=1e-12)
    np.testing.assert_allclose(got.P[0, 1], covariance, rtol=1e-10)
    untouched = np.ones((3, 4), bool)
    untouched[0, 1] = False
    np.testing.assert_array_equal(got.m[untouched], bank.m[untouched])
    np.testing.assert_allclose(got.w, bank.w, rtol=1e-12)


def test_no_model_of_a_hypothesis_falls_below_the_floor_and_hypotheses_keep_their_weight():
    bank = random_bank(2)
    bank = bank._replace(w=bank.w * np.array([1e-9, 1.0, 1.0])[:, None])
    got = restart_and_floor(bank, np.zeros((3, 4)), floor=1e-3, restart=1e-5)
    np.testing.assert_allclose(got.w.sum(axis=0), bank.w.sum(axis=0), rtol=1e-12)
    assert (got.w / got.w.sum(axis=0)).min() == pytest.approx(1e-3, rel=1e-12)


@pytest.mark.parametrize("restart", [0.0, 0.01])
def test_without_clutter_it_is_maybecks_filter_bank(restart):
    told = reference.jumping_model(3, 3, axes=1, detection_probability=1.0)._replace(gate_probability=1.0)
    z = detections(told, 12, 3)
    H, R = told.sensor
    p, m, P = told.mode_prior, [told.prior.m[0]] * 3, [told.prior.P[0]] * 3
    restarted = 0
    for (_, report), scan in zip(flight(mmae_pda(told, floor=1e-2, restart=restart), z), z, strict=True):
        density = np.empty(3)
        for i, move in enumerate(told.motions):
            m[i], P[i] = reference.kalman_predict(m[i], P[i], *move)
            S = H @ P[i] @ H.T + R
            density[i] = multivariate_normal.pdf(scan[0], H @ m[i], S)
            m[i], P[i] = reference.kalman_update(m[i], P[i], H, R, scan[0])
        p = p * density / (p @ density)
        bad = density < restart
        if bad.any() and not bad.all():
            restarted += 1
            _, mean, covariance = reference.moment_match(p[~bad], np.array(m)[~bad], np.array(P)[~bad])
            m = [mean if lost else old for lost, old in zip(bad, m, strict=True)]
            P = [covariance if lost else old for lost, old in zip(bad, P, strict=True)]
        low = p < 1e-2
        while low.any():  # what the raised ones need is taken from the others in proportion
            p = np.where(low, 1e-2, p * (1 - 1e-2 * low.sum()) / p[~low].sum())
            low = p < 1e-2 * (1 - 1e-12)
        _, mean, covariance = reference.moment_match(p, np.array(m), np.array(P))
        # textbook inverses over a dozen scans: rounding, with room
        np.testing.assert_allclose(report.x[0], mean, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(report.P[0], covariance, rtol=1e-7, atol=1e-7)
    assert bool(restarted) == (restart > 0)


def test_without_switching_floor_and_restarts_it_is_the_imm():
    told = reference.jumping_model(5, 3, axes=2, detection_probability=0.9)
    told = told._replace(switching=np.eye(3))
    z = reference.flown(told, 6, np.random.default_rng(5), clutter=3)
    for mine, theirs in (
        (mmae_pda(told, floor=0.0, restart=0.0), ImmPda(told)),
        (mmae_mht(told, 8, floor=0.0, restart=0.0), imm_mht(told, 8)),
    ):
        for (_, a), (_, b) in zip(flight(mine, z), flight(theirs, z), strict=True):
            np.testing.assert_allclose(a.x, b.x, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(a.P, b.P, rtol=1e-8, atol=1e-9)


def test_with_one_model_it_is_the_plain_mht():
    told = reference.jumping_model(7, 1, axes=2, detection_probability=0.9)._replace(gate_probability=1.0)
    z = reference.flown(told, 6, np.random.default_rng(7), clutter=3)
    plain = Mht(told, reducer("runnalls", 6), prune_weight=0.0, prune_density=0.0)
    for (_, a), (_, b) in zip(flight(mmae_mht(told, 6, prune_weight=0.0), z), flight(plain, z), strict=True):
        np.testing.assert_allclose(a.x, b.x, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(a.P, b.P, rtol=1e-8, atol=1e-8)


def test_probability_flows_to_the_aggressive_model_when_the_f16_jinks_and_back_after():
    world = agile_flight(clutter_density=0.0)
    tracker, chances = mmae_pda(world.model), []
    for seed in range(6):
        z = [one[None] for one in draw(world, seed).z]
        chances.append([belief.w[1, 0] for belief, _ in flight(tracker, z)])
    level, jinks, after = (np.mean(np.array(chances)[:, span], axis=1) for span in (
        slice(20, 44), slice(205, 245), slice(300, 350)
    ))  # fmt: skip
    # in every one of six runs
    assert (jinks > level + 0.2).all() and (jinks > after + 0.2).all()


def test_an_unreduced_bank_keeps_every_association():
    told = reference.jumping_model(1, 2, axes=1, detection_probability=0.8)._replace(gate_probability=1.0)
    z = [np.array([[0.0], [1.0]]), np.array([[0.5]])]

    def keep(p):
        return p, np.arange(len(p.w))

    ((_, first), (belief, second)) = flight(
        MhtOfBanks(told, keep, no_interaction, no_interaction, Limits(0.0)), z
    )
    assert len(first.mixture.w) == 3 and len(second.mixture.w) == 6
    np.testing.assert_allclose(moments(imm_output(belief))[0], second.x[0], rtol=1e-12)


@pytest.mark.parametrize("build", [mmae_pda, mmae_mht])
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"floor": 0.5}, r"floor must lie in \[0, 1 / 2\) for 2 modes, got 0.5"),
        ({"floor": np.nan}, "floor must lie in"),
        ({"restart": -1.0}, "restart must be a density, 0 for never, got -1"),
        ({"restart": np.nan}, "restart must be a density, 0 for never, got nan"),
    ],
)
def test_a_wrong_floor_or_restart_is_refused_when_the_tracker_is_made(build, wrong, message):
    with pytest.raises(ValueError, match=message):
        build(agile_flight().model, **wrong)
