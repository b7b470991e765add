"""Workers of this machine and of a Dask cluster: the same bits, and nothing lost where one is killed."""

import importlib
import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from gmr_gym.baselines.gm_phd import gm_phd
from gmr_gym.baselines.mht import runnalls
from gmr_gym.baselines.nearest_neighbour import NearestNeighbour
from gmr_gym.cli import app
from gmr_gym.evaluation import clusters, montecarlo, source, workers
from gmr_gym.evaluation.montecarlo import BLOCK, Runs, run
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.workers import ATTEMPTS, ClusterLost, WorkersLost, check_workers
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.lv import unknown_clutter

WORLD = turning_target(horizon=8, clutter_rate=20)
NEAREST = {"nearest": NearestNeighbour(WORLD.model)}
RUNS = 4 * BLOCK + 3
HERE = os.getpid()


@dataclass(frozen=True)
class Dying(NearestNeighbour):
    """Kills its process at its first step, until the folder has as many graves as its file `deaths` says."""

    folder: Path = Path()
    home: int = HERE  # the process that it spares

    def step(self, belief, z):
        if os.getpid() != self.home and graves(self.folder) < int((self.folder / "deaths").read_text()):
            (self.folder / f"grave-{os.getpid()}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(belief, z)


def graves(folder):
    return len(list(folder.glob("grave-*")))


def dying(folder, deaths):
    (folder / "deaths").write_text(str(deaths))
    return {"nearest": Dying(WORLD.model, folder=folder)}


def assert_same(one, other, kind=Runs):
    assert list(one) == list(other)
    for name in one:
        for field in set(kind._fields) - {"seconds"}:
            np.testing.assert_array_equal(getattr(one[name], field), getattr(other[name], field), field)


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes; a killed one is started again."""
    if not find_spec("distributed"):
        pytest.skip("needs dask: pip install 'gmr-gym[dask]'")
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        yield cluster


def processes(cluster):
    from distributed import Client

    with Client(cluster, set_as_default=False) as client:
        client.wait_for_workers(2)
        return set(client.run(os.getpid).values())


def on_dask(cluster, *asked, **options):
    return run(*asked, backend="dask", scheduler=cluster.scheduler_address, **options)


def test_one_process_two_and_a_dask_cluster_give_the_same_to_the_last_bit(cluster):
    built = NEAREST | {"mht": runnalls(WORLD.model, 5)}
    one = run(WORLD, built, RUNS, seed=2)
    assert len(one["mht"].x) == RUNS
    assert_same(one, run(WORLD, built, RUNS, seed=2, jobs=2))
    assert_same(one, on_dask(cluster, WORLD, built, RUNS, seed=2))


def test_so_they_do_with_many_targets(cluster):
    world = unknown_clutter(horizon=6)
    built = {"phd": gm_phd(world.model)}
    one = run(world, built, BLOCK + 1, seed=3)
    assert_same(one, run(world, built, BLOCK + 1, seed=3, jobs=2), MultiTargetRuns)
    assert_same(one, on_dask(cluster, world, built, BLOCK + 1, seed=3), MultiTargetRuns)


def test_a_dask_worker_killed_on_the_way_loses_and_doubles_nothing(cluster, tmp_path):
    world = turning_target(horizon=60, clutter_rate=60)
    built = {"mht": runnalls(world.model, 10)}
    before, seen = processes(cluster), []

    def kill_one(done, total):
        seen.append((done, total))
        if len(seen) == 2:  # both are at work
            os.kill(min(before), signal.SIGKILL)

    found = on_dask(cluster, world, built, RUNS, folder=tmp_path, progress=kill_one)
    assert len(processes(cluster) & before) == 1
    assert_same(found, run(world, built, RUNS))
    done = np.array([at for at, _ in seen])
    assert sorted(np.diff(done)) == [3, *[BLOCK] * 4] and {total for _, total in seen} == {RUNS}
    # what is on disk is what was returned, the clock too
    again = run(world, built, RUNS, folder=tmp_path)
    np.testing.assert_array_equal(again["mht"].seconds, found["mht"].seconds)


def test_a_block_that_the_cluster_gives_up_is_made_again(cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)
    built = dying(tmp_path, 1)
    assert_same(on_dask(cluster, WORLD, built, BLOCK + 3), run(WORLD, NEAREST, BLOCK + 3))
    assert graves(tmp_path) == 1


def test_a_killed_process_of_this_machine_loses_and_doubles_nothing(tmp_path):
    deaths = ATTEMPTS - 1
    built, seen, blocks = dying(tmp_path, deaths), [], tmp_path / "blocks"
    found = run(WORLD, built, RUNS, jobs=2, folder=blocks, progress=lambda *at: seen.append(at[0]))
    assert graves(tmp_path) >= deaths
    assert_same(found, run(WORLD, NEAREST, RUNS))
    assert sorted(np.diff(seen)) == [3, *[BLOCK] * 4]
    assert len(list(blocks.iterdir())) == 5


def test_what_is_done_when_the_last_process_dies_is_kept_and_the_same_call_goes_on(tmp_path):
    blocks = tmp_path / "blocks"
    first = run(WORLD, dying(tmp_path, 0), 2 * BLOCK, folder=blocks)["nearest"]
    message = (
        rf"died {ATTEMPTS} times in a row \(.*terminated.*\); 2 of 4 blocks .* kept in {blocks}: .* there"
    )
    with pytest.raises(WorkersLost, match=message):
        run(WORLD, dying(tmp_path, 1000), 4 * BLOCK, jobs=2, folder=blocks)
    found = run(WORLD, dying(tmp_path, 0), 4 * BLOCK, folder=blocks)
    np.testing.assert_array_equal(found["nearest"].seconds[: 2 * BLOCK], first.seconds)
    assert_same(found, run(WORLD, NEAREST, 4 * BLOCK))


@pytest.fixture
def started(tmp_path):
    """Starts a part of a Dask cluster as a process of its own."""
    pytest.importorskip("distributed")
    processes = []

    def start(part, *words):
        command = [sys.executable, "-m", f"distributed.cli.dask_{part}", *words, "--no-dashboard"]
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
        processes.append(subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL))
        return processes[-1]

    yield start
    for process in processes:
        process.kill()
        process.wait()


def test_a_scheduler_that_dies_is_said_in_one_line_and_what_is_finished_is_kept(
    started, tmp_path, monkeypatch, capfd
):
    monkeypatch.setattr(workers, "SECONDS", 1.0)
    monkeypatch.setattr(clusters, "SECONDS", 0.5)
    file, blocks = tmp_path / "scheduler.json", tmp_path / "blocks"
    scheduler = started("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    while not file.exists() or not file.read_text():  # written a moment after it is made
        time.sleep(0.05)
    address = json.loads(file.read_text())["address"]
    on_it = partial(run, WORLD, NEAREST, RUNS, folder=blocks, backend="dask", scheduler=address)
    with pytest.raises(OSError, match=rf"the cluster at {address} has no worker after 0\.5 s"):
        on_it()
    started("worker", address, "--nthreads", "1", "--no-nanny")
    monkeypatch.setattr(clusters, "SECONDS", 30)
    killed = []

    def kill(done, total):
        if done:
            scheduler.kill()
            killed.append(time.monotonic())

    message = rf"^the cluster at {address} was lost; [1-4] of 5 blocks .* kept in {blocks}: .* from there$"
    with pytest.raises(ClusterLost, match=message) as lost:
        on_it(progress=kill)
    assert time.monotonic() - killed[0] < 10
    assert capfd.readouterr().err == ""
    assert f"; {len(list(blocks.iterdir()))} of 5 blocks" in str(lost.value)
    assert_same(run(WORLD, NEAREST, RUNS, folder=blocks), run(WORLD, NEAREST, RUNS))


def test_a_cluster_that_never_answered_is_not_called_lost():
    dask = pytest.importorskip("dask")
    with (
        dask.config.set({"distributed.comm.timeouts.connect": "500ms"}),
        pytest.raises(OSError, match=r"no cluster answers at tcp://127\.0\.0\.1:9: Timed out .* 0.5 s"),
    ):
        run(WORLD, NEAREST, 1, backend="dask", scheduler="tcp://127.0.0.1:9")


def test_an_error_of_the_tracker_is_raised_as_it_is_and_not_tried_again(tmp_path):
    with pytest.raises(FileNotFoundError, match="deaths"):
        run(WORLD, {"nearest": Dying(WORLD.model, folder=tmp_path)}, BLOCK + 1, jobs=2)


def test_a_worker_with_other_source_is_refused(monkeypatch, tmp_path):
    (tmp_path / "own_tracker.py").write_text("x = 1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    importlib.import_module("own_tracker")
    told = {"own_tracker": source.digest("own_tracker"), "gmr_gym": source.digest("gmr_gym")}
    source.check_sources(told | {"__main__": "another program", "not_imported": "sent by value"})
    with pytest.raises(ValueError, match=r"own_tracker on .* is not the source .* install the same version"):
        source.check_sources(told | {"own_tracker": "edited"})
    with pytest.raises(ValueError, match="gmr_gym on"):
        source.check_sources(told | {"gmr_gym": "0.0.1"})
    # what this process has imported counts, not what the file has become
    (tmp_path / "own_tracker.py").write_text("x = 2\n")
    source.check_sources(told)


def test_a_dask_worker_with_other_source_is_refused(cluster, monkeypatch):
    monkeypatch.setattr(source, "sources", lambda tracker: {"gmr_gym": "another version"})
    with pytest.raises(ValueError, match=r"gmr_gym on .* is not the source that this sweep was started with"):
        on_dask(cluster, WORLD, NEAREST, 1)


def test_workers_with_several_threads_are_refused():
    if not find_spec("distributed"):
        pytest.skip("needs dask: pip install 'gmr-gym[dask]'")
    from distributed import LocalCluster

    with (
        LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address=":0") as cluster,
        pytest.raises(ValueError, match=r"has 2 threads, .* --nthreads 1 --nworkers 2"),
    ):
        on_dask(cluster, WORLD, NEAREST, 1)


def test_two_threads_of_a_worker_that_joined_later_take_turns(monkeypatch):
    inside, most = [], []

    def block(i):
        inside.append(i)
        time.sleep(0.05)
        most.append(len(inside))
        inside.remove(i)
        return i

    monkeypatch.setattr(montecarlo, "run_block", block)
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(partial(montecarlo._block_alone, {}), range(4))) == [0, 1, 2, 3]
    assert most == [1] * 4


def test_what_is_on_disk_asks_for_no_cluster(tmp_path):
    if not find_spec("distributed"):
        pytest.skip("needs dask: pip install 'gmr-gym[dask]'")
    run(WORLD, NEAREST, 2, folder=tmp_path)
    run(WORLD, NEAREST, 2, folder=tmp_path, backend="dask", scheduler="tcp://nowhere:1")


@pytest.mark.parametrize(
    ("address", "message"),
    [("nowhere", "missing port number in address 'nowhere'"), ("http://here:1", "address scheme 'http'")],
)
def test_an_address_that_is_none_is_refused_before_anything_connects(monkeypatch, address, message):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(distributed, "Client", None)
    with pytest.raises(ValueError, match=message):
        run(WORLD, NEAREST, 1, backend="dask", scheduler=address)


@pytest.mark.parametrize(("jobs", "calls", "processes"), [(1, 5, 1), (2, 1, 2), (9, 5, 5), (9, 1, 2)])
def test_no_more_processes_are_started_than_there_are_calls_nor_one_that_is_this(
    monkeypatch, jobs, calls, processes
):
    started = []

    class Noting(workers.joblib.Parallel):
        def __init__(self, n_jobs, **options):
            started.append(n_jobs)
            super().__init__(n_jobs=1, **options)

    monkeypatch.setattr(workers.joblib, "Parallel", Noting)
    assert dict(workers.results({i: (abs, -i) for i in range(calls)}, jobs)) == {i: i for i in range(calls)}
    assert started == [processes]


def test_no_jobs_are_refused():
    with pytest.raises(ValueError, match="jobs must be a number of processes, or -1 for one per core, got 0"):
        run(WORLD, NEAREST, 1, jobs=0)


def test_a_backend_that_is_none_or_not_installed_or_not_there_is_named(monkeypatch):
    check_workers(1, "loky", None)
    with pytest.raises(ValueError, match="unknown backend 'threads'; choose one of loky, dask, ray"):
        run(WORLD, NEAREST, 1, backend="threads")
    with pytest.raises(ValueError, match="loky stays on this machine"):
        check_workers(1, "loky", "tcp://here:1")
    monkeypatch.setitem(workers.BACKENDS, "ray", "no_such_package")
    with pytest.raises(ImportError, match=r"'ray' is not installed; pip install 'gmr-gym\[ray\]'"):
        run(WORLD, NEAREST, 1, backend="ray", scheduler="auto")
    monkeypatch.setitem(workers.BACKENDS, "dask", "joblib")
    with pytest.raises(ValueError, match="backend 'dask' needs scheduler, the address"):
        check_workers(1, "dask", None)


def test_the_command_line_on_a_dask_cluster_leaves_what_it_leaves_on_one_process(
    cluster, tmp_path, monkeypatch
):
    monkeypatch.setattr("gmr_gym.evaluation.curves.RESAMPLES", 20)
    words = "evaluate", "gmr_gym/JumpMarkov-v0", "--tracker", "imm-pda", "--tracker", "mmg-3", "--runs", "21"
    here, there = tmp_path / "here", tmp_path / "there"
    app([*words, "--jobs", "1", "--out", str(here)], standalone_mode=False)
    on_cluster = "--backend", "dask", "--scheduler", cluster.scheduler_address
    app([*words, *on_cluster, "--out", str(there)], standalone_mode=False)
    assert (here / "runs.csv").read_bytes() == (there / "runs.csv").read_bytes()
    assert {file.name for file in (here / "blocks").iterdir()} == {
        file.name for file in (there / "blocks").iterdir()
    }
