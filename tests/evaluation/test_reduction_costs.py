"""Costs over many mixtures: those of one, kept, and left out where a reduction takes too long."""

from functools import partial

import numpy as np
import pytest

from gmr_gym.evaluation.mixture_problems import random_mixture
from gmr_gym.evaluation.reduction_costs import Costs, Reducing, costs, measured
from gmr_gym.evaluation.reductions import divergence
from gmr_gym.reduction import runnalls, west
from gmr_gym.reduction.distances import integral_squared_difference

MIXTURES = [random_mixture(i) for i in range(3)]
SAMPLES = 200
calls = []


def counted(p, components):
    calls.append(len(p.w))
    return runnalls(p, components)


def refusing(p, components):
    if p is MIXTURES[-1]:
        raise ValueError("too large")
    return runnalls(p, components)


def reducing(reduction, longest=10.0):
    return Reducing(partial(reduction, components=5), MIXTURES, SAMPLES, longest)


def test_costs_are_those_of_every_mixture_alone():
    found = costs(reducing(west))
    for i, p in enumerate(MIXTURES):
        q, _ = west(p, 5)
        assert found.components[i, 0] == 5 and found.seconds[i, 0] > 0
        assert found.ise[i, 0] == integral_squared_difference(p, q)
        assert found.divergence[i, 0] == divergence(p, q, SAMPLES)[0]
        assert found.reverse_divergence[i, 0] == divergence(q, p, SAMPLES)[0]


def test_costs_that_are_kept_are_not_measured_again(tmp_path):
    asked = {"counted": reducing(counted), "west": reducing(west)}
    said = []
    first = measured({"counted": asked["counted"]}, folder=tmp_path)
    done = len(calls)
    assert done > 0
    again = measured(asked, folder=tmp_path, progress=lambda *so_far: said.append(so_far))
    assert len(calls) == done and said == [(1, 2), (2, 2)]
    for field in Costs._fields:
        np.testing.assert_array_equal(getattr(first["counted"], field), getattr(again["counted"], field))
    assert [*again] == ["counted", "west"]


@pytest.mark.parametrize(
    ("asked", "known"),
    [(reducing(west, longest=0.0), True), (reducing(refusing), False)],
    ids=["slow", "refusing"],
)
def test_a_reduction_that_takes_too_long_or_refuses_a_mixture_is_left_out(asked, known):
    found = costs(asked)
    assert np.isnan(found.ise).all() and (found.components == 0).all()
    assert np.isfinite(found.seconds).all() == known
