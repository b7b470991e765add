"""Compiled kernels are kept where that can be, and work where it cannot."""

import errno
import gc
import multiprocessing
import os
import pickle
import subprocess
import sys
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from filelock import FileLock
from numba import config
from numba.core.caching import IndexDataCacheFile
from numba.core.errors import TypingError

from gmr_gym import kernels

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
ROOT = Path(__file__).parents[1]
SOURCE = """
from gmr_gym.kernels import kernel

@kernel
def plus(x):
    return x + 1

@kernel(nogil=True)
def twice(x):
    return 2 * plus(x)

def repeated(step):
    @kernel
    def loop(x):
        for _ in range(3):
            x = step(x)
        return x

    return loop
"""
STEPS = """
from gmr_gym.kernels import kernel

@kernel(inline="always")
def up(x):
    return x + 1

@kernel
def down(x):
    return x - 1
"""
PROGRAM = """
import sys
from joblib import Parallel, delayed
from some_kernels import plus, twice
print(twice(2), Parallel(2)(delayed(plus)(i) for i in range(4)))
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """With the source of two kernels, kept beside it."""
    (tmp_path / "some_kernels.py").write_text(SOURCE)
    monkeypatch.setattr(config, "CACHE_DIR", "")
    kernels.warn_uncached.cache_clear()
    yield tmp_path
    kernels.warn_uncached.cache_clear()


def imported(folder, name="some_kernels"):
    """The module as a new process has it."""
    spec = spec_from_file_location(name, folder / f"{name}.py")
    spec.loader.exec_module(module := module_from_spec(spec))
    return module


def kept(folder, ending):
    return sorted((folder / "__pycache__").glob(f"*.{ending}"))


def nowhere(folder):
    """The environment in which no folder can be written to, whoever asks: each is below a file."""
    (folder / "__pycache__").write_text("")
    below = str(folder / "some_kernels.py" / "below")
    return {"NUMBA_CACHE_DIR": below, "XDG_CACHE_HOME": below, "HOME": below, "LOCALAPPDATA": below}


def test_a_second_start_finds_what_the_first_one_compiled(folder):
    with warnings.catch_warnings(action="error"):
        assert imported(folder).twice(2) == 6
        again = imported(folder)
        assert again.twice(2) == 6
    assert sum(again.twice.stats.cache_hits.values()) == 1 and not again.twice.stats.cache_misses
    flags = {name: value for name, value in again.twice.targetoptions.items() if value is not None}
    ours = {"error_model": "numpy", "no_cfunc_wrapper": True}
    assert flags == {"nopython": True, "nogil": True, **ours}


def test_a_loop_of_another_kernel_is_found_again_until_the_file_of_that_kernel_changes(folder):
    def started(step):
        """The loop in a new process: its result, and how often it was found."""
        loop = imported(folder).repeated(getattr(imported(folder, "steps"), step))
        return loop(2), sum(loop.stats.cache_hits.values())

    (folder / "steps.py").write_text(STEPS)
    assert [started(step) for step in ("up", "down", "up", "down")] == [(5, 0), (-1, 0), (5, 1), (-1, 1)]
    (folder / "steps.py").write_text(STEPS.replace("x + 1", "x + 10"))
    assert [started(step) for step in ("up", "up", "down")] == [(32, 0), (32, 1), (-1, 0)]


def test_without_a_folder_to_write_to_kernels_work_and_one_line_says_what_to_set(folder):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(folder))), **nowhere(folder)}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == "6 [1, 2, 3, 4]\n"
    (line,) = done.stderr.splitlines()
    assert (
        "UserWarning: compiled kernels cannot be kept" in line and "set NUMBA_CACHE_DIR to a folder" in line
    )


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["emptied", "cut", "overwritten", "another thing"])
def test_what_is_damaged_is_compiled_again_and_kept_anew(folder, ending, damage):
    imported(folder).twice(2)
    for file in kept(folder, ending):
        whole = file.read_bytes()
        file.write_bytes({
            "emptied": b"", "cut": whole[:-20], "overwritten": bytes(len(whole)),
            "another thing": pickle.dumps([1, 2]),
        }[damage])  # fmt: skip
    with warnings.catch_warnings(action="error"):
        mended, again = imported(folder), None
        assert mended.twice(2) == 6
        again = imported(folder)
        assert again.twice(2) == 6
    assert not mended.twice.stats.cache_hits and sum(again.twice.stats.cache_hits.values()) == 1


@pytest.mark.parametrize("method", ["_save_index", "_save_data"])
def test_a_full_disk_costs_the_cache_and_not_the_result(folder, monkeypatch, method):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch, pytest.warns(UserWarning, match="NUMBA_CACHE_DIR") as said:
        patch.setattr(IndexDataCacheFile, method, full)
        assert imported(folder).twice(2) == 6
    assert len(said) == 1 and kept(folder, "nbc") == []
    assert imported(folder).twice(2) == 6 and len(kept(folder, "nbc")) == 2  # with room again


WITH_ANOTHER = """
import sys
from some_kernels import twice
print("ready", flush=True)
sys.stdin.readline()
print(twice(2), *twice._cache_misses.values())
"""


def test_of_two_processes_that_start_at_once_one_compiles_and_the_other_waits(folder):
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(ROOT), str(folder)))}
    environment.pop("NUMBA_CACHE_DIR", None)
    command, pipe = [sys.executable, "-c", WITH_ANOTHER], subprocess.PIPE
    both = [subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, text=True) for _ in range(2)]
    assert [process.stdout.readline() for process in both] == ["ready\n"] * 2
    for process in both:
        process.stdin.write("go\n")
        process.stdin.flush()
    said = sorted(process.communicate(timeout=120)[0].split() for process in both)
    assert said == [["6"], ["6", "1"]]


def test_code_that_another_process_saves_meanwhile_is_taken(folder, monkeypatch):
    waiting, other = imported(folder), imported(folder)
    claim, claimed = kernels.KernelCache._claim, []

    def late(cache):  # the other has saved its code when this one holds the lock
        if cache is waiting.plus._cache:
            claimed.append(other.plus(1))
        return claim(cache)

    monkeypatch.setattr(kernels.KernelCache, "_claim", late)
    assert waiting.plus(1) == 2 and claimed == [2]
    assert sum(waiting.plus.stats.cache_hits.values()) == 1 and not waiting.plus.stats.cache_misses


def test_a_kernel_that_cannot_be_compiled_is_not_waited_for(folder):
    plus = imported(folder).plus
    with pytest.raises(TypingError):
        plus("text")
    assert not plus._cache._lock.is_locked and gc.isenabled()


def test_without_locks_every_process_compiles(folder, monkeypatch):
    monkeypatch.setattr(kernels, "FileLock", lambda *_, **__: (_ for _ in ()).throw(NotImplementedError))
    assert imported(folder).twice(2) == 6
    assert sum(imported(folder).twice.stats.cache_hits.values()) == 0


def test_who_has_waited_in_vain_does_not_wait_for_the_next_kernel(folder, monkeypatch):
    monkeypatch.setattr(kernels.KernelCache, "patience", 0.2)
    module, claim, waited = imported(folder), kernels.KernelCache._claim, []

    def watched(cache):
        waited.append(cache.patience)
        return claim(cache)

    monkeypatch.setattr(kernels.KernelCache, "_claim", watched)
    files = [compiled._cache._cache_file._index_path for compiled in (module.twice, module.plus)]
    held = [FileLock(f"{file}.lock") for file in files]
    with ThreadPoolExecutor(1) as hanging:  # locks of another thread are as those of another process
        for lock in held:
            hanging.submit(lock.acquire).result()
        assert module.twice(2) == 6
        for lock in held:
            hanging.submit(lock.release).result()
    assert waited == [0.2, 0.0]


def test_a_kernel_is_compiled_ahead_in_another_process(folder, monkeypatch, tmp_path_factory):
    monkeypatch.setattr(sys, "path", [str(folder), *sys.path, Path("no text")])
    monkeypatch.chdir(elsewhere := tmp_path_factory.mktemp("elsewhere"))
    (elsewhere / "numba.py").write_text("raise SystemExit(1)")  # of the current folder, and not in the path
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: None)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    started, popen = [], subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *a, **k: started.append(popen(*a, **k)) or started[-1])
    plus = imported(folder).plus
    kernels.compile_ahead(plus, "(i8,)")
    assert started[0].wait(timeout=120) == 0 and len(kept(folder, "nbc")) == 1
    assert plus(1) == 2 and sum(plus.stats.cache_hits.values()) == 1
    kernels.compile_ahead(plus, "(i8,)")  # nothing is left to do
    assert len(started) == 1


@pytest.mark.parametrize("executable", ["", "/usr/bin/host", None])
def test_no_program_is_started_in_the_place_of_python(folder, monkeypatch, executable):
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: None)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(sys, "executable", executable)
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: pytest.fail("started"))
    kernels.compile_ahead(imported(folder).plus, "(i8,)")


def test_an_mht_and_an_environment_need_no_compiler():
    code = (
        "import gymnasium; from gmr_gym import make_tracker; "
        "env = gymnasium.make('gmr_gym/TurningTarget-v0'); env.reset(seed=0); "
        "print(make_tracker('runnalls-5', env.unwrapped.scenario.model).reduce.components)"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout == "5\n", done.stderr


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [1, 2, 40])
def test_every_share_is_done_once_on_any_number_of_threads(threads, count):
    done = []
    kernels.together(lambda i, j: done.append((i, j)), [(i, -i) for i in range(count)], threads)
    assert sorted(done) == [(i, -i) for i in range(count)]


def test_a_thread_that_has_not_begun_when_all_is_done_is_not_waited_for():
    busy, done = threading.Event(), []
    elsewhere = kernels._pool(os.getpid(), 1).submit(busy.wait, 60)
    kernels.together(lambda i: done.append(threading.current_thread()), [(i,) for i in range(9)], 2)
    assert done == 9 * [threading.current_thread()] and not elsewhere.done()
    busy.set()
    assert elsewhere.result()


def test_what_another_thread_raises_is_raised():
    caller, both = threading.current_thread(), threading.Barrier(2, timeout=60)

    def call(i):
        both.wait()
        if threading.current_thread() is not caller:
            raise ArithmeticError("of the other")

    with pytest.raises(ArithmeticError, match="of the other"):
        kernels.together(call, [(0,), (1,)], 2)
