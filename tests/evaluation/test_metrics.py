"""Scores and intervals against direct loops, known limits and printed values."""

import numpy as np
import pytest
import reference

from gmr_gym.evaluation.metrics import cardinality_error, credibility, lost_at, nees
from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.summary import bootstrap_mean, differences, errors, not_lost, summary, wilson
from gmr_gym.models.gating import Gates
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.loss import truth_outside_gates


@pytest.mark.parametrize("patience", [1, 2, 5])
def test_lost_is_the_first_scan_that_completes_the_row_off_target(patience):
    off = np.random.default_rng(patience).random((200, 30)) < 0.4
    got = lost_at(off, patience)
    for run, lost in zip(off, got, strict=True):
        ends = [t for t in range(patience - 1, 30) if run[t - patience + 1 : t + 1].all()]
        assert lost == (ends[0] if ends else -1)
    assert (lost_at(np.zeros((3, 4), bool), patience) == -1).all()
    assert (lost_at(np.ones((3, 6), bool), patience) == patience - 1).all()


@pytest.mark.parametrize(
    "off", [[0, 1], [[0.0, np.nan]], [[0, 2]], np.ma.array([[True, True]], mask=[[False, True]])]
)
def test_what_is_neither_on_nor_off_target_is_refused_by_name(off):
    with pytest.raises(ValueError, match="off_target must"):
        lost_at(off, 1)


def test_of_no_scans_none_is_lost():
    np.testing.assert_array_equal(lost_at(np.zeros((3, 0), bool), 1), [-1, -1, -1])


@pytest.mark.parametrize("kind", [int, float, np.uint8, list])
def test_a_number_of_targets_is_as_wrong_above_as_below_whatever_counts_it(kind):
    few, many = (np.array(counts, kind if kind is not list else int) for counts in ([1, 4], [3, 0]))
    few, many = (few.tolist(), many.tolist()) if kind is list else (few, many)
    for one, other in ((few, many), (many, few)):
        np.testing.assert_array_equal(cardinality_error(one, other), [2, 4])


def test_truth_is_outside_only_when_no_gate_holds_it():
    H = np.array([[1.0, 0.0]])
    gates = Gates(np.array([[0.0], [10.0]]), np.array([[[1.0]], [[4.0]]]), 9.0)  # [-3, 3] and [4, 16]
    nothing = np.full(1, np.nan)
    for position, outside in ((0, False), (2.9, False), (3.1, True), (4.1, False), (16.1, True)):
        assert truth_outside_gates(H, gates, np.array([position, 99.0]), nothing) == outside


def test_nees_is_the_textbooks_and_averages_to_the_dimension():
    rng = np.random.default_rng(0)
    _, _, P = reference.random_mixture(rng, 6, 4)
    error = rng.standard_normal((6, 4))
    wanted = [reference.mahalanobis_squared(e, 0, A) for e, A in zip(error, P, strict=True)]
    np.testing.assert_allclose(nees(error, P), wanted, rtol=1e-9)
    assert nees(error.reshape(2, 3, 4), P.reshape(2, 3, 4, 4)).shape == (2, 3)
    errors = rng.standard_normal((50_000, 4)) @ np.linalg.cholesky(P[0]).T
    average = nees(errors, np.broadcast_to(P[0], (50_000, 4, 4))).mean()
    assert abs(average - 4) < 5 * np.sqrt(2 * 4 / 50_000)  # five standard errors of a chi-square mean


def test_credibility_is_the_direct_loop():
    rng = np.random.default_rng(1)
    runs, scans, d = 12, 3, 2
    error, P = rng.standard_normal((runs, scans, d)), np.empty((runs, scans, d, d))
    for t in range(scans):
        P[:, t] = reference.random_mixture(rng, runs, d)[2]
    index, inclination = credibility(error, nees(error, P))
    for t in range(scans):
        C = sum(np.outer(e, e) for e in error[:, t]) / runs
        rho = [
            10 * np.log10(reference.mahalanobis_squared(e, 0, A) / reference.mahalanobis_squared(e, 0, C))
            for e, A in zip(error[:, t], P[:, t], strict=True)
        ]
        assert inclination[t] == pytest.approx(sum(rho) / runs, rel=1e-9)
        assert index[t] == pytest.approx(sum(map(abs, rho)) / runs, rel=1e-9)


def test_credibility_of_an_error_that_is_not_finite_is_undefined_at_its_scan_alone():
    rng = np.random.default_rng(2)
    error = rng.standard_normal((8, 3, 2))
    error[0, 1] = np.nan
    index, inclination = credibility(error, np.ones((8, 3)))
    assert np.isfinite([index, inclination]).tolist() == [[True, False, True]] * 2


def test_credibility_is_zero_for_the_truth_and_a_factor_in_decibels_for_a_boast():
    rng = np.random.default_rng(2)
    error = rng.standard_normal((50, 4, 3))
    C = np.einsum("ati,atj->tij", error, error) / 50
    for claimed, decibels in ((1.0, 0.0), (0.1, 10.0), (100.0, -20.0)):
        index, inclination = credibility(error, nees(error, np.broadcast_to(claimed * C, (50, 4, 3, 3))))
        np.testing.assert_allclose(inclination, decibels, atol=1e-9)  # above 0: worse than it says
        np.testing.assert_allclose(index, abs(decibels), atol=1e-9)
    for few in (0, 2):
        index, inclination = credibility(error[:few], (error[:few] ** 2).sum(axis=-1))
        assert index.shape == (4,) and np.isnan(index).all() and np.isnan(inclination).all()


def test_weighted_credibility_is_that_of_the_runs_repeated_so_often():
    rng = np.random.default_rng(4)
    error, claimed = rng.standard_normal((15, 4, 3)), rng.exponential(3, (15, 4))
    times = rng.integers(0, 4, 15)
    assert {0, 1, 3} <= set(times)
    repeated = credibility(np.repeat(error, times, axis=0), np.repeat(claimed, times, axis=0))
    # sums in another order, and a whitener of a few states: rounding, with room
    np.testing.assert_allclose(credibility(error, claimed, times), repeated, rtol=1e-9)
    np.testing.assert_allclose(credibility(error, claimed, 0.1 * times), repeated, rtol=1e-9)
    assert not np.allclose(credibility(error, claimed), repeated, rtol=0.01)


def test_runs_of_weight_zero_play_no_part_in_credibility():
    rng = np.random.default_rng(5)
    error, claimed = rng.standard_normal((20, 4, 3)), rng.exponential(3, (20, 4))
    mask = np.arange(20) % 3 > 0
    wanted = credibility(error[mask], claimed[mask])
    error[~mask], claimed[~mask] = 1e6, 1e12
    np.testing.assert_allclose(credibility(error, claimed, mask), wanted, rtol=1e-9)  # rounding
    assert np.isfinite(wanted).all()
    # too few runs of any weight, however many there are
    assert np.isnan(credibility(error, claimed, np.arange(20) < 2)).all()


@pytest.mark.parametrize(("count", "total"), [(0, 10), (3, 10), (10, 10), (17, 1000)])
def test_wilson_interval_solves_its_own_equation(count, total):
    share, low, high = wilson(count, total)
    assert share == count / total and low <= share <= high
    for bound in {low, high} - {0.0, 1.0}:  # |share - p| is 1.96 standard errors of p itself
        standard_error = np.sqrt(bound * (1 - bound) / total)
        assert abs(share - bound) == pytest.approx(1.959963985 * standard_error, rel=1e-6)
    assert (low == 0) == (count == 0) and (high == 1) == (count == total)


def test_bootstrap_interval_of_a_mean_is_near_the_normal_one():
    values = np.random.default_rng(3).exponential(size=400)
    value, low, high = bootstrap_mean(values)
    half = 1.96 * values.std() / 20
    assert value == pytest.approx(values.mean(), rel=1e-12)
    assert low == pytest.approx(value - half, abs=0.15 * half)  # 2000 resamples: a tenth of half
    assert high == pytest.approx(value + half, abs=0.15 * half)
    assert bootstrap_mean(values) == (value, low, high)
    assert np.isnan(bootstrap_mean(np.array([]))).all() and bootstrap_mean(np.array([2.0, 2.0])) == (2, 2, 2)
    assert bootstrap_mean(np.array([2.0]))[0] == 2 and np.isnan(bootstrap_mean(np.array([2.0]))[1:]).all()


def made_up_runs(seed, lost, offset=0.0):
    """Runs in which those of `lost` miss the target in the last of five scans."""
    rng = np.random.default_rng(seed)
    n, scans = len(lost), 5
    truth = rng.standard_normal((n, scans, 4))
    off = np.zeros((n, scans), bool)
    off[:, -1] = lost
    return Runs(
        truth, truth + offset + rng.standard_normal((n, scans, 4)), np.tile(2 * np.eye(4), (n, scans, 1, 1)),
        np.full((n, scans), 3), np.full((n, scans), 7.0), np.ones((n, scans)), off,
        np.ones((n, scans, 1)), np.full((n, scans), 1e-3),
    )  # fmt: skip


def test_summary_tells_runs_kept_by_the_tracker_from_runs_kept_by_all():
    scenario = turning_target(horizon=5)
    lost = np.arange(20) < np.array([[4], [8]])
    lost[1] = lost[1][::-1]
    results = {"one": made_up_runs(0, lost[0]), "two": made_up_runs(0, lost[1], offset=1.0)}
    rows = summary(scenario, results)
    assert rows["one"]["track_loss"].value == 0.2 and rows["two"]["track_loss"].value == 0.4
    common = ~lost[0] & ~lost[1]
    for (name, runs), own in zip(results.items(), ~lost, strict=True):
        np.testing.assert_array_equal(not_lost(scenario, runs), own)
        error = runs.x - runs.truth
        position, velocity = errors(scenario, runs)
        np.testing.assert_allclose(position, np.hypot(error[..., 0], error[..., 1]), rtol=1e-12)
        np.testing.assert_allclose(velocity, np.hypot(error[..., 2], error[..., 3]), rtol=1e-12)
        row = rows[name]
        for suffix, chosen in (("own", own), ("common", common)):
            squares = (position[chosen] ** 2).mean()
            assert row[f"rmse_{suffix}"].value == pytest.approx(np.sqrt(squares), rel=1e-12)
            assert row[f"error_{suffix}"].value == pytest.approx(position[chosen].mean(), rel=1e-12)
            assert row[f"rmse_{suffix}"].low < row[f"rmse_{suffix}"].value < row[f"rmse_{suffix}"].high
        squares = (velocity[own] ** 2).mean()
        assert row["velocity_rmse_own"].value == pytest.approx(np.sqrt(squares), rel=1e-12)
        # errors against a claimed covariance of 2 I
        assert row["anees_own"].value == pytest.approx((error[own] ** 2).sum(-1).mean() / 8, rel=1e-12)
        assert row["components"] == (3, 3, 3) and row["gate_area"] == (7, 7, 7)
        assert row["time_per_scan"].value == 1e-3
    difference = differences(scenario, results)["two - one"]
    assert difference["track_loss"].value == pytest.approx(0.2)
    gain = np.subtract(*(errors(scenario, results[name])[0].mean(axis=1) for name in ("two", "one")))
    assert difference["error_common"].value == pytest.approx(gain[common].mean(), rel=1e-12)


def test_summary_of_a_tracker_that_lost_every_run_has_no_errors_to_show():
    scenario = turning_target(horizon=5)
    row = summary(scenario, {"give_up_ratio": made_up_runs(0, np.ones(6, bool))})["give_up_ratio"]
    assert row["track_loss"].value == 1 and row["components"].value == 3
    assert all(np.isnan(row[key].value) for key in ("rmse_own", "error_common", "anees_own", "nci_own"))


def test_of_the_others_it_leaves_the_common_runs_as_they_are():
    scenario = turning_target(horizon=5)
    some, all_but = np.arange(20) < 4, np.arange(20) > 14
    two = {"one": made_up_runs(0, some), "two": made_up_runs(1, all_but)}
    alone = summary(scenario, two)
    rows = summary(scenario, {"give_up_ratio": made_up_runs(2, np.ones(20, bool)), **two})
    for name in two:
        assert rows[name] == alone[name] and np.isfinite(rows[name]["error_common"].value)
    assert np.isnan(rows["give_up_ratio"]["error_common"].value)


@pytest.mark.parametrize(
    ("error", "P", "message"),
    [
        (np.ones((4, 2)), np.ones((4, 2)), r"error must have shape \(\.\.\., d\) and P"),
        (np.ones((4, 2)), np.ones((4, 2, 3)), r"P \(\.\.\., d, d\), got \(4, 2\) and \(4, 2, 3\)"),
        (np.ones((4, 2)), np.ones((3, 2, 2)), "got \\(4, 2\\) and \\(3, 2, 2\\)"),
        (1.0, np.eye(1), "error must have shape"),
        (np.ones(2) + 1j, np.eye(2), "error must be an array of real numbers"),
        (np.ones(2), [["1", "0"], ["0", "1"]], "P must be an array of real numbers"),
    ],
)
def test_errors_and_covariances_that_do_not_fit_are_refused_by_name(error, P, message):
    with pytest.raises(ValueError, match=message):
        nees(error, P)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"error": np.ones((3, 2))}, "error must have shape"),
        ({"claimed": np.ones((5, 0))}, r"claimed \(runs, T\), got \(5, 4, 2\) and \(5, 0\)"),
        ({"claimed": np.ones((5, 4)) + 0j}, "claimed must be an array of real numbers"),
        ({"weight": np.ones(4)}, "weight must be 5 finite numbers"),
        ({"weight": [1, 1, -1, 1, 1]}, "weight must be 5 finite numbers, none negative"),
        ({"weight": [1, 1, np.nan, 1, 1]}, "weight must be"),
    ],
)
def test_credibility_of_runs_that_do_not_fit_is_refused_by_name(wrong, message):
    error = np.random.default_rng(0).standard_normal((5, 4, 2))
    with pytest.raises(ValueError, match=message):
        credibility(**{"error": error, "claimed": np.ones((5, 4)), "weight": None} | wrong)
