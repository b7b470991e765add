"""Files of detections in many forms become the same records, and what could be misread is refused."""

import gzip
import json
from datetime import UTC, date, datetime

import numpy as np
import pytest

from gmr_gym.evaluation import csv_columns
from gmr_gym.recorded import SensorSettings, read
from gmr_gym.recorded.geodesy import to_local

RADAR = {"time": "tod:s", "range": "rho:nmi", "azimuth": "theta:deg", "range_rate": "vr:kn"}


def written(tmp_path, text, name="z.csv", encoding="utf-8"):
    file = tmp_path / name
    file.write_text(text, encoding=encoding, newline="")
    return file


def refused(message, *args, **kwargs):
    with pytest.raises(ValueError) as error:
        read(*args, **kwargs)
    assert message in str(error.value), str(error.value)
    assert "\n" not in str(error.value)


# forms


def test_columns_are_found_by_their_names_with_their_units(tmp_path):
    found = read(written(tmp_path, "Time_ms,snr,X_km,y (ft)\n0,7,1,10\n1500,8,2,20\n"))
    assert found.time.tolist() == [0, 1.5] and found.coordinates == ("X_km", "y (ft)")
    np.testing.assert_allclose(found.z, [[1000, 3.048], [2000, 6.096]])
    assert found.metadata == {"snr": ["7", "8"]} and found.row.tolist() == [2, 3]
    assert found.kind == "cartesian" and found.start is None and found.reference is None
    assert found.remarks == ("time from Time_ms as ms; x from X_km in km, y from y (ft) in ft",)


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|", "  "])
def test_any_delimiter_decimal_comma_gzip_and_encoding(tmp_path, delimiter):
    rows = [["time_s", "x_m", "y_m", "ort"], ["0", "1.5", "2", "Köln"], ["1", "2.5", "3", "-"]]
    if delimiter != ",":
        rows = [[cell.replace(".", ",") for cell in row] for row in rows]
    text = "".join(delimiter.join(row) + "\r\n" for row in rows)
    file = written(tmp_path, text, encoding="latin-1")
    (tmp_path / "z.csv.gz").write_bytes(gzip.compress(file.read_bytes()))
    for path in (file, tmp_path / "z.csv.gz"):
        found = read(path, encoding="latin-1", decimal="." if delimiter == "," else ",")
        assert found.z.tolist() == [[1.5, 2], [2.5, 3]] and found.metadata["ort"] == ["Köln", "-"]
    refused("line 2: not text in UTF-8", file)
    (tmp_path / "cut.gz").write_bytes(gzip.compress(file.read_bytes())[:-9])
    refused("cut.gz: a damaged gzip file", tmp_path / "cut.gz")


def test_geographic_coordinates_become_local_ones(tmp_path):
    rows = [(50.77, -1.09), (50.78, -1.11), (50.77, -1.09)]
    lines = [f"2016-01-12 13:02:1{i}.218,23507076{i % 2},{a},{b}" for i, (a, b) in enumerate(rows)]
    file = written(tmp_path, "Time,MMSI,Latitude_degrees,Longitude_degrees\n" + "\n".join(lines))
    found = read(file, {"id": "MMSI"})
    assert found.start == datetime(2016, 1, 12, 13, 2, 10, 218_000, UTC)
    assert found.reference == (50.77, -1.09, 0.0) and found.identity.tolist() == [
        "235070760",
        "235070761",
        "235070760",
    ]
    np.testing.assert_allclose(
        found.z, to_local([[*row, 0] for row in rows], (50.77, -1.09, 0))[:, :2], atol=1e-9
    )
    placed = read(file, sensors=[SensorSettings(geodetic=(50.0, -1.0, 80.0))])
    assert placed.reference == (50.0, -1.0, 80.0)
    assert placed.sensors[0].position == pytest.approx((0, 0, 0), abs=1e-9)


def test_an_altitude_makes_a_track_in_space_unless_only_the_others_are_named(tmp_path):
    file = written(tmp_path, "time,latitude,longitude,altitude (m)\n2019-12-09 10:49:35,50.3,-30.9,708\n")
    assert read(file).z[0] == pytest.approx([0, 0, 708], abs=1e-6)
    flat = read(file, {"lat": "latitude", "lon": "longitude"})
    assert flat.z.shape == (1, 2) and flat.metadata == {"altitude (m)": ["708"]}


def test_polar_detections_of_a_compass(tmp_path):
    file = written(tmp_path, "tod,rho,theta,vr\n0,1,0,-10\n1,1,90,0\n2,1,225,10\n")
    found = read(file, RADAR, day=date(2024, 3, 1), sensors=[SensorSettings(north_offset=np.radians(5))])
    assert found.kind == "polar" and found.start == datetime(2024, 3, 1, tzinfo=UTC)
    np.testing.assert_allclose(found.z[:, 0], 1852)
    np.testing.assert_allclose(np.degrees(found.z[:, 1]), [85, -5, -140])
    np.testing.assert_allclose(found.range_rate * 3600 / 1852, [-10, 0, 10])
    mathematical = read(file, RADAR, azimuth_convention="math")
    np.testing.assert_allclose(np.degrees(mathematical.z[:, 1]), [0, 90, -135])
    assert "clockwise from north" in found.remarks[1] and "from the x axis" in mathematical.remarks[1]


def test_a_second_radar_measures_in_the_axes_of_the_first(tmp_path):
    """What both see at one place comes out at one place, though their norths differ."""
    target = np.array([51.2, 1.3, 9000.0])
    places = {"a": (50.0, 0.0, 10.0), "b": (51.0, 3.0, 200.0)}
    lines = ["time_s,radar,range_m,azimuth_deg,elevation_deg"]
    for name, place in places.items():
        east, north, up = to_local(target, place)
        azimuth, elevation = np.degrees([np.arctan2(east, north), np.arctan2(up, np.hypot(east, north))])
        lines.append(f"0,{name},{np.linalg.norm([east, north, up])},{azimuth % 360},{elevation}")
    sensors = [SensorSettings(name=name, geodetic=place) for name, place in places.items()]
    found = read(written(tmp_path, "\n".join(lines)), {"sensor": "radar"}, sensors=sensors)
    away, azimuth, elevation = found.z.T
    directions = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    seen = found.origin + away[:, None] * np.stack(directions, axis=1)
    np.testing.assert_allclose(seen, np.tile(to_local(target, places["a"]), (2, 1)), atol=1e-5)


@pytest.mark.parametrize("polar", [True, False])
def test_a_ship_with_a_satellite_receiver_measures_about_itself(tmp_path, polar):
    """One buoy, seen from three places, is at one place; its own axes turn as it sails east."""
    buoy = np.array([58.6, 10.4, 0.0])
    lines = ["time_s,a,b,lat,lon"]
    for i, lon in enumerate((10.0, 10.2, 10.6)):
        east, north, _ = to_local(buoy, (58.5, lon, 0.0))
        compass = np.degrees(np.arctan2(east, north)) % 360
        a, b = (np.hypot(east, north), compass) if polar else (east, north)
        lines.append(f"{600 * i},{a},{b},58.5,{lon}")
    measured = {"range": "a:m", "azimuth": "b:deg"} if polar else {"x": "a:m", "y": "b:m"}
    file = written(tmp_path, "\n".join(lines))
    found = read(file, {**measured, "own_lat": "lat", "own_lon": "lon"})
    assert found.reference == (58.5, 10.0, 0.0) and found.origin[0].tolist() == [0, 0, 0]
    seen = found.z
    if polar:
        away, azimuth = found.z.T
        seen = found.origin[:, :2] + away[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    np.testing.assert_allclose(seen, np.tile(to_local(buoy, found.reference)[:2], (3, 1)), atol=2.0)
    refused("--own-lat needs --own-lon COLUMN as well", file, {**measured, "own_lat": "lat"})
    blank = written(tmp_path, "time_s,x_m,y_m,lat,lon\n0,1,1,58,10\n1,1,1,,\n", "blank.csv")
    columns = {"x": "x_m", "y": "y_m", "own_lat": "lat", "own_lon": "lon"}
    refused("blank.csv, line 3, column lat: no value, though x_m has one", blank, columns)
    wrong = {**columns, "own_lat": "lon", "own_lon": "lat"}
    east = written(tmp_path, "time_s,x_m,y_m,lat,lon\n0,1,1,58,100\n", "east.csv")
    refused("east.csv, line 2, column lon: 100 is no latitude in degrees", east, wrong)


def test_sensors_of_two_kinds_in_one_file_without_a_header(tmp_path):
    rows = (
        "L 3.1 0.5 1477010443000000 0.6",
        "R 1.0 0.55 4.9 1477010443050000 0.8",
        "L 1.2 0.4 1477010443100000 0.9",
    )
    text = "\n".join(rows).replace(" ", "\t")
    columns = {
        "sensor": "1", "x": "L=2:m", "y": "L=3:m", "time": ["L=4:us", "R=5:us"], "range": "R=2:m",
        "azimuth": "R=3:rad", "range_rate": "R=4:m/s",
    }  # fmt: skip
    found = read(written(tmp_path, text, "z.txt"), columns, header=False, azimuth_convention="math")
    assert found.kind == "mixed" and [spec.kind for spec in found.sensors] == ["cartesian", "polar"]
    assert found.sensor.tolist() == [0, 1, 0] and found.time.tolist() == [0, 0.05, 0.1]
    np.testing.assert_allclose(found.z, [[3.1, 0.5], [1.0, 0.55], [1.2, 0.4]])
    assert np.isnan(found.range_rate[[0, 2]]).all() and found.range_rate[1] == 4.9
    refused("--no-header", tmp_path / "z.txt")


def records():
    own = {"ownshipPosition": [10.0, 20.0], "sensorID": 2}  # north, east
    return [
        {"sensorID": 3, "time": 1.62e9, "measurement": 0.4, "ownshipPosition": [0, 0]},
        {**own, "time": 1.62e9 + 1, "measurement": [[1.0, 3.0], [2.0, 4.0]]},
        {**own, "time": 1.62e9 + 2, "measurement": []},
        {**own, "time": 1.62e9 + 3, "measurement": [5.0, 6.0]},
    ]


def test_json_with_lists_of_detections_and_a_moving_sensor(tmp_path):
    file = written(tmp_path, json.dumps(records()), "z.json")
    columns = {
        "time": "time:s", "x": "measurement[1]:m", "y": "measurement[0]:m", "own_x": "ownshipPosition[1]:m",
        "own_y": "ownshipPosition[0]:m",
    }  # fmt: skip
    found = read(file, columns, where=["sensorID=2"])
    assert found.z.tolist() == [[22, 11], [24, 13], [26, 15]] and found.time.tolist() == [0, 0, 2]
    assert found.origin[:, :2].tolist() == [[20, 10]] * 3 and found.row.tolist() == [2, 2, 4]
    assert found.empty_time.tolist() == [1] and found.start == datetime.fromtimestamp(1.62e9 + 1, UTC)
    refused(
        "z.json, record 2: time runs back by 1 s",
        written(tmp_path, json.dumps(records()[:0:-1]), "z.json"),
        columns,
        order="strict",
    )
    for text, message in (
        (
            '{"t": 0}\n{"t": 1}\n',
            "a record of JSON on each line; make them one list first, as `jq -s . FILE`",
        ),
        ('[{"a": 1]', "not JSON"),
        ('{\n"a": 1', "not JSON"),
        ("[1, 2]", "must be a list of records in braces"),
    ):
        refused(message, written(tmp_path, text, "bad.json"))


def test_lines_that_end_in_a_carriage_return_alone_are_refused_with_the_way_out(tmp_path):
    text = "time_s,x_m,y_m\r0,1,1\r"
    refused(r"end in line feeds first, as `tr '\r' '\n' < OLD > NEW` does", written(tmp_path, text))
    assert len(read(written(tmp_path, text.replace("\r", "\r\n"))).time) == 1


def test_arrays_and_data_frames_are_read_by_their_columns():
    arrays = {"time_s": np.array([0, 1]), "x_m": [1.0, 2.0], "y_m": np.array([3.0, 4.0]), "name": ["a", "b"]}
    found = read(arrays, {"id": "name"})
    assert found.z.tolist() == [[1, 3], [2, 4]] and found.identity.tolist() == ["a", "b"]

    class Frame:
        columns = tuple(arrays)

        def __getitem__(self, name):
            return arrays[name]

    moments = np.array(["2024-01-01T00:00:00", "2024-01-01T00:00:00.25"], "datetime64[ms]")
    assert (read(Frame()).z == found.z).all()
    timed = read({**arrays, "time_s": moments}, {"time": "time_s"})
    assert timed.time.tolist() == [0, 0.25] and timed.start == datetime(2024, 1, 1, tzinfo=UTC)
    moments[1] = "NaT"
    refused("dict, record 2, column time_s: no time", {**arrays, "time_s": moments}, {"time": "time_s"})


# rows


def test_repeats_are_dropped_rows_sorted_and_both_counted(tmp_path):
    file = written(tmp_path, "time_s,x_m,y_m,id\n1,1,1,a\n0,2,2,b\n1,1,1,a\n0,2,2,c\n2,3,3,a\n")
    found = read(file, {"id": "id"})
    assert found.row.tolist() == [3, 5, 2, 6] and found.time.tolist() == [0, 0, 1, 2]
    assert found.remarks[1:] == ("2 rows sorted by time", "1 repeats of other rows dropped")
    assert len(read(file, {"id": "id"}, drop_repeats=False).time) == 5
    refused("line 3: time runs back by 1 s; sort the rows, or leave --order strict out", file, order="strict")


def test_rows_without_a_position_are_empty_looks_or_are_counted(tmp_path):
    file = written(tmp_path, "time_s,x_m,y_m\n0,,\n1,1,1\n1,,\n2,nan,NA\n2,,\n")
    found = read(file)
    assert found.time.tolist() == [1] and found.empty_time.tolist() == [0, 2]
    assert found.remarks[-1] == "2 rows without a position dropped"
    named = read(written(tmp_path, "time_s,x_m,y_m,id\n0,1,1,a\n1,,,a\n"), {"id": "id"})
    assert len(named.empty_time) == 0 and named.remarks[-1] == "1 rows without a position dropped"


def test_conditions_and_kept_columns(tmp_path):
    file = written(tmp_path, "time_s,x_m,y_m,snr,type\n0,1,1,5,plot\n1,2,2,15,plot\n2,3,3,25,track\n")
    assert read(file, where=["snr>10"]).row.tolist() == [3, 4]
    found = read(file, where=["snr >= 15", "type!=track"], keep=["snr"])
    assert found.row.tolist() == [3] and found.metadata["snr"] == ["15"]
    assert read(file, where=["x_m<2.5", "time_s>0"]).z.tolist() == [[2, 2]]
    refused("none of 3 rows fulfils --where snr>99", file, where=["snr>99"])
    refused("no column 'snt', did you mean 'snr'?", file, where=["snt>1"])
    refused("must be COLUMN, a comparison and a value", file, where=["snr"])
    refused("no column 'typ' to keep, did you mean 'type'?", file, keep=["typ"])


def test_times_and_conditions_have_decimal_commas_too(tmp_path):
    file = written(tmp_path, "time_s;x_m;y_m;snr\n0,5;1;1;9,5\n1,5;2;2;10,5\n2,0;3;3;11\n")
    found = read(file, decimal=",", where=["snr>9,5"])
    assert found.time.tolist() == [0, 0.5] and found.metadata["snr"] == ["10,5", "11"]


def test_scans_truth_and_names_of_sensors_are_taken_from_their_columns(tmp_path):
    file = written(
        tmp_path, "time_s,x_m,y_m,turn,who,radar\n0,1,1,7,A,north\n1,2,2,7,,south\n2,2,2,9,B,north\n"
    )
    found = read(file, {"scan": "turn", "truth": "who", "sensor": "radar"})
    assert found.scan.tolist() == [0, 0, 1] and found.truth.tolist() == ["A", None, "B"]
    assert [spec.name for spec in found.sensors] == ["north", "south"] and found.sensor.tolist() == [0, 1, 0]
    refused(
        "no row is of sensor 'nort', did you mean 'north'?",
        file,
        {"sensor": "radar"},
        sensors=[SensorSettings("nort")],
    )


def test_a_large_file_is_read_in_blocks_and_one_too_large_is_refused_with_its_memory(tmp_path, monkeypatch):
    n = 3 * csv_columns.BLOCK + 7
    file = written(tmp_path, "time_s,x_m,y_m,kind\n" + "".join(f"{i},{i}.5,2,plot\n" for i in range(n)))
    found = read(file)
    assert len(found.time) == n and found.z[-1].tolist() == [n - 0.5, 2] and found.row[-1] == n + 1
    monkeypatch.setattr(csv_columns, "_free_memory", lambda: 1e5)
    with pytest.raises(
        MemoryError, match=r"some 6.1e.03 rows need 0.0 GB, and 0.0 GB are free; keep fewer columns"
    ):
        read(file)


# refusals


@pytest.mark.parametrize(
    "text, columns, message",
    [
        ("", None, "line 1: no names of columns, and no rows"),
        ("[]", None, "JSON without records"),
        # a name without a unit, and units that are wrong
        ("time_s,x,y_m\n0,1,1\n", None, "column x: no unit in its name; give --x x:m (or km, ft, nmi, FL)"),
        (
            "time,x_m,y_m\n0,1,1\n",
            None,
            "line 2, column time: '0' is a number; say of what by --time COLUMN:s",
        ),
        (
            "time_s,range_m,azimuth\n0,1,1\n",
            None,
            "column azimuth: no unit in its name; give --azimuth azimuth:rad",
        ),
        ("time_s,a,b\n0,1,1\n", {"x": "a:metrs", "y": "b:m"}, "unknown unit 'metrs', did you mean 'metres'?"),
        ("time_s,a,b\n0,1,1\n", {"x": "a:s", "y": "b:m"}, "s is a unit of time, but a length is needed"),
        (
            "time_s,x_km,y_m\n0,1,1\n",
            {"x": "x_km:m", "y": "y_m"},
            "column x_km: km by its name, but m by --x; rename",
        ),
        ("time_s,x_km,x_m,y_m\n0,1,1,1\n", None, "columns x_km and x_m may both be x; say which by --x x_km"),
        # roles
        (
            "time_s,x_m,y_m\n0,1,1\n",
            {"x": "x_m", "y": "x_m"},
            "column x_m: given as --x and as --y; a column has one role",
        ),
        ("time_s,lat,lon\n0,1,1\n", {"lat": "lat"}, "--lat needs --lon COLUMN as well"),
        ("time_s,range_m,y\n0,1,1\n", {"range": "range_m"}, "--range needs --azimuth COLUMN as well"),
        (
            "time_s,x_m,y_m,v\n0,1,1,1\n",
            {"x": "x_m", "y": "y_m", "range_rate": "v:m/s"},
            "--range-rate needs --range",
        ),
        (
            "time_s,x_m,y_m,lat,lon\n0,1,1,1,1\n",
            None,
            "x_m, y_m and lat, lon are positions; say which by --x COLUMN",
        ),
        (
            "time_s,x_m,y_m,lat\n0,1,1,1\n",
            {"x": "x_m", "y": "y_m", "lat": "lat"},
            "x/y and lat/lon are given as the position",
        ),
        (
            "time_s,snr\n0,1\n",
            None,
            "which columns are positions? give --x COLUMN --y COLUMN, or --lat and --lon",
        ),
        (
            "when,x_m,y_m\n0,1,1\n",
            None,
            "which column is the time? give --time COLUMN; there are when, x_m, y_m",
        ),
        ("time_s,x_m,y_m\n0,1,1\n", {"x": "x_n", "y": "y_m"}, "no column 'x_n' for --x, did you mean 'x_m'?"),
        ("time_s,x_m,y_m\n0,1,1\n", {"X": "x_m"}, "unknown role 'X', did you mean 'x'?"),
        (
            "time_s,x_m,y_m\n0,1,1\n",
            {"x": "L=x_m", "y": "L=y_m"},
            "L=COLUMN is of one sensor; give --sensor COLUMN as well",
        ),
        (
            "time_s,x_m,y_m,s\n0,1,1,L\n1,1,1,R\n",
            {"sensor": "s", "x": "L=x_m", "y": "L=y_m"},
            "sensor 'R' has no columns; give --time R=COLUMN:UNIT and others",
        ),
        # coordinates that cannot be
        ("time_s,lat,lon\n0,1,1\n1,91,0\n", None, "line 3, column lat: 91 is no latitude in degrees"),
        ("time_s,lat,lon\n0,1,1\n1,0,999\n", None, "line 3, column lon: 999 is no longitude in degrees"),
        ("time_s,range_m,azimuth_deg\n0,-5,1\n", None, "line 2, column range_m: -5 m is a negative range"),
        (
            "time_s,range_m,azimuth_rad\n0,5,180\n",
            None,
            "180 rad is more than a turn: degrees? give --azimuth COLUMN:deg",
        ),
        ("time_s,range_m,azimuth_deg,elevation_rad\n0,5,1,3\n", None, "3 rad is above the zenith: degrees?"),
        ("time_s,x_m,y_m\n0,1e12,1\n", None, "line 2, column x_m: 1e+12 m is beyond 1e9 m: another unit?"),
        ("time_s,x_m,y_m\n0,1,1\n1,2,\n", None, "line 3, column y_m: no value, though x_m has one"),
        (
            "time_s,x_m,y_m\n0,1,\n1,2,\n",
            None,
            "column y_m: empty in all 2 rows; leave --y out or name another",
        ),
        ("time_s,x_m,y_m,who\n0,1,1,\n", {"id": "who"}, "column who: empty in all 1 rows; leave --id out"),
        ("time_s,x_m,y_m\n0,1,1\n1,two,1\n", None, "line 3, column x_m: 'two' is not a finite number"),
        ("time_s,x_m,y_m\n0,1,1\n1,2\n", None, "line 3, column y_m: 2 cells under 3 columns"),
        ("time_s,x_m,y_m\n", None, "no rows follow"),
        (
            "!AIVDM,1,1,,A,33P;Tw0tjBQO22:E7dm66DrB20UP,0*2E\n",
            None,
            "AIS sentences hold no time of reception",
        ),
    ],
)
def test_what_could_be_misread_is_refused_with_the_way_out(tmp_path, text, columns, message):
    file = written(tmp_path, text)
    refused(message, file, columns)


def test_speeds_that_no_target_has_are_refused_or_counted(tmp_path):
    rows = [f"{i},{i * 90_000},0,a" for i in range(5)]
    file = written(tmp_path, "time_ms,x_m,y_m,id\n" + "\n".join(rows))
    for columns in ({"id": "id"}, None):
        refused(
            "lines 2 and 3 are 9e+04 m and 0.001 s apart, 9e+07 m/s, faster than any target", file, columns
        )
    slow = [f"{i},{i * 10},0,a" for i in range(5)]
    jump = written(tmp_path, "time_s,x_m,y_m,id\n" + "\n".join([*slow, "5,9e6,0,a"]))
    assert "1 steps of 5 are faster than any target: lines 6 and 7" in read(jump, {"id": "id"}).remarks[-1]
