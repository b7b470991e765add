"""A slice of the fuzzing of every public door, and that what fuzzes can find what it is there to find."""

import inspect
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gmr_gym.envs.registry import ENVIRONMENTS, MULTI_TARGET, RECORDED
from gmr_gym.evaluation import metrics
from gmr_gym.filters.registry import MULTI_TARGET_GROUP, trackers
from gmr_gym.models import radar
from gmr_gym.reduction import distances
from gmr_gym.reduction import runnalls as reduction
from gmr_gym.reduction.registry import REDUCERS

ROOT = Path(__file__).parents[2]
FUZZ = ROOT / "benchmarks" / "fuzz.py"
SLICE = (
    "reduction/", "mixture/", "metric/", "distance/", "radar/", "file/", "environment/", "vector/",
    "tracker/pda", "tracker/runnalls", "tracker/imm-pda", "tracker/gm-phd", "tracker/pmb",
)  # fmt: skip


OF_NO_MIXTURE = {  # checks, parts of reductions, and what is not one
    "greedy", "check_count", "at_least_zero", "check_reduced", "total_merge_cost", "whitened", "weighing",
    "at_unit", "entering", "through", "grouped",
}  # fmt: skip


def fuzz(*arguments):
    there = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    command = [sys.executable, str(FUZZ), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=there, cwd=ROOT)


@pytest.fixture(scope="module")
def targets():
    sys.path.insert(0, str(ROOT / "benchmarks"))
    from fuzzing.registry import every_target

    yield {target.name: target for target in every_target()}
    sys.path.remove(str(ROOT / "benchmarks"))


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    names = ("loses_weight", "gives_nan", "forgets_the_spread", "hangs", "dies")
    file = tmp_path_factory.mktemp("fuzz") / "found.json"
    reductions = [f"--reduction=broken_reductions:{name}" for name in names]
    done = fuzz(*reductions, "--calls", 300, "--seconds", 2, "--out", file)
    assert done.returncode == 1, done.stdout + done.stderr
    found = {name: {} for name in names}
    for finding in json.loads(file.read_text())["findings"]:
        if finding["legal"]:
            found[finding["target"].rpartition(":")[2]][finding["outcome"]] = finding
    return found


def test_hostile_input_is_answered_or_refused_at_every_door():
    only = [f"--target={name}" for name in SLICE]
    done = fuzz(*only, "--calls", 4000, "--seed", 1, "--seconds", 30)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("name", "outcome", "said"),
    [
        ("loses_weight", "moments", "weight of component"),
        ("gives_nan", "not finite", "m is not finite"),
        ("forgets_the_spread", "moments", "covariance of component"),
        ("hangs", "hang", "no result after"),
        ("dies", "crash", "SIGSEGV"),
    ],
)
def test_a_broken_reduction_is_found(broken, name, outcome, said):
    assert said in broken[name][outcome]["message"]


def test_a_finding_names_the_command_that_shows_it_again(broken):
    finding = broken["gives_nan"]["not finite"]
    done = fuzz(*finding["reproduce"].split()[2:])
    assert done.returncode == 1
    assert "legal" in done.stdout and "Mixture(w=" in done.stdout
    assert "m is not finite" in done.stdout


def test_a_case_is_the_same_whenever_it_is_drawn(targets):
    from fuzzing.cases import drawn

    for name in ("reduction/runnalls", "metric/ospa", "tracker/pda", "radar/raw"):
        for case in range(20):
            assert repr(drawn(targets[name], 3, case)) == repr(drawn(targets[name], 3, case))
        assert repr(drawn(targets[name], 3, 0)) != repr(drawn(targets[name], 4, 0))


def test_every_door_there_is_has_a_target(targets):
    assert {f"reduction/{name}" for name in REDUCERS} <= set(targets)
    for group in ("gmr_gym.trackers", MULTI_TARGET_GROUP):
        assert {f"tracker/{name}" for name in trackers(group)} <= set(targets)
    ids = {name.removeprefix("gmr_gym/") for name in ENVIRONMENTS}
    assert {f"environment/{name}" for name in ids} <= set(targets)
    of_many = {name.removeprefix("gmr_gym/") for name in MULTI_TARGET | RECORDED}
    assert {f"vector/{name}" for name in ids - of_many} <= set(targets)


@pytest.mark.parametrize(
    ("module", "prefix", "elsewhere"),
    [
        (reduction, "reduction", OF_NO_MIXTURE),
        (metrics, "metric", {"truth_outside_gates", "detection_outside_gates", "cardinality_error"}),
        (distances, "distance", {"pack", "unpack", "products"}),
        (radar, "radar", {"radar", "spherical", "cartesian", "check_deviations", "check_detections"}),
    ],
)
def test_every_public_function_has_a_target(targets, module, prefix, elsewhere):
    public = {
        name
        for name, value in vars(module).items()
        if inspect.isfunction(value) and value.__module__ == module.__name__ and not name.startswith("_")
    }
    covered = {name.replace("-", "_").removeprefix(f"{prefix}/") for name in targets}
    assert public - elsewhere <= covered


def test_moments_are_judged_to_rounding():
    sys.path.insert(0, str(ROOT / "benchmarks"))
    from fuzzing.cases import Finding
    from fuzzing.checks import groups_match

    from gmr_gym.mixture import Mixture

    p = Mixture(np.array([0.5, 0.5]), np.array([[-1.0], [1.0]]), np.ones((2, 1, 1)))
    q = Mixture(np.array([1.0]), np.array([[0.0]]), np.array([[[2.0]]]))
    groups_match(p, q, np.zeros(2, int))
    for wrong in (q._replace(w=q.w + 1e-12), q._replace(m=q.m + 1e-12), q._replace(P=q.P + 1e-11)):
        with pytest.raises(Finding):
            groups_match(p, wrong, np.zeros(2, int))
