"""The rows that need a process of their own: starting, compiling, memory."""

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory

from timing import Plan, Row, compared, timed

COMMAND = (sys.executable, "-c", "from gmr_gym.cli import main; main()")
WARM = ("warm", "--env", "gmr_gym/TurningTarget-v0", "--tracker", "runnalls-30")
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
FIRST_OBSERVATION = """
from time import process_time
started = process_time()
import gymnasium, gmr_gym
gymnasium.make("gmr_gym/TurningTarget-v0").reset(seed=0)
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
            _output(*COMMAND, *WARM, env=_keeping(cache))
            for what, program in (("observation", FIRST_OBSERVATION), ("ten scans of an MHT", FIRST_SCANS)):
                yield compared(
                    plan, f"first {what}, compiled before, read from disk",
                    partial(_spent, program, cache), "nothing compiled", partial(_compiling, program),
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


def _compiling(program: str) -> float:
    with TemporaryDirectory() as cache:
        return _spent(program, cache)


def _spent(program: str, cache: str) -> float:
    """Processor time that the program says it took, s, with compiled code in the folder."""
    return float(_output(sys.executable, "-c", program, env=_keeping(cache)))


def _keeping(cache: str) -> dict[str, str]:
    return {**os.environ, "NUMBA_CACHE_DIR": cache}


def peak(*command: str) -> float:
    """Peak memory of a command, MB."""
    return float(_output(sys.executable, "-c", PEAK, *command)) / 1024  # ru_maxrss is in kB on Linux


def _output(*command: str, env: Mapping[str, str] | None = None) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True, env=env).stdout
