"""Closed-form distances between two Gaussians and between two mixtures."""

import numpy as np
from numba import njit

from gmr_gym.mixture import Mixture

BLOCK = 128  # matrices factored together: few enough to stay in the first-level cache

# ---- between the Gaussians N(m1, P1) and N(m2, P2): means (d,), covariances (d, d) ----


def kullback_leibler(m1, P1, m2, P2) -> float:
    """Divergence of N(m2, P2) from N(m1, P1), the expected log ratio under the first; >= 0."""
    L1, L2 = np.linalg.cholesky(P1), np.linalg.cholesky(P2)
    A = np.linalg.solve(L2, L1)  # A A' is P1 in the coordinates that make P2 the identity
    y = np.linalg.solve(L2, np.subtract(m1, m2))
    divergence = 0.5 * (np.sum(A * A) + y @ y - len(y)) - np.log(np.diag(A)).sum()
    return max(float(divergence), 0.0)  # rounding leaves two equal Gaussians near -1e-16


def bhattacharyya(m1, P1, m2, P2) -> float:
    """Minus the log of the integral of sqrt(N1 N2), >= 0 (Bhattacharyya 1943)."""
    d2, log_volume = _mean_shape(m1, P1, m2, P2)
    return d2 / 8 + log_volume


def hellinger(m1, P1, m2, P2) -> float:
    """Hellinger distance, sqrt(1 - integral of sqrt(N1 N2)), in [0, 1]."""
    return float(np.sqrt(-np.expm1(-bhattacharyya(m1, P1, m2, P2))))


def correlation(m1, P1, m2, P2) -> float:
    """Correlation of two densities, <N1, N2> / sqrt(<N1, N1> <N2, N2>), in [0, 1]; 1 iff equal."""
    d2, log_volume = _mean_shape(m1, P1, m2, P2)
    return float(np.exp(-d2 / 4 - log_volume))


def wasserstein(m1, P1, m2, P2) -> float:
    """2-Wasserstein distance, in the unit of the means (Olkin and Pukelsheim 1982).

    The covariance part is |L1 - L2 U| over rotations U, least at the polar factor of L2' L1:
    equal to the usual trace formula, without its cancellation when P1 is close to P2.
    """
    L1, L2 = np.linalg.cholesky(P1), np.linalg.cholesky(P2)
    X, _, Y = np.linalg.svd(L2.T @ L1)
    return float(np.hypot(np.linalg.norm(np.subtract(m1, m2)), np.linalg.norm(L1 - L2 @ X @ Y)))


def _mean_shape(m1, P1, m2, P2):
    """Squared Mahalanobis distance of the means under S = (P1 + P2) / 2, and
    log(|S| / sqrt(|P1| |P2|)) / 2 >= 0, what the difference in shape alone costs."""
    L, L1, L2 = np.linalg.cholesky([np.add(P1, P2) / 2, P1, P2])
    y = np.linalg.solve(L, np.subtract(m1, m2))
    half = np.log([np.diag(L), np.diag(L1), np.diag(L2)]).sum(axis=1)  # log |.| / 2
    return float(y @ y), max(float(half[0] - (half[1] + half[2]) / 2), 0.0)  # rounding as above


# ---- between mixtures; weights need not sum to 1 ----


def inner_product(p: Mixture, q: Mixture) -> float:
    """Integral of p(x) q(x) over all x; 0 when the two are out of each other's reach."""
    return float(p.w @ products(pack(p.m, p.P), pack(q.m, q.P)) @ q.w)


def integral_squared_difference(p: Mixture, q: Mixture) -> float:
    """Integral of (p(x) - q(x))^2, Jff + Jgg - 2 Jfg (Zhang 2014, eq. 3), >= 0.

    Good to about 1e-16 (Jff + Jgg), whatever the difference itself.
    Departs: the line below eq. 3 prints + Jfg, which is not the square it expands.
    """
    return max(inner_product(p, p) + inner_product(q, q) - 2 * inner_product(p, q), 0.0)


def normalised_integral_squared_difference(p: Mixture, q: Mixture) -> float:
    """Integral squared difference over Jff + Jgg, in [0, 1]: 1 when p and q nowhere overlap."""
    scale = max(p.w.max(), q.w.max())  # the ratio is free of it; tiny weights would underflow
    p, q = p._replace(w=p.w / scale), q._replace(w=q.w / scale)
    return integral_squared_difference(p, q) / (inner_product(p, p) + inner_product(q, q))


# ---- the integral of a product of two Gaussians, N(m1; m2, P1 + P2), many at a time ----
#
# A Gaussian is packed into a column (T,), T = d (d + 1) / 2 + d: the lower triangle of its
# covariance row by row, then its mean, which is the lower triangle of the bordered matrix
# [[P, m], [m', .]] without its corner. Many are the columns of (T, n): the component axis comes
# last, so that the compiler factors several matrices at once.


def pack(m: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Columns (T, n) of n Gaussians with means m (n, d) and covariances P (n, d, d)."""
    rows, columns = np.tril_indices(m.shape[1])
    return np.ascontiguousarray(np.vstack([P[:, rows, columns].T, m.T]), dtype=float)


def unpack(columns: np.ndarray, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Means (n, d) and covariances (n, d, d) of packed columns (T, n)."""
    rows, cols = np.tril_indices(d)
    P = np.empty((columns.shape[1], d, d))
    P[:, rows, cols] = P[:, cols, rows] = columns[:-d].T
    return columns[-d:].T.copy(), P


def products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Integrals (n, k) of the products of the Gaussians packed in a (T, n) and in b (T, k)."""
    return np.array([products_with(x, b, b.shape[1]) for x in a.T])


@njit(cache=True, error_model="numpy")
def products_with(x, b, n):
    """Products (n,) of the one Gaussian packed in x (T,) with the first n columns of b."""
    T = len(b)
    out = np.empty(n)
    for start in range(0, n, BLOCK):
        k = min(BLOCK, n - start)
        bordered = np.empty((T + 1, k))
        for t in range(T):
            row, total = b[t, start : start + k], bordered[t]
            # covariances add up, means are taken apart
            y = x[t] if t < T - dimension(T) else -x[t]
            for i in range(k):
                total[i] = row[i] + y
        _density_at_border(out[start : start + k], bordered)
    return out


@njit(cache=True, error_model="numpy")
def products_of_columns(a, b, n):
    """Products (n,) of column i of a with column i of b, for the first n."""
    T = len(b)
    bordered = np.empty((T + 1, n))
    for t in range(T):
        x, row, total = a[t], b[t], bordered[t]
        sign = 1.0 if t < T - dimension(T) else -1.0
        for i in range(n):
            total[i] = row[i] + sign * x[i]
    out = np.empty(n)
    _density_at_border(out, bordered)
    return out


@njit(cache=True, error_model="numpy")
def dimension(T):
    """The d of packed columns of length T = d (d + 3) / 2."""
    return int(np.sqrt(2.0 * T + 2.25) - 1.0)


@njit(cache=True, error_model="numpy")
def _density_at_border(out, bordered):
    """N(e; 0, S) of each column [[S, e], [e', .]] of bordered (T + 1, n), which it uses up.

    Cholesky in place turns the border e' into y = L^-1 e, with e' S^-1 e = y'y. Underflows to
    0, never to nan; nan where S is not positive definite.
    """
    n = len(out)
    d = dimension(len(bordered) - 1)
    corner = bordered[len(bordered) - 1]
    for i in range(n):
        corner[i] = 0.0
        out[i] = (2.0 * np.pi) ** (-0.5 * d)
    for c in range(d):
        pivot = bordered[c * (c + 3) // 2]
        for i in range(n):
            pivot[i] = 1.0 / np.sqrt(pivot[i])
            out[i] *= pivot[i]
        for r in range(c + 1, d + 1):
            lead = bordered[r * (r + 1) // 2 + c]
            for i in range(n):
                lead[i] *= pivot[i]
            for k in range(c + 1, r + 1):
                other, target = bordered[k * (k + 1) // 2 + c], bordered[r * (r + 1) // 2 + k]
                for i in range(n):
                    target[i] -= lead[i] * other[i]
    for i in range(n):
        out[i] *= np.exp(0.5 * corner[i])
