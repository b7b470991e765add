"""The figures of the comparison."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from judge import Episodes
from matplotlib.figure import Figure
from scores import front

from gmr_gym.evaluation.writing import whole

LABELS = {
    "track_loss": "targets lost, %",
    "error_capped": "error of a scan, at most 100 m",
    "work": "work a scan, mean",
    "work_iqm": "work a scan, interquartile mean",
    "time": "time a scan, s",
}
MARKERS = "osD^vP*X<>"


def draw_fronts(
    file: Path,
    competitors: Mapping[str, Mapping[str, float]],
    constants: Sequence[Mapping[str, float]],
    best: Mapping[str, Mapping[str, float]],
    by_instance: Sequence[Mapping[str, float]],
) -> None:
    """Error and losses against work, by places of `scores.place`: constants as a cloud, the front of the best
    of them, constants chosen by instance as a line, and the competitors."""
    figure = Figure(figsize=(11, 8), layout="constrained")
    axes = figure.subplots(2, 2)
    for row, error in zip(axes, ("error_capped", "track_loss"), strict=True):
        for ax, work in zip(row, ("work", "work_iqm"), strict=True):
            cloud, line = (_points(places, error, work) for places in (constants, by_instance))
            ax.plot(*cloud.T, ".", color="0.7", label="constants")
            corners = _points(list(best.values()), error, work)
            ax.plot(*corners[front(corners)].T, "-", color="0.5", label="front of the best of them")
            ax.plot(*line[front(line)].T, ":", color="0.3", label="constants by instance, in hindsight")
            for marker, (name, place) in zip(MARKERS * 3, competitors.items(), strict=False):
                ax.plot(*_points([place], error, work).T, marker, label=name, markersize=8)
            ax.set(xscale="log", xlabel=LABELS[work], ylabel=LABELS[error])
            ax.grid(alpha=0.3)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    _save(figure, file)


def draw_losses(
    file: Path, fronts: Mapping[str, Sequence[Mapping[str, float]]], named: Sequence[str]
) -> None:
    """Losses against work, its interquartile mean, and time, by places of `scores.place`, front by front:
    those that are not named in grey."""
    figure = Figure(figsize=(14, 7), layout="constrained")
    for ax, cost in zip(figure.subplots(1, 3), ("work", "work_iqm", "time"), strict=True):
        for name in (*(fronts.keys() - set(named)), *named):
            points = _points(fronts[name], "track_loss", cost)
            corners = points[front(points)].T
            if name in named:
                i = named.index(name)
                ax.plot(*corners, f"C{i % 10}-{MARKERS[i % len(MARKERS)]}", label=name, markersize=6)
            else:
                ax.plot(*corners, ".-", color="0.8", linewidth=1)
        ax.set(xscale="log", xlabel=LABELS[cost], ylabel=LABELS["track_loss"])
        ax.grid(alpha=0.3)
    figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    _save(figure, file)


def draw_instances(file: Path, competitors: Mapping[str, Episodes], reference: str) -> None:
    """Every point an instance: work, and error, of the competitors against those of the reference."""
    figure = Figure(figsize=(11, 5), layout="constrained")
    for ax, field, label in zip(
        figure.subplots(1, 2), ("work", "capped"), (LABELS["work"], LABELS["error_capped"]), strict=True
    ):
        x = getattr(competitors[reference], field).mean(axis=(0, 2))
        others = (item for item in competitors.items() if item[0] != reference)
        for marker, (name, episodes) in zip(MARKERS * 3, others, strict=False):
            ax.plot(x, getattr(episodes, field).mean(axis=(0, 2)), marker, label=name, alpha=0.7)
        ax.axline((x.min(), x.min()), (x.max() * 1.01, x.max() * 1.01), color="0.6", linewidth=1)
        ax.set(xlabel=f"{label}: {reference}", ylabel=label)
        ax.grid(alpha=0.3)
        if field == "work":
            ax.set(xscale="log", yscale="log")
    figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    _save(figure, file)


def _points(places: Sequence[Mapping[str, float]], error: str, work: str) -> np.ndarray:
    """Work and error (n, 2), losses in per cent."""
    scale = 100 if error == "track_loss" else 1
    return np.array([(place[work], scale * place[error]) for place in places])


def _save(figure: Figure, file: Path) -> None:
    with whole(file) as partial:
        figure.savefig(partial, dpi=120)
