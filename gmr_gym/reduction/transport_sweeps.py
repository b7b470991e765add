"""Sweeps of majorisation and minimisation on the composite transportation divergence: kernels."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into

CONVERGED = 1e-10  # relative fall of the objective in a sweep
LEAST_WEIGHT = 1e-300  # of a Gaussian, beside components of weight 1: below it digits are lost


@kernel
def sweeps(w, m, P, share, temperature, weighted, limit):
    """Whether every covariance stayed definite, the weights, means and covariances of the Gaussians, and the
    objective by sweep; share (L, n) is overwritten."""
    count, (n, d) = len(share), m.shape
    v, c, S = np.empty(count), np.empty((count, d)), np.empty((count, d, d))
    columns, log_det = columns_of(m, P)
    table, objective, total = np.empty((count, n)), np.empty(limit), w.sum()
    before, sweep = np.inf, 0
    while sweep < limit:
        moment_matches(share, m, P, v, c, S)
        if not divergences(columns, log_det, v, c, S, table):
            return False, v, c, S, objective[:sweep]
        after = share_out(table, w, v, temperature, weighted, share)
        objective[sweep] = after
        sweep += 1
        if not before - after > CONVERGED * (abs(after) + temperature * total):
            break
        before = after
    moment_matches(share, m, P, v, c, S)
    return True, v, c, S, objective[:sweep]


@kernel
def cost_table(m, P, v, c, S):
    """Costs (L, n) of the Gaussians m, P of a mixture and those of another, v, c, S."""
    table = np.empty((len(v), len(m)))
    columns, log_det = columns_of(m, P)
    if not divergences(columns, log_det, v, c, S, table):
        raise ValueError("a covariance of the mixture is not positive definite")
    return table


@kernel
def columns_of(m, P):
    """Lower triangles of the covariances, row by row, then means, in columns (T, n); and log determinants
    (n,)."""
    n, d = m.shape
    columns, log_det, L = np.empty((d * (d + 3) // 2, n)), np.zeros(n), np.zeros((d, d))
    for i in range(n):
        cholesky_into(L, P[i])
        q = 0
        for r in range(d):
            log_det[i] += 2.0 * np.log(L[r, r])
            columns[len(columns) - d + r, i] = m[i, r]
            for s in range(r + 1):
                columns[q, i] = P[i, r, s]
                q += 1
    return columns, log_det


@kernel
def moment_matches(share, m, P, v, c, S):
    """Writes the weight, mean and covariance of every row of shares; 0 for a row of next to no weight."""
    n, d = m.shape
    v[:], c[:], S[:] = 0.0, 0.0, 0.0
    for j in range(len(share)):
        for i in range(n):
            v[j] += share[j, i]
        if not v[j] > LEAST_WEIGHT:
            v[j] = 0.0
            continue
        for i in range(n):
            if share[j, i] > 0.0:
                a = share[j, i] / v[j]
                for r in range(d):
                    c[j, r] += a * m[i, r]
        for i in range(n):
            if share[j, i] > 0.0:
                a = share[j, i] / v[j]
                for r in range(d):
                    for s in range(r + 1):
                        S[j, r, s] += a * (P[i, r, s] + (m[i, r] - c[j, r]) * (m[i, s] - c[j, s]))
        for r in range(d):
            for s in range(r):
                S[j, s, r] = S[j, r, s]


@kernel
def divergences(columns, log_det, v, c, S, table):
    """Writes KL(i || j) to the table (L, n), infinite where Gaussian j has no weight; False where a
    covariance is not positive definite."""
    count, d = c.shape
    n = len(log_det)
    L, G, apart = np.zeros((d, d)), np.zeros((d, d)), np.empty((d, n))
    for j in range(count):
        row = table[j]
        if not v[j] > 0.0:
            row[:] = np.inf
            continue
        if not cholesky_into(L, S[j]):
            return False
        _inverse(L, G)
        constant = -float(d)
        for r in range(d):
            constant += 2.0 * np.log(L[r, r])
            mean, deviation = columns[len(columns) - d + r], apart[r]
            for i in range(n):
                deviation[i] = mean[i] - c[j, r]
        for i in range(n):
            row[i] = constant - log_det[i]
        q = 0
        for r in range(d):
            for s in range(r + 1):
                entry, x, y = columns[q], apart[r], apart[s]
                g = G[r, s] if r == s else 2.0 * G[r, s]
                for i in range(n):
                    row[i] += g * (entry[i] + x[i] * y[i])
                q += 1
        for i in range(n):
            row[i] = max(0.5 * row[i], 0.0)  # for two equals rounding may give -1e-16
    return True


@kernel
def _inverse(L, G):
    """Writes the inverse of L L' to G, both (d, d)."""
    d = len(L)
    for column in range(d):
        for r in range(d):
            total = 1.0 if r == column else 0.0
            for k in range(r):
                total -= L[r, k] * G[k, column]
            G[r, column] = total / L[r, r]
        for r in range(d - 1, -1, -1):
            total = G[r, column]
            for k in range(r + 1, d):
                total -= L[k, r] * G[k, column]
            G[r, column] = total / L[r, r]


@kernel
def share_out(table, w, v, temperature, weighted, share):
    """Writes the shares (L, n) of least objective, given the costs, and returns the objective."""
    if temperature == 0.0:
        return _to_the_nearest(table, w, share)
    count, n = table.shape
    total, prior, objective = w.sum(), np.zeros(count), 0.0
    if weighted:
        for j in range(count):
            prior[j] = np.log(v[j] / total)
    for i in range(n):
        largest, parts = -np.inf, 0.0
        for j in range(count):
            share[j, i] = prior[j] - table[j, i] / temperature
            largest = max(largest, share[j, i])
        for j in range(count):
            share[j, i] = np.exp(share[j, i] - largest)
            parts += share[j, i]
        for j in range(count):
            share[j, i] *= w[i] / parts
        objective -= w[i] * temperature * (largest + np.log(parts))
    return objective


@kernel
def _to_the_nearest(table, w, share):
    """`share_out` without entropy: every component whole to the Gaussian of least cost, the first among
    equals."""
    objective = 0.0
    for i in range(len(w)):
        nearest = 0
        for j in range(len(table)):
            share[j, i] = 0.0
            if table[j, i] < table[nearest, i]:
                nearest = j
        share[nearest, i] = w[i]
        objective += w[i] * table[nearest, i]
    return objective
