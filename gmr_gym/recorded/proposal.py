"""What a file says of its sensors and targets: deviations, detection probability, clutter, process noise."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.models.gating import gate_threshold
from gmr_gym.recorded.configuration import Configuration, SensorSettings
from gmr_gym.recorded.detections import POLAR, Detections, SensorSpec
from gmr_gym.recorded.evidence import (
    Evidence,
    check_enough,
    count_innovations,
    first_speed,
    independent,
    looks_of,
    run_with,
    static_speed,
    usual_speed,
    wide,
)
from gmr_gym.recorded.figures import Figure, wilson
from gmr_gym.recorded.noise import deviation_of, differences, likelihoods
from gmr_gym.recorded.positions import local_positions
from gmr_gym.recorded.quality import unused
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.static_cells import static_rows

PARTS = (100.0, 400.0, 25.0)  # of the extent, that are tried for a first deviation
AGAIN = 3.0  # times the deviation found with it, for the second run
MOST_SCANS = 2000  # the first ones are looked at
MOST_USED = 3000  # detections for the process noise
LEAST_DIFFERENCES = 24  # of each sensor: a deviation within a factor of two
LEAST = 1e-3  # times the deviation assumed, below which detections are rounded, not repeated
FEW = 5  # tracks that move, below which the numbers are said to be of these targets alone
NOISES = (0.1, 0.3, 1.0, 3.0, 10.0)  # m/s in a second
FACTORS = (1.0, 1.5, 2.25, 3.4)  # of the deviation
GAIN = 5.0  # in log likelihood, for which a larger deviation is taken
SCATTERED = 1.5  # index of dispersion, from which on clutter is learned
MANOEUVRE = 2  # steps from the noise of quiet motion to that of manoeuvres; one model's is between
COMPARED = (
    "NIS / degrees",
    "NIS beyond",
    "correlation of",
    "tracks confirmed",
    "static tracks",
    "coasted share",
)
BEYOND = 0.99  # of the NIS, looked at for manoeuvres


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
        `LEAST_DIFFERENCES` differences of a sensor, were measured.

    Notes
    -----
    Only tracks count that move, are not of spots that are hit all the time, and have ten detections. Their
    number is no reason to refuse: how well noise is known depends on the number of innovations alone, and the
    interval says it. It limits for which targets the numbers hold, and is said where it is below `FEW`.
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
        for spec in _sensors(first, points)[0]
    ]
    second = run_with(found._replace(sensors=tuple(guesses)), scans, target, still, reports)
    check_enough(second, points)
    sensors, lines = _sensors(second, points)
    third = run_with(found._replace(sensors=sensors), scans, target, still, reports)
    third = third if third.moving else second
    learn = False
    if not reports:
        sensors, learn, more = _detection(third, sensors, scans)
        lines += more
    factor, motion, more = _noise(third, found._replace(sensors=sensors), points)
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
    lines.append(_rests_on(second, points))
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


def _rests_on(run: Evidence, points: np.ndarray) -> str:
    n = len(run.moving)
    alone = f"; fewer than {FEW}: other targets may be different" if n < FEW else ""
    return f"rests on {n} tracks that move, {count_innovations(run, points)} innovations{alone}"


def _sensors(run: Evidence, points: np.ndarray) -> tuple[tuple[SensorSpec, ...], list[str]]:
    """The sensors with the deviations of the detections, and a line of each."""
    sensors, lines = [], []
    for i, spec in enumerate(run.found.sensors):
        away = differences(run.hits, run.found, points, i)
        if len(away) < LEAST_DIFFERENCES:
            raise ValueError(
                f"too little to propose from: sensor {spec.name!r} has {len(away)} detections between two "
                f"others of a track that moves; needed are {LEAST_DIFFERENCES}"
            )
        deviation, factor = deviation_of(away)
        deviation = np.maximum(deviation, LEAST * np.array(spec.deviation))
        sensors.append(spec._replace(deviation=tuple(deviation.tolist())))
        names = ("range", "azimuth", "elevation") if spec.kind == POLAR else ("x", "y", "z")
        of = f" of {spec.name}" if spec.name else ""
        for name, one in zip(names, deviation.tolist(), strict=False):
            value, unit = (np.degrees(one), "deg") if name in ("azimuth", "elevation") else (one, "m")
            ends = f"{value / factor:.3g} to {value * factor:.3g}"
            lines.append(f"deviation in {name}{of}: {value:.3g} {unit} ({ends}), {len(away)} differences")
    return tuple(sensors), lines


def _noise(run: Evidence, found: Detections, points: np.ndarray) -> tuple[float, dict[str, Any], list[str]]:
    """Factor of the deviations, motion and its noise, by the likelihood of the innovations; and lines."""
    hits, used = [], 0
    for own in sorted(run.hits, key=len, reverse=True):
        hits.append(own[: max(MOST_USED - used, 0)])
        used += len(hits[-1])
    pairs = np.array([(factor, noise) for factor in FACTORS for noise in NOISES])
    of = likelihoods([own for own in hits if len(own) > 2], found, points, pairs)
    log, n = of.log.reshape(len(FACTORS), len(NOISES)), of.nis.shape[1]
    i = int(log.max(axis=1).argmax()) if log.max() > log[0].max() + GAIN else 0
    k = int(log[i].argmax())
    likely = [one for one, value in zip(NOISES, log[i], strict=True) if value > log[i, k] - 2.0]
    grid = ", ".join(f"{one:g}" for one in NOISES)
    lines = [f"deviations times {FACTORS[i]:g}: innovations are larger than they repeat"] if i else []
    lines.append(
        f"acceleration deviation: {NOISES[k]:g} m/s in a second ({likely[0]:g} to {likely[-1]:g} of {grid}), "
        f"{n} innovations"
    )
    beyond = float((of.nis[i * len(NOISES) + k] > gate_threshold(BEYOND, of.dof)).mean())
    if beyond <= 1 - BEYOND + 3 * np.sqrt(BEYOND * (1 - BEYOND) / n):
        return FACTORS[i], {"motion": "constant-velocity", "acceleration_deviation": (NOISES[k],)}, lines
    quiet = min(max(k - 1, 0), len(NOISES) - 1 - MANOEUVRE)
    both = NOISES[quiet], NOISES[quiet + MANOEUVRE]
    lines.append(
        f"motion: two, of {both[0]:g} and {both[1]:g} m/s in a second, for of one {beyond:.1%} of the NIS "
        f"are beyond {BEYOND:.0%}"
    )
    return FACTORS[i], {"motion": "imm", "acceleration_deviation": both}, lines


def _detection(
    run: Evidence, sensors: tuple[SensorSpec, ...], scans: Sequence[Scan]
) -> tuple[tuple[SensorSpec, ...], bool, list[str]]:
    """The sensors with detection probability and clutter, whether to learn it, and lines."""
    left, completed, lines, learn = unused(run.tracks, len(run.found.time)), [], [], False
    for i, spec in enumerate(sensors):
        of = f" of {spec.name}" if spec.name else ""
        looks = looks_of(run, scans, i)
        n, hits = sum(map(len, looks)), int(sum(one.sum() for one in looks))
        counts = np.array([left[scan.rows].sum() for scan in scans if scan.sensor == i])
        mean, scatter = float(counts.mean()), float(counts.var() / max(counts.mean(), 1e-9))
        half = 1.96 * np.sqrt(max(scatter, 1.0) * mean / len(counts))
        learn |= scatter > SCATTERED
        spec = spec._replace(clutter_per_scan=max(mean, 1 / len(counts)), clutter_density=np.nan)
        if n:
            probability = (hits + 1) / (n + 2)
            spec = spec._replace(detection_probability=probability)
            low, high = wilson(*independent(looks))
            lines.append(
                f"detection probability{of}: {probability:.2f} ({low:.2f} to {high:.2f}), {hits} of {n} looks"
            )
        lines.append(
            f"clutter a scan{of}: {mean:.3g} ({max(mean - half, 0):.3g} to {mean + half:.3g}), index of "
            f"dispersion {scatter:.2g}{': learned' if scatter > SCATTERED else ''}, {len(counts)} scans"
        )
        completed.append(spec)
    return tuple(completed), learn, lines
