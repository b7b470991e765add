"""What the command `track` writes of many targets: every file that is asked for, and nothing that is not."""

import json
import sys

import numpy as np
import pytest
from made_tracks import made

from gmr_gym import cli

SEEN = made(seed=7, scans=40, clutter=1.0)


@pytest.fixture
def call(tmp_path, monkeypatch, capsys):
    """Runs `gmr-gym track plots.csv --targets many ...` in a folder with that file and its truth."""
    monkeypatch.chdir(tmp_path)
    rows = np.column_stack([1.7e9 + SEEN.detections.time, SEEN.detections.z])
    np.savetxt("plots.csv", rows, "%.3f", ",", header="time_s,x_m,y_m", comments="")
    T, n, _ = SEEN.truth.shape
    time = 1.7e9 + np.repeat([scan.time for scan in SEEN.scans], n)
    truth = np.column_stack([time, SEEN.truth.reshape(-1, 2), np.tile(np.arange(n), T)])
    np.savetxt("truth.csv", truth, ["%.3f"] * 3 + ["%d"], ",", header="time_s,x_m,y_m,target", comments="")

    def run(*words, targets="many"):
        usual = ["--sensor-deviation", "5", "--clutter-per-scan", "1"] if targets == "many" else []
        monkeypatch.setattr(
            sys, "argv", ["gmr-gym", "track", "plots.csv", "--targets", targets, *usual, *words]
        )
        code = 0
        try:
            cli.main()
        except SystemExit as end:
            code = end.code or 0
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return run


def test_every_file_is_written_and_says_what_made_it(call, tmp_path):
    words = ["--reference", "63.4,10.4,0", "--truth-file", "truth.csv", "--cutoff", "30"]
    words += ["--geojson", "a.geojson", "--html", "a.html", "--mot", "a.txt", "--labelled", "l.csv"]
    code, printed, errors = call(*words, "--report", "r.json", "--out", "t.csv")
    assert (code, errors) == (0, "")
    assert "3 tracks; written to t.csv, a.geojson, a.html, a.txt, l.csv, r.json" in printed
    assert "coverage of target 0 " in printed
    command = "gmr-gym track plots.csv --targets many --reference 63.4,10.4,0 --sensor-deviation 5"
    assert (tmp_path / "t.csv").read_text().splitlines()[1].startswith(f"# command: {command}")
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["command"].startswith(command)
    figures = {one["name"]: one for group in report["figures"].values() for one in group}
    assert figures["tracks confirmed"]["value"] == 3
    assert figures["labels of target 0"]["value"] == 1
    assert figures["coverage of target 0"]["value"] > 0.7
    assert len(report["over_time"]["time"]) == len(SEEN.scans)
    labelled = np.genfromtxt("l.csv", delimiter=",", names=True)
    taken = np.zeros(len(SEEN.detections.time), int)
    hits = SEEN.tracks.detection >= 0
    taken[SEEN.tracks.detection[hits]] = SEEN.tracks.track[hits]
    for track in 1, 2, 3:  # the labels are others, but each is of one target
        named = labelled["track_id"][(taken == track) & np.isfinite(labelled["track_id"])]
        assert (named == np.median(named)).mean() > 0.9


def columns(file):
    lines = [line for line in file.read_text().splitlines() if line[0] != "#"]
    return {name: [*column] for name, *column in zip(*(line.split(",") for line in lines), strict=True)}


def test_smoothed_tracks_are_the_same_rows_nearer_to_the_truth(call, tmp_path):
    code, printed, _ = call("--smooth", "--truth-file", "truth.csv", "--out", "t.csv", "--report", "r.json")
    assert code == 0 and "written to t.csv, t-smoothed.csv, r.json" in printed
    filtered, smoothed = columns(tmp_path / "t.csv"), columns(tmp_path / "t-smoothed.csv")
    assert filtered.keys() == smoothed.keys() and set(smoothed["nis"]) == {""}
    for name in ("time", "track_id", "status", "existence", "detection_row", "weight", "age"):
        assert filtered[name] == smoothed[name]
    groups = json.loads((tmp_path / "r.json").read_text())["figures"]
    error = [
        next(one["value"] for one in groups[title] if one["name"].endswith("root mean square error"))
        for title in ("With a truth", "Smoothed, with a truth")
    ]
    assert error[1] < 0.85 * error[0]
    assert "Smoothed, with a truth:\n" in printed
    code, _, errors = call("--smooth", "--out", "t.csv")
    assert code == 2 and "t.csv is there already" in errors
    (tmp_path / "t.csv").unlink()
    assert "--smooth: t-smoothed.csv is there already" in call("--smooth", "--out", "t.csv")[2]


def test_what_is_there_is_kept_unless_it_may_be_replaced(call, tmp_path):
    (tmp_path / "t.csv").write_text("mine")
    code, _, errors = call("--out", "t.csv")
    assert (code, errors) == (2, "error: --out: t.csv is there already; give --overwrite, or another name\n")
    assert (tmp_path / "t.csv").read_text() == "mine"
    assert call("--out", "t.csv", "--overwrite")[0] == 0
    assert (tmp_path / "t.csv").read_text().startswith("# gmr-gym")


def test_a_dry_run_writes_nothing(call, tmp_path):
    before = sorted(tmp_path.iterdir())
    code, printed, _ = call("--out", "t.csv", "--html", "a.html", "--dry-run")
    assert code == 0 and sorted(tmp_path.iterdir()) == before
    assert f"{len(SEEN.detections.time)} detections in 40 scans would be tracked" in printed
    assert "would write t.csv, a.html" in printed


def test_settings_of_the_file_are_kept_where_nothing_is_typed(call, tmp_path):
    (tmp_path / "a.toml").write_text('[output]\nmot = "b.txt"\nout = "b.csv"\nonly = "all"\n')
    code, printed, _ = call("--config", "a.toml")
    assert code == 0 and "written to b.csv, b.txt" in printed


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--out", "a.kml"], "--out must end in .csv, got 'a.kml'"),
        (["--geojson", "a.kml"], "--geojson must end in .geojson or .json, got 'a.kml'"),
        (["--report", "a.txt"], "--report must end in .json or .md, got 'a.txt'"),
        (["--only", "some"], "--only must be one of confirmed, all, got 'some'"),
        (["--geojson", "a.json"], "GeoJSON has latitudes and longitudes, but nothing says where on Earth"),
        (["--cutoff", "0"], "--cutoff must be positive"),
        (["--out", "plots.csv", "--overwrite"], "plots.csv is named twice"),
        (["--truth-file", "no.csv"], "no.csv: no such file or directory"),
    ],
)  # fmt: skip
def test_what_is_refused_is_refused_before_the_work_and_leaves_nothing(call, tmp_path, words, message):
    before = sorted(tmp_path.iterdir())
    code, printed, errors = call(*words)
    assert (code, printed) == (2, "") and message in errors and errors.count("\n") == 1
    assert sorted(tmp_path.iterdir()) == before


def test_files_of_many_targets_are_refused_for_one(call):
    code, _, errors = call("--html", "a.html", targets="one")
    assert (code, errors) == (2, "error: --html is of many targets; give --targets many\n")
