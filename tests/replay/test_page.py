"""Pages: their numbers are the tracker's, the same seed has the same bytes, and no name can break them."""

import html
import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from unpacked import Elements, columns_of, data_of

import gmr_gym
from gmr_gym.evaluation.loop import play
from gmr_gym.filters.registry import make_tracker
from gmr_gym.replay import page, record, write_page
from gmr_gym.replay.page import PLAYER
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.simulation.single_target import draw

WATCH = Path(__file__).parents[2] / "docs" / "watch.md"
SCANS = 12
SCENARIO = turning_target(clutter_rate=170, horizon=SCANS)
TURNING = "gmr_gym/TurningTarget-v0"
HOSTILE = """</script><script>alert(1)</script><!-- "'&amp;\u2028\u2029 ]]> \\u003c é"""
REAL = 1.01 * 2.0**-9  # of weights and covariances, relative
GAMMA = "runnalls-30"  # which prunes and merges


def recorded(scenario=SCENARIO, names=(GAMMA, "pda"), seed=3, **options):
    return record(scenario, {name: make_tracker(name, scenario.model) for name in names}, seed, **options)


@dataclass(frozen=True)
class Account:
    """A tracker that keeps every trace, as `play` runs it."""

    tracker: object
    traces: list

    @property
    def model(self):
        return self.tracker.model

    def init(self):
        return self.tracker.init()

    def step(self, belief, z):
        belief, report, trace = self.tracker.trace(belief, z)
        self.traces.append(trace)
        return belief, report


def flat(P):
    return np.array([[each[0, 0], each[0, 1], each[1, 1]] for each in P]).reshape(-1, 3)


@pytest.fixture(scope="module")
def shown():
    text = page(recorded(environment=TURNING))
    return text, data_of(text), columns_of(text)


@pytest.fixture(scope="module")
def played():
    """The scans and reports of the tracker that merges, and its traces."""
    account = Account(make_tracker(GAMMA, SCENARIO.model), [])
    return [*play(SCENARIO, account, draw(SCENARIO, 3))], account.traces


@pytest.mark.parametrize("t", [0, 5, SCANS - 1])
def test_the_numbers_of_a_scan_are_those_of_the_trackers_report(shown, played, t):
    _, data, columns = shown
    _, seen, report, _ = played[0][t]

    def there(name, group):
        start = columns[f"0/{group}_start"]
        return columns[f"0/{name}"][start[t] : start[t + 1]]

    def close(name, group, wanted):
        step = data["columns"][f"0/{name}"]["step"]
        assert step < 0.05
        np.testing.assert_allclose(there(name, group), wanted, rtol=0, atol=0.5001 * step)

    close("z", "z", seen.z)
    close("gate", "gate", report.gates.z)
    close("kept", "kept", report.mixture.m[:, :2])
    np.testing.assert_allclose(there("kept_w", "kept"), report.mixture.w, rtol=REAL)
    np.testing.assert_allclose(there("kept_P", "kept"), flat(report.mixture.P), rtol=REAL)
    np.testing.assert_allclose(
        there("gate_shape", "gate"), flat(report.gates.threshold * report.gates.S), rtol=REAL
    )
    assert columns["0/count"][t] == len(report.mixture.w)
    np.testing.assert_allclose(columns["0/estimate"][t], report.x[0, :2], atol=0.03)
    np.testing.assert_allclose(columns["0/estimate_P"][t], flat(report.P)[0], rtol=REAL)
    (own,) = [*np.flatnonzero(seen.origin == 0), -1][:1]
    assert columns["0/target"][t] == own


@pytest.mark.parametrize("t", [0, 5, SCANS - 1])
def test_the_merges_of_a_scan_are_those_of_the_trackers_trace(shown, played, t):
    _, data, columns = shown
    trace, start = played[1][t], columns["0/full_start"]
    span = slice(start[t], start[t + 1])
    left_out = trace.full.w < 1e-4
    for i in np.flatnonzero(left_out & (trace.into >= 0)):  # the heaviest of a merge is never left out
        left_out[i] = trace.full.w[i] < trace.full.w[trace.into == trace.into[i]].max()
    for field in ("parent", "detection", "into", "mode"):
        np.testing.assert_array_equal(columns[f"0/full_{field}"][span], getattr(trace, field)[~left_out])
    step = data["columns"]["0/full"]["step"]
    np.testing.assert_allclose(
        columns["0/full"][span], trace.full.m[~left_out, :2], rtol=0, atol=0.5001 * step
    )
    np.testing.assert_allclose(columns["0/full_w"][span], trace.full.w[~left_out], rtol=REAL)
    np.testing.assert_allclose(columns["0/full_P"][span], flat(trace.full.P[~left_out]), rtol=REAL)
    assert columns["0/full_rest_count"][t] == (left_out & (trace.into < 0)).sum()
    assert columns["0/full_rest_merged"][t] == (left_out & (trace.into >= 0)).sum()
    kept = slice(*columns["0/kept_start"][t : t + 2])
    np.testing.assert_array_equal(columns["0/full_per_kept"][kept], np.bincount(trace.into[trace.into >= 0]))
    np.testing.assert_allclose(columns["0/full_rest_w"][t], trace.full.w[left_out].sum(), rtol=REAL)


def test_hypotheses_are_left_out_kept_pruned_and_merged(shown):
    columns = shown[2]  # so that the tests above are of each of them
    assert columns["0/full_rest_count"].any() and (columns["0/full_into"] < 0).any()
    into = columns["0/full_into"][columns["0/full_start"][-2] :]
    assert (np.bincount(into[into >= 0]) > 1).any()


def test_the_page_says_what_is_shown(shown):
    text, data, columns = shown
    assert data["trackers"] == [{"name": GAMMA}, {"name": "pda"}]
    assert {key: data[key] for key in ("environment", "seed", "kind", "period", "scans", "patience")} == {
        "environment": TURNING, "seed": 3, "kind": "one", "period": 1.0, "scans": SCANS,
        "patience": SCENARIO.patience,
    }  # fmt: skip
    assert data["versions"] == {"gmr_gym": gmr_gym.__version__} and not data["radar"]
    assert data["columns"]["1/z"] == {"same": "0/z"}
    assert Elements(text).text["title", None] == f"{GAMMA}, pda: {TURNING} seed 3"
    np.testing.assert_array_equal(columns["0/lost_at"], [-1])


@pytest.mark.parametrize("names", [("pda",), ("learning-pmb",)])
def test_the_same_seed_has_the_same_bytes_and_another_has_others(names):
    scenario = SCENARIO if names == ("pda",) else unknown_clutter(horizon=5)
    first, again, other = (page(recorded(scenario, names, seed, scans=5)) for seed in (1, np.int64(1), 2))
    assert first == again != other


def test_a_page_of_many_targets_says_so():
    columns, data = (
        read(page(recorded(unknown_clutter(horizon=5), ["learning-pmb"]))) for read in (columns_of, data_of)
    )
    assert data["kind"] == "many" and columns["truth"].shape == (5, 3, 2)
    assert np.isnan(columns["truth"]).any() and len(columns["clutter_start"]) == 6


def test_a_name_can_be_anything():
    tracker = make_tracker("pda", SCENARIO.model)
    plain, text = (
        page(record(SCENARIO, {name: tracker}, 3, 2, environment=name)) for name in ("plain", HOSTILE)
    )
    assert data_of(text)["trackers"] == [{"name": HOSTILE}] and data_of(text)["environment"] == HOSTILE
    assert Elements(text).text["title", None] == f"{HOSTILE}: {HOSTILE} seed 3"
    for mark in ("<script", "</script", "<!--"):
        assert text.count(mark) == plain.count(mark)
    assert not {"\u2028", "\u2029"} & {*text.partition("<body>")[2]}


@pytest.mark.parametrize(("pruning", "most"), [({}, 400e3), ({"prune_weight": 0, "prune_density": 0}, 400e3)])
def test_a_page_of_a_dense_episode_is_small(pruning, most):
    scenario = turning_target(clutter_rate=170)
    text = page(record(scenario, {GAMMA: make_tracker(GAMMA, scenario.model, **pruning)}, 0))
    assert len(text.encode()) < most


def test_a_page_is_written_whole_or_not_at_all(tmp_path):
    kept = recorded(names=["pda"])
    write_page(kept, tmp_path / "new" / "e.html")
    assert (tmp_path / "new" / "e.html").read_text(encoding="utf-8") == page(kept)
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=re.escape(str(tmp_path / "file" / "e.html"))):
        write_page(kept, tmp_path / "file" / "e.html")
    assert sorted(os.listdir(tmp_path)) == ["file", "new"] and os.listdir(tmp_path / "new") == ["e.html"]


def test_a_notebook_shows_the_page_in_a_frame_of_its_own(tmp_path):
    shown = gmr_gym.show(SCENARIO, GAMMA, make_tracker("pda", SCENARIO.model), seed=3, scans=4)
    frame = shown._repr_html_()
    found = re.fullmatch(r'<iframe srcdoc="([^"]*)" sandbox="allow-scripts" style="[^"]*"></iframe>', frame)
    assert html.unescape(found[1]) == shown.page
    tracker = make_tracker(GAMMA, SCENARIO.model)
    same = record(SCENARIO, {GAMMA: tracker, "Pda": make_tracker("pda", SCENARIO.model)}, 3, 4)
    assert shown.page == page(same)
    shown.save(tmp_path / "e.html")
    assert (tmp_path / "e.html").read_text(encoding="utf-8") == shown.page


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((TURNING,), {}, "trackers must be from 1 to 4, got 0"),
        ((TURNING, "pda"), {"scans": 0}, "scans must be from 1 to the 100 of the episode, got 0"),
        ((TURNING, "gm-phd"), {}, f"'gm-phd' cannot run in {TURNING}: tracker 'gm-phd' is for many targets"),
        ((TURNING, "pda", "pda"), {}, "tracker 'pda' is given twice"),
        (("TurningTarget", "pda"), {}, f"unknown environment 'TurningTarget'; did you mean '{TURNING}'?"),
        ((7, "pda"), {}, "environment must be an id or a scenario, got 7"),
        ((TURNING, 7), {}, "'int' is no tracker: it must have model, init and step"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_a_line(arguments, options, message):
    with pytest.raises(ValueError) as refused:
        gmr_gym.show(*arguments, **options)
    assert str(refused.value).startswith(message) and "\n" not in str(refused.value)


def test_the_page_about_watching_lists_the_keys_of_the_player():
    text = (PLAYER / "controls.js").read_text(encoding="utf-8").partition("const KEYS = [")[2]
    keys = re.findall(r'^  \["(.+)", "(.+)"\],$', text.partition("];")[0], re.M)
    rows = re.findall(r"^\| (.+) \| (.+) \|$", WATCH.read_text(encoding="utf-8"), re.M)
    assert len(keys) > 8 and not {*keys} - {*rows}
