"""Reduction by the divergence of what remains from what was: pruning or merging, whichever costs less."""

import numpy as np

from gmr_gym.checks import check_count, check_flag
from gmr_gym.kernels import kernel, leaf_kernel
from gmr_gym.linalg import inverse_into
from gmr_gym.mixture import Mixture, match, mean_and_covariance
from gmr_gym.reduction.agglomeration import absorb, nearest_others
from gmr_gym.reduction.greedy_merging import first_least
from gmr_gym.reduction.pair_costs import pair_of
from gmr_gym.reduction.protocol import TOO_FAR, Reduced, definite, through
from gmr_gym.reduction.pruning import weighing


def prune_or_merge(p: Mixture, components: int, sharpened: bool = False) -> Reduced:
    r"""Greedy reduction by the divergence of the reduced mixture from the present one.

    Each step takes the cheapest of all prunings and all merges of a pair, merges first among equals, until
    `components` remain. Peaks are kept, and light parts of the mixture are dropped.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    sharpened : bool
        Whether to approximate the cost of a merge instead of bounding it.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,), -1 where a component was pruned. The weights are rescaled to
        the sum that they had, so the total weight is kept; mean and covariance are not.

    Raises
    ------
    ValueError
        For `components` below 1, or a mixture that fails `checked`.

    Warnings
    --------
    Weight is given up where nothing else is: a tracker forgets hypotheses.

    Notes
    -----
    With weights of sum 1, and q the moment match of i and j, the costs of pruning i and of merging i and j
    are

    .. math::

        & \min_{j \neq i} \left( -\log(1 - w_i) - \frac{w_j}{1 - w_i} \log \left( 1 + \frac{w_i}{w_j}
        e^{-\mathrm{KL}(f_j \| f_i)} \right) \right) \\
        & W \log W - W \log \left( w_i e^{-\mathrm{KL}(q \| f_i)} + w_j e^{-\mathrm{KL}(q \| f_j)} \right),
        \qquad W = w_i + w_j

    which are upper bounds of the divergence of the mixture after the step from the one before. Sharpened, the
    exponent of component j leaves out where i is dense,

    .. math::

        \int q \left( 1 - \frac{f_i}{\max f_i} \right) \log \frac{q}{f_j}

    and that of i likewise; the cost is then no bound.

    References
    ----------
    Ardeshiri, Orguner and Özkan 2015, arXiv:1508.05514.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.5, 0.48, 0.02], [[0.0], [0.5], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = prune_or_merge(p, 2)
    >>> origin.tolist(), round(float(q.w.sum()), 9)
    ([0, 1, -1], 1.0)
    """
    components = check_count(components)
    check_flag("sharpened", sharpened)
    q, place = weighing(p)
    if len(q.w) <= components:
        return q, place
    mean, _ = mean_and_covariance(q)
    total = q.w.sum()
    w, m, P, group = _reduce(q.w / total, q.m - mean, q.P, components, sharpened)
    return definite(Mixture(w * (total / w.sum()), mean + m, P)), through(place, group)


@kernel
def _reduce(w, m, P, components, sharpened):
    """Weights, means, covariances and groups (n,), -1 where pruned."""
    n, d = m.shape
    w, m, P, group, left = w.copy(), m.copy(), P.copy(), np.arange(n), n
    precision, log_det, room = np.empty((n, d, d)), np.empty(n), np.empty((8, d, d))
    g = (w, m, P, precision, log_det)
    merging, pruning = np.full((n, n), np.inf), np.full((n, n), np.inf)
    for i in range(n):
        log_det[i] = 2.0 * inverse_into(precision[i], P[i], room[0])
        _costs_of(i, i, g, sharpened, room, merging, pruning)
    (near, least), (heir, saved) = nearest_others(merging), nearest_others(pruning)
    while left > components:
        i, total = first_least(least, n), w.sum()
        j = near[i]
        k, cost = _cheapest_pruning(w, saved, total)
        if cost == np.inf and least[i] == np.inf:
            raise ValueError(TOO_FAR)
        left -= 1
        if least[i] <= cost * total:
            _, m_ij, P_ij = match(*pair_of(i, j, w, m, P), np.zeros(2, np.int64), 1)
            w[i], m[i], P[i], w[j] = w[i] + w[j], m_ij[0], P_ij[0], 0.0
            log_det[i] = 2.0 * inverse_into(precision[i], P[i], room[0])
            _costs_of(i, n, g, sharpened, room, merging, pruning)
        else:
            i = j = k
            w[k] = 0.0
        absorb(i, j, group, merging, near, least)
        absorb(i, j, group, pruning, heir, saved)
    kept = w > 0.0
    place = np.cumsum(kept) - 1
    for k in range(n):
        group[k] = place[group[k]] if kept[group[k]] else -1
    return w[kept], m[kept], P[kept], group


@leaf_kernel
def _cheapest_pruning(w, saved, total):
    """What to prune for the least cost, and that cost; `saved` (n,), below 0, is what others take over."""
    at, least = 0, np.inf
    for k in range(len(w)):
        rest, given_up = total - w[k], np.log1p(-w[k] / total)
        if rest < w[k]:  # the difference has too few digits
            rest = w[:k].sum() + w[k + 1 :].sum()
            given_up = np.log(rest / total)
        if w[k] > 0.0 and rest > 0.0:
            cost = max(saved[k] / rest - given_up, 0.0)
            if cost < least:
                at, least = k, cost
    return at, least


@kernel
def _costs_of(i, stop, g, sharpened, room, merging, pruning):
    """Writes what concerns component i and those before `stop` to the tables. g holds the weights,
    means, covariances, their inverses and log determinants."""
    w, m, P, precision, log_det = g
    for j in range(stop):
        if j == i or w[j] == 0.0:
            continue
        merging[i, j] = merging[j, i] = _merge_cost(i, j, g, sharpened, room)
        for a, b in ((i, j), (j, i)):  # a pruned, b its heir
            divergence = _divergence(m[b], P[b], log_det[b], m[a], precision[a], log_det[a])
            z = np.log(w[a]) - np.log(w[b]) - divergence
            pruning[a, b] = -w[b] * (max(z, 0.0) + np.log1p(np.exp(-abs(z))))


@leaf_kernel
def _merge_cost(i, j, g, sharpened, room):
    w, m, P, precision, log_det = g
    d, W = m.shape[1], w[i] + w[j]
    a = w[i] / W
    S, inverse, mean = room[0], room[1], room[2, 0]
    for r in range(d):
        mean[r] = a * m[i, r] + (1.0 - a) * m[j, r]
        for c in range(d):
            spread = (m[i, r] - m[j, r]) * (m[i, c] - m[j, c])
            S[r, c] = a * P[i, r, c] + (1.0 - a) * (P[j, r, c] + a * spread)
    log_S = 2.0 * inverse_into(inverse, S, room[3])
    if np.isnan(log_S):
        return np.inf
    x = _divergence(mean, S, log_S, m[i], precision[i], log_det[i])
    y = _divergence(mean, S, log_S, m[j], precision[j], log_det[j])
    if sharpened:
        x, y = (
            x - _inside(j, i, g, mean, S, inverse, log_S, room),
            y - _inside(i, j, g, mean, S, inverse, log_S, room),
        )
    x, y = x - np.log(a), y - np.log(w[j] / W)
    nearer = min(x, y)
    return W * max(nearer - np.log1p(np.exp(nearer - max(x, y))), 0.0)


@leaf_kernel
def _divergence(m1, P1, log_det1, m2, precision2, log_det2):
    """KL(N(m1, P1) || N(m2, P2)) from the inverse of P2 and the log determinants."""
    d, total = len(m1), log_det2 - log_det1
    for r in range(d):
        total -= 1.0
        for c in range(d):
            total += precision2[r, c] * (P1[r, c] + (m1[r] - m2[r]) * (m1[c] - m2[c]))
    return max(0.5 * total, 0.0)


@leaf_kernel
def _inside(i, j, g, mean, S, inverse, log_S, room):
    """Integral of q f_i / max f_i log(q / f_j), for q = N(mean, S)."""
    _, m, P, precision, log_det = g
    d, T, K, both, u, centre = len(mean), room[3], room[4], room[5], room[6, 0], room[7, 0]
    for r in range(d):
        for c in range(d):
            both[r, c] = P[i, r, c] + S[r, c]
    part = 0.5 * log_det[i] - inverse_into(T, both, K)
    for r in range(d):
        u[r] = 0.0
        for c in range(d):
            u[r] += T[r, c] * (mean[c] - m[i, c])
        part -= 0.5 * u[r] * (mean[r] - m[i, r])
    for r in range(d):
        centre[r] = m[i, r]
        for c in range(d):
            centre[r] += P[i, r, c] * u[c]
            K[r, c] = 0.0
            for k in range(d):
                K[r, c] += P[i, r, k] * T[k, c]
    total = log_det[j] - log_S  # the product of q and f_i is N(centre, (1 - K) Pi) but for a factor
    for r in range(d):
        for c in range(d):
            own = P[i, r, c]
            for k in range(d):
                own -= K[r, k] * P[i, k, c]
            total += precision[j, r, c] * (own + (centre[r] - m[j, r]) * (centre[c] - m[j, c]))
            total -= inverse[r, c] * (own + (centre[r] - mean[r]) * (centre[c] - mean[c]))
    return np.exp(part) * 0.5 * total
