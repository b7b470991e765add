"""A paper's tables and maps, run, and the files they leave."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from gmr_gym.experiments.figures import legend
from gmr_gym.experiments.output import write_csv, write_json, write_runs
from gmr_gym.experiments.records import answered
from gmr_gym.experiments.sheets import VERDICTS, claims_table, comparison, notes
from gmr_gym.experiments.sweeps import Sweep, runs_shown
from gmr_gym.experiments.tables import Paper, SettingsGrid, Table, table_record


def rerun(
    name: str,
    paper: Paper,
    entries: Iterable[Table | SettingsGrid],
    asked: dict[str, Any],
    sweep: Sweep,
    out: Path,
    copy: Path | None,
) -> Iterator[Any]:
    """Runs tables and maps one after the other, and gives what a screen shows of each once its files are left
    in `out`; at the end what the paper says. The record, and its copy, hold what there is so far."""
    tables: list[dict[str, Any]] = []
    evidence: dict[str, Any] = {}
    further: dict[str, Any] = {"command": sweep.command}
    entries = list(entries)
    for entry in entries:
        title = f"{name}, {_label(entry)}: {entry.title}"
        if isinstance(entry, SettingsGrid):
            found = [mapped(paper, entry, _sweep(entry, sweep), out)]
        else:
            found, kept = reproduced(paper, entry, _sweep(entry, sweep), out)
            title += "" if entry.exact else f"; {sweep.runs} runs"
            if kept is not None:
                evidence[entry.name] = kept
        tables += found
        _keep(out / name, copy, answered(asked, tables, **further))
        first, *paired = found
        yield comparison(title, first, entry.columns)
        for record in paired:
            yield comparison(record["name"], record, list(record["rows"][0]["metrics"]))
        yield from first["notes"]
    if evidence:
        further["claims"] = paper.claim_records(evidence)
        _keep(out / name, copy, answered(asked, tables, **further))
    if further.get("claims"):
        yield claims_table(further["claims"])
    yield from legend(metric for entry in entries for metric in entry.columns)
    if any(isinstance(entry, Table) and entry.published for entry in entries):
        yield VERDICTS
    yield f"tables, figures and runs are in {out}"


def _keep(stem: Path, copy: Path | None, record: dict[str, Any]) -> None:
    for file in filter(None, (stem.with_name(f"{stem.name}.json"), copy)):
        write_json(file, record)
    write_csv(stem.with_name(f"{stem.name}.csv"), record)


def reproduced(paper: Paper, entry: Table, sweep: Sweep, out: Path) -> tuple[list[dict[str, Any]], Any]:
    """Runs a table and leaves its files; the records of it, and the evidence its paper's claims need. The
    results are gone by then: a table of a thousand runs is a hundred megabytes."""
    work = entry.work()
    (results,) = runs_shown(_label(entry), work, sweep)
    ((scenario, _),) = work
    rows = entry.summarise(scenario, results)
    write_runs(out / f"runs-{entry.name}.csv", scenario, results)
    paper.figures(entry, scenario, results, rows, out)
    evidence = paper.evidence(entry, scenario, results)
    remarks = [] if entry.exact else notes(rows, sweep.runs)
    said = {"env": entry.env_id, "trackers": entry.trackers, "notes": remarks}
    records = [table_record(entry.name, entry.settings, rows, entry, sweep.runs) | said]
    if entry.paired:
        name = f"{entry.name}, paired differences"
        records.append(table_record(name, entry.settings, entry.paired(scenario, results)))
    records = [record | {"of": entry.of} for record in records]
    return records, evidence


def mapped(paper: Paper, entry: SettingsGrid, sweep: Sweep, out: Path) -> dict[str, Any]:
    """Runs every cell of a map and leaves its drawing; the record of it."""
    work = entry.work()
    results = runs_shown(_label(entry), work, sweep)
    rows = {
        name: entry.summarise(scenario, found)
        for name, (scenario, _), found in zip(entry.cells(), work, results, strict=True)
    }
    if paper.map_figures:
        paper.map_figures(entry, rows, out)
    said = {"env": entry.env_id, "trackers": entry.trackers, "notes": notes({}, sweep.runs)}
    return table_record(entry.name, entry.settings | {"runs": sweep.runs}, rows) | said


def sharded(entries: Iterable[Table | SettingsGrid], sweep: Sweep) -> tuple[int, int]:
    """Runs a shard of tables and maps: how many blocks of runs are in the folder then, and of how many."""
    found: list = []
    for entry in entries:
        found += runs_shown(_label(entry), entry.work(), _sweep(entry, sweep))
    there, total = map(sum, zip(*found, strict=True))
    return there, total


def _label(entry: Table | SettingsGrid) -> str:
    return entry.name if isinstance(entry, SettingsGrid) else f"table {entry.name}"


def _sweep(entry: Table | SettingsGrid, sweep: Sweep) -> Sweep:
    """What is asked of a table or map, of all that is asked."""
    return sweep._replace(runs=entry.runs_of(sweep.runs))
