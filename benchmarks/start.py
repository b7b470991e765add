"""The rows that need a process of their own: starting, compiling, memory."""

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from tempfile import TemporaryDirectory

from timing import Plan, Row, Timing, interleaved, summary, timed

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
    rounds = 1 if plan.quick else 5
    timings = interleaved(
        {
            "list": timed(lambda: _output(*COMMAND, "list")),
            "import": timed(lambda: _output(*IMPORT)),
            "needed": timed(lambda: _output(*NEEDED)),
        },
        1,
        rounds,
    )
    needed = "import gymnasium, numba, scipy.stats"
    yield Row("import gmr_gym, process included", timings["import"], needed, timings["needed"])
    yield Row("gmr-gym list", timings["list"], "import gmr_gym", timings["import"])
    compiling, compiled = [], []
    for _ in range(1 if plan.quick else 3):
        with TemporaryDirectory() as cache:
            compiling.append(_first_scans(cache))
            compiled.append(_first_scans(cache))
    what = "first ten scans of an MHT, nothing compiled, processor time"
    yield Row(what, summary([compiling]), "compiled before, read from disk", summary([compiled]))


def memory_rows(plan: Plan) -> Iterator[Row]:
    runs = 20 if plan.quick else 100
    with TemporaryDirectory() as out:
        table = f"reproduce dortenzio --table 1 --jobs 1 --runs {runs} --out".split()
        most = peak(*COMMAND, *table, out)
    what = f"peak memory, Table 1 of D'Ortenzio, {runs} runs"
    yield Row(what, most, "import gmr_gym", peak(*IMPORT), unit="MB")


def _first_scans(cache: str) -> float:
    environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
    return float(_output(sys.executable, "-c", FIRST_SCANS, env=environment))


def peak(*command: str) -> Timing:
    """Peak memory of a command, MB."""
    megabytes = float(_output(sys.executable, "-c", PEAK, *command)) / 1024  # ru_maxrss is in kB on Linux
    return Timing(megabytes, megabytes)


def _output(*command: str, env: Mapping[str, str] | None = None) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True, env=env).stdout
