"""Mixture reduction: merge what is alike, drop what hardly counts.

Every reducer takes a Mixture and returns (Mixture, origin): origin (n,) is the output index that
each input component flowed into, -1 where it was dropped. Merging keeps the total weight, mean and
covariance; pruning and capping lower the weight and leave rescaling to `normalised`. A component
of weight zero is always dropped, and nothing stays nothing. Raises ValueError for a mixture that
is not `checked`.
"""

from dataclasses import dataclass
from numbers import Real

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.merge_cost import cost_of_all
from gmr_gym.merging import merge_greedily
from gmr_gym.mixture import Mixture, checked, match_groups, moments, root_determinants
from gmr_gym.validation import sound

Reduced = tuple[Mixture, np.ndarray]
ANY = 2**62  # components: more than there ever are
TOO_FAR = (
    "components lie too far apart: over more than some 1e8 standard deviations, the covariance of their "
    "merge is lost in rounding"
)


def runnalls(p: Mixture, components: int) -> Reduced:
    """Greedy merging of the pair with the least cost B until `components` remain
    (Runnalls 2007; D'Ortenzio, eq. 13 and section 3.1)."""
    return Greedy(at_least_one(components))(p)


def adaptive(p: Mixture, loss_bound: float, components: int | None = None) -> Reduced:
    """Greedy merging while the relative loss stays within `loss_bound` (alpha in the paper); where
    `components` is given, on past the bound until no more than that many remain
    (D'Ortenzio, eqs. 14-15, Algorithm 1 and section 3.3).

    Departs: the listing lowers m after a merge that it has rejected and has no guard at m = 1; the
    last accepted mixture is returned, and one component is left as it is.
    """
    return greedy(components, loss_bound)(p)


@dataclass(frozen=True)
class Greedy:
    """The two greedy ways of merging as plain numbers, which a compiled scan can take."""

    components: int  # at most so many are left
    loss_bound: float = -1.0  # alpha; negative for Runnalls, who stops at `components`

    def __call__(self, p: Mixture) -> Reduced:
        *merged, origin = merge_by_cost(*checked(p), self.components, self.loss_bound)
        return _definite(Mixture(*merged)), origin


def greedy(components: int | None, loss_bound: float) -> Greedy:
    """Checked Greedy of `adaptive`; ValueError for a loss outside [0, 1] and for no component at all."""
    if not 0 <= loss_bound <= 1:
        raise ValueError(f"loss_bound must lie in [0, 1], got {loss_bound}")
    return Greedy(ANY if components is None else at_least_one(components), float(loss_bound))


def capping(p: Mixture, components: int) -> Reduced:
    """The `components` heaviest, the earlier first among equals (D'Ortenzio, section 3.3)."""
    p, components = checked(p), at_least_one(components)
    return _kept(p, among_heaviest(p.w, components) & (p.w > 0))


def prune(p: Mixture, weight: float) -> Reduced:
    """Drops what weighs less than `weight` (gamma; D'Ortenzio, section 3.4), never the heaviest."""
    p, weight = checked(p), at_least_zero("weight", weight)
    return _kept(p, heavier(p.w, p.w, weight))


def prune_density(p: Mixture, density: float) -> Reduced:
    """Drops what has w / sqrt|P| below `density` (gamma~, in units of 1 / sqrt|P|: s^2/m^4 for a
    planar position and velocity), never the heaviest (D'Ortenzio, eq. 16)."""
    p, density = checked(p), at_least_zero("density", density)
    return _kept(p, heavier(p.w, p.w / root_determinants(p.P), density))


def heaviest(p: Mixture, weight: float, most: int) -> Reduced:
    """What weighs at least `weight`, and of that no more than the `most` heaviest: `prune` and
    `capping` in one, for the hypotheses that are to enter a reduction."""
    return entering(checked(p), at_least_zero("weight", weight), at_least_one(most, "most"))


def entering(p: Mixture, weight: float, most: int) -> Reduced:
    """`heaviest` for a mixture made here."""
    return _kept(p, among_heaviest(p.w, most) & heavier(p.w, p.w, weight))


def salmond(p: Mixture, components: int, distance: float = 0.0) -> Reduced:
    """Joining: merges the pair with the least d^2 = wi wj / (wi + wj) (mi - mj)' P^-1 (mi - mj), P
    the covariance of the whole mixture, while more than `components` remain or d^2 is below
    `distance` (Salmond 1990, section 4.1). Raises ValueError for a negative distance."""
    components, distance = at_least_one(components), at_least_zero("distance", distance)
    q, place = weighing(p)
    if len(q.w) <= (components if distance == 0 else 1):
        return q, place
    return _merged(q, place, _joining(q.w / q.w.sum(), whitened(q), components, distance))


def west(p: Mixture, components: int) -> Reduced:
    """Merges the lightest component with its nearest neighbour, distances measured by the
    covariance of the whole mixture, until `components` remain (West 1993, section 3)."""
    components = at_least_one(components)
    q, place = weighing(p)
    if len(q.w) <= components:
        return q, place
    return _merged(q, place, _lightest_first(at_unit(q.w), whitened(q), components))


def total_merge_cost(p: Mixture) -> float:
    """Cost of merging everything into one Gaussian: sum of w_i KL(component i || moment match).

    Departs: D'Ortenzio, eq. 14 divides by the total weight; kept undivided it is the sum of the
    costs B of any way of merging down to one, whatever the weights sum to.
    """
    q, _ = weighing(p)
    return float(cost_of_all(*q)[0]) if len(q.w) else 0.0


def check_reduced(reduced, n: int) -> None:
    """Raise ValueError unless a reduction of n components has returned a Mixture and an origin (n,)."""
    try:
        mixture, origin = reduced
        sound = isinstance(mixture, Mixture) and np.shape(origin) == (n,)
    except (TypeError, ValueError):
        sound = False
    if not sound:
        raise ValueError(f"a reduction must return a Mixture and the origin ({n},) of what it was given")


def whitened(p: Mixture) -> np.ndarray:
    """Means (n, d) in coordinates where the whole mixture has unit covariance."""
    mean, P = moments(p)
    try:
        L = np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        raise ValueError(TOO_FAR) from None
    return np.linalg.solve(L, (p.m - mean).T).T.copy()


def at_least_one(count: int, name: str = "components") -> int:
    """A count, by default the budget of components, checked, and no more than kernels can take, ANY;
    ValueError naming it unless it is a whole number of at least 1."""
    if not isinstance(count, Real) or not count >= 1:
        raise ValueError(f"{name} must be at least 1, got {count!r}")
    if count % 1 != 0:
        raise ValueError(f"{name} must be a whole number, got {count!r}")
    return min(int(count), ANY)


def at_least_zero(name: str, value: float) -> float:
    """A threshold, checked; ValueError naming it unless it is a number that is not negative."""
    if not isinstance(value, Real) or not value >= 0:
        raise ValueError(f"{name} must be a number, at least 0, got {value!r}")
    return float(value)


def weighing(p: Mixture) -> Reduced:
    """The checked mixture without what weighs nothing: itself, where all of it weighs something."""
    p = checked(p)
    kept = p.w > 0
    return (p, np.arange(len(kept))) if kept.all() else _kept(p, kept)


def at_unit(w: np.ndarray) -> np.ndarray:
    """The weights w (n,) times the power of two, which rounds nothing, that brings the largest just below 1:
    products of tiny ones do not underflow."""
    return np.ldexp(w, -np.frexp(w.max())[1])


def grouped(p: Mixture, group: np.ndarray, count: int) -> Mixture:
    """Moment match of each of `count` groups of a checked mixture; none of them empty.

    Raises ValueError where the covariance of one has drowned in the distance between its members."""
    return _definite(match_groups(p, group, count))


def through(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Origin (n,) of a reduction of what another has left."""
    return np.append(second, -1)[first]


def _definite(q: Mixture) -> Mixture:
    """The mixture; ValueError where a covariance is none any more."""
    if not sound(*q):
        raise ValueError(TOO_FAR)
    return q


def _kept(p: Mixture, kept: np.ndarray) -> Reduced:
    *selected, origin = selected_by(*p, kept)
    return Mixture(*selected), origin


def _merged(p: Mixture, place: np.ndarray, group: np.ndarray) -> Reduced:
    """Moment match of each group of components: group (n,) holds the index of a member. The origin is of the
    mixture that p is left of by place."""
    used, origin = np.unique(group, return_inverse=True)
    return grouped(p, origin, len(used)), through(place, origin)


@kernel(inline="always")
def merge_by_cost(w, m, P, components, loss_bound):
    """`adaptive`, or `runnalls` for a negative bound: w, m, P and origin (n,) of what is left."""
    w, m, P, alive = selected_by(w, m, P, heavier(w, w, 0.0))
    if len(w) <= 1 or (loss_bound < 0.0 and len(w) <= components):
        return w, m, P, alive
    # at a bound of 1 the rounding of the sum must not spare the last merge
    budget = np.inf if loss_bound == 1.0 else -1.0
    if 0.0 <= loss_bound < 1.0:
        budget = loss_bound * cost_of_all(w, m, P)[0]
    w, m, P, origin = merge_greedily(w, m, P, components, budget)
    for i in range(len(alive)):
        if alive[i] >= 0:
            alive[i] = origin[alive[i]]
    return w, m, P, alive


@kernel
def heavier(w, measure, threshold):
    """Which components (n,) have a weight and a measure of at least the threshold: the heaviest if none,
    should it weigh anything."""
    n, found, first = len(w), False, 0
    kept = np.zeros(n, np.bool_)
    for i in range(n):
        kept[i] = measure[i] >= threshold and w[i] > 0.0
        found |= kept[i]
        first = i if w[i] > w[first] else first
    if not found and n > 0:
        kept[first] = w[first] > 0.0
    return kept


@kernel
def among_heaviest(w, most):
    """Which components (n,) are the `most` heaviest, the earlier first among equals."""
    n = len(w)
    kept = np.zeros(n, np.bool_)
    if n <= most:
        for i in range(n):
            kept[i] = True
        return kept
    # numbers that are not negative are in the order of their bits: the largest that `most` of them reach
    bits, low, high = np.empty(n, np.int64), np.int64(0), np.int64(0)
    for i in range(n):
        bits[i] = np.float64(w[i]).view(np.int64)
        high = max(high, bits[i])
    while low < high:
        middle = high - (high - low) // 2
        reached = 0
        for i in range(n):
            reached += bits[i] >= middle
        if reached >= most:
            low = middle
        else:
            high = middle - 1
    left = most
    for i in range(n):
        kept[i] = bits[i] > low
        left -= kept[i]
    for i in range(n):
        if left > 0 and bits[i] == low:
            kept[i] = True
            left -= 1
    return kept


@kernel
def selected_by(w, m, P, kept):
    """Components that are kept, and the place (n,) of each, -1 where it is not."""
    n, d = m.shape
    count = 0
    for i in range(n):
        count += kept[i]
    w_out, m_out, P_out = np.empty(count), np.empty((count, d)), np.empty((count, d, d))
    origin = np.full(n, -1)
    at = 0
    for i in range(n):
        if kept[i]:
            w_out[at], origin[i] = w[i], at
            for r in range(d):
                m_out[at, r] = m[i, r]
                for c in range(d):
                    P_out[at, r, c] = P[i, r, c]
            at += 1
    return w_out, m_out, P_out, origin


@kernel
def _joining(w, y, components, distance):
    """Groups (n,) of Salmond's joining from the weights and whitened means y (n, d)."""
    n, d = y.shape
    w, y, group, alive = w.copy(), y.copy(), np.arange(n), np.arange(n)
    while len(alive) > 1:
        best, first, second = np.inf, alive[0], alive[1]
        for a in range(1, len(alive)):
            for b in range(a):
                i, j = alive[a], alive[b]
                d2 = 0.0
                for r in range(d):
                    d2 += (y[i, r] - y[j, r]) ** 2
                d2 *= w[i] / (w[i] + w[j]) * w[j]
                if d2 < best:
                    best, first, second = d2, j, i
        if len(alive) <= components and best >= distance:
            break
        _join(first, second, w, y, group)
        alive = alive[alive != second]
    return group


@kernel
def _lightest_first(w, y, components):
    """Groups (n,) of West's merging from the weights and whitened means y (n, d)."""
    w, y, group, alive = w.copy(), y.copy(), np.arange(len(w)), np.arange(len(w))
    while len(alive) > components:
        lightest = alive[w[alive].argmin()]
        best, nearest = np.inf, alive[0] if alive[0] != lightest else alive[1]
        for i in alive:
            d2 = ((y[i] - y[lightest]) ** 2).sum()
            if i != lightest and d2 < best:
                best, nearest = d2, i
        _join(nearest, lightest, w, y, group)
        alive = alive[alive != lightest]
    return group


@kernel
def _join(i, j, w, y, group):
    y[i] = (w[i] * y[i] + w[j] * y[j]) / (w[i] + w[j])
    w[i] += w[j]
    group[group == j] = i
