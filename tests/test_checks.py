"""Every public reduction and distance takes what is a mixture in any kind of array, and nothing else."""

from functools import partial

import numpy as np
import pytest
from reference import moment_match, random_mixture

from gmr_gym.mixture import Mixture, checked, collapsed, log_density, matched, mixture, moments
from gmr_gym.reduction import distances
from gmr_gym.reduction.dissimilarity import MEASURES, dissimilarity
from gmr_gym.reduction.properties import PROPERTIES
from gmr_gym.reduction.pruning import prune, prune_and_cap, prune_density
from gmr_gym.reduction.registry import REDUCERS
from gmr_gym.reduction.runnalls import adaptive, total_merge_cost
from gmr_gym.reduction.salmond_west import salmond, whitened
from gmr_gym.reduction.vo_ma import vo_ma

DROPPING = {
    "capping": partial(REDUCERS["capping"], components=2),
    "prune": partial(prune, weight=0.1),
    "prune_density": partial(prune_density, density=0.1),
    "heaviest": partial(prune_and_cap, weight=1e-9, max_components=2),
    "vo_ma": partial(vo_ma, components=2),
}
MERGING = {name: partial(reduce, components=2) for name, reduce in REDUCERS.items() if name != "capping"} | {
    "adaptive to nothing": partial(adaptive, loss_bound=1.0),
    "salmond by distance": partial(salmond, components=9, distance=0.3),
}
REDUCING = MERGING | DROPPING
OTHERS = {
    "moments": moments,
    "collapsed": collapsed,
    "whitened": whitened,
    "total_merge_cost": total_merge_cost,
    "matched": lambda p: matched(p, np.array([0, 1, 0, 1, -1, 0]), 2),
    "log_density": lambda p: log_density(p, np.zeros((2, 4))),
    "inner_product": lambda p: distances.inner_product(p, p),
    "isd": lambda p: distances.integral_squared_difference(p, GOOD),
    "normalised isd": lambda p: distances.normalised_integral_squared_difference(p, GOOD),
} | {f"dissimilarity {measure}": partial(dissimilarity, measure=measure) for measure in MEASURES}
DOORS = REDUCING | OTHERS


def whole_numbers(seed):
    """A mixture whose numbers are all whole, and so the same in any kind of array."""
    rng = np.random.default_rng(seed)
    A = rng.integers(-2, 3, (6, 4, 4))
    P = A @ A.transpose(0, 2, 1) + 3 * np.eye(4)
    return Mixture(rng.integers(1, 9, 6).astype(float), rng.integers(-9, 9, (6, 4)).astype(float), P)


GOOD = whole_numbers(0)


def flattened(result):
    """The arrays of a result, of whatever it is made."""
    return [b for a in result for b in flattened(a)] if isinstance(result, tuple) else [np.asarray(result)]


def read_only(a):
    a = a.copy()
    a.setflags(write=False)
    return a


KINDS = {
    "float32": np.float32,
    "integers": lambda a: a.astype(int),
    "read-only": read_only,
    "Fortran order": lambda a: np.asfortranarray(a).copy(order="F"),
    "every second": lambda a: np.repeat(a, 2, axis=0)[::2],
    "lists": np.ndarray.tolist,
    "nothing masked": np.ma.array,
    "the other byte order": lambda a: a.astype(a.dtype.newbyteorder()),
}


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_a_mixture_in_any_kind_of_array_is_that_mixture(door, kind):
    given = Mixture(*map(kind, GOOD))
    for got, wanted in zip(flattened(door(given)), flattened(door(GOOD)), strict=True):
        assert got.dtype == wanted.dtype
        np.testing.assert_array_equal(got, wanted)


def test_no_kernel_is_compiled_for_another_kind_of_array():
    from gmr_gym.reduction.runnalls import merge_by_cost

    kinds = len(getattr(REDUCERS["runnalls"](GOOD, 2) and merge_by_cost, "signatures", []))
    for kind in KINDS.values():
        REDUCERS["runnalls"](Mixture(*map(kind, GOOD)), 2)
    assert len(getattr(merge_by_cost, "signatures", [])) == kinds


def changed(name, at, value):
    a = getattr(GOOD, name).copy()
    a[at] = value
    return GOOD._replace(**{name: a})


BAD = {
    "w of one too few": (GOOD._replace(w=GOOD.w[:5]), "p.m must have shape .* len.w. = 5"),
    "m of two more": (
        GOOD._replace(m=np.zeros((8, 4)), P=np.tile(np.eye(4), (8, 1, 1))),
        "p.m must have shape",
    ),
    "w in two dimensions": (GOOD._replace(w=GOOD.w[:, None]), r"p.w must have shape \(n,\), got \(6, 1\)"),
    "m in one": (GOOD._replace(m=GOOD.m[:, 0]), r"p.m must have shape \(n, d\)"),
    "m of no dimension": (GOOD._replace(m=np.zeros((6, 0)), P=np.zeros((6, 0, 0))), "p.m must have shape"),
    "one P": (GOOD._replace(P=np.eye(4)), r"p.P must have shape \(6, 4, 4\)"),
    "smaller P": (GOOD._replace(P=GOOD.P[:, :3, :3]), r"p.P must have shape \(6, 4, 4\)"),
    "nan weight": (changed("w", 1, np.nan), "p.w must be finite and non-negative"),
    "negative weight": (changed("w", 5, -1e-9), "p.w must be finite and non-negative"),
    "infinite weight": (changed("w", 0, np.inf), "p.w must be finite and non-negative"),
    "nan mean": (changed("m", (2, 3), np.nan), "p.m must be finite"),
    "infinite mean": (changed("m", (5, 0), -np.inf), "p.m must be finite"),
    "nan covariance": (changed("P", (3, 1, 1), np.nan), r"p.P\[3\] must be finite"),
    "nan beside": (changed("P", (3, 0, 1), np.nan), r"p.P\[3\] must be finite"),
    "infinite beside": (changed("P", (3, 0, 1), -np.inf), r"p.P\[3\] must be finite"),
    "infinite covariance": (changed("P", (0, 0, 0), np.inf), r"p.P\[0\] must be finite"),
    "indefinite": (changed("P", 4, np.diag([1.0, -1, -1, 1])), r"p.P\[4\] must be positive definite"),
    "singular": (changed("P", 2, 0.0), r"p.P\[2\] must be positive definite"),
    "asymmetric": (changed("P", (1, 0, 3), 0.1 + GOOD.P[1, 3, 0]), r"p.P\[1\] must be symmetric"),
    "complex": (GOOD._replace(m=GOOD.m + 0j), "p.m must be an array of real numbers, got dtype complex128"),
    "objects": (
        GOOD._replace(w=GOOD.w.astype(object)),
        "p.w must be an array of real numbers, got dtype object",
    ),
    "strings": (GOOD._replace(w=["1"] * 6), "p.w must be an array of real numbers"),
    "ragged": (GOOD._replace(m=[[1.0, 2.0], [3.0]]), "p.m must be an array of real numbers"),
    "masked": (
        GOOD._replace(w=np.ma.masked_greater(GOOD.w, GOOD.w.min())),
        "p.w must have no masked entries",
    ),
    "masked row": (GOOD._replace(m=[np.ma.masked_less(row, 0) for row in GOOD.m]), "p.m must have no masked"),
    "nothing like it": (3, "p must be a Mixture"),
}


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD)
@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
def test_what_is_no_mixture_is_refused_by_name(door, bad):
    p, message = bad
    with pytest.raises(ValueError, match=message):
        door(p)


def test_the_second_mixture_is_refused_by_its_name_and_for_its_dimension():
    with pytest.raises(ValueError, match=r"q\.w must be finite"):
        distances.inner_product(GOOD, changed("w", 0, -1.0))
    with pytest.raises(ValueError, match="q has 1 dimensions, but p has 4"):
        distances.inner_product(GOOD, mixture([1.0], [[0.0]], [[[1.0]]]))


@pytest.mark.parametrize("distance", [distances.kullback_leibler, distances.wasserstein, distances.hellinger])
def test_gaussians_at_a_distance_are_refused_by_name(distance):
    m, P = np.zeros(2), np.eye(2)
    for wrong, message in (
        ((m[:1], P, m, P), "P1 must have shape"),
        ((m, P, m[:1], P), "m2 must be finite and have shape"),
        ((m, P, m, -P), "P2 must be positive definite"),
        ((m * np.nan, P, m, P), "m1 must be finite"),
        ((m, P + 0j, m, P), "P1 must be an array of real numbers"),
    ):
        with pytest.raises(ValueError, match=message):
            distance(*wrong)
    assert distance(m.tolist(), P.tolist(), m, P) == distance(m, P, m, P) == 0.0


def test_groups_are_refused_that_are_not_of_every_component():
    for group in (np.zeros(5, int), np.zeros(6), np.zeros((6, 1), int)):
        with pytest.raises(ValueError, match="group must hold an integer for each of 6 components"):
            matched(GOOD, group, 1)
    with pytest.raises(ValueError, match="x must have shape"):
        log_density(GOOD, np.zeros((2, 3)))


def test_a_mixture_that_fits_is_taken_as_it_is():
    assert checked(GOOD) is GOOD
    skew = GOOD.P + 1e-13 * np.triu(GOOD.P, 1)  # no more than rounding does
    assert checked(GOOD._replace(P=skew)).P is skew


@pytest.mark.parametrize("n", [0, 1, 5])
@pytest.mark.parametrize("reduce", REDUCING.values(), ids=REDUCING)
def test_nothing_stays_nothing(reduce, n):
    q, origin = reduce(Mixture(np.zeros(n), np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))))
    assert origin.tolist() == n * [-1]
    assert q.w.shape == (0,) and q.m.shape == (0, 3) and q.P.shape == (0, 3, 3)


def test_nothing_costs_nothing_and_has_no_moments():
    p = Mixture(np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    assert total_merge_cost(p) == 0.0 and distances.normalised_integral_squared_difference(p, p) == 0.0
    assert distances.inner_product(p, p) == 0.0
    with pytest.raises(ValueError, match="no component"):
        moments(p)


@pytest.mark.parametrize("reduce", REDUCING.values(), ids=REDUCING)
def test_a_component_of_weight_zero_is_dropped_even_where_there_is_room(reduce):
    p = Mixture(np.array([0.0, 0.0, 0.3]), np.zeros((3, 2)), np.tile(np.eye(2), (3, 1, 1)))
    q, origin = reduce(p)
    assert q.w.tolist() == [0.3] and origin.tolist() == [-1, -1, 0]


def drawn(n=8, d=2, **kwargs):
    return Mixture(*random_mixture(np.random.default_rng(n), n, d, **kwargs))


HOSTILE = {
    "weights of 1e-300": drawn(total=1e-300),
    "weights over 300 decades": drawn()._replace(w=10.0 ** -np.linspace(0, 300, 8)),
    "condition numbers of 1e14": drawn()._replace(P=np.tile(np.diag([1e7, 1e-7]), (8, 1, 1))),
    "one place": drawn()._replace(m=np.zeros((8, 2)), P=np.tile(np.eye(2), (8, 1, 1))),
    "far from the origin": drawn()._replace(m=drawn().m + 1e8),
    "spread over 1e7 m": drawn()._replace(m=1e7 * drawn().m, P=1e2 * drawn().P),
    "variances of 1e-18": drawn(d=6)._replace(m=1e-9 * drawn(d=6).m, P=1e-18 * drawn(d=6).P),
    "four states": drawn(d=4, spread=1e4),
}


@pytest.mark.parametrize("p", HOSTILE.values(), ids=HOSTILE)
@pytest.mark.parametrize("name", REDUCING)
def test_what_is_left_of_a_hostile_mixture_is_a_mixture(name, p):
    q, origin = REDUCING[name](p)
    checked(q)
    if name in MERGING:
        assert q.w.sum() == pytest.approx(p.w.sum(), rel=1e-12) or name == "ise-unscaled"
    if name in PROPERTIES and not PROPERTIES[name].matches:
        return
    assert set(origin) - {-1} == set(range(len(q.w)))
    for i in range(len(q.w)):
        _, mean, covariance = moment_match(*(a[origin == i] for a in p))
        deviation = np.sqrt(np.abs(covariance).max())
        rounding = 1e-9 * deviation + 1e-15 * np.abs(mean).max()  # far from the origin, that of the means
        np.testing.assert_allclose(q.m[i], mean, rtol=0, atol=rounding)
        np.testing.assert_allclose(q.P[i], covariance, rtol=0, atol=rounding * deviation)


UNFIT = {
    "squares that overflow": drawn()._replace(m=1e200 * drawn().m),
    "determinants that underflow": drawn(d=6)._replace(m=1e-30 * drawn(d=6).m, P=1e-60 * drawn(d=6).P),
    "1e9 standard deviations apart": drawn(spread=1e9),
}


@pytest.mark.parametrize("p", UNFIT.values(), ids=UNFIT)
@pytest.mark.parametrize("name", MERGING)
def test_what_floats_cannot_hold_is_refused_in_words_or_reduced_to_a_mixture(name, p):
    try:
        q, _ = MERGING[name](p)
    except ValueError as error:
        assert "too far apart" in str(error) or "choose units nearer" in str(error)
    else:
        checked(q)
        assert q.w.sum() == pytest.approx(p.w.sum(), rel=1e-12) or name == "ise-unscaled"


@pytest.mark.parametrize("reduce", REDUCERS.values(), ids=REDUCERS)
def test_a_budget_beyond_any_count_is_no_limit(reduce):
    np.testing.assert_array_equal(reduce(GOOD, components=1e20)[1], reduce(GOOD, components=len(GOOD.w))[1])


def test_runnalls_refuses_a_merge_whose_covariance_is_lost_in_rounding():
    """1e9 standard deviations apart, in no direction of the axes: what is left is not definite."""
    P = 1e-13 * np.array([[13.01, 9.0], [9.0, 10.01]])
    p = mixture([0.01, 0.1, 0.1], [[57.0, -190.0], [-113.0, -327.0], [-383.0, 189.0]], [P] * 3)
    with pytest.raises(ValueError, match="too far apart"):
        REDUCERS["runnalls"](p, components=2)
