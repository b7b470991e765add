"""What a reduction costs: closed forms, quadrature by another hand, and the sums that merges must keep."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from gmr_gym.evaluation.reductions import cost, divergence, steps
from gmr_gym.experiments.mixtures import crouse
from gmr_gym.mixture import Mixture, gaussian, mixture
from gmr_gym.reduction import REDUCERS, reducer, total_merge_cost

METHODS = "runnalls", "west", "ise", "k-means"


def density(p, x):
    P = p.P[:, 0, 0]
    return np.sum(p.w * np.exp(-0.5 * (x - p.m[:, 0]) ** 2 / P) / np.sqrt(2 * np.pi * P))


def integral(f):
    """Over the line, in pieces that no component of `crouse` is lost between."""
    edges = np.arange(-3.0, 6.0, 0.5)
    return sum(quad(f, a, b, epsabs=1e-13, epsrel=1e-11)[0] for a, b in pairwise(edges))


@pytest.mark.parametrize(
    ("components", "ise"), [(6, 0.0012211816), (5, 0.0266345318), (4, 0.0332198129), (3, 0.0478529933)]
)
def test_runnalls_reduction_of_the_mixture_of_crouse_has_the_known_error(components, ise):
    assert cost(crouse(), reducer("runnalls", components)).ise == pytest.approx(ise, abs=5e-11)


@pytest.mark.parametrize("name", METHODS)
def test_errors_in_one_dimension_are_the_integrals_that_they_stand_for(name):
    p, reduce = crouse(), reducer(name, 4)
    q, _ = reduce(p)
    found = cost(p, reduce)
    square = integral(lambda x: (density(p, x) - density(q, x)) ** 2)
    sums = integral(lambda x: density(p, x) ** 2 + density(q, x) ** 2)
    kl = integral(lambda x: density(p, x) * np.log(density(p, x) / density(q, x)))
    back = integral(lambda x: density(q, x) * np.log(density(q, x) / density(p, x)))
    assert found.components == 4 and found.standard_error == found.reverse_standard_error == 0.0
    assert [found.ise, found.nise] == pytest.approx([square, square / sums], rel=1e-7)
    assert [found.divergence, found.reverse_divergence] == pytest.approx([kl, back], rel=1e-7)


@pytest.mark.parametrize("d", [2, 5])
def test_a_sampled_divergence_is_that_of_two_gaussians_within_its_error(d):
    rng = np.random.default_rng(d)
    A = rng.normal(size=(d, d))
    S, shift = A @ A.T + np.eye(d), rng.normal(size=d)
    exact = 0.5 * (
        np.trace(np.linalg.inv(S)) + shift @ np.linalg.solve(S, shift) - d + np.linalg.slogdet(S)[1]
    )
    found, error = divergence(gaussian(np.zeros(d), np.eye(d)), gaussian(shift, S))
    assert 0 < error < 0.02 and abs(found - exact) < 4 * error
    assert divergence(gaussian(np.zeros(d), np.eye(d)), gaussian(shift, S)) == (found, error)
    fewer, wider = divergence(gaussian(np.zeros(d), np.eye(d)), gaussian(shift, S), samples=500)
    assert wider == pytest.approx(10 * error, rel=0.2) and abs(fewer - exact) < 4 * wider


def test_weights_do_not_count_in_a_divergence_but_do_in_the_integral_squared_error():
    half = crouse()._replace(w=crouse().w / 2)
    kl, _ = divergence(crouse(), half)
    assert kl == pytest.approx(0, abs=1e-12)
    assert cost(crouse(), lambda p: (half, np.arange(10))).nise == pytest.approx(0.25 / 1.25)


@pytest.mark.parametrize("name", METHODS)
def test_every_step_is_the_reduction_of_the_whole_mixture(name):
    found = steps(crouse(), REDUCERS[name], 3)
    assert [len(step.mixture.w) for step in found] == [10, 9, 8, 7, 6, 5, 4, 3]
    for step in found[1:]:
        q, origin = reducer(name, len(step.mixture.w))(crouse())
        np.testing.assert_array_equal(step.origin, origin)
        assert all(np.array_equal(a, b) for a, b in zip(step.mixture, q, strict=True))


@pytest.mark.parametrize("name", ["runnalls", "west", "average-isd"])
def test_merges_lead_from_step_to_step_and_their_costs_sum_to_that_of_one_gaussian(name):
    found = steps(crouse(), REDUCERS[name])
    for before, after in pairwise(found):
        np.testing.assert_array_equal(after.into[before.origin], after.origin)
    total = sum(step.merge_cost for step in found[1:])
    assert total == pytest.approx(total_merge_cost(crouse()), rel=1e-12)


def test_a_deletion_has_no_cost_of_a_merge():
    found = steps(crouse(), REDUCERS["capping"], 8)
    assert np.isnan([step.merge_cost for step in found]).all()
    assert found[1].into.tolist().count(-1) == 1


def test_groups_that_are_formed_anew_are_no_merges():
    four = mixture([0.25] * 4, [[0.0], [1.0], [2.0], [3.0]], [[[1.0]]] * 4)

    def anew(p, components):
        group = np.array([0, 0, 1, 1]) if components == 2 else np.array([0, 1, 1, 2])
        group = group if components < 4 else np.arange(4)
        return Mixture(p.w[:components] * 4 / components, p.m[:components], p.P[:components]), group

    third, second = steps(four, anew, 2)[1:]
    assert third.into.tolist() == [0, 1, 1, 2]
    assert second.into is None and np.isnan(second.merge_cost)


def test_a_call_is_timed():
    assert 0 < cost(crouse(), reducer("runnalls", 4)).seconds < 0.01


@pytest.mark.parametrize(
    ("reduction", "message"),
    [
        (lambda p, components: p, "a reduction must return a Mixture and the origin"),
        (lambda p, components: (p._replace(w=0 * p.w), np.arange(10)), "leaves a mixture without weight"),
        (lambda p, components: (p._replace(P=-p.P), np.arange(10)), r"the reduced P\[0\] must be positive"),
    ],
)
def test_what_is_no_reduction_is_refused(reduction, message):
    with pytest.raises(ValueError, match=message):
        steps(crouse(), reduction, 9)
    with pytest.raises(ValueError, match=message):
        cost(crouse(), partial(reduction, components=9))


@pytest.mark.parametrize("components", [0, 11])
def test_components_that_are_not_there_are_refused(components):
    with pytest.raises(ValueError, match="components must be at"):
        steps(crouse(), REDUCERS["west"], components)
