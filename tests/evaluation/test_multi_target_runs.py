"""Runs of trackers of many targets: scores of known accounts, the same on any number of workers."""

from dataclasses import dataclass

import numpy as np
import pytest

from gmr_gym.baselines.gm_phd import gm_phd
from gmr_gym.baselines.learning_phd import learning_phd
from gmr_gym.baselines.learning_pmb import learning_pmb
from gmr_gym.evaluation.montecarlo import run
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns, density_error, run_multi_target_once
from gmr_gym.evaluation.multi_target_summary import multi_target_differences, multi_target_summary
from gmr_gym.filters.registry import MULTI_TARGET_GROUP, make_tracker, trackers
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.models.clutter import no_components, uniform_clutter
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.simulation.multi_target import draw

WORLD = unknown_clutter(horizon=25)


@dataclass(frozen=True)
class Scripted:
    """Names what it is given, scan by scan."""

    model: MultiTargetModel
    said: tuple  # of (j, d) states

    def init(self):
        return 0

    def step(self, belief, z):
        x = self.said[belief]
        one = np.ones(len(x))
        account = MultiTargetReport(
            x, one, np.arange(len(x)), float(len(x)), no_components(6), self.model.clutter
        )
        return belief + 1, account


def there(seed):
    """The states of the targets that are there, scan by scan."""
    return [x[np.isfinite(x).all(axis=1)] for x in draw(WORLD, seed).x]


def test_who_names_what_is_there_has_no_error_and_who_is_off_by_ten_metres_has_ten():
    right = run_multi_target_once(WORLD, Scripted(WORLD.model, tuple(there(0))), 0)
    for field in ("ospa", "gospa", "localisation", "missed", "false", "wasserstein"):
        np.testing.assert_allclose(getattr(right, field), 0.0, atol=1e-9)
    np.testing.assert_array_equal(right.named, right.targets)
    assert right.targets[0] == 1 and right.targets[-1] == 2  # the second is there from scan 20 on
    off = [x + np.array([6.0, 8.0, 0, 0, 0, 0]) for x in there(0)]
    wrong = run_multi_target_once(WORLD, Scripted(WORLD.model, tuple(off)), 0)
    np.testing.assert_allclose(wrong.ospa, 10.0)
    np.testing.assert_allclose(wrong.wasserstein, 10.0)
    np.testing.assert_allclose(wrong.localisation, 100.0 * wrong.targets)


def test_what_is_not_named_is_missed_and_what_is_not_there_is_false():
    none = run_multi_target_once(WORLD, Scripted(WORLD.model, (np.empty((0, 6)),) * 25), 0)
    np.testing.assert_allclose(none.ospa, 100.0)
    np.testing.assert_allclose(none.missed, 5000.0 * none.targets)
    assert not none.false.any() and np.isnan(none.wasserstein).all()  # a gap, which does not read as perfect
    ghosts = [np.vstack([x, np.full(6, 900.0)]) for x in there(0)]
    more = run_multi_target_once(WORLD, Scripted(WORLD.model, tuple(ghosts)), 0)
    np.testing.assert_allclose(more.false, 5000.0)
    np.testing.assert_allclose(more.ospa, 100.0 / np.sqrt(more.targets + 1))


def test_the_clutter_is_wrong_by_a_share_of_what_is_expected():
    places = np.random.default_rng(0).uniform(-1000, 1000, (400, 2))
    low, high = np.full(2, -1000.0), np.full(2, 1000.0)
    true = uniform_clutter(low, high, 50.0)
    assert density_error(true, true, places) == 0.0
    assert density_error(uniform_clutter(low, high, 75.0), true, places) == pytest.approx(0.5)
    runs = run_multi_target_once(WORLD, Scripted(WORLD.model, tuple(there(0))), 0)
    judged = np.isfinite(runs.density_error)
    assert judged[::5].all() and judged.sum() == 5
    # uniform where half of Table 1's weight lies on a seventh of the square
    assert 1.0 < runs.density_error[0] < 1.5


def test_runs_are_the_same_on_one_worker_on_two_and_from_disk(tmp_path):
    built = {"phd": gm_phd(WORLD.model), "learning": learning_phd(WORLD.model)}
    one = run(WORLD, built, 3, seed=5, folder=tmp_path)
    two = run(WORLD, built, 3, seed=5, jobs=2)
    kept = run(WORLD, built, 3, seed=5, folder=tmp_path)
    for name, runs in one.items():
        assert isinstance(runs, MultiTargetRuns) and runs.ospa.shape == (3, 25)
        for field, a, b, c in zip(MultiTargetRuns._fields, runs, two[name], kept[name], strict=True):
            np.testing.assert_array_equal(a, c)
            if field != "seconds":
                np.testing.assert_array_equal(a, b)


def test_a_row_is_of_means_over_scans_and_runs_and_differences_are_paired():
    rng = np.random.default_rng(0)
    results = {
        name: MultiTargetRuns(*(rng.exponential(10.0, (8, 25)).round() for _ in MultiTargetRuns._fields))
        for name in "ab"
    }
    rows = multi_target_summary(WORLD, results)
    for name, runs in results.items():
        row = rows[name]
        for field in ("ospa", "gospa", "localisation", "missed", "false", "wasserstein"):
            assert row[field].value == pytest.approx(getattr(runs, field).mean())
            assert row[field].low < row[field].value < row[field].high
        assert row["cardinality_bias"].value == pytest.approx((runs.named - runs.targets).mean())
        assert row["cardinality_error"].value == pytest.approx(np.abs(runs.named - runs.targets).mean())
        assert row["time_per_scan"].value == np.median(runs.seconds)
        assert row["wasserstein_undefined"] == (0, 0, 0)
    (difference,) = multi_target_differences(WORLD, results).values()
    a, b = results.values()
    assert difference["ospa"].value == pytest.approx((b.ospa - a.ospa).mean())


def test_scans_without_a_wasserstein_distance_are_left_out_and_counted():
    distance = np.full((3, 4), 20.0)
    distance[0, :3] = np.nan
    distance[2] = np.nan
    blank = MultiTargetRuns(*(np.zeros((3, 4)) for _ in MultiTargetRuns._fields))._replace(
        wasserstein=distance
    )
    (row,) = multi_target_summary(WORLD, {"one": blank}).values()
    assert row["wasserstein"].value == 20.0
    assert row["wasserstein_undefined"].value == pytest.approx(7 / 12)
    (row,) = multi_target_summary(
        WORLD, {"one": blank._replace(wasserstein=np.full((3, 4), np.nan))}
    ).values()
    assert np.isnan(row["wasserstein"].value) and row["wasserstein_undefined"].value == 1.0


def test_learning_the_clutter_comes_near_to_being_told_it():
    """Eight paired episodes: told uniform it names two too many, told the truth or learning it none."""
    world = unknown_clutter()
    told = unknown_clutter(told="true").model
    built = {
        "uniform": gm_phd(world.model), "true": gm_phd(told), "learning": learning_phd(world.model),
    }  # fmt: skip
    built |= {"tracks": learning_pmb(world.model)}
    rows = multi_target_summary(world, run(world, built, 8, seed=1))
    assert rows["uniform"]["ospa"].value > rows["true"]["ospa"].value + 15
    # 1.2 m in measurement, with an interval of a metre over eight episodes
    assert rows["learning"]["ospa"].value < rows["true"]["ospa"].value + 3
    assert abs(rows["learning"]["cardinality_bias"].value) < 0.3 < rows["uniform"]["cardinality_bias"].value
    # 16.6 +- 0.3 over twenty episodes
    assert rows["tracks"]["ospa"].value < 18.0 and abs(rows["tracks"]["cardinality_bias"].value) < 0.1
    assert rows["learning"]["density_error"].value < 0.4 < rows["uniform"]["density_error"].value


@pytest.mark.parametrize("name", trackers(MULTI_TARGET_GROUP))
def test_trackers_of_many_targets_are_found_by_name_and_others_are_not(name):
    tracker = make_tracker(name, WORLD.model)
    assert tracker.model is WORLD.model
    _, account = tracker.step(tracker.init(), np.zeros((0, 2)))
    assert len(account.x) == 0 and account.clutter.expected > 0
    with pytest.raises(ValueError, match="tracker 'pda' is for one target, the model for many"):
        make_tracker("pda", WORLD.model)
    with pytest.raises(ValueError, match="takes no 'update'"):
        make_tracker(name, WORLD.model, update="raw")
