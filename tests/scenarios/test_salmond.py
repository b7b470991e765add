"""A second-order target in clutter: its statistics are those that the filter is told, in its unit."""

import numpy as np
import pytest

from gmr_gym.scenarios.salmond import SCANS, second_order
from gmr_gym.simulation.single_target import draw, scan


def test_truth_and_detections_are_as_the_filter_is_told():
    scenario = second_order(acceleration=0.5, clutter=0.01)
    episodes = [draw(scenario, seed) for seed in range(60)]
    x = np.array([episode.x for episode in episodes])
    F = scenario.model.motion.F
    noise = x[:, 1:] - x[:, :-1] @ F.T
    # the acceleration changes the velocity by its deviation and the position by half of it
    assert noise[..., 2:].std() == pytest.approx(0.5, rel=0.05)
    np.testing.assert_allclose(noise[..., :2], noise[..., 2:] / 2, atol=1e-6)
    assert np.abs(x[:, 0, :2]).max() < 3 and x.shape == (60, SCANS, 4)
    error = np.array([episode.z for episode in episodes]) - x[..., :2]
    assert error.std() == pytest.approx(1.0, rel=0.05)
    assert all(episode.detected.all() for episode in episodes)


def test_clutter_has_the_density_that_is_asked_for():
    scenario = second_order(clutter=0.02)
    episode = draw(scenario, 1)
    counts = [len(scan(scenario, episode, t, episode.x[t, :2]).z) - 1 for t in range(SCANS)]
    assert np.mean(counts) == pytest.approx(0.02 * 60**2, rel=0.1)
    assert scenario.model.clutter_density == 0.02


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"acceleration": 0}, "acceleration must be positive and at most 100, got 0"),
        ({"clutter": -1}, "clutter must be a number, at least 0, got -1"),
        ({"clutter": 11}, "clutter must be at most 10, got 11"),
        ({"detection_probability": 2}, "detection_probability"),
    ],
)
def test_a_bad_argument_is_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        second_order(**wrong)
