"""Mixtures drawn at random: always the same of a seed, and as their distributions say."""

import numpy as np
import pytest

from gmr_gym.evaluation.mixture_problems import random_mixture


def test_a_seed_is_a_mixture():
    first, again, other = random_mixture(3), random_mixture(3), random_mixture(4)
    assert all(np.array_equal(a, b) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first.m, other.m)
    assert random_mixture(0, 7, 2).P.shape == (7, 2, 2)


def test_many_draws_have_the_moments_of_their_distributions():
    drawn = [random_mixture(seed) for seed in range(400)]
    w, m, P = (np.stack(arrays) for arrays in zip(*drawn, strict=True))
    # Dirichlet(1, ..., 1) of ten has the variance 0.1 * 0.9 / 11; a component is one of 4000 draws
    np.testing.assert_allclose(w.sum(axis=1), 1)
    assert w.var() == pytest.approx(0.09 / 11, rel=0.1)
    assert m.mean() == pytest.approx(1.5, abs=0.03) and m.var() == pytest.approx(0.75, rel=0.03)
    assert 0 < m.min() and m.max() < 3
    # Wishart with 5 degrees of freedom and scale I / 50
    np.testing.assert_allclose(P.mean(axis=(0, 1)), np.eye(4) / 10, atol=0.005)
    assert P[..., 0, 0].var() == pytest.approx(2 * 5 / 50**2, rel=0.15)


@pytest.mark.parametrize(("name", "wrong"), [("components", 0), ("dimension", 1.5)])
def test_sizes_are_whole_numbers(name, wrong):
    with pytest.raises(ValueError, match=f"{name} must be"):
        random_mixture(0, **{name: wrong})
