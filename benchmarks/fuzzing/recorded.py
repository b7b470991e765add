"""Files of detections as targets: read, cut into scans, tracked, smoothed and written."""

import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import Rng, decades
from fuzzing.stored import READ, folder, stored, with_bytes_wrong
from gmr_gym.recorded import Tracks, cut, read, smooth, track, tracking_model
from gmr_gym.recorded.output import write_tracks
from gmr_gym.recorded.positions import box_of
from gmr_gym.recorded.tracks import DELETED

POLAR = ("range_m", "azimuth_deg", "elevation_deg")
HEADS = (("x_m", "y_m"), ("x_km", "y_km", "z_km"), POLAR[:2], POLAR, ("lat", "lon"), ("lat", "lon", "alt_m"))
CELLS = ("x", "1_0", "--1", "0x10", "1e999", "inf")
BESIDE = ("", "id", "scan", "range_rate_mps")


def recorded_targets() -> list[Target]:
    """Files of detections, whole and with bytes wrong."""
    whole = Target("recorded/track", _draw, _tracked, _check, _spoil, share=0.3, refuses=READ)
    return [whole, with_bytes_wrong(whole, _check)]


def _draw(rng: Rng) -> tuple:
    names, beside, n = HEADS[rng.integers(len(HEADS))], BESIDE[rng.integers(4)], int(rng.integers(1, 40))
    steps = rng.choice([0.0, 1.0, decades(rng, -6, 6)], n)
    time = np.cumsum(steps) + (1.6e9 if rng.random() < 0.3 else 0.0)
    place = _places(rng, names, n, time)
    columns = {"time_s": time} | dict(zip(names, place.T, strict=True))
    if beside == "id":
        columns["id"] = rng.integers(3, size=n)
    elif beside == "scan":
        columns["scan"] = np.cumsum(steps > 0)
    elif beside and names[0] == "range_m":
        columns["range_rate_mps"] = decades(rng, -2, 3) * rng.standard_normal(n)
    rows = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns.values(), strict=True)]
    text = "\n".join([",".join(columns), *(rows[i] for i in _order(rng, n))])
    assumed = {
        "deviation": float(decades(rng, -5, 5)),
        "acceleration_deviation": tuple(decades(rng, -5, 3, int(rng.integers(1, 3))).tolist()),
        "max_speed": float(decades(rng, -2, 4)),
        "birth_rate": float(decades(rng, -6, 1)),
        "learn_clutter": bool(rng.random() < 0.3),
        "confirm": ((2, 3), 0.9)[rng.integers(2)],
    }
    return text.encode(), assumed


def _places(rng: Rng, names: tuple[str, ...], n: int, time: np.ndarray) -> np.ndarray:
    """Positions (n, p) of a few targets that move, or of none."""
    base = np.array([50.0, 8.0, 100.0] if names[0] == "lat" else [1e3, 40.0, 5.0])[: len(names)]
    size = decades(rng, -6, 0) if names[0] == "lat" else decades(rng, -4, 3)
    start = size * rng.standard_normal((n if rng.random() < 0.2 else 1, len(names)))
    drift = 1e-3 * size * rng.standard_normal(len(names)) * (time - time[0])[:, None] % 10.0
    return base + start + drift + 1e-3 * size * rng.standard_normal((n, len(names)))


def _order(rng: Rng, n: int) -> np.ndarray:
    return rng.permutation(n) if rng.random() < 0.1 else np.arange(n)


def _tracked(content: bytes, assumed: dict) -> tuple[Tracks, Tracks]:
    found = read(stored(content, "read.csv"))
    assumed = dict(assumed)
    deviation = assumed.pop("deviation")
    sensors = []
    for spec in found.sensors:
        turned = (1e-5 * deviation,) * (spec.p - 1) if spec.kind == "polar" else (deviation,) * (spec.p - 1)
        sensors.append(spec._replace(deviation=(deviation, *turned), range_rate_deviation=deviation))
    low, high = box_of(found)
    model = tracking_model(sensors, low.tolist(), high.tolist(), **assumed)
    found, scans = found._replace(sensors=model.sensors), cut(found)
    alone = len(scans) == len(found.time) and all(name is not None for name in found.identity)
    tracks = track(found, scans, model, reports=alone)
    write_tracks(folder() / "tracks.csv", tracks, found)
    return tracks, smooth(tracks, found, model)


def _spoil(rng: Rng, arguments: tuple) -> Spoilt:
    content, assumed = arguments
    lines = content.decode().split("\n")
    row = int(rng.integers(1, len(lines)))
    cells = lines[row].split(",")
    cells[rng.integers(3)] = cell = CELLS[rng.integers(len(CELLS))]
    lines[row] = ",".join(cells)
    return Spoilt(("\n".join(lines).encode(), assumed), ("read.csv",), f"a cell of {cell!r}")


def _check(arguments: tuple, result: tuple[Tracks, Tracks]) -> None:
    for tracks in result:
        checks.finite("x", tracks.x)
        checks.finite("P", tracks.P)
        for name in ("existence", "weight", "modes"):
            value = getattr(tracks, name)
            checks.finite(name, value)
            if (value < 0).any() or (value > 1 + 1e-9).any():
                raise Finding("value", f"{name} beyond 0..1: {value.min()} to {value.max()}")
        variance = np.diagonal(tracks.P, axis1=1, axis2=2)
        if (variance <= 0).any():
            raise Finding("indefinite", f"a variance of {variance.min()}")
    _check_lives(result[0])


def _check_lives(tracks: Tracks) -> None:
    """Rows are in order, and a track that was deleted has none after that."""
    if (np.diff(tracks.time) < 0).any():
        raise Finding("value", "rows are not in order of time")
    for label in np.unique(tracks.track):
        rows = np.flatnonzero(tracks.track == label)
        if (tracks.status[rows[:-1]] == DELETED).any() or (np.diff(tracks.age[rows]) <= 0).any():
            raise Finding("value", f"track {label} goes on after its end, or does not age")
