"""Every speed of the package against a named alternative measured in the same run:
`python benchmarks/run.py [--quick] [--sections NAME ...] [--history FILE]` prints one Markdown table."""

import argparse
import os
import platform
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import history
from crowd import crowd_rows
from modes import mode_rows
from reduction import reduction_rows
from rows import environment_rows, scan_rows, worker_rows
from start import memory_rows, start_rows
from table import amount, markdown
from threadpoolctl import threadpool_limits
from timing import Plan, Row
from vectors import vector_rows

from gmr_gym.first_calls import compiled_at_once
from gmr_gym.version import __version__

SECTIONS: tuple[Callable[[Plan], Iterator[Row]], ...] = (
    reduction_rows, scan_rows, mode_rows, crowd_rows, environment_rows, vector_rows, worker_rows, start_rows,
    memory_rows,
)  # fmt: skip
NAMES = {section.__name__.removesuffix("_rows"): section for section in SECTIONS}
PACKAGES = "numpy", "numba", "stonesoup", "nrl-tracker", "filterpy"
SECONDS, QUICK = 5.0, 1.0  # of a row


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the package against named alternatives.")
    parser.add_argument("--quick", action="store_true", help="a second a row, and none that takes long")
    parser.add_argument("--sections", nargs="+", choices=NAMES, default=[*NAMES], help="these alone")
    parser.add_argument(
        "--history", type=Path, metavar="FILE", default=history.FILE, help="earlier runs, and this one"
    )
    parser.add_argument("--no-history", action="store_true", help="neither compare with earlier runs nor add")
    options = parser.parse_args()
    plan = Plan(QUICK if options.quick else SECONDS, not options.quick)
    before = _load()
    rows: list[Row] = []
    with threadpool_limits(1), compiled_at_once():  # no first call in plain Python is timed
        for name in options.sections:
            print(name, "...", file=sys.stderr)
            rows += NAMES[name](plan)
    measured_on, load = machine(), (before, _load())
    lines = {"gmr-gym": __version__, **measured_on, "load": f"{load[0]:.1f} before, {load[1]:.1f} after"}
    print("\n".join(f"- {name}: {value}" for name, value in lines.items()), "", table(rows), sep="\n")
    if not options.no_history:
        now = history.record(rows, __version__, measured_on, load)
        slower = history.regressions(now, history.read(options.history))
        history.append(options.history, now)
        print("", *(f"- slower: {line}" for line in slower or ["nothing, by earlier runs"]), sep="\n")


def table(rows: list[Row]) -> str:
    """A Markdown table; the ratio is how many times as much the alternative takes."""
    cells = [
        [
            row.what, amount(row.ours, row.unit), row.against, amount(row.theirs, row.unit),
            history.ratio(row._asdict()), row.note,
        ]
        for row in rows
    ]  # fmt: skip
    return markdown(["what", "ours", "against", "theirs", "ratio, 95 %", "note"], cells)


def machine() -> dict[str, str]:
    """What the times are taken on."""
    return {
        "processor": f"{_processor()}, {os.cpu_count()} cores",
        "Python": platform.python_version(),
        **{name: _version(name) for name in PACKAGES},
    }


def _load() -> float:
    """Processes that run or wait for a processor, the mean of a minute."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0


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


if __name__ == "__main__":
    main()
