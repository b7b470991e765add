"""Validation of arguments at public functions: each check raises a ValueError that names the argument.

An array that fits a kernel is taken as it is, one that can be converted is converted, any other is refused:
a kernel trusts the shapes it is given and is compiled once more for every kind of array.
"""

from numbers import Real

import numpy as np

from gmr_gym.kernels import kernel

DOUBLE = np.dtype(float)
HEAVIEST = 1e300  # limit of the sum of all weights, so that no merged weight exceeds it
BLOCK = 64  # covariances factored together
LEAST_PIVOT = 1e-15  # a pivot below this fraction of its diagonal entry may be rounding alone


def doubles(name: str, a, at: str = "") -> np.ndarray:
    """The array-like in float64, C-ordered and writeable: as it is where it already fits, else a copy.

    Parameters
    ----------
    name : str
        Name of the argument, for the error message.
    a : array_like
    at : str
        Prefix of the name.

    Raises
    ------
    ValueError
        Naming the argument, for a masked entry or an entry that is not a real number.
    """
    if type(a) is np.ndarray and a.dtype == DOUBLE and a.flags.carray:
        return a
    try:
        given = np.ma.asarray(a)
    except (TypeError, ValueError):
        raise ValueError(
            f"{at}{name} must be an array of real numbers, but its rows differ in length"
        ) from None
    if given.dtype.kind not in "fiub":
        raise ValueError(f"{at}{name} must be an array of real numbers, got dtype {given.dtype}")
    if np.ma.is_masked(given):
        raise ValueError(f"{at}{name} must have no masked entries; leave out the masked components")
    return np.require(given.data, DOUBLE, ["C", "A", "W", "E"])


def refuse_unsound(at: str, w: np.ndarray, m: np.ndarray, P: np.ndarray) -> None:
    """Raise the ValueError that says what is wrong with a mixture that is not `sound`; `at` is the prefix
    of its names."""
    if w.ndim != 1:
        raise ValueError(f"{at}w must have shape (n,), got {w.shape}")
    if m.ndim != 2 or len(m) != len(w) or m.shape[1] == 0:
        raise ValueError(f"{at}m must have shape (n, d) with n = len(w) = {len(w)}, got {m.shape}")
    if P.shape != (*m.shape, m.shape[1]):
        raise ValueError(f"{at}P must have shape {(*m.shape, m.shape[1])} to fit m, got {P.shape}")
    if not ((w >= 0) & (w <= HEAVIEST)).all() or not w.sum() <= HEAVIEST:
        raise ValueError(f"{at}w must be finite and non-negative, and sum to no more than {HEAVIEST:g}")
    if not np.isfinite(m).all():
        raise ValueError(f"{at}m must be finite")
    for i, covariance in enumerate(P):
        check_covariance(f"{at}P[{i}]", covariance)


def check_covariance(name: str, P: np.ndarray) -> None:
    """Raise ValueError naming the argument unless P (d, d) is symmetric positive definite."""
    if P.ndim != 2 or P.shape[0] != P.shape[1]:
        raise ValueError(f"{name} must be a square matrix, got shape {P.shape}")
    if not np.isfinite(P).all():
        raise ValueError(f"{name} must be finite")
    if not np.allclose(P, P.T, rtol=1e-9, atol=1e-12 * np.abs(P).max(initial=0.0)):
        raise ValueError(f"{name} must be symmetric, got {P.tolist()}; pass (P + P.T) / 2")
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        least = np.linalg.eigvalsh(P)[0]
        raise ValueError(
            f"{name} must be positive definite, but its least eigenvalue is {least:.3g}"
        ) from None


@kernel
def sound(w, m, P):
    """Whether weights (n,), means (n, d) and covariances (n, d, d) fit each other, the weights are finite
    and not negative, the means finite, and the covariances symmetric and positive definite."""
    n, d = m.shape
    if d == 0 or len(w) != n or P.shape[0] != n or P.shape[1] != d or P.shape[2] != d:
        return False
    good, symmetric, total, flat = True, True, 0.0, m.reshape(-1)
    for i in range(n):
        good &= w[i] >= 0.0
        total += w[i]
    good &= total <= HEAVIEST
    for i in range(n * d):
        good &= abs(flat[i]) < np.inf
    A = np.empty((d * (d + 1) // 2, BLOCK))  # lower triangles, one entry a row
    for start in range(0, n, BLOCK):
        k, block, q = min(BLOCK, n - start), P[start : start + BLOCK], 0
        for r in range(d):
            row = A[q]
            for c in range(r + 1):
                row = A[q]
                for j in range(k):
                    row[j] = block[j, r, c]
                    symmetric &= row[j] == block[j, c, r]
                q += 1
            for j in range(k):
                good &= row[j] < np.inf
        good &= _definite(A, block, k, d)
    return good and (symmetric or _nearly_symmetric(P))


@kernel(inline="always")
def _definite(A, P, n, d):
    """Whether the first n matrices of P are positive definite beyond their rounding, by LDL'. A (d (d +
    1) / 2, BLOCK) holds their lower triangles, one entry a row, and is overwritten."""
    positive = True
    for k in range(d):
        pivot = A[k * (k + 3) // 2]
        for j in range(n):
            positive &= pivot[j] > LEAST_PIVOT * P[j, k, k]
            pivot[j] = 1.0 / pivot[j]
        for r in range(k + 1, d):
            below = A[r * (r + 1) // 2 + k]
            for c in range(k + 1, r + 1):
                target, beside = A[r * (r + 1) // 2 + c], A[c * (c + 1) // 2 + k]
                for j in range(n):
                    target[j] -= below[j] * pivot[j] * beside[j]
    return positive


@kernel
def _nearly_symmetric(P):
    """Whether every matrix (d, d) of P is symmetric to rounding."""
    d = P.shape[1]
    for i in range(len(P)):
        A, largest = P[i], 0.0
        for r in range(d):
            for c in range(d):
                if not abs(A[r, c]) < np.inf:  # any difference would be within rounding
                    return False
                largest = max(largest, abs(A[r, c]))
        for r in range(d):
            for c in range(r):
                if not abs(A[r, c] - A[c, r]) <= 1e-9 * min(abs(A[r, c]), abs(A[c, r])) + 1e-12 * largest:
                    return False
    return True


def _check_positive(**values: float) -> None:
    for name, value in values.items():
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive and finite, got {value}")


def check_choice(name: str, choice: str, choices: tuple[str, ...]) -> None:
    """Raise ValueError naming the argument unless the choice is one of `choices`."""
    if choice not in choices:
        raise ValueError(f"{name} must be one of {', '.join(choices)}, got {choice!r}")


def check_whole(name: str, value: int, least: int) -> None:
    """Raise ValueError naming the argument unless it is a whole number, at least `least`."""
    if isinstance(value, bool) or not isinstance(value, Real) or not value % 1 == 0:
        raise ValueError(f"{name} must be a whole number, got {value!r}")
    if value < least:
        raise ValueError(f"{name} must be at least {least}, got {value}")


LEAST_DENSITY = float(np.finfo(float).tiny)  # of clutter; below it digits are lost or the inverse overflows


def check_probability(name: str, value: float) -> None:
    """Raise ValueError naming the argument unless value lies in (0, 1]."""
    if not 0 < value <= 1:
        raise ValueError(f"{name} must lie in (0, 1], got {value}")


def check_density(name: str, value: float) -> None:
    """Raise ValueError naming the argument unless value is a finite clutter density, large enough to
    divide by."""
    if not LEAST_DENSITY <= value < np.inf:
        raise ValueError(
            f"{name} must be positive and finite, {LEAST_DENSITY:.3g} or more, got {value}; where there is "
            "no clutter pass a very small density, so that a second detection can be a false alarm"
        )


UNLIMITED = 2**62  # components: no limit


def check_count(count: int, name: str = "components") -> int:
    """The count as an int, at most `UNLIMITED`, which kernels can still take.

    Parameters
    ----------
    count : int
        By default the budget of components.
    name : str
        Name of the argument, for the error message.

    Raises
    ------
    ValueError
        Naming the argument, unless it is a whole number of at least 1.
    """
    if not isinstance(count, Real) or not count >= 1:
        raise ValueError(f"{name} must be at least 1, got {count!r}")
    if count % 1 != 0:
        raise ValueError(f"{name} must be a whole number, got {count!r}")
    return min(int(count), UNLIMITED)


def check_flag(name: str, value: bool) -> bool:
    """The value; ValueError naming the argument unless it is True or False."""
    if not isinstance(value, bool):
        raise ValueError(f"{name} must be True or False, got {value!r}")
    return value


def check_not_negative(name: str, value: float) -> float:
    """The threshold as a float; ValueError naming the argument unless it is a number of at least 0."""
    if not isinstance(value, Real) or not value >= 0:
        raise ValueError(f"{name} must be a number, at least 0, got {value!r}")
    return float(value)


def check_loss_bound(bound: float) -> float:
    """The bound of a relative loss as a float; ValueError unless it lies in [0, 1]."""
    if not isinstance(bound, Real) or not 0 <= bound <= 1:
        raise ValueError(f"loss_bound must lie in [0, 1], got {bound!r}")
    return float(bound)


def check_limits(prune_weight: float, max_hypotheses: int, give_up_ratio: float = np.inf) -> None:
    """Raise ValueError naming the first invalid limit of a tracker's work."""
    if not 0 <= prune_weight < np.inf:
        raise ValueError(f"prune_weight must be non-negative and finite, got {prune_weight}")
    if not max_hypotheses >= 1 or max_hypotheses % 1 != 0:
        raise ValueError(f"max_hypotheses must be a whole number, at least 1, got {max_hypotheses}")
    if not give_up_ratio > 0:
        raise ValueError(f"give_up_ratio must be positive, got {give_up_ratio}")
