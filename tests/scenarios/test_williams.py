"""Four targets that meet: their paths, and what trackers assume before the first scan."""

import numpy as np
import pytest

from gmr_gym.baselines.gm_cphd import gm_cphd
from gmr_gym.baselines.gm_phd import gm_phd
from gmr_gym.baselines.learning_pmb import pmb
from gmr_gym.scenarios.williams import MIDDLE, meeting_targets
from gmr_gym.simulation.multi_target import draw


def paths(seed=0, **settings):
    return draw(meeting_targets(**settings), seed).x


def test_they_meet_in_the_middle_where_one_disappears():
    x = paths()
    assert x.shape == (81, 4, 4)
    assert np.isnan(x[MIDDLE - 1 :, 0]).all() and np.isfinite(x[: MIDDLE - 1, 0]).all()
    assert np.isfinite(x[:, 1:]).all()
    assert np.abs(x[MIDDLE - 1, 1:, :2] - 150.0).max() < 5 * np.sqrt(0.1)


def test_born_one_after_another_they_appear_ten_scans_apart():
    first = (~np.isnan(paths(staggered=True)[:, :, 0])).argmax(axis=0)
    assert first.tolist() == [0, 10, 20, 30]


def test_they_move_as_the_filter_model_says():
    model = meeting_targets().model
    F, Q, _ = model.motion
    steps = np.concatenate([x[1:, 1:] - x[:-1, 1:] @ F.T for x in map(paths, range(40))]).reshape(-1, 4)
    # backward the noise is -F^-1 q, seen forward again as -q, of the same covariance
    covariance = steps.T @ steps / len(steps)
    deviation = np.sqrt((np.outer(np.diag(Q), np.diag(Q)) + Q**2) / len(steps))
    assert (np.abs(covariance - Q) < 5 * deviation).all()  # over 9600 steps


def test_with_a_seed_of_the_paths_only_the_detections_differ():
    scenario = meeting_targets(truth_seed=3)
    one, other = draw(scenario, 1), draw(scenario, 2)
    np.testing.assert_array_equal(one.x, other.x)
    assert one.z.shape != other.z.shape or (one.z != other.z).any()
    assert not np.array_equal(paths(1)[:, 1:], paths(2)[:, 1:])


@pytest.mark.parametrize("make", [pmb, gm_phd, gm_cphd])
def test_three_targets_are_expected_before_the_first_scan(make):
    tracker = make(meeting_targets().model)
    _, report = tracker.step(tracker.init(), np.empty((0, 2)))
    # all survive with 0.99, 0.005 are born; a scan without detections leaves a share of 1 - P_D of each, and
    # of their Poisson number a Poisson number
    assert report.expected_targets == pytest.approx(0.1 * (3 * 0.99 + 0.005), rel=1e-3)


@pytest.mark.parametrize(
    ("name", "value"),
    [("detection_probability", 0.0), ("clutter_rate", 0.0), ("sensor_deviation", -1.0), ("truth_seed", -1)],
)
def test_a_wrong_setting_is_named(name, value):
    with pytest.raises(ValueError, match=name):
        meeting_targets(**{name: value})
