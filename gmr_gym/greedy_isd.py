"""Greedy merging by the integral squared difference (Zhang, eq. 3): a merge changes one row of a table
of what merging any pair would cost."""

import numpy as np

from gmr_gym.agglomeration import cheapest_pair, merged_by, nearest_others, numbered, take_in
from gmr_gym.dissimilarity import isd_row, isd_table, own_products
from gmr_gym.distances import dimension, pack, products_of_columns
from gmr_gym.kernels import kernel
from gmr_gym.merge_cost import merge_pair
from gmr_gym.mixture import Mixture, moments
from gmr_gym.reduction import Reduced


def greedy_isd(p: Mixture, components: int) -> Reduced:
    """Merges the pair that makes the least integral squared difference to the mixture as it then
    stands, until `components` remain (Zhang, section 3; compared with the original mixture, and
    with deletions, it is Williams' error in `ise`). At equal cost the lowest indices come first."""

    def groups(q, components):
        # about the mean, merged means keep the digits that their differences are made of
        return _merge_nearest(q.w.copy(), pack(q.m - moments(q)[0], q.P), components)

    return merged_by(groups, p, components)


@kernel
def _merge_nearest(w, M, components):
    """Groups (n,) of greedy merging of the Gaussians packed in M (T, n); w and M are overwritten."""
    T, n = M.shape
    means, entries = M[T - dimension(T) :], M[: T - dimension(T)]
    room = np.empty((len(entries), 1)), np.empty(1)
    own, table = own_products(M), isd_table(w, M)
    nearest, least = nearest_others(table)
    group, alive = np.arange(n), np.arange(n)
    while len(alive) > components:
        i, j = cheapest_pair(nearest, least)
        merge_pair(i, j, w, means, entries, room)
        merged = M[:, i : i + 1].copy()
        own[i] = products_of_columns(merged, merged, 1)[0]
        alive = alive[alive != j]
        others = alive[alive != i]
        row = isd_row(i, others, w, M, own)
        for k in range(len(others)):
            table[i, others[k]] = table[others[k], i] = row[k]
        take_in(i, j, group, table, nearest, least)
    return numbered(group)
