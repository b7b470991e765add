"""Every speed of the package against a named alternative measured in the same run:
`python benchmarks/run.py [--quick] [--json FILE]` prints one Markdown table."""

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter, process_time

from crowd import crowd_rows
from modes import mode_rows
from reduction import reduction_rows
from rows import environment_rows, scan_rows, worker_rows
from start import memory_rows, start_rows
from threadpoolctl import threadpool_limits
from timing import Plan, Row, Timing
from vectors import vector_rows

from gmr_gym.experiments.output import write_json

SECTIONS: tuple[Callable[[Plan], Iterator[Row]], ...] = (
    reduction_rows, scan_rows, mode_rows, crowd_rows, environment_rows, vector_rows, worker_rows, start_rows,
    memory_rows,
)  # fmt: skip
PACKAGES = "gmr-gym", "numpy", "numba", "stonesoup", "nrl-tracker", "filterpy"
UNITS = ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"))


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the package against named alternatives.")
    parser.add_argument("--quick", action="store_true", help="fewer and shorter repeats, no workers")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to this file")
    parser.add_argument(
        "--cpu",
        action="store_true",
        help="count processor time where one process works alone, for a busy machine",
    )
    options = parser.parse_args()
    plan = Plan(options.quick, process_time if options.cpu else perf_counter)
    before = _load()
    rows: list[Row] = []
    with threadpool_limits(1):
        for section in SECTIONS:
            print(section.__name__.removesuffix("_rows"), "...", file=sys.stderr)
            rows += section(plan)
    clock = "processor time of this process, wall where there are others" if options.cpu else "wall"
    measured_on = machine(clock, before)
    if options.json:
        record = {
            "machine": measured_on,
            "quick": options.quick,
            "rows": [_record(row) for row in rows],
        }
        write_json(options.json, record)
    print("\n".join(f"- {name}: {value}" for name, value in measured_on.items()), "", sep="\n")
    print(table(rows))


def table(rows: list[Row]) -> str:
    """A Markdown table; times are the median and the best of the repeats, and the ratio is how many
    times as much the alternative takes, of the medians and of the bests."""
    lines = [
        "| what | ours, median (best) | against | theirs, median (best) | ratio (of bests) | note |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        lines.append(
            f"| {row.what} | {_shown(row.ours, row.unit)} | {row.against} "
            f"| {_shown(row.theirs, row.unit) if row.theirs else '-'} | {_ratio(row)} | {row.note} |"
        )
    return "\n".join(lines)


def machine(clock: str, before: float) -> dict[str, str]:
    """What the times were taken on, and its load `before` and after, ours included."""
    return {
        "processor": f"{_processor()}, {os.cpu_count()} cores",
        "load": f"{before:.1f} before, {_load():.1f} after",
        "clock": clock,
        "Python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
    }


def _load() -> float:
    """Processes that run or wait for a processor, the mean of a minute."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")


def _processor() -> str:
    information = Path("/proc/cpuinfo")
    lines = information.read_text().splitlines() if information.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"


def _shown(timing: Timing, unit: str) -> str:
    if unit != "s":
        return f"{timing.median:.0f} {unit}"
    return f"{_seconds(timing.median)} ({_seconds(timing.best)})"


def _seconds(value: float) -> str:
    scale, unit = next((pair for pair in UNITS if value >= pair[0]), UNITS[-1])
    return f"{value / scale:.3g} {unit}"


def _ratio(row: Row) -> str:
    if not row.theirs:
        return "-"
    medians, bests = row.theirs.median / row.ours.median, row.theirs.best / row.ours.best
    return f"{medians:.3g}" if row.unit != "s" else f"{medians:.3g} ({bests:.3g})"


def _record(row: Row) -> dict:
    theirs = row.theirs._asdict() if row.theirs else None
    return {**row._asdict(), "ours": row.ours._asdict(), "theirs": theirs}


if __name__ == "__main__":
    main()
