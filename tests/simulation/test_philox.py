"""Numbers that are functions of key and counter: the published words, and the distributions they promise.

All statistical tests are seeded, so that they hold for good or not at all; p-values below one in ten thousand
would be called a failure."""

from itertools import product

import numpy as np
import pytest
from scipy.stats import chisquare, kstest, norm
from scipy.stats import poisson as poisson_law

from gmr_gym.simulation import philox

KEY = np.array([20_261_122, 7], np.uint32)
LEAST = 1e-4


def words(counter, key):
    block = philox.block.py_func if hasattr(philox.block, "py_func") else philox.block
    return [int(word) for word in block(*map(np.uint64, (*counter, *key)))]


def points(n, p, key=KEY, stream=1, at=(0, 0, 0)):
    out = np.empty((n, p))
    low, words = np.zeros(p), philox.buffer_for(n)
    philox.points_into(out, low, np.ones(p), low, np.array(key, np.uint32), stream, at, words)
    return out


def uniforms(n, *args, **kwargs):
    return points(n // 2, 2, *args, **kwargs).ravel()


def counts(rate, n, stream=3):
    return np.array([philox.poisson(rate, KEY, stream, (t, 0, 0)) for t in range(n)])


# kat_vectors of Random123, philox4x32 10
@pytest.mark.parametrize(
    ("counter", "key", "known"),
    [
        ([0] * 4, [0] * 2, "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xA4093822, 0x299F31D0],
            "d16cfe09 94fdcceb 5001e420 24126ea1",
        ),
    ],
)
def test_words_are_the_published_ones(counter, key, known):
    assert words(counter, key) == [int(word, 16) for word in known.split()]


def pair_of(stream, draw, at):
    """Two uniforms of 53 bits, in whole numbers until the last step."""
    a, b, c, d = words(((stream << 28) + draw, *at), KEY)
    return ((a << 32 | b) >> 11) / 2**53, ((c << 32 | d) >> 11) / 2**53


def test_pairs_are_the_words_of_the_counter_two_by_two():
    for draw, at in product((0, 1, 2**28 - 1), ((0, 0, 0), (2**32 - 1, 5, 9))):
        assert philox.pair(KEY, 6, draw, at) == pair_of(6, draw, at)


def test_points_take_two_coordinates_of_a_pair_and_the_next_of_the_next_stream():
    at = (2**32 - 1, 5, 9)
    for n, p in product((0, 1, 2, 7, 64, 1001), (1, 2, 3, 4)):
        expected = [
            sum((pair_of(6 + c, i, at) for c in range(2)), ())[:p] for i in range(n)
        ]  # fmt: skip
        np.testing.assert_array_equal(points(n, p, KEY, 6, at), np.array(expected).reshape(n, p))
    out, low, high = np.full((9, 3), np.nan), np.array([-5.0, 1.0, 10.0]), np.array([5.0, 2.0, 40.0])
    centre = np.array([100.0, 0.0, -7.0])
    philox.points_into(out[:8], low, high, centre, KEY, 6, at, philox.buffer_for(8))
    np.testing.assert_allclose(out[:8], centre + low + (high - low) * points(8, 3, KEY, 6, at), rtol=1e-15)
    assert np.isnan(out[8]).all()


def test_uniforms_reach_zero_but_never_one():
    word = np.uint64(0xFFFFFFFF)
    convert = philox.uniform.py_func if hasattr(philox.uniform, "py_func") else philox.uniform
    assert convert(word, word) == 1 - 2.0**-53 and convert(np.uint64(0), np.uint64(0)) == 0


def test_another_key_stream_scan_or_square_has_other_numbers():
    base = uniforms(1000)
    others = [
        uniforms(1000, (KEY[0] + 1, KEY[1])), uniforms(1000, (KEY[0], KEY[1] + 1)), uniforms(1000, stream=2),
        uniforms(1000, at=(1, 0, 0)), uniforms(1000, at=(0, 1, 0)), uniforms(1000, at=(0, 0, 1)),
    ]  # fmt: skip
    drawn = np.concatenate([base, *others])
    assert len(np.unique(drawn)) == len(drawn)  # two alike by chance: 3e-9
    for other in others:
        # five standard errors of a correlation of independent numbers, 1 / sqrt(n)
        assert abs(np.corrcoef(base, other)[0, 1]) < 5 / np.sqrt(1000)


def test_uniforms_are_uniform_along_draws_and_along_scans():
    along = uniforms(100_000)
    across = np.concatenate([points(1, 3, at=(t, 0, 0)).ravel() for t in range(30_000)])
    for u in (along, across):
        assert (u >= 0).all() and (u < 1).all()
        assert kstest(u, "uniform").pvalue > LEAST
        pairs = np.histogram2d(u[:-1:2], u[1::2], bins=16, range=[(0, 1)] * 2)[0]
        assert chisquare(pairs.ravel()).pvalue > LEAST
        low_bits = (u * 2**53).astype(np.int64) % 256
        assert chisquare(np.bincount(low_bits, minlength=256)).pvalue > LEAST


def test_normals_are_standard_and_independent():
    drawn = np.empty((30_000, 3))
    for t in range(len(drawn)):
        philox.normals_into(drawn[t], KEY, 0, (t, 0, 0))
    for column in drawn.T:
        assert kstest(column, "norm").pvalue > LEAST
        # the tails have cells of their own: KS hardly looks there
        edges = norm.ppf(np.array([1e-3, 1e-2, 0.5, 0.99, 0.999]))
        seen = np.bincount(np.searchsorted(edges, column), minlength=6)
        share = np.diff(np.concatenate(([0], norm.cdf(edges), [1])))
        assert chisquare(seen, share * len(column)).pvalue > LEAST
    # five standard errors of a covariance of independent normals, 1 / sqrt(n), of a variance sqrt(2 / n)
    np.testing.assert_allclose(np.cov(drawn.T), np.eye(3), atol=5 * np.sqrt(2 / len(drawn)))
    long = np.empty(100_001)
    philox.normals_into(long, KEY, 0, (0, 0, 0))
    assert kstest(long, "norm").pvalue > LEAST


@pytest.mark.parametrize("rate", [0.01, 0.5, 4.0, 9.99, 10.0, 11.3, 30.0, 150.0, 1e3, 1e5])
def test_counts_are_poisson_at_every_rate(rate):
    n = 40_000
    drawn = counts(rate, n)
    # cells of at least ten expected counts, as Pearson's test wants them
    edges = np.unique(poisson_law.ppf(np.linspace(0, 1, 41)[1:-1], rate))
    edges = edges[np.diff(np.concatenate(([0], poisson_law.cdf(edges, rate)))) * n > 10]
    share = np.diff(np.concatenate(([0], poisson_law.cdf(edges, rate), [1])))
    if share[-1] * n < 10:
        edges, share = edges[:-1], np.append(share[:-2], share[-2:].sum())
    seen = np.bincount(np.searchsorted(edges, drawn), minlength=len(share))
    assert chisquare(seen, share * n).pvalue > LEAST
    # five standard errors of a Poisson mean and variance
    assert abs(drawn.mean() - rate) < 5 * np.sqrt(rate / n)
    assert abs(drawn.var() - rate) < 5 * np.sqrt((rate + 2 * rate**2) / n)


def test_far_tails_of_counts_are_as_thick_as_they_should_be():
    n = 400_000
    drawn = counts(40.0, n)
    for tail, share in (
        (drawn > 65, poisson_law.sf(65, 40.0)), (drawn < 20, poisson_law.cdf(19, 40.0)),
    ):  # fmt: skip
        expected = n * share
        assert expected > 20
        assert abs(tail.sum() - expected) < 5 * np.sqrt(expected)  # standard errors of a rare count


def test_no_rate_no_count():
    assert not counts(0.0, 1000).any()
