"""The commands that read files of detections."""

import csv
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from gmr_gym import cli
from gmr_gym.evaluation import csv_columns


@pytest.fixture
def call(tmp_path, monkeypatch, capsys):
    """Runs a command in an empty folder: exit code, output and errors."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)

    def run(*words):
        monkeypatch.setattr("sys.argv", ["gmr-gym", *map(str, words)])
        code = 0
        try:
            cli.main()
        except SystemExit as end:
            code = end.code
        return code, *capsys.readouterr()

    return run


def radar(scans=30):
    """A file of a radar at sea: two ships that cross, and clutter."""
    rng = np.random.default_rng(3)
    lines = ["t_utc,rho_km,theta_deg,snr"]
    for i in range(scans):
        ships = [(-1500 + 15 * 2.5 * i, 900.0), (800.0, -900 + 12 * 2.5 * i)]
        for x, y in [*ships, *rng.uniform(-3000, 3000, (2, 2))]:
            x, y = rng.normal((x, y), 4)
            azimuth = np.degrees(np.arctan2(x, y)) % 360
            lines.append(f"2024-05-01T10:00:{2.5 * i:06.3f}Z,{np.hypot(x, y) / 1000:.6f},{azimuth:.5f},9")
    return "\n".join(line for line in lines if ":60." not in line)


READ = (
    "z.csv",
    "--time",
    "t_utc",
    "--range",
    "rho_km",
    "--azimuth",
    "theta_deg",
    "--sensor-position",
    "58.1,8.3,20",
)


def test_inspect_says_what_was_understood_and_tracks_nothing(call):
    Path("z.csv").write_text(radar(20))
    code, printed, errors = call("inspect", *READ)
    assert code == 0 and errors == "" and [*map(str, Path().iterdir())] == ["z.csv"]
    lines = dict(line.split(": ", 1) for line in printed.splitlines())
    assert lines["rows"] == "80 detections, 0 looks that detected nothing"
    assert (
        lines["columns"]
        == "time from t_utc as ISO 8601; range from rho_km in km, azimuth from theta_deg in deg"
    )
    assert (
        lines["times"].startswith("0 to 47.5 s, 0 s is 2024-05-01 10:00:00")
        and "every 2.5 s" in lines["scans"]
    )
    assert "origin at (58.1, 8.3, 20.0)" in lines["extent"] and lines["sensors"] == "one (polar, 80 rows)"
    assert lines["metadata"] == "snr" and "clockwise from north" in lines["remark"]


def test_track_of_many_follows_the_ships_of_a_polar_file(call):
    Path("z.csv").write_text(radar(20))
    words = (
        "--targets",
        "many",
        "--sensor-deviation",
        "range=4,azimuth=0.15deg",
        "--clutter-per-scan",
        2,
        "--max-speed",
        30,
    )
    code, printed, errors = call("track", *READ, *words)
    assert code == 0 and errors == "" and "written to tracks.csv" in printed
    rows = [*csv.DictReader(line for line in Path("tracks.csv").read_text().splitlines() if line[0] != "#")]
    last = [row for row in rows if float(row["time"]) == 47.5 and row["status"] == "confirmed"]
    places = np.array([[float(row["x_m"]), float(row["y_m"])] for row in last])
    for ship in ((-1500 + 15 * 47.5, 900), (800, -900 + 12 * 47.5)):
        assert np.linalg.norm(places - ship, axis=1).min() < 25


def test_what_would_not_fit_in_memory_is_refused_before_it_is_tracked(call, monkeypatch):
    Path("z.csv").write_text(radar(4))
    monkeypatch.setattr(csv_columns, "_free_memory", lambda: 1.6e4)
    code, _, errors = call("track", *READ, "--targets", "many")
    assert code == 2 and "z.csv: tracks of 16 detections need 0.0 GB, and 0.0 GB are free; choose" in errors


def test_settings_in_a_file_are_overridden_by_options(call):
    Path("z.csv").write_text("time_s,a,b\n0,1,2\n1,2,3\n")
    Path("s.toml").write_text('[input]\nx = "a:m"\ny = "b:m"\n')
    assert "x from a in m, y from b in m" in call("inspect", "z.csv", "--config", "s.toml")[1]
    assert "x from a in km, y from b in m" in call("inspect", "z.csv", "--config", "s.toml", "--x", "a:km")[1]


def test_options_override_what_settings_say_of_motion_rules_and_clutter(call):
    """Also where what is typed is what would be taken without settings, or says it in another way."""
    Path("z.csv").write_text("time_s,x_m,y_m\n1,1,1\n0,1,1\n")
    Path("s.toml").write_text(
        '[input]\norder = "strict"\n[target]\nmotion = "constant-acceleration"\n[output]\nonly = "all"\n'
        '[tracks]\nconfirm = "3/5"\n[[sensor]]\nclutter = { density = 1.0 }\n'
    )
    words = "track", "z.csv", "--config", "s.toml", "--sensor-deviation", "5"
    assert "line 3: time runs back" in call(*words)[2]
    assert (
        call(*words, "--order", "sort")[0] == 0
        and "_constant-acceleration_" in Path("tracks.csv").read_text()
    )
    typed = "--order", "sort", "--motion", "imm", "--only", "confirmed", "--confirm-existence", "0.5"
    assert call(*words, *typed, "--clutter-per-scan", "0.01", "--overwrite")[0] == 0
    text = Path("tracks.csv").read_text()
    assert "_constant-velocity_3," in text and ",confirmed," in text and ",tentative," not in text
    Path("s.toml").write_text("[target]\nmodes = [{ acceleration_deviation = 2.0 }]\n")
    typed = "--order", "sort", "--acceleration-deviation", "1"
    assert call(*words, *typed, "--overwrite")[0] == 0
    assert "_constant-velocity_1," in Path("tracks.csv").read_text()


def test_range_rates_need_their_deviation(call):
    Path("z.csv").write_text("time_s,range_m,azimuth_deg,range_rate_kn\n0,100,1,3\n1,100,1,3\n")
    code, _, errors = call(
        "track", "z.csv", "--targets", "many", "--sensor-deviation", "range=5,azimuth=1deg"
    )
    assert code == 2 and "sensor '' measures range rates; give their deviation too, such as" in errors


ASSUMED = "--sensor-deviation", "5", "--clutter-density", "1e-6"
ONE = "--targets", "one", *ASSUMED


def test_one_target_is_tracked_in_a_file_of_any_units(call):
    for name, header, scale in (("m.csv", "time_s,x_m,y_m", 1), ("ft.csv", "time_ms,x_ft,y_ft", 0.3048)):
        rows = [
            f"{i * (1000 if 'ms' in header else 1)},{10 * i / scale!r},{5 / scale!r}" for i in range(1, 6)
        ]
        Path(name).write_text(f"{header}\n" + "\n".join(rows))
    code, _, _ = call("track", "m.csv", *ONE, "--out", "a.csv")
    assert code == 0
    columns = "--time", "time_ms", "--x", "x_ft", "--y", "y_ft"
    assert call("track", "ft.csv", *columns, *ONE, "--out", "b.csv")[0] == 0
    one, other = (np.loadtxt(name, delimiter=",", skiprows=1) for name in ("a.csv", "b.csv"))
    np.testing.assert_allclose(one[:, 1:7], other[:, 1:7], rtol=1e-6, atol=1e-6)


def test_how_many_targets_there_are_may_stand_in_the_settings(call):
    Path("z.csv").write_text("time_s,x_m,y_m\n0,1,1\n1,1,1\n")
    Path("s.toml").write_text('[tracks]\ntargets = "one"\n')
    assert (
        "2 scans tracked; written to track.csv" in call("track", "z.csv", *ASSUMED, "--config", "s.toml")[1]
    )
    words = "track", "z.csv", *ASSUMED, "--config", "s.toml", "--targets", "many"
    assert ", 1 track; written to tracks.csv" in call(*words, "--only", "all")[1]
    Path("s.toml").write_text('[tracks]\ntargets = "few"\n')
    assert "targets must be one of one, many, got 'few'" in call(*words[:-2])[2]


def test_the_tracker_of_many_targets_is_chosen_by_option_or_settings(call):
    rng = np.random.default_rng(0)
    places = [(t, *xy) for t in range(8) for xy in rng.normal([[10 * t, 0], [0, 900 + 9 * t]], 4)]
    rows = [f"{t},{x:.2f},{y:.2f}" for t, x, y in places]
    Path("z.csv").write_text("time_s,x_m,y_m\n" + "\n".join(rows))
    Path("s.toml").write_text('[tracks]\ntracker = "gnn"\n')
    words = "track", "z.csv", *ASSUMED, "--config", "s.toml", "--overwrite"
    code, printed, _ = call(*words)
    assert code == 0 and "tracking 16 detections in 8 scans by gnn" in printed and ", 2 tracks;" in printed
    code, printed, _ = call(*words, "--tracker", "gm-cphd", "--smooth")
    assert code == 0 and "gm-cphd does not use motion models other than that of 3 m/s^2: pmb," in printed
    lines = [line for line in Path("tracks.csv").read_text().splitlines() if line[0] != "#"]
    row = [*csv.DictReader(lines)][-1]
    assert row["nis"] == row["mode_constant-velocity_3"] == "" and row["detection_row"] in ("16", "17")
    smoothed = [line for line in Path("tracks-smoothed.csv").read_text().splitlines() if line[0] != "#"]
    assert len(smoothed) == len(lines)


def test_a_tracker_that_cannot_track_the_file_is_refused(call):
    Path("z.csv").write_text("time_s,x_m,y_m,mmsi\n0,1,1,a\n1,900,1,b\n2,1,1,a\n")
    words = "track", "z.csv", *ASSUMED, "--tracker"
    for tracker, message in (
        ("gm-pdh", "unknown tracker 'gm-pdh', did you mean 'gm-phd'?; choose from "),
        ("runnalls-30", "tracker 'runnalls-30' is for one target; give --targets one, or one of pmb, pda"),
        ("gm-phd:x=1", "tracker 'gm-phd' takes no parameter 'x'"),
        ("mht:leaves=4", "tracker 'mht' of files of detections takes no parameters, got 'mht:leaves=4'"),
    ):
        assert message in call(*words, tracker)[2]
    reports = call(*words, "gm-phd", "--id", "mmsi")[2]
    assert "tracker 'gm-phd' needs scans, and these are reports of single targets: give --scan-win" in reports


def test_what_is_there_is_not_written_over_unasked(call):
    Path("z.csv").write_text("time_s,x_m,y_m\n0,1,1\n1,1,1\n")
    for name in ("track.csv", "track-smoothed.csv", "s.toml"):
        Path(name).write_text("mine")
    one = "track", "z.csv", *ONE
    for words, option, name in (
        (one, "--out", "track.csv"),
        ((*one, "--smooth", "--out", "track.csv"), "--out", "track.csv"),
        ((*one, "--smooth", "--out", "new.csv"), "--smooth", "new-smoothed.csv"),
        (("inspect", "z.csv", "--write", "s.toml"), "--write", "s.toml"),
    ):
        Path("new-smoothed.csv").write_text("mine")
        code, printed, errors = call(*words)
        assert (code, printed) == (2, "") and Path(name).read_text() == "mine"
        assert f"{option}: {name} is there already; give --overwrite, or another name" in errors
    assert call(*one, "--overwrite")[0] == 0 and Path("track.csv").read_text() != "mine"


def test_a_recorded_episode_names_the_unit_of_its_times(call):
    assert call("record", "gmr_gym/RecordedFlight-v0", "--truth", "true.csv")[0] == 0
    for name in ("detections.csv", "true.csv"):
        assert Path(name).read_text().startswith("time_s,")
    assert "time from time_s" in call("inspect", "detections.csv")[1]


def test_one_target_is_smoothed_into_a_second_file(call):
    rows = [f"{i},{10 * i + 5 * (-1) ** i},5" for i in range(12)]
    Path("z.csv").write_text("time_s,x_m,y_m\n" + "\n".join(rows))
    Path("s.toml").write_text("[output]\nsmooth = true\n")
    assert call("track", "z.csv", *ONE, "--out", "a.csv")[0] == 0
    code, printed, _ = call("track", "z.csv", *ONE, "--config", "s.toml", "--out", "b.csv")
    assert code == 0 and "written to b.csv, b-smoothed.csv" in printed
    assert Path("a.csv").read_text() == Path("b.csv").read_text()
    a, b = (np.loadtxt(name, delimiter=",", skiprows=1) for name in ("a.csv", "b-smoothed.csv"))
    truth = 10 * np.arange(12)
    assert a.shape == b.shape and ((b[:, 1] - truth) ** 2).sum() < 0.7 * ((a[:, 1] - truth) ** 2).sum()
    assert (b[:-1, 5] < a[:-1, 5]).all()  # the variance of x
    assert call("track", "z.csv", *ONE, "--smooth", "--out", "z-smoothed.csv")[0] == 0
    Path("s.toml").write_text('[output]\nsmooth = "yes"\n')
    error = call("track", "z.csv", *ONE, "--config", "s.toml")[2]
    assert "[output], smooth: must be of type bool, got 'yes'" in error


@pytest.mark.parametrize(
    "text, message",
    [
        ("time,lat,lon\n0,50,1\n1,50,1\n", "column lat: no position in metres by its name; say which are"),
        ("time,range_m,azimuth\n0,50,1\n1,50,1\n", "column azimuth: no position in metres by its name"),
        ("time,x,y,snr\n0,1,1,9\n1,1,1,9\n", "column snr: no position in metres by its name"),
        ("time,x_km,y_km\n0,1,1\n1,1,1\n", "column x_km: in km, not in metres; say what the columns are"),
        ("time,x,y\n1477010443000000,1,1\n1477010443100000,1,1\n", "1477010443100000 s is 4.68e+07 years"),
    ],
)
def test_what_was_tracked_silently_wrong_is_refused(call, text, message):
    Path("z.csv").write_text(text)
    code, printed, errors = call("track", "z.csv", *ONE)
    assert code == 2 and printed == "" and len(errors.splitlines()) == 1 and message in errors
    assert errors.isascii() and not Path("track.csv").exists()


@pytest.mark.parametrize(
    "words, message",
    [
        (("--targets", "two"), "unknown targets 'two'; choose one of one, many"),
        ((), "sensor '' has no deviation; give --sensor-deviation, such as 50 (m)"),
        ((*ASSUMED, "--confirm", "3"), "--confirm must be M/N, such as 3/5, got '3'"),
        ((*ASSUMED, "--prior", "1,1,0,0"), "--prior is of one target; give --targets one"),
        ((*ASSUMED, "--speed", "150"), "--speed is of one target; give --targets one"),
        (("--targets", "one", "--sensor-deviation", "5"), "missing option --clutter-density"),
        (("--targets", "one", "--clutter-density", "5"), "missing option --sensor-deviation"),
        (
            (*ONE, "--acceleration-deviation", "1,2"),
            "--acceleration-deviation of one target must be one number",
        ),
        (
            ("--sensor-deviation", "5 sec"),
            "--sensor-deviation: sec is a unit of time, but a length is needed",
        ),
        (("--day", "1/2/2024"), "--day must be YYYY-MM-DD, got '1/2/2024'"),
        (("--rotation-period", "-1"), "--rotation-period must be positive, got -1"),
        (("--sensor-position", "5"), "--sensor-position: must be LAT,LON or LAT,LON,ALT"),
        (("--sensor-deviation", "x=3,x=4,y=2"), "--sensor-deviation: a coordinate is named twice: x, x, y"),
        (("--encoding", "nonsense"), "encoding must be one of text, such as utf-8 or cp1252, got 'nonsense'"),
        (("--delimiter", ",,"), "delimiter must be one character, tab or space, got ',,'"),
        (("--decimal", ";"), "decimal must be one of ., ,, got ';'"),
        (("--azimuth-convention", "nautic"), "azimuth_convention must be one of compass, math, got 'nautic'"),
        (("--north-offset", "5deg"), "z.csv: no azimuths for a north offset to turn; leave it out"),
        ((*ASSUMED, "--max-coast", "0"), "max_coast must be positive, got 0.0"),
        ((*ASSUMED, "--max-speed", "0"), "max_speed must be positive, got 0.0"),
        ((*ASSUMED, "--stay-probability", "0"), "stay_probability must be in (0, 1], got 0.0"),
        ((*ASSUMED, "--confirm-existence", "0"), "confirm must be a probability of existence or (M, N)"),
        (
            (*ASSUMED, "--delete", "5/5", "--delete-existence", "0.1"),
            "--delete and --delete-existence are two",
        ),
        (("--clutter-density", "-1"), "--clutter-density must be 0 or more, got -1.0"),
        ((*ASSUMED, "--clutter-per-scan", "2"), "--clutter-density and --clutter-per-scan both say"),
        (
            (*ASSUMED, "--motion", "constant-velocity", "--acceleration-deviation", "1,2"),
            "--motion constant-velocity has one acceleration deviation, got 2",
        ),
        ((*ONE, "--max-speed", "3"), "--max-speed is of many targets; give --targets many"),
        ((*ONE, "--confirm", "3/5"), "--confirm is of many targets; give --targets many"),
        ((*ASSUMED, "--truth-file", "t.csv", "--out", "t.csv"), "t.csv is named twice, and what it holds"),
    ],
)
def test_an_option_that_is_wrong_is_named(call, words, message):
    Path("z.csv").write_text("time_s,x_m,y_m\n0,1,1\n1,1,1\n")
    code, printed, errors = call("track", "z.csv", *words)
    assert code == 2 and printed == "" and len(errors.splitlines()) == 1 and message in errors


def test_the_help_has_the_options_by_what_they_are_of():
    printed = CliRunner().invoke(cli.app, ["track", "--help"], env={"COLUMNS": "200"}).output
    panels = [printed.index(f" {name} ─") for name in ("input", "sensor", "target", "tracks")]
    assert panels == sorted(panels) and panels[1] < printed.index("--north-offset") < panels[2]
