"""Trajectory GOSPA: an exhaustive search, the axioms of a metric, and cases with a closed form."""

from itertools import permutations, product

import numpy as np
import pytest

from gmr_gym.evaluation.metrics import gospa
from gmr_gym.evaluation.trajectory_metrics import trajectory_gospa

CUTOFF, ORDER, SWITCHING = 10.0, 2.0, 4.0


def drawn(rng, scans, n, spread=6.0):
    """Trajectories (scans, n, 2) that are absent now and then."""
    points = rng.normal(0, spread, (scans, n, 2))
    points[rng.random((scans, n)) < 0.25] = np.nan
    return points


def exhaustive(x, y, cutoff=CUTOFF, order=ORDER, switching=SWITCHING):
    """The least cost over all sequences of assignments of tracks to targets or none, as a p-th power."""
    n, k = x.shape[1], y.shape[1]
    maps = {tuple(p[:n]) for p in permutations([*range(k), *[-1] * n], n)}

    def scan_cost(t, of):
        cost, taken = 0.0, set()
        for i, j in enumerate(of):
            there, other = np.isfinite(x[t, i, 0]), j >= 0 and np.isfinite(y[t, j, 0])
            taken.add(j)
            if there and other:
                cost += min(np.hypot(*(x[t, i] - y[t, j])), cutoff) ** order
            else:
                cost += cutoff**order / 2 * (there + other)
        return cost + sum(cutoff**order / 2 for j in range(k) if j not in taken and np.isfinite(y[t, j, 0]))

    def switch_cost(a, b):
        return switching**order * sum(
            (i != j) * (1 if i >= 0 and j >= 0 else 0.5) for i, j in zip(a, b, strict=True)
        )

    best = {of: scan_cost(0, of) for of in maps}
    for t in range(1, len(x)):
        best = {of: scan_cost(t, of) + min(best[was] + switch_cost(was, of) for was in maps) for of in maps}
    return min(best.values())


@pytest.mark.parametrize("seed", range(6))
def test_it_is_the_best_of_all_sequences_of_assignments(seed):
    rng = np.random.default_rng(seed)
    x, y = drawn(rng, 4, 2), drawn(rng, 4, 1 + seed % 3)
    found = trajectory_gospa(x, y, CUTOFF, ORDER, SWITCHING)
    assert found.total**ORDER == pytest.approx(exhaustive(x, y), rel=1e-9)
    assert sum(found[1:]) == pytest.approx(found.total**ORDER, rel=1e-12)


def test_it_is_a_metric():
    for seed, p in product(range(4), (1.0, 2.0)):
        rng = np.random.default_rng(seed)
        a, b, c = (drawn(rng, 5, n) for n in (2, 3, 2))
        ab, ba, bc, ac = (
            trajectory_gospa(one, other, CUTOFF, p, SWITCHING)
            for one, other in ((a, b), (b, a), (b, c), (a, c))
        )
        assert trajectory_gospa(a, a[:, ::-1], CUTOFF, p, SWITCHING).total == pytest.approx(0, abs=1e-6)
        assert ab.total > 0
        assert ab.total == pytest.approx(ba.total)
        assert (ab.missed, ab.false) == pytest.approx((ba.false, ba.missed))
        assert ac.total <= ab.total + bc.total + 1e-9


def test_without_switches_it_is_gospa_of_every_scan():
    rng = np.random.default_rng(3)
    x, y = drawn(rng, 6, 3), drawn(rng, 6, 2)
    found = trajectory_gospa(x, y, CUTOFF, ORDER, 1e-9)
    each = [
        gospa(a[np.isfinite(a[:, 0])], b[np.isfinite(b[:, 0])], CUTOFF, ORDER)
        for a, b in zip(x, y, strict=True)
    ]
    assert found.total**2 == pytest.approx(sum(part.total**2 for part in each), rel=1e-9)
    assert found.false == pytest.approx(sum(part.false for part in each))


def test_parts_of_two_tracks_that_change_places():
    straight = np.zeros((6, 2, 2))
    straight[:, :, 0] = np.arange(6)[:, None]
    straight[:, 1, 1] = 8.0
    crossed = straight.copy()
    crossed[3:] = straight[3:, ::-1]
    found = trajectory_gospa(crossed, straight, CUTOFF, ORDER, SWITCHING)
    assert found == pytest.approx((np.sqrt(32), 0, 0, 0, 2 * SWITCHING**2))


def test_parts_of_a_late_false_and_lost_track():
    y = np.full((5, 2, 2), np.nan)
    y[:, 0] = 0.0
    y[:3, 1] = 50.0
    x = np.full((5, 2, 2), np.nan)
    x[1:, 0] = [3.0, 0.0]
    x[2:, 1] = -400.0
    found = trajectory_gospa(x, y, CUTOFF, ORDER, SWITCHING)
    assert found[1:] == pytest.approx((4 * 9, 4 * 50, 3 * 50, 0))


def test_sets_without_trajectories():
    none, one = np.zeros((3, 0, 2)), np.zeros((3, 1, 2))
    assert trajectory_gospa(none, none).total == 0
    assert trajectory_gospa(none, one, CUTOFF) == pytest.approx((np.sqrt(150), 0, 150, 0, 0))
    assert trajectory_gospa(one, none, CUTOFF).false == pytest.approx(150)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"estimates": np.zeros((3, 2))}, r"estimates must have shape \(T, n, d\), got \(3, 2\)"),
        ({"targets": np.zeros((4, 1, 2))}, "must agree in the numbers of scans and coordinates"),
        ({"targets": np.array([[[0.0, np.nan]]] * 3)}, "targets must be finite positions, all nan where"),
        ({"estimates": np.full((3, 1, 2), np.inf)}, "estimates must be finite positions"),
        ({"cutoff": 0}, "cutoff must be positive and finite, got 0"),
        ({"switching": np.inf}, "switching must be positive and finite, got inf"),
        ({"order": 0.5}, "order must be at least 1 and finite, got 0.5"),
    ],
)
def test_what_is_refused(change, message):
    given = {"estimates": np.zeros((3, 1, 2)), "targets": np.zeros((3, 1, 2))} | change
    with pytest.raises(ValueError, match=message):
        trajectory_gospa(**given)
