"""The rows that need a process of their own: starting, compiling, memory."""

import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from tempfile import TemporaryDirectory

from timing import Row, Timing, interleaved, timed

COMMAND = (sys.executable, "-c", "from gmr_gym.cli import main; main()")
IMPORT = (sys.executable, "-c", "import gmr_gym")
NEEDED = (sys.executable, "-c", "import gymnasium, numba, scipy.stats")
FIRST_SCANS = """
from time import perf_counter
from gmr_gym.montecarlo import run_once
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.tracker import make_tracker

scenario = turning_target()
tracker = make_tracker("runnalls-5", scenario.model, prune_weight=0.0)
started = perf_counter()
run_once(scenario, tracker, 0, scans=10)
print(perf_counter() - started)
"""
# a process of its own in between: a child's peak starts from its parent's
PEAK = """
import os, subprocess, sys
child = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
_, status, usage = os.wait4(child.pid, 0)
print(usage.ru_maxrss if os.waitstatus_to_exitcode(status) == 0 else "failed")
"""


def start_rows(quick: bool) -> Iterator[Row]:
    rounds = 2 if quick else 7
    timings = interleaved(
        {
            "list": timed(lambda: _output(*COMMAND, "list")),
            "import": timed(lambda: _output(*IMPORT)),
            "needed": timed(lambda: _output(*NEEDED)),
        },
        rounds,
    )
    needed = "import gymnasium, numba, scipy.stats"
    yield Row("import gmr_gym, process included", timings["import"], needed, timings["needed"])
    yield Row("gmr-gym list", timings["list"], "import gmr_gym", timings["import"])
    with TemporaryDirectory() as kept:
        _first_scans(kept)
        timings = interleaved(
            {"compiling": _first_scans_compiled, "kept": lambda _: _first_scans(kept)}, 1 if quick else 3
        )
    what = "first 10 scans of a process, nothing compiled yet"
    yield Row(what, timings["compiling"], "compiled before, read from disk", timings["kept"])


def memory_rows(quick: bool) -> Iterator[Row]:
    runs = 20 if quick else 100
    with TemporaryDirectory() as out:
        reproduce = ("reproduce", "dortenzio", "--table", "1", "--jobs", "1", "--out", out, "--runs", str(runs))
        peak = _peak(*COMMAND, *reproduce)
    imported = _peak(*IMPORT)
    yield Row(f"peak memory, one of the paper's tables, {runs} runs", peak, "import gmr_gym", imported, unit="MB")


def _first_scans_compiled(_: int) -> float:
    with TemporaryDirectory() as empty:
        return _first_scans(empty)


def _first_scans(folder: str) -> float:
    return float(_output(sys.executable, "-c", FIRST_SCANS, env={**os.environ, "NUMBA_CACHE_DIR": folder}))


def _peak(*command: str) -> Timing:
    megabytes = float(_output(sys.executable, "-c", PEAK, *command)) / 1024  # ru_maxrss is in kB on Linux
    return Timing(megabytes, megabytes)


def _output(*command: str, env: Mapping[str, str] | None = None) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True, env=env).stdout
