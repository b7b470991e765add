"""Reductions by name, with parameters of their own, as every tracker takes them."""

import numpy as np
import pytest

from gmr_gym.evaluation.mixture_problems import crouse
from gmr_gym.filters.registry import make_tracker
from gmr_gym.reduction.registry import reducer, reduction_named
from gmr_gym.reduction.runnalls import Greedy, greedy
from gmr_gym.reduction.salmond_west import salmond
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.scenarios.zhang import jump_markov

TURNING, JUMPING, MANY = turning_target().model, jump_markov().model, unknown_clutter(told="true").model
TRACKERS = [
    ("mht", TURNING),
    *(
        (name, JUMPING)
        for name in ("mmg", "imm-mht", "mmae-mht", "imm-of-mhts", "mmae-of-mhts", "one-motion")
    ),
    *((name, MANY) for name in ("gm-phd", "gm-cphd", "learning-phd", "fitted-phd")),
]


@pytest.mark.parametrize("spec", ["salmond:distance=0.2", "salmond:distance=0.2:", "salmond,distance=0.2"])
def test_parameters_follow_the_name(spec):
    wanted, origin = salmond(crouse(), 9, distance=0.2)
    assert len(wanted.w) < len(salmond(crouse(), 9)[0].w)
    for reduce in (reducer(spec, 9), reducer("salmond", 9, distance=0.2), reduction_named(spec, 9, 4.0)):
        q, where = reduce(crouse())
        np.testing.assert_array_equal(q.m, wanted.m)
        np.testing.assert_array_equal(where, origin)


def test_parameters_follow_a_function_of_ones_own():
    q, _ = reducer("gmr_gym.reduction.salmond_west:salmond:distance=0.2", 9)(crouse())
    np.testing.assert_array_equal(q.m, salmond(crouse(), 9, distance=0.2)[0].m)


@pytest.mark.parametrize(("name", "model"), TRACKERS)
@pytest.mark.parametrize(
    ("reduction", "message"),
    [
        ("salmond:distance=-1", "distance must be a number, at least 0, got -1"),
        ("adaptive:loss_bound=much", "loss_bound must lie in .0, 1., got 'much'"),
        ("salmond:reach=1", "reduction 'salmond' takes no parameter 'reach'; it takes distance"),
        ("salmond:distance", "expected key=value after the reduction 'salmond', got 'distance'"),
        ("salmond:distance=1:distance=2", "distance is given twice, as 1 and as 2"),
        ("salmnd:distance=1", "unknown reduction 'salmnd'; did you mean 'salmond'"),
        ("salmond:components=3", "reduction 'salmond' takes no parameter 'components'"),
    ],
)
def test_every_tracker_says_in_a_line_what_is_wrong_with_its_reduction(name, model, reduction, message):
    with pytest.raises(ValueError, match=message) as raised:
        make_tracker(name, model, reduction=reduction)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(("name", "model"), TRACKERS)
def test_every_tracker_takes_a_reduction_with_parameters(name, model):
    assert make_tracker(name, model, components=3, reduction="salmond:distance=0.1")


def test_a_parameter_that_is_given_in_the_name_and_beside_it_is_refused():
    with pytest.raises(ValueError, match="distance is given twice, once in the name of the reduction"):
        reducer("salmond:distance=1", 3, distance=2)


@pytest.mark.parametrize("name", [None, 3, [1], salmond])
def test_a_reduction_is_named_by_a_text(name):
    with pytest.raises(ValueError, match="the reduction must be named by a text, got "):
        reducer(name, 3)


def test_the_mht_by_name_scans_in_compiled_code_where_its_reduction_can():
    assert make_tracker("mht-5", TURNING).reduce == Greedy(5)
    assert make_tracker("mht-5", TURNING, reduction="adaptive:loss_bound=0.2").reduce == greedy(5, 0.2)
    with pytest.raises(ValueError, match="components must be at least 1, got 0"):
        make_tracker("mht", TURNING, components=0)
    west = make_tracker("mht-5", TURNING, reduction="west").reduce
    np.testing.assert_array_equal(west(crouse())[0].m, reducer("west", 5)(crouse())[0].m)
