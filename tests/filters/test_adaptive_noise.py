"""Process noise from innovations: the sums against a transparent form, the methods against their formulae."""

import numpy as np
import pytest

from gmr_gym.baselines.adaptive_noise import adaptive_noise
from gmr_gym.baselines.mht import adaptive
from gmr_gym.filters.adaptive_noise import (
    METHODS,
    Innovations,
    Noise,
    NoiseEstimator,
    Traces,
    innovations,
)
from gmr_gym.filters.mht import expand_scan, gate_and_log_weights
from gmr_gym.mixture import gaussian, mixture
from gmr_gym.models.kalman import position_sensor, predict
from gmr_gym.models.model import model
from gmr_gym.models.motions import constant_velocity

TRACES = Traces(sensor=200.0, process=2.0, rank=2, p=2)
SCAN = Innovations(detected=0.9, squared=400.0, normalised=3.6, predicted=100.0, moved=5.0, settled=-1.5)
LAST = Noise(factor=2.0, fading=1.5, seen=1000.0, expected=800.0)


def told(acceleration=2.0, clutter=1e-5, detection=0.9, prior=None):
    prior = gaussian(np.zeros(4), np.diag([100.0, 100.0, 25.0, 25.0])) if prior is None else prior
    return model(constant_velocity(1.0, acceleration), position_sensor(10.0), detection, 0.99, clutter, prior)


def test_the_sums_are_those_of_every_hypothesis():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(3, 4, 8))
    belief = mixture([0.5, 0.3, 0.2], rng.normal(scale=5, size=(3, 4)), 9 * A @ A.transpose(0, 2, 1))
    m = told(prior=belief)
    z, H, R = rng.normal(scale=15, size=(4, 2)), m.sensor.H, m.sensor.R
    full, gates = expand_scan(belief[:], m.motion[:], m.sensor[:], z, *gate_and_log_weights(m))
    inverse = np.linalg.pinv(m.motion.Q)
    found = Innovations(*innovations(belief[:], m.motion[:], full, gates, z, R, inverse))
    ahead, rows = predict(belief, m.motion), []
    for w, x, P, i, j in zip(*full.mixture, full.parent, full.detection, strict=True):
        S, moved = H @ ahead.P[i] @ H.T + R, x - ahead.m[i]
        nu = z[j] - H @ ahead.m[i] if j >= 0 else np.zeros(2)
        hit = w * (j >= 0)
        rows.append([
            hit, w * nu @ nu, w * nu @ np.linalg.solve(S, nu), hit * np.trace(S - R),
            w * moved @ inverse @ moved, w * np.trace(inverse @ (P - ahead.P[i])),
        ])  # fmt: skip
    assert len(rows) > 6
    assert found == pytest.approx(tuple(np.sum(rows, axis=0)))
    assert 0 < found.detected < 1 and found.settled < 0 < found.moved


def test_every_method_computes_its_formula():
    def after(method, **options):
        return NoiseEstimator(method, memory=0.9, **options).after(LAST, SCAN, TRACES)

    assert after("constant", factor=2.0, fading=1.2) == LAST
    ratio = (900 + 400 - 180) / (720 + 100)
    assert after("innovations").factor == pytest.approx(2 * ratio**0.5)
    assert after("sage-husa").factor == pytest.approx(0.9 * 2 + 0.1 * (2 + 3.5 / 2))
    fading = (900 + 400 - 180 - 1.8) / (720 + (100 - 1.8) / 1.5)
    assert after("strong-tracking").fading == pytest.approx(fading) and fading > 1
    assert after("strong-tracking").factor == 2.0
    expected = 720 + 1.8
    assert after("switching", threshold=903.6 / expected - 1e-6, high=9.0).factor == 9.0
    assert after("switching", threshold=903.6 / expected + 1e-6, factor=0.5).factor == 0.5


def test_factors_stay_within_their_bounds():
    for method in METHODS:
        rng, noise = np.random.default_rng(1), Noise(1.0, 1.0, 1.0, 1.0)
        estimator = NoiseEstimator(method, memory=0.2, low=0.5, high=4.0)
        for _ in range(50):
            noise = estimator.after(noise, Innovations(*rng.lognormal(sigma=4, size=6)), TRACES)
            assert 0.5 <= noise.factor <= 4 and 1 <= noise.fading <= 4


@pytest.mark.parametrize("method", ["innovations", "sage-husa"])
@pytest.mark.parametrize("true", [0.7, 6.0])
def test_without_clutter_the_factor_finds_the_true_process_noise(method, true):
    rng = np.random.default_rng(3)
    motion = constant_velocity(1.0, true)
    # every scan has the target's detection, in the gate, and no other
    assumed = told(clutter=1e-12, detection=1.0)._replace(gate_probability=1 - 1e-12)
    tracker = adaptive_noise(assumed, method=method, memory=0.95)
    belief, x, factors = tracker.init(), np.zeros(4), []
    for _ in range(600):
        x = rng.multivariate_normal(motion.F @ x, motion.Q, method="svd")
        belief, _ = tracker.step(belief, x[None, :2] + rng.normal(scale=10, size=(1, 2)))
        factors.append(belief.noise.factor)
    found = np.exp(np.mean(np.log(factors[200:])))
    assert 0.5 < found / (true / 2) ** 2 < 2


def test_a_tracker_without_adaptation_is_the_adaptive_one_with_that_noise():
    rng = np.random.default_rng(4)
    mine, other = adaptive_noise(told(), method="constant", factor=4.0), adaptive(told(acceleration=4.0))
    a, b = mine.init(), other.init()
    for _ in range(10):
        z = rng.uniform(-60, 60, (8, 2))
        (a, said), (b, expected) = mine.step(a, z), other.step(b, z)
        assert said.x == pytest.approx(expected.x) and len(said.mixture.w) == len(expected.mixture.w)
    assert a.work > 0


def test_fading_widens_the_covariance_before_the_prediction():
    plain, faded = (adaptive_noise(told(), method="constant", fading=fading) for fading in (1.0, 1.5))
    nothing = np.empty((0, 2))
    (_, a), (_, b) = (tracker.step(tracker.init(), nothing) for tracker in (plain, faded))
    m = told()
    expected = m.motion.F @ (1.5 * m.prior.P[0]) @ m.motion.F.T + m.motion.Q
    assert b.P[0] == pytest.approx(expected) and b.P[0, 0, 0] > a.P[0, 0, 0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "method must be one of constant, innovations, .*, got 'magic'"),
        ({"factor": 0.0}, "0 < low <= factor <= high must hold, got low 0.0625, factor 0.0, high 64.0"),
        ({"memory": 1.0}, r"memory must lie in \[0, 1\), got 1.0"),
        ({"threshold": 0.0}, "threshold must be positive and finite, got 0.0"),
        ({"fading": 0.5}, "fading must be at least 1 and finite, got 0.5"),
    ],
)
def test_impossible_options_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        NoiseEstimator(**options)
