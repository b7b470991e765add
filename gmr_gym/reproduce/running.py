"""A paper's tables and maps, run, and the files they leave."""

from pathlib import Path
from types import ModuleType
from typing import Any

from gmr_gym.commands import runs_shown, scenario_of, tracker_of
from gmr_gym.output import write_runs
from gmr_gym.reproduce import Map, Table, table_record


def reproduced(
    paper: ModuleType, entry: Table, runs: int, seed: int, jobs: int, out: Path
) -> tuple[list[dict[str, Any]], Any]:
    """Runs a table and leaves its files; the records of it, and the evidence its paper's claims need. The
    results are gone by then: a table of a thousand runs is a hundred megabytes."""
    scenario = scenario_of(entry.env_id, entry.settings)
    label = f"table {entry.name}"
    (results,) = runs_shown(label, [(scenario, _trackers(entry, scenario))], runs, seed, jobs, out)
    rows = entry.summarise(scenario, results)
    write_runs(out / f"runs-{entry.name}.csv", scenario, results)
    paper.figures(entry, scenario, results, rows, out)
    evidence = entry.evidence(scenario, results) if entry.evidence else None
    records = [table_record(entry.name, entry.settings, rows, entry, runs)]
    if entry.paired:
        name = f"{entry.name}, paired differences"
        records.append(table_record(name, entry.settings, entry.paired(scenario, results)))
    return records, evidence


def mapped(paper: ModuleType, entry: Map, runs: int, seed: int, jobs: int, out: Path) -> dict[str, Any]:
    """Runs every cell of a map and leaves its drawing; the record of it."""
    scenarios = {name: scenario_of(entry.env_id, settings) for name, settings in entry.cells().items()}
    work = [(scenario, _trackers(entry, scenario)) for scenario in scenarios.values()]
    runs = max(2, runs // entry.share)
    results = runs_shown(entry.name, work, runs, seed, jobs, out)
    rows = {
        name: entry.summarise(scenario, found)
        for (name, scenario), found in zip(scenarios.items(), results, strict=True)
    }
    paper.map_figures(entry, rows, out)
    return table_record(entry.name, entry.settings | {"runs": runs}, rows)


def _trackers(entry: Table | Map, scenario) -> dict[str, Any]:
    return {spec: tracker_of(spec, scenario, **parameters) for spec, parameters in entry.trackers.items()}
