r"""Reduction by the composite transportation divergence, descended by majorisation and minimisation.

Notes
-----
The components f_i of a mixture, of weights w_i, are shared out among the Gaussians g_j of the reduced one so
that with a cost c of two Gaussians

.. math::

    \sum_{ij} \pi_{ij} \, c(f_i, g_j) + \lambda \sum_{ij} \pi_{ij} \log \frac{\pi_{ij}}{w_i},
    \qquad \pi_{ij} \ge 0, \quad \sum_j \pi_{ij} = w_i

is least. A sweep makes every g_j the barycentre of what it has been given, of that weight, and then shares
the components out anew. Neither step raises the sum.
"""

from typing import NamedTuple
from warnings import warn

import numpy as np

from gmr_gym.checks import check_choice, check_count, check_not_negative, sound
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into
from gmr_gym.mixture import Mixture, mean_and_covariance
from gmr_gym.reduction.protocol import TOO_FAR, Reduced, at_unit, through
from gmr_gym.reduction.pruning import weighing
from gmr_gym.reduction.runnalls import runnalls

COSTS = ("kl",)
SWEEPS = 1000  # at most; the hard form converges within some ten
CONVERGED = 1e-10  # relative fall of the objective in a sweep


class Descent(NamedTuple):
    """Where the sweeps have ended."""

    share: np.ndarray  # (L, n) weight of each component given to each Gaussian
    v: np.ndarray  # (L,) weights of the Gaussians, 0 where all components have left one
    m: np.ndarray  # (L, d)
    P: np.ndarray  # (L, d, d)
    objective: np.ndarray  # (sweeps,)


def transportation(p: Mixture, components: int, cost: str = "kl", entropy: float = 0.0, starts: int = 1):
    """Least composite transportation divergence, by sweeps from the groups of `runnalls`.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    cost : {"kl"}
        Cost of two Gaussians.
    """
    check_choice("cost", cost, COSTS)
    entropy, starts = check_not_negative("entropy", entropy), check_count(starts, "starts")
    q, place = weighing(p)
    if len(q.w) <= check_count(components):
        return q, place
    return _reduced(q, place, _descended(q, int(components), cost, entropy, starts), entropy > 0)


def _descended(p, components, cost, entropy, starts) -> Descent:
    _, group = runnalls(p, components)
    return _descent(p, group, components, 0.0, False)


def _descent(p: Mixture, group: np.ndarray, components: int, temperature: float, weighted: bool) -> Descent:
    """Sweeps from groups (n,) of the components, of any weights."""
    w = at_unit(p.w)
    share = np.where(group == np.arange(components)[:, None], w, 0.0)
    mean = mean_and_covariance(p)[0]
    good, v, m, P, objective = _sweeps(w, p.m - mean, p.P, share, temperature, weighted)
    if not good:
        raise ValueError(TOO_FAR)
    if len(objective) == SWEEPS:
        warn(f"transportation has not converged within {SWEEPS} sweeps", UserWarning, 4)
    unit = np.ldexp(1.0, int(np.frexp(p.w.max())[1]))
    return Descent(share, unit * v, m + mean, P, unit * objective)


def _reduced(p: Mixture, place: np.ndarray, descent: Descent, soft: bool) -> Reduced:
    left = descent.v > 0
    q = Mixture(descent.v[left], descent.m[left], descent.P[left])
    if not sound(*q):
        raise ValueError(TOO_FAR)
    origin = descent.share[left].argmax(axis=0)
    return q, through(place, origin)


@kernel
def _sweeps(w, m, P, share, temperature, weighted):
    """Whether every covariance stayed definite, the weights, means and covariances of the Gaussians, and the
    objective by sweep; share (L, n) is overwritten."""
    count, (n, d) = len(share), m.shape
    v, c, S = np.empty(count), np.empty((count, d)), np.empty((count, d, d))
    columns, log_det = _columns(m, P)
    table, objective, total = np.empty((count, n)), np.empty(SWEEPS), w.sum()
    before, sweep = np.inf, 0
    while sweep < SWEEPS:
        _moment_matches(share, m, P, v, c, S)
        if not _divergences(columns, log_det, v, c, S, table):
            return False, v, c, S, objective[:sweep]
        after = _share_out(table, w, v, temperature, weighted, share)
        objective[sweep] = after
        sweep += 1
        if not before - after > CONVERGED * (abs(after) + temperature * total):
            break
        before = after
    _moment_matches(share, m, P, v, c, S)
    return True, v, c, S, objective[:sweep]


@kernel
def _columns(m, P):
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
def _moment_matches(share, m, P, v, c, S):
    """Writes the weight, mean and covariance of every row of shares."""
    n, d = m.shape
    v[:], c[:], S[:] = 0.0, 0.0, 0.0
    for j in range(len(share)):
        for i in range(n):
            v[j] += share[j, i]
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
def _divergences(columns, log_det, v, c, S, table):
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
def _share_out(table, w, v, temperature, weighted, share):
    """Writes the shares of least objective, given the costs (L, n), and returns the objective."""
    count, n = table.shape
    total, objective = w.sum(), 0.0
    for i in range(n):
        nearest = 0
        for j in range(count):
            if table[j, i] < table[nearest, i]:
                nearest = j
        least = table[nearest, i]
        if temperature == 0.0:
            for j in range(count):
                share[j, i] = 0.0
            share[nearest, i] = w[i]
        else:
            parts = 0.0
            for j in range(count):
                part = np.exp((least - table[j, i]) / temperature)
                share[j, i] = part * v[j] / total if weighted else part
                parts += share[j, i]
            for j in range(count):
                share[j, i] *= w[i] / parts
            least -= temperature * np.log(parts)
        objective += w[i] * least
    return objective
