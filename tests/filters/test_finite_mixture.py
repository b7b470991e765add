"""The mixture of one scan: expectation maximisation against a plain form, Gibbs against what was drawn, and
the trackers that live on it."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gmr_gym.baselines.fmm import Tracks, fmm_em, fmm_gibbs
from gmr_gym.baselines.pda import Pda
from gmr_gym.checks import check_whole
from gmr_gym.evaluation.montecarlo import run
from gmr_gym.filters.clutter_estimation import responsibilities
from gmr_gym.filters.finite_mixture import (
    ScanMixture,
    em_options,
    fit_em,
    initial,
    log_likelihood,
    maximised,
    merge_and_prune,
    variance,
)
from gmr_gym.filters.gibbs import fit_gibbs
from gmr_gym.mixture import Mixture, gaussian, log_density
from gmr_gym.models.clutter import no_components, uniform_clutter
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.model import model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.scenarios.lv import unknown_clutter

FLAT = 1 / 4e6
R = 12.5**2 * np.eye(2)
HOW = em_options()


def scan_and_parts(seed, n=60, c=4, t=3):
    rng = np.random.default_rng(seed)
    group = rng.multivariate_normal([400, 200], np.diag([120.0, 80.0]) ** 2, n // 2)
    z = rng.permutation(np.concatenate([rng.uniform(-1000, 1000, (n - n // 2, 2)), group]))
    targets = Mixture(np.ones(t), z[c : c + t] + rng.normal(0, 10, (t, 2)), np.tile(R, (t, 1, 1)))
    return z, initial(no_components(2), z[:c], z, targets, 15.0)


def plain_log_likelihood(z, parts):
    g = Mixture(parts.w[1:], parts.m, parts.P)
    return np.logaddexp(np.log(parts.w[0] * FLAT), log_density(g, z)).sum()


def told(births=None, clutter=5.0, spawn=0.0):
    return multi_target_model(
        constant_velocity(1.0, 0.5), position_sensor(10.0), 0.98, 0.99,
        no_components(4) if births is None else births,
        uniform_clutter([-1000.0, -1000.0], [1000.0, 1000.0], clutter), spawn,
        np.diag([100.0, 100.0, 25.0, 25.0]),
    )  # fmt: skip


def one_birth():
    return Mixture(np.array([0.1]), np.zeros((1, 4)), np.diag([100.0, 100.0, 100.0, 100.0])[None])


def alike(first, second):
    for a, b in zip(first, second, strict=True):
        if isinstance(a, tuple):
            alike(a, b)
        else:
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("seed", range(5))
def test_a_step_of_the_fit_is_expectation_maximisation_with_covariances_of_targets_known(seed):
    z, parts = scan_and_parts(seed)
    joint = [np.full(len(z), parts.w[0] * FLAT)]
    gaussians = zip(parts.w[1:], parts.m, parts.P, strict=True)
    joint += [w * multivariate_normal(*one).pdf(z) for w, *one in gaussians]
    joint = np.array(joint).T
    share = joint / joint.sum(axis=1, keepdims=True)
    w, m, P = maximised(z, responsibilities(z, *parts[:3], FLAT), parts.m, parts.P, 4, 1e-3)
    np.testing.assert_allclose(w, share.mean(axis=0), rtol=1e-9)
    for i in range(7):
        r = share[:, i + 1] / share[:, i + 1].sum()
        np.testing.assert_allclose(m[i], r @ z, rtol=1e-8)
        spread = np.einsum("n,ni,nj->ij", r, z - m[i], z - m[i]) if i < 4 else R
        np.testing.assert_allclose(P[i], spread, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("deviation", [1.0, 15.0, 60.0])
@pytest.mark.parametrize("seed", range(8))
def test_the_likelihood_never_falls_between_managements_even_at_the_floor(seed, deviation):
    z, parts = scan_and_parts(seed)
    w, m, P = parts.w, parts.m, parts.P.copy()
    P[:4] += deviation**2 * np.eye(2)
    before = -np.inf
    for _ in range(40):
        share = responsibilities(z, w, m, P, FLAT)
        value = log_likelihood(share, w[0] * FLAT)
        assert value >= before - 1e-9 * abs(value)  # rounding
        assert value == pytest.approx(plain_log_likelihood(z, ScanMixture(w, m, P, parts.origin)), rel=1e-9)
        before = value
        w, m, P = maximised(z, share, m, P, 4, deviation)
        assert w.sum() == pytest.approx(1)
        assert np.linalg.eigvalsh(P[:4]).min() >= deviation**2 * (1 - 1e-9)


def test_parts_merge_among_their_kind_alone_and_the_first_target_keeps_its_number_and_covariance():
    m = np.array([[0.0, 0], [30, 0], [500, 0], [0, 0], [5, 0], [300, 0]])
    P = np.array([400.0 * np.eye(2)] * 3 + [R, 2 * R, R])
    w = np.array([0.2, 0.2, 0.1, 0.02, 0.1, 0.37, 0.01])
    parts = ScanMixture(w, m, P, np.array([0, 1, 2]))
    w_out, m_out, P_out, origin = merge_and_prune(parts, 50, 4.0, 4.0, 3.0, 0.6)
    assert origin.tolist() == [0]  # the third, and the clutter about (500, 0), are pruned
    np.testing.assert_allclose(m_out[0], [10, 0])
    np.testing.assert_allclose(P_out[0], [[400 + 200, 0], [0, 400]])  # weights 2 : 1, 30 m apart
    np.testing.assert_allclose(m_out[1], [5 * 0.37 / 0.47, 0])
    np.testing.assert_allclose(P_out[1], R)
    np.testing.assert_allclose(w_out, np.array([0.2, 0.3, 0.47]) / 0.97)


def test_a_fit_does_not_depend_on_the_order_of_detections():
    z, parts = scan_and_parts(3)
    order = np.random.default_rng(0).permutation(len(z))
    one, value = fit_em(z, parts, FLAT, HOW)
    other, same = fit_em(z[order], parts, FLAT, HOW)
    assert value == pytest.approx(same, rel=1e-9)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6)


def test_a_fit_finds_a_target_beside_a_group_of_clutter():
    z, _ = scan_and_parts(1)
    target = Mixture(np.ones(1), np.array([[-600.0, 610.0]]), R[None])
    z = np.append(z, [[-605.0, 600.0]], axis=0)
    z = z[(np.linalg.norm(z - z[-1], axis=1) > 150) | (np.arange(len(z)) == len(z) - 1)]
    fitted, _ = fit_em(z, initial(no_components(2), z[:6], z, target, 15.0), FLAT, HOW)
    assert fitted.origin.tolist() == [0]
    np.testing.assert_allclose(fitted.m[-1], [-605, 600], atol=1e-3)
    assert len(z) * fitted.w[-1] == pytest.approx(1, abs=0.05)


def test_the_first_width_is_a_tenth_of_the_mean_variance_but_for_the_floor():
    z = np.array([[0.0, 0], [200, 0], [0, 200], [200, 200]])
    assert variance(z, 1.0) == pytest.approx(1e4 / 10)
    assert variance(z, 50.0) == 2500 and variance(z[:0], 50.0) == 2500


def test_gibbs_recovers_a_mixture_from_many_points():
    rng = np.random.default_rng(4)
    truth = [[400.0, 200.0], [-300.0, 300.0]], [np.diag([120.0, 80.0]) ** 2, 6e3 * np.eye(2) + 2e3]
    target, n = np.array([0.0, -600.0]), (1500, 1200, 900, 400)
    z = np.concatenate([
        rng.uniform(-1000, 1000, (n[0], 2)), rng.multivariate_normal(truth[0][0], truth[1][0], n[1]),
        rng.multivariate_normal(truth[0][1], truth[1][1], n[2]), rng.multivariate_normal(target, R, n[3]),
    ])  # fmt: skip
    start = Mixture(np.ones(1), target[None] + 8, R[None])
    places = np.array([[300.0, 100.0], [-200.0, 350.0]])
    fitted = fit_gibbs(
        z, initial(no_components(2), places, z, start, 15.0), FLAT, HOW, np.random.default_rng(0)
    )
    assert fitted.gaussians == 2 and fitted.origin.tolist() == [0]
    number = fitted.w * len(z)
    # six standard errors and more: sqrt(n) of a number, deviation / sqrt(n) of a mean, with overlap besides
    np.testing.assert_allclose(number, n, atol=6 * np.sqrt(1500))
    np.testing.assert_allclose(fitted.m[:2], truth[0], atol=6 * 120 / np.sqrt(900))
    np.testing.assert_allclose(fitted.m[2], target, atol=6 * 12.5 / np.sqrt(400))
    np.testing.assert_allclose(fitted.P[:2], truth[1], atol=6 * 120**2 * np.sqrt(2 / 900))
    np.testing.assert_array_equal(fitted.P[2], R)


def test_gibbs_and_expectation_maximisation_agree_on_one_gaussian():
    z = np.random.default_rng(2).multivariate_normal([100, -50], [[900, 300], [300, 1600]], 2000)
    parts = initial(no_components(2), np.array([[90.0, -40.0]]), z, no_components(2), 15.0)
    by_em = fit_em(z, parts, FLAT, HOW)[0]
    drawn = fit_gibbs(z, parts, FLAT, HOW, np.random.default_rng(1), sweeps=200)
    # a draw is off by deviation / sqrt(n), the average of 200 by a fourteenth of that
    np.testing.assert_allclose(drawn.m, by_em.m, atol=6 * 40 / np.sqrt(2000 * 200))
    np.testing.assert_allclose(drawn.P, by_em.P, atol=6 * 1600 * np.sqrt(2 / 2000 / 200) + 20)


def test_a_single_target_in_sparse_uniform_clutter_is_followed_as_by_pda():
    rng = np.random.default_rng(7)
    people = told(clutter=4.0)
    motion, sensor = people.motion, people.sensor
    P = np.diag([100.0, 100.0, 25.0, 25.0])
    start = gaussian([-300.0, 0.0, 15.0, 5.0], P)
    pda = Pda(model(motion, sensor, 0.98, 0.999, 4 * FLAT, start))
    tracker = fmm_em(people, repaired=True)
    belief = Tracks(start, np.array([0]), np.array([9]), np.array([0]), 1, people.clutter, 0)
    other, x, apart, errors = start, start.m[0], [], []
    for _ in range(40):
        x = motion.F @ x
        z = np.concatenate([sensor.H @ x + rng.normal(0, 10, (1, 2)), rng.uniform(-1000, 1000, (4, 2))])
        belief, account = tracker.step(belief, z)
        other, report = pda.step(other, z)
        assert account.label.tolist() == [0]
        apart.append(np.linalg.norm(account.x[0, :2] - report.x[0, :2]))
        errors.append(np.linalg.norm(account.x[0, :2] - x[:2]))
    assert np.median(apart) < 0.5 and np.mean(errors) < 12  # m; the sensor alone is off by 12.5


@pytest.mark.parametrize("make", [fmm_em, fmm_gibbs])
def test_repaired_it_tracks_better(make):
    world = unknown_clutter()
    found = run(world, {r: make(world.model, repaired=r) for r in (False, True)}, 8)
    saved = (found[False].ospa - found[True].ospa).mean(axis=1)
    # m, in the same episodes; over a hundred runs it is near 28, with a deviation of 20 in a run
    assert saved.mean() > 28 - 2 * 20 / np.sqrt(8)


@pytest.mark.parametrize("make", [fmm_em, fmm_gibbs])
def test_a_lone_detection_of_a_birth_is_the_targets_and_not_clutters(make):
    tracker = make(told(one_birth()), repaired=True)
    belief = tracker.init()
    for _ in range(6):
        belief, account = tracker.step(belief, np.array([[5.0, -5.0]]))
    assert len(account.x) == 1 and account.existence[0] > 0.5


@pytest.mark.parametrize("make", [fmm_em, fmm_gibbs])
@pytest.mark.parametrize("repaired", [False, True])
def test_odd_scans_are_survived(make, repaired):
    tracker = make(told(one_birth(), spawn=0.01), repaired=repaired)
    rng = np.random.default_rng(0)
    belief = tracker.init()
    scans = [
        [], [[0.0, 0.0]], [[3.0, 4.0]] * 2, [[5.0, 5.0]] * 30, [], [[1e6, -1e6]],
        rng.uniform(-1000, 1000, (10_000, 2)), [], [[0.0, 0.0], [1.0, 1.0]],
    ]  # fmt: skip
    for z in scans:
        belief, account = tracker.step(belief, np.array(z))
        assert account.expected_targets == pytest.approx(account.intensity.w.sum())
        assert len(account.x) == len(account.existence) == len(account.label)
        assert ((account.existence >= 0) & (account.existence <= 1)).all()
        assert len(set(account.label.tolist())) == len(account.label)
        assert np.isfinite(account.x).all() and np.isfinite(account.intensity.P).all()
        assert (account.clutter.density(np.zeros((1, 2))) > 0).all()


def test_as_printed_a_target_that_is_missed_once_is_gone_and_repaired_it_coasts():
    people = told()
    start = gaussian([-300.0, 0.0, 0.0, 0.0], np.diag([100.0, 100.0, 25.0, 25.0]))
    began = Tracks(start, np.array([4]), np.array([9]), np.array([0]), 5, people.clutter, 0)
    nothing_near = np.array([[900.0, 900.0], [-900.0, -800.0]])
    _, printed = fmm_em(people, gaussians=0).step(began, nothing_near)
    assert len(printed.x) == 0 and printed.expected_targets == 0
    tracker, belief = fmm_em(people, repaired=True, gaussians=0, patience=2), began
    for named in (1, 1, 0):
        belief, account = tracker.step(belief, nothing_near)
        assert len(account.x) == named
    belief, _ = tracker.step(began, nothing_near)
    _, account = tracker.step(belief, np.array([[-295.0, 5.0]]))
    assert account.label.tolist() == [4] and account.existence[0] > 0.9


def test_a_birth_is_named_as_printed_at_once_and_repaired_when_established():
    z = np.array([[2.0, 1.0], [700.0, 700.0], [-500.0, 300.0]])
    for repaired, counts in ((False, [1, 1, 1]), (True, [0, 0, 1])):
        tracker = fmm_em(told(one_birth()), repaired=repaired, gaussians=0, establishing=3)
        belief, seen = tracker.init(), []
        for _ in range(3):
            belief, account = tracker.step(belief, z)
            seen.append(len(account.x))
        assert seen == counts


@pytest.mark.parametrize("make", [fmm_em, fmm_gibbs])
def test_the_same_belief_and_scan_give_the_same_account_and_the_seed_matters(make):
    z, _ = scan_and_parts(0)
    people = unknown_clutter().model
    tracker = make(people)
    belief, _ = tracker.step(tracker.init(), z)
    alike(tracker.step(belief, z), tracker.step(belief, z))
    other = make(people, seed=1)
    assert len(tracker.step(belief, z)[1].clutter.gaussians.w) > 0
    first, second = (one.step(belief, z)[1].clutter.uniform for one in (tracker, other))
    assert first != second


def test_two_targets_that_meet_are_one_as_printed_and_repaired_both_live_on():
    people = told()
    m = np.array([[0.0, 0.0, 10.0, 0.0], [8.0, 0.0, -10.0, 0.0]])
    both = Mixture(np.ones(2), m, np.tile(np.diag([50.0, 50.0, 25.0, 25.0]), (2, 1, 1)))
    began = Tracks(both, np.arange(2), np.array([9, 9]), np.zeros(2, int), 2, people.clutter, 0)
    z = np.array([[4.0, 1.0], [5.0, -3.0]])
    assert len(fmm_em(people, gaussians=0).step(began, z)[1].x) == 1
    assert len(fmm_em(people, repaired=True, gaussians=0).step(began, z)[1].x) == 2


def test_what_is_found_beyond_the_gate_is_not_found():
    people = told()
    start = gaussian([-300.0, 0.0, 0.0, 0.0], np.diag([100.0, 100.0, 25.0, 25.0]))
    began = Tracks(start, np.array([4]), np.array([9]), np.array([0]), 5, people.clutter, 0)
    z = np.array([[-300.0, 50.0]])  # more than three deviations of sqrt(100 + 25 + 100) m
    for gate, y in ((9.0, 0.0), (1e6, 27.8)):  # 50 * 125 / 225, but for the process noise
        _, account = fmm_em(people, repaired=True, gaussians=0, gate=gate).step(began, z)
        assert account.x[0, 1] == pytest.approx(y, abs=0.1)


def test_the_spawned_merge_into_their_parent_as_printed_and_aside_become_targets():
    people = told(spawn=0.01)
    start = gaussian([0.0, 0.0, 0.0, 0.0], np.diag([50.0, 50.0, 25.0, 25.0]))
    began = Tracks(start, np.array([0]), np.array([9]), np.array([0]), 1, people.clutter, 0)
    z = np.array([[0.0, 0.0], [42.0, 0.0]])
    assert len(fmm_em(people, gaussians=0).step(began, z)[1].intensity.w) == 1
    after, account = fmm_em(people, repaired=True, gaussians=0).step(began, z)
    assert account.label.tolist() == [0] and len(after.label) == 2
    assert after.targets.m[1, 0] == pytest.approx(42, abs=3)


def test_clutter_and_targets_account_for_all_detections():
    z, _ = scan_and_parts(5)
    tracker = fmm_em(unknown_clutter().model)
    _, account = tracker.step(tracker.init(), z)
    explained = account.clutter.expected + account.expected_targets
    assert len(z) - 1 <= explained <= len(z) + 1e-9  # a target counts no more than once


@pytest.mark.parametrize(
    "name, value",
    [
        ("merging", -1.0), ("clutter_least", np.nan), ("target_least", -0.1), ("deviation", 0.0),
        ("gaussians", -1), ("gaussians", 1.5), ("seed", -1), ("patience", -1), ("establishing", 0),
        ("spawn_distance", -1.0), ("gate", 0.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("make", [fmm_em, fmm_gibbs])
def test_a_wrong_parameter_is_refused_by_name(make, name, value):
    with pytest.raises(ValueError, match=name):
        make(told(), repaired=True, **{name: value})


@pytest.mark.parametrize(
    "make, name, value",
    [
        (fmm_em, "tolerance", -1.0),
        (fmm_em, "iterations", 0),
        (fmm_em, "repaired", "false"),
        (fmm_gibbs, "burn", -1),
        (fmm_gibbs, "sweeps", 0),
    ],
)
def test_a_wrong_limit_of_the_fit_is_refused_by_name(make, name, value):
    with pytest.raises(ValueError, match=name):
        make(told(), **{name: value})


@pytest.mark.parametrize("value", [np.inf, np.nan, True])
def test_what_is_no_number_is_not_whole(value):
    with pytest.raises(ValueError, match="seed must be a whole number"):
        check_whole("seed", value, 0)
