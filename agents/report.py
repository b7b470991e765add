"""The comparison as text: Markdown for a page, plain data for a file."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gmr_gym.evaluation.summary import Estimate

COLUMNS = {
    "track_loss": ("targets lost, %", 100),
    "error_kept": ("error where kept, m", 1),
    "error_capped": ("capped error, m", 1),
    "work": ("work, mean", 1),
    "work_iqm": ("work, IQM", 1),
    "reward": ("reward, mean", 1),
    "reward_iqm": ("reward, IQM", 1),
    "work_at_equal_error": ("work over the front's at equal error, %", 100),
    "work_at_equal_loss": ("at equal loss, %", 100),
    "time_per_scan": ("time a scan, ms", 1e3),
}
DIFFERENCES = {
    "track_loss": ("targets lost, points", 100),
    "error_kept": ("error where both kept, m", 1),
    "error_capped": ("capped error, m", 1),
    "work_ratio": ("work, mean, %", 100),
    "work_iqm_ratio": ("work, IQM, %", 100),
    "reward": ("reward", 1),
    "improvement": ("better in, % of episodes", 100),
}


def markdown(title: str, found: Mapping[str, Any]) -> str:
    """Three tables under a heading: figures, differences to the best constant, and what a gain is due to."""
    runs = {shape[2] for shape in found["shape"].values()}
    fewer = [f"{name} {shape[2]}" for name, shape in found["shape"].items() if shape[2] < max(runs)]
    seeds = [f"{name} {shape[0]}" for name, shape in found["shape"].items() if shape[0] > 1]
    said = [f"{max(runs)} episodes of each of {len(found['instances'])} instances"]
    said += [f"fewer: {', '.join(fewer)}"] * bool(fewer)
    said += [f"seeds of training: {', '.join(seeds)}"] * bool(seeds)
    return "\n\n".join([
        f"### {title}", f"{'; '.join(said)}.",
        table_of(COLUMNS, found["competitors"]),
        "Against the best constant, episode by episode:", table_of(DIFFERENCES, found["against"]),
        "What a gain is due to:", table_of(DIFFERENCES, found["split"]),
    ])  # fmt: skip


def table_of(columns: Mapping[str, tuple[str, float]], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """A table of figures, a row each: heading and scale of every column by the name of its figure."""
    lines = [["", *(heading for heading, _ in columns.values())], ["---"] * (len(columns) + 1)]
    for name, figures in rows.items():
        cells = ((figures.get(metric, Estimate(np.nan)), scale) for metric, (_, scale) in columns.items())
        lines.append([name, *(_shown(*cell) for cell in cells)])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _shown(figure: Estimate, scale: float) -> str:
    value, low, high = (f"{scale * x:.3g}" if abs(scale * x) < 1000 else f"{scale * x:.0f}" for x in figure)
    if np.isnan(figure.value):
        return "–"
    return value if np.isnan(figure.low) else f"{value} ({low} to {high})"


def plain(record: Any) -> Any:
    """The record for JSON: a Figure as [value, low, high], nan as null."""
    if isinstance(record, Mapping):
        return {key: plain(value) for key, value in record.items()}
    if isinstance(record, tuple | list):
        return [plain(value) for value in record]
    return None if isinstance(record, float) and np.isnan(record) else record
