"""Further reductions written plainly: merging by the reverse divergence, transportation, refinement."""

import numpy as np
from plain import _log_determinant, _products, runnalls_compiled
from scipy.optimize import minimize

from gmr_gym.kernels import kernel
from gmr_gym.linalg import inverse_into
from gmr_gym.mixture import Mixture


def reverse_kl_in_numpy(p: Mixture, components: int) -> np.ndarray:
    """Origin (n,) of greedy merging by the reverse divergence, into its barycentres: pair costs kept in a
    table whose lower half is used and searched whole for each minimum; a row is formed at once."""
    w, m, P = (a.copy() for a in p)
    n = len(w)
    into, alive, log_det = np.arange(n), np.arange(n), np.linalg.slogdet(P)[1]
    table = np.full((n, n), np.inf)

    def costs(i, others):
        W, e = w[i] + w[others], (m[others] - m[i])[..., None]
        a = (w[i] / W)[:, None, None]
        N = (1 - a) * P[i] + a * P[others]
        spread = w[i] * w[others] / W * (e * np.linalg.solve(N, e)).sum((1, 2))
        return 0.5 * (W * np.linalg.slogdet(N)[1] - w[others] * log_det[i] - w[i] * log_det[others] + spread)

    for i in range(1, n):
        table[i, :i] = costs(i, np.arange(i))
    while len(alive) > components:
        j, i = sorted(divmod(int(table.argmin()), n))
        a, one, other = w[i] / (w[i] + w[j]), np.linalg.inv(P[i]), np.linalg.inv(P[j])
        S = np.linalg.inv(a * one + (1 - a) * other)
        m[j], P[j], w[j] = S @ (a * one @ m[i] + (1 - a) * other @ m[j]), S, w[i] + w[j]
        log_det[j] = np.linalg.slogdet(S)[1]
        into[into == i] = j
        table[i, :], table[:, i] = np.inf, np.inf
        alive = alive[alive != i]
        below, above = alive[alive < j], alive[alive > j]
        table[j, below], table[above, j] = costs(j, below), costs(j, above)
    return np.searchsorted(alive, into)


def reverse_kl_compiled(p: Mixture, components: int) -> np.ndarray:
    """`reverse_kl_in_numpy` in compiled loops, a pair at a time."""
    return _reverse_kl(p.w.copy(), p.m.copy(), p.P.copy(), components)


@kernel
def _reverse_kl(w, m, P, components):
    n, d = m.shape
    into, alive, table = np.arange(n), np.ones(n, np.bool_), np.full((n, n), np.inf)
    N, L, e, log_det = np.empty((d, d)), np.zeros((d, d)), np.empty(d), np.empty(n)
    for i in range(n):
        log_det[i] = _log_determinant(P[i], L)
        for j in range(i):
            table[i, j] = _reverse_cost(i, j, w, m, P, log_det, N, L, e)
    for _ in range(n - components):
        j, i, least = 0, 0, np.inf
        for a in range(n):
            for b in range(a):
                if table[a, b] < least:
                    j, i, least = b, a, table[a, b]
        _intersect(i, j, w, m, P, N, L, e)
        w[j] += w[i]
        log_det[j] = _log_determinant(P[j], L)
        alive[i] = False
        for k in range(n):
            into[k] = j if into[k] == i else into[k]
            table[i, k] = table[k, i] = np.inf
            if alive[k] and k != j:
                table[max(j, k), min(j, k)] = _reverse_cost(j, k, w, m, P, log_det, N, L, e)
    place = np.cumsum(alive) - 1
    return place[into]


@kernel
def _intersect(i, j, w, m, P, N, L, e):
    """Writes the barycentre of the two to j."""
    inverse, both, a = np.empty(N.shape), np.zeros(N.shape), w[i] / (w[i] + w[j])
    e[:] = 0.0
    for k, share in ((i, a), (j, 1.0 - a)):
        inverse_into(inverse, P[k], L)
        for r in range(len(e)):
            for c in range(len(e)):
                both[r, c] += share * inverse[r, c]
                e[r] += share * inverse[r, c] * m[k, c]
    inverse_into(P[j], both, L)
    for r in range(len(e)):
        m[j, r] = 0.0
        for c in range(len(e)):
            m[j, r] += P[j, r, c] * e[c]


@kernel
def _reverse_cost(i, j, w, m, P, log_det, N, L, e):
    W, d2 = w[i] + w[j], 0.0
    a = w[i] / W
    for r in range(len(e)):
        for c in range(r + 1):
            N[r, c] = (1.0 - a) * P[i, r, c] + a * P[j, r, c]
    log_N = _log_determinant(N, L)
    for r in range(len(e)):
        e[r] = m[j, r] - m[i, r]
        for c in range(r):
            e[r] -= L[r, c] * e[c]
        e[r] /= L[r, r]
        d2 += e[r] ** 2
    return 0.5 * (W * log_N - w[j] * log_det[i] - w[i] * log_det[j] + a * w[j] * d2)


def _start(p: Mixture, components: int) -> np.ndarray:
    """Groups (n,) of Runnalls' merging, from 0."""
    return np.unique(runnalls_compiled(p, components), return_inverse=True)[1]


def transportation_in_numpy(p: Mixture, components: int) -> np.ndarray:
    """Origin (n,) of the sweeps of `transportation` by the Kullback-Leibler divergence."""
    d, log_det, group = p.m.shape[1], np.linalg.slogdet(p.P)[1], _start(p, components)
    while True:
        share = np.where(group == np.arange(group.max() + 1)[:, None], p.w, 0.0)
        share /= share.sum(axis=1, keepdims=True)
        e = p.m - (share @ p.m)[:, None]
        S = np.tensordot(share, p.P, 1) + (share[..., None] * e).transpose(0, 2, 1) @ e
        inverse = np.linalg.inv(S)
        trace = inverse.reshape(len(S), -1) @ p.P.reshape(len(p.w), -1).T
        cost = np.linalg.slogdet(S)[1][:, None] - log_det - d + trace + (e @ inverse * e).sum(axis=2)
        nearest = cost.argmin(axis=0)
        if (nearest == group).all():
            return group
        group = np.unique(nearest, return_inverse=True)[1]


def refine_in_scipy(p: Mixture, components: int) -> Mixture:
    """Descent of the integral squared error from Runnalls' result, over weights, means and Cholesky factors,
    by SciPy's quasi-Newton method with gradients by differences."""
    group, d = _start(p, components), p.m.shape[1]
    lower = np.tril_indices(d)

    def unpacked(x):
        x = x.reshape(components, -1)
        L = np.zeros((components, d, d))
        L[:, *lower] = x[:, 1 + d :]
        w = np.exp(x[:, 0])
        return Mixture(w * (p.w.sum() / w.sum()), x[:, 1 : 1 + d], L @ L.transpose(0, 2, 1))

    def error(x):  # but for the product of p with itself
        q = unpacked(x)
        return q.w @ _products(q.m, q.P, q.m, q.P) @ q.w - 2.0 * (q.w @ _products(q.m, q.P, p.m, p.P) @ p.w)

    start = []
    for g in range(components):
        own = group == g
        a = p.w[own] / p.w[own].sum()
        mean = a @ p.m[own]
        e = p.m[own] - mean
        S = np.tensordot(a, p.P[own], 1) + (a[:, None] * e).T @ e
        start.append([np.log(p.w[own].sum()), *mean, *np.linalg.cholesky(S)[lower]])
    return unpacked(minimize(error, np.ravel(start), method="BFGS", options={"gtol": 1e-7}).x)
