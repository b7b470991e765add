"""Projections of a scan's posterior on tracks: what they keep, and what they make most alike."""

from itertools import permutations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from gmr_gym.filters import projections
from gmr_gym.filters.mixture_tracks import MixtureTracks, associate, reduce, started
from gmr_gym.filters.projections import momb, permuted, tomb, variational
from gmr_gym.filters.target_densities import Densities, as_mixture, outputs
from gmr_gym.filters.undetected_targets import appear, intensity_of
from gmr_gym.mixture import Mixture, mixture, moments
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.models.switching import sticky_switching

CORNER = np.array([-300.0, -300.0])
KAPPA = 1e-3


def told(modes=1):
    births = mixture([0.2], [[0.0, 0, 0, 0]], [np.diag([200.0, 200, 9, 9])])
    return multi_target_model(
        tuple(constant_velocity(1.0, 1.0 + 4.0 * q) for q in range(modes)), position_sensor(3.0), 0.9, 0.98,
        births, uniform_clutter(CORNER, -CORNER, 10.0), switching=sticky_switching(0.9, modes),
    )  # fmt: skip


def drawn(seed, n=3, modes=1, rows=1, reach=5.0):
    rng = np.random.default_rng(seed)
    A = rng.normal(0, 2, (n * rows, modes, 4, 4))
    densities = Densities(
        rng.dirichlet(np.ones(modes), n * rows), rng.normal(0, reach, (n * rows, modes, 4)),
        A @ A.swapaxes(2, 3) + np.eye(4),
    )  # fmt: skip
    weight = rng.dirichlet(np.ones(rows), n).ravel()
    return MixtureTracks(
        rng.uniform(0.5, 1.0, n), np.arange(n), densities, weight, np.repeat(np.arange(n), rows)
    )


def scanned(tracks, model, z):
    """Tracks after a scan, and what it begins."""
    log_kappa = np.log(np.full(len(z), KAPPA))
    appearing = appear(intensity_of(model.births, model), model, z, log_kappa)
    found = associate(tracks, model, z, log_kappa + appearing.log_ratio)
    new, detection = started(appearing, z, found.unassigned, 0.0)
    return found, new._replace(label=100 + new.label), detection


def intensity(tracks):
    """Of targets, over modes and states."""
    mass = tracks.existence[tracks.track] * tracks.weight
    p = as_mixture(tracks.densities)
    return Mixture(np.repeat(mass, tracks.densities.w.shape[1]) * p.w, p.m, p.P)


@pytest.mark.parametrize("project", [momb, variational])
@pytest.mark.parametrize(("n", "modes", "rows"), [(2, 1, 1), (4, 1, 1), (3, 2, 1), (3, 1, 3)])
def test_every_projection_keeps_the_intensity(project, n, modes, rows):
    model, tracks = told(modes), drawn(n, n, modes, rows)
    posterior = scanned(tracks, model, np.random.default_rng(1).normal(0, 6, (4, 2)))
    one, other = tomb(*posterior), project(*posterior)
    for got in (other, reduce(other, None)):
        assert intensity(got).w.sum() == pytest.approx(intensity(one).w.sum(), rel=1e-10)
        for a, b in zip(moments(intensity(got)), moments(intensity(one)), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
    assert (other.existence <= 1).all()
    np.testing.assert_allclose(np.bincount(other.track, other.weight), 1.0, rtol=1e-12)


def test_a_track_of_a_detection_exists_as_the_formula_says():
    z = np.random.default_rng(2).normal(0, 5, (3, 2))
    found, new, detection = scanned(drawn(5), told(), z)
    got = momb(found, new, detection)
    p = np.zeros((3, 3))
    p[found.pairs.track, found.pairs.detection] = found.pairs.assigned
    expected = p.sum(axis=0)
    expected[detection] += new.existence
    np.testing.assert_allclose(got.existence[:3], expected, rtol=1e-10)
    r = drawn(5).existence
    np.testing.assert_allclose(got.existence[3:], found.missed * r * 0.1 / (1 - 0.9 * r), rtol=1e-10)
    named = got.label[got.label >= 0]
    assert len(set(named)) == len(named) and set(named) <= {0, 1, 2, 100, 101, 102}


def test_targets_that_share_nothing_are_projected_alike():
    tracks = drawn(6, 2, reach=3.0)
    tracks.densities.m[1, 0, :2] += 250.0
    posterior = scanned(tracks, told(), np.array([[1.0, 2.0], [251.0, 249.0], [2.0, -3.0]]))
    one, other = reduce(tomb(*posterior), None), reduce(variational(*posterior), None)
    for a, b in zip((one.existence, *one.densities), (other.existence, *other.densities), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)


@pytest.mark.parametrize("seed", range(8))
def test_the_divergence_falls_from_round_to_round(seed):
    rng = np.random.default_rng(seed)
    n, h, u = 3, 12, 9
    local = np.array([[3 * i + rng.integers(3) for i in range(n)] for _ in range(h)])
    densities = drawn(seed, u, 2).densities
    share, costs = permuted(rng.dirichlet(np.ones(h)), local, rng.uniform(0.2, 1.0, u), densities)
    assert len(costs) > 1 and (np.diff(costs) <= 1e-9).all()
    np.testing.assert_allclose(share.sum(), n, rtol=1e-12)


def test_one_event_is_left_as_it_is():
    densities, local = drawn(0, 3).densities, np.array([[0, 1, 2]])
    share, costs = permuted(np.ones(1), local, np.array([1.0, 0.5, 0.8]), densities)
    np.testing.assert_array_equal(share, np.eye(3))
    assert costs[-1] == pytest.approx(0.0, abs=1e-6)


def test_of_all_permutations_the_least_is_taken():
    rng = np.random.default_rng(3)
    cost, local = rng.normal(0, 1, (8, 4)), rng.permuted(np.tile(np.arange(8), (6, 1)), axis=1)[:, :4]
    got = projections._permutations(cost, local)
    for hypotheses, places in zip(local, got, strict=True):
        sums = [cost[hypotheses, list(p)].sum() for p in permutations(range(4))]
        assert cost[hypotheses, places].sum() == pytest.approx(min(sums), rel=1e-12)


def test_a_divergence_is_the_integral():
    def of(w, m, P):
        return Densities(np.array([w]), np.array(m)[None, :, None], np.array(P)[None, :, None, None])

    f, q, r, s = of([0.3, 0.7], [0.0, 2.0], [1.0, 2.0]), of([0.6, 0.4], [1.0, 1.5], [3.0, 1.5]), 0.8, 0.6
    got = projections._divergences(np.array([r]), *f, np.array([s]), *q)[0, 0]

    def part(x, mode):
        a, b = (
            share * p.w[0, mode] * norm(p.m[0, mode, 0], np.sqrt(p.P[0, mode, 0, 0])).pdf(x)
            for share, p in ((r, f), (s, q))
        )
        return a * np.log(a / b)

    expected = (1 - r) * np.log((1 - r) / (1 - s)) + sum(
        quad(part, -15, 15, args=(mode,), epsabs=1e-10)[0] for mode in range(2)
    )
    assert got == pytest.approx(expected, rel=1e-8)


def test_two_targets_in_one_place_part_where_tracks_may_be_permuted():
    # alike but for rounding; their detections lie 20 m apart
    one = drawn(8, 1)
    densities = Densities(*(np.repeat(part, 2, axis=0) for part in one.densities))
    densities.m[:, 0, :2] = [[-0.1, 0.0], [0.1, 0.0]]
    densities.P[:] = np.diag([50.0, 50.0, 4.0, 4.0])
    tracks = MixtureTracks(np.full(2, 0.99), np.arange(2), densities, np.ones(2), np.arange(2))
    posterior = scanned(tracks, told(), np.array([[-10.0, 0.0], [10.0, 0.0]]))

    def apart(got):
        x = outputs(reduce(got, None).densities)[0][:2, 0]
        return abs(x[1] - x[0])

    assert apart(tomb(*posterior)) < 1.0 and apart(variational(*posterior)) > 12.0
