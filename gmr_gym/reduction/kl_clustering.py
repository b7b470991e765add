"""Clustering of Gaussians by the Kullback-Leibler divergence, as k-means does it with points."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, half_log_determinant
from gmr_gym.mixture import Mixture, match
from gmr_gym.reduction.protocol import warn_unfinished

ROUNDS = 100  # of assigning and matching; some five are needed


def cluster_by_divergence(p: Mixture, group: np.ndarray, count: int) -> np.ndarray:
    """Groups (n,) of components, each nearest to the moment match of its own group.

    A component moves to the group whose moment match q has the least KL(component || q), the first among
    equals, if that is strictly less than for its own group, and never out of a group of one. The groups are
    then matched anew, until nothing moves. The sum of w KL(component || q) never rises.

    Parameters
    ----------
    p : Mixture
        Checked, of positive weights.
    group : ndarray of int (n,)
        Groups to begin with, 0 to count - 1, none of them empty.
    count : int
        Number of groups.

    Warns
    -----
    UserWarning
        Where components still move after 100 rounds.

    References
    ----------
    Schieferdecker and Huber 2009, section IV.
    """
    group, settled = _lloyd(*p, group.copy(), count)
    if not settled:
        warn_unfinished("clustering by the Kullback-Leibler divergence", ROUNDS)
    return group


@kernel
def _lloyd(w, m, P, group, count):
    """The groups when nothing moves, and whether that was reached."""
    for _ in range(ROUNDS):
        _, q_m, q_P = match(w, m, P, group, count)
        if not _reassign(divergences(m, P, q_m, q_P), group):
            return group, True
    return group, False


@kernel
def divergences(m, P, q_m, q_P):
    """KL(i || j) (n, k) of Gaussians with means m (n, d) and covariances P from those with q_m (k, d) and
    q_P; infinite where a covariance is not positive definite."""
    n, d = m.shape
    table = np.full((n, len(q_m)), np.inf)
    log_det, L, X, y = np.full(n, np.nan), np.zeros((d, d)), np.zeros((d, d)), np.empty(d)
    for i in range(n):
        if cholesky_into(L, P[i]):
            log_det[i] = half_log_determinant(L)
    for j in range(len(q_m)):
        if not cholesky_into(L, q_P[j]):
            continue
        own = half_log_determinant(L)
        inverse_of_lower(X, L)
        for i in range(n):
            total = 2.0 * (own - log_det[i]) - d
            for r in range(d):
                y[r] = m[i, r] - q_m[j, r]
            for r in range(d):  # |X (m_i - q_m)|^2 + tr(X P_i X')
                across = 0.0
                for c in range(r + 1):
                    across += X[r, c] * y[c]
                    row = 0.0
                    for k in range(c):
                        row += X[r, k] * P[i, c, k]
                    total += X[r, c] * (2.0 * row + X[r, c] * P[i, c, c])
                total += across * across
            if total < np.inf:
                table[i, j] = max(0.5 * total, 0.0)  # of two equals rounding may give -1e-16
    return table


@kernel
def inverse_of_lower(X, L):
    """Writes the inverse of the lower triangular L (d, d) into the lower triangle of X."""
    for c in range(len(L)):
        X[c, c] = 1.0 / L[c, c]
        for r in range(c + 1, len(L)):
            total = 0.0
            for k in range(c, r):
                total -= L[r, k] * X[k, c]
            X[r, c] = total / L[r, r]


@kernel
def _reassign(table, group):
    """Moves components to the nearest group; returns whether any has moved."""
    members, moved = np.zeros(table.shape[1], np.int64), False
    for g in group:
        members[g] += 1
    for i in range(len(table)):
        old = group[i]
        if members[old] > 1:
            for j in range(table.shape[1]):
                if table[i, j] < table[i, group[i]]:
                    group[i], moved = j, True
            members[old] -= 1
            members[group[i]] += 1
    return moved
