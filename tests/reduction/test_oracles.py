"""The oracles are best: among all partitions written out, and against what is greedy or descends."""

import numpy as np
import pytest
import reference
from test_runnalls import random_mixture

from gmr_gym.experiments.mixtures import crouse
from gmr_gym.mixture import Mixture, take
from gmr_gym.reduction.agglomeration import greedy_isd
from gmr_gym.reduction.barycentres import barycentre
from gmr_gym.reduction.distances import integral_squared_difference, kullback_leibler
from gmr_gym.reduction.oracles import brute_force, transportation_optimum
from gmr_gym.reduction.runnalls import runnalls


def partitions(n, k):
    """Groups (n,) of every partition into k blocks, each named by when its first member comes."""
    found = [[0]]
    for _ in range(n - 1):
        found = [[*group, g] for group in found for g in range(min(max(group) + 2, k))]
    return [np.array(group) for group in found if max(group) == k - 1]


def merged(p, group):
    blocks = (group == g for g in range(group.max() + 1))
    parts = [reference.moment_match(*(a[block] for a in p)) for block in blocks]
    return Mixture(*(np.array(a) for a in zip(*parts, strict=True)))


def spent(p, group):
    """Sum of w KL(component || moment match of its group)."""
    q = merged(p, group)
    log_det = [np.linalg.slogdet(P)[1] for P in p.P]
    return 0.5 * (q.w @ [np.linalg.slogdet(P)[1] for P in q.P] - p.w @ log_det)


@pytest.mark.parametrize(
    ("components", "ise"),
    [(6, 0.0003928270), (5, 0.0029520974), (4, 0.0141536504), (3, 0.0295049142)],
)
def test_the_best_partition_of_the_mixture_of_crouse_has_the_known_error(components, ise):
    q, _ = brute_force(crouse(), components)
    assert integral_squared_difference(crouse(), q) == pytest.approx(ise, abs=5e-11)


def test_the_least_transportation_divergence_of_the_mixture_of_crouse_is_known():
    q, origin = transportation_optimum(crouse(), 5)
    blocks = [np.flatnonzero(origin == g).tolist() for g in range(5)]
    assert blocks == [[0, 4, 7], [1], [2, 3], [5, 6, 9], [8]]
    assert spent(crouse(), origin) == pytest.approx(0.14670576, abs=5e-9)
    assert integral_squared_difference(crouse(), q) == pytest.approx(0.018314, abs=5e-7)


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize("components", [1, 2, 3, 6])
def test_oracles_find_the_best_of_all_partitions_written_out(d, components):
    p = random_mixture(10 * d + components, 7, d, spread=1.5, total=3.0)
    every = partitions(7, components)
    errors = [integral_squared_difference(p, merged(p, group)) for group in every]
    q, origin = brute_force(p, components)
    assert integral_squared_difference(p, q) == pytest.approx(min(errors), rel=1e-9)
    np.testing.assert_array_equal(origin, every[int(np.argmin(errors))])
    costs = [spent(p, group) for group in every]
    np.testing.assert_array_equal(transportation_optimum(p, components)[1], every[int(np.argmin(costs))])


def test_the_optimum_by_another_cost_is_the_best_of_all_partitions_written_out():
    p, costs = random_mixture(3, 6, 2, spread=1.5), []
    for group in partitions(6, 3):
        total = 0.0
        for g in range(3):
            block = take(p, group == g)
            q = barycentre(block, "reverse-kl")
            total += sum(w * kullback_leibler(q.m[0], q.P[0], m, P) for w, m, P in zip(*block, strict=True))
        costs.append(total)
    q, origin = transportation_optimum(p, 3, cost="reverse-kl")
    np.testing.assert_array_equal(origin, partitions(6, 3)[int(np.argmin(costs))])
    np.testing.assert_allclose(q.P[0], barycentre(take(p, origin == 0), "reverse-kl").P[0], rtol=1e-12)


def test_there_are_as_many_partitions_as_stirling_counts():
    assert [len(partitions(7, k)) for k in range(1, 8)] == [1, 63, 301, 350, 140, 21, 1]


@pytest.mark.parametrize("seed", range(30))
def test_no_greedy_reduction_is_better(seed):
    p = random_mixture(seed, 9, 1 + seed % 4, spread=1.5)
    best = integral_squared_difference(p, brute_force(p, 4)[0])
    for greedy in (greedy_isd, runnalls):
        assert best <= integral_squared_difference(p, greedy(p, 4)[0]) + 1e-12


@pytest.mark.parametrize(("oracle", "limit"), [(brute_force, 12), (transportation_optimum, 14)])
def test_more_components_than_can_be_gone_through_are_refused(oracle, limit):
    p = random_mixture(0, limit + 1, 1)
    with pytest.raises(ValueError, match=f"at most {limit} components, got {limit + 1}; prune") as refused:
        oracle(p, 2)
    assert "\n" not in str(refused.value)
    assert len(oracle(p, limit + 1)[0].w) == limit + 1  # nothing to reduce
    p.w[3] = 0.0
    q, origin = oracle(p, limit - 1)
    assert len(q.w) == limit - 1 and origin[3] == -1


@pytest.mark.parametrize("oracle", [brute_force, transportation_optimum])
def test_oracles_avoid_merges_that_rounding_loses(oracle):
    p = random_mixture(1, 6, 2, spread=1.0)
    p.m[3:] += 1e12
    assert oracle(p, 4)[0].P.max() < 1e3
    with pytest.raises(ValueError, match="too far apart"):
        oracle(p, 1)
