"""The front against its definition."""

import numpy as np
import pytest

from gmr_gym.evaluation.fronts import front


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
