"""Clutter drawn by compiled calls is what NumPy draws from the same generator, number by number."""

import numpy as np
import pytest
import reference

from gmr_gym.mixture import mixture
from gmr_gym.models.clutter import Clutter, no_components, uniform_clutter
from gmr_gym.simulation.clutter_points import parts_of, scans_into, within
from gmr_gym.simulation.multi_target import draw_clutter

BOX = np.array([[-100.0, -60.0], [140.0, 100.0]])
# along the axes, some reaching out; Poisson rates on both sides of 10, where NumPy changes its method
ALONG = Clutter(
    *BOX, 25.0,
    mixture([14.0, 0.4], [[130.0, 0.0], [0.0, 0.0]], [np.diag([900.0, 400.0]), 100 * np.eye(2)]),
    mixture([3.0, 11.0], [[-95.0, -50.0], [40.0, 30.0]], [np.diag([100.0, 700.0]), np.diag([900.0, 400.0])]),
)  # fmt: skip
FEW = ALONG._replace(
    uniform=0.3,
    gaussians=mixture([0.4, 0.1], *ALONG.gaussians[1:]),
    ellipses=mixture([0.3, 0.1], *ALONG.ellipses[1:]),
)
ASLANT = ALONG._replace(
    gaussians=mixture([20.0], [[0.0, 0.0]], [[[900.0, 400.0], [400.0, 600.0]]]),
    ellipses=mixture([20.0], [[0.0, 0.0]], [[[900.0, 400.0], [400.0, 600.0]]]),
)
ELLIPSES = ALONG._replace(uniform=0.5, gaussians=no_components(2))
LINE = Clutter(
    np.array([0.0]), np.array([9.0]), 2.0, no_components(1), mixture([8.0], [[2.0]], [[[9.0]]])
)  # fmt: skip


@pytest.mark.parametrize("clutter", [ALONG, ALONG._replace(uniform=0.0), FEW, LINE])
def test_false_alarms_are_those_of_numpys_generator_to_the_last_bit(clutter):
    for seed in range(40):
        one, other = np.random.default_rng(seed), np.random.default_rng(seed)
        np.testing.assert_array_equal(draw_clutter(clutter, one), reference.false_alarms(clutter, other))
        assert one.random() == other.random()  # as much was drawn


def test_false_alarms_of_parts_aslant_are_those_of_numpy_but_for_rounding():
    for seed in range(20):
        ours, theirs = (
            drawn(ASLANT, np.random.default_rng(seed)) for drawn in (draw_clutter, reference.false_alarms)
        )
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)  # m, of sums in another order


def test_the_scans_of_an_episode_are_those_of_numpy_scan_by_scan():
    rng, clutter = np.random.default_rng(3), [ALONG, uniform_clutter(*BOX, 0.0), ELLIPSES, ALONG] * 5
    measured = rng.uniform(-120, 160, (20, 4, 2))
    measured[::3, 1] = np.nan
    detected, ranks = rng.random((20, 4)) < 0.7, rng.random((20, 4))
    z, origin = np.empty((1200, 2)), np.empty(1200, int)
    first = scans_into(z, origin, parts_of(clutter), measured, detected, ranks, np.random.default_rng(8))
    wanted = list(reference.scans_of_many(clutter, measured, detected, ranks, np.random.default_rng(8)))
    assert first[0] == 0
    for t, (detections, origins) in enumerate(wanted):
        np.testing.assert_array_equal(z[first[t] : first[t + 1]], detections)
        np.testing.assert_array_equal(origin[first[t] : first[t + 1]], origins)
    assert {*origin[: first[-1]]} == {-1, 0, 1, 2, 3}


def test_clutter_without_room_is_dropped_and_the_targets_are_not():
    z, origin, every = np.empty((9, 2)), np.empty(9, int), np.ones((3, 2))
    measured, rng = np.zeros((3, 2, 2)), np.random.default_rng(0)
    first = scans_into(z, origin, parts_of([ALONG] * 3), measured, every > 0, every / 2, rng)
    assert first[-1] == 9
    assert [sorted(origin[first[t] : first[t + 1]])[-2:] for t in range(3)] == [[0, 1]] * 3


def test_the_corner_of_the_box_is_inside():
    low, high = BOX
    assert [within(z, low, high) for z in (low, high, high + 1e-9)] == [True, True, False]
    assert not within(np.array([0.0, np.nan]), low, high)
