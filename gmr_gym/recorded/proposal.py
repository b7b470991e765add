"""What a file says of its sensors and targets: deviations, detection probability, clutter, process noise."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from gmr_gym.recorded.detections import POLAR, Detections, SensorSpec
from gmr_gym.recorded.figures import Figure, wilson
from gmr_gym.recorded.model import tracking_model
from gmr_gym.recorded.noise import deviation_of, differences, likelihoods
from gmr_gym.recorded.positions import box_of, local_positions
from gmr_gym.recorded.quality import SHORT, Life, lives_of, quality, unused
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.static_cells import static_rows
from gmr_gym.recorded.tracking import track
from gmr_gym.recorded.tracks import Tracks

PARTS = (100.0, 400.0, 25.0)  # of the extent, that are tried for a first deviation
AGAIN = 3.0  # times the deviation found with it, for the second run
FASTEST = 350.0  # m/s, of the first run; less in a small place
CROSSED = 10  # periods in which no target crosses the place
UNKNOWN_RATE = 1.0  # m/s, deviation of range rates of which nothing is known
MOST_SCANS = 2000  # the first ones are looked at
MOST_USED = 3000  # detections for the process noise
LEAST_INNOVATIONS = 100  # coordinates of detections of tracks that move
LEAST_DIFFERENCES = 24  # of each sensor: a deviation within a factor of two
LEAST = 1e-3  # times the deviation assumed, below which detections are rounded, not repeated
FEW = 5  # tracks that move, below which the numbers are said to be of these targets alone
NOISES = (0.1, 0.3, 1.0, 3.0, 10.0)  # m/s in a second
FACTORS = (1.0, 1.5, 2.25, 3.4)  # of the deviation
GAIN = 5.0  # in log likelihood, for which a larger deviation is taken
SCATTERED = 1.5  # index of dispersion, from which on clutter is learned
MANOEUVRE = 2  # steps from the noise of quiet motion to that of manoeuvres
BEYOND = 0.99  # of the NIS, looked at for manoeuvres


class Evidence(NamedTuple):
    """Tracks of one run, those that move, and what these took."""

    found: Detections  # with what the run assumed of the sensors
    tracks: Tracks
    confirmed: int
    moving: list[Life]
    hits: list[np.ndarray]  # of each of these, indices into the detections
    figures: list[Figure]


class Proposal(NamedTuple):
    """What tracking may assume, and what that rests on.

    Attributes
    ----------
    sensors : tuple of SensorSpec
    learn_clutter : bool
    target : dict
        `motion`, `acceleration_deviation` (or two) and `max_speed`, as `tracking_model` takes them.
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
    scans, points = list(scans[:MOST_SCANS]), local_positions(found)
    still, _ = static_rows(points, scans)
    target = {"motion": "constant-velocity", "acceleration_deviation": 3.0}
    target["max_speed"] = _first_speed(points, scans)
    rough = [_run(_wide(found, points, part), scans, target, still, reports) for part in PARTS]
    first = max(rough, key=lambda one: sum(map(len, one.hits)))
    _check(first, points)
    target["max_speed"] = _speed(first)
    wide = [
        spec._replace(deviation=tuple(AGAIN * d for d in spec.deviation))
        for spec in _sensors(first, points)[0]
    ]
    second = _run(found._replace(sensors=tuple(wide)), scans, target, still, reports)
    _check(second, points)
    sensors, lines = _sensors(second, points)
    third = _run(found._replace(sensors=sensors), scans, target, still, reports)
    third = third if third.moving else second
    learn = False
    if not reports:
        sensors, learn, more = _detection(third, sensors, scans)
        lines += more
    factor, motion, more = _noise(third, found._replace(sensors=sensors), points)
    lines += more
    target |= motion | {"max_speed": _speed(second)}
    sensors = tuple(s._replace(deviation=tuple(factor * d for d in s.deviation)) for s in sensors)
    last = _run(found._replace(sensors=sensors), scans, target, still, reports, learn_clutter=learn)
    lines.append(_rests_on(second, points))
    return Proposal(sensors, learn, target, lines, first.figures, last.figures)


def _run(
    found: Detections,
    scans: Sequence[Scan],
    target: dict[str, Any],
    still: np.ndarray,
    reports: bool,
    **more: Any,
) -> Evidence:
    low, high = box_of(found)
    model = tracking_model(found.sensors, low.tolist(), high.tolist(), **target, **more)
    found = found._replace(sensors=model.sensors)
    tracks = track(found, scans, model, reports=reports)
    lives = lives_of(tracks)
    taken = [tracks.detection[life.rows[life.hits]] for life in lives]
    moves = [
        not life.static and len(own) >= SHORT and still[own].mean() < 0.5
        for life, own in zip(lives, taken, strict=True)
    ]
    moving, hits = ([one for one, yes in zip(all_of, moves, strict=True) if yes] for all_of in (lives, taken))
    return Evidence(found, tracks, len(lives), moving, hits, quality(tracks, found, scans, reports=reports))


def _wide(found: Detections, points: np.ndarray, part: float) -> Detections:
    """The detections, of sensors whose deviations are this part of the extent."""
    length = float(np.nanmax(np.ptp(points[:, :2], axis=0), initial=1e-3)) / part
    specs = []
    for i, spec in enumerate(found.sensors):
        deviation = (length,) * spec.p
        if spec.kind == POLAR:
            angle = min(length / float(np.median(found.z[found.sensor == i, 0])), 0.1)
            deviation = (length, *(angle,) * (spec.p - 1))
        rate = spec.range_rate_deviation if spec.range_rate_deviation > 0 else UNKNOWN_RATE
        specs.append(spec._replace(deviation=deviation, range_rate_deviation=rate))
    return found._replace(sensors=tuple(specs))


def _first_speed(points: np.ndarray, scans: Sequence[Scan]) -> float:
    times = np.unique([scan.time for scan in scans])
    period = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    extent = float(np.nanmax(np.ptp(points[:, :2], axis=0), initial=0.0))
    return float(np.clip(extent / (CROSSED * period), 1.0, FASTEST))


def _speed(run: Evidence) -> float:
    """Largest speed to expect: one and a half that of nearly all rows of tracks that move."""
    axes = run.tracks.x.shape[1] // 2
    rows = np.concatenate([life.rows[life.hits][1:] for life in run.moving])
    return float(f"{1.5 * np.quantile(np.linalg.norm(run.tracks.x[rows, axes:], axis=1), 0.95):.2g}")


def _check(run: Evidence, points: np.ndarray) -> None:
    """Refuse to propose from too little."""
    count = _innovations(run, points)
    needed = (
        f"needed are {LEAST_INNOVATIONS} measured coordinates of targets that move, in tracks of at least "
        f"{SHORT} detections each"
    )
    if not run.moving:
        raise ValueError(
            f"nothing to propose from: of {run.confirmed} confirmed tracks none moves for so long; {needed}"
        )
    if count < LEAST_INNOVATIONS:
        raise ValueError(
            f"too little to propose from: tracks that move: {len(run.moving)}, their coordinates: {count}; "
            f"{needed}"
        )


def _innovations(run: Evidence, points: np.ndarray) -> int:
    """Coordinates of detections that a track predicts: of all but its first two."""
    return sum(len(own) - 2 for own in run.hits) * points.shape[1]


def _rests_on(run: Evidence, points: np.ndarray) -> str:
    n = len(run.moving)
    alone = f"; fewer than {FEW}: other targets may be different" if n < FEW else ""
    return f"rests on {n} tracks that move, {_innovations(run, points)} innovations{alone}"


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
    beyond = float((of.nis[i * len(NOISES) + k] > chi2.ppf(BEYOND, of.dof)).mean())
    if beyond <= 1 - BEYOND + 3 * np.sqrt(BEYOND * (1 - BEYOND) / n):
        return FACTORS[i], {"motion": "constant-velocity", "acceleration_deviation": (NOISES[k],)}, lines
    k = min(k, len(NOISES) - 1 - MANOEUVRE)
    both = NOISES[k], NOISES[k + MANOEUVRE]
    lines.append(
        f"motion: two, of {both[0]:g} and {both[1]:g} m/s in a second, for of one {beyond:.1%} of the NIS are "
        f"beyond {BEYOND:.0%}"
    )
    return FACTORS[i], {"motion": "imm", "acceleration_deviation": both}, lines


def _detection(
    run: Evidence, sensors: tuple[SensorSpec, ...], scans: Sequence[Scan]
) -> tuple[tuple[SensorSpec, ...], bool, list[str]]:
    """The sensors with detection probability and clutter, whether to learn it, and lines."""
    left, completed, lines, learn = unused(run.tracks, len(run.found.time)), [], [], False
    for i, spec in enumerate(sensors):
        of = f" of {spec.name}" if spec.name else ""
        looks = _looks(run, scans, i)
        n, hits = sum(map(len, looks)), int(sum(one.sum() for one in looks))
        counts = np.array([left[scan.rows].sum() for scan in scans if scan.sensor == i])
        mean, scatter = float(counts.mean()), float(counts.var() / max(counts.mean(), 1e-9))
        half = 1.96 * np.sqrt(max(scatter, 1.0) * mean / len(counts))
        learn |= scatter > SCATTERED
        spec = spec._replace(clutter_per_scan=max(mean, 1 / len(counts)), clutter_density=np.nan)
        if n:
            probability = (hits + 1) / (n + 2)
            spec = spec._replace(detection_probability=probability)
            low, high = wilson(*_independent(looks))
            lines.append(
                f"detection probability{of}: {probability:.2f} ({low:.2f} to {high:.2f}), {hits} of {n} looks"
            )
        lines.append(
            f"clutter a scan{of}: {mean:.3g} ({max(mean - half, 0):.3g} to {mean + half:.3g}), index of "
            f"dispersion {scatter:.2g}{': learned' if scatter > SCATTERED else ''}, {len(counts)} scans"
        )
        completed.append(spec)
    return tuple(completed), learn, lines


def _looks(run: Evidence, scans: Sequence[Scan], sensor: int) -> list[np.ndarray]:
    """Of each track that moves, whether a sensor detected it between its confirmation and last detection."""
    times = [np.unique([s.time for s in scans if (s.sensor == sensor) == own]) for own in (True, False)]
    looks = []
    for life in run.moving:
        between = slice(1, int(np.flatnonzero(life.hits)[-1]))
        rows, hits = life.rows[between], life.hits[between]
        mine, others = (np.isin(run.tracks.time[rows], one) for one in times)
        by = run.found.sensor[run.tracks.detection[rows]]
        looks.append(hits[mine & np.where(hits, by == sensor, ~others)])
    return [one for one in looks if len(one)]


def _independent(looks: list[np.ndarray]) -> tuple[int, int]:
    """Hits and looks, as many as would say as much if misses did not come in runs."""
    n, hits = sum(map(len, looks)), sum(int(one.sum()) for one in looks)
    off = [one - hits / n for one in looks]
    square = sum(float(one @ one) for one in off)
    together = sum(float(one[1:] @ one[:-1]) for one in off) / square if square else 0.0
    share = (1 - together) / (1 + together) if together > 0 else 1.0
    count = max(round(n * share), 1)
    return round(hits / n * count), count
