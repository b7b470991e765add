"""Every tracker in every environment that it has a model for, on the same episodes."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, tracker_entry_points
from gmr_gym.envs.lookup import scenario_of, tracker_of
from gmr_gym.evaluation.loop import play
from gmr_gym.evaluation.multi_target_summary import multi_target_summary
from gmr_gym.evaluation.summary import Estimate, summary
from gmr_gym.experiments.output import write_json, write_rows, write_text
from gmr_gym.experiments.pages import definition_list, figures, page, section
from gmr_gym.experiments.records import answered
from gmr_gym.experiments.sheets import figures_table
from gmr_gym.experiments.sweeps import Sweep, runs_shown
from gmr_gym.experiments.tables import table_record
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario, draw

UNIT = "gmr_gym/TurningTarget-v0", "pda"  # whose time per scan is 1
COLUMNS = ("track_loss", "error_own", "rmse_own", "anees_own", "components", "time_in_pda_scans")
MULTI_TARGET_COLUMNS = (
    "gospa", "localisation", "missed", "false", "cardinality_error", "components", "time_in_pda_scans",
)  # fmt: skip
ADD = (
    "A tracker of an installed package has its rows here as soon as the package names it in the entry-point "
    f"group {GROUP}, or {MULTI_TARGET_GROUP} for many targets; --tracker NAME:key=value adds one with "
    "parameters of your own."
)


def entries(
    env_ids: Sequence[str], more: Sequence[str]
) -> tuple[dict[str, tuple[Any, dict[str, Any]]], dict[str, dict[str, str]]]:
    """The trackers that run in each environment.

    Parameters
    ----------
    env_ids : sequence of str
    more : sequence of str
        Trackers beside the installed ones, NAME:key=value,key=value.

    Returns
    -------
    work : dict of str to tuple
        Scenario and trackers by environment.
    unfit : dict of str to dict of str to str
        By environment and tracker, why a tracker does not run there.

    Raises
    ------
    ValueError
        For one of `more` that runs in no environment, with the reason.
    """
    more = [name.removesuffix(":") for name in more]
    work: dict[str, tuple[Any, dict[str, Any]]] = {}
    unfit: dict[str, dict[str, str]] = {}
    for env_id in env_ids:
        scenario = scenario_of(env_id, {})
        group = MULTI_TARGET_GROUP if isinstance(scenario, MultiTargetScenario) else GROUP
        work[env_id], unfit[env_id] = (scenario, {}), {}
        for name in dict.fromkeys((*_once(group), *more)):
            try:
                work[env_id][1][name] = tracker_of(name, scenario)
            except ValueError as error:
                unfit[env_id][name] = str(error)
    for name in more:
        if reasons := [unfit[env_id][name] for env_id in env_ids if name in unfit[env_id]]:
            if len(reasons) == len(env_ids):
                raise ValueError(f"tracker {name!r} runs in none of {', '.join(env_ids)}: {reasons[0]}")
    return work, unfit


def leaderboard(
    asked: dict[str, Any],
    work: Mapping[str, tuple[Any, Mapping[str, Any]]],
    unfit: Mapping[str, Mapping[str, str]],
    sweep: Sweep,
    out: Path,
    copy: Path | None,
) -> Iterator[Any]:
    """Runs every tracker, leaves record, rows and page in `out`, and then gives what a screen shows."""
    unit = pda_scan_time(sweep.seed)
    tables, sheets = [], []
    for env_id, results in zip(work, runs_shown("leaderboard", work.values(), sweep), strict=True):
        rows = ranked(work[env_id][0], results, unit)
        tables.append(table_record(env_id, {}, rows))
        sheets.append(figures_table(f"{env_id}: {sweep.runs} runs, seed {sweep.seed}", rows))
    record = answered(asked, tables, command=sweep.command, pda_scan_time=unit, unfit=unfit)
    for file in filter(None, (out / "leaderboard.json", copy)):
        write_json(file, record)
    write_rows(
        out / "leaderboard.csv", ("environment", "tracker", "metric", "value", "low", "high"), _cells(record)
    )
    write_text(out / "leaderboard.html", leaderboard_page(record))
    yield from sheets
    yield f"written to {out}"


def ranked(
    scenario: Scenario | MultiTargetScenario, results: Mapping[str, Any], unit: float
) -> dict[str, dict[str, Estimate]]:
    """Figures of every tracker, the best first: by the share of tracks lost and the error, or by GOSPA.

    Parameters
    ----------
    scenario : Scenario or MultiTargetScenario
    results : mapping of str to Runs or MultiTargetRuns
    unit : float
        Time of a scan of PDA, s.

    Returns
    -------
    dict of str to dict of str to Estimate
    """
    columns: tuple[str, ...]
    order: tuple[str, ...]
    if isinstance(scenario, MultiTargetScenario):
        rows, columns, order = multi_target_summary(scenario, results), MULTI_TARGET_COLUMNS, ("gospa",)
    else:
        rows, columns, order = summary(scenario, results), COLUMNS, ("track_loss", "error_own")
    for row in rows.values():
        row["time_in_pda_scans"] = Estimate(row["time_per_scan"].value / unit)
    names = sorted(rows, key=lambda name: [_last_if_undefined(rows[name][metric].value) for metric in order])
    return {name: {metric: rows[name][metric] for metric in columns} for name in names}


def pda_scan_time(seed: int, episodes: int = 5) -> float:
    """Median time of a scan of PDA in TurningTarget, s, on this machine now."""
    scenario = scenario_of(UNIT[0], {})
    tracker = tracker_of(UNIT[1], scenario)
    seconds = [
        played.seconds
        for i in range(episodes)
        for played in islice(play(scenario, tracker, draw(scenario, seed + i)), 1, None)  # the first compiles
    ]
    return float(np.median(seconds))


def leaderboard_page(record: Mapping[str, Any]) -> str:
    """The page of a record: a table that sorts by any column for each environment."""
    parts = [
        section(table["name"], figures(table["rows"]), _left_out(record["unfit"].get(table["name"], {})))
        for table in record["tables"]
    ]
    about = {
        "runs": f"{record['runs']} of every tracker, the same episodes, seed {record['seed']}",
        "intervals": f"{100 * record['level']:g} %",
        "time": f"in scans of PDA in TurningTarget, {1e6 * record['pda_scan_time']:.3g} µs on that machine",
        "version": f"gmr_gym {record['version']}",
        "clairvoyant": "is given the target-originated measurement and no clutter: a bound, not a competitor",
        "your own": ADD,
    }
    return page("Leaderboard", [definition_list(about), *parts], record["command"])


def _once(group: str) -> list[str]:
    """Names of the installed trackers of a group, sorted; of two names of one tracker the first."""
    points = sorted(tracker_entry_points(group).items(), reverse=True)
    return sorted({point.value: name for name, point in points}.values())


def _left_out(reasons: Mapping[str, str]) -> str:
    return f"Not run here, for reasons in leaderboard.json: {', '.join(reasons)}." if reasons else ""


def _cells(record: Mapping[str, Any]) -> Iterator[list[Any]]:
    for table in record["tables"]:
        for row in table["rows"]:
            for metric, cell in row["metrics"].items():
                yield [table["name"], row["tracker"], metric, cell["value"], cell["low"], cell["high"]]


def _last_if_undefined(value: float) -> float:
    return np.inf if np.isnan(value) else value
