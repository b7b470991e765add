"""The front against its definition."""

import numpy as np
import pytest

from gmr_gym.evaluation.fronts import at_cost, front, hypervolume


@pytest.mark.parametrize("seed", range(20))
def test_the_front_is_what_comparing_every_pair_leaves(seed):
    cost, figure = np.random.default_rng(seed).integers(0, 6, (2, 12)).astype(float)  # with ties
    expected = [
        not any(
            c <= cost[i] and f <= figure[i] and (c < cost[i] or f < figure[i])
            for c, f in zip(cost, figure, strict=True)
        )
        for i in range(12)
    ]
    assert front(cost, figure).tolist() == expected


def test_what_has_no_figure_is_on_no_front():
    cost, figure = np.array([1.0, 0.5, np.nan, 2.0]), np.array([0.5, np.nan, 0.1, np.inf])
    assert front(cost, figure).tolist() == [True, False, False, False]


def test_the_hypervolume_of_one_and_two_points_is_that_of_rectangles():
    assert hypervolume(np.array([1.0]), np.array([0.25]), (3.0, 1.0)) == 2 * 0.75
    union = 2 * 0.5 + 1 * 0.75 - 1 * 0.5  # two rectangles without what they share
    assert hypervolume(np.array([2.0, 1.0]), np.array([0.25, 0.5]), (3.0, 1.0)) == union


def test_the_hypervolume_of_a_hyperbola_is_its_integral():
    # figure 1 / cost from 1 to e, up to the cost e: below the figure 1 lies e - 1 minus log e
    cost = np.geomspace(1, np.e, 20001)
    assert hypervolume(cost, 1 / cost, (np.e, 1.0)) == pytest.approx(np.e - 2, abs=1e-4)


@pytest.mark.parametrize("seed", range(5))
def test_the_hypervolume_is_the_share_of_drawn_points_that_some_point_betters(seed):
    rng = np.random.default_rng(seed)
    cost, figure = rng.uniform(0, 1.2, (2, 3, 8))  # three fronts, some of whose points lie beyond the worst
    drawn = rng.random((20000, 2, 1, 1))
    share = ((cost <= drawn[:, 0]) & (figure <= drawn[:, 1])).any(axis=-1).mean(axis=0)
    assert hypervolume(cost, figure, (1.0, 1.0)) == pytest.approx(share, abs=0.015)


def test_what_is_dominated_beyond_the_worst_or_undefined_adds_no_area():
    cost, figure = np.array([1.0, 1.5, 0.5, 2.0, np.nan]), np.array([0.5, 0.6, 1.5, np.nan, 0.1])
    for n in range(1, 6):
        assert hypervolume(cost[:n], figure[:n], (3.0, 1.0)) == 1.0


def test_the_figure_at_a_cost_is_on_the_line_between_the_corners():
    cost, figure = np.array([[3.0, 1.0, 2.0], [1.0, 2.0, 3.0]]), np.array([[0.1, 0.5, 0.7], [0.3, 0.3, 0.2]])
    assert at_cost(cost, figure, 2.0) == pytest.approx([0.3, 0.25])  # a point that is bettered is no corner
    assert at_cost(cost, figure, 9.0).tolist() == [0.1, 0.2]
    assert np.isnan(at_cost(cost, figure, 0.5)).all()
