"""Closed-form distances between two Gaussians and between two mixtures."""

import numpy as np

from gmr_gym.checks import check_covariance, doubles
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, checked

BLOCK = 128  # matrices factored together: few enough to stay in the first-level cache

# ---- between the Gaussians N(m1, P1) and N(m2, P2): means (d,), covariances (d, d) ----


def kullback_leibler(m1, P1, m2, P2) -> float:
    r"""Kullback-Leibler divergence of N(m2, P2) from N(m1, P1), in nats, >= 0.

    It is the expectation under the first Gaussian of log(N1 / N2).

    Parameters
    ----------
    m1, m2 : array_like (d,)
        Means.
    P1, P2 : array_like (d, d)
        Covariances.

    Raises
    ------
    ValueError
        Naming the argument, for a shape that does not fit, and for a mean or covariance that is not valid.

    Notes
    -----
    .. math::

        \mathrm{KL}(N_1 \,\|\, N_2) = \tfrac{1}{2} \left( \operatorname{tr}(P_2^{-1} P_1)
        + (m_1 - m_2)^T P_2^{-1} (m_1 - m_2) - d + \log \frac{|P_2|}{|P_1|} \right)

    Examples
    --------
    >>> kullback_leibler([0.0], [[1.0]], [1.0], [[1.0]])
    0.5
    >>> round(kullback_leibler([0.0], [[1.0]], [0.0], [[4.0]]), 4)
    0.3181
    """
    m1, P1, m2, P2 = _two_gaussians(m1, P1, m2, P2)
    L1, L2 = np.linalg.cholesky(P1), np.linalg.cholesky(P2)
    A = np.linalg.solve(L2, L1)  # A A' is P1 in the coordinates that make P2 the identity
    y = np.linalg.solve(L2, np.subtract(m1, m2))
    divergence = 0.5 * (np.sum(A * A) + y @ y - len(y)) - np.log(np.diag(A)).sum()
    return max(float(divergence), 0.0)  # for two equal Gaussians rounding may give -1e-16


def bhattacharyya(m1, P1, m2, P2) -> float:
    """Bhattacharyya distance: minus the log of the integral of sqrt(N1 N2), >= 0.

    Parameters
    ----------
    m1, m2 : array_like (d,)
        Means.
    P1, P2 : array_like (d, d)
        Covariances.

    Raises
    ------
    ValueError
        Naming the argument, for a shape that does not fit, and for a mean or covariance that is not valid.

    References
    ----------
    Bhattacharyya 1943.

    Examples
    --------
    >>> bhattacharyya([0.0], [[1.0]], [2.0], [[1.0]])
    0.5
    """
    d2, log_volume = _mean_shape(m1, P1, m2, P2)
    return d2 / 8 + log_volume


def hellinger(m1, P1, m2, P2) -> float:
    """Hellinger distance, sqrt(1 - integral of sqrt(N1 N2)), in [0, 1].

    Parameters
    ----------
    m1, m2 : array_like (d,)
        Means.
    P1, P2 : array_like (d, d)
        Covariances.

    Raises
    ------
    ValueError
        Naming the argument, for a shape that does not fit, and for a mean or covariance that is not valid.
    """
    return float(np.sqrt(-np.expm1(-bhattacharyya(m1, P1, m2, P2))))


def correlation(m1, P1, m2, P2) -> float:
    """Correlation of two densities, <N1, N2> / sqrt(<N1, N1> <N2, N2>), in [0, 1].

    It is 1 only for equal densities.

    Parameters
    ----------
    m1, m2 : array_like (d,)
        Means.
    P1, P2 : array_like (d, d)
        Covariances.

    Raises
    ------
    ValueError
        Naming the argument, for a shape that does not fit, and for a mean or covariance that is not valid.
    """
    d2, log_volume = _mean_shape(m1, P1, m2, P2)
    return float(np.exp(-d2 / 4 - log_volume))


def wasserstein(m1, P1, m2, P2) -> float:
    """2-Wasserstein distance, in the unit of the means.

    Parameters
    ----------
    m1, m2 : array_like (d,)
        Means.
    P1, P2 : array_like (d, d)
        Covariances.

    Raises
    ------
    ValueError
        Naming the argument, for a shape that does not fit, and for a mean or covariance that is not valid.

    Notes
    -----
    The covariance part is `|L1 - L2 U|` minimised over rotations U, attained at the polar factor of L2' L1.
    It equals the usual trace formula without its cancellation when P1 is close to P2.

    References
    ----------
    Olkin and Pukelsheim 1982.

    Examples
    --------
    >>> round(wasserstein([0.0], [[1.0]], [3.0], [[25.0]]), 9)
    5.0
    """
    m1, P1, m2, P2 = _two_gaussians(m1, P1, m2, P2)
    L1, L2 = np.linalg.cholesky(P1), np.linalg.cholesky(P2)
    X, _, Y = np.linalg.svd(L2.T @ L1)
    return float(np.hypot(np.linalg.norm(np.subtract(m1, m2)), np.linalg.norm(L1 - L2 @ X @ Y)))


def _mean_shape(m1, P1, m2, P2):
    """Squared Mahalanobis distance of the means under S = (P1 + P2) / 2, and the part due to the
    difference in shape, log(|S| / sqrt(|P1| |P2|)) / 2 >= 0."""
    m1, P1, m2, P2 = _two_gaussians(m1, P1, m2, P2)
    L, L1, L2 = np.linalg.cholesky([np.add(P1, P2) / 2, P1, P2])
    y = np.linalg.solve(L, np.subtract(m1, m2))
    half = np.log([np.diag(L), np.diag(L1), np.diag(L2)]).sum(axis=1)  # log |.| / 2
    return float(y @ y), max(float(half[0] - (half[1] + half[2]) / 2), 0.0)  # rounding as above


def _two_gaussians(m1, P1, m2, P2):
    """The four arguments, checked, in float64. Raises ValueError naming the wrong one."""
    m1, P1 = doubles("m1", m1), doubles("P1", P1)
    m2, P2 = doubles("m2", m2), doubles("P2", P2)
    for number, m, P in (("1", m1, P1), ("2", m2, P2)):
        if m.ndim != 1 or m.shape != m1.shape or not np.isfinite(m).all():
            raise ValueError(f"m{number} must be finite and have shape {m1.shape[:1]}, got {m}")
        if P.shape != 2 * m1.shape:
            raise ValueError(f"P{number} must have shape {2 * m1.shape} to fit m1, got {P.shape}")
        check_covariance(f"P{number}", P)
    return m1, P1, m2, P2


# ---- between mixtures; weights need not sum to 1 ----


def inner_product(p: Mixture, q: Mixture) -> float:
    """Integral of p(x) q(x) over all x; 0 where p and q lie too far apart to overlap.

    Parameters
    ----------
    p, q : Mixture
        Of the same dimension; the weights need not sum to 1.

    Raises
    ------
    ValueError
        For mixtures that fail `checked` or differ in dimension.
    """
    return _inner_product(*_two_mixtures(p, q))


def integral_squared_difference(p: Mixture, q: Mixture) -> float:
    r"""Integral of (p(x) - q(x))^2 over all x, >= 0.

    Accurate to about 1e-16 (Jff + Jgg), however small the difference itself is.

    Parameters
    ----------
    p, q : Mixture
        Of the same dimension; the weights need not sum to 1.

    Raises
    ------
    ValueError
        For mixtures that fail `checked` or differ in dimension.

    Notes
    -----
    .. math::

        \int (p(x) - q(x))^2 \, dx = J_{ff} + J_{gg} - 2 J_{fg}, \qquad
        J_{fg} = \sum_{i, j} v_i w_j \, N(m_i; \mu_j, P_i + \Sigma_j)

    with p the mixture of weights v, means m and covariances P, and q that of w, mu and Sigma; J_ff and J_gg
    likewise.

    Departs: the line below Zhang's eq. 3 prints + Jfg, which is not the expansion of the square.

    References
    ----------
    Zhang 2014, eq. 3.

    Examples
    --------
    >>> from gmr_gym.mixture import gaussian
    >>> round(integral_squared_difference(gaussian([0.0], [[1.0]]), gaussian([1.0], [[1.0]])), 4)
    0.1248
    """
    return _difference_and_sum(*_two_mixtures(p, q))[0]


def normalised_integral_squared_difference(p: Mixture, q: Mixture) -> float:
    """Integral squared difference divided by Jff + Jgg, in [0, 1].

    It is 1 when p and q overlap nowhere, and 0 when both have weight zero.

    Parameters
    ----------
    p, q : Mixture
        Of the same dimension; the weights need not sum to 1.

    Raises
    ------
    ValueError
        For mixtures that fail `checked` or differ in dimension.

    References
    ----------
    Zhang 2014, eq. 3.
    """
    p, q = _two_mixtures(p, q)
    scale = max(p.w.max(initial=0.0), q.w.max(initial=0.0))
    if scale == 0.0:
        return 0.0
    # the ratio does not depend on it; tiny weights would underflow
    difference, total = _difference_and_sum(p._replace(w=p.w / scale), q._replace(w=q.w / scale))
    if not 0.0 < total < np.inf:
        raise ValueError(
            "the squares of p and q have integrals outside the range of floats: choose units nearer to the "
            "spread of the states"
        )
    return difference / total


def _two_mixtures(p, q):
    p, q = checked(p), checked(q, "q.")
    if q.m.shape[1] != p.m.shape[1]:
        raise ValueError(f"q has {q.m.shape[1]} dimensions, but p has {p.m.shape[1]}")
    return p, q


def _inner_product(p, q):
    return float(p.w @ products(pack(p.m, p.P), pack(q.m, q.P)) @ q.w)


def _difference_and_sum(p, q):
    """max(Jff + Jgg - 2 Jfg, 0), and Jff + Jgg."""
    total = _inner_product(p, p) + _inner_product(q, q)
    return max(total - 2 * _inner_product(p, q), 0.0), total


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
    return np.array([products_with(x, b, b.shape[1]) for x in a.T]).reshape(a.shape[1], b.shape[1])


@kernel
def products_with(x, b, n):
    """Products (n,) of the one Gaussian packed in x (T,) with the first n columns of b."""
    T = len(b)
    mean = T - dimension(T)  # the row where the means begin
    out = np.empty(n)
    for start in range(0, n, BLOCK):
        k = min(BLOCK, n - start)
        bordered = np.empty((T + 1, k))
        for t in range(T):
            row, total = b[t, start : start + k], bordered[t]
            # covariances are added, means subtracted
            y = x[t] if t < mean else -x[t]
            for i in range(k):
                total[i] = row[i] + y
        _density_at_border(out[start : start + k], bordered)
    return out


@kernel
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


@kernel
def known(product):
    """The product, or 0 where it is not a number: a covariance lost in rounding, of a merge over more
    than 1e8 standard deviations, is of a density too low to overlap with anything."""
    return product if product < np.inf else 0.0


@kernel
def dimension(T):
    """The d of packed columns of length T = d (d + 3) / 2."""
    return int(np.sqrt(2.0 * T + 2.25) - 1.0)


@kernel
def _density_at_border(out, bordered):
    """N(e; 0, S) of each column [[S, e], [e', .]] of bordered (T + 1, n), which is overwritten.

    Underflows to 0, never to nan; nan where S is not positive definite.
    """
    d = dimension(len(bordered) - 1)
    if d == 6:
        _eliminate_six(out, bordered)
    else:
        eliminate(out, bordered, d)
    peak = (2.0 * np.pi) ** (-0.5 * d)
    for i in range(len(out)):
        out[i] *= peak
    times_exponentials(out, bordered[0], bordered[1])


@kernel
def eliminate(out, bordered, d):
    """Set out to det(S)^(-1/2) and the first row to -e' S^-1 e / 2.

    L D L' of the bordered matrix in place, without square roots, leaves -e' S^-1 e in the corner.
    """
    n = len(out)
    corner, ratio = bordered[len(bordered) - 1], np.empty(n)
    for i in range(n):
        corner[i] = 0.0
        out[i] = 1.0
    for c in range(d):
        pivot = bordered[c * (c + 3) // 2]
        for i in range(n):
            out[i] *= pivot[i] if pivot[i] > 0.0 else np.nan
            pivot[i] = 1.0 / pivot[i]
        for r in range(c + 1, d + 1):
            lead = bordered[r * (r + 1) // 2 + c]
            for i in range(n):
                ratio[i] = lead[i] * pivot[i]
            for k in range(c + 1, r + 1):
                other, target = bordered[k * (k + 1) // 2 + c], bordered[r * (r + 1) // 2 + k]
                for i in range(n):
                    target[i] -= ratio[i] * other[i]
    exponent = bordered[0]
    for i in range(n):
        exponent[i] = 0.5 * corner[i]
        out[i] = 1.0 / np.sqrt(out[i])


@kernel
def _eliminate_six(out, bordered):
    """`eliminate` for six states (planar position, velocity, acceleration), unrolled: everything stays
    in registers, which takes half the time."""
    b = bordered
    for i in range(len(out)):
        s00 = b[0, i]
        s10, s11 = b[1, i], b[2, i]
        s20, s21, s22 = b[3, i], b[4, i], b[5, i]
        s30, s31, s32, s33 = b[6, i], b[7, i], b[8, i], b[9, i]
        s40, s41, s42, s43, s44 = b[10, i], b[11, i], b[12, i], b[13, i], b[14, i]
        s50, s51, s52, s53, s54, s55 = b[15, i], b[16, i], b[17, i], b[18, i], b[19, i], b[20, i]
        e0, e1, e2, e3, e4, e5 = b[21, i], b[22, i], b[23, i], b[24, i], b[25, i], b[26, i]
        v0 = 1.0 / s00
        r1, r2, r3, r4, r5 = s10 * v0, s20 * v0, s30 * v0, s40 * v0, s50 * v0
        s11 -= r1 * s10
        s21, s22 = s21 - r2 * s10, s22 - r2 * s20
        s31, s32, s33 = s31 - r3 * s10, s32 - r3 * s20, s33 - r3 * s30
        s41, s42, s43, s44 = s41 - r4 * s10, s42 - r4 * s20, s43 - r4 * s30, s44 - r4 * s40
        s51, s52, s53 = s51 - r5 * s10, s52 - r5 * s20, s53 - r5 * s30
        s54, s55 = s54 - r5 * s40, s55 - r5 * s50
        e1, e2, e3, e4, e5 = e1 - r1 * e0, e2 - r2 * e0, e3 - r3 * e0, e4 - r4 * e0, e5 - r5 * e0
        v1 = 1.0 / s11
        r2, r3, r4, r5 = s21 * v1, s31 * v1, s41 * v1, s51 * v1
        s22 -= r2 * s21
        s32, s33 = s32 - r3 * s21, s33 - r3 * s31
        s42, s43, s44 = s42 - r4 * s21, s43 - r4 * s31, s44 - r4 * s41
        s52, s53, s54, s55 = s52 - r5 * s21, s53 - r5 * s31, s54 - r5 * s41, s55 - r5 * s51
        e2, e3, e4, e5 = e2 - r2 * e1, e3 - r3 * e1, e4 - r4 * e1, e5 - r5 * e1
        v2 = 1.0 / s22
        r3, r4, r5 = s32 * v2, s42 * v2, s52 * v2
        s33 -= r3 * s32
        s43, s44 = s43 - r4 * s32, s44 - r4 * s42
        s53, s54, s55 = s53 - r5 * s32, s54 - r5 * s42, s55 - r5 * s52
        e3, e4, e5 = e3 - r3 * e2, e4 - r4 * e2, e5 - r5 * e2
        v3 = 1.0 / s33
        r4, r5 = s43 * v3, s53 * v3
        s44 -= r4 * s43
        s54, s55 = s54 - r5 * s43, s55 - r5 * s53
        e4, e5 = e4 - r4 * e3, e5 - r5 * e3
        v4 = 1.0 / s44
        r5 = s54 * v4
        s55 -= r5 * s54
        e5 -= r5 * e4
        v5 = 1.0 / s55
        d2 = e0 * e0 * v0 + e1 * e1 * v1 + e2 * e2 * v2 + e3 * e3 * v3 + e4 * e4 * v4 + e5 * e5 * v5
        least = min(min(min(s00, s11), min(s22, s33)), min(s44, s55))
        determinant = (s00 * s11 * s22) * (s33 * s44 * s55)
        b[0, i] = -0.5 * d2
        out[i] = 1.0 / np.sqrt(determinant) if least > 0.0 else np.nan


@kernel
def eliminate_four(out, bordered):
    """`eliminate` for four states (planar position and velocity), unrolled as for six."""
    b = bordered
    for i in range(len(out)):
        s00 = b[0, i]
        s10, s11 = b[1, i], b[2, i]
        s20, s21, s22 = b[3, i], b[4, i], b[5, i]
        s30, s31, s32, s33 = b[6, i], b[7, i], b[8, i], b[9, i]
        e0, e1, e2, e3 = b[10, i], b[11, i], b[12, i], b[13, i]
        v0 = 1.0 / s00
        r1, r2, r3 = s10 * v0, s20 * v0, s30 * v0
        s11 -= r1 * s10
        s21, s22 = s21 - r2 * s10, s22 - r2 * s20
        s31, s32, s33 = s31 - r3 * s10, s32 - r3 * s20, s33 - r3 * s30
        e1, e2, e3 = e1 - r1 * e0, e2 - r2 * e0, e3 - r3 * e0
        v1 = 1.0 / s11
        r2, r3 = s21 * v1, s31 * v1
        s22 -= r2 * s21
        s32, s33 = s32 - r3 * s21, s33 - r3 * s31
        e2, e3 = e2 - r2 * e1, e3 - r3 * e1
        v2 = 1.0 / s22
        r3 = s32 * v2
        s33 -= r3 * s32
        e3 -= r3 * e2
        d2 = e0 * e0 * v0 + e1 * e1 * v1 + e2 * e2 * v2 + e3 * e3 / s33
        least = min(min(s00, s11), min(s22, s33))
        b[0, i] = -0.5 * d2
        out[i] = 1.0 / np.sqrt(s00 * s11 * s22 * s33) if least > 0.0 else np.nan


@kernel
def times_exponentials(out, x, room):
    """Multiplies out (n,) by exp(x) for x < 700, to the last bits; room (n,) is workspace.

    A call of the library's exponential would prevent the loops from being vectorised.
    """
    n = len(out)
    bits = room.view(np.int64)
    shift = 6755399441055744.0  # 1.5 * 2^52: added to y, it leaves the nearest integer in the low bits
    for i in range(n):
        x[i] = -708.0 if x[i] < -708.0 else x[i]
        room[i] = x[i] * 1.4426950408889634 + shift
        k = room[i] - shift
        # exp(x) = 2^k exp(r), |r| < 0.35; log 2 in two parts keeps the digits of r
        r = (x[i] - k * 6.93147180369123816490e-01) - k * 1.90821492927058770002e-10
        # written out, since a loop over the coefficients would not be vectorised over i
        series = 1 / 39916800 + r * (1 / 479001600 + r * (1 / 6227020800))
        series = 1 / 40320 + r * (1 / 362880 + r * (1 / 3628800 + r * series))
        series = 1 / 120 + r * (1 / 720 + r * (1 / 5040 + r * series))
        series = 0.5 + r * (1 / 6 + r * (1 / 24 + r * series))
        out[i] *= 1.0 + r * (1.0 + r * series)
    for i in range(n):
        bits[i] = (bits[i] + 1023) << 52  # 2^k
    for i in range(n):
        out[i] = 0.0 if x[i] == -708.0 else out[i] * room[i]
