"""What becomes of labelled targets: switches, gaps, late finds, and whether existence and covariance hold."""

import numpy as np
import pytest

from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns, run_multi_target_once
from gmr_gym.evaluation.multi_target_summary import TRACK_FIGURES, reliability, track_figures
from gmr_gym.evaluation.track_scores import Declared, track_scores
from gmr_gym.evaluation.trajectory_metrics import trajectory_costs, trajectory_gospa
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.williams import meeting_targets

CUTOFF, SCANS = 10.0, 12
NAN = np.full(4, np.nan)


def still(*places):
    """States (T, m, 4) of targets that stand at these x."""
    x = np.zeros((SCANS, len(places), 4))
    x[:, :, 0] = places
    return x


def said(x, label, existence=1.0, P=None):
    """What is declared in a scan: states (j, 4) with labels."""
    x = np.reshape(x, (-1, 4))
    P = np.full((len(x), 4, 4), np.nan) if P is None else np.array([P] * len(x))
    return Declared(x, P, np.full(len(x), existence), np.array(label, int))


def scored(found, truth):
    return track_scores(found, truth, (0, 1), CUTOFF, 2.0)


def test_labels_that_change_places_are_two_switches_at_that_scan():
    truth = still(0.0, 50.0)
    scores = scored([said(truth[t], [7, 3] if t < 5 else [3, 7]) for t in range(SCANS)], truth)
    assert np.flatnonzero(scores.switches).tolist() == [5] and scores.switches[5] == 2
    np.testing.assert_allclose(scores.trajectory_switches, np.where(np.arange(SCANS) == 5, 2.0, 0.0))
    assert not scores.fragments.any() and (scores.found == 2).all() and scores.appeared.sum() == 2


@pytest.mark.parametrize(("after", "switches"), [(7, 0), (8, 1)])
def test_a_gap_is_a_fragment_and_with_another_label_a_switch_too(after, switches):
    truth = still(0.0)
    gap = range(4, 7)
    found = [
        said(truth[t][:0] if t in gap else truth[t], [] if t in gap else [7 if t < 4 else after])
        for t in range(SCANS)
    ]
    scores = scored(found, truth)
    assert scores.fragments.tolist() == [float(t == 7) for t in range(SCANS)]
    assert scores.switches.sum() == switches and scores.found.sum() == SCANS - 3
    assert scores.unfound.sum() == 0


def test_a_target_counts_as_unfound_from_its_first_scan_to_the_one_before_it_is_found():
    truth = still(0.0, 100.0)
    truth[:3, 0] = np.nan
    late = [said(truth[t, :1] if t >= 8 else truth[t, :0], [4] if t >= 8 else []) for t in range(SCANS)]
    scores = scored(late, truth)
    assert scores.unfound.tolist() == [1] * 3 + [2] * 5 + [1] * 4  # the second is never found
    assert scores.appeared.tolist() == [1, 0, 0, 1] + [0] * 8


def test_a_label_stays_with_its_target_while_it_is_near_though_another_is_nearer():
    truth = still(0.0)
    near = [np.array([[6.0, 0, 0, 0]]), np.array([[6.0, 0, 0, 0], [1.0, 0, 0, 0]])]
    found = [said(near[t > 3], [1] if t <= 3 else [1, 2]) for t in range(SCANS)]
    assert not scored(found, truth).switches.any()
    found[8:] = [said(near[1] + [[5.0, 0, 0, 0], [0, 0, 0, 0]], [1, 2])] * 4  # no longer near
    assert np.flatnonzero(scored(found, truth).switches).tolist() == [8]


def test_one_estimate_finds_one_target_though_its_label_was_of_both():
    truth = still(0.0, 30.0)
    truth[2:, 1, 0] = 4.0  # the label went over to the second, which then comes near
    found = [said([[x, 0, 0, 0]], [7]) for x in [0.0, 30.0] + [1.0] * (SCANS - 2)]
    scores = scored(found, truth)
    assert (scores.found == 1).all() and scores.unfound.tolist() == [1] + [0] * (SCANS - 1)
    assert not scores.switches.any() and not scores.fragments.any()


def test_of_many_pairs_the_most_are_made_and_the_nearest():
    truth = still(0.0, 8.0)
    found = [said([[9.0, 0, 0, 0], [16.0, 0, 0, 0]], [0, 1])] * SCANS
    assert (scored(found, truth).found == 2).all()


def test_without_labels_there_are_no_trajectories_and_the_rest_stands():
    truth = still(0.0)
    scores = scored([said(truth[t], [-1]) for t in range(SCANS)], truth)
    for name in ("trajectory_localisation", "trajectory_missed", "trajectory_switches", "switches"):
        assert np.isnan(getattr(scores, name)).all()
    assert (scores.found == 1).all() and not scores.fragments.any()


def test_an_estimate_without_a_label_among_others_is_a_trajectory_of_one_scan():
    truth = still(0.0)
    scores = scored([said(truth[t], [-1 if t == 5 else 3]) for t in range(SCANS)], truth)
    # as cheap as any: the target is missed and the estimate false, or there and back
    assert scores.trajectory_switches.sum() == pytest.approx(2.0) and not scores.switches.any()


def test_existence_is_compared_with_the_share_that_is_real():
    truth = still(0.0)
    ghost = np.array([[0.0, 0, 0, 0], [90.0, 0, 0, 0]])
    scores = scored([said(ghost, [1, 2], existence=0.8)] * SCANS, truth)
    np.testing.assert_allclose(scores.existence, 1.6)
    np.testing.assert_allclose(scores.squared_surprise, 0.2**2 + 0.8**2)


def test_bins_of_existence_hold_what_is_declared_and_what_of_it_is_real():
    truth, world = still(0.0), meeting_targets(horizon=SCANS)
    states = np.array([[0.0, 0, 0, 0], [90.0, 0, 0, 0], [60.0, 0, 0, 0]])
    found = Declared(states, np.full((3, 4, 4), np.nan), np.array([0.93, 0.91, 0.4]), np.arange(3))
    runs = run_multi_target_once(world, make_tracker("gnn", world.model), 0)
    scores = scored([found] * SCANS, truth)
    runs = runs._replace(**scores._asdict())
    existence, real, number = reliability(MultiTargetRuns(*(field[None] for field in runs)))
    assert number.tolist() == [SCANS, 0, 0, 0, 0, 2 * SCANS, 0, 0]
    np.testing.assert_allclose(existence[[0, 5]], [0.4, 0.92])
    np.testing.assert_allclose(real[[0, 5]], [0.0, 0.5])
    assert np.isnan(existence[[1, 2, 3, 4, 6, 7]]).all()


def test_a_label_is_kept_while_it_is_that_of_the_first_find():
    truth = still(0.0)
    labels = [7, 7, 3, 3, 7] + [9] * (SCANS - 5)
    scores = scored([said(truth[t], [labels[t]]) for t in range(SCANS)], truth)
    assert scores.kept.tolist() == [1, 1, 0, 0, 1] + [0] * (SCANS - 5) and scores.switches.sum() == 3
    nameless = scored([said(truth[t], [-1]) for t in range(SCANS)], truth)
    assert np.isnan(nameless.kept).all()


def test_errors_as_large_as_the_covariance_says_have_an_anees_of_one():
    rng, P = np.random.default_rng(0), np.diag([4.0, 1.0, 0.25, 0.5])
    truth = still(*(100.0 * np.arange(50)))
    found = [
        said(truth[t] + rng.multivariate_normal(np.zeros(4), P, 50), np.arange(50), P=P) for t in range(SCANS)
    ]
    scores = scored(found, truth)
    n = scores.believed.sum()
    assert n == 50 * SCANS and abs(scores.nees.sum() / n / 4 - 1) < 5 * np.sqrt(2 / (4 * n))
    assert not scored([said(truth[t], np.arange(50)) for t in range(SCANS)], truth).believed.any()


def test_costs_by_scan_sum_to_the_distance_and_a_switch_counts_in_the_scan_after_it():
    rng = np.random.default_rng(1)
    x, y = rng.normal(0, 6, (2, 7, 3, 2))
    x[rng.random((7, 3)) < 0.3], y[rng.random((7, 3)) < 0.3] = np.nan, np.nan
    costs, whole = trajectory_costs(x, y, 10.0, 2.0, 4.0), trajectory_gospa(x, y, 10.0, 2.0, 4.0)
    assert costs.shape == (4, 7) and costs.sum(axis=1) == pytest.approx(whole[1:])
    assert costs.sum() == pytest.approx(whole.total**2)


def test_a_run_has_the_scores_of_what_its_reports_declare():
    scenario = meeting_targets(horizon=12)
    runs = run_multi_target_once(scenario, make_tracker("pmb", scenario.model), 3)
    assert runs.found[-1] == 4 and runs.believed[-1] == 4 and 0 < runs.nees.sum() < 200
    both = MultiTargetRuns(*(np.array([field, field]) for field in runs))
    figures = track_figures(scenario, both)
    assert tuple(figures) == TRACK_FIGURES and all(each.shape == (2,) for each in figures.values())
    assert figures["trajectory_gospa"][0] >= np.sqrt((runs.gospa**2).mean()) - 1e-9
    assert figures["time_to_find"][0] == runs.unfound.sum() / 4
