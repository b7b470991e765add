"""Sweeps lower the objective, and end where the sheet of known values and limiting cases say."""

import numpy as np
import pytest
from scipy.integrate import quad
from test_oracles import spent
from test_runnalls import groups, random_mixture

from gmr_gym.experiments.mixtures import crouse
from gmr_gym.mixture import Mixture, collapsed, log_density, mixture, moments, take
from gmr_gym.reduction import transport_descent as module
from gmr_gym.reduction.barycentres import barycentre
from gmr_gym.reduction.distances import integral_squared_difference, kullback_leibler
from gmr_gym.reduction.measures import MEASURES
from gmr_gym.reduction.oracles import transportation_optimum
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.reduction.transport_descent import descent
from gmr_gym.reduction.transportation import dphem, transportation, transportation_objective

FORMS = {
    "hard": transportation,
    "entropy": lambda p, components: transportation(p, components, entropy=3.0),
    "samples": lambda p, components: dphem(p, components, samples=2.0),
}
every_form = pytest.mark.parametrize("reduce", FORMS.values(), ids=FORMS)


def falls(objective):
    """Whether it never rises, but for rounding."""
    return (np.diff(objective) <= 1e-13 * np.abs(objective).max()).all()


def assert_same_moments(q, p):
    assert q.w.sum() == pytest.approx(p.w.sum(), rel=1e-12)
    for ours, theirs in zip(moments(q), moments(p), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


# ---- known values ----


def test_crouse_mixture_by_kl_stays_with_the_groups_of_runnalls():
    q, _ = transportation(crouse(), 5)
    assert integral_squared_difference(crouse(), q) == pytest.approx(0.0266345318, abs=5e-11)
    assert transportation_objective(crouse(), 5)[-1] == pytest.approx(0.14775502, abs=5e-9)


def test_more_starts_find_the_optimum_of_the_mixture_of_crouse():
    objective = transportation_objective(crouse(), 5, starts=5)
    assert objective[-1] == pytest.approx(0.14670576, abs=5e-9)
    _, origin = transportation(crouse(), 5, starts=5)
    assert groups(origin) == groups(transportation_optimum(crouse(), 5)[1])


def test_one_virtual_sample_smooths_the_mixture_of_crouse():
    q, _ = dphem(crouse(), 5, samples=1)
    assert integral_squared_difference(crouse(), q) == pytest.approx(0.0343, abs=5e-5)


@pytest.mark.parametrize(
    ("cost", "ise", "objective"),
    [
        ("kl", 0.026635, 0.147755),
        ("reverse-kl", 0.004245, 0.115835),
        ("wasserstein", 0.019059, 0.010422),
        ("cauchy-schwarz", 0.011556, 0.052722),
        ("isd", 0.009296, 0.186436),
    ],
)
def test_every_cost_leads_crouse_mixture_to_known_values(cost, ise, objective):
    q, _ = transportation(crouse(), 5, cost=cost)
    assert integral_squared_difference(crouse(), q) == pytest.approx(ise, abs=5.1e-7)
    assert transportation_objective(crouse(), 5, cost=cost)[-1] == pytest.approx(objective, abs=5.1e-7)


# ---- the objective ----


@pytest.mark.parametrize("entropy", [0.0, 0.1, 3.0, 1e3])
@pytest.mark.parametrize("seed", range(5))
def test_the_objective_never_rises(entropy, seed):
    p = random_mixture(seed, 20, 2, spread=1.5, total=4.0)
    assert falls(transportation_objective(p, 6, entropy=entropy))


@pytest.mark.parametrize("entropy", [0.0, 0.3, 3.0])
@pytest.mark.parametrize("cost", MEASURES)
def test_the_objective_of_every_cost_never_rises(cost, entropy):
    p = random_mixture(4, 10, 2, spread=1.5, total=4.0)
    objective = transportation_objective(p, 3, cost=cost, entropy=entropy)
    assert falls(objective) and np.isfinite(objective).all()


@pytest.mark.parametrize("samples", [0.5, 5.0])
def test_the_objective_of_virtual_samples_never_rises(samples):
    p = random_mixture(3, 20, 2, spread=1.5, total=4.0)
    found = descent(p, runnalls(p, 6)[1], "kl", 1 / samples, weighted=True)
    assert falls(found.objective) and len(found.objective) > 2
    # the last is the sum that is written out
    q, z = found.reduced, found.share / found.share.sum(axis=0)
    cost = [
        [kullback_leibler(m, P, c, S) for m, P in zip(p.m, p.P, strict=True)]
        for c, S in zip(*q[1:], strict=True)
    ]
    with np.errstate(divide="ignore", invalid="ignore"):
        entropy = np.nan_to_num(np.log(z / (q.w / q.w.sum())[:, None]))
    written = (p.w * z * (np.array(cost) + entropy / samples)).sum()
    assert found.objective[-1] == pytest.approx(written, rel=1e-6)


@pytest.mark.parametrize("seed", range(40))
def test_sweeps_end_between_the_optimum_and_runnalls(seed):
    p = random_mixture(seed, 9, 1 + seed % 4, spread=1.5)
    best, greedy = (spent(p, reduce(p, 4)[1]) for reduce in (transportation_optimum, runnalls))
    ours = transportation_objective(p, 4)[-1]
    assert best - 1e-12 <= ours <= greedy + 1e-12
    assert ours == pytest.approx(spent(p, transportation(p, 4)[1]), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_divergence_bounds_that_of_the_mixtures(seed):
    p = random_mixture(seed, 8, 1, spread=1.5)
    q, _ = transportation(p, 3)

    def integrand(x):
        f, g = log_density(p, [[x]])[0], log_density(q, [[x]])[0]
        return np.exp(f) * (f - g)

    divergence = quad(integrand, -12, 12, points=sorted(p.m[:, 0]), limit=300)[0]
    assert 0 < divergence <= transportation_objective(p, 3)[-1]


# ---- limiting cases ----


def test_no_entropy_to_speak_of_is_none():
    p = random_mixture(0, 20, 2, spread=1.5)
    hard = transportation(p, 6)
    for q, origin in (
        transportation(p, 6, entropy=1e-6),
        dphem(p, 6, samples=1e9),
        dphem(p, 6, samples=np.inf),
    ):
        np.testing.assert_array_equal(origin, hard[1])
        for ours, theirs in zip(q, hard[0], strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("entropy", [1e3, 1e300])
def test_a_large_entropy_leaves_the_moment_match(entropy):
    p = random_mixture(0, 20, 2, spread=1.5, total=3.0)
    q, origin = transportation(p, 6, entropy=entropy)
    assert len(q.w) == 1 and (origin == 0).all()
    for ours, theirs in zip(q, collapsed(p), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("cost", MEASURES)
def test_the_costs_agree_on_the_limiting_cases(cost):
    p = random_mixture(6, 10, 2, spread=1.5)
    whole = barycentre(p, cost)
    for q, _ in (transportation(p, 1, cost=cost), transportation(p, 3, cost=cost, entropy=1e6)):
        assert len(q.w) == 1
        for ours, theirs in zip(q, whole, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-5)
    hard, soft = transportation(p, 3, cost=cost), transportation(p, 3, cost=cost, entropy=1e-6)
    np.testing.assert_array_equal(hard[1], soft[1])
    for ours, theirs in zip(hard[0], soft[0], strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


@every_form
def test_one_component_is_the_moment_match_and_enough_are_left_alone(reduce):
    p = random_mixture(0, 8, 2)
    for ours, theirs in zip(reduce(p, 1)[0], collapsed(p), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)
    q, origin = reduce(p, 8)
    assert all((ours == theirs).all() for ours, theirs in zip(q, p, strict=True))
    assert origin.tolist() == list(range(8))


@pytest.mark.filterwarnings("ignore:the descent")  # expectation maximisation may take its time
@every_form
@pytest.mark.parametrize("d", [1, 3])
def test_weight_mean_and_covariance_are_kept(reduce, d):
    for seed in range(3):
        p = random_mixture(seed, 15, d, spread=1.5, total=7.0)
        assert_same_moments(reduce(p, 4)[0], p)


# ---- invariances ----


@every_form
def test_affine_maps_and_the_order_of_components_change_nothing(reduce):
    p = random_mixture(2, 15, 2, spread=1.5)
    A, b = np.array([[300.0, 20.0], [-0.1, 0.05]]), np.array([1e3, -7.0])
    q, origin = reduce(p, 4)
    mapped, same = reduce(Mixture(p.w, p.m @ A.T + b, A @ p.P @ A.T), 4)
    np.testing.assert_array_equal(origin, same)
    np.testing.assert_allclose(mapped.w, q.w, rtol=1e-6)
    np.testing.assert_allclose(mapped.m, q.m @ A.T + b, rtol=1e-5, atol=1e-3)
    order = np.random.default_rng(1).permutation(15)
    shuffled, where = reduce(take(p, order), 4)
    there = {frozenset(order[list(group)].tolist()) for group in groups(where) if group}
    assert there == groups(origin) - {frozenset()}
    np.testing.assert_allclose(sorted(shuffled.w), sorted(q.w), rtol=1e-6)


@pytest.mark.parametrize("cost", MEASURES)
def test_costs_do_not_see_maps_that_they_allow(cost):
    p = random_mixture(2, 9, 2, spread=1.5)
    rigid = cost == "wasserstein"
    A = np.array([[0.6, -0.8], [0.8, 0.6]]) if rigid else np.array([[30.0, 2.0], [-0.1, 0.5]])
    q, origin = transportation(p, 4, cost=cost)
    mapped, same = transportation(Mixture(p.w, p.m @ A.T + 5.0, A @ p.P @ A.T), 4, cost=cost)
    np.testing.assert_array_equal(origin, same)
    np.testing.assert_allclose(mapped.m, q.m @ A.T + 5.0, rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(mapped.P, A @ q.P @ A.T, rtol=1e-4, atol=1e-4)


def test_two_starts_are_no_worse_and_always_the_same():
    p = random_mixture(5, 15, 2, spread=1.0)
    one, many = (transportation_objective(p, 5, starts=starts)[-1] for starts in (1, 6))
    assert many <= one
    np.testing.assert_array_equal(transportation(p, 5, starts=6)[1], transportation(p, 5, starts=6)[1])


# ---- extremes ----

FAR = mixture([0.4, 0.2, 0.1, 0.3], [[0.0], [0.5], [1.0], [1e8]], [[[1.0]]] * 4)
EXTREMES = {
    "weights over 300 decades": random_mixture(1, 8, 2)._replace(w=10.0 ** -np.linspace(0, 300, 8)),
    "variances over 24 decades": random_mixture(1, 8, 1)._replace(
        P=10.0 ** np.linspace(-12, 12, 8)[:, None, None]
    ),
    "states over 24 decades": random_mixture(1, 8, 2)._replace(P=np.tile(np.diag([1e12, 1e-12]), (8, 1, 1))),
    "1e8 deviations apart": FAR,
    "one of all that is there": take(random_mixture(1, 1, 2), np.zeros(8, int)),
}


@every_form
@pytest.mark.parametrize("p", EXTREMES.values(), ids=EXTREMES)
def test_extremes_leave_a_mixture(reduce, p):
    q, origin = reduce(p, 3)
    assert all(np.isfinite(a).all() for a in q) and (q.w > 0).all() and (origin >= 0).all()
    assert q.w.sum() == pytest.approx(p.w.sum(), rel=1e-12)
    for P in q.P:
        np.linalg.cholesky(P)


def test_a_far_component_keeps_its_gaussian():
    for reduce in FORMS.values():
        q, origin = reduce(FAR, 2)
        assert (
            origin[3] == 1
            and q.m[1, 0] == pytest.approx(1e8)
            and q.P[1, 0, 0] == pytest.approx(1.0, rel=1e-6)
        )


# ---- complaints ----


def test_an_unfinished_descent_is_reported(monkeypatch):
    monkeypatch.setattr(module, "SWEEPS", 2)
    with pytest.warns(UserWarning, match="limit of 2 iterations"):
        dphem(random_mixture(3, 20, 2, spread=1.5), 6, samples=1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cost": "kullback"}, "cost must be one of kl, .*, got 'kullback'"),
        ({"entropy": -1.0}, "entropy must be a number, at least 0, got -1.0"),
        ({"entropy": np.inf}, "entropy must be finite, got inf"),
        ({"starts": 0}, "starts must be at least 1, got 0"),
        ({"starts": 10_001}, "starts must be at most 10000, got 10001"),
        ({"components": 0}, "components must be at least 1, got 0"),
    ],
)
def test_what_makes_no_sense_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        transportation(random_mixture(0, 4, 1), **{"components": 2, **arguments})


@pytest.mark.parametrize("samples", [0, -1.0, np.nan, "3"])
def test_virtual_samples_are_a_positive_number(samples):
    with pytest.raises(ValueError, match="samples must be positive, got"):
        dphem(random_mixture(0, 4, 1), 2, samples=samples)
