"""Runs of reductions: a run is a mixture, the same for every reduction, and is kept as other runs are."""

from functools import partial

import numpy as np
import pytest

from gmr_gym.evaluation.blocks import load
from gmr_gym.evaluation.mixture_problems import MixtureProblem, crouse, random_mixture
from gmr_gym.evaluation.montecarlo import run, run_shard
from gmr_gym.evaluation.reduction_runs import ReductionRuns
from gmr_gym.evaluation.reductions import cost, divergence
from gmr_gym.evaluation.source import sources
from gmr_gym.reduction import capping, reducer

DRAWN = MixtureProblem(samples=100)
REDUCTIONS = {"runnalls": reducer("runnalls", 5), "capping": reducer("capping", 5)}


def test_a_run_has_the_figures_of_its_mixture():
    results = run(DRAWN, REDUCTIONS, runs=3, seed=2)
    for i, name in ((0, "runnalls"), (2, "capping")):
        p = random_mixture(np.random.SeedSequence(2, spawn_key=(i,)))
        q, _ = REDUCTIONS[name](p)
        found, wanted = results[name], cost(p, REDUCTIONS[name])
        assert [found.ise[i, 0], found.nise[i, 0]] == [wanted.ise, wanted.nise]
        assert found.divergence[i, 0] == divergence(p, q, 100)[0]
        assert found.reverse_divergence[i, 0] == divergence(q, p, 100)[0]
        assert found.components[i, 0] == 5 and found.seconds[i, 0] > 0


def test_a_given_mixture_is_that_of_every_run():
    runs = run(MixtureProblem(crouse()), {"west": reducer("west", 4)}, runs=2)["west"]
    assert runs.ise[0] == runs.ise[1] == cost(crouse(), reducer("west", 4)).ise


def test_runs_are_kept_and_found_again_whatever_else_is_asked(tmp_path):
    first = run(DRAWN, REDUCTIONS, runs=21, folder=tmp_path)
    files = sorted(tmp_path.iterdir())
    assert len(files) == 4 and isinstance(load(files[0], ReductionRuns), ReductionRuns)
    again = run(DRAWN, REDUCTIONS | {"fewer": reducer("runnalls", 3)}, runs=21, folder=tmp_path)
    assert len([*tmp_path.iterdir()]) == 6
    for one, other in zip(first["runnalls"], again["runnalls"], strict=True):
        np.testing.assert_array_equal(one, other)  # the times, too
    assert run_shard(DRAWN, REDUCTIONS, 21, shard=(1, 2), folder=tmp_path) == (4, 4)


def mine(p, components):
    return capping(p, components)


def test_runs_depend_on_the_module_of_the_reduction():
    assert {*sources(partial(mine, components=2))} == {"gmr_gym", __name__}
    assert {*sources(REDUCTIONS["runnalls"])} == {"gmr_gym", "gmr_gym.reduction.runnalls"}


def test_what_is_no_reduction_is_refused():
    with pytest.raises(ValueError, match="a reduction must return a Mixture and the origin"):
        run(DRAWN, {"none": lambda p: p}, runs=1)
