"""Deviations, detection probability, clutter and motion, estimated from the tracks of a run; and in words."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gmr_gym.models.gating import gate_threshold
from gmr_gym.recorded.detections import POLAR, Detections, SensorSpec
from gmr_gym.recorded.evidence import Evidence, count_innovations, independent, looks_of
from gmr_gym.recorded.figures import wilson
from gmr_gym.recorded.noise import deviation_of, differences, likelihoods
from gmr_gym.recorded.quality import unused
from gmr_gym.recorded.scans import Scan

MOST_USED = 3000  # detections for the process noise
LEAST_DIFFERENCES = 24  # of each sensor: a deviation within a factor of two
LEAST = 1e-3  # times the deviation assumed, below which detections are rounded, not repeated
FEW = 5  # tracks that move, below which the numbers are said to be of these targets alone
NOISES = (0.1, 0.3, 1.0, 3.0, 10.0)  # m/s in a second
FACTORS = (1.0, 1.5, 2.25, 3.4)  # of the deviation
GAIN = 5.0  # in log likelihood, for which a larger deviation is taken
SCATTERED = 1.5  # index of dispersion, from which on clutter is learned
MANOEUVRE = 2  # steps from the noise of quiet motion to that of manoeuvres; one model's is between
BEYOND = 0.99  # of the NIS, looked at for manoeuvres


def rests_on(run: Evidence, points: np.ndarray) -> str:
    """What a proposal rests on, a line."""
    n = len(run.moving)
    alone = f"; fewer than {FEW}: other targets may be different" if n < FEW else ""
    return f"rests on {n} tracks that move, {count_innovations(run, points)} innovations{alone}"


def deviations_of_sensors(run: Evidence, points: np.ndarray) -> tuple[tuple[SensorSpec, ...], list[str]]:
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


def motion_and_noise(
    run: Evidence, found: Detections, points: np.ndarray
) -> tuple[float, dict[str, Any], list[str]]:
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


def detection_and_clutter(
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
