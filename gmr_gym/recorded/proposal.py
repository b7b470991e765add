"""What a file says of its sensors and targets: deviations, detection probability, clutter, process noise."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.recorded.configuration import Configuration
from gmr_gym.recorded.detections import POLAR, Detections, SensorSpec
from gmr_gym.recorded.estimates import (
    detection_and_clutter,
    deviations_of_sensors,
    motion_and_noise,
    rests_on,
)
from gmr_gym.recorded.evidence import check_enough, first_speed, run_with, static_speed, usual_speed, wide
from gmr_gym.recorded.figures import Figure
from gmr_gym.recorded.positions import local_positions
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.sensor_settings import SensorSettings
from gmr_gym.recorded.static_cells import static_rows

PARTS = (100.0, 400.0, 25.0)  # of the extent, that are tried for a first deviation
AGAIN = 3.0  # times the deviation found with it, for the second run
MOST_SCANS = 2000  # the first ones are looked at
COMPARED = (
    "NIS / degrees",
    "NIS beyond",
    "correlation of",
    "tracks confirmed",
    "static tracks",
    "coasted share",
)


class Proposal(NamedTuple):
    """What tracking may assume, and what that rests on.

    Attributes
    ----------
    sensors : tuple of SensorSpec
    learn_clutter : bool
    target : dict
        `motion`, `acceleration_deviation` (or two) and `max_speed`, as `tracking_model` takes them; and
        `min_speed` where there are static tracks.
    lines : list of str
        Each number with its interval and what it rests on.
    before, after : list of Figure
        Quality of the tracks of the first run and of one with the proposal.
    """

    sensors: tuple[SensorSpec, ...]
    learn_clutter: bool
    target: dict[str, Any]
    lines: list[str]
    before: list[Figure]
    after: list[Figure]


def propose(found: Detections, scans: Sequence[Scan], *, reports: bool = False) -> Proposal:
    """Propose what tracking assumes from the detections alone.

    Parameters
    ----------
    found : Detections
    scans : sequence of Scan
        In order of time.
    reports : bool
        Whether scans are single reports of targets: none is missed, and none is clutter.

    Returns
    -------
    Proposal

    Raises
    ------
    ValueError
        If no target moves, or fewer than `LEAST_INNOVATIONS` coordinates of such targets, or
        `estimates.LEAST_DIFFERENCES` differences of a sensor, were measured.

    Notes
    -----
    Only tracks count that move, are not of spots that are hit all the time, and have ten detections. Their
    number is no reason to refuse: how well noise is known depends on the number of innovations alone, and the
    interval says it. It limits for which targets the numbers hold, and is said where it is below
    `estimates.FEW`.
    """
    for spec, rates in ((spec, found.range_rate[found.sensor == i]) for i, spec in enumerate(found.sensors)):
        if not (spec.range_rate_deviation > 0 or np.isnan(rates).all()):
            raise ValueError(
                f"the deviation of range rates is not proposed, and sensor {spec.name!r} measures them; give "
                "--sensor-deviation range_rate=1 (m/s)"
            )
    scans, points = list(scans[:MOST_SCANS]), local_positions(found)
    still, _ = static_rows(points, scans)
    target = {"motion": "constant-velocity", "acceleration_deviation": 3.0}
    target["max_speed"] = first_speed(points, scans)
    rough = [run_with(wide(found, points, part), scans, target, still, reports) for part in PARTS]
    first = max(rough, key=lambda one: sum(map(len, one.hits)))
    check_enough(first, points)
    target["max_speed"] = usual_speed(first)
    guesses = [
        spec._replace(deviation=tuple(AGAIN * one for one in spec.deviation))
        for spec in deviations_of_sensors(first, points)[0]
    ]
    second = run_with(found._replace(sensors=tuple(guesses)), scans, target, still, reports)
    check_enough(second, points)
    sensors, lines = deviations_of_sensors(second, points)
    third = run_with(found._replace(sensors=sensors), scans, target, still, reports)
    third = third if third.moving else second
    learn = False
    if not reports:
        sensors, learn, more = detection_and_clutter(third, sensors, scans)
        lines += more
    factor, motion, more = motion_and_noise(third, found._replace(sensors=sensors), points)
    lines += more
    target |= motion | {"max_speed": usual_speed(third)}
    least, static = (0.0, 0) if reports else static_speed(third)
    if static:
        target["min_speed"] = least
        lines.append(
            f"least speed: {least:g} m/s, the median of {static} static tracks; slower targets are hidden, "
            "and others until they have moved beyond errors"
        )
    sensors = tuple(s._replace(deviation=tuple(factor * d for d in s.deviation)) for s in sensors)
    last = run_with(found._replace(sensors=sensors), scans, target, still, reports, learn_clutter=learn)
    lines.append(rests_on(second, points))
    return Proposal(sensors, learn, target, lines, first.figures, last.figures)


def completed(settings: Configuration, proposal: Proposal) -> Configuration:
    """Settings with what is proposed for all that they do not say.

    Parameters
    ----------
    settings : Configuration
        Those that the detections were read by.
    proposal : Proposal

    Returns
    -------
    Configuration
    """
    sensors = tuple(_completed(settings.sensors, spec, proposal) for spec in proposal.sensors)
    target = dict(proposal.target)
    tracks = {name: target.pop(name) for name in ("min_speed",) if name in target}
    target["acceleration_deviation"] = list(target["acceleration_deviation"])
    if {"motion", "modes", "acceleration_deviation"} & set(settings.target):
        target = {"max_speed": target["max_speed"]}
    target, tracks = {**target, **settings.target}, {**tracks, **settings.tracks}
    return settings._replace(sensors=sensors, target=target, tracks=tracks)


def _completed(settings: Sequence[SensorSettings], spec: SensorSpec, proposal: Proposal) -> SensorSettings:
    """The settings of a sensor."""
    own = [one for one in settings if one.name == (spec.name or None)]
    said = [*own, *(one for one in settings if one.name is None), SensorSettings()][0]
    names = ("range", "azimuth", "elevation") if spec.kind == POLAR else ("x", "y", "z")
    given = {role: value for role, value in said.deviation.items() if value > 0}
    if "" not in given:
        rounded = (float(f"{one:.3g}") for one in spec.deviation)
        given = dict(zip(names, rounded, strict=False)) | given
    said = said._replace(name=spec.name or None, deviation=given)
    if np.isnan(said.detection_probability) and not np.isnan(spec.detection_probability):
        said = said._replace(detection_probability=float(f"{spec.detection_probability:.3g}"))
    if np.isnan([said.clutter_per_scan, said.clutter_density]).all() and spec.clutter_per_scan > 0:
        clutter = float(f"{spec.clutter_per_scan:.3g}")
        said = said._replace(
            clutter_per_scan=clutter, learn_clutter=said.learn_clutter or proposal.learn_clutter
        )
    return said


def before_and_after(proposal: Proposal) -> list[str]:
    """The figures of quality with rough numbers and with those proposed, a line each."""
    after = {one.name: one for one in proposal.after}
    lines = []
    for one in proposal.before:
        if one.name.startswith(COMPARED) and one.name in after:
            other = after[one.name]
            expected = f", expected {other.low:.3g} to {other.high:.3g}" if other.low == other.low else ""
            lines.append(f"{one.name}: {one.value:.3g} before, {other.value:.3g} after{expected}")
    return lines
