"""A paper's tables and maps, run, and the files they leave."""

from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import Any

from gmr_gym.commands import Work, runs_shown, scenario_of, tracker_of
from gmr_gym.output import write_runs
from gmr_gym.reproduce import Map, Table, table_record
from gmr_gym.sweeps import Sweep
from gmr_gym.tables import notes


def reproduced(paper: ModuleType, entry: Table, sweep: Sweep, out: Path) -> tuple[list[dict[str, Any]], Any]:
    """Runs a table and leaves its files; the records of it, and the evidence its paper's claims need. The
    results are gone by then: a table of a thousand runs is a hundred megabytes."""
    work = _work(entry)
    (results,) = runs_shown(_label(entry), work, sweep)
    ((scenario, _),) = work
    rows = entry.summarise(scenario, results)
    write_runs(out / f"runs-{entry.name}.csv", scenario, results)
    paper.figures(entry, scenario, results, rows, out)
    evidence = entry.evidence(scenario, results) if entry.evidence else None
    said = {"env": entry.env_id, "trackers": entry.trackers, "notes": notes(rows, sweep.runs)}
    records = [table_record(entry.name, entry.settings, rows, entry, sweep.runs) | said]
    if entry.paired:
        name = f"{entry.name}, paired differences"
        records.append(table_record(name, entry.settings, entry.paired(scenario, results)))
    return records, evidence


def mapped(paper: ModuleType, entry: Map, sweep: Sweep, out: Path) -> dict[str, Any]:
    """Runs every cell of a map and leaves its drawing; the record of it."""
    work, sweep = _work(entry), _share(entry, sweep)
    results = runs_shown(_label(entry), work, sweep)
    rows = {
        name: entry.summarise(scenario, found)
        for name, (scenario, _), found in zip(entry.cells(), work, results, strict=True)
    }
    paper.map_figures(entry, rows, out)
    said = {"env": entry.env_id, "trackers": entry.trackers, "notes": notes({}, sweep.runs)}
    return table_record(entry.name, entry.settings | {"runs": sweep.runs}, rows) | said


def sharded(entries: Iterable[Table | Map], sweep: Sweep) -> tuple[int, int]:
    """Runs a shard of tables and maps: how many blocks of runs are in the folder then, and of how many."""
    found: list = []
    for entry in entries:
        found += runs_shown(_label(entry), _work(entry), _share(entry, sweep))
    there, total = map(sum, zip(*found, strict=True))
    return there, total


def _label(entry: Table | Map) -> str:
    return entry.name if isinstance(entry, Map) else f"table {entry.name}"


def _share(entry: Table | Map, sweep: Sweep) -> Sweep:
    return sweep._replace(runs=max(2, sweep.runs // entry.share)) if isinstance(entry, Map) else sweep


def _work(entry: Table | Map) -> list[Work]:
    """The scenario of a table, or those of a map's cells, with the trackers."""
    every = entry.cells().values() if isinstance(entry, Map) else [entry.settings]
    scenarios = [scenario_of(entry.env_id, settings) for settings in every]
    return [
        (scenario, {spec: tracker_of(spec, scenario, **told) for spec, told in entry.trackers.items()})
        for scenario in scenarios
    ]
