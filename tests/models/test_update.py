"""A detection leaves the covariance that Bayes' rule has, however much wider than the noise it was."""

import mpmath
import numpy as np
import pytest

from gmr_gym.baselines.imm_dcm_pda_printed import Printed
from gmr_gym.filters.association import expand
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import gaussian, mixture
from gmr_gym.models import radar
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import Motion, position_sensor, sensor
from gmr_gym.models.model import model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.models.spherical import jacobian_of
from gmr_gym.points import FARTHEST

SIGMA = 0.01  # m, of the sensor
RATIOS = [1.0, 1e3, 1e4, 1e6, 1e8, 1e10, 1e12]
# P - W'W may round the last 1e-16 of a variance 1e8 times the noise's
CLOSE = 1e-7
ALONE = 1e-100  # m^-2, clutter that weighs nothing even beside a prior as wide


def bayes(P, C, S):
    """Gain (d, p) and covariance (d, d), C' S^-1 and P - C' S^-1 C, to fifty digits."""
    with mpmath.workdps(50):
        P, C, S = (mpmath.matrix(np.asarray(a).tolist()) for a in (P, C, S))
        K = C.T * mpmath.inverse(S)
        return np.array(K.tolist(), float), np.array((P - K * C).tolist(), float)


def seen_by(see, P):
    """`bayes` for a linear sensor."""
    with mpmath.workdps(50):
        P, H, R = (mpmath.matrix(a.tolist()) for a in (P, see.H, see.R))
        return bayes(P.tolist(), (H * P).tolist(), (H * P * H.T + R).tolist())


def assert_right(P, wanted, tolerance=CLOSE):
    """Every entry in units of the deviations; and definite."""
    deviations = np.sqrt(np.diag(wanted))
    unit = np.outer(deviations, deviations)
    np.testing.assert_allclose(P / unit, wanted / unit, rtol=0, atol=tolerance)
    assert (P == P.T).all() and (np.diag(np.linalg.cholesky(P)) > 0).all()


def correlated(deviations, seed):
    """A covariance of those deviations (d,) whose correlations are drawn."""
    A = np.random.default_rng(seed).standard_normal((len(deviations), 3 * len(deviations)))
    scale = deviations / np.linalg.norm(A, axis=1)
    return A @ A.T * np.outer(scale, scale)


def after(p, see, z):
    """Mean (d,) and covariance (d, d) of the one component, sure of its detection z (p,)."""
    posterior = expand(p, Gates(*see.gates(p), np.inf), see, z[None], 1.0, 1.0, 1.0).mixture
    return posterior.m[0], posterior.P[0]


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("axes", [2, 3])
@pytest.mark.parametrize("wide", ["positions", "x", "everything"])
def test_the_update_is_right_however_much_wider_than_the_noise_the_prior_is(ratio, axes, wide):
    deviations = np.full(2 * axes, ratio * SIGMA)
    if wide != "everything":
        deviations[1 if wide == "x" else axes :] = 5.0
    P, see = correlated(deviations, axes), position_sensor(SIGMA, axes)
    z = np.linalg.cholesky(P)[:axes, :axes] @ np.random.default_rng(1).standard_normal(axes)
    m, covariance = after(gaussian(np.zeros(2 * axes), P), see, z)
    K, wanted = seen_by(see, P)
    assert_right(covariance, wanted)
    # and the mean to a few roundings of a coordinate
    assert (np.abs(m - K @ z) <= 1e-7 * np.sqrt(np.diag(wanted)) + 1e-15 * deviations).all()


@pytest.mark.parametrize("ratio", RATIOS[:-1])
def test_so_it_is_where_the_sensor_mixes_states_and_its_noises_are_correlated(ratio):
    P = correlated(np.array([ratio, ratio, 3 * ratio, 5.0]), 3)
    see = sensor([[1.0, 1, 0, 0], [1, -1, 0, 0], [0, 0, 2, 0]], correlated(np.array([1.0, 30, 0.1]), 4))
    assert_right(after(gaussian(np.zeros(4), P), see, np.zeros(3))[1], seen_by(see, P)[1])


def far_away(deviation, distance=1e12):
    """A prediction so far from a radar, 1e6 m wide, the radar's deviations, `deviation` m on every axis, and
    what it says of that place."""
    z = np.array([distance, 0.7, 0.4])
    P = correlated(np.array([1e6, 1e6, 1e6, 5.0, 5.0, 5.0]), 5)
    noise = deviation / np.array([1.0, z[0], z[0]])
    return gaussian([*radar.cartesian(z), 10.0, 20.0, 30.0], P), noise, z


@pytest.mark.parametrize("update", [*radar.CONVERSIONS, "extended"])
def test_a_radars_update_keeps_its_noise_beside_a_prior_1e8_times_as_wide(update):
    p, noise, z = far_away(SIGMA)
    J = jacobian_of(z[None])[0]
    # over 1e6 m in 1e12 space is flat to a millionth
    flat = sensor(np.eye(3, 6), J @ np.diag(noise**2) @ J.T)
    assert_right(after(p, radar.radar(noise, 6, update), z)[1], seen_by(flat, p.P[0])[1], 1e-5)


@pytest.mark.parametrize("as_printed", [True, False])
def test_the_printed_filter_keeps_that_noise_too(as_printed):
    p, noise, z = far_away(SIGMA, FARTHEST)
    see = radar.radar(noise, 6, "debiased-at-prediction")
    still = Motion(np.eye(6), np.zeros((6, 6)), np.zeros(6))
    told = model(still, see, 1.0, 1.0, ALONE, p)
    tracker = Printed(told, as_printed, likelihood_as_printed=False)
    J = jacobian_of(z[None])[0]
    flat = sensor(np.eye(3, 6), J @ np.diag(noise**2) @ J.T)
    _, report = tracker.step(tracker.init(), z[None])
    # over 1e6 m in 1e10 space is flat to a part in ten thousand
    assert_right(report.P[0], seen_by(flat, p.P[0])[1], 1e-3)


@pytest.mark.parametrize(("update", "middle"), [("unscented", 0.25), ("cubature", 0.0)])
def test_so_does_an_update_by_points_and_what_the_line_through_them_leaves(update, middle):
    p, noise, z = far_away(1.0)  # bends by as much as the noise
    P, weight = p.P[0], (1 - middle) / 6
    with mpmath.workdps(50):
        exact = np.vectorize(mpmath.mpf, otypes=[object])
        L = np.array(mpmath.cholesky(mpmath.matrix(P[:3, :3].tolist())).tolist())
        steps = np.concatenate([L.T, -L.T]) / mpmath.sqrt(2 * exact(weight))
        off = said(exact(p.m[0, :3]) + steps) - said(exact(p.m[:, :3]))
        mean = weight * off.sum(axis=0)
        S = (
            weight * (off - mean).T @ (off - mean)
            + middle * np.outer(mean, mean)
            + np.diag(exact(noise) ** 2)
        )
        regression = mpmath.matrix((weight * off.T @ steps).tolist()) * mpmath.inverse(P[:3, :3].tolist())
        C = regression * mpmath.matrix(P[:3].tolist())
        wanted = bayes(P, C.tolist(), S)[1]
    # ranges of 1e12 m are rounded to 1e-4 m
    assert_right(after(p, radar.radar(noise, 6, update), z)[1], wanted, 1e-4)


def said(x):
    """Range, azimuth and elevation (n, 3) of positions (n, 3), to the digits that mpmath works with."""
    level = [mpmath.hypot(a, b) for a, b, _ in x]
    return np.array([
        [mpmath.hypot(r, c), mpmath.atan2(b, a), mpmath.atan2(c, r)]
        for r, (a, b, c) in zip(level, x, strict=True)
    ])  # fmt: skip


PLACE = np.array([5e5, 5e6, 30.0, -20.0])  # m and m/s, as UTM has it
WIDE = np.diag([3e6, 3e6, 100.0, 100.0]) ** 2  # about 0: nothing is known of the place
MOVE, SEE = constant_velocity(1.0, 1.0), position_sensor(SIGMA)


def filtered(z):
    """Means (4,) and covariances (4, 4) of the Kalman filter from WIDE through z (T, 2), to fifty digits."""
    out = []
    with mpmath.workdps(50):
        F, Q, H, R = (mpmath.matrix(a.tolist()) for a in (MOVE.F, MOVE.Q, SEE.H, SEE.R))
        m, P = mpmath.zeros(4, 1), mpmath.matrix(WIDE.tolist())
        for row in z:
            m, P = F * m, F * P * F.T + Q
            K = P * H.T * mpmath.inverse(H * P * H.T + R)
            m, P = m + K * (mpmath.matrix(row.tolist()) - H * m), P - K * H * P
            out.append((np.array(m.tolist(), float)[:, 0], np.array(P.tolist(), float)))
    return out


def passing():
    """Four detections of a target that passes PLACE."""
    noise = SIGMA * np.random.default_rng(0).standard_normal((4, 2))
    return PLACE[:2] + np.arange(1, 5)[:, None] * PLACE[2:] + noise


@pytest.mark.parametrize(
    "name",
    [
        "clairvoyant", "nearest-neighbour", "pda", "runnalls-30", "adaptive-30", "capping-5", "salmond-5",
        "ise-5", "imm-pda", "gpb2", "mmg-5", "imm-mht-5", "mmae-mht-5", "one-motion-5", "imm-of-mhts-5",
    ],
)  # fmt: skip
def test_every_tracker_that_knows_nothing_of_the_place_is_the_exact_filter_from_the_first_scan(name):
    tracker = make_tracker(name, model(MOVE, SEE, 0.9, 0.999, ALONE, gaussian(np.zeros(4), WIDE)))
    belief = tracker.init()
    for z, (m, P) in zip(passing(), filtered(passing()), strict=True):
        belief, report = tracker.step(belief, z[None])
        np.testing.assert_allclose(report.x[0], m, rtol=0, atol=1e-4 * SIGMA)
        # the second scan finds places as wide as the speed, and their difference from it rounded
        assert_right(report.P[0], P, 1e-6)


@pytest.mark.parametrize("name", ["gm-phd", "gm-cphd", "pmb", "learning-phd", "learning-pmb"])
def test_targets_born_anywhere_are_as_sure_of_their_place_as_their_first_detection(name):
    births = mixture([0.1], np.zeros((1, 4)), WIDE[None])
    clutter = uniform_clutter([-1e7, -1e7], [1e7, 1e7], 1e-20)
    # none is missed: Vo and Ma's merging would make one of a target and of those not yet seen, anywhere
    tracker = make_tracker(name, multi_target_model(MOVE, SEE, 1.0, 0.99, births, clutter))
    _, account = tracker.step(tracker.init(), passing()[:1])
    sure = np.abs(account.intensity.m[:, :2] - passing()[0]).max(axis=1) < 1e-6
    assert account.intensity.w[sure].sum() == pytest.approx(1.0, rel=1e-3)
    for P in account.intensity.P[sure]:
        assert_right(P, seen_by(SEE, WIDE)[1])
