"""Settings in TOML say what options say."""

from datetime import date

import numpy as np
import pytest

from gmr_gym.recorded import read, read_configuration

WHOLE = """
[input]
time = { column = "tod", unit = "s", day = 2024-03-01 }
range = { column = "range_nmi" }
azimuth = { column = "azimuth_deg", from = "north", turning = "clockwise" }
sensor = "sac_sic"
keep = ["flight_level"]
drop_repeats = true

[[sensor]]
name = 6413
position = { lat = 45.9, lon = 16.1, alt = 250.0 }
rotation_period = 4.945
deviation = { range = "50 m", azimuth = "0.07 deg" }
detection_probability = "auto"
clutter = { density = "auto", learn = true }

[target]
motion = "imm"
modes = [{ acceleration_deviation = 0.1 }, { acceleration_deviation = 3.0 }]
stay_probability = 0.95
max_speed = 350.0

[tracks]
confirm = "3/5"
max_coast = 30.0

[output]
smooth = true
"""


def settings(tmp_path, text):
    (tmp_path / "radar.toml").write_text(text)
    return read_configuration(tmp_path / "radar.toml")


def test_a_whole_file_of_settings_reads_detections(tmp_path):
    found = settings(tmp_path, WHOLE)
    assert found.columns["time"] == ["tod:s"] and found.reading["day"] == date(2024, 3, 1)
    assert found.reading["azimuth_convention"] == "compass" and found.tracks["confirm"] == "3/5"
    (sensor,) = found.sensors
    assert sensor.name == "6413" and sensor.geodetic == (45.9, 16.1, 250.0) and sensor.learn_clutter
    assert np.isnan(sensor.detection_probability) and sensor.rotation_period == 4.945
    (tmp_path / "z.csv").write_text(
        "tod,sac_sic,range_nmi,azimuth_deg,flight_level,x\n27354.6,6413,10,90,330,0\n"
    )
    seen = read(tmp_path / "z.csv", found.columns, sensors=found.sensors, **found.reading)
    assert seen.z.tolist() == [[18520.0, 0.0]] and seen.metadata == {"flight_level": ["330"]}
    assert seen.sensors[0].deviation == pytest.approx((50, np.radians(0.07)))


@pytest.mark.parametrize(
    "text, message",
    [
        ("[inputs]\n", "unknown key 'inputs', did you mean 'input'?"),
        ('[input]\ntimes = "t"\n', "[input]: unknown key 'times', did you mean 'time'?"),
        ('[input]\ntime = { colum = "t" }\n', "[input], time: unknown key 'colum', did you mean 'column'?"),
        ('[input]\ntime = { unit = "s" }\n', "[input], time: needs a column"),
        ("[input]\nwhere = 3\n", "[input], where: must be of type list, got 3"),
        (
            '[input]\nazimuth = { column = "a", from = "south" }\n',
            'must be from = "north", turning = "clockwise"',
        ),
        ("[sensor]\nname = 3\n", "sensor must be a table, [[sensor]]"),
        ("[[sensor]]\ndeviation = { rang = 3 }\n", "'rang' is not measured, did you mean 'range'?"),
        ("[[sensor]]\ndeviation = -1\n", "[[sensor]], deviation: must be positive, got -1"),
        ('[[sensor]]\ndeviation = "5 sec"\n', "sec is a unit of time, but a length is needed"),
        (
            "[[sensor]]\nposition = { lat = 100, lon = 3 }\n",
            "100.0, 3.0 is no latitude and longitude in degrees",
        ),
        ("[[sensor]]\nposition = { lat = 10 }\n", "must be LAT,LON or LAT,LON,ALT in degrees and metres"),
        ('[[sensor]]\ndetection_probability = "high"\n', "must be a number or \"auto\", got 'high'"),
        ("[[sensor]]\nrotation_period = 0\n", "[[sensor]], rotation_period: must be positive, got 0"),
        ("[[sensor]]\nclutter = { densty = 1 }\n", "unknown key 'densty', did you mean 'density'?"),
        ("[[sensor]]\nclutter = { density = 1, per_scan = 2 }\n", "density and per_scan both say it"),
        ('[[sensor]]\nclutter = { learn = "no" }\n', "clutter, learn: must be of type bool, got 'no'"),
        ("[[sensor]]\nposition = 3\n", "[[sensor]], position: must be a table, got 3"),
        ("[target]\nmodes = [3]\n", "[target], modes: must be a table, got 3"),
        ("[target]\nmodes = [{}]\n", "modes, acceleration_deviation: must be of type float, got None"),
        ("[target]\nmax_speed = true\n", "[target], max_speed: must be of type float, got True"),
        ('[output]\noverwrite = "no"\n', "[output], overwrite: must be of type bool, got 'no'"),
        ("[output]\nhtml = 5\n", "[output], html: must be of type str, got 5"),
        ("[input\n", "not TOML"),
    ],
)
def test_settings_that_are_wrong_are_named_by_their_key(tmp_path, text, message):
    with pytest.raises(ValueError) as error:
        settings(tmp_path, text)
    assert message in str(error.value) and str(error.value).startswith(f"{tmp_path / 'radar.toml'}")
