"""Files of tracks: every number is found again, by this package and by readers of others."""

import csv
import json
import re
from fnmatch import fnmatch
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from made_tracks import REFERENCE, START, made

from gmr_gym.recorded.detections import objects
from gmr_gym.recorded.geodesy import to_local
from gmr_gym.recorded.geojson import geojson, write_geojson
from gmr_gym.recorded.output import confirmed_only, write_mot, write_tracks
from gmr_gym.recorded.positions import geodetic
from gmr_gym.recorded.tracks import CONFIRMED, STATUS, Tracks
from gmr_gym.version import __version__

MADE = made(scans=12, start=START, reference=REFERENCE)


@pytest.fixture
def written(tmp_path):
    file = tmp_path / "tracks.csv"
    write_tracks(
        file, MADE.tracks, MADE.detections, modes=["straight", "turning"], command="gmr-gym track a.csv"
    )
    return file


def read(file):
    lines = file.read_text(encoding="utf-8").splitlines()
    head = [line for line in lines if line.startswith("#")]
    return head, list(csv.DictReader(line for line in lines if not line.startswith("#")))


def numbers(rows, *names):
    return np.array([[float(row[name] or "nan") for name in names] for row in rows])


def test_every_number_of_the_tracks_is_in_the_file(written):
    tracks, (_, rows) = MADE.tracks, read(written)
    assert len(rows) == len(tracks.time)
    assert numbers(rows, "x_m", "y_m", "vx_mps", "vy_mps") == pytest.approx(tracks.x, abs=6e-5)
    P = numbers(rows, "var_x", "cov_x_y", "cov_x_vx", "cov_x_vy", "var_y", "cov_y_vx", "cov_y_vy", "var_vx",
                "cov_vx_vy", "var_vy")  # fmt: skip
    assert P == pytest.approx(np.array([each[np.triu_indices(4)] for each in tracks.P]), rel=1e-5, abs=1e-9)
    plain = numbers(rows, "time", "track_id", "existence", "detections", "weight", "nis", "age")
    wanted = [
        tracks.time,
        tracks.track,
        tracks.existence,
        tracks.detections,
        tracks.weight,
        tracks.nis,
        tracks.age,
    ]
    assert plain == pytest.approx(np.stack(wanted, axis=1), rel=1e-5, nan_ok=True)
    assert [row["status"] for row in rows] == [STATUS[each] for each in tracks.status]
    assert numbers(rows, "mode_straight", "mode_turning") == pytest.approx(tracks.modes)
    assert numbers(rows, "speed_mps")[:, 0] == pytest.approx(np.hypot(*tracks.x[:, 2:].T), abs=1e-4)


def test_a_row_names_its_detection_and_copies_what_the_input_has_of_it(written):
    detections = MADE.detections
    for row, i in zip(read(written)[1], MADE.tracks.detection, strict=True):
        assert row["detection_row"] == (str(detections.row[i]) if i >= 0 else "")
        assert row["snr"] == (detections.metadata["snr"][i] if i >= 0 else "")


def test_the_head_says_what_made_it_and_where_zero_is(written):
    head, rows = read(written)
    assert head == [
        f"# gmr-gym {__version__}",
        "# command: gmr-gym track a.csv",
        "# time 0 s: 2024-03-01T12:00:00.250000Z",
        "# reference: 63.4, 10.4, 20.0 (latitude deg, longitude deg, altitude m; x east, y north, z up)",
    ]
    assert rows[-1]["time_utc"] == "2024-03-01T12:00:22.250000Z"


def test_places_on_earth_are_those_of_the_points_at_the_height_of_the_reference(written):
    found = numbers(read(written)[1], "lat", "lon")
    back = to_local(np.column_stack([found, np.full(len(found), REFERENCE[2])]), REFERENCE)
    assert back[:, :2] == pytest.approx(MADE.tracks.x[:, :2], abs=2e-4)
    far = np.array([[120e3, -80e3], [0.0, 0.0]])
    assert geodetic(far, REFERENCE)[:, 2] == pytest.approx(REFERENCE[2], abs=1e-3)
    assert to_local(geodetic(far, REFERENCE), REFERENCE)[:, :2] == pytest.approx(far, abs=1e-3)


@pytest.mark.parametrize(
    ("vx", "vy", "course"), [(0, 1, 0), (1, 0, 90), (0, -2, 180), (-3, 0, 270), (1, -1, 135)]
)
def test_a_course_is_counted_clockwise_from_north(tmp_path, vx, vy, course):
    tracks = MADE.tracks._replace(x=np.tile([5.0, 5.0, vx, vy], (len(MADE.tracks.time), 1)))
    write_tracks(tmp_path / "a.csv", tracks, MADE.detections)
    assert float(read(tmp_path / "a.csv")[1][0]["course_deg"]) == course


def test_what_is_not_known_has_no_column_and_names_of_the_input_give_way(tmp_path):
    n = len(MADE.detections.time)
    detections = MADE.detections._replace(
        start=None, reference=None, metadata={"status": ["a"] * n}, identity=objects([None, *["b"] * (n - 1)])
    )
    write_tracks(tmp_path / "a.csv", MADE.tracks, detections)
    head, rows = read(tmp_path / "a.csv")
    assert len(head) == 1
    assert not {"time_utc", "lat", "lon", "alt"} & rows[0].keys()
    assert (rows[0]["status"], rows[0]["input_status"], rows[0]["identity"]) == ("tentative", "a", "")
    assert rows[1]["identity"] == "b"


def in_space(tracks, height):
    """The same tracks in three coordinates."""
    x, P = np.zeros((len(tracks.time), 6)), np.tile(9.0 * np.eye(6), (len(tracks.time), 1, 1))
    x[:, [0, 1, 3, 4]], x[:, 2] = tracks.x, height
    return tracks._replace(x=x, P=P)


def test_tracks_in_space(tmp_path):
    write_tracks(tmp_path / "a.csv", in_space(MADE.tracks, 500.0), MADE.detections)
    rows = read(tmp_path / "a.csv")[1]
    assert numbers(rows[:1], "z_m", "vz_mps", "var_vz", "cov_z_vz").tolist() == [[500, 0, 9, 0]]
    assert numbers(rows, "alt")[:, 0] == pytest.approx(520, abs=0.5)


def test_the_page_has_every_column_in_order(tmp_path):
    page = (Path(__file__).parents[2] / "docs" / "files.md").read_text(encoding="utf-8")
    table = page.partition("### Columns of a file of tracks")[2].partition("| column | |\n|---|---|\n")[2]
    cells = [line.split("|")[1] for line in table.partition("\n\n")[0].splitlines()]
    wanted = [name for cell in cells for name in re.findall("`([^`]+)`", cell)]
    detections = MADE.detections._replace(identity=objects(["a"] * len(MADE.detections.time)), metadata={})
    write_tracks(tmp_path / "a.csv", in_space(MADE.tracks, 500.0), detections, modes=["slow", "fast"])
    place = [
        [fnmatch(name, pattern) for pattern in wanted].index(True) for name in read(tmp_path / "a.csv")[1][0]
    ]
    assert set(place) == set(range(len(wanted)))
    turns = {wanted.index("var_*"), wanted.index("cov_*")}  # variances and covariances take turns
    assert [i for i in place if i not in turns] == sorted(i for i in place if i not in turns)


def test_confirmed_tracks_alone_begin_with_their_confirmation():
    tracks = MADE.tracks
    never = tracks._replace(status=np.where(tracks.track == 2, 0, tracks.status).astype(np.int8))
    left = confirmed_only(never)
    for track in 1, 3:
        rows = tracks.track == track
        assert left.time[left.track == track].tolist() == tracks.time[rows][2:].tolist()
    assert set(left.track) == {1, 3}


def test_the_lines_of_the_motchallenge(tmp_path):
    tracks, file = MADE.tracks, tmp_path / "tracks.txt"
    write_mot(file, tracks, np.arange(-2.0, 30.0, 2.0))
    lines = np.loadtxt(file, delimiter=",")
    assert lines.shape == (len(tracks.time), 10)
    assert lines[:, 0] == pytest.approx(2 + tracks.time / 2)
    assert lines[:, 1].tolist() == tracks.track.tolist()
    assert (lines[:, 2:6] == -1).all()
    assert lines[:, 6:9] == pytest.approx(np.column_stack([tracks.existence, tracks.x[:, :2]]), abs=6e-5)
    with pytest.raises(ValueError, match=r"times must have that of every row of tracks, but 22\.0 is none"):
        write_mot(file, tracks, np.arange(0.0, 21.0, 2.0))


def test_stone_soup_reads_the_tracks(written):
    generic = pytest.importorskip("stonesoup.reader.generic", reason="needs stonesoup, of the extra peers")
    if not hasattr(generic, "CSVTrackReader"):
        pytest.skip("this version of stonesoup reads no tracks")
    plain = written.with_name("plain.csv")
    lines = written.read_text(encoding="utf-8").splitlines(keepends=True)
    plain.write_text("".join(line for line in lines if not line.startswith("#")), encoding="utf-8")
    reader = generic.CSVTrackReader(
        plain,
        state_vector_fields=["x_m", "vx_mps", "y_m", "vy_mps"],
        time_field="time_utc",
        track_id_field="track_id",
        default_covar=np.zeros((4, 4)),
        covar_fields_index={"var_x": (0, 0), "var_vx": (1, 1), "var_y": (2, 2), "var_vy": (3, 3)},
    )
    found = {track.id: track for _, updated in reader for track in updated}
    tracks = MADE.tracks
    assert sorted(found) == sorted(map(str, np.unique(tracks.track)))
    for name, track in found.items():
        rows = tracks.track == int(name)
        states = np.array([np.ravel(state.state_vector) for state in track])
        assert states == pytest.approx(tracks.x[rows][:, [0, 2, 1, 3]], abs=6e-5)
        assert [state.covar[0, 0] for state in track] == pytest.approx(tracks.P[rows, 0, 0], rel=1e-5)
        assert (track[0].timestamp - START).total_seconds() == tracks.time[rows][0]
        assert track.metadata["status"] == STATUS[tracks.status[rows][-1]]


@pytest.mark.skipif(find_spec("trackeval") is None, reason="trackeval is not installed")
def test_trackeval_reads_the_lines(tmp_path):
    from trackeval.datasets import MotChallenge2DBox

    tracks = MADE.tracks
    truth, tracker = tmp_path / "gt" / "all" / "seq" / "gt", tmp_path / "trackers" / "all" / "mine" / "data"
    for folder in (truth, tracker):
        folder.mkdir(parents=True)
    write_mot(tracker / "seq.txt", tracks, np.unique(tracks.time))
    (truth / "gt.txt").write_text("1,1,0,0,1,1,1,1,1\n")
    (truth.parent / "seqinfo.ini").write_text("[Sequence]\nname=seq\nseqLength=12\n")
    data = MotChallenge2DBox({
        "GT_FOLDER": str(tmp_path / "gt"), "TRACKERS_FOLDER": str(tmp_path / "trackers"), "BENCHMARK": "",
        "SEQ_INFO": {"seq": 12}, "SKIP_SPLIT_FOL": True, "SPLIT_TO_EVAL": "all", "PRINT_CONFIG": False,
        "GT_LOC_FORMAT": "{gt_folder}/all/{seq}/gt/gt.txt", "TRACKERS_TO_EVAL": ["all/mine"],
    })  # fmt: skip
    raw = data._load_raw_file("all/mine", "seq", is_gt=False)
    for t, ids in enumerate(raw["tracker_ids"]):
        assert sorted(ids) == sorted(tracks.track[tracks.time == 2.0 * t])


def check_position(position):
    """RFC 7946, 3.1.1: two numbers or three, longitude first; of degrees on Earth."""
    assert len(position) in (2, 3) and all(type(number) in (int, float) for number in position)
    assert -180 <= position[0] <= 180 and -90 <= position[1] <= 90


def check_rfc_7946(text):
    """What RFC 7946 says of a FeatureCollection of points and lines that it MUST be."""

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    whole = json.loads(text, parse_constant=refuse)
    assert whole["type"] == "FeatureCollection" and isinstance(whole["features"], list)
    assert not {"coordinates", "geometry", "properties", "crs", "geometries"} & whole.keys()  # 7.1, 4
    for feature in whole["features"]:
        assert feature["type"] == "Feature"
        assert isinstance(feature["properties"], dict | None) and "geometry" in feature
        assert isinstance(feature.get("id", ""), str | int)
        assert not {"coordinates", "features", "geometries"} & feature.keys()
        geometry = feature["geometry"]
        assert not {"geometry", "properties", "features"} & geometry.keys()
        kind, coordinates = geometry["type"], geometry["coordinates"]
        lines = {"Point": [[coordinates] * 2], "LineString": [coordinates], "MultiLineString": coordinates}[
            kind
        ]
        for line in lines:
            assert len(line) >= 2
            for position in line:
                check_position(position)
    return whole


def test_geojson_is_a_line_for_each_track_without_its_coasted_end(tmp_path):
    tracks = MADE.tracks
    missed = np.flatnonzero(tracks.track == 1)[-3:]
    detection = tracks.detection.copy()
    detection[missed] = -1
    tracks = tracks._replace(detection=detection)
    write_geojson(tmp_path / "a.geojson", tracks, MADE.detections)
    features = check_rfc_7946((tmp_path / "a.geojson").read_text())["features"]
    assert [feature["properties"]["track_id"] for feature in features] == [1, 2, 3]
    rows = np.flatnonzero(tracks.track == 1)
    last = rows[detection[rows] >= 0][-1]
    first = features[0]
    line = np.array(first["geometry"]["coordinates"])
    assert len(line) == len(first["properties"]["times"]) == np.flatnonzero(rows == last)[0] + 1 < len(rows)
    back = to_local(np.column_stack([line[:, ::-1], np.full(len(line), REFERENCE[2])]), REFERENCE)
    assert back[:, :2] == pytest.approx(tracks.x[rows[: len(line)], :2], abs=0.02)
    assert first["properties"]["start"] == "2024-03-01T12:00:00.250000Z"
    assert first["properties"]["end"] == first["properties"]["times"][-1]
    assert first["properties"].keys() == {"track_id", "start", "end", "status", "times"}
    assert all(len(f"{number}".partition(".")[2]) <= 7 for number in line.ravel())


def test_a_track_of_one_scan_is_a_point_and_one_in_space_has_altitudes():
    one = Tracks(*(column[:1] for column in in_space(MADE.tracks, 500.0)))
    collection = geojson(one, MADE.detections)
    geometry = check_rfc_7946(json.dumps(collection))["features"][0]["geometry"]
    assert geometry["type"] == "Point"
    assert geometry["coordinates"][2] == pytest.approx(520, abs=0.5)


def test_a_line_across_the_antimeridian_is_cut_there():
    time = np.arange(4.0)
    rows = np.zeros(4, int)
    x = np.column_stack([[-3000.0, -1000.0, 1000.0, 3000.0], np.zeros(4), np.zeros((4, 2))])
    P = np.tile(np.eye(4), (4, 1, 1))
    ones = np.ones(4)
    tracks = Tracks(
        time,
        rows + 1,
        np.full(4, CONFIRMED, np.int8),
        x,
        P,
        ones,
        ones[:, None],
        rows + 1,
        rows,
        ones,
        ones,
        rows,
    )
    detections = MADE.detections._replace(reference=(10.0, 180.0, 0.0), start=None)
    feature = check_rfc_7946(json.dumps(geojson(tracks, detections)))["features"][0]
    west, east = feature["geometry"]["coordinates"]
    assert (west[-1][0], east[0][0]) == (180, -180)
    assert west[-1][1] == east[0][1] == pytest.approx(10.0, abs=1e-5)
    assert all(position[0] > 0 for position in west) and all(position[0] < 0 for position in east)
    assert feature["properties"]["times"] == [0, 1, 2, 3]


def test_geojson_without_a_place_on_earth_is_refused(tmp_path):
    with pytest.raises(ValueError, match="nothing says where on Earth x and y are 0"):
        write_geojson(tmp_path / "a.geojson", MADE.tracks, MADE.detections._replace(reference=None))
    assert not list(tmp_path.iterdir())
