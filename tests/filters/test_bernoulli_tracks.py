"""Bernoulli tracks with an IMM in each: equal to `pmb`, to `imm` and to the update written out."""

import numpy as np
import pytest

from gmr_gym.filters import bernoulli_tracks, imm, pmb
from gmr_gym.filters.bernoulli_tracks import Associated, Bernoullis, Origins
from gmr_gym.filters.imm_tracks import Banks
from gmr_gym.mixture import Mixture
from gmr_gym.models import kalman
from gmr_gym.models.clutter import no_components
from gmr_gym.models.intervals import Mode, modes, stay_or_switch, transition
from gmr_gym.models.positions import Look
from tests import plain_tracks

ONE = modes([Mode("constant-velocity", 1.0)], np.ones((1, 1)))
TWO = modes([Mode("constant-velocity", 0.3), Mode("coordinated-turn", 2.0, 0.1)], stay_or_switch(2, 0.9))
KAPPA, P_D = 1e-5, 0.85


def look(time, z, at=None, range_rate=None, origin=(0.0, 0.0, 0.0), polar=False, deviation=(4.0, 6.0, 0.5)):
    k = len(z)
    return Look(
        time, np.full(k, time) if at is None else np.array(at), np.array(z, float).reshape(k, 2),
        np.full(k, np.nan) if range_rate is None else np.array(range_rate),
        np.tile(np.array(origin, float), (k, 1)), np.array(deviation), polar,
    )  # fmt: skip


def everything(k, detection_probability=P_D, other=KAPPA):
    """Nothing gated out, and no identities."""
    return Origins(
        detection_probability,
        np.full(k, np.log(other)),
        np.full(k, -1),
        np.zeros(k, bool),
        np.full(2, np.inf),
    )


def tracks(n=2, r=1, seed=0, existence=(0.95, 0.6, 0.3), apart=30.0):
    rng = np.random.default_rng(seed)
    A = rng.normal(0, 1, (n, r, 4, 4)) * np.array([4.0, 4.0, 1.0, 1.0])[:, None]
    m = np.zeros((n, r, 4)) + rng.normal(0, 1, (n, r, 4))
    m[..., 0] += 500.0 + apart * np.arange(n)[:, None]
    m[..., 2] += 10.0
    P = A @ A.transpose(0, 1, 3, 2) + np.eye(4)
    w = rng.dirichlet(np.ones(r), n)
    return Bernoullis(Banks(w, m, P, np.zeros(n)), np.array(existence[:n]), np.full(n, -1), np.full(n, P_D))


def test_with_one_mode_and_one_time_the_update_is_that_of_pmb():
    mine, z = tracks(3), np.array([[505.0, 4.0], [538.0, 1.0], [520.0, -3.0], [900.0, 0.0]])
    F, Q = transition(ONE, 0, 1.0, 2, 4)
    before = Mixture(mine.existence, mine.banks.m[:, 0], mine.banks.P[:, 0])
    sensor = kalman.sensor(np.eye(2, 4), np.diag([16.0, 36.0]))
    theirs = pmb.MultiBernoulli(
        kalman.predict(before, kalman.motion(F, Q)), np.arange(3), no_components(4), 3
    )
    expected, p_clutter = pmb.update(
        theirs, sensor, z, P_D, np.full(4, KAPPA), association="belief-propagation"
    )
    found = Associated(*bernoulli_tracks.update(mine, ONE, look(1.0, z), everything(4)))
    np.testing.assert_allclose(mine.existence, expected.tracks.w, rtol=1e-9)
    np.testing.assert_allclose(mine.banks.m[:, 0], expected.tracks.m, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(mine.banks.P[:, 0], expected.tracks.P, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.unassigned, p_clutter, rtol=1e-9)


def test_with_a_certain_association_the_bank_is_that_of_imm():
    mine = tracks(1, 2, existence=(1.0,))
    w, m, P = mine.banks.w[0].copy(), mine.banks.m[0].copy(), mine.banks.P[0].copy()
    parts = [transition(TWO, q, 1.0, 2, 4) for q in range(2)]
    F, Q = (np.array([part[i] for part in parts]) for i in range(2))
    predicted = imm.mix_and_predict(
        w, m, P, stay_or_switch(2, 0.9), np.zeros((2, 2, 4), bool), F, Q, np.zeros((2, 4))
    )
    z, R = np.array([[512.0, 3.0]]), np.diag([16.0, 36.0])
    scan = kalman.predict_detections(*predicted[1:], np.eye(2, 4), R, z)
    gates = (scan.z_hat, scan.S, np.inf)
    w, m, P, *_ = imm.pda_every_mode(predicted, tuple(scan), gates, 0.0, np.pi, -np.inf, 0.0, np.inf)
    sure = everything(1, 1.0, 1e-300)
    bernoulli_tracks.update(mine._replace(looked=np.ones(1)), TWO, look(1.0, z), sure)
    np.testing.assert_allclose(mine.banks.w[0], w / w.sum(), rtol=1e-9)
    np.testing.assert_allclose(mine.banks.m[0], m, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(mine.banks.P[0], P, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("polar", [False, True])
@pytest.mark.parametrize("n", [1, 2])
def test_a_few_scans_equal_those_written_out(polar, n):
    """Two modes, detections at their own times, range rate for some; two tracks share no detection, so that
    the marginals are exact."""
    mine = tracks(n, 2, apart=400.0)
    w, m, P, existence = (np.copy(column) for column in (*mine.banks[:3], mine.existence))
    plain = [{"w": w[i], "m": m[i], "P": P[i], "time": 0.0, "existence": existence[i]} for i in range(n)]
    origin, deviation = np.array([100.0, -300.0, 0.0]), np.array([4.0, 0.01 if polar else 6.0, 0.5])
    for t in range(3):
        at = np.array([0.6, 0.9, 1.0]) + 1.3 * t
        places = np.array([[500 + 10 * at[0], 2.0], [503 + 10 * at[1], -8.0], [900 + 10 * at[2], 5.0]])
        off = places - origin[:2]
        z = np.stack([np.hypot(*off.T), np.arctan2(off[:, 1], off[:, 0])], axis=1) if polar else places
        scan = look(1.0 + 1.3 * t, z, at, [7.5, np.nan, 8.0], origin, polar, deviation)
        other = np.full(3, KAPPA * (500.0 if polar else 1.0))
        bernoulli_tracks.update(mine, TWO, scan, everything(3, P_D, other[0]))
        plain = plain_tracks.update(plain, TWO, scan, P_D, other)
    for i in range(n):
        assert mine.existence[i] == pytest.approx(plain[i]["existence"], rel=1e-4)
        np.testing.assert_allclose(mine.banks.w[i], plain[i]["w"], rtol=1e-4)
        np.testing.assert_allclose(mine.banks.m[i], plain[i]["m"], rtol=1e-5, atol=1e-4)
        np.testing.assert_allclose(mine.banks.P[i], plain[i]["P"], rtol=1e-4, atol=1e-4)


def test_intervals_that_differ_give_what_their_sum_gives():
    """Without detections and without looks: one step of 2 s, or steps of 0.3, 0.5 and 1.2 s."""
    whole, steps = (tracks(2, 1)._replace(looked=np.zeros(2)) for _ in range(2))
    bernoulli_tracks.update(whole, ONE, look(2.0, []), everything(0))
    for time in (0.3, 0.8, 2.0):
        bernoulli_tracks.update(steps, ONE, look(time, []), everything(0))
    np.testing.assert_allclose(steps.banks.m, whole.banks.m, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(steps.banks.P, whole.banks.P, rtol=1e-11, atol=1e-11)


def test_range_rate_halves_the_error_of_velocity_where_it_should():
    r"""On a line, two positions of deviation s one second apart give the velocity the variance 2 s^2, and two
    range rates of variance 4 s^2 / 3 bring it down to a quarter of that."""
    still = modes([Mode("constant-velocity", 1e-6)], np.ones((1, 1)))
    deviations = []
    for rate in (np.nan, 20.0):
        scans = [
            Look(t, np.array([t]), np.array([[1000.0 + 20.0 * t]]), np.array([rate]), np.zeros((1, 3)),
                 np.array([3.0, np.sqrt(12.0)]), False)
            for t in (0.0, 1.0)
        ]  # fmt: skip
        banks = Banks(*bernoulli_tracks.started(still, scans[0], np.zeros(1, int), 1e5, 2))
        track = Bernoullis(banks, np.ones(1), np.full(1, -1), np.ones(1))
        bernoulli_tracks.update(track, still, scans[1], everything(1, 1.0, 1e-300))
        deviations.append(np.sqrt(track.banks.P[0, 0, 1, 1]))
        assert track.banks.m[0, 0, 1] == pytest.approx(20.0, abs=1e-3)
    assert deviations[0] == pytest.approx(3 * np.sqrt(2), rel=1e-4)
    assert deviations[1] == pytest.approx(deviations[0] / 2, rel=1e-4)
