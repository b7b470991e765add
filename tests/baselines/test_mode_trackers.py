"""Trackers of a target that switches between motions: against exact posteriors, the textbook's filters,
FilterPy's IMM, and one another where they must agree."""

from functools import partial
from itertools import islice

import numpy as np
import pytest
import reference
from filterpy.kalman import IMMEstimator, KalmanFilter
from scipy.stats import chi2

from gmr_gym.baselines.clairvoyant import Clairvoyant
from gmr_gym.baselines.imm_pda import ImmPda
from gmr_gym.baselines.mht import Mht
from gmr_gym.baselines.mht_of_banks import MhtOfBanks, imm_mht
from gmr_gym.baselines.mmg import Mmg, b_best, gpb1, gpb2, mmg
from gmr_gym.baselines.pda import Pda
from gmr_gym.evaluation.loop import play
from gmr_gym.filters import mode_mixture
from gmr_gym.filters.filter_bank import FilterBank, as_bank, imm_mix, mmae_weights, no_interaction
from gmr_gym.filters.joint_gating import Limits, expected_false_alarms
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import gaussian, moments
from gmr_gym.models.kalman import Motion
from gmr_gym.reduction.properties import MOMENTS, PROPERTIES
from gmr_gym.reduction.pruning import capping
from gmr_gym.reduction.registry import REDUCERS
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.scenarios.zhang import jump_markov
from gmr_gym.simulation.single_target import draw

imm_engine = partial(MhtOfBanks, before=imm_mix, after=no_interaction)
WITH_MODES = {
    "imm-pda": ImmPda,
    "imm-mht": imm_mht,
    "mmg": mmg,
    "gpb1": gpb1,
    "gpb2": gpb2,
    "b-best": b_best,
}
each = pytest.mark.parametrize("build", WITH_MODES.values(), ids=WITH_MODES)


def everything_kept(p, mode=None):
    return p, np.arange(len(p.w))


def unreduced(told):
    return Mmg(told, everything_kept, Limits(0.0, 100_000))


def flight(tracker, scans):
    """Belief and report after each scan."""
    belief = tracker.init()
    for z in scans:
        belief, report = tracker.step(belief, z)
        yield belief, report


def mode_weights(belief):
    """Probability of each mode (r,) in a belief of either kind."""
    if isinstance(belief, FilterBank):
        return belief.w.sum(axis=1)
    return belief.modes.T @ belief.mixture.w


def same_estimates(flown, others, rtol=1e-9):
    """The same estimates and covariances scan by scan, to the rounding of sums in another order that
    the motions of a few scans enlarge; covariances to a share of their largest entry."""
    for (_, got), (_, wanted) in zip(flown, others, strict=True):
        size = np.abs(wanted.P).max()
        np.testing.assert_allclose(got.x, wanted.x, rtol=rtol, atol=rtol * np.sqrt(size))
        np.testing.assert_allclose(got.P, wanted.P, rtol=rtol, atol=rtol * size)


# ---- exact posteriors ----


def assert_exact(told, belief, report, scans):
    """Belief and report are the enumeration of all histories: weights, means, covariances, the mode
    of every component and the moments of the whole."""
    w, m, P, histories = reference.every_history(told, scans)
    possible = w > 0
    assert len(belief.mixture.w) == possible.sum()
    last = np.array([sequence[-1] for _, sequence, _ in histories])
    mine = np.argsort(belief.mixture.w)
    theirs = np.flatnonzero(possible)[np.argsort(w[possible])]  # no two weights are equal
    # products of a few likelihoods, and inverses of matrices of a few rows: rounding, with room
    np.testing.assert_allclose(belief.mixture.w[mine], w[theirs], rtol=1e-8)
    np.testing.assert_allclose(belief.mixture.m[mine], m[theirs], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(belief.mixture.P[mine], P[theirs], rtol=1e-8, atol=1e-8)
    assert (belief.modes[mine] == np.eye(len(told.motions))[last[theirs]]).all()
    assert_moments(told, belief, report, (w, m, P, histories))


def assert_moments(told, belief, report, enumerated):
    w, m, P, histories = enumerated
    _, mean, covariance = reference.moment_match(w, m, P)
    np.testing.assert_allclose(report.x, [mean], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(report.P, [covariance], rtol=1e-8, atol=1e-8)
    wanted = reference.last_mode(w, histories, len(told.motions))
    np.testing.assert_allclose(mode_weights(belief), wanted, rtol=1e-8)


@pytest.mark.parametrize(("count", "axes", "parents", "scans"), [(2, 1, 1, 5), (3, 1, 2, 3), (2, 2, 3, 3)])
def test_unreduced_mmg_equals_enumerating_every_sequence_of_models(count, axes, parents, scans):
    told = reference.jumping_model(count, count, axes, parents)
    z = reference.flown(told, scans, np.random.default_rng(0))
    for t, (belief, report) in enumerate(flight(unreduced(told), z), 1):
        assert_exact(told, belief, report, z[:t])
    assert len(belief.mixture.w) == parents * count**scans


@pytest.mark.parametrize(
    ("count", "parents", "sizes"), [(2, 1, (2, 1, 2)), (2, 2, (1, 0, 2)), (3, 1, (2, 3))]
)
def test_unreduced_mmg_in_clutter_equals_enumerating_models_and_associations(count, parents, sizes):
    told = reference.jumping_model(count, count, parents=parents, detection_probability=0.8)
    rng = np.random.default_rng(sum(sizes))
    z = [told.prior.m[0, :1] + 3 * rng.standard_normal((k, 1)) for k in sizes]
    for t, (belief, report) in enumerate(flight(unreduced(told), z), 1):
        assert_exact(told, belief, report, z[:t])


def test_mmg_with_more_components_than_hypotheses_is_exact():
    told = reference.jumping_model(7, 2, detection_probability=0.8)
    z = reference.flown(told, 3, np.random.default_rng(7), clutter=1)
    for t, (belief, report) in enumerate(flight(mmg(told, 100_000, prune_weight=0.0), z), 1):
        assert_exact(told, belief, report, z[:t])


def test_modes_and_switches_that_cannot_be_leave_the_posterior_exact():
    told = reference.jumping_model(4, 3, detection_probability=0.8)
    cyclic = np.array([[0.0, 0.0, 1.0], [1.0, 0.3, 0.0], [0.0, 0.7, 0.0]])
    told = told._replace(switching=cyclic, mode_prior=np.array([0.6, 0.4, 0.0]))
    z = reference.flown(told, 3, np.random.default_rng(0), clutter=1)
    for t, (belief, report) in enumerate(flight(unreduced(told), z), 1):
        assert_exact(told, belief, report, z[:t])
    assert len(belief.mixture.w) < 3**3 * np.prod([1 + len(scan) for scan in z])


@each
def test_modes_and_switches_that_cannot_be_stay_at_zero_and_make_no_nan(build):
    told = reference.jumping_model(4, 3, detection_probability=0.8)
    absorbing = np.array([[0.8, 0.0, 0.0], [0.2, 1.0, 0.1], [0.0, 0.0, 0.9]])
    told = told._replace(switching=absorbing, mode_prior=np.array([1.0, 0.0, 0.0]))
    z = reference.flown(told, 8, np.random.default_rng(1), clutter=2)
    z[4] = z[4][:0]
    for belief, report in flight(build(told), z):
        got = mode_weights(belief)
        assert got[2] == 0 and got.sum() == pytest.approx(1, rel=1e-12)
        assert np.isfinite(report.x).all()
        np.linalg.cholesky(report.P)
        arrays = belief if isinstance(belief, FilterBank) else (*belief.mixture, belief.modes)
        assert all(np.isfinite(a).all() for a in arrays)


@each
def test_modes_switch_before_the_first_scan_and_empty_scans_tell_nothing_of_them(build):
    told = reference.jumping_model(5, 3, detection_probability=0.8)
    wanted = told.mode_prior
    scans = 2 if build is b_best else 4  # it drops histories beyond the fifteenth, and their modes
    for belief, _ in flight(build(told), [np.empty((0, 1))] * scans):
        wanted = told.switching @ wanted
        np.testing.assert_allclose(mode_weights(belief), wanted, rtol=1e-12)


@pytest.mark.parametrize("build", [ImmPda, imm_mht, gpb2])
def test_filters_that_merge_mode_by_mode_coast_with_the_exact_mean_and_covariance(build):
    # the moments of each mode are all that the moments one scan on depend on
    told = reference.jumping_model(6, 3, parents=2, detection_probability=0.8)
    z = [np.empty((0, 1))] * 4
    for t, (belief, report) in enumerate(flight(build(told), z), 1):
        assert_moments(told, belief, report, reference.every_history(told, z[:t]))


@pytest.mark.parametrize("count", [2, 3])
def test_b_best_keeps_the_likeliest_histories(count):
    told = reference.jumping_model(count, count, detection_probability=0.8)
    z = reference.flown(told, 1, np.random.default_rng(count), clutter=3)
    ((belief, _),) = flight(b_best(told, 4), z)
    w, m, P, _ = reference.every_history(told, z)
    best, mine = np.argsort(-w)[:4], np.argsort(-belief.mixture.w)
    np.testing.assert_allclose(belief.mixture.w[mine], w[best] / w[best].sum(), rtol=1e-9)
    np.testing.assert_allclose(belief.mixture.m[mine], m[best], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(belief.mixture.P[mine], P[best], rtol=1e-8, atol=1e-8)


# ---- the textbook's filters ----


@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize("axes", [1, 2])
def test_imm_is_bar_shaloms_four_steps(count, axes):
    told = reference.jumping_model(count, count, axes)
    scans = reference.flown(told, 12, np.random.default_rng(axes))
    w, m, P = told.mode_prior, np.repeat(told.prior.m, count, 0), np.repeat(told.prior.P, count, 0)
    for z, (belief, report) in zip(scans, flight(ImmPda(told), scans), strict=True):
        w, m, P = reference.imm_step(w, m, P, told, partial(reference.kalman, told=told, z=z[0]))
        w /= w.sum()
        assert_bank(belief, report, w, m, P)


def assert_bank(belief, report, w, m, P):
    """One hypothesis with these filters, and their moments reported; to rounding over a dozen scans."""
    np.testing.assert_allclose(belief.w[:, 0], w, rtol=1e-8)
    np.testing.assert_allclose(belief.m[:, 0], m, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(belief.P[:, 0], P, rtol=1e-8, atol=1e-8)
    _, mean, covariance = reference.moment_match(w, m, P)
    np.testing.assert_allclose(report.x, [mean], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(report.P, [covariance], rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("axes", [1, 2])
def test_imm_pda_has_a_pda_for_each_mode_over_one_list_of_detections(count, axes):
    told = reference.jumping_model(count, count, axes, detection_probability=0.8, gate_probability=0.99)
    told = told._replace(clutter_density=2 / 16**axes)
    scans = reference.flown(told, 8, np.random.default_rng(axes), clutter=2, reach=8.0)
    w, m, P = told.mode_prior, np.repeat(told.prior.m, count, 0), np.repeat(told.prior.P, count, 0)
    unlike, tracker = 0, ImmPda(told)
    belief = tracker.init()
    for z in scans:
        belief, report = tracker.step(belief, z)
        assert report.alive
        inside = gated_by_hand(report.gates, z)
        listed = inside.any(axis=0)
        unlike += (inside[:, listed].sum(axis=1) < listed.sum()).any()
        w, m, P = reference.imm_step(w, m, P, told, partial(reference.pda, told=told, z=z[listed]))
        w /= w.sum()
        assert_bank(belief, report, w, m, P)
    assert unlike or count == 1  # else one list for all would be the same as a list for each


def gated_by_hand(gates, z):
    """Whether each gate holds each detection (n, k)."""
    return np.array([
        [reference.mahalanobis_squared(row, centre, S) <= gates.threshold for row in z]
        for centre, S in zip(gates.z, gates.S, strict=True)
    ]).reshape(len(gates.z), len(z))  # fmt: skip


@pytest.mark.parametrize(
    "build", [lambda told: Mmg(told, everything_kept, Limits(0.0)), gpb2, ImmPda, imm_mht]
)
def test_a_detection_in_any_gate_is_weighed_by_every_model_and_one_in_none_by_none(build):
    still, fast = (Motion(np.eye(2), np.eye(2), np.array([x, 0.0])) for x in (0.0, 3.0))
    told = reference.jumping_model(0, 2, detection_probability=0.9, gate_probability=0.5)
    told = told._replace(motions=(still, fast), prior=gaussian([0.0, 0.0], np.eye(2)))
    # S = 1 + 1 + 1: the gates reach 1.17 either way, and hold the first, the second and none
    z = np.array([[0.9], [2.6], [1.5]])
    assert np.sqrt(3 * chi2.ppf(0.5, 1)) == pytest.approx(1.168, abs=1e-3)
    ((belief, _),) = flight(build(told), [z])
    wanted = np.zeros(2)
    for p, chance in enumerate(told.switching @ told.mode_prior):
        m, P = reference.kalman_predict(np.zeros(2), np.eye(2), *told.motions[p])
        wanted[p] = chance * reference.pda(m, P, told, z[:2])[0]
    np.testing.assert_allclose(mode_weights(belief), wanted / wanted.sum(), rtol=1e-10)


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("clutter", [0, 3])
def test_gpb1_and_gpb2_are_the_textbooks(count, clutter):
    sure = 0.8 if clutter else 1.0
    told = reference.jumping_model(10 + count, count, detection_probability=sure)
    scans = reference.flown(told, 10, np.random.default_rng(clutter), clutter=clutter)
    updates = [
        partial(reference.pda, told=told, z=z) if clutter else partial(reference.kalman, told=told, z=z[0])
        for z in scans
    ]
    w, m, P = told.mode_prior, told.prior.m[0], told.prior.P[0]
    for update, (belief, _) in zip(updates, flight(gpb1(told), scans), strict=True):
        w, m, P = reference.gpb1_step(w, m, P, told, update)
        w /= w.sum()
        np.testing.assert_allclose(belief.modes, [w], rtol=1e-8)
        np.testing.assert_allclose(belief.mixture.m, [m], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(belief.mixture.P, [P], rtol=1e-8, atol=1e-8)
    w, m, P = told.mode_prior, np.repeat(told.prior.m, count, 0), np.repeat(told.prior.P, count, 0)
    for update, (belief, report) in zip(updates, flight(gpb2(told), scans), strict=True):
        w, m, P = reference.gpb2_step(w, m, P, told, update)
        w /= w.sum()
        assert (belief.modes == np.eye(count)).all()
        bank = as_bank(belief.mixture, count)
        assert_bank(bank, report, w, m, P)


def test_imm_is_filterpys_step_by_step():
    scenario = jump_markov("clear")
    rng = np.random.default_rng(0)
    switching = 0.7 * scenario.model.switching + 0.3 * rng.dirichlet(np.ones(5), 5).T
    told = scenario.model._replace(switching=switching, mode_prior=rng.dirichlet(np.ones(5)))
    filters = []
    for F, Q, offset in told.motions:
        theirs = KalmanFilter(dim_x=4, dim_z=2, dim_u=1)
        theirs.x, theirs.P = told.prior.m[0].copy(), told.prior.P[0].copy()
        theirs.F, theirs.Q, theirs.B = F, Q, offset[:, None]
        theirs.H, theirs.R = told.sensor
        filters.append(theirs)
    imm = IMMEstimator(filters, told.mode_prior, switching.T)  # rows are where a mode goes
    scans = [z[None] for z in draw(scenario, 3).z]
    assert len(scans) == 45
    for z, (belief, report) in zip(scans, flight(ImmPda(told), scans), strict=True):
        imm.predict(np.ones(1))
        imm.update(z[0])
        # coordinates of 2.5e5 m are rounded at 6e-11 m, and a likelihood at as much of a deviation
        np.testing.assert_allclose(report.x[0], imm.x, rtol=0, atol=1e-7)
        np.testing.assert_allclose(report.P[0], imm.P, rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(belief.w[:, 0], imm.mu, rtol=1e-7, atol=1e-12)
        for q, theirs in enumerate(filters):
            np.testing.assert_allclose(belief.m[q, 0], theirs.x, rtol=0, atol=1e-7)
            np.testing.assert_allclose(belief.P[q, 0], theirs.P, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize(("parents", "sizes"), [(1, (2, 1, 2)), (2, (1, 0, 2))])
def test_unreduced_imm_mht_is_an_imm_along_every_history_of_associations(parents, sizes):
    told = reference.jumping_model(3, 2, parents=parents, detection_probability=0.8)
    rng = np.random.default_rng(sum(sizes))
    scans = [told.prior.m[0, :1] + 3 * rng.standard_normal((k, 1)) for k in sizes]
    histories = [
        (told.mode_prior * w, np.array([m, m]), np.array([P, P])) for w, m, P in zip(*told.prior, strict=True)
    ]
    tracker = imm_engine(told, everything_kept, work_limits=Limits(0.0))
    for z, (belief, _) in zip(scans, flight(tracker, scans), strict=True):
        updates = [lambda m, P: (1 - told.detection_probability, m, P)]
        for row in z:
            updates.append(partial(one_of_many, told=told, z=row))
        histories = [reference.imm_step(*h, told, update) for h in histories for update in updates]
        total = sum(h[0].sum() for h in histories)
        assert belief.w.shape == (2, len(histories))
        mine = np.argsort(belief.w.sum(axis=0))
        theirs = np.argsort([h[0].sum() for h in histories])  # no two weights are equal
        for j, i in zip(mine, theirs, strict=True):
            w, m, P = histories[i]
            np.testing.assert_allclose(belief.w[:, j], w / total, rtol=1e-8)
            np.testing.assert_allclose(belief.m[:, j], m, rtol=1e-8, atol=1e-8)
            np.testing.assert_allclose(belief.P[:, j], P, rtol=1e-8, atol=1e-8)


def one_of_many(m, P, told, z):
    """A Kalman filter's step and its weight relative to a detection more that is false."""
    density, m, P = reference.kalman(m, P, told, z)
    return told.detection_probability * density / told.clutter_density, m, P


def test_imm_that_never_switches_weighs_its_first_scan_as_an_mmae_does():
    told = reference.jumping_model(8, 3)._replace(switching=np.eye(3))
    ((z,),) = reference.flown(told, 1, np.random.default_rng(8))
    ((belief, _),) = flight(ImmPda(told), [z[None]])
    likelihood = [
        reference.kalman(*reference.kalman_predict(told.prior.m[0], told.prior.P[0], *move), told, z)[0]
        for move in told.motions
    ]
    wanted = mmae_weights(told.mode_prior, np.log(likelihood))
    np.testing.assert_allclose(belief.w[:, 0], wanted, rtol=1e-10)


# ---- where they must agree ----


@each
def test_with_one_model_and_no_clutter_all_are_the_kalman_filter(build):
    told = reference.jumping_model(1, 1, axes=2)
    scans = reference.flown(told, 20, np.random.default_rng(1))
    m, P = told.prior.m[0], told.prior.P[0]
    for z, (_, report) in zip(scans, flight(build(told), scans), strict=True):
        _, m, P = reference.kalman(*reference.kalman_predict(m, P, *told.motions[0]), told, z[0])
        # the form (I - K H) P loses digits over twenty scans
        np.testing.assert_allclose(report.x[0], m, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(report.P[0], P, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("components", [1, 3, 8])
def test_with_one_model_mmg_is_imm_mht_is_the_mht(components):
    told = reference.jumping_model(2, 1, axes=2, detection_probability=0.9)
    scans = reference.flown(told, 15, np.random.default_rng(2), clutter=6)
    # no more than 8 x 8 hypotheses, which no limit of any of the three touches
    merging = partial(runnalls, components=components)
    mht = list(flight(Mht(told, merging, prune_weight=1e-5, prune_density=0.0), scans))
    assert max(len(report.mixture.w) for _, report in mht) == components
    same_estimates(flight(mmg(told, components, prune_weight=1e-5), scans), mht)
    same_estimates(flight(imm_mht(told, components, prune_weight=1e-5), scans), mht)


@pytest.mark.parametrize("build", [ImmPda, gpb1, gpb2, partial(mmg, components=1, prune_weight=0.0)])
def test_with_one_model_and_one_hypothesis_all_are_the_pda(build):
    told = reference.jumping_model(3, 1, axes=2, detection_probability=0.9, gate_probability=0.99)
    scans = reference.flown(told, 15, np.random.default_rng(3), clutter=6)
    same_estimates(flight(build(told), scans), flight(Pda(told), scans))


def test_with_one_model_b_best_is_the_mht_that_caps():
    told = reference.jumping_model(4, 1, axes=2, detection_probability=0.9)
    scans = reference.flown(told, 15, np.random.default_rng(4), clutter=6)
    caps = Mht(told, partial(capping, components=5), prune_weight=0.0, prune_density=0.0)
    same_estimates(flight(b_best(told, 5), scans), flight(caps, scans))


def test_without_clutter_imm_mht_and_imm_pda_are_the_imm():
    scenario = jump_markov("clear")
    scans = [z[None] for z in draw(scenario, 0).z]
    told = scenario.model
    imm = list(flight(ImmPda(told), scans))
    many = list(flight(imm_mht(told), scans))
    named = list(flight(make_tracker("imm", told), scans))
    for others in (many, named):
        for (a, x), (b, y) in zip(imm, others, strict=True):
            # 2.5e5 m are rounded at 6e-11 m
            np.testing.assert_allclose(x.x, y.x, rtol=0, atol=1e-8)
            np.testing.assert_allclose(x.P, y.P, rtol=1e-8, atol=1e-9)
            np.testing.assert_allclose(a.w, b.w, rtol=1e-8, atol=1e-15)
            assert b.w.shape == (5, 1)


def test_clairvoyant_filter_of_one_motion_is_the_kalman_filter():
    told = reference.jumping_model(5, 1, axes=2, detection_probability=0.7)
    scans = reference.flown(told, 20, np.random.default_rng(5))
    assert {len(z) for z in scans} == {0, 1}
    m, P = told.prior.m[0], told.prior.P[0]
    for z, (_, report) in zip(scans, flight(Clairvoyant(told), scans), strict=True):
        m, P = reference.kalman_predict(m, P, *told.motions[0])
        if len(z):
            _, m, P = reference.kalman(m, P, told, z[0])
        np.testing.assert_allclose(report.x[0], m, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(report.P[0], P, rtol=1e-8, atol=1e-8)


def test_clairvoyant_filter_of_several_motions_is_the_mmg_that_is_handed_the_detection():
    told = reference.jumping_model(6, 3, detection_probability=0.7, gate_probability=0.99)
    scans = reference.flown(told, 12, np.random.default_rng(6))
    assert {len(z) for z in scans} == {0, 1}
    sure = told._replace(detection_probability=1.0, gate_probability=1.0)
    handed = list(flight(mmg(sure, components=6, prune_weight=0.0), scans))
    same_estimates(flight(Clairvoyant(told, components=6), scans), handed)
    assert len(handed[-1][1].mixture.w) == 6


# ---- limits ----


@pytest.fixture(scope="module")
def acquisition():
    """The paper's first case, and the scans of one flight as MMG saw them."""
    scenario = jump_markov("1")
    seen = islice(play(scenario, mmg(scenario.model), draw(scenario, 1)), 8)
    return scenario.model, [scan.z for _, scan, _, _ in seen]


@pytest.mark.parametrize("name", ["mmg", "imm-mht"])
@pytest.mark.parametrize("how", [name for name in REDUCERS if PROPERTIES[name].most is None])
def test_every_named_reduction_serves(name, how, acquisition):
    told, scans = acquisition
    # pruned harder than it would be in earnest, for the slow ones' sake
    tracker = make_tracker(f"{name}-4", told, reduction=how, prune_weight=3e-3)
    most = 0
    for belief, report in flight(tracker, scans):
        assert np.isfinite(report.x).all() and report.alive
        np.linalg.cholesky(report.P)
        assert report.mixture.w.sum() == pytest.approx(1, rel=1e-12)
        assert mode_weights(belief).sum() == pytest.approx(1, rel=1e-12)
        most = max(most, len(report.mixture.w))
    assert most == 4 or (PROPERTIES[how].bounded and most < 4)


@pytest.mark.parametrize("name", ["mmg", "imm-mht"])
@pytest.mark.parametrize(
    "how", [name for name in REDUCERS if PROPERTIES[name].keeps == MOMENTS and PROPERTIES[name].most is None]
)
def test_reductions_that_only_merge_leave_the_first_estimate_exact(name, how):
    told = reference.jumping_model(11, 3, detection_probability=0.8)
    z = reference.flown(told, 1, np.random.default_rng(11), clutter=4)
    tracker = make_tracker(f"{name}-2", told, reduction=how, prune_weight=0.0)
    ((belief, report),) = flight(tracker, z)
    assert len(report.mixture.w) <= 2
    # all modes start from one Gaussian, which mixing leaves as it is
    assert_moments(told, belief, report, reference.every_history(told, z))


@pytest.mark.parametrize("name", ["mmg", "imm-mht"])
def test_a_reduction_may_be_any_function_that_can_be_imported(name, acquisition):
    told, scans = acquisition
    yours = make_tracker(name, told, components=3, reduction="gmr_gym.reduction:capping")
    same_estimates(flight(yours, scans), flight(make_tracker(f"{name}-3", told, reduction="capping"), scans))


@pytest.mark.parametrize("name", ["mmg", "imm-mht"])
@pytest.mark.parametrize(
    ("number", "parameters", "message"),
    [
        ("-0", {}, "components must be at least 1, got 0"),
        ("", {"components": 2.5}, r"components must be a whole number, got 2\.5"),
        ("", {"reduction": "runnals"}, r"unknown reduction 'runnals'; did you mean 'runnalls'\? \(there are"),
        ("", {"reduction": "xyz"}, r"unknown reduction 'xyz' \(there are runnalls, greedy-isd"),
        ("", {"reduction": "nosuch:f"}, "reduction 'nosuch:f' is no function that can be imported"),
        (
            "",
            {"reduction": "gmr_gym.reduction:f"},
            "'gmr_gym.reduction:f' is no function that can be imported",
        ),
        ("", {"reduction": ":f"}, "reduction ':f' is no function that can be imported"),
        ("", {"reduction": 3}, "the reduction must be named by a text, got 3"),
        ("", {"reduction": "gmr_gym.reduction.salmond_west:whitened"}, "cannot be made with"),
        ("", {"reduction": "gmr_gym.mixture:__doc__"}, "the first argument must be callable"),
        ("", {"prune_weight": -1.0}, "prune_weight must be non-negative and finite"),
        ("", {"prune": 0.1}, "no parameter 'prune'; it takes components, reduction, prune_weight"),
    ],
)
def test_wrong_parameter_of_a_tracker_with_modes_is_refused(name, number, parameters, message):
    with pytest.raises(ValueError, match=message):
        make_tracker(name + number, reference.jumping_model(0, 2), **parameters)


@pytest.mark.parametrize("engine", [Mmg, imm_engine])
@pytest.mark.parametrize(
    ("limit", "message"),
    [
        ({"max_hypotheses": 0}, "max_hypotheses must be a whole number, at least 1, got 0"),
        ({"give_up_ratio": 0.0}, r"give_up_ratio must be positive, got 0\.0"),
        ({"give_up_ratio": np.nan}, "give_up_ratio must be positive, got nan"),
        ({"prune_weight": np.inf}, "prune_weight must be non-negative and finite, got inf"),
    ],
)
def test_a_limit_that_is_none_is_refused(engine, limit, message):
    with pytest.raises(ValueError, match=message):
        engine(reference.jumping_model(0, 2), everything_kept, work_limits=Limits(**limit))


@each
def test_a_hopeless_track_is_given_up_and_coasts_like_the_prediction(build):
    told = reference.jumping_model(9, 3, axes=2, detection_probability=0.9, gate_probability=0.999)
    P = 1e6 * np.eye(4)  # pi x 1e6 m^2 of clutter within a deviation
    told = told._replace(prior=gaussian(told.prior.m[0], P))
    z = told.prior.m[0, :2] + 1e3 * np.random.default_rng(9).standard_normal((50, 2))
    # every tracker expects as many at its first scan: half of that is to be too many
    ((belief, report),) = flight(build(told, give_up_ratio=0.5), [z])
    assert not report.alive
    chances = told.switching @ told.mode_prior
    ahead = [reference.kalman_predict(told.prior.m[0], P, *move) for move in told.motions]
    _, mean, covariance = reference.moment_match(chances, *map(np.array, zip(*ahead, strict=True)))
    np.testing.assert_allclose(report.x[0], mean, rtol=1e-12)
    np.testing.assert_allclose(report.P[0], covariance, rtol=1e-10, atol=1e-10 * 1e6)
    np.testing.assert_allclose(mode_weights(belief), chances, rtol=1e-12)
    ((_, hopeful),) = flight(build(told), [z])
    assert hopeful.alive and np.abs(hopeful.x - mean).max() > 1e-3  # it has looked


@each
def test_a_track_is_given_up_once_it_is_twenty_times_as_unsure_as_at_first(build):
    told = reference.jumping_model(9, 3, axes=2, detection_probability=0.9, gate_probability=0.999)
    told = told._replace(prior=gaussian(told.prior.m[0], 100 * np.eye(4)), clutter_density=0.01)
    tracker = build(told)
    reports = [report for _, report in flight(tracker, [np.empty((0, 2))] * 60)]
    unsure = np.array([
        expected_false_alarms(report.gates, np.ones(len(report.gates.z)), 0.01) for report in reports
    ])  # fmt: skip
    alive = np.array([report.alive for report in reports])
    assert alive[0] and not alive[-1] and (np.diff(alive.astype(int)) <= 0).all()
    first = max(unsure[0], 1.0)
    # the gates' plain mean stands in for that by weight: good to a factor of two
    assert unsure[alive].max() < 40 * first and unsure[~alive].min() > 10 * first


@pytest.mark.parametrize(("engine", "count"), [(Mmg, 2), (imm_engine, 1)])
def test_ten_thousand_detections_send_no_more_than_the_most_into_the_reduction(engine, count):
    entered = []

    def spy(p, mode=None):
        entered.append(p)
        return p, np.arange(len(p.w))

    told = reference.jumping_model(1, 2, axes=2, detection_probability=0.9)
    z = told.prior.m[0, :2] + 20 * np.random.default_rng(1).standard_normal((10_000, 2))
    list(flight(engine(told, spy, work_limits=Limits(0.0, 10**6, np.inf)), [z]))
    everything = np.sort(entered[-1].w)
    assert len(everything) > 5_000 * count  # but for weights that are zero to the machine
    limited = engine(told, spy, work_limits=Limits(0.0, 7, np.inf))
    ((belief, report),) = flight(limited, [z])
    np.testing.assert_allclose(np.sort(entered[-1].w), everything[-7:], rtol=1e-12)
    assert len(report.mixture.w) == 7
    assert mode_weights(belief).sum() == pytest.approx(1, rel=1e-12)
    assert report.mixture.w.sum() == pytest.approx(1, rel=1e-12)


@pytest.mark.parametrize("engine", [Mmg, imm_engine])
def test_what_weighs_less_than_the_bound_never_enters_the_reduction(engine):
    entered = []

    def spy(p, mode=None):
        entered.append(p.w)
        return p, np.arange(len(p.w))

    told = reference.jumping_model(1, 2, detection_probability=0.9)
    z = reference.flown(told, 1, np.random.default_rng(1), clutter=4)
    list(flight(engine(told, spy, work_limits=Limits(0.0)), z))
    everything = np.sort(entered[-1])
    bound = everything[-4:-2].mean()
    ((belief, report),) = flight(engine(told, spy, work_limits=Limits(bound)), z)
    np.testing.assert_allclose(np.sort(entered[-1]), everything[-3:], rtol=1e-12)
    assert report.mixture.w.sum() == pytest.approx(1, rel=1e-12)
    assert mode_weights(belief).sum() == pytest.approx(1, rel=1e-12)


@each
def test_estimate_is_the_mean_and_covariance_of_the_hypotheses_kept(build):
    told = reference.jumping_model(2, 3, detection_probability=0.8)
    for _, report in flight(build(told), reference.flown(told, 5, np.random.default_rng(2), clutter=3)):
        mean, covariance = moments(report.mixture)
        np.testing.assert_allclose(report.x, [mean], rtol=1e-12)
        np.testing.assert_allclose(report.P, [covariance], rtol=1e-12)


def test_reducers_that_know_modes_serve_the_engine_as_any_other():
    told = reference.jumping_model(3, 2, detection_probability=0.8)
    scans = reference.flown(told, 5, np.random.default_rng(3), clutter=3)
    by_hand = Mmg(told, lambda p, mode: mode_mixture.gpb2(p, mode), Limits(0.0))
    same_estimates(flight(by_hand, scans), flight(gpb2(told), scans))
