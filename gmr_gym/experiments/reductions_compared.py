"""Reductions compared: what they lose of mixtures and in tracking, against the time they take."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation.fronts import front
from gmr_gym.experiments.drawings import save
from gmr_gym.experiments.evidence import Rows
from gmr_gym.experiments.figures import heading
from gmr_gym.experiments.formats import piped
from gmr_gym.experiments.output import write_csv, write_json, write_text
from gmr_gym.experiments.records import answered
from gmr_gym.experiments.reduction_drawings import against_time
from gmr_gym.experiments.reduction_quality import (
    EVERY,
    RANDOM,
    Problem,
    of_environment,
    pooled,
    problems,
    quality_rows,
    tracker_with,
    trials,
)
from gmr_gym.experiments.reduction_tracking import REFERENCE, outcome, tables, unfit
from gmr_gym.experiments.sheets import Sheet, figures_table, notes
from gmr_gym.experiments.sheets import shown as shown_figure
from gmr_gym.experiments.sweeps import Sweep, Work, runs_shown, say_what_is_left
from gmr_gym.experiments.tables import table_record
from gmr_gym.reduction.registry import reducer
from gmr_gym.simulation.single_target import Scenario

# figures of fronts and drawings: of random mixtures, of posteriors, and of tracking
MEANS = ("nise", "divergence", "reverse_divergence")
MEDIANS = ("nise_median", "divergence_median", "reverse_divergence_median")
TRACKING = ("track_loss", "error_capped")


class Found(NamedTuple):
    """What is measured: figures of mixtures by problem, of tracking by environment and number of components,
    and why reductions are left out where."""

    quality: dict[str, Rows]
    tracking: dict[tuple[str, int], Rows]
    left_out: dict[str, dict[str, str]]

    def by_environment(self) -> dict[str, Rows]:
        """The figures of tracking with all numbers of components together, rows NAME, NUMBER."""
        found: dict[str, Rows] = {}
        for (env_id, n), rows in self.tracking.items():
            found.setdefault(env_id, {}).update({f"{name}, {n}": row for name, row in rows.items()})
        return found

    def tables(self) -> dict[str, Rows]:
        """All figures by table."""
        equal = {f"{env_id}, {n} components": rows for (env_id, n), rows in self.tracking.items()}
        timed = {
            f"{env_id}, equal time": at_equal_time(rows) for env_id, rows in self.by_environment().items()
        }
        return self.quality | equal | timed

    def fronts(self) -> dict[str, dict[str, list[str]]]:
        """By problem or environment and figure, the rows on the front, the quickest first."""
        time_of = dict.fromkeys(self.quality, "time_per_reduction")
        of = {name: MEANS if name == RANDOM else MEDIANS for name in self.quality}
        return {
            name: {
                figure: named_front(rows, time_of.get(name, "time_per_scan"), figure)
                for figure in of.get(name, TRACKING)
            }
            for name, rows in (self.quality | self.by_environment()).items()
        }


class Part(NamedTuple):
    """Runs under one bar: what each comes to is known by a key."""

    label: str
    keys: list[Any]
    work: list[Work]
    sweep: Sweep

    def results(self) -> Iterator[tuple[Any, Any]]:
        """Each key, and what `runs_shown` gives for it."""
        return zip(self.keys, runs_shown(self.label, self.work, self.sweep), strict=True)


def compared(
    asked: dict[str, Any],
    names: Sequence[str],
    scenarios: Mapping[str, Scenario],
    sweep: Sweep,
    out: Path,
    copy: Path | None,
) -> Iterator[Any]:
    """Reduces mixtures and tracks, leaves record, fronts and drawings in `out`, and gives what a screen
    shows; of a shard only what is left to others."""
    each = problems(asked["mixtures"], asked["seed"])
    tried = trials(names, each, asked["seed"])
    left_out = {
        problem: {name: one.reason for name, one in of.items() if one.reason} for problem, of in tried.items()
    }
    tracking = dict.fromkeys((REFERENCE, *asked["tracking"]))
    for env_id in scenarios:
        here = tried[of_environment(env_id)]
        left_out[env_id] = unfit({name: here[name] for name in tracking}, asked["slowest"])
    parts = [
        *(of_mixtures(problem, found, names, left_out[problem], sweep) for problem, found in each.items()),
        of_tracking(scenarios, asked["components"], tracking, left_out, sweep),
    ]
    results = [part.results() for part in parts]
    if sweep.shard:
        there = [left for part in results for _, left in part]
        say_what_is_left(sweep.blocks, *map(sum, zip(*there, strict=True)))
        return
    runs = dict(chain(*results[:-1]))
    quality = {problem: quality_rows(of, tried[problem]) for problem, of in runs.items()}
    quality[EVERY] = quality_rows(*pooled(runs, tried))
    outcomes = ((cell, outcome(scenarios[cell[0]], of[cell[2]])) for cell, of in results[-1])
    found = Found(quality, dict(tables(outcomes)), {where: why for where, why in left_out.items() if why})
    _leave(asked, found, sweep, out, copy)
    yield from shown(found, sweep)
    yield f"these, the posteriors of each environment, and drawings are in {out}"


def of_mixtures(
    problem: str, asked: Problem, names: Sequence[str], left_out: Collection[str], sweep: Sweep
) -> Part:
    """Every mixture of a problem reduced by every reduction that is not left out."""
    reducers = {name: reducer(name, asked.components) for name in names if name not in left_out}
    return Part(problem, [problem], [(asked.mixtures, reducers)], sweep._replace(runs=asked.number))


def of_tracking(
    scenarios: Mapping[str, Scenario],
    counts: Sequence[int],
    names: Iterable[str],
    left_out: Mapping[str, Collection[str]],
    sweep: Sweep,
) -> Part:
    """Every environment with every number of components and every reduction that is not left out."""
    cells = [
        (env_id, n, name)
        for env_id in scenarios
        for n in counts
        for name in names
        if name not in left_out[env_id]
    ]
    work: list[Work] = [
        (scenarios[env_id], {name: tracker_with(scenarios[env_id], components=n, reduction=name)})
        for env_id, n, name in cells
    ]
    return Part("tracking", cells, work, sweep)


def _leave(asked: dict[str, Any], found: Found, sweep: Sweep, out: Path, copy: Path | None) -> None:
    """Writes record, figures, fronts and drawings."""
    tables = [table_record(name, {}, rows) for name, rows in found.tables().items()]
    further = {"command": sweep.command, "fronts": found.fronts(), "left_out": found.left_out}
    record = answered(asked, tables, notes=notes({}, sweep.runs), **further)
    for file in filter(None, (out / "compare-reductions.json", copy)):
        write_json(file, record)
    write_csv(out / "compare-reductions.csv", record)
    for name, sheet in (("fronts", fronts_sheet(found)), ("posteriors", posteriors_sheet(found.quality))):
        write_text(out / f"{name}.md", piped(sheet.headings, sheet.rows))
    mixtures = {name: (found.quality[name], of) for name, of in ((RANDOM, MEANS), (EVERY, MEDIANS))}
    tracking = {env_id: (rows, TRACKING) for env_id, rows in found.by_environment().items()}
    for name, panels, time in (
        ("mixtures", mixtures, "time_per_reduction"), ("tracking", tracking, "time_per_scan")
    ):  # fmt: skip
        drawing = against_time(panels, time)
        for ending in ("png", "svg"):
            save(drawing, out / f"{name}.{ending}")


def shown(found: Found, sweep: Sweep) -> Iterator[Any]:
    """Tables and remarks for a screen."""
    for name, figures in ((RANDOM, ("ise", *MEANS)), (EVERY, MEDIANS)):
        columns = (*figures, "time_per_reduction")
        rows = {key: {column: row[column] for column in columns} for key, row in found.quality[name].items()}
        yield figures_table(name, rows)
    yield posteriors_sheet(found.quality)
    for name, rows in found.tables().items():
        if name not in found.quality:
            yield figures_table(f"{name}: {sweep.runs} runs, seed {sweep.seed}", rows)
    yield fronts_sheet(found)
    for where, reasons in found.left_out.items():
        yield f"left out of {where}: {'; '.join(f'{name}, {why}' for name, why in reasons.items())}"
    yield from notes({}, sweep.runs)


def named_front(rows: Rows, time: str, figure: str) -> list[str]:
    """The rows that no other one betters in the figure at no more time, the quickest first."""
    seconds = np.array([row[time].value for row in rows.values()])
    on = front(seconds, np.array([row[figure].value for row in rows.values()]))
    names = [*rows]
    return [names[i] for i in np.argsort(seconds, kind="stable") if on[i]]


def at_equal_time(rows: Rows) -> Rows:
    """Of rows NAME, NUMBER, for each name the one with the most components that takes no more time than the
    median of all rows; the best first. A name without such a row is not there."""
    limit = np.median([row["time_per_scan"].value for row in rows.values()])
    most: dict[str, str] = {}
    for key in sorted(rows, key=lambda key: int(key.rpartition(", ")[2])):
        if rows[key]["time_per_scan"].value <= limit:
            most[key.rpartition(", ")[0]] = key
    order = sorted(most.values(), key=lambda key: [rows[key][figure].value for figure in TRACKING])
    return {key: {figure: rows[key][figure] for figure in (*TRACKING, "time_per_scan")} for key in order}


def posteriors_sheet(quality: Mapping[str, Rows]) -> Sheet:
    """What of the mass of the posteriors of each environment is forgotten: median KL(f||g)."""
    figure, where = "divergence_median", [name for name in quality if name not in (RANDOM, EVERY)]
    rows = [
        [
            name,
            *(
                shown_figure(figure, quality[at][name][figure]) if name in quality[at] else "-"
                for at in where
            ),
        ]
        for name in quality[EVERY]
    ]
    titles = [name.removeprefix("posteriors of ").partition("-v")[0] for name in where]
    return Sheet(f"{heading(figure)} of posteriors, by environment", ["", *titles], rows)


def fronts_sheet(found: Found) -> Sheet:
    """What is on which front."""
    rows = [
        [where, heading(figure), "; ".join(names)]
        for where, by_figure in found.fronts().items()
        for figure, names in by_figure.items()
    ]
    return Sheet("on the front against time, the quickest first", ["of", "by", "on the front"], rows)
