"""The likelihood of a scan before it was seen."""

import doctest

import numpy as np
import pytest

from gmr_gym.evaluation import innovations
from gmr_gym.evaluation.innovations import log_likelihood
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import mixture
from gmr_gym.models.priors import constant_velocity_model

HALF = 400.0  # m, of the side of the box
SIDES = np.linspace(-HALF, HALF, 81)
PLACES = np.stack(np.meshgrid(SIDES, SIDES), axis=-1).reshape(-1, 2)  # the whole of it, 10 m apart


def reported(name):
    """A tracker of two hypotheses, and its report of an empty scan."""
    m = [[0.0, 0.0, 0.0, 0.0], [120.0, -60.0, 0.0, 0.0]]
    prior = mixture([0.3, 0.7], m, np.tile(np.diag([400.0, 400.0, 4.0, 4.0]), (2, 1, 1)))
    model = constant_velocity_model(
        1.0, prior, axes=2, acceleration_deviation=1.0, sensor_deviation=10.0, detection_probability=0.8,
        clutter_density=1e-6,
    )  # fmt: skip
    tracker = make_tracker(name, model)
    return tracker, tracker.step(tracker.init(), np.empty((0, 2)))[1]


@pytest.mark.parametrize("name", ["runnalls-5", "pda"])
def test_scans_of_one_detection_are_as_likely_as_one_target_and_poisson_clutter_make_them(name):
    tracker, report = reported(name)
    volume, before = (2 * HALF) ** 2, tracker.model.prior.w
    expected = tracker.model.clutter_density * volume  # false alarms in the box, by hand
    none = np.exp(log_likelihood(tracker.model, report, before, np.empty((0, 2)), volume))
    assert none == pytest.approx(np.exp(-expected) * 0.2)
    of_each = [log_likelihood(tracker.model, report, before, z[None], volume) for z in PLACES]
    one = np.exp(of_each).sum() * 100.0  # the sum over the box is its integral
    assert one == pytest.approx(np.exp(-expected) * (0.2 * expected + 0.8), rel=0.03)


def test_gates_that_no_weights_belong_to_are_refused():
    tracker, report = reported("runnalls-5")
    with pytest.raises(
        ValueError, match="this one has 2 gates and kept 3 hypotheses; choose another, such as"
    ):
        log_likelihood(tracker.model, report, np.ones(3) / 3, np.empty((0, 2)), 1.0)


def test_the_example_is_as_shown():
    assert doctest.testmod(innovations).failed == 0
