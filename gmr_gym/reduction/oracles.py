"""The best partition of a few components, by looking at all of them: what faster reductions are judged by."""

import numpy as np

from gmr_gym.checks import check_choice, check_count
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, mean_and_covariance
from gmr_gym.reduction.agglomeration import merged_by
from gmr_gym.reduction.distances import dimension, pack, products_with
from gmr_gym.reduction.measures import MEASURES
from gmr_gym.reduction.overlap_descent import STEPS
from gmr_gym.reduction.protocol import Reduced, at_unit, definite, through, warn_unfinished
from gmr_gym.reduction.pruning import weighing
from gmr_gym.reduction.transport_descent import shares, stepping

PARTITIONED = 12  # components of which every partition is tried
PROGRAMMED = 14  # components whose subsets the dynamic programme goes through


def brute_force(p: Mixture, components: int) -> Reduced:
    """The partition whose moment matches have the least integral squared difference from the mixture.

    Every partition into `components` groups is tried: 42 525 for 10 components into 5.

    Parameters
    ----------
    p : Mixture
        At most 12 components of positive weight, unless `components` suffice for all.
    components : int
        Upper limit of the number of components that remain.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For too many components, `components` below 1, or a mixture that fails `checked`.

    References
    ----------
    Crouse et al. 2011.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.25, 0.25, 0.5], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = brute_force(p, 2)
    >>> q.m.tolist(), origin.tolist()
    ([[1.0], [9.0]], [0, 0, 1])
    """

    def groups(q, components):
        _check_few("brute-force", len(q.w), PARTITIONED)
        return _least_difference(q.w, pack(q.m - mean_and_covariance(q)[0], q.P), components)

    return merged_by(groups, p, components)


def transportation_optimum(p: Mixture, components: int, cost: str = "kl") -> Reduced:
    """The partition of least composite transportation divergence, by a dynamic programme.

    `transportation` descends to a partition from which no sweep leads further; this is the best of all.

    Parameters
    ----------
    p : Mixture
        At most 14 components of positive weight, unless `components` suffice for all.
    components : int
        Upper limit of the number of components that remain.
    cost : {"kl", "reverse-kl", "symmetrised-kl", "wasserstein", "cauchy-schwarz", "isd"}
        Cost of two Gaussians, see `gmr_gym.reduction.measures`; the least costs by the last two are known as
        far as their barycentres are.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For too many components, an unknown cost, `components` below 1, or a mixture that fails `checked`.
    """
    check_choice("cost", cost, MEASURES)
    components = check_count(components)
    q, place = weighing(p)
    n = len(q.w)
    if n <= components:
        return q, place
    _check_few("transportation-optimum", n, PROGRAMMED)
    step, w = stepping(cost, q), at_unit(q.w)
    subsets = np.where(np.arange(2**n)[:, None] >> np.arange(n) & 1, w, 0.0)
    *_, table, _ = step(subsets)
    table[subsets == 0.0] = 0.0
    group = _least_sum((subsets * table).sum(axis=1), n, components)
    v, m, P, _, exact = step(shares(w, group))
    if not exact:
        warn_unfinished(f"the barycentre by {cost}", STEPS)
    return definite(Mixture(q.w.max() / w.max() * v, m, P)), through(place, group)


def _check_few(name: str, n: int, limit: int) -> None:
    """Raise ValueError for more components than whose partitions can be gone through."""
    if n > limit:
        raise ValueError(
            f"{name} goes through all partitions and takes at most {limit} components, got {n}; prune first"
        )


@kernel
def _subsets(w, M):
    """Weights (2^n,) and packed moment matches (T, 2^n) of all subsets of the Gaussians packed in M (T, n);
    component i belongs to the subsets whose bit i is set."""
    T, n = M.shape
    mean = T - dimension(T)  # the row where the means begin
    weight, out, apart = np.zeros(2**n), np.zeros((T, 2**n)), np.empty(T - mean)
    for s in range(1, 2**n):
        last = 0
        while s >> (last + 1):
            last += 1
        rest = s ^ (1 << last)
        weight[s] = weight[rest] + w[last]
        b = w[last] / weight[s]
        for r in range(len(apart)):
            apart[r] = M[mean + r, last] - out[mean + r, rest]
            out[mean + r, s] = out[mean + r, rest] + b * apart[r]
        q = 0
        for r in range(len(apart)):
            for c in range(r + 1):
                spread = b * M[q, last] + b * (1.0 - b) * apart[r] * apart[c]
                out[q, s] = (1.0 - b) * out[q, rest] + (spread if rest else M[q, last])
                q += 1
    return weight, out


# ---- integral squared difference: every partition ----


@kernel
def _least_difference(w, M, components):
    """Groups (n,) of the partition of least integral squared difference."""
    n = len(w)
    if components == 1:
        return np.zeros(n, np.int64)
    weight, subsets = _subsets(w, M)
    own, size, place = np.zeros(2**n), np.zeros(2**n, np.int64), np.zeros(2**n, np.int64)
    for i in range(n):
        product = products_with(M[:, i].copy(), subsets, 2**n)
        for s in range(1, 2**n):
            own[s] -= 2.0 * weight[s] * w[i] * product[s]
            if s >> i & 1:
                size[s] += 1
                place[s] += 3**i
    pairs = _pair_products(weight, subsets, own, size, place, n - components + 2)
    return _least_partition(own, pairs, size, place, components)


@kernel
def _pair_products(weight, subsets, own, size, place, largest):
    """Adds the integral of its own square to every subset, infinite where a covariance is lost in rounding;
    returns the integrals of products of disjoint subsets s and t of at most `largest` components together, at
    place[s] + 2 place[t]. The first component of s comes before that of t."""
    count = len(weight)
    pairs, room, partner = (
        np.zeros(2 * place[count - 1] + 1),
        np.empty(subsets.shape),
        np.zeros(count, np.int64),
    )
    for s in range(1, count):
        if size[s] > largest - 1:
            continue
        others = (count - 1) ^ s
        others &= ~((s & -s) - 1)
        partner[0], k, t = s, 1, others
        while t:
            if size[s] + size[t] <= largest:
                partner[k] = t
                k += 1
            t = (t - 1) & others
        for q in range(len(room)):
            for j in range(k):
                room[q, j] = subsets[q, partner[j]]
        product = products_with(room[:, 0].copy(), room, k)
        own[s] += weight[s] ** 2 * product[0]
        own[s] = own[s] if own[s] < np.inf else np.inf
        for j in range(1, k):
            pairs[place[s] + 2 * place[partner[j]]] = weight[s] * weight[partner[j]] * product[j]
    return pairs


@kernel
def _least_partition(own, pairs, size, place, components):
    """Groups (n,) of the best partition. Each block holds the first of the components that are left and some
    of the others; the last block, all that are left."""
    full = len(own) - 1
    block, best = np.zeros(components, np.int64), np.zeros(components, np.int64)
    rest, others, cost = np.zeros(components, np.int64), np.zeros(components, np.int64), np.zeros(components)
    rest[0], others[0], least, level = full, full - 1, np.inf, 0
    while level >= 0:
        if others[level] < 0:
            level -= 1
            continue
        free = rest[level] & (rest[level] - 1)
        block[level] = rest[level] ^ free | others[level]
        others[level] = (others[level] - 1) & free if others[level] else -1
        left = rest[level] ^ block[level]
        if size[left] < components - 1 - level:
            continue
        total = cost[level] + _added(block, level, own, pairs, place)
        if level < components - 2:
            level += 1
            rest[level], others[level], cost[level] = left, left & (left - 1), total
            continue
        block[level + 1] = left
        total += _added(block, level + 1, own, pairs, place)
        if total < least:
            least, best[:] = total, block
    return _groups(best, size[full])


@kernel
def _added(block, level, own, pairs, place):
    """What the block of that level adds to the integral squared difference of those before it."""
    total = own[block[level]]
    for k in range(level):
        total += 2.0 * pairs[place[block[k]] + 2 * place[block[level]]]
    return total


@kernel
def _groups(block, n):
    """Groups (n,) of components from blocks (k,), subsets of them."""
    group = np.zeros(n, np.int64)
    for k in range(len(block)):
        for i in range(n):
            if block[k] >> i & 1:
                group[i] = k
    return group


# ---- sums over the blocks: a dynamic programme ----


@kernel
def _least_sum(cost, n, components):
    """Groups (n,) of the partition whose blocks have the least sum of costs (2^n,)."""
    full = len(cost) - 1
    chosen = np.zeros((components, full + 1), np.int64)
    before = np.full(full + 1, np.inf)
    before[0] = 0.0
    for k in range(components):
        after = np.full(full + 1, np.inf)
        for s in range(1, full + 1):
            free = s & (s - 1)
            others = free
            while others >= 0:
                block = s ^ free | others
                total = cost[block] + before[s ^ block]
                if total < after[s]:
                    after[s], chosen[k, s] = total, block
                others = (others - 1) & free if others else -1
        before = after
    best, left = np.zeros(components, np.int64), full
    for k in range(components):
        best[k] = chosen[components - 1 - k, left]
        left ^= best[k]
    return _groups(best, n)
