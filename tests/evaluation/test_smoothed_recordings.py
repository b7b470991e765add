"""One target smoothed: every association weighed by its evidence, all its states at once."""

from itertools import product

import numpy as np
import pytest

from gmr_gym.evaluation.recordings import Scans, track
from gmr_gym.evaluation.smoothed_recordings import smoothed_track
from gmr_gym.filters.registry import make_tracker
from gmr_gym.models.priors import constant_velocity_model, prior_given

TIMES = [1.0, 2.0, 4.0, 5.0]
Z = [
    [[12.0, 0.5], [4.0, 9.0]],
    [[22.0, -3.0]],
    [[36.0, 3.0], [45.0, -12.0]],
    [[52.0, 2.0]],
]
SCANS = Scans(np.array(TIMES), [np.array(z) for z in Z], ("x_m", "y_m"))
PRIOR = prior_given([0, 0, 10, 0], [8, 8, 3, 3])
P_D, CLUTTER, DEVIATION = 0.9, 1e-3, 6.0


def told(dt):
    return constant_velocity_model(
        dt, PRIOR, axes=2, acceleration_deviation=1.5, sensor_deviation=DEVIATION, detection_probability=P_D,
        gate_probability=1 - 1e-13, clutter_density=CLUTTER,
    )  # fmt: skip


def build(name, **parameters):
    return lambda dt: make_tracker(name, told(dt), **parameters)


def by_enumeration():
    """Means (T, 4) and covariances (T, 4, 4) of the states given all scans: the mixture over all
    associations, each one Gaussian of all states and all its detections together."""
    T = len(TIMES)
    mean, P = np.zeros((T, 4)), np.zeros((T, 4, T, 4))
    m, S = PRIOR.m[0], PRIOR.P[0]
    for t, dt in enumerate(np.diff([0.0, *TIMES])):
        F, Q, _ = told(dt).motion
        m, S = F @ m, F @ S @ F.T + Q
        mean[t], P[t, :, t] = m, S
        for s in range(t):
            P[t, :, s] = F @ P[t - 1, :, s]
            P[s, :, t] = P[t, :, s].T
    mean, P = mean.ravel(), P.reshape(4 * T, 4 * T)
    weights, means, covariances = [], [], []
    for chosen in product(*(range(-1, len(z)) for z in Z)):
        rows = [4 * t + c for t, j in enumerate(chosen) if j >= 0 for c in (0, 1)]
        seen = np.array([c for t, j in enumerate(chosen) if j >= 0 for c in Z[t][j]])
        S = P[np.ix_(rows, rows)] + DEVIATION**2 * np.eye(len(rows))
        off, gain = seen - mean[rows], P[:, rows] @ np.linalg.inv(S)
        density = np.exp(-0.5 * off @ np.linalg.solve(S, off)) / np.sqrt(np.linalg.det(2 * np.pi * S))
        hits = len(rows) // 2
        weights.append(density * (P_D / CLUTTER) ** hits * (1 - P_D) ** (T - hits))
        means.append(mean + gain @ off)
        covariances.append(P - gain @ P[rows])
    w = np.array(weights) / sum(weights)
    x = w @ means
    spread = np.array(means) - x
    P = np.einsum("k,kij->ij", w, covariances) + np.einsum("k,ki,kj->ij", w, spread, spread)
    return x.reshape(T, 4), np.array([P[4 * t : 4 * t + 4, 4 * t : 4 * t + 4] for t in range(T)])


def test_where_nothing_is_merged_estimates_are_those_of_every_association_weighed():
    x, P = by_enumeration()
    filtered, smoothed = smoothed_track(SCANS, build("capping", components=200), prior_time=0.0)
    np.testing.assert_allclose(smoothed.x, x, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(smoothed.P, P, rtol=1e-6, atol=1e-6)
    assert np.abs(filtered.x - x)[:-1].max() > 0.5  # the filter does not know what comes


@pytest.mark.parametrize("name", ["pda", "runnalls-10", "nearest-neighbour"])
def test_what_is_filtered_is_that_of_track_and_smoothing_brings_errors_down(name):
    errors, built = [], build(name)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        times = np.arange(1.0, 41.0)
        truth = np.stack([10 * times, 40 * np.sin(times / 6)], axis=1)
        z = [np.vstack([rng.normal(at, DEVIATION, (int(rng.random() < P_D), 2)), rng.normal(at, 60, (1, 2))])
             for at in truth]  # fmt: skip
        filtered, smoothed = smoothed_track(Scans(times, z, ("x_m", "y_m")), built, prior_time=0.0)
        for one, other in zip(
            filtered, track(Scans(times, z, ("x_m", "y_m")), built, prior_time=0.0), strict=True
        ):
            np.testing.assert_array_equal(one, other)
        errors.append([np.sqrt(((each.x[:, :2] - truth) ** 2).mean()) for each in (filtered, smoothed)])
        np.testing.assert_allclose(smoothed.x[-1], filtered.x[-1], atol=1e-9)
    before, after = np.mean(errors, axis=0)
    assert after < 0.8 * before


def test_a_prior_at_the_first_scan_is_smoothed_too():
    times = np.arange(5.0)
    scans = Scans(times, [np.array([[10 * t, 1.0]]) for t in times], ("x_m", "y_m"))
    filtered, smoothed = smoothed_track(scans, build("pda"), prior_time=0.0)
    assert len(smoothed.x) == 5 and np.array_equal(filtered.x[0], PRIOR.m[0])
    assert (np.linalg.eigvalsh(PRIOR.P[0] - smoothed.P[0]) > 0).all()


def test_a_tracker_that_says_not_where_its_hypotheses_come_from_is_refused():
    with pytest.raises(ValueError, match="smoothing needs a tracker with `trace`, such as runnalls-30"):
        smoothed_track(SCANS, lambda dt: Silent(make_tracker("pda", told(dt))), prior_time=0.0)


class Silent:
    """A tracker with nothing but what a tracker must have."""

    def __init__(self, tracker):
        self.model, self.init, self.step = tracker.model, tracker.init, tracker.step
