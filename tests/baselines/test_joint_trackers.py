"""GNN, JPDA, JIPDA, LMB and PMB of mixtures as trackers: what they find, keep and bear."""

from functools import partial
from time import perf_counter

import numpy as np
import pytest

from gmr_gym.baselines.delta_glmb import delta_glmb
from gmr_gym.baselines.gnn import gnn
from gmr_gym.baselines.jipda import jipda
from gmr_gym.baselines.jpda import jpda
from gmr_gym.baselines.learning_pmb import Pmb, pmb
from gmr_gym.baselines.lmb import lmb
from gmr_gym.filters import multi_bernoulli_mixture as mixtures
from gmr_gym.filters import track_logic as logic_of
from gmr_gym.filters.mixture_pmb import MixturePmb
from gmr_gym.filters.track_logic import track_logic
from gmr_gym.mixture import mixture
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.models.radar import radar
from gmr_gym.models.switching import sticky_switching

CORNER = np.array([-300.0, -300.0])
BIRTHS = [[100.0, 0, 0, 5], [-100, 50, 5, 0]], [np.diag([100.0, 100, 9, 9])] * 2
TRACKERS = [
    gnn, jpda, partial(jpda, labels="exchanged"), jipda, lmb, partial(lmb, births="model"),
    partial(pmb, components=3), partial(pmb, projection="momb"), partial(pmb, projection="variational"),
]  # fmt: skip


def told(expected=10.0, detection=0.9, births=(0.01, 0.01), modes=1, **kwargs):
    motions = tuple(constant_velocity(1.0, 1.0 + 4.0 * q) for q in range(modes))
    return multi_target_model(
        motions, position_sensor(3.0), detection, 0.98, mixture(births, *BIRTHS),
        uniform_clutter(CORNER, -CORNER, expected), switching=sticky_switching(0.9, modes), **kwargs,
    )  # fmt: skip


def followed(tracker, scans):
    belief, reports = tracker.init(), []
    for z in scans:
        belief, report = tracker.step(belief, z)
        reports.append(report)
        assert np.isfinite(report.x).all() and np.isfinite(report.intensity.P).all()
        assert report.expected_targets == pytest.approx(report.intensity.w.sum())
        assert len(set(report.label)) == len(report.x) == len(report.existence)
    return belief, reports


def two_walks(scans, seed, false=10):
    """Two targets from the places of birth, always seen, in clutter."""
    rng = np.random.default_rng(seed)
    x, out = np.array([[100.0, 0, 0, 5], [-100, 50, 5, 0]]), []
    for _ in range(scans):
        z = x[:, :2] + 3 * rng.standard_normal((2, 2))
        out.append(rng.permutation(np.vstack([z, rng.uniform(-300, 300, (rng.poisson(false), 2))])))
        x[:, :2] += x[:, 2:]
    return out


@pytest.mark.parametrize("options", [{}, {"modes": 2}, {"spawn_weight": 1e-4}])
@pytest.mark.parametrize("make", TRACKERS)
def test_two_targets_are_found_and_keep_their_labels(make, options):
    _, reports = followed(make(told(**options)), two_walks(15, 1))
    late = reports[6:]
    assert len({tuple(sorted(report.label)) for report in late}) == 1
    truth = np.array([[100.0, 70], [-30, 50]])
    assert len(late[-1].x) == 2
    assert np.linalg.norm(late[-1].x[:, None, :2] - truth, axis=2).min(axis=0).max() < 12  # four deviations


@pytest.mark.parametrize("make", [jpda, jipda])
def test_a_mixture_in_every_track_finds_them_too(make):
    _, reports = followed(make(told(modes=2), 3, "runnalls"), two_walks(15, 2))
    assert len(reports[-1].x) == 2


@pytest.mark.parametrize("make", TRACKERS)
def test_by_radar_a_target_is_found(make):
    sensor = radar([5.0, 0.005, 0.005])
    births = mixture([0.1], [[1000.0, 500, 300, 5, 0, 0]], [np.diag([400.0] * 3 + [9.0] * 3)])
    clutter = uniform_clutter([800.0, -1.0, -1.0], [1600.0, 1.0, 1.0], 5.0)
    model = multi_target_model(constant_velocity(1.0, 1.0, axes=3), sensor, 0.95, 0.99, births, clutter)
    rng, x, scans = np.random.default_rng(0), births.m[0].copy(), []
    for _ in range(10):
        x[:3] += x[3:]
        seen = sensor.measure(x) + rng.normal(0, [5.0, 0.005, 0.005])
        scans.append(np.vstack([rng.uniform(clutter.low, clutter.high, (5, 3)), seen]))
    _, reports = followed(make(model), scans)
    assert len(reports[-1].x) == 1
    assert np.linalg.norm(reports[-1].x[0, :3] - x[:3]) < 25.0


@pytest.mark.parametrize("make", TRACKERS)
def test_a_thousand_empty_scans_leave_nothing(make):
    belief, reports = followed(make(told()), [*two_walks(5, 2), *[np.empty((0, 2))] * 1000])
    assert len(reports[-1].x) == 0 and len(belief.tracks.label) <= 2  # those just born


@pytest.mark.parametrize("detection", [0.9, 1.0])
@pytest.mark.parametrize("make", TRACKERS)
def test_many_detections_at_once_are_borne(make, detection):
    z = np.random.default_rng(0).uniform(-300, 300, (2000, 2))
    belief, _ = followed(make(told(2000.0, detection)), [z, z, z[:0], z])
    assert len(belief.tracks.label) <= 1000


@pytest.mark.parametrize("make", TRACKERS)
def test_targets_and_detections_in_one_place_are_borne(make):
    z = np.tile([[100.0, 0.0]], (30, 1))
    belief, reports = followed(make(told(births=(5.0, 5.0))), [z] * 6)
    assert len(belief.tracks.label) <= 1000
    assert len(set(np.concatenate([report.label for report in reports]))) >= 1


@pytest.mark.parametrize("make", TRACKERS)
def test_labels_are_never_used_again(make):
    scans = [*two_walks(8, 3), *[np.empty((0, 2))] * 40, *two_walks(8, 4)]
    _, reports = followed(make(told()), scans)
    first = set(np.concatenate([report.label for report in reports[:8]]).tolist())
    later = set(np.concatenate([report.label for report in reports[48:]]).tolist())
    assert first and later and not first & later


@pytest.mark.parametrize("make", [gnn, jpda, jipda, lmb, partial(pmb, components=3)])
def test_labels_go_on_beyond_32_bits(make):
    tracker = make(told())
    belief = tracker.init()._replace(next_label=2**31)
    for z in two_walks(8, 3):
        belief, report = tracker.step(belief, z)
    assert len(report.label) == 2 and (report.label >= 2**31).all()


@pytest.mark.parametrize("make", TRACKERS)
def test_the_probability_of_a_false_alarm_is_that_of_no_target(make):
    tracker, scans = make(told()), two_walks(12, 5)
    belief, _ = followed(tracker, scans[:-1])
    z = np.vstack([scans[-1][:0], [[100.0, 55.0], [250.0, -250.0]]])
    _, false = tracker.update(belief, z, tracker.model.clutter)
    assert false[0] < 0.1 and false[1] > 0.9


def test_gnn_takes_the_assignment_of_least_cost_and_not_the_nearest_first():
    # by hand: the nearest pair is (1, 0), but then 0 would go without
    model = told(1e-3, births=(2.0, 1e-9))
    tracker = gnn(model, "m-of-n", 1, 1)
    belief, _ = followed(tracker, [[[95.0, 0.0], [105.0, 0.0]]])
    before = belief.tracks.densities.m[:, 0, :2]
    _, reports = followed_on(tracker, belief, np.array([[103.0, 5.0], [112.0, 5.0]]))
    left, right = sorted(range(2), key=lambda i: before[i, 0])
    x = reports.x[:, 0]
    assert x[left] < 103.0 < x[right]


def followed_on(tracker, belief, z):
    return tracker.step(belief, z)


def test_an_lmb_has_the_existences_of_the_delta_glmb():
    places = [[100.0, 0, 0, 5], [106, 4, 5, 0], [-100, 50, 5, 0]], [np.diag([100.0, 100, 9, 9])] * 3
    model = told(births=(1e-12, 1e-12), initial=mixture([0.4, 0.3, 0.2], *places))
    z = np.array([[101.0, 6.0], [108.0, 2.0], [97.0, 3.0], [-96.0, 51.0]])
    every = delta_glmb(model, 100_000, prune_hypotheses=0.0, births="model", association="murty")
    belief, _ = every.step(every.init(), z)
    exists = dict(zip(belief.label, mixtures.track_existence(belief), strict=True))
    alike = lmb(model, births="model", prune_existence=1e-6)
    tracks = alike.step(alike.init(), z)[0].tracks
    likely = tracks.existence > 1e-4
    assert likely.sum() == 3
    expected = sorted(r for r in exists.values() if r > 1e-4)
    np.testing.assert_allclose(np.sort(tracks.existence[likely]), expected, rtol=1e-8)


@pytest.mark.parametrize("make", TRACKERS)
def test_a_cluster_of_thirty_targets_is_bounded_work(make):
    rng = np.random.default_rng(0)
    births = mixture([30.0], [[0.0, 0, 0, 0]], [np.diag([400.0, 400, 9, 9])])
    model = told(initial=births)
    tracker = make(model)
    belief, begun = tracker.init(), perf_counter()
    for _ in range(6):
        belief, report = tracker.step(belief, rng.normal(0, 12, (33, 2)))
    assert perf_counter() - begun < 10.0
    assert report.approximated <= 1


def test_m_of_n_confirms_and_drops_by_its_counts():
    rules = track_logic("m-of-n", 2, 3, 2)
    history = logic_of.started(rules, np.zeros(4))
    hits = np.array([[1, 0, 0, 1], [0, 1, 0, 0], [0, 1, 0, 0]], bool)
    seen = []
    for hit in hits:
        history, kept = logic_of.advanced(rules, history, hit, np.zeros(4))
        seen.append((history.confirmed.tolist(), kept.tolist()))
    assert seen[0] == ([True, False, False, True], [True, True, True, True])
    assert seen[1] == ([True, True, False, True], [True, True, False, True])
    assert seen[2][1][0] is False and seen[2][1][1] is True  # two misses in a row; none


def test_scores_confirm_and_drop_at_wald_s_bounds():
    rules = track_logic("score", false_confirmation=0.01, missed_confirmation=0.02)
    assert rules.confirm == pytest.approx(np.log(98)) and rules.drop == pytest.approx(np.log(0.02 / 0.99))
    history = logic_of.started(rules, np.array([0.0, -9.0, -9.0, 5.0, 5.0]))
    assert history.confirmed.tolist() == [False, False, False, True, True]
    fall = rules.drop - rules.confirm
    gain = np.array([rules.confirm, rules.drop, rules.drop, fall, fall])
    gain += np.array([0.1, 0.1, -0.1, 0.1, -0.1])
    history, kept = logic_of.advanced(rules, history, gain > 0, gain)
    assert history.confirmed.tolist() == [True, False, False, True, True]
    assert kept.tolist() == [True, True, False, True, False]


@pytest.mark.parametrize(
    ("make", "wrong", "message"),
    [
        (gnn, {"logic": "luck"}, "logic must be"),
        (jpda, {"hits": 0}, "hits must be"),
        (jpda, {"hits": 3, "window": 2}, "window must be"),
        (gnn, {"misses": 0}, "misses must be"),
        (jpda, {"false_confirmation": 0.7, "missed_confirmation": 0.6}, "must sum to less than 1"),
        (jpda, {"labels": "lost"}, "labels must be"),
        (jpda, {"association": "hope"}, "association must be"),
        (jpda, {"components": 0}, "components must be"),
        (jpda, {"start_probability": 0.0}, "start_probability must lie"),
        (jipda, {"confirm": 0.0}, "confirm must lie"),
        (jipda, {"drop": 0.95}, "drop must be a probability less than confirm 0.9, got 0.95"),
        (jipda, {"reduction": "runnals"}, "did you mean 'runnalls'"),
        (jipda, {"tracks": 0}, "tracks must be"),
        (jipda, {"prune_weight": -1.0}, "prune_weight must be"),
        (lmb, {"prune_existence": 0.6}, "prune_existence must be"),
        (lmb, {"births": "storks"}, "births must be"),
        (lmb, {"association": "hope"}, "association must be"),
        (pmb, {"projection": "film"}, "projection must be"),
        (pmb, {"projection": "momb", "association": "hope"}, "association must be"),
        (pmb, {"hypotheses": 0}, "hypotheses must be"),
        (pmb, {"components": 2, "prune_hypotheses": 1.0}, "prune_hypotheses must lie"),
    ],
)
def test_a_wrong_option_is_named(make, wrong, message):
    with pytest.raises(ValueError, match=message):
        make(told(), **wrong)


@pytest.mark.parametrize("association", ["exact", "belief-propagation"])
def test_a_pmb_of_one_component_is_the_same_by_both_ways(association):
    model = told(spawn_weight=1e-3)
    plain = pmb(model, 1e-3, association=association)
    general = MixturePmb(model, None, association=association)
    assert isinstance(plain, Pmb)
    scans = two_walks(12, 6)
    for one, other in zip(followed(plain, scans)[1], followed(general, scans)[1], strict=True):
        np.testing.assert_array_equal(one.label, other.label)
        for field in ("x", "existence", "expected_targets"):
            np.testing.assert_allclose(getattr(one, field), getattr(other, field), rtol=1e-7, atol=1e-7)
        np.testing.assert_allclose(one.intensity.P, other.intensity.P, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("make", TRACKERS)
def test_targets_that_are_always_seen_are_confirmed(make):
    model = told(0.001, 1.0, (1e-6, 1e-6), initial=mixture([0.4, 0.4], *BIRTHS))
    assert len(followed(make(model), two_walks(8, 4, 0))[1][-1].x) == 2


def test_births_that_are_rare_beside_clutter_are_not_dropped_at_once():
    model, scans = told(births=(1e-6, 1e-6)), two_walks(10, 3)
    assert not any(len(report.x) for report in followed(pmb(model, 1e-3), scans)[1])
    assert len(followed(pmb(model), scans)[1][-1].x) == 2
    assert pmb(told()).limits.prune_existence == pytest.approx(0.2 * 0.018 / 10.018)
    assert pmb(told(births=(0.1, 0.1))).limits.prune_existence == 1e-3


def test_where_nothing_is_seen_a_track_keeps_its_existence():
    def seen(x):
        return np.where(x[:, 1] < 43.0, 0.9, 1e-6)  # behind it nothing is seen

    scans = [*two_walks(9, 7, 0), *[np.empty((0, 2))] * 10]
    for make in (jipda, pmb):
        (_, behind), (_, open_field) = (
            followed(make(told(detection=seen)), scans),
            followed(make(told()), scans),
        )
        assert len(behind[-1].x) >= 1 and len(open_field[-1].x) == 0


def after_a_meeting(labels, seed):
    """Mean distance of the worse of two targets from the nearest estimate, after they were a metre apart for
    twelve scans."""
    y = np.concatenate([np.linspace(25, 0.5, 10), np.full(12, 0.5), np.linspace(0.5, 25, 10)])
    births = mixture([1.0, 1.0], [[-150.0, 25, 5, -3], [-150, -25, 5, 3]], [np.diag([25.0, 25, 4, 4])] * 2)
    tracker = jpda(told(2.0, births=(1e-9, 1e-9), initial=births), labels=labels)
    rng, belief, off = np.random.default_rng(seed), tracker.init(), []
    for t in range(32):
        x = np.array([[-145.0 + 5 * t, y[t]], [-145.0 + 5 * t, -y[t]]])
        belief, report = tracker.step(belief, x + 3 * rng.standard_normal((2, 2)))
        off.append(np.linalg.norm(report.x[:, None, :2] - x, axis=2).min(axis=0, initial=99.0).max())
    return np.mean(off[24:])


def test_tracks_that_have_met_part_again_where_labels_are_exchanged():
    kept, exchanged = (
        np.mean([after_a_meeting(labels, seed) for seed in range(5)]) for labels in ("kept", "exchanged")
    )
    assert exchanged < 4.5 < 5.5 < kept
