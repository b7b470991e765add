"""Greedy merging by bounds on costs makes the merges of working out every cost anew."""

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from gmr_gym.mixture import Mixture, take
from gmr_gym.reduction.greedy_merging import first_least, merge_greedily
from gmr_gym.reduction.runnalls import runnalls


def scattered(rng, n, d):
    return Mixture(*reference.random_mixture(rng, n, d, spread=1.5))


def clustered(rng, n, d):
    """Three clumps far apart."""
    p = scattered(rng, n, d)
    return p._replace(m=0.3 * p.m + 40.0 * (np.arange(n) % 3)[:, None])


def uneven(rng, n, d):
    """Weights over nine decades, in no order."""
    return scattered(rng, n, d)._replace(w=10.0 ** -rng.uniform(0, 9, n))


def expanded(rng, n, d):
    """As after a scan: the children of a hypothesis share a covariance, those of a detection lie near one
    another, and what is missed is far heavier than what fits badly."""
    parents, detections = scattered(rng, 4, d), 2.0 * rng.standard_normal((n // 4 + 1, d))
    parent, detection = np.arange(n) % 4, np.arange(n) // 4
    m = 0.3 * parents.m[parent] + 0.7 * detections[detection]
    return Mixture(10.0 ** -rng.uniform(0, 6, n), m, 0.2 * parents.P[parent])


def crowded(rng, n, d):
    """One covariance, nearly one mean, nearly one weight."""
    p = scattered(rng, n, d)
    return Mixture((1 + 1e-3 * rng.random(n)) / n, 0.1 * p.m, np.broadcast_to(p.P[0], p.P.shape).copy())


KINDS = [scattered, clustered, uneven, expanded, crowded]


def groups(origin):
    """Sets of inputs that flowed into one output."""
    return {frozenset(np.flatnonzero(origin == i).tolist()) for i in range(origin.max() + 1)}


def all_costs(w, m, P):
    """B (n, n) of every pair, infinite but below the diagonal."""
    a = (w[:, None] / (w[:, None] + w))[..., None, None]
    d = m[:, None] - m
    merged = a * P[:, None] + (1 - a) * P + a * (1 - a) * d[..., None] * d[..., None, :]
    log_det = np.linalg.slogdet(P)[1]
    joint = np.linalg.slogdet(merged)[1]
    cost = 0.5 * (w[:, None] * (joint - log_det[:, None]) + w * (joint - log_det))
    return np.where(np.tri(len(w), k=-1, dtype=bool), cost, np.inf)


def merged_by_all_costs(p, components):
    """The groups after every merge, all costs evaluated anew before each, and what the merges cost."""
    parts, members, after, costs = p, [frozenset([i]) for i in range(len(p.w))], [], []
    while len(members) > components:
        table = all_costs(*parts)
        i, j = divmod(int(table.argmin()), len(members))
        costs.append(table[i, j])
        one = [np.array([a]) for a in reference.moment_match(*take(parts, np.array([j, i])))]
        for all_of_them, value in zip(parts, one, strict=True):
            all_of_them[j] = value[0]
        members[j] |= members.pop(i)
        parts = take(parts, np.arange(len(parts.w)) != i)
        after.append(set(members))
    return after, np.array(costs)


@pytest.mark.parametrize("d", [1, 2, 4, 6])
@pytest.mark.parametrize("kind", KINDS)
def test_every_merge_is_that_of_working_out_every_cost(kind, d):
    for seed in range(2):
        p = kind(np.random.default_rng([seed, d]), 40, d)
        after, costs = merged_by_all_costs(Mixture(*(a.copy() for a in p)), 1)
        for left, wanted in zip(range(39, 0, -1), after, strict=True):
            assert groups(runnalls(p, left)[1]) == wanted
        # a budget between what a merge and the next one cost ends there: costs are counted one by one
        paid = np.cumsum(costs)
        for k in (5, 20, 33):
            origin = merge_greedily(*p, 40, 0.5 * (paid[k] + paid[k - 1]))[3]
            assert groups(origin) == after[k - 1]


@pytest.mark.parametrize("d", [2, 4])
@pytest.mark.parametrize("kind", KINDS)
def test_many_merges_are_those_of_working_out_every_cost(kind, d):
    p = kind(np.random.default_rng(3), 170, d)  # more than a block, and gaps closed many times
    wanted = merged_by_all_costs(Mixture(*(a.copy() for a in p)), 20)[0]
    for left in (130, 20):
        assert groups(runnalls(p, left)[1]) == wanted[169 - left]


@settings(derandomize=True, deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.sampled_from(KINDS), st.integers(2, 25), st.sampled_from([1, 3, 4]))
def test_any_number_of_any_kind_is_merged_as_by_working_out_every_cost(seed, kind, n, d):
    p = kind(np.random.default_rng(seed), n, d)
    wanted = merged_by_all_costs(Mixture(*(a.copy() for a in p)), 1)[0]
    left = 1 + seed % (n - 1)
    assert groups(runnalls(p, left)[1]) == wanted[n - 1 - left]


@settings(derandomize=True, deadline=None, max_examples=100)
@given(st.integers(0, 2**32 - 1), st.sampled_from(KINDS), st.sampled_from([1, 2, 4]))
def test_a_merge_with_a_third_costs_no_less_than_the_bound_from_its_parts(seed, kind, d):
    p = kind(np.random.default_rng(seed), 3, d)
    ij, ik, jk = (reference.merge_cost(*take(p, np.array(pair))) for pair in ((0, 1), (0, 2), (1, 2)))
    rest = reference.merge_cost(*p) - ij  # F, less what the first merge has cost
    assert rest >= max(ik, jk, 0.5 * (ij + ik + jk)) - ij - 1e-14 * p.w.sum()


@pytest.mark.parametrize("d", [2, 4])
def test_of_equal_costs_the_pair_whose_later_component_comes_first_is_merged(d):
    p = scattered(np.random.default_rng(0), 3, d)
    twice = take(p, np.array([0, 1, 2, 1, 0]))._replace(w=np.array([0.2, 0.3, 0.1, 0.3, 0.2]))
    assert groups(runnalls(twice, 4)[1]) == {
        frozenset({0}),
        frozenset({1, 3}),
        frozenset({2}),
        frozenset({4}),
    }
    line = Mixture(np.full(6, 0.5), np.arange(6.0)[:, None] * np.eye(1, d), np.array([np.eye(d)] * 6))
    assert runnalls(line, 5)[1].tolist() == [0, 0, 1, 2, 3, 4]


def test_what_is_left_stands_in_the_order_of_its_first_members():
    p = scattered(np.random.default_rng(1), 60, 4)
    for left in (50, 30, 3):
        origin = runnalls(p, left)[1]
        assert (np.diff([np.flatnonzero(origin == i)[0] for i in range(left)]) > 0).all()


@pytest.mark.parametrize("d", [2, 4])
def test_components_too_far_apart_are_refused_when_nothing_else_is_left(d):
    m = np.array([0.0, 1.0, 1e10])[:, None] * np.ones(d)
    p = Mixture(np.full(3, 1 / 3), m, np.array([np.eye(d)] * 3))
    assert groups(runnalls(p, 2)[1]) == {frozenset({0, 1}), frozenset({2})}
    with pytest.raises(ValueError, match="too far apart"):
        runnalls(p, 1)


def test_the_first_least_is_that_of_a_search_one_by_one():
    rng = np.random.default_rng(0)
    for n in (1, 7, 8, 9, 16, 37):
        for _ in range(20):
            row = rng.integers(0, 6, n + 3).astype(float)  # ties
            row[n:] = -1.0  # beyond the first n
            assert first_least(row, n) == row[:n].argmin()
    assert first_least(np.full(20, np.inf), 20) == 0
