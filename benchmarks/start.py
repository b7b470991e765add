"""The rows that need a process of their own: starting, compiling, memory."""

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory

from timing import Plan, Row, compared, timed

COMMAND = (sys.executable, "-c", "from gmr_gym.cli import main; main()")
IMPORT = (sys.executable, "-c", "import gmr_gym")
NEEDED = (sys.executable, "-c", "import gymnasium, numba, scipy.stats")
FIRST_SCANS = """
from time import process_time
from gmr_gym.evaluation.montecarlo import run_once
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.filters.registry import make_tracker

scenario = turning_target()
started = process_time()
tracker = make_tracker("runnalls-30", scenario.model)
run_once(scenario, tracker, 0, scans=10)
print(process_time() - started)
"""
# a process of its own in between: a child's peak starts from its parent's
PEAK = """
import os, subprocess, sys
child = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, usage = os.wait4(child.pid, 0)
print(usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def start_rows(plan: Plan) -> Iterator[Row]:
    listing, imported, needed = (
        timed(lambda command=command: _output(*command), clock=children)
        for command in ((*COMMAND, "list"), IMPORT, NEEDED)
    )
    what = "import gmr_gym, process included"
    yield compared(plan, what, imported, "import gymnasium, numba, scipy.stats", needed)
    yield compared(plan, "gmr-gym list", listing, "import gmr_gym", imported)
    if plan.everything:
        with TemporaryDirectory() as cache:
            _first_scans(cache)
            yield compared(
                plan, "first ten scans of an MHT, compiled before, read from disk",
                lambda: _first_scans(cache), "nothing compiled", _compiling,
            )  # fmt: skip


def memory_rows(plan: Plan) -> Iterator[Row]:
    with TemporaryDirectory() as out:
        table = "reproduce dortenzio --table 1 --jobs 1 --runs 20 --out".split()
        most, least = (lambda: peak(*COMMAND, *table, out)), (lambda: peak(*IMPORT))
        what = "peak memory, Table 1 of D'Ortenzio, 20 runs"
        yield compared(plan, what, most, "import gmr_gym", least, unit="MB")


def children() -> float:
    """Processor time of the processes that have ended, s."""
    return sum(getrusage(RUSAGE_CHILDREN)[:2])


def _compiling() -> float:
    with TemporaryDirectory() as cache:
        return _first_scans(cache)


def _first_scans(cache: str) -> float:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    return float(_output(sys.executable, "-c", FIRST_SCANS, env=environment))


def peak(*command: str) -> float:
    """Peak memory of a command, MB."""
    return float(_output(sys.executable, "-c", PEAK, *command)) / 1024  # ru_maxrss is in kB on Linux


def _output(*command: str, env: Mapping[str, str] | None = None) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True, env=env).stdout
