"""Curves over runs against plain loops, and whether their intervals keep their word."""

from dataclasses import replace

import numpy as np
import pytest
import reference
from reference import runs_of
from scipy.stats import norm
from scipy.stats import t as student

from gmr_gym.evaluation import curves as module
from gmr_gym.evaluation.curves import CURVES, Errors, averages, curves, errors_of, resampled
from gmr_gym.evaluation.metrics import credibility, nees
from gmr_gym.evaluation.summary import wilson
from gmr_gym.scenarios.dortenzio import turning_target

SCANS = 5
# two scans in a row lose a track; the states are in the order of Zhang, and neither pair is sorted
WORLD = replace(turning_target(horizon=SCANS), position=(2, 0), velocity=(1, 3), patience=2)


def made_up_errors(seed, n=12):
    """Errors of n runs whose states have unlike scales."""
    error = np.random.default_rng(seed).standard_normal((n, SCANS, 4)) * [1, 2, 3, 4]
    return errors_of(WORLD, runs_of(error))


def random_covariances(seed, n):
    rng = np.random.default_rng(seed)
    return reference.random_mixture(rng, n * SCANS, 4)[2].reshape(n, SCANS, 4, 4)


def test_errors_and_curves_are_plain_loops_whatever_the_order_of_the_states():
    n = 12
    runs = runs_of(np.random.default_rng(1).standard_normal((n, SCANS, 4)), claimed=random_covariances(1, n))
    errors = errors_of(WORLD, runs)
    got = curves(errors, np.ones(n))
    index, inclination = credibility(runs.x - runs.truth, nees(runs.x - runs.truth, runs.P))
    for t in range(SCANS):
        position = velocity = 0.0
        for i in range(n):
            e = runs.x[i, t] - runs.truth[i, t]
            position += e[0] ** 2 + e[2] ** 2
            velocity += e[1] ** 2 + e[3] ** 2
            assert errors.position[i, t] == pytest.approx(e[0] ** 2 + e[2] ** 2, rel=1e-12)
            assert errors.velocity[i, t] == pytest.approx(e[1] ** 2 + e[3] ** 2, rel=1e-12)
            assert errors.claimed[i, t] == pytest.approx(e @ np.linalg.inv(runs.P[i, t]) @ e, rel=1e-9)
            np.testing.assert_array_equal(errors.error[i, t], e)
        assert got.rmse[t] == pytest.approx(np.sqrt(position / n), rel=1e-12)
        assert got.velocity_rmse[t] == pytest.approx(np.sqrt(velocity / n), rel=1e-12)
    np.testing.assert_allclose(got.nci, index, rtol=1e-9)
    np.testing.assert_allclose(got.inclination, inclination, rtol=1e-9)
    assert not np.allclose(got.nci, got.inclination, rtol=0.01)


def test_a_mask_gives_the_curves_of_the_runs_it_leaves():
    errors, mask = made_up_errors(2), np.arange(12) % 4 > 0
    cut = Errors(*(part[mask] for part in errors))
    # the same sums with noughts between: rounding
    np.testing.assert_allclose(curves(errors, mask), curves(cut, np.ones(9)), rtol=1e-9)
    assert not np.allclose(curves(errors, mask), curves(errors, np.ones(12)), rtol=0.01)


def test_a_run_of_weight_two_counts_as_two():
    errors, times = made_up_errors(3), np.random.default_rng(3).integers(0, 3, 12)
    repeated = Errors(*(np.repeat(part, times, axis=0) for part in errors))
    np.testing.assert_allclose(curves(errors, times), curves(repeated, np.ones(times.sum())), rtol=1e-9)


def mean_and_square(values):
    """A statistic (2,) of weighted runs with these values."""
    return lambda weight: np.array([weight @ values, weight @ values**2]) / weight.sum()


def test_a_resampled_value_is_the_statistic_of_the_mask_and_its_interval_1_96_standard_errors():
    rng = np.random.default_rng(6)
    mask = rng.random(80) < 0.75
    values = np.where(mask, rng.standard_normal(80), 1e9)  # whoever draws a run left out will know
    figures = resampled(mean_and_square(values), mask)
    assert len(figures) == 2
    for figure, chosen in zip(figures, (values[mask], values[mask] ** 2), strict=True):
        assert figure.value == pytest.approx(chosen.mean(), rel=1e-12, abs=1e-12)
        assert figure.high - figure.value == pytest.approx(figure.value - figure.low, rel=1e-9)
        reach = norm.ppf(0.975) * chosen.std() / np.sqrt(mask.sum())
        # 200 resamples know a deviation to one part in twenty; three such
        assert figure.high - figure.value == pytest.approx(reach, rel=0.15)
    assert resampled(mean_and_square(values), mask) == figures


def test_interval_covers_the_mean_of_a_gaussian_95_times_in_a_hundred():
    n, seeds, covered = 40, 200, 0
    for seed in range(seeds):
        values = 3.0 + np.random.default_rng(seed).standard_normal(n)
        figure = resampled(mean_and_square(values), np.ones(n, bool))[0]
        covered += figure.low <= 3.0 <= figure.high
    # a bootstrap divides by n, and so few runs have Student's tails: 94.0 and not 95 %
    wanted = 2 * student(n - 1).cdf(norm.ppf(0.975) * np.sqrt((n - 1) / n)) - 1
    assert wanted == pytest.approx(0.94, abs=0.002)
    assert abs(covered / seeds - wanted) < 3 * np.sqrt(wanted * (1 - wanted) / seeds)  # binomial, 0.05


@pytest.mark.parametrize("left", [0, 1])
def test_fewer_than_two_runs_have_no_figures(left):
    figures = resampled(mean_and_square(np.arange(7.0)), np.arange(7) < left)
    assert np.shape(figures) == (2, 3) and np.isnan(figures).all()


def test_averages_tell_all_runs_from_those_that_no_tracker_lost(monkeypatch):
    monkeypatch.setattr(module, "RESAMPLES", 20)  # of the intervals no more is asked than that there are any
    n, rng = 24, np.random.default_rng(7)
    off = np.zeros((3, n, SCANS), bool)
    off[0, :3, 1:3] = True  # two scans in a row: lost
    off[1, 2:8, 3:] = True
    off[2, 8:, ::2] = True  # never two in a row: kept
    results = {
        name: runs_of(rng.standard_normal((n, SCANS, 4)) * (i + 1), off[i], random_covariances(i, n), seed=i)
        for i, name in enumerate(("few", "more", "none"))
    }
    rows = averages(WORLD, results)
    common = np.arange(n) >= 8
    times = "components", "gate_area", "time_per_scan", "time_worst"
    wanted = {"track_loss", *times, *(f"{name}_{which}" for name in CURVES for which in ("all", "common"))}
    for lost, (name, runs) in zip((3, 6, 0), results.items(), strict=True):
        row = rows[name]
        assert set(row) == wanted
        assert row["track_loss"] == wilson(lost, n)
        error, claimed = runs.x - runs.truth, nees(runs.x - runs.truth, runs.P)
        for which, chosen in (("all", np.full(n, True)), ("common", common)):
            squares = (error[chosen] ** 2).mean(axis=0)
            by_scan = {
                "rmse": np.sqrt(squares[:, 0] + squares[:, 2]),
                "velocity_rmse": np.sqrt(squares[:, 1] + squares[:, 3]),
                **dict(zip(("nci", "inclination"), credibility(error[chosen], claimed[chosen]), strict=True)),
            }
            for field, curve in by_scan.items():
                figure = row[f"{field}_{which}"]
                assert figure.value == pytest.approx(curve.mean(), rel=1e-9)
                assert figure.low < figure.value < figure.high
        assert row["components"].value == pytest.approx(runs.components.mean(), rel=1e-12)
        assert row["gate_area"].value == pytest.approx(runs.gate_volume.mean(), rel=1e-12)
        assert row["time_per_scan"].value == np.median(runs.seconds)
        assert row["time_worst"].value == runs.seconds.max()


def test_one_that_lost_every_run_has_no_common_one_and_no_say_in_those_of_others():
    error = np.random.default_rng(8).standard_normal((20, SCANS, 4))
    everywhere = np.ones((20, SCANS), bool)
    rows = averages(WORLD, {"lost": runs_of(error, everywhere), "kept": runs_of(error)})
    assert rows["lost"]["track_loss"].value == 1 and rows["kept"]["track_loss"].value == 0
    for field in CURVES:
        assert np.isnan(rows["lost"][f"{field}_common"].value)
        assert rows["kept"][f"{field}_common"] == rows["kept"][f"{field}_all"]
    assert np.isfinite(rows["lost"]["rmse_all"]).all()
    apart = np.arange(20) < 10
    half, other = (np.broadcast_to(those[:, None], (20, SCANS)) for those in (apart, ~apart))
    rows = averages(WORLD, {"one": runs_of(error, half), "two": runs_of(error, other)})
    assert all(np.isnan(row["rmse_common"].value) for row in rows.values())  # each kept some, none the same


def test_curves_of_no_runs_are_not_numbers():
    assert np.isnan(curves(made_up_errors(0), np.zeros(12, bool))).all()
