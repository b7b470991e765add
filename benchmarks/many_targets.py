"""Trackers of many targets: what a scan takes, how that grows with targets and clutter, and Stone Soup's JPDA
on the same scans.

`python benchmarks/many_targets.py results/many-targets.png` draws the growth and prints the tables, by
processor time on one thread; the load of the machine stands above them.
"""

import argparse
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from rows import MISSING, stone_soup, tracked
from table import amount, markdown
from threadpoolctl import threadpool_limits
from timing import Plan, compared, timed

from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dense import dense_targets
from gmr_gym.scenarios.williams import meeting_targets
from gmr_gym.simulation.multi_target import MultiTargetScenario, draw, scan

SCANS, SEED = 15, 1
ENOUGH, SECONDS = 0.2, 3.0  # s of repeats, and of a ratio
TRACKERS = "jpda", "pmb", "pmbm", "delta-glmb", "lmb", "tomht"
TARGETS, CLUTTER = (5, 10, 20, 40), (10, 30, 100, 300)
FEW, SPARSE = 20, 50  # targets beside growing clutter, and false alarms beside growing targets


class Asked(NamedTuple):
    scenario: str
    tracker: str
    what: str
    most: float  # ms


SCENARIOS: dict[str, Callable[[], MultiTargetScenario]] = {
    "four that meet, 10 false alarms": lambda: meeting_targets(horizon=2 * SCANS),
    "20 targets, 50 false alarms": lambda: dense_targets(20, 50.0, horizon=2 * SCANS),
    "50 targets, 200 false alarms": lambda: dense_targets(horizon=2 * SCANS),
}
FOUR, TWENTY, FIFTY = SCENARIOS
ASKED = (
    Asked(TWENTY, "jpda", "JPDA", 0.5), Asked(FOUR, "pmb", "PMB", 0.5), Asked(FIFTY, "pmb", "PMB", 5.0),
    Asked(FOUR, "pmbm", "PMBM, 200 hypotheses", 5.0), Asked(FIFTY, "pmbm", "PMBM, 200 hypotheses", 100.0),
    Asked(FOUR, "delta-glmb", "delta-GLMB, 1000 samples", 10.0),
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description="Time trackers of many targets.")
    parser.add_argument("file", type=Path)
    file = parser.parse_args().file
    file.parent.mkdir(parents=True, exist_ok=True)
    before = os.getloadavg()[0]
    with threadpool_limits(1):
        figures = [asked_row(one) for one in ASKED]
        ratios = list(ratio_rows())
        curves = list(growth())
    drawing(curves).savefig(file, dpi=120)
    print(f"- load: {before:.1f} before, {os.getloadavg()[0]:.1f} after", end="\n\n")
    print(markdown(["a scan", "of", "asked, ms", "measured, ms"], figures), end="\n\n")
    print(markdown(["a scan", "ours", "against", "theirs", "ratio, 95 %", "note"], ratios), end="\n\n")
    print(markdown(["grows with", *TRACKERS], growth_rows(curves)))


def scans(scenario: MultiTargetScenario) -> list[np.ndarray]:
    episode = draw(scenario, SEED)
    return [scan(episode, t).z for t in range(scenario.horizon)]


def milliseconds(scenario: MultiTargetScenario, tracker: str) -> float:
    """Of a scan, the mean of a run; the best of the repeats: a busy machine only adds."""
    watch = tracked(make_tracker(tracker, scenario.model), scans(scenario))
    watch()  # compiles
    taken = [watch()]
    while sum(taken) * scenario.horizon < ENOUGH:
        taken.append(watch())
    return 1e3 * min(taken)


def asked_row(one: Asked) -> list[str]:
    return [
        one.what,
        one.scenario,
        f"{one.most:g}",
        f"{milliseconds(SCENARIOS[one.scenario](), one.tracker):.2f}",
    ]


def ratio_rows() -> Iterator[list[str]]:
    """JPDA, its tracks handed to Stone Soup's before each scan: those that are confirmed alone."""
    for name, build in (
        ("20 targets, 50 false alarms", SCENARIOS[TWENTY]),
        ("four that meet", SCENARIOS[FOUR]),
    ):
        if not stone_soup:
            yield [f"JPDA, {name}", "", "Stone Soup", "", "", MISSING]
            continue
        scenario = build()
        tracker, theirs, given = make_tracker("jpda", scenario.model), stone_soup.Jpda(scenario.model), []
        belief = tracker.init()
        for t, z in enumerate(scans(scenario)):
            if t >= SCANS and t % 6 == 0:
                given.append((belief, z))
            belief, _ = tracker.step(belief, z)
        ready = [theirs.prepared(before.tracks.densities, before.history.confirmed, z) for before, z in given]
        row = compared(
            Plan(SECONDS, True),
            name,
            timed(tracker.step, given),
            "Stone Soup, EHM2",
            timed(theirs.step, ready),
        )
        apart = max(
            np.abs(theirs.step(*one) - after(tracker, *both)).max()
            for one, both in zip(ready, given, strict=True)
        )
        tracks = np.mean([before.history.confirmed.sum() for before, _ in given])
        interval = f" ({row.low:.3g} to {row.high:.3g})" if row.low is not None else f", {row.pairs} pairs"
        yield [
            f"JPDA, {name}", amount(row.ours, "s"), row.against, amount(row.theirs, "s"),
            f"{row.ratio:.3g}{interval}",
            f"{tracks:.3g} confirmed tracks; ours updates and starts tentative ones too; estimates at most "
            f"{apart:.0e} m apart",
        ]  # fmt: skip


def after(tracker: Any, belief: Any, z: np.ndarray) -> np.ndarray:
    """Estimates (n, d) of the tracks that were confirmed before a scan."""
    label, (now, _) = belief.tracks.label[belief.history.confirmed], tracker.step(belief, z)
    row = [np.flatnonzero(now.tracks.label == one)[0] for one in label]
    return now.tracks.densities.m[row, 0]


def growth() -> Iterator[tuple[str, str, Sequence[int], list[float]]]:
    for name in TRACKERS:
        yield (
            "targets",
            name,
            TARGETS,
            [milliseconds(dense_targets(n, SPARSE, horizon=SCANS), name) for n in TARGETS],
        )
        yield (
            "false alarms",
            name,
            CLUTTER,
            [milliseconds(dense_targets(FEW, c, horizon=SCANS), name) for c in CLUTTER],
        )


def growth_rows(curves: Sequence[tuple]) -> list[list[str]]:
    rows = []
    for panel, points in (("targets", TARGETS), ("false alarms", CLUTTER)):
        of = {name: ms for where, name, _, ms in curves if where == panel}
        for a, x in enumerate(points):
            rows.append([f"{x} {panel}", *(f"{of[name][a]:.2f} ms" for name in TRACKERS)])
    return rows


def drawing(curves: Sequence[tuple]) -> Figure:
    figure = Figure((8, 3.6), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    beside = f"targets, {SPARSE} false alarms", f"false alarms, {FEW} targets"
    for axis, panel, label in zip(axes, ("targets", "false alarms"), beside, strict=True):
        for where, name, x, ms in curves:
            if where == panel:
                axis.loglog(x, ms, "o-", markersize=3, label=name)
        axis.set(xlabel=label, xticks=TARGETS if panel == "targets" else CLUTTER)
        axis.set_xticklabels(TARGETS if panel == "targets" else CLUTTER)
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("a scan, ms of processor time")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right", fontsize=8)
    return figure


if __name__ == "__main__":
    main()
