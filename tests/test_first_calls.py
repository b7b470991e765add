"""First calls of kernels: in plain Python with the same bits, while another process compiles them."""

import multiprocessing
import os
import pickle
import subprocess
import sys
from importlib import import_module
from pkgutil import walk_packages

import gymnasium as gym
import numpy as np
import pytest
from numba import config
from numba.core.dispatcher import Dispatcher

import gmr_gym
from gmr_gym import first_calls, kernels
from gmr_gym.checks import sound
from gmr_gym.envs.registry import TRACKING
from gmr_gym.envs.tracking import blank
from gmr_gym.experiments import warming
from gmr_gym.first_calls import PlainFirst, PlainForm, compiled_at_once, for_few_calls, plain
from gmr_gym.mixture import match
from gmr_gym.simulation import scans
from gmr_gym.simulation.philox import buffer_for
from gmr_gym.simulation.single_target import draw, draw_truth, key_of, scene_of

pytestmark = pytest.mark.skipif(config.DISABLE_JIT, reason="nothing is compiled")
SEEDS = 8


def same(some, other):
    """Whether two results are equal to the last bit."""
    if isinstance(some, tuple):
        return len(some) == len(other) and all(map(same, some, other))
    return np.asarray(some).tobytes() == np.asarray(other).tobytes()


def agree(kernel, *args):
    """The result of the kernel, after a comparison with its plain form; arguments that it writes to too."""
    others = pickle.loads(pickle.dumps(args))
    with compiled_at_once(), np.errstate(all="raise"):
        result = kernel(*args)
        assert same(result, plain(kernel)(*others)) and same(args[0], others[0])
    return result


@pytest.mark.parametrize("env_id", TRACKING)
def test_the_plain_form_of_a_simulation_gives_the_same_bits(env_id):
    scenario = gym.make(env_id).unwrapped.scenario
    scene, follows = scene_of(scenario), scenario.window.follows
    for seed in range(SEEDS):
        z = np.array(scenario.sensor.measure(draw_truth(scenario, seed).x))
        agree(scans.measure_all, z, key_of(seed), scenario.sensor.R)
        episode = draw(scenario, seed)
        for t in (seed, scenario.horizon - 1):
            centre, target = np.zeros(z.shape[1]), episode.z[t].copy()
            estimate = scenario.model.prior.m[0] + 100.0 * seed
            if scene.window_motion is not None and follows:
                agree(scans.centre_into, centre, scene.window_motion, estimate)
            detections, mask, origin = blank((scene.capacity, len(target)))
            where = scene.field_of_view, episode.key, t, centre
            detections[:] = 0.0
            own = target, episode.detected[t], episode.slot[t]
            k, place = agree(scans.scan_into, detections, *where, *own)
            assert 0 <= k <= scene.capacity and -1 <= place < k
            agree(scans.label_into, detections, mask, origin, k, place)
            agree(scans.clutter_into, detections, *where, np.zeros((4, scene.capacity + 8), np.uint32))
            agree(scans.insert_into, detections, 5, 3, target)


@pytest.mark.parametrize("rate", [0.0, 0.3, 9.99, 10.0, 47.0, 3000.0])
@pytest.mark.parametrize("axes", [1, 2, 3])
def test_the_plain_form_of_clutter_gives_the_same_bits_at_any_rate(rate, axes):
    side = np.linspace(1.0, 1e5, axes)
    view = scans.View(rate, -side, 2.0 * side, True, None)
    for seed in range(SEEDS):
        z = np.zeros((int(rate + 9.0 * rate**0.5) + 9, axes))
        agree(scans.clutter_into, z, view, key_of(seed), seed, side / 3.0, buffer_for(len(z)))


@pytest.mark.parametrize("fault", ["none", "asymmetric", "nearly symmetric", "indefinite", "negative", "nan"])
@pytest.mark.parametrize("n, d", [(1, 1), (1, 4), (3, 2), (70, 6)])
def test_the_plain_forms_for_mixtures_give_the_same_bits(n, d, fault):
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        w, m, A = rng.random(n), 1e3 * rng.standard_normal((n, d)), rng.standard_normal((n, d, d))
        P = A @ A.transpose(0, 2, 1) + np.eye(d)
        P = (P + P.transpose(0, 2, 1)) / 2
        assert same(plain(match)(w, m, P, np.arange(n) % 3 - 1, 2), match(w, m, P, np.arange(n) % 3 - 1, 2))
        if fault.endswith("symmetric"):
            P[-1, 0, -1] *= 1.1 if fault == "asymmetric" else 1 + 1e-15
        P[-1] -= (fault == "indefinite") * 1e3 * np.eye(d)
        w[-1] -= (fault == "negative") * 2
        m[-1, 0] *= np.nan if fault == "nan" else 1
        assert bool(agree(sound, w, m, P)) == (
            fault in ("none", "nearly symmetric") or (d == 1 and "sym" in fault)
        )


def test_every_kernel_that_is_plain_first_is_compared_above():
    names = [each.name for each in walk_packages(gmr_gym.__path__, "gmr_gym.")]
    # have no kernels, and need what may not be installed
    optional = (
        "gmr_gym.data.", "gmr_gym.stonesoup", "gmr_gym.experiments.trials", "gmr_gym.experiments.tuned",
        "gmr_gym.envs.dacbench", "gmr_gym.learning.set_features",
    )  # fmt: skip
    modules = [import_module(name) for name in names if not name.startswith(optional)]
    kernels = {
        value for module in modules for value in vars(module).values() if isinstance(value, Dispatcher)
    }
    marked = {each.__name__ for each in kernels if isinstance(each._compile_for_args, PlainFirst)}
    compared = {"measure_all", "centre_into", "scan_into", "label_into", "clutter_into", "insert_into"}
    assert marked == compared | {"buffer_for"}  # which only makes room


SOURCE = """
from gmr_gym.kernels import kernel

@kernel
def plus(x):
    return x + 1

@kernel(plain_first=True)
def twice(x):
    return 2 * plus(x)
"""


@pytest.fixture
def twice(tmp_path, monkeypatch):
    """A kernel that no process has compiled yet, in a module of its own."""
    (tmp_path / "first_kernels.py").write_text(SOURCE)
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)  # for other processes
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(multiprocessing, "parent_process", lambda: None)
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    monkeypatch.setattr(PlainForm, "seconds", 1.0)
    monkeypatch.setattr(first_calls, "_compiler", first_calls.Compiler())
    kernels.warn_uncached.cache_clear()
    yield import_module("first_kernels").twice
    kernels.warn_uncached.cache_clear()
    sys.modules.pop("first_kernels")


@pytest.fixture
def started(monkeypatch):
    """The processes that have been started."""
    processes, popen = [], subprocess.Popen
    monkeypatch.setattr(
        subprocess, "Popen", lambda *a, **k: processes.append(popen(*a, **k)) or processes[-1]
    )
    return processes


def test_a_kernel_is_called_plainly_until_another_process_has_compiled_it(twice, started):
    assert [twice(x) for x in (2, 3, 4)] == [6, 8, 10] and not twice.overloads
    (process,) = started
    assert process.wait(timeout=120) == 0  # idle
    assert twice(2) == 6 and sum(twice.stats.cache_hits.values()) == 1 and not twice.stats.cache_misses
    assert len(started) == 1


def test_what_another_process_did_not_compile_is_compiled_when_it_has_ended(twice, started):
    assert twice(2) == 6 and not twice.overloads
    first_calls._stop(started[0])
    assert twice(2) == 6 and sum(twice.stats.cache_misses.values()) == 1
    assert twice(2.5) == 7.0 and len(twice.overloads) == 2  # and no other process is started
    assert len(started) == 1


@pytest.mark.parametrize(
    "why", ["a single core", "a worker", "no more processes", "no Python", "many numbers"]
)
def test_a_kernel_is_compiled_at_once_where_waiting_would_not_help(twice, monkeypatch, why):
    def none(*_, **__):
        raise OSError

    monkeypatch.setattr(*{
        "a single core": (os, "cpu_count", lambda: 1),
        "a worker": (multiprocessing, "parent_process", lambda: "another"),
        "no more processes": (subprocess, "Popen", none),
        "no Python": (sys, "executable", "/usr/bin/host"),
        "many numbers": (first_calls, "FEW", 0),
    }[why])  # fmt: skip
    assert twice(np.ones(2)).tolist() == [4.0, 4.0] and len(twice.overloads) == 1


def test_plain_calls_end_when_they_have_taken_as_long_as_the_compiler(twice, monkeypatch):
    monkeypatch.setattr(first_calls.Compiler, "request", lambda *_: True)
    monkeypatch.setattr(first_calls.Compiler, "is_running", lambda _: True)
    assert twice(2) == 6 and not twice.overloads
    monkeypatch.setattr(PlainForm, "seconds", 1e-9)
    assert twice(2) == 6 and twice.overloads


def test_the_first_calls_of_a_check_need_no_compiler(twice):
    few = for_few_calls(twice)
    assert few(2) == 6 and not twice.overloads
    with compiled_at_once():
        assert few(2) == 6 and twice.overloads
    assert for_few_calls(len) is len


SERVE = "import first_kernels\n{}\nfrom gmr_gym.first_calls import serve; serve(0)"


@pytest.mark.parametrize("disk, code", [("", 0), ("first_kernels.twice._cache.save_overload = print", 1)])
def test_a_process_that_cannot_save_what_it_compiles_fails(twice, tmp_path, disk, code):
    request = pickle.dumps(("first_kernels", "twice", "(i8,)")).hex()
    command = [sys.executable, "-c", SERVE.format(disk)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(map(str, sys.path))}
    with subprocess.Popen(command, env=environment, stdin=subprocess.PIPE, text=True) as process:
        process.stdin.write(f"{request}\n")
        process.stdin.flush()
        assert process.wait(timeout=120) == code
    assert bool(list((tmp_path / "__pycache__").glob("*twice*.nbc"))) == (code == 0)


def test_a_process_ends_when_the_one_that_started_it_was_killed(twice, started):
    assert twice(2) == 6
    started[0].stdin.close()
    assert started[0].wait(timeout=30) == 1


PROGRAM = """
from first_kernels import twice
from gmr_gym.first_calls import _compiler
print(twice(2), len(twice.overloads), _compiler._process.pid)
"""


@pytest.mark.skipif(os.name == "nt", reason="signal 0 would end a process there")
def test_no_process_is_left_when_a_program_ends(twice, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, sys.path)))
    command = [sys.executable, "-X", "dev", "-c", PROGRAM]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    *results, process = done.stdout.split()
    assert results == ["6", "0"] and done.stderr == ""
    with pytest.raises(ProcessLookupError):
        os.kill(int(process), 0)


def test_a_kernel_that_cannot_be_saved_is_compiled_at_once(twice, tmp_path, monkeypatch):
    monkeypatch.setattr(kernels, "KernelCache", lambda _: (_ for _ in ()).throw(RuntimeError))
    monkeypatch.delitem(sys.modules, "first_kernels")
    with pytest.warns(UserWarning, match="NUMBA_CACHE_DIR"):
        again = import_module("first_kernels").twice
    assert again(2) == 6 and len(again.overloads) == 1


def test_warming_leaves_nothing_to_another_process(monkeypatch):
    seconds = []

    def results(calls, jobs):
        for call in calls:
            seconds.append(PlainForm.seconds)
            yield call

    monkeypatch.setattr(warming, "results", results)
    warming.warm(["gmr_gym/TurningTarget-v0"], ["pda"], 1, lambda done, of: None)
    assert seconds == [0.0, 0.0] and PlainForm.seconds > 0.0
