"""The PHD and CPHD filters are their papers' sums, keep what they count, and name who is there."""

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from gmr_gym.baselines.fitted_phd import fitted_phd
from gmr_gym.baselines.gm_cphd import CphdBelief, GmCphd, gm_cphd
from gmr_gym.baselines.gm_phd import GmPhd, gm_phd
from gmr_gym.baselines.learning_phd import learning_phd
from gmr_gym.baselines.learning_pmb import learning_pmb
from gmr_gym.filters import cphd as cardinality
from gmr_gym.filters import phd
from gmr_gym.filters.mode_phd import ModePhd
from gmr_gym.filters.phd import LabelledIntensity
from gmr_gym.mixture import Mixture, gaussian, mixture, moments, normalised, take
from gmr_gym.models.clutter import Clutter, no_components, uniform_clutter
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.motions import constant_acceleration, constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.models.radar import radar
from gmr_gym.models.switching import sticky_switching
from gmr_gym.reduction.properties import MOMENTS, PROPERTIES
from gmr_gym.reduction.registry import REDUCERS, reduction_named
from gmr_gym.reduction.vo_ma import vo_ma

CORNER = np.array([-300.0, -300.0])
EVERY = ["vo-ma", *(name for name in REDUCERS if PROPERTIES[name].most is None)]
LOSING = ["capping", "ise-unscaled"]  # these drop components for good
UNLIKE_MOMENTS = [name for name, row in PROPERTIES.items() if row.keeps != MOMENTS]
FILTERS = [gm_phd, gm_cphd]


def as_it_is(p):
    return p, np.arange(len(p.w))


def told(births=None, expected=10.0, detection=0.9, survival=0.98, **kwargs):
    """Targets of the plane that are born about two places."""
    if births is None:
        births = mixture([0.1, 0.05], [[100.0, 0, 0, 5], [-100, 50, 5, 0]], [np.diag([100.0, 100, 9, 9])] * 2)
    return multi_target_model(
        constant_velocity(1.0, 1.0), position_sensor(3.0), detection, survival, births,
        uniform_clutter(CORNER, -CORNER, expected), **kwargs,
    )  # fmt: skip


def spawning(**kwargs):
    return told(spawn_weight=0.05, spawn_covariance=np.diag([25.0, 25, 1, 1]), **kwargs)


def intensity(seed, n=5, total=2.0, spread=20.0):
    return Mixture(*reference.random_mixture(np.random.default_rng(seed), n, 4, spread, total))


def labelled(p):
    return LabelledIntensity(p, np.arange(len(p.w)), len(p.w))


def scan_about(p, seed, near=3, far=3):
    """Detections at some components and anywhere."""
    rng = np.random.default_rng(seed)
    at = p.m[rng.integers(len(p.w), size=near), :2] + 3 * rng.standard_normal((near, 2))
    return rng.permutation(np.vstack([at, rng.uniform(-300, 300, (far, 2))]))


def world(told, scans, rng):
    """Scans drawn from the very population, and the number of targets in each."""
    F, Q, _ = told.motion
    H, R = told.sensor
    x, out, count = np.empty((0, 4)), [], []
    for _ in range(scans):
        x = x[rng.random(len(x)) < told.survival_probability]
        x = x @ F.T + rng.multivariate_normal(np.zeros(4), Q, len(x))
        for w, m, P in zip(*told.births, strict=True):
            x = np.vstack([x, rng.multivariate_normal(m, P, rng.poisson(w))])
        seen = x[rng.random(len(x)) < told.detection_probability]
        z = seen @ H.T + rng.multivariate_normal(np.zeros(2), R, len(seen))
        false = rng.uniform(told.clutter.low, told.clutter.high, (rng.poisson(told.clutter.uniform), 2))
        out.append(rng.permutation(np.vstack([z, false])))
        count.append(len(x))
    return out, np.array(count)


def followed(tracker, scans, belief=None):
    belief, accounts = tracker.init() if belief is None else belief, []
    for z in scans:
        belief, said = tracker.step(belief, z)
        accounts.append(said)
    return belief, accounts


# ---- a step is the paper's ----


@pytest.mark.parametrize("seed", range(5))
def test_two_scans_are_those_of_the_plain_filter(seed):
    people = spawning()
    tracker = GmPhd(people, as_it_is, prune_weight=0.0, max_components=10**9)
    p = intensity(seed)
    kappa = 10.0 / 600.0**2
    slow, belief = tuple(p), labelled(p)
    for t in range(2):
        z = scan_about(p, 7 * seed + t)
        slow = reference.phd_updated(*reference.phd_predicted(*slow, people), people, kappa, z)
        belief, said = tracker.step(belief, z)
        kept = slow[0] > 1e-12
        fast = take(said.intensity, said.intensity.w > 1e-12)
        for ours, theirs in zip(fast, slow, strict=True):
            np.testing.assert_allclose(ours, theirs[kept], rtol=1e-8, atol=1e-10)
        assert said.expected_targets == pytest.approx(slow[0].sum(), rel=1e-12)
        assert said.expected_targets == pytest.approx(said.intensity.w.sum(), rel=1e-14)


def test_a_scan_with_uneven_clutter_is_that_of_the_plain_filter():
    hill = mixture([4.0], [[0.0, 0.0]], [400.0 * np.eye(2)])
    disc = mixture([3.0], [[50.0, 0.0]], [900.0 * np.eye(2)])
    people = told()._replace(clutter=Clutter(CORNER, -CORNER, 2.0, hill, disc))
    p = intensity(3)
    z = scan_about(p, 4, near=6, far=2)
    kappa = np.array([
        2 / 600**2
        + 4 * reference.gaussian_density(row, np.zeros(2), 400 * np.eye(2))
        + (np.sum((row - [50, 0]) ** 2) <= 900) * 3 / (np.pi * 900)
        for row in z
    ])  # fmt: skip
    slow = reference.phd_updated(*reference.phd_predicted(*p, people), people, kappa, z)
    _, said = GmPhd(people, as_it_is, 0.0).step(labelled(p), z)
    assert said.expected_targets == pytest.approx(slow[0].sum(), rel=1e-12)
    ours, theirs = (np.sort(w[w > 1e-15]) for w in (said.intensity.w, slow[0]))
    np.testing.assert_allclose(ours, theirs, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_a_detection_is_false_by_the_share_of_clutter_where_it_lies(seed):
    people, p = told(), intensity(seed)
    H, R = people.sensor
    z, kappa = scan_about(p, seed), np.geomspace(1e-8, 1e-2, 6)
    targets = 0.9 * sum(
        w * np.array([reference.gaussian_density(row, H @ m, H @ P @ H.T + R) for row in z])
        for w, m, P in zip(*p, strict=True)
    )
    _, false = phd.update(labelled(p), people.sensor, z, 0.9, kappa, 1e-5)
    np.testing.assert_allclose(false, kappa / (kappa + targets), rtol=1e-9)
    assert phd.update(labelled(p), people.sensor, z[:0], 0.9, kappa[:0], 1e-5)[1].shape == (0,)
    np.testing.assert_array_equal(phd.update(phd.initial(people), people.sensor, z, 0.9, kappa, 1e-5)[1], 1.0)


def test_a_sure_lone_target_is_followed_as_by_a_kalman_filter():
    people = told(births=no_components(4), expected=1e-9, detection=1.0, survival=1.0)
    rng = np.random.default_rng(1)
    m, P = np.array([0.0, 0, 3, 1]), np.diag([50.0, 50, 4, 4])
    for factory in FILTERS:
        tracker = factory(people)
        belief = labelled(gaussian(m, P))
        if factory is gm_cphd:
            belief = CphdBelief(belief, np.eye(51)[1])
        x, A = m, P
        for t in range(20):
            z = np.array([3.0 * t, t]) + 3 * rng.standard_normal(2)
            x, A = reference.kalman_update(*reference.kalman_predict(x, A, *people.motion), *people.sensor, z)
            belief, said = tracker.step(belief, z[None])
            np.testing.assert_allclose(said.x, x[None], rtol=1e-9)
            np.testing.assert_allclose(said.intensity.P, A[None], rtol=1e-9)
            assert said.label.tolist() == [0] and said.existence == pytest.approx([1.0], abs=1e-6)


def test_an_empty_scan_leaves_what_is_missed():
    p = intensity(2)
    people = spawning()
    _, said = GmPhd(people, as_it_is, 0.0).step(labelled(p), [])
    predicted = reference.phd_predicted(*p, people)
    np.testing.assert_allclose(said.intensity.w, 0.1 * predicted[0], rtol=1e-12)
    np.testing.assert_allclose(said.intensity.m, predicted[1], rtol=1e-12)
    np.testing.assert_allclose(said.intensity.P, predicted[2], rtol=1e-12)


def test_two_identical_detections_count_as_two():
    p = gaussian(np.zeros(4), np.diag([9.0, 9, 1, 1]))
    people = told(births=no_components(4))
    z = np.zeros((2, 2))
    slow = reference.phd_updated(*reference.phd_predicted(*p, people), people, 10.0 / 600.0**2, z)
    _, said = gm_phd(people).step(labelled(p), z)
    assert said.expected_targets == pytest.approx(slow[0].sum(), rel=1e-9) and said.expected_targets > 1.5
    # one component, two targets: of the second nothing is known from scan to scan
    assert len(said.intensity.w) == 1 and said.label.tolist() == [0, -1]
    np.testing.assert_array_equal(said.x[0], said.x[1])
    np.testing.assert_allclose(said.existence, [1.0, min(said.expected_targets - 1, 1.0)], rtol=1e-12)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.integers(0, 8), st.sampled_from(FILTERS))
def test_the_order_of_components_and_of_detections_counts_for_nothing(seed, n, k, factory):
    rng = np.random.default_rng(seed)
    p, tracker = intensity(seed, n), factory(spawning())
    z = scan_about(p, seed, near=k, far=k)

    def after(p, z):
        targets = labelled(p)
        number = np.eye(51)[:4].mean(axis=0)
        said = tracker.step(CphdBelief(targets, number) if factory is gm_cphd else targets, z)[1]
        order = np.argsort(said.intensity.w)
        return take(said.intensity, order), np.sort(said.existence)

    q, existence = after(p, z)
    turned, as_sure = after(take(p, rng.permutation(n)), rng.permutation(z))
    for ours, theirs in zip(q, turned, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(existence, as_sure, rtol=1e-9)


# ---- reduction ----


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 25), st.sampled_from([0.0, 0.5, 4.0, 50.0]))
def test_vo_and_ma_merge_the_groups_of_the_plain_listing(seed, n, distance):
    p = intensity(seed, n, spread=1.5)
    q, origin = vo_ma(p, n, distance)
    groups = reference.vo_ma_groups(*p, distance)
    assert {frozenset(np.flatnonzero(origin == g).tolist()) for g in range(len(q.w))} == set(groups)
    for g in range(len(q.w)):
        match = reference.moment_match(*(a[origin == g] for a in p))
        for ours, theirs in zip((q.w[g], q.m[g], q.P[g]), match, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("total", [1e-4, 1.0, 30.0])
def test_a_reduction_keeps_the_number_of_targets_and_does_not_care_what_it_is(name, total):
    unit = intensity(5, 12, 1.0, 4.0)
    p = unit._replace(w=total * unit.w)
    q, origin = reduction_named(name, 12 if name == "vo-ma" else 4, 4.0)(p)
    same, where = reduction_named(name, 12 if name == "vo-ma" else 4, 4.0)(unit)
    np.testing.assert_array_equal(origin, where)
    np.testing.assert_allclose(q.w, total * same.w, rtol=1e-9)
    if name not in LOSING:
        assert q.w.sum() == pytest.approx(total, rel=1e-12)
    if name not in LOSING and name not in UNLIKE_MOMENTS:
        for ours, theirs in zip(moments(q), moments(p), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-8)


def test_heavy_components_are_merged_without_a_limit_to_their_weight():
    p = Mixture(np.array([3.0, 2.5]), np.zeros((2, 4)), np.stack([np.eye(4)] * 2))
    assert vo_ma(p, 5)[0].w.tolist() == [5.5]


def test_vo_and_ma_measure_by_the_covariance_of_the_lighter():
    P = np.stack([100.0 * np.eye(1), np.eye(1)])
    apart = Mixture(np.array([1.0, 0.5]), np.array([[0.0], [5.0]]), P)
    assert len(vo_ma(apart, 5, 4.0)[0].w) == 2
    assert len(vo_ma(apart._replace(w=apart.w[::-1].copy()), 5, 4.0)[0].w) == 1


def test_of_too_many_merged_the_heaviest_stay_and_nothing_is_made_of_nothing():
    p = Mixture(np.array([0.2, 0.0, 0.7, 0.1]), np.array([[0.0], [200], [200], [300]]), np.ones((4, 1, 1)))
    q, origin = vo_ma(p, 2)
    assert q.w.tolist() == [0.7, 0.2] and origin.tolist() == [1, -1, 0, -1]


@pytest.mark.parametrize("factory", FILTERS)
@pytest.mark.parametrize("name", EVERY)
def test_every_reduction_runs_and_accounts_for_what_it_kept(factory, name):
    people = spawning()
    scans, _ = world(told(), 6, np.random.default_rng(2))
    tracker = factory(people, components=8, reduction=name)
    for said in followed(tracker, scans)[1]:
        assert len(said.intensity.w) <= 8
        assert said.expected_targets == pytest.approx(said.intensity.w.sum(), rel=1e-12)
        assert np.isfinite(said.x).all() and (said.existence <= 1).all() and (said.existence > 0).all()
        assert len(said.x) == len(said.existence) == len(said.label)
        for covariance in said.intensity.P:
            np.linalg.cholesky(covariance)


# ---- names ----


def test_crossing_targets_are_told_apart_and_labels_last():
    births = mixture(
        [0.1, 0.1], [[-100.0, -100, 10, 10], [-100, 100, 10, -10]], [np.diag([25.0, 25, 4, 4])] * 2
    )
    rng = np.random.default_rng(0)
    tracker = gm_phd(told(births, detection=0.98))
    scans = []
    for t in range(1, 21):
        x = np.array([[-100.0 + 10 * t, -100 + 10 * t], [-100 + 10 * t, 100 - 10 * t]])
        scans.append(np.vstack([x + rng.standard_normal((2, 2)), rng.uniform(-300, 300, (5, 2))]))
    accounts = followed(tracker, scans)[1]

    def by_label(said):
        return {
            int(label): x
            for label, x, sure in zip(said.label, said.x, said.existence, strict=True)
            if sure > 0.8
        }

    early, late = by_label(accounts[4]), by_label(accounts[-1])
    assert len(early) == 2 and early.keys() == late.keys()
    for label in early:
        # x grows alike for both; each goes on to the other side
        assert np.sign(early[label][1]) == -np.sign(late[label][1])


def test_no_label_is_given_twice_and_survivors_keep_theirs():
    first = phd.predict(phd.initial(spawning()), spawning())
    second = phd.predict(first, spawning())
    assert first.label.tolist() == [0, 1] and second.label.tolist() == [0, 1, 2, 3, 4, 5]
    assert phd.predict(second, spawning()).next_label == 6 + 6 + 2


def test_labels_named_in_a_scan_differ():
    scans, _ = world(told(expected=30.0), 40, np.random.default_rng(8))
    tracker = gm_phd(spawning(expected=30.0))
    for said in followed(tracker, scans)[1]:
        named = said.label[said.label >= 0]
        assert len(np.unique(named)) == len(named)


def test_of_two_children_of_one_target_the_heavier_keeps_its_label_and_the_other_a_new_one():
    w = np.array([0.6, 0.9, 0.2])
    belief = LabelledIntensity(intensity(1, 3)._replace(w=w), np.array([4, 4, 4]), 9)
    belief, said = phd.report(belief, told().clutter)
    assert said.label.tolist() == [4, 9] and said.existence.tolist() == [0.9, 0.6]
    assert belief.label.tolist() == [9, 4, 4] and belief.next_label == 10


def test_what_is_merged_has_the_label_of_its_heaviest_part():
    p = Mixture(np.array([0.3, 0.8, 0.1, 0.8]), np.zeros((4, 2)), np.stack([np.eye(2)] * 4))
    belief = phd.reduce_intensity(LabelledIntensity(p, np.array([5, 6, 7, 8]), 9), lambda q: vo_ma(q, 3), 10)
    assert belief.label.tolist() == [6]
    only = phd.reduce_intensity(LabelledIntensity(p, np.array([5, 6, 7, 8]), 9), as_it_is, 2)
    assert only.label.tolist() == [6, 8] and only.intensity.w.tolist() == [0.8, 0.8]


def test_a_component_of_weight_w_names_as_many_as_w_rounds_to():
    p = intensity(1, 4)._replace(w=np.array([2.6, 0.5, 0.51, 1.4]))
    said = phd.report(labelled(p), told().clutter)[1]
    np.testing.assert_allclose(said.existence, [1, 1, 1, 0.6, 0.51])
    assert said.label.tolist() == [0, -1, 3, -1, 2]
    assert phd.report(labelled(p), told().clutter, 2)[1].label.tolist() == [0, -1]
    assert len(phd.report(labelled(p), told().clutter, 0)[1].x) == 0


# ---- edges ----


@pytest.mark.parametrize("factory", FILTERS)
def test_nothing_born_and_nothing_there_is_nothing_said(factory):
    tracker = factory(told(births=no_components(4)))
    _, accounts = followed(tracker, [np.zeros((3, 2)), []])
    assert [said.expected_targets for said in accounts] == [0.0, 0.0] and accounts[-1].x.shape == (0, 4)


@pytest.mark.parametrize("factory", [*FILTERS, learning_phd, fitted_phd])
@pytest.mark.parametrize("name", EVERY)
def test_births_of_no_weight_are_none(factory, name):
    births = told().births
    weightless = factory(told(births=births._replace(w=0.0 * births.w)), reduction=name, prune_weight=0.0)
    _, accounts = followed(weightless, [np.zeros((3, 2)), []])
    _, wanted = followed(
        factory(told(births=no_components(4)), reduction=name, prune_weight=0.0), [np.zeros((3, 2)), []]
    )
    for said, none in zip(accounts, wanted, strict=True):
        assert said.expected_targets == none.expected_targets == 0.0 and said.x.shape == (0, 4)


@pytest.mark.parametrize("factory", FILTERS)
@pytest.mark.parametrize("prune_weight", [0.0, 1e-5])
def test_a_hundred_scans_of_nothing_stay_finite(factory, prune_weight):
    people = told()
    tracker = factory(people, prune_weight=prune_weight, components=30)
    scans, _ = world(people, 5, np.random.default_rng(1))
    _, accounts = followed(tracker, scans + [[]] * 100)
    last = accounts[-1]
    assert all(np.isfinite(a).all() for a in last.intensity)
    assert 0 < last.expected_targets < 0.2 and len(last.x) == 0


@pytest.mark.parametrize("factory", FILTERS)
def test_a_sure_target_that_is_not_there_is_forgotten_or_kept_but_stays_finite(factory):
    people = told(births=no_components(4), detection=1.0, survival=1.0)
    belief = labelled(gaussian(np.zeros(4), np.eye(4)))
    if factory is gm_cphd:
        belief = CphdBelief(belief, np.eye(51)[1])
    said = followed(factory(people), [[]] * 3, belief)[1][-1]
    assert said.expected_targets == (1.0 if factory is gm_cphd else 0.0)


def test_births_far_away_change_nothing_here():
    here = told()
    far = mixture(here.births.w, here.births.m, here.births.P)
    far = Mixture(
        np.append(far.w, 0.1), np.vstack([far.m, [1e9, 1e9, 0, 0]]), np.concatenate([far.P, far.P[:1]])
    )
    scans, _ = world(here, 8, np.random.default_rng(5))
    # of a CPHD filter that is not so: it weighs all targets against one number
    near = followed(gm_phd(here), scans)[1][-1]
    both = followed(gm_phd(here._replace(births=far)), scans)[1][-1]
    inside = np.abs(both.intensity.m[:, 0]) < 1e6
    assert both.intensity.w[inside].sum() == pytest.approx(near.expected_targets, rel=1e-9)


@pytest.mark.parametrize("factory", FILTERS)
def test_ten_thousand_detections(factory):
    rng = np.random.default_rng(0)
    people = told(expected=1e4)
    z = rng.uniform(-300, 300, (10_000, 2))
    _, accounts = followed(factory(people), [z, z[::-1]])
    assert np.isfinite(accounts[-1].expected_targets) and accounts[-1].expected_targets < 2


@pytest.mark.parametrize("factory", FILTERS)
@pytest.mark.parametrize(
    "z, words", [(np.full((1, 2), np.nan), "row 0"), (np.zeros(2), "shape"), (np.zeros((2, 3)), "shape")]
)
def test_no_scan_is_refused_in_words(factory, z, words):
    tracker = factory(told())
    with pytest.raises(ValueError, match=words):
        tracker.step(tracker.init(), z)


@pytest.mark.parametrize("factory", FILTERS)
@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"components": 0}, "components"),
        ({"merging": -1.0}, "merging must be a number, at least 0"),
        ({"merging": np.nan}, "merging"),
        ({"prune_weight": -1e-5}, "prune_weight"),
        ({"reduction": "runnals"}, "did you mean 'runnalls'"),
    ],
)
def test_a_wrong_parameter_is_refused_when_the_tracker_is_made(factory, wrong, words):
    with pytest.raises(ValueError, match=words):
        factory(told(), **wrong)


@pytest.mark.parametrize("wrong", [0, 2.5])
def test_a_wrong_number_of_targets_is_refused(wrong):
    with pytest.raises(ValueError, match="targets"):
        gm_cphd(told(), targets=wrong)


def test_the_gate_leaves_out_nothing_that_counts():
    """A detection at eleven deviations is the target's where clutter is all but impossible."""
    p = gaussian(np.zeros(4), np.diag([16.0, 16, 1e-3, 1e-3]))
    people = told(births=no_components(4), expected=1e-40)
    z = np.array([[55.0, 0.0]])
    slow = reference.phd_updated(*reference.phd_predicted(*p, people), people, 1e-40 / 600.0**2, z)
    _, said = gm_phd(people).step(labelled(p), z)
    assert said.expected_targets == pytest.approx(slow[0].sum(), rel=1e-9) and said.expected_targets > 1


def test_a_detection_that_clutter_cannot_explain_is_a_target_without_overflow():
    p = gaussian(np.zeros(4), np.eye(4))
    q, false = phd.update(labelled(p), told().sensor, np.zeros((1, 2)), 0.9, np.array([5e-324]), 1e-5)
    assert q.intensity.w.sum() == pytest.approx(1.1, rel=1e-12) and 0 <= false[0] < 1e-300


@pytest.mark.parametrize("kappa", [1e-300, 1e-200, 1e-3, 1e6])
@pytest.mark.parametrize("there", [1.0, 0.4])
def test_a_lone_target_is_bayes_in_clutter_of_any_density(kappa, there):
    people, z = told(births=no_components(4)), np.array([[0.3, 0.0], [21.0, 0.0]])
    p = gaussian(np.zeros(4), np.diag([25.0, 25, 1, 1]))
    p, number = p._replace(w=np.array([there])), np.array([1 - there, there])
    S = p.P[0, :2, :2] + 9.0 * np.eye(2)
    log_hit = np.log(0.9) + multivariate_normal(cov=S).logpdf(z) - np.log(kappa)
    given = people.sensor, z, 0.9, np.full(2, kappa), 0.0
    # of one target at most it is one of the detections, or none; or there is no target
    with np.errstate(divide="ignore"):
        log_w = np.log([0.1 * there, there, there, 1 - there])
    log_w[1:3] += log_hit
    w = np.exp(log_w - np.logaddexp.reduce(log_w))
    q, after = cardinality.update(labelled(p), number, *given)
    np.testing.assert_allclose(after[1], w[:3].sum(), rtol=1e-9)
    np.testing.assert_allclose(q.intensity.w, w[:3][w[:3] > 0], rtol=1e-9)
    # each detection for itself
    counted, false = phd.update(labelled(p), *given)
    each = np.exp(np.log(there) + log_hit - np.logaddexp(np.log(there) + log_hit, 0.0))
    np.testing.assert_allclose(counted.intensity.w, [0.1 * there, *each], rtol=1e-9)
    np.testing.assert_allclose(false, 1 - each, rtol=1e-9, atol=1e-15)


# ---- cardinality ----


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("detection", [0.7, 1.0])
def test_a_cphd_scan_is_that_of_the_printed_sums(seed, detection):
    people = told(births=no_components(4), detection=detection)
    rng = np.random.default_rng(seed)
    p, number = intensity(seed, 4), rng.dirichlet(np.ones(7))
    z = scan_about(p, seed, near=3, far=2)
    kappa = np.full(5, 10.0 / 600.0**2)
    slow, after = reference.cphd_updated(*p, number, people, kappa, 10.0, z)
    q, ours = cardinality.update(labelled(p), number, people.sensor, z, detection, kappa, 1e-12)
    np.testing.assert_allclose(ours, after, rtol=1e-9, atol=1e-15)
    for fast, exact in zip(q.intensity, slow, strict=True):
        np.testing.assert_allclose(fast, exact[slow[0] >= 1e-12], rtol=1e-8, atol=1e-10)
    # the weights sum to the mean number
    assert q.intensity.w.sum() == pytest.approx(np.arange(7) @ ours, rel=1e-9)


def test_with_a_poisson_number_the_cphd_scan_is_the_phd_scan():
    people, p = told(births=no_components(4)), intensity(3, total=1.5)
    z = scan_about(p, 3, near=4, far=10)
    given = people.sensor, z, 0.9, np.full(14, 10.0 / 600.0**2), 1e-12
    number = cardinality.cardinality_transition(1.0, 0.0, 1.5, 60)[:, 0]
    counted = cardinality.update(labelled(p), number, *given)[0].intensity
    plain = phd.update(labelled(p), *given)[0].intensity
    for ours, theirs in zip(counted, plain, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-8, atol=1e-10)


def test_a_number_that_is_known_stays_known():
    people = told(births=no_components(4), survival=1.0)
    p = intensity(6, 3, 3.0)
    belief = CphdBelief(labelled(p), np.eye(51)[3])
    for t in range(10):
        belief, said = gm_cphd(people, prune_weight=0.0).step(belief, scan_about(p, t))
        np.testing.assert_allclose(belief.cardinality, np.eye(51)[3], atol=1e-12)
        assert said.expected_targets == pytest.approx(3.0, rel=1e-9) and len(said.x) == 3


def test_the_number_ahead_is_of_those_who_survive_spawn_and_are_born():
    moves = cardinality.cardinality_transition(0.9, 0.1, 0.3, 80)
    np.testing.assert_allclose(moves.sum(axis=0)[:20], 1, rtol=1e-12)
    np.testing.assert_allclose(np.arange(81) @ moves[:, :20], 0.3 + 1.0 * np.arange(20), rtol=1e-12)


def test_the_expected_number_is_unbiased_where_the_world_is_as_told():
    """Four standard errors over 200 independent worlds of 20 scans; seeds are fixed."""
    people, gap = told(), []
    tracker = gm_phd(people, prune_weight=1e-8, components=200)
    for seed in range(200):
        scans, count = world(people, 20, np.random.default_rng(seed))
        said = followed(tracker, scans)[1]
        gap.append(np.mean([a.expected_targets for a in said] - count))
    assert abs(np.mean(gap)) < 4 * np.std(gap, ddof=1) / np.sqrt(len(gap))


def test_what_a_scan_says_of_the_number_is_on_average_what_was_so_before():
    """Four standard errors over 1000 draws of independent targets, two or five, none of which moves."""
    people, rng = told(births=no_components(4), detection=0.7), np.random.default_rng(0)
    p, number = intensity(4, 3, 3.5, spread=40.0), np.array([0, 0, 0.5, 0, 0, 0.5])
    H, R = people.sensor
    after, sums, kappa = [], [], 10.0 / 600.0**2
    for _ in range(1000):
        at = rng.choice(3, p=p.w / p.w.sum(), size=rng.choice([2, 5]))
        x = np.array([rng.multivariate_normal(p.m[i], p.P[i]) for i in at])
        seen = x[rng.random(len(x)) < 0.7] @ H.T
        seen = seen + rng.multivariate_normal(np.zeros(2), R, len(seen))
        z = np.vstack([seen, rng.uniform(-300, 300, (rng.poisson(10.0), 2))])
        q, after_scan = cardinality.update(
            labelled(p), number, people.sensor, z, 0.7, np.full(len(z), kappa), 0.0
        )
        after.append(after_scan)
        sums.append(q.intensity.w.sum())
    assert abs(np.mean(after, axis=0) - number).max() < 4 * np.std(after, axis=0).max() / np.sqrt(1000)
    assert abs(np.mean(sums) - 3.5) < 4 * np.std(sums) / np.sqrt(1000)
    np.testing.assert_allclose(sums, np.array(after) @ np.arange(6), rtol=1e-9)


def test_the_parameters_are_fields():
    tracker = gm_phd(told(), prune_weight=1e-3)
    assert isinstance(tracker, GmPhd) and tracker.prune_weight == 1e-3
    assert (
        isinstance(gm_cphd(told(), targets=9), GmCphd)
        and gm_cphd(told(), targets=9).init().cardinality.size == 10
    )
    _, said = tracker.step(tracker.init(), np.array([[0.0, 0.0]]))
    assert said.clutter is tracker.model.clutter and normalised(said.intensity).w.sum() == pytest.approx(1)


def test_six_states_of_constant_acceleration():
    births = mixture([0.2], [np.zeros(6)], [np.diag([25.0, 25, 9, 9, 1, 1])])
    people = multi_target_model(
        constant_acceleration(1.0, 0.3), position_sensor(3.0, rates=2), 0.95, 0.99, births,
        uniform_clutter(CORNER, -CORNER, 5.0),
    )  # fmt: skip
    scans = [np.array([[2.0 * t, t**2 / 4]]) for t in range(1, 16)]
    said = followed(gm_phd(people), scans)[1][-1]
    assert np.linalg.norm(said.x[0, :2] - scans[-1][0]) < 5 and said.existence[0] > 0.9


BIRTH = mixture([0.2], [np.zeros(4)], [np.diag([25.0, 25, 9, 9])])
EVEN = uniform_clutter(CORNER, -CORNER, 5.0)
ONE = mixture([1.0], [np.zeros(2)], [np.eye(2)])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"births": BIRTH._replace(w=np.array([-0.1]))}, "births.w must be finite and non-negative"),
        ({"births": BIRTH._replace(w=np.array([np.nan]))}, "births.w must be finite and non-negative"),
        ({"births": BIRTH._replace(m=np.full((1, 4), np.nan))}, "births.m must be finite"),
        ({"births": BIRTH._replace(P=-BIRTH.P)}, r"births.P\[0\] must be positive definite"),
        ({"clutter": EVEN._replace(uniform=np.inf)}, "clutter.uniform must be positive and finite"),
        ({"clutter": EVEN._replace(uniform=1e-304)}, "clutter.uniform over the volume of its box must"),
        ({"clutter": uniform_clutter([-1e200] * 2, [1e200] * 2, 5.0)}, "over the volume of its box must"),
        ({"clutter": uniform_clutter([0.0] * 2, [1e-200] * 2, 5.0)}, "over the volume of its box must"),
        (
            {"clutter": EVEN._replace(high=np.array([np.inf, 1.0]))},
            "clutter must be over a finite box of 2",
        ),
        (
            {"clutter": EVEN._replace(gaussians=ONE._replace(w=np.array([-5.0])))},
            "clutter.gaussians.w must be finite and non-negative",
        ),
        (
            {"clutter": EVEN._replace(ellipses=ONE._replace(P=0 * ONE.P))},
            r"clutter.ellipses.P\[0\] must be positive definite",
        ),
    ],
)
def test_an_intensity_that_is_none_is_refused_by_name(wrong, message):
    right = {"births": BIRTH, "clutter": EVEN}
    with pytest.raises(ValueError, match=message):
        multi_target_model(constant_velocity(1.0, 1.0), position_sensor(3.0), 0.9, 0.99, **(right | wrong))


@pytest.mark.parametrize("make", [gm_cphd, learning_phd, fitted_phd, learning_pmb])
def test_a_sensor_that_is_not_linear_is_refused(make):
    model = multi_target_model(
        constant_velocity(1.0, 1.0, axes=3), radar([10.0, 0.01, 0.01]), 0.9, 0.99, no_components(6),
        uniform_clutter([0.0] * 3, [1.0] * 3, 5.0),
    )  # fmt: skip
    with pytest.raises(ValueError, match="needs a linear sensor, a Sensor of positions, got a Radar"):
        make(model)


def test_something_that_is_no_sensor_is_refused():
    with pytest.raises(ValueError, match="sensor must be a Sensor or a Radar, got a str"):
        multi_target_model(constant_velocity(1.0, 1.0), "eyes", 0.9, 0.99, BIRTH, EVEN)


@pytest.mark.parametrize(("estimator", "declared"), [("expected", 1), ("components", 0)])
def test_a_target_in_two_components_is_declared_by_the_expected_number_alone(estimator, declared):
    tracker = GmPhd(told(), as_it_is, estimator=estimator)
    two = mixture([0.45, 0.5], [[0.0, 0, 0, 0], [3.0, 0, 0, 0]], [np.eye(4)] * 2)
    _, report = tracker.report(phd.LabelledIntensity(two, np.arange(2), 2), tracker.model.clutter)
    assert len(report.x) == declared


def test_an_unknown_estimator_is_refused():
    with pytest.raises(ValueError, match=r"estimator must be .*expected.*components.*'both'"):
        GmPhd(told(), as_it_is, estimator="both")


def test_of_one_motion_the_filter_over_modes_is_that_without():
    plain, general = gm_phd(spawning(), 20), ModePhd(spawning(), reduction_named("vo-ma", 20, 4.0))
    one, other = plain.init(), general.init()
    for seed in range(8):
        z = np.random.default_rng(seed).uniform(-120, 120, (12, 2))
        (one, report), (other, again) = plain.step(one, z), general.step(other, z)
        np.testing.assert_array_equal(report.label, again.label)
        np.testing.assert_allclose(report.x, again.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(report.intensity.w, again.intensity.w, rtol=1e-9)
        np.testing.assert_allclose(report.intensity.P, again.intensity.P, rtol=1e-9, atol=1e-9)


def test_a_target_that_turns_is_followed_by_the_filter_of_two_motions():
    motions = constant_velocity(1.0, 0.1), constant_velocity(1.0, 20.0)
    births = mixture([0.05], [[0.0, 0, 20, 0]], [np.diag([100.0, 100, 9, 9])])
    rng, corner = np.random.default_rng(0), np.array([-600.0, -600.0])
    x = np.cumsum([[20.0, 0]] * 8 + [[0, 20.0]] * 8, axis=0)
    z = [np.vstack([row + 3 * rng.standard_normal(2), rng.uniform(-600, 600, (5, 2))]) for row in x]

    def missed(motion, **modes):
        model = multi_target_model(
            motion, position_sensor(3.0), 0.95, 0.99, births, uniform_clutter(corner, -corner, 5.0), **modes
        )
        tracker, out = gm_phd(model, 30), 0
        belief = tracker.init()
        for scan, at in zip(z, x, strict=True):
            belief, report = tracker.step(belief, scan)
            off = np.linalg.norm(report.x[:, :2] - at, axis=1)
            out += not (off < 12.0).any()
        return out

    assert missed(motions, switching=sticky_switching(0.9, 2)) <= 1
    assert missed(motions[0]) >= 4


def test_components_keep_their_modes_where_they_are_merged():
    births = mixture([0.5], [[0.0, 0, 0, 0]], [np.diag([100.0, 100, 9, 9])])
    motions, switching = (constant_velocity(1.0, 0.1), constant_velocity(1.0, 20.0)), sticky_switching(0.9, 2)
    model = multi_target_model(
        motions, position_sensor(3.0), 0.9, 0.98, births, EVEN, switching=switching, mode_prior=[0.8, 0.2]
    )
    tracker = gm_phd(model, 1, reduction="runnalls")
    posterior, _ = tracker.update(tracker.init(), np.array([[1.0, 2.0], [-8.0, 4.0]]), model.clutter)
    (w, densities), *_ = posterior
    ((total, merged), *_), _ = tracker.report(posterior, model.clutter)
    np.testing.assert_allclose(total, [w.sum()], rtol=1e-12)
    np.testing.assert_allclose(merged.w[0], w @ densities.w / w.sum(), rtol=1e-12)
    for q in range(2):
        mean, covariance = moments(mixture(w * densities.w[:, q], densities.m[:, q], densities.P[:, q]))
        np.testing.assert_allclose(merged.m[0, q], mean, rtol=1e-10)
        np.testing.assert_allclose(merged.P[0, q], covariance, rtol=1e-10, atol=1e-10)
