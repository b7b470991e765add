"""Distances of sets by compiled loops are those of `metrics`, which are SciPy's, to the last bit."""

import numpy as np
import pytest

from gmr_gym.evaluation.metrics import gospa, ospa
from gmr_gym.evaluation.set_distances import rule_of, set_distances


def wanted(x, y, cutoff, order):
    return (*gospa(x, y, cutoff, order), ospa(x, y, cutoff, order))


def cases():
    rng = np.random.default_rng(0)
    for i in range(900):
        j, k = rng.integers(0, 25 if i % 30 == 0 else 8, 2)
        x, y = (50 * rng.normal(size=(count, 1 + i % 3)) for count in (j, k))
        if i % 4 == 0:  # many equal costs: the assignment that SciPy chooses
            x, y = np.round(x / 30), np.round(y / 30)
        if i % 5 == 0 and min(j, k):
            x[0] = y[-1]
        yield x, y, (100.0, 1.0, 17.3)[i % 7 % 3], 1.0 + i % 2


def test_distances_are_those_of_metrics_to_the_last_bit():
    for x, y, cutoff, order in cases():
        assert set_distances(x, y, cutoff, order) == wanted(x, y, cutoff, order)


@pytest.mark.parametrize("scale", [1e-150, 1e150])
def test_distances_too_short_or_too_long_to_be_squared_are_those_of_metrics(scale):
    x, y = np.array([[0.0, 1.0], [2.0, 2.0]]) * scale, np.array([[1.0, 1.0]]) * scale
    assert set_distances(x, y, 100.0, 2.0) == wanted(x, y, 100.0, 2.0)


def test_of_another_order_distances_are_those_of_metrics():
    x, y = np.array([[0.0, 1.0], [2.0, 2.0]]), np.array([[1.0, 1.0]])
    assert rule_of(100.0, 3.0) is None
    assert set_distances(x, y, 100.0, 3.0) == wanted(x, y, 100.0, 3.0)
    with pytest.raises(ValueError, match="order must be finite"):
        set_distances(x, y, 100.0, np.inf)
