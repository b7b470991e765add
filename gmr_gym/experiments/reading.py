"""Files of detections as the command line describes them."""

import math
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any

from gmr_gym.evaluation import recordings
from gmr_gym.experiments import tracks
from gmr_gym.experiments.detection_options import INPUT, SENSOR, given_columns, said_by
from gmr_gym.experiments.specs import numbers
from gmr_gym.recorded.configuration import READING, Configuration, read_configuration
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.formats import TEXT, form_of
from gmr_gym.recorded.reading import read
from gmr_gym.recorded.sensor_settings import SensorSettings, deviations, geodetic_of
from gmr_gym.recorded.units import ANGLE, TIME, quantity_typed

CLUTTER = "clutter_density", "clutter_per_scan"  # one of which says how much clutter there is


def configuration_of(given: Mapping[str, Any]) -> Configuration:
    """Settings of the file named by --config, with what was typed over them."""
    found = read_configuration(given["config"]) if given["config"] else Configuration()
    columns = {**found.columns, **given_columns(given)}
    typed = said_by(given, INPUT, SENSOR)
    reading = {**found.reading, **{name: typed[name] for name in READING if name in typed}}
    if given["day"]:
        reading["day"] = _day(given["day"])
    if given["reference"]:
        reading["reference"] = geodetic_of("--reference", numbers("--reference", given["reference"]))
    sensors = tuple(_typed(given, each) for each in found.sensors or (SensorSettings(),))
    return found._replace(columns=columns, reading=reading, sensors=sensors)


def detections_of(file: Path, found: Configuration) -> Detections:
    """Detections of a file, read by these settings."""
    return read(file, found.columns, sensors=found.sensors, **found.reading)


def one_target_scans(file: Path, found: Configuration, given: Mapping[str, Any]) -> recordings.Scans:
    """Scans of one target: of a plain file as they stand, or as the settings say."""
    as_it_stands = not (found.columns or found.reading or given["config"] or given["scan_window"])
    if as_it_stands and form_of(file) == TEXT:
        return tracks.plain_scans(file)
    return tracks.scans_of_positions(detections_of(file, found), given["scan_window"])


def one_target_model(found: Configuration, given: Mapping[str, Any]) -> dict[str, float]:
    """What the filter of one target assumes."""
    sensor = found.sensors[0]
    if not sensor.deviation.get("", 0.0) > 0:
        raise ValueError("missing option --sensor-deviation, m, for the positions of one target")
    if not sensor.clutter_density > 0:
        raise ValueError("missing option --clutter-density, false alarms per scan and m^2")
    acceleration = numbers("--acceleration-deviation", given["acceleration_deviation"] or "3")
    if len(acceleration) > 1:
        raise ValueError("--acceleration-deviation of one target must be one number")
    return {
        "acceleration_deviation": acceleration[0],
        "sensor_deviation": sensor.deviation[""],
        "detection_probability": 0.9
        if math.isnan(sensor.detection_probability)
        else sensor.detection_probability,
        "clutter_density": sensor.clutter_density,
    }


def _typed(given: Mapping[str, Any], settings: SensorSettings) -> SensorSettings:
    """The settings of a sensor, with what was typed over them."""
    changed: dict[str, Any] = {}
    if given["sensor_position"]:
        changed["geodetic"] = geodetic_of(
            "--sensor-position", numbers("--sensor-position", given["sensor_position"])
        )
    if given["north_offset"]:
        changed["north_offset"] = quantity_typed(given["north_offset"], ANGLE, "--north-offset")
    if given["rotation_period"]:
        changed["rotation_period"] = quantity_typed(given["rotation_period"], TIME, "--rotation-period")
        if not changed["rotation_period"] > 0:
            raise ValueError(f"--rotation-period must be positive, got {given['rotation_period']}")
    if given["sensor_deviation"]:
        changed["deviation"] = {
            **settings.deviation,
            **deviations("--sensor-deviation", given["sensor_deviation"]),
        }
    if given["detection_probability"] is not None:
        changed["detection_probability"] = given["detection_probability"]
    clutter = {name: given[name] for name in CLUTTER if given[name] is not None}
    if len(clutter) > 1:
        raise ValueError("--clutter-density and --clutter-per-scan both say the clutter; give one of them")
    for name, value in clutter.items():
        if not 0 <= value < math.inf:
            raise ValueError(f"--{name.replace('_', '-')} must be 0 or more, got {value}")
        changed |= dict.fromkeys(CLUTTER, math.nan) | clutter
    return settings._replace(**changed)


def _day(text: str) -> date:
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise ValueError(f"--day must be YYYY-MM-DD, got {text!r}") from None
