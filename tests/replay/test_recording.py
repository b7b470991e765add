"""What is recorded of an episode: what trackers report and runs score, and what is refused."""

import warnings
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from gmr_gym.evaluation.loop import play
from gmr_gym.evaluation.metrics import lost_at
from gmr_gym.evaluation.montecarlo import run_once
from gmr_gym.evaluation.multi_target_runs import run_multi_target_once
from gmr_gym.evaluation.summary import errors
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import no_components
from gmr_gym.replay import record
from gmr_gym.replay.lineup import trackers_of
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.simulation.multi_target import draw as draw_many
from gmr_gym.simulation.single_target import draw

SCENARIO = turning_target(clutter_rate=170)
SHORT = turning_target(clutter_rate=20, horizon=6)
MANY = unknown_clutter(horizon=12)
PDA, NEAREST = (make_tracker(name, SHORT.model) for name in ("pda", "nearest-neighbour"))


@dataclass(frozen=True)
class Reporting:
    """PDA that reports other numbers, from scan 3 to scan 5."""

    change: partial
    model: object = SHORT.model

    def init(self):
        return 0, PDA.init()

    def step(self, belief, z):
        t, inner = belief
        inner, report = PDA.step(inner, z)
        return (t + 1, inner), self.change(report) if 2 <= t <= 4 else report


def replaced(report, **fields):
    return report._replace(**{name: change(getattr(report, name)) for name, change in fields.items()})


def of_tracker(recording, i=0):
    return {name[2:]: column for name, column in recording.columns.items() if name.startswith(f"{i}/")}


@pytest.mark.parametrize("seed", [0, 3])
def test_scores_are_those_of_a_run(seed):
    names = "pda", "runnalls-30"
    kept = record(SCENARIO, {name: make_tracker(name, SCENARIO.model) for name in names}, seed)
    for i, name in enumerate(names):
        runs = run_once(SCENARIO, make_tracker(name, SCENARIO.model), seed)
        own = of_tracker(kept, i)
        np.testing.assert_array_equal(own["estimate"], runs.x[:, :2])
        np.testing.assert_array_equal(own["off_target"], runs.off_target)
        np.testing.assert_array_equal(own["count"], runs.components)
        np.testing.assert_allclose(own["error"], errors(SCENARIO, runs)[0], rtol=1e-14)
        np.testing.assert_array_equal(own["lost_at"], lost_at(runs.off_target[None], SCENARIO.patience))
        np.testing.assert_array_equal(own["alive"], np.ones(100, bool))
    assert kept.columns["0/lost_at"] != -1 or seed != 0
    np.testing.assert_array_equal(kept.columns["truth"], draw(SCENARIO, seed).x[:, :2])
    np.testing.assert_array_equal(kept.columns["0/z"], kept.columns["1/z"])


def test_a_following_window_shows_each_tracker_its_own_detections():
    scenario = turning_target(clutter_rate=20, window=(200.0, 300.0))
    trackers = {name: make_tracker(name, scenario.model) for name in ("pda", "nearest-neighbour")}
    kept = record(scenario, trackers, 5, scans=20)
    for i, tracker in enumerate(trackers.values()):
        own = of_tracker(kept, i)
        for played in play(scenario, tracker, draw(scenario, 5)):
            if played.t == 20:
                break
            span = slice(*own["z_start"][played.t : played.t + 2])
            np.testing.assert_array_equal(own["z"][span], played.scan.z)
            (target,) = np.flatnonzero(played.scan.origin == 0) if (played.scan.origin == 0).any() else [-1]
            assert own["target"][played.t] == target
    assert not np.array_equal(kept.columns["0/z"], kept.columns["1/z"])


def test_what_a_radar_measures_is_recorded_in_metres_from_above():
    path, still = [[20_000.0, 30.0 * t, 2_000.0] for t in range(5)], [[0.0, 0.0, 0.0]] * 5
    scenario = airborne_radar(trajectory=path, platform=still)
    tracker = make_tracker("imm-pda", scenario.model)
    kept = record(scenario, {"imm-pda": tracker}, 5)
    own = of_tracker(kept)
    assert kept.radar and kept.kind == "one"
    np.testing.assert_array_equal(kept.columns["truth"], np.array(path)[:, :2])
    for t, seen, report, _ in play(scenario, tracker, draw(scenario, 5)):
        distance, azimuth, elevation = seen.z.T
        ground = distance * np.cos(elevation) * [np.cos(azimuth), np.sin(azimuth)]
        np.testing.assert_allclose(own["z"][slice(*own["z_start"][t : t + 2])], ground.T, rtol=1e-12)
        shapes = report.gates.threshold * report.gates.S
        gates, parts = (
            slice(*own["gate_start"][t : t + 2]),
            (shapes[:, 0, 0], shapes[:, 0, 1], shapes[:, 1, 1]),
        )
        np.testing.assert_allclose(own["gate_shape"][gates].T, parts)
        np.testing.assert_array_equal(own["mode_p"][t], report.modes)
        error = report.x[0, list(scenario.position)] - path[t]
        assert len(error) == 3 and own["error"][t] == pytest.approx(np.sqrt(error @ error))


def test_a_tracker_that_knows_the_origin_was_given_the_row_that_is_named():
    tracker = make_tracker("clairvoyant", SHORT.model)
    own = of_tracker(record(SHORT, {"clairvoyant": tracker}, 1))
    for t in range(6):
        rows = own["full_detection"][slice(*own["full_start"][t : t + 2])]
        np.testing.assert_array_equal(rows, own["target"][t])
    assert (own["target"] >= 0).any()


def test_a_bank_of_trackers_that_starts_with_several_hypotheses_is_recorded():
    scenario = airborne_radar()
    own = of_tracker(record(scenario, {"bank": make_tracker("mmae-of-mhts", scenario.model)}, 1, 2))
    first = slice(0, own["full_start"][1])
    assert {0, 1} <= {*own["full_parent"][first]} and {0, 1} == {*own["full_mode"][first]}


def test_a_tracker_without_a_trace_is_recorded_without_merges():
    plain = Reporting(partial(replaced))
    own, traced = of_tracker(record(SHORT, {"plain": plain}, 1)), of_tracker(record(SHORT, {"pda": PDA}, 1))
    assert {name for name in traced if name.startswith("full")} and set(own) == {
        name for name in traced if not name.startswith("full")
    }
    for name, column in own.items():
        np.testing.assert_array_equal(column, traced[name])


def test_gospa_is_that_of_a_run_and_targets_are_those_declared():
    tracker = make_tracker("learning-pmb", MANY.model)
    kept, runs = record(MANY, {"learning-pmb": tracker}, 2), run_multi_target_once(MANY, tracker, 2)
    own, episode = of_tracker(kept), draw_many(MANY, 2)
    assert kept.kind == "many" and runs.gospa.any()
    for name, wanted in {
        "gospa": runs.gospa, "expected": runs.expected, "present": runs.targets, "count": runs.components,
        "z": episode.z, "origin": episode.origin, "z_start": episode.first,
    }.items():  # fmt: skip
        np.testing.assert_array_equal(own[name], wanted)
    np.testing.assert_array_equal(kept.columns["truth"], episode.x[..., list(MANY.position)])
    belief = tracker.init()
    for t in range(12):
        belief, report = tracker.step(belief, episode.z[slice(*episode.first[t : t + 2])])
        span, parts = slice(*own["declared_start"][t : t + 2]), slice(*own["kept_start"][t : t + 2])
        np.testing.assert_array_equal(own["declared"][span], report.x[:, list(MANY.position)])
        np.testing.assert_array_equal(own["existence"][span], report.existence)
        np.testing.assert_array_equal(own["label"][span], report.label)
        np.testing.assert_array_equal(own["kept_w"][parts], report.intensity.w)
        learned = slice(*own["guess_start"][t : t + 2])
        np.testing.assert_array_equal(own["guess"][learned], report.clutter.gaussians.m)
        np.testing.assert_allclose(own["guess_P"][learned, 2], 5.99 * report.clutter.gaussians.P[:, 1, 1])
    assert own["declared_start"][-1] > 5 and own["guess_start"][-1] > 0


def test_five_thousand_detections_are_a_scan_like_any_other():
    scenario = turning_target(clutter_rate=5000, horizon=2)
    own = of_tracker(record(scenario, {"pda": make_tracker("pda", scenario.model)}, 0))
    assert own["z_start"][-1] == len(own["z"]) > 9500


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e300])
def test_what_is_no_number_is_missing_with_a_warning(wrong):
    spoilt = Reporting(
        partial(replaced, x=lambda x: x * wrong, gates=lambda g: g._replace(z=g.z + wrong)), SHORT.model
    )
    with pytest.warns(UserWarning, match=r"^tracker 'mine' reported numbers that are not finite in 3 of 6"):
        own = of_tracker(record(SHORT, {"mine": spoilt}, 1))
    right = of_tracker(record(SHORT, {"pda": PDA}, 1))
    away = np.array([False, False, True, True, True, False])
    for name in ("estimate", "error"):
        assert np.isnan(own[name][away]).all()
        np.testing.assert_array_equal(own[name][~away], right[name][~away])
    assert own["off_target"][away].all() and own["gate_start"].tolist() == [0, 1, 2, 2, 2, 2, 3]
    np.testing.assert_array_equal(own["kept"], right["kept"])


@dataclass(frozen=True)
class Declaring:
    """Declares one target at the origin, with the fields changed."""

    fields: dict
    model: object = MANY.model

    def init(self):
        return None

    def step(self, belief, z):
        none = no_components(6)
        report = MultiTargetReport(
            np.zeros((1, 6)), np.ones(1), np.zeros(1, int), 1.0, none, self.model.clutter
        )
        return belief, report._replace(**self.fields)


def test_what_is_no_number_is_missing_of_many_targets_too():
    nowhere = np.full((1, 6), np.nan)
    spoilt = Mixture(np.ones(1), nowhere[:, :2], np.full((1, 2, 2), np.inf))
    tracker = Declaring({"x": nowhere, "clutter": MANY.model.clutter._replace(gaussians=spoilt)})
    with pytest.warns(UserWarning, match=r"^tracker 'mine' reported numbers that are not finite in 3 of 3"):
        own = of_tracker(record(MANY, {"mine": tracker}, 2, 3))
    assert np.isnan(own["declared"]).all() and np.isnan(own["guess_P"]).all()
    nothing = Declaring({"x": np.empty((0, 6)), "existence": [], "label": []})
    np.testing.assert_array_equal(own["gospa"], record(MANY, {"a": nothing}, 2, 3).columns["0/gospa"])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"x": np.zeros(6)}, r"x at scan 1: expected shape \(n, 6\), got \(6,\)"),
        ({"existence": np.ones(2)}, r"existence at scan 1: expected shape \(1\), got \(2,\)"),
        ({"label": np.array([0.5])}, r"label at scan 1: expected 1 whole numbers from -1"),
        ({"expected_targets": np.ones(2)}, r"expected_targets at scan 1: expected shape \(\), got \(2,\)"),
        ({"intensity": 3}, "intensity at scan 1: expected a Mix"),
    ],
)
def test_reports_of_many_targets_of_wrong_shapes_are_refused_in_a_line(fields, message):
    with pytest.raises(ValueError, match=f"^tracker 'mine', {message}"):
        record(MANY, {"mine": Declaring(fields)}, 2, 3)


def test_a_window_cannot_follow_what_is_no_number():
    scenario = turning_target(clutter_rate=20, window=(300.0, 300.0))
    spoilt = Reporting(partial(replaced, x=lambda x: x * np.nan))
    with pytest.raises(ValueError, match=r"^tracker 'mine', x at scan 3: the window follows the estimate"):
        record(scenario, {"mine": spoilt}, 1)


def test_sound_trackers_give_no_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        record(SHORT, {"pda": PDA}, 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": lambda x: x[0]}, r"x at scan 3: expected shape \(1, 4\), got \(4,\)"),
        ({"P": lambda P: P[:, :2]}, r"P at scan 3: expected shape \(1, 4, 4\), got \(1, 2, 4\)"),
        ({"x": lambda x: "here"}, "x at scan 3: expected numbers, got 'here'"),
        ({"mixture": lambda p: p._replace(m=p.m[:, :2])}, r"mixture.m at scan 3: expected shape \(1, 4\)"),
        ({"mixture": lambda p: p._replace(w=p.w[:, None])}, r"mixture.w at scan 3: expected shape \(n\)"),
        ({"mixture": lambda p: None}, "mixture at scan 3: expected a Mixture, got None"),
        ({"gates": lambda g: g._replace(S=g.S[:, 0])}, r"gates.S at scan 3: expected shape \(1, 2, 2\)"),
        ({"modes": lambda m: np.ones(3) / 3}, r"modes at scan 3: expected shape \(1\), got \(3,\)"),
        ({"modes": lambda m: None}, r"modes at scan 3: expected shape \(n\), got \(\)"),
        ({"gates": lambda g: None}, "gates at scan 3: expected a Gates, got NoneType"),
        ({"alive": lambda alive: np.ones(2)}, r"alive at scan 3: expected shape \(\), got \(2,\)"),
    ],
)
def test_reports_of_wrong_shapes_are_refused_in_a_line(change, message):
    with pytest.raises(ValueError, match=f"^tracker 'mine', {message}"):
        record(SHORT, {"mine": Reporting(partial(replaced, **change))}, 1)


@pytest.mark.parametrize("field", ["parent", "detection", "into", "mode"])
def test_traces_that_name_what_is_not_there_are_refused(field):
    mht = make_tracker("runnalls-30", SHORT.model)

    class Wrong(type(mht)):
        def trace(self, belief, z):
            kept, report, trace = super().trace(belief, z)
            ends = {"parent": len(belief.w), "detection": len(z), "into": len(kept.w), "mode": 1}
            named = getattr(trace, field).copy()
            named[0] = ends[field] - (len(belief.w) == 1)  # one too many, but for the first scan
            return kept, report, trace._replace(**{field: named})

    with pytest.raises(ValueError, match=f"^tracker 'mine', trace.{field} at scan 2: expected .* whole numb"):
        record(SHORT, {"mine": Wrong(SHORT.model, mht.reduce)}, 1)


def test_every_hypothesis_that_is_kept_shows_where_it_came_from_however_light():
    tracker = make_tracker("runnalls-30", SCENARIO.model, prune_weight=0, prune_density=0)
    own = of_tracker(record(SCENARIO, {"all": tracker}, 0, 30))
    for t in range(30):
        into = own["full_into"][slice(*own["full_start"][t : t + 2])]
        np.testing.assert_array_equal(np.unique(into), np.arange(own["count"][t]))
    assert (own["full_w"] < 1e-4).any() and own["full_rest_merged"].any() and not own["full_rest_count"].any()


@pytest.mark.parametrize(
    ("trackers", "scans", "message"),
    [
        ({}, None, "trackers must be from 1 to 4, got 0"),
        (dict.fromkeys("abcde", PDA), None, "trackers must be from 1 to 4, got 5"),
        ({"a": PDA}, 0, "scans must be from 1 to the 6 of the episode, got 0"),
        ({"a": PDA}, 2.5, "scans must be from 1 to the 6 of the episode, got 2.5"),
        ({"a": PDA}, "3", "scans must be from 1 to the 6 of the episode, got 3"),
        ({"a": PDA}, 7, "scans must be from 1 to the 6 of the episode, got 7"),
        ({"a": "pda"}, None, "'a' is no tracker: it must have model, init and step"),
        ({"a": type(PDA)}, None, "'a' is no tracker: it must have model, init and step"),
        (
            {"a": make_tracker("learning-pmb", MANY.model)},
            None,
            "'a' is for many targets, the scenario has one target",
        ),
        (
            {"a": make_tracker("imm-pda", airborne_radar().model)},
            None,
            "'a' takes detections of 3 coordinates, those of the scenario have 2",
        ),
    ],
)
def test_what_cannot_be_recorded_is_refused(trackers, scans, message):
    with pytest.raises(ValueError, match=f"^{message}$"):
        record(SHORT, trackers, 1, scans)


def test_trackers_are_named_as_they_are_typed_or_after_their_class():
    other = make_tracker("pda", SHORT.model)
    found = trackers_of(["runnalls-5:prune_weight=0", PDA, other, "pda"], SHORT)
    assert [*found] == ["runnalls-5:prune_weight=0", "Pda", "Pda 2", "pda"]
    assert found["Pda"] is PDA and found["Pda 2"] is other
    assert found["runnalls-5:prune_weight=0"].prune_weight == 0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["pda", "pda:"], "tracker 'pda' is given twice"),
        ([PDA, PDA], "tracker 'Pda 2' is given twice"),
        (["gm-phd"], "'gm-phd' cannot run in there: tracker 'gm-phd' is for many targets, the model for one"),
        (["pdx"], "'pdx' cannot run in there: unknown tracker 'pdx'; did you mean 'pda'?"),
        (["pda:limit=1"], "'pda:limit=1' cannot run in there: tracker 'pda' takes no parameter 'limit'"),
    ],
)
def test_trackers_that_cannot_run_are_named_with_the_environment(given, message):
    with pytest.raises(ValueError) as refused:
        trackers_of(given, SHORT, "there")
    assert str(refused.value).startswith(message)


def test_progress_is_of_the_scans_of_all_trackers():
    done = []
    record(SHORT, {"a": PDA, "b": NEAREST}, 1, 2, progress=lambda *counts: done.append(counts))
    assert done == [(1, 4), (2, 4), (3, 4), (4, 4)]
