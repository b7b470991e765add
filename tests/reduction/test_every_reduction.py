"""Every reduction by the same rules: what it keeps and follows is what its row of `PROPERTIES` says, no less
and no more, and whatever numbers a mixture has, what comes out is a mixture."""

import warnings
from inspect import signature

import numpy as np
import pytest

from gmr_gym.evaluation.mixture_problems import random_mixture
from gmr_gym.mixture import Mixture, checked, mean_and_covariance, mixture, take
from gmr_gym.reduction import oracles
from gmr_gym.reduction.distances import normalised_integral_squared_difference
from gmr_gym.reduction.properties import AFFINE, MOMENTS, PROPERTIES
from gmr_gym.reduction.registry import REDUCERS, reducer

DESCENDS = {"refine", "gmrc"}  # to where a gradient is small, by steps that a map may change
each = pytest.mark.parametrize("name", REDUCERS)
P = random_mixture(3, components=9, dimension=2)
TURN = np.array([[0.6, -0.8], [0.8, 0.6]])
STRETCH = np.array([[9.0, 0.0], [1.0, 0.1]])


def reduced(name, p, components):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of iterations at their limit
        q, origin = reducer(name, components)(p)
    checked(q)
    assert origin.shape == p.w.shape and -1 <= origin.min() and origin.max() < len(q.w) <= components
    return q, origin


def mapped(p, A, b):
    P = A @ p.P @ A.T
    return Mixture(p.w, p.m @ A.T + b, (P + P.transpose(0, 2, 1)) / 2)


def apart(name, A, b):
    """How far the reduction of what a map makes of P is from what it makes of the reduction, in [0, 1]."""
    first, _ = reduced(name, mapped(P, A, b), 4)
    then = mapped(reduced(name, P, 4)[0], A, b)
    return normalised_integral_squared_difference(first, then)


def rounding(name):
    return 1e-6 if name in DESCENDS else 1e-12


def test_every_reduction_has_its_row():
    assert PROPERTIES.keys() == REDUCERS.keys()
    limits = {name: row.most for name, row in PROPERTIES.items() if row.most}
    assert limits == {"brute-force": oracles.PARTITIONED, "transportation-optimum": oracles.PROGRAMMED}


@each
def test_a_reduction_keeps_what_its_row_says_and_no_more(name):
    q, _ = reduced(name, P, 4)
    before, after = ((p.w.sum(), *mean_and_covariance(p)) for p in (P, q))
    errors = [np.abs(a - b).max() for a, b in zip(before, after, strict=True)]
    assert [moment for moment, error in zip(MOMENTS, errors, strict=True) if error < 1e-12] == [
        *PROPERTIES[name].keeps
    ]


@each
def test_a_reduction_follows_the_maps_of_its_row_and_no_others(name):
    assert apart(name, TURN, np.array([3.0, -5.0])) < rounding(name)
    stretched = apart(name, STRETCH, np.array([3.0, -5.0]))
    assert (stretched < rounding(name)) == (PROPERTIES[name].follows == AFFINE), stretched


@each
def test_the_order_of_the_components_and_the_unit_of_the_weights_do_not_count(name):
    q, origin = reduced(name, P, 4)
    order = np.random.default_rng(0).permutation(9)
    other, where = reduced(name, take(P, order), 4)
    assert normalised_integral_squared_difference(q, other) < rounding(name)
    groups = {frozenset(np.flatnonzero(origin == j)) for j in range(-1, len(q.w))}
    assert {frozenset(order[where == j]) for j in range(-1, len(other.w))} == groups
    thrice, _ = reduced(name, P._replace(w=3 * P.w), 4)
    assert normalised_integral_squared_difference(thrice._replace(w=thrice.w / 3), q) < rounding(name)


@each
def test_few_enough_components_stay_as_they_are_and_one_has_all_the_weight(name):
    if not PROPERTIES[name].bounded:
        for components in (9, 12):
            q, _ = reduced(name, P, components)
            assert normalised_integral_squared_difference(q, P) < rounding(name) and len(q.w) == 9
    one, _ = reduced(name, P, 1)
    assert len(one.w) == 1
    if "weight" in PROPERTIES[name].keeps:
        assert one.w[0] == pytest.approx(P.w.sum(), rel=1e-12)


@each
def test_a_component_and_its_double_are_merged_first_and_at_no_cost(name):
    if "weight" not in PROPERTIES[name].keeps:
        pytest.skip("it drops components, and what is left is another mixture")
    four = mixture([0.1, 0.2, 0.3, 0.4], 9.0 * np.arange(8.0).reshape(4, 2) ** 1.5, [np.diag([1.0, 2.0])] * 4)
    doubled = take(four, np.array([0, 0, 1, 2, 3]))
    doubled.w[:2] /= 2
    # by its own rule it would merge further
    q, origin = reduced("adaptive-2023:ratio=0" if name == "adaptive-2023" else name, doubled, 4)
    assert normalised_integral_squared_difference(q, four) < rounding(name)
    assert origin[0] == origin[1] and len({*origin}) == 4


EXTREMES = {
    "tiny weights": P._replace(w=P.w * 10.0 ** -np.linspace(0, 300, 9)),
    "thin and wide": P._replace(P=P.P * 10.0 ** np.linspace(-12, 12, 9)[:, None, None]),
    "far": P._replace(m=P.m + np.where(np.arange(9) < 3, 1e7, 0.0)[:, None]),
    "alike": take(P, np.zeros(9, int)),
    "thin": mapped(P, np.diag([1e-5, 1e5]), np.zeros(2)),
}


@each
@pytest.mark.parametrize("kind", EXTREMES)
def test_what_comes_out_is_a_mixture_whatever_goes_in(name, kind):
    p = EXTREMES[kind]
    try:
        q, _ = reduced(name, p, 3)
    except ValueError as refused:
        assert "\n" not in str(refused)
        assert "too far apart" in str(refused) or "positive definite" in str(refused), refused
    else:
        assert q.w.sum() > 0 and (np.linalg.eigvalsh(q.P) > 0).all()


@each
def test_a_parameter_of_another_kind_is_refused_before_anything_is_reduced(name):
    for parameter in [*signature(REDUCERS[name]).parameters][1:]:
        wrong = {"components": 2} | {parameter: "?" if parameter != "components" else 0}
        for p in (P, take(P, np.array([0]))):
            with pytest.raises((ValueError, TypeError)):
                REDUCERS[name](p, **wrong)
