"""Switching matrices, mixtures that carry modes and banks of filters: the formulas, term by term."""

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from gmr_gym.filters.filter_bank import (
    FilterBank,
    as_bank,
    as_mixture,
    floored,
    imm_mix,
    imm_output,
    initial_bank,
    merge_hypotheses,
    mmae_weights,
    predict_bank,
)
from gmr_gym.filters.mode_mixture import (
    MixtureWithModes,
    gpb1,
    gpb2,
    merge_mode_probabilities,
    predict_every_mode,
)
from gmr_gym.mixture import Mixture, matched, mixture
from gmr_gym.models.switching import check_switching, sticky_switching


def random_bank(seed, modes=3, n=4, d=2):
    rng = np.random.default_rng(seed)
    return as_bank(Mixture(*reference.random_mixture(rng, modes * n, d)), modes)


def random_modal(seed, modes=3, n=4, d=2):
    rng = np.random.default_rng(seed)
    return MixtureWithModes(Mixture(*reference.random_mixture(rng, n, d)), rng.dirichlet(np.ones(modes), n))


def random_switching(seed, modes=3):
    return np.random.default_rng(seed).dirichlet(np.ones(modes), modes).T


def close(got, wanted):
    """Field by field the same but for the rounding of sums of a few terms of order 10."""
    for a, b in zip(got, wanted, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-11, atol=1e-11)


def hypothesis_of(bank, j):
    """The filters of hypothesis j as weights, means and covariances."""
    return bank.w[:, j], bank.m[:, j], bank.P[:, j]


# ---- switching ----


@pytest.mark.parametrize("modes", [1, 2, 5])
def test_staying_keeps_a_mode_and_shares_the_rest_alike(modes):
    switching = sticky_switching(0.7, modes)
    for q in range(modes):
        for p in range(modes):
            wanted = 1.0 if modes == 1 else 0.7 if p == q else 0.3 / (modes - 1)
            assert switching[q, p] == pytest.approx(wanted, rel=1e-14)
    assert (check_switching(switching, modes) == switching).all()


def test_staying_takes_its_extremes():
    assert sticky_switching(1.0, 3).tolist() == np.eye(3).tolist()
    assert sticky_switching(0.0, 2).tolist() == [[0, 1], [1, 0]]


@pytest.mark.parametrize(
    ("probability", "modes", "message"),
    [
        (1.1, 2, r"probability must lie in \[0, 1\], got 1\.1"),
        (-0.1, 2, r"probability must lie in \[0, 1\]"),
        (np.nan, 2, r"probability must lie in \[0, 1\]"),
        (0.5, 0, "modes must be at least 1, got 0"),
    ],
)
def test_staying_refuses_what_is_no_probability_and_no_mode(probability, modes, message):
    with pytest.raises(ValueError, match=message):
        sticky_switching(probability, modes)


def test_switching_is_checked_by_columns_and_copied():
    given_matrix = [[0.9, 0.4], [0.1, 0.6]]
    got = check_switching(given_matrix, 2)
    assert got.tolist() == given_matrix and got.dtype == float
    array = np.array(given_matrix)
    check_switching(array, 2)[0, 0] = 5
    assert array[0, 0] == 0.9


@pytest.mark.parametrize(
    ("switching", "message"),
    [
        ([[0.9, 0.1], [0.4, 0.6]], r"column-stochastic.*sum to \[1\.3, 0\.7\]; its rows do.*transpose"),
        ([[0.9, 0.9], [0.4, 0.6]], r"columns sum to \[1\.3, 1\.5\]$"),
        ([[1.1, 0.4], [-0.1, 0.6]], "probabilities between 0 and 1"),
        ([[np.nan, 0.4], [0.1, 0.6]], "probabilities between 0 and 1"),
        ([[1.0]], r"switching must have shape \(2, 2\), got \(1, 1\)"),
        (np.full((2, 3), 0.5), r"switching must have shape \(2, 2\), got \(2, 3\)"),
        ([0.5, 0.5], r"switching must have shape \(2, 2\), got \(2,\)"),
    ],
)
def test_switching_that_is_not_column_stochastic_is_refused(switching, message):
    with pytest.raises(ValueError, match=message):
        check_switching(switching, 2)


# ---- a mixture that carries its modes ----


@pytest.mark.parametrize(("modes", "n"), [(1, 3), (2, 1), (3, 4)])
def test_spread_moves_every_component_by_every_motion_as_eq_8_weighs_it(modes, n):
    told = reference.jumping_model(n, modes)
    belief = random_modal(5, modes, n)
    predicted, mode = predict_every_mode(belief, told.motions, told.switching)
    assert len(predicted.w) == modes * n
    at = 0
    for p in range(modes):
        for j in range(n):
            chance = sum(told.switching[p, i] * belief.modes[j, i] for i in range(modes))
            m, P = reference.kalman_predict(belief.mixture.m[j], belief.mixture.P[j], *told.motions[p])
            close([part[at] for part in predicted], (chance * belief.mixture.w[j], m, P))
            assert mode[at] == p
            at += 1
    assert predicted.w.sum() == pytest.approx(1, rel=1e-14)


def test_column_of_the_switching_matrix_says_where_a_mode_goes():
    switching = np.array([[0.7, 0.2], [0.3, 0.8]])
    told = reference.jumping_model(0, 2)
    first = np.array([[1.0, 0.0]])  # a transposed matrix would send it on with 0.7 and 0.2
    predicted, _ = predict_every_mode(MixtureWithModes(told.prior, first), told.motions, switching)
    assert predicted.w.tolist() == [0.7, 0.3]
    bank = random_bank(0, 2, 1)._replace(w=first.T)
    assert imm_mix(bank, switching).w[:, 0].tolist() == [0.7, 0.3]


@pytest.mark.parametrize("seed", range(5))
def test_carried_modes_are_the_shares_of_eq_6(seed):
    rng = np.random.default_rng(seed)
    posterior = Mixture(*reference.random_mixture(rng, 30, 2))
    mode = rng.integers(3, size=30)
    origin = rng.integers(-1, 4, size=30)  # -1 for what the reduction has dropped
    origin[:4] = range(4)
    reduced = matched(posterior, origin, 4), origin
    got = merge_mode_probabilities(posterior, mode, reduced, 3)
    assert got.mixture is reduced[0]
    for j in range(4):
        for p in range(3):
            into = sum(posterior.w[i] for i in range(30) if origin[i] == j and mode[i] == p)
            whole = sum(posterior.w[i] for i in range(30) if origin[i] == j)
            assert got.modes[j, p] == pytest.approx(into / whole, rel=1e-12, abs=1e-15)
    np.testing.assert_allclose(got.modes.sum(axis=1), 1, rtol=1e-14)


def test_gpb1_merges_everything_and_gpb2_what_ends_in_the_same_mode():
    p = Mixture(*reference.random_mixture(np.random.default_rng(0), 7, 2))
    p = p._replace(w=p.w * [1, 1, 0, 1, 1, 1, 1])
    mode = np.array([0, 2, 1, 2, 0, 0, 2])  # nothing that counts ends in mode 1
    one, into_one = gpb1(p, mode)
    assert into_one.tolist() == [0, 0, -1, 0, 0, 0, 0]
    two, into_two = gpb2(p, mode)
    assert into_two.tolist() == [0, 1, -1, 1, 0, 0, 1]
    for reduced, origin in ((one, into_one), (two, into_two)):
        for g in range(origin.max() + 1):
            members = origin == g
            wanted = reference.moment_match(p.w[members], p.m[members], p.P[members])
            close([part[g] for part in reduced], wanted)
    assert merge_mode_probabilities(p, mode, (two, into_two), 3).modes.tolist() == [[1, 0, 0], [0, 0, 1]]


# ---- a bank of filters ----


def test_a_bank_starts_as_the_prior_in_every_mode_and_fuses_to_it():
    prior = Mixture(*reference.random_mixture(np.random.default_rng(7), 4, 2))
    chances = np.array([0.5, 0.2, 0.3])
    bank = initial_bank(chances, prior)
    close(imm_output(bank), prior)
    for q in range(3):
        np.testing.assert_array_equal(bank.w[q], chances[q] * prior.w)
        assert (bank.m[q] == prior.m).all() and (bank.P[q] == prior.P).all()


def test_flat_lays_a_bank_out_mode_by_mode_and_banked_undoes_it():
    bank = random_bank(0)
    p = as_mixture(bank)
    for q in range(3):
        for j in range(4):
            assert p.w[4 * q + j] == bank.w[q, j]
            assert (p.m[4 * q + j] == bank.m[q, j]).all() and (p.P[4 * q + j] == bank.P[q, j]).all()
    for a, b in zip(as_bank(p, 3), bank, strict=True):
        np.testing.assert_array_equal(a, b)


def test_every_filter_moves_by_the_motion_of_its_mode():
    told, bank = reference.jumping_model(1, 3), random_bank(1)
    predicted = as_bank(predict_bank(bank, told.motions), 3)
    assert (predicted.w == bank.w).all()
    for q in range(3):
        for j in range(4):
            wanted = reference.kalman_predict(bank.m[q, j], bank.P[q, j], *told.motions[q])
            close((predicted.m[q, j], predicted.P[q, j]), wanted)


@pytest.mark.parametrize("modes", [1, 2, 4])
def test_mixing_matches_for_each_mode_all_it_may_have_come_from(modes):
    bank, switching = random_bank(modes, modes), random_switching(modes, modes)
    got = imm_mix(bank, switching)
    for j in range(4):
        for q in range(modes):
            from_each = np.array([switching[q, p] * bank.w[p, j] for p in range(modes)])
            wanted = reference.moment_match(from_each, bank.m[:, j], bank.P[:, j])
            close((got.w[q, j], got.m[q, j], got.P[q, j]), wanted)


@pytest.mark.parametrize("seed", range(5))
def test_mixing_keeps_weight_mean_and_covariance_of_every_hypothesis(seed):
    bank = random_bank(seed)
    got = imm_mix(bank, random_switching(seed))
    assert got.w.sum() == pytest.approx(bank.w.sum(), rel=1e-14)
    for j in range(4):
        before, after = (reference.moment_match(*hypothesis_of(b, j)) for b in (bank, got))
        close(after, before)


def test_mixing_changes_nothing_where_no_mode_is_ever_left():
    bank = random_bank(2)
    close(imm_mix(bank, np.eye(3)), bank)


def test_mixing_stands_modes_that_cannot_be_and_modes_that_cannot_be_reached():
    bank = random_bank(3)
    bank = bank._replace(w=bank.w * [[0.0], [1.0], [1.0]])
    got = imm_mix(bank, np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.1], [0.0, 0.4, 0.9]]))
    assert (got.w[0] == 0).all() and got.w.sum() == pytest.approx(bank.w.sum(), rel=1e-14)
    assert np.isfinite(got.m).all()
    np.linalg.cholesky(got.P)


def test_fused_is_one_matched_gaussian_for_each_hypothesis():
    bank = random_bank(4)
    for j, got in enumerate(zip(*imm_output(bank), strict=True)):
        close(got, reference.moment_match(*hypothesis_of(bank, j)))


@settings(derandomize=True, deadline=None, max_examples=50)
@given(seed=st.integers(0, 1000), modes=st.integers(1, 4), groups=st.lists(st.integers(0, 3), min_size=1))
def test_merging_of_any_grouping_keeps_weight_mean_and_covariance_of_every_mode(seed, modes, groups):
    _, origin = np.unique(groups, return_inverse=True)
    bank = random_bank(seed, modes, len(origin))
    got = merge_hypotheses(bank, origin, origin.max() + 1)
    assert got.w.shape == (modes, origin.max() + 1)
    for q in range(modes):
        before, after = (reference.moment_match(b.w[q], b.m[q], b.P[q]) for b in (bank, got))
        close(after, before)
    # hence of the whole, and the modes of a merged hypothesis are those of its parts
    close(reference.moment_match(*as_mixture(got)), reference.moment_match(*as_mixture(bank)))
    for g in range(origin.max() + 1):
        close(got.w[:, g], bank.w[:, origin == g].sum(axis=1))


def test_merging_is_by_mode_and_drops_what_the_reducer_dropped():
    bank, origin = random_bank(6), np.array([1, -1, 0, 1])
    got = merge_hypotheses(bank, origin, 2)
    for q in range(3):
        close((got.w[q, 0], got.m[q, 0], got.P[q, 0]), (bank.w[q, 2], bank.m[q, 2], bank.P[q, 2]))
        pair = [part[q, [0, 3]] for part in bank]
        close((got.w[q, 1], got.m[q, 1], got.P[q, 1]), reference.moment_match(*pair))


# ---- mode probabilities of an MMAE ----


@st.composite
def probabilities(draw):
    """Weights (r,) or (r, n) of every size, some of them zero, none of the columns without any; and a
    floor that they may be raised to."""
    r, n = draw(st.integers(1, 6)), draw(st.integers(0, 3))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    w = 10.0 ** rng.uniform(-draw(st.sampled_from([0.5, 3, 30])), 0, (r, n) if n else r)
    w[draw(st.integers(0, r - 1))] *= draw(st.sampled_from([0.0, 1.0])) if r > 1 else 1.0
    return w, draw(st.sampled_from([0.0, 1e-3, 0.1, 0.5, 0.9])) / r


@settings(derandomize=True, deadline=None, max_examples=200)
@given(case=probabilities())
def test_floored_probabilities_sum_to_one_and_none_is_below_the_floor(case):
    w, floor = case
    got = floored(w, floor)
    assert got.shape == w.shape
    np.testing.assert_allclose(got.sum(axis=0), 1, rtol=1e-12)
    assert (got >= floor * (1 - 1e-12)).all()
    for old, new in zip(w.reshape(len(w), -1).T, got.reshape(len(w), -1).T, strict=True):
        old = old / old.sum()
        free = new > floor * (1 + 1e-9)
        assert free.any()
        # those above share what is left in their old proportions, and the raised ones would be below
        shrunk = new[free] / old[free]
        np.testing.assert_allclose(shrunk, shrunk[0], rtol=1e-9)
        assert shrunk[0] <= 1 + 1e-12 and (old[~free] * shrunk[0] <= floor * (1 + 1e-9)).all()


def test_floor_leaves_alone_what_is_above_it():
    w = np.array([[0.5, 0.2], [0.25, 0.3], [0.25, 0.5]])
    np.testing.assert_allclose(floored(w, 0.19), w, rtol=1e-15)
    np.testing.assert_allclose(floored(4 * w, 0.0), w, rtol=1e-15)


def test_scaling_down_to_make_room_may_bring_another_to_the_floor():
    # 0.205 would become 0.205 * 0.8 / 1 = 0.164
    np.testing.assert_allclose(floored(np.array([0.0, 0.205, 0.795]), 0.2), [0.2, 0.2, 0.6], rtol=1e-14)


@pytest.mark.parametrize("floor", [-0.1, 1 / 3, 1.0, np.nan])
def test_floor_that_leaves_no_room_is_refused(floor):
    with pytest.raises(ValueError, match=r"floor must lie in \[0, 1 / 3\) for 3 modes"):
        floored(np.ones(3), floor)


def test_mmae_weights_are_bayes_rule():
    rng = np.random.default_rng(0)
    prior, likelihood = rng.dirichlet(np.ones(3), 4).T, rng.random((3, 4))
    got = mmae_weights(prior, np.log(likelihood))
    for j in range(4):
        wanted = prior[:, j] * likelihood[:, j]
        np.testing.assert_allclose(got[:, j], wanted / wanted.sum(), rtol=1e-12)
        np.testing.assert_allclose(mmae_weights(prior[:, j], np.log(likelihood[:, j])), got[:, j], rtol=1e-15)


def test_mmae_weights_survive_likelihoods_that_underflow_and_keep_to_the_floor():
    unlikely = np.array([-1e6, -1e6 + np.log(3), -2e6])
    alike = np.full(3, 1 / 3)
    np.testing.assert_allclose(mmae_weights(alike, unlikely), [0.25, 0.75, 0], rtol=1e-9)
    np.testing.assert_allclose(mmae_weights(alike, unlikely, floor=0.1), [0.225, 0.675, 0.1], rtol=1e-9)
    sure = np.array([0.0, 1.0, 0.0])
    assert mmae_weights(sure, np.array([5.0, 0.0, -np.inf])).tolist() == [0, 1, 0]


@pytest.mark.parametrize(
    ("prior", "log_likelihood"),
    [
        ([0.5, 0.5], [-np.inf, -np.inf]),
        ([1.0, 0.0], [-np.inf, 0.0]),
        ([[0.5, 0.5], [0.5, 0.5]], [[0.0, -np.inf], [0.0, -np.inf]]),
    ],
)
def test_a_scan_that_no_mode_explains_is_refused(prior, log_likelihood):
    with pytest.raises(ValueError, match="every mode is impossible by log_likelihood"):
        mmae_weights(np.array(prior), np.array(log_likelihood), floor=0.1)


def test_a_bank_of_one_mode_is_the_mixture_itself():
    p = mixture([0.2, 0.8], [[0.0], [1.0]], [[[1.0]], [[2.0]]])
    bank = FilterBank(p.w[None], p.m[None], p.P[None])
    close(imm_output(bank), p)
    close(as_mixture(imm_mix(bank, sticky_switching(0.5, 1))), p)
