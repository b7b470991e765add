"""Published tables, run again: the paper's figures beside ours, with a verdict on each."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from gmr_gym.summary import CONFIDENCE, Figure


@dataclass(frozen=True)
class Table:
    """One published table: where it was run, what was run, and what was printed."""

    name: str
    title: str
    env_id: str
    settings: dict[str, Any]  # of the environment
    trackers: dict[str, dict[str, Any]]  # name -> parameters
    published: dict[str, dict[str, float]]  # tracker -> metric -> figure
    runs: int  # behind the published figures


def verdict(figure: Figure, runs: int, printed: float, printed_runs: int, share: bool) -> str:
    """ "agrees" when ours and the printed figure differ by no more than chance allows 99 times in a
    hundred, else "above" or "below". The printed figure is given the relative sampling error ours would
    have with as many runs; `share` marks a proportion, whose error is known from the figure itself."""
    if share:
        deviation = np.sqrt(figure.value * (1 - figure.value) / runs + printed * (1 - printed) / printed_runs)
    else:
        own = (figure.high - figure.low) / 2 / norm.ppf((1 + CONFIDENCE) / 2)
        deviation = own * np.hypot(1, printed / figure.value * np.sqrt(runs / printed_runs))
    if not np.isfinite(deviation):
        return "unknown"
    if abs(figure.value - printed) <= norm.ppf(0.995) * deviation:
        return "agrees"
    return "above" if figure.value > printed else "below"


def table_record(
    name: str,
    settings: Mapping[str, Any],
    rows: Mapping[str, Mapping[str, Figure]],
    table: Table | None = None,
    runs: int = 0,
) -> dict[str, Any]:
    """A table as plain data for JSON; with the published Table, its figures and verdicts."""
    records = []
    for tracker, figures in rows.items():
        metrics = {}
        for metric, figure in figures.items():
            cell: dict[str, Any] = {key: _number(value) for key, value in figure._asdict().items()}
            printed = table.published.get(tracker, {}).get(metric) if table else None
            if table and printed is not None:
                cell["paper"] = printed
                if metric != "time_per_scan":  # another machine's clock
                    cell["verdict"] = verdict(figure, runs, printed, table.runs, share=metric == "track_loss")
            metrics[metric] = cell
        records.append({"tracker": tracker, "metrics": metrics})
    return {"name": name, "settings": dict(settings), "rows": records}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
