"""What was understood of a file of detections, in ten lines."""

from collections import Counter

import numpy as np

from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.positions import local_positions
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.static_cells import CELL, STATIC, static_rows

GAP = 2.5  # usual intervals; longer ones are gaps
SHOWN = 6  # names in a line


def described(found: Detections, scans: list[Scan]) -> list[str]:
    """What was understood, a line each of rows, columns, times, scans, extent, sensors, ..., and the remarks.

    Parameters
    ----------
    found : Detections
    scans : list of Scan
        Of these detections.

    Returns
    -------
    list of str
    """
    first, *others = found.remarks or ("",)
    columns = [first, *(remark for remark in others if " from " in remark and remark.startswith("time"))]
    notes = [remark for remark in others if remark not in columns]
    points = local_positions(found)[:, :3]
    low, high = np.nanmin(points, axis=0, initial=np.inf), np.nanmax(points, axis=0, initial=-np.inf)
    extent = ", ".join(f"{axis} {a:.6g} to {b:.6g}" for axis, a, b in zip("xyz", low, high, strict=False))
    lines = [
        f"rows: {len(found.time)} detections, {len(found.empty_time)} looks that detected nothing",
        *(f"columns: {line}" for line in columns),
        f"times: {_times(found)}",
        f"scans: {_scans(scans)}",
        f"extent: {extent} m" + (f"; origin at {found.reference}" if found.reference else ""),
        f"sensors: {_sensors(found)}",
        f"identities: {_counted(found.identity, 'rows')}; truth: {_counted(found.truth, 'rows')}",
        f"static: {_static(points, scans)}",
        f"metadata: {', '.join(found.metadata) or 'none'}",
    ]
    return [*lines, *(f"remark: {note}" for note in notes)]


def _times(found: Detections) -> str:
    if not len(found.time):
        return "none"
    text = f"{found.time[0]:g} to {found.time[-1]:g} s"
    return text + (f", 0 s is {found.start:%Y-%m-%d %H:%M:%S.%f} UTC" if found.start else "")


def _scans(scans: list[Scan]) -> str:
    gaps = np.diff([scan.time for scan in scans])
    gaps = gaps[gaps > 0]
    if not len(gaps):
        return f"{len(scans)}"
    usual = float(np.median(gaps))
    rows = np.array([len(scan.rows) for scan in scans])
    return (
        f"{len(scans)}, {rows.mean():.3g} rows each (0 in {(rows == 0).sum()}, most {rows.max()}); every "
        f"{usual:.4g} s, {(gaps > GAP * usual).sum()} gaps, longest {gaps.max():.4g} s"
    )


def _sensors(found: Detections) -> str:
    counts = np.bincount(found.sensor, minlength=len(found.sensors))
    each = [
        f"{spec.name or 'one'} ({spec.kind}, {count} rows"
        + (f", at {tuple(round(v, 1) for v in spec.position)} m" if any(spec.position) else "")
        + ")"
        for spec, count in zip(found.sensors, counts.tolist(), strict=True)
    ]
    moving = (
        "; moving"
        if len(found.origin) and np.ptp(found.origin, axis=0).max() > CELL and len(each) == 1
        else ""
    )
    return ", ".join(each[:SHOWN]) + (f" and {len(each) - SHOWN} more" if len(each) > SHOWN else "") + moving


def _counted(names: np.ndarray, what: str) -> str:
    counts = Counter(name for name in names.tolist() if name is not None)
    if not counts:
        return "none"
    most, count = counts.most_common(1)[0]
    return f"{len(counts)}, most {most} with {count} {what}"


def _static(points: np.ndarray, scans: list[Scan]) -> str:
    """Rows at spots that are detected in many scans: piers, masts, what is moored."""
    rows, cells = static_rows(points, scans)
    return f"{rows.sum()} rows in {cells} cells of {CELL:g} m that are hit in over {STATIC:.0%} of the scans"
