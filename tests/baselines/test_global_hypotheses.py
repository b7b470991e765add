"""Trackers by global hypotheses, where scans are hostile and options wrong."""

import numpy as np
import pytest

from gmr_gym.filters.registry import make_tracker
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.scenarios.williams import meeting_targets
from gmr_gym.simulation.multi_target import draw, scan

NAMES = ["pmbm", "mbm", "delta-glmb", "tomht"]
each = pytest.mark.parametrize("name", NAMES)


def played(tracker, scans):
    belief, reports = tracker.init(), []
    for z in scans:
        belief, report = tracker.step(belief, z)
        for a in (report.x, report.existence, report.intensity.w, report.intensity.m, report.intensity.P):
            assert np.isfinite(a).all()
        assert ((report.existence >= 0) & (report.existence <= 1)).all()
        assert len(set(report.label.tolist())) == len(report.label)
        reports.append(report)
    return reports


def around(rng, k, spread=1.0):
    return 100 + spread * rng.standard_normal((k, 2))


@each
@pytest.mark.parametrize("p_detected", [0.9, 1.0])
def test_hostile_scans(name, p_detected):
    tracker, rng = make_tracker(name, meeting_targets(p_detected).model), np.random.default_rng(0)
    played(tracker, [np.full((4, 2), 100.0)] * 4)  # targets and detections in one place
    silent = played(tracker, [around(rng, 3)] * 3 + [np.empty((0, 2))] * 60)
    assert silent[-1].expected_targets < 0.2 and len(silent[-1].x) == 0
    played(tracker, [around(rng, 2), rng.uniform(0, 300, (400, 2)), around(rng, 2)])


@pytest.mark.parametrize("name", ["pmbm", "delta-glmb", "tomht"])
def test_labels_are_never_reused(name):
    tracker, rng = make_tracker(name, meeting_targets().model), np.random.default_rng(1)
    lives = [[np.array([[x, 100.0]]) + 0.3 * rng.standard_normal((1, 2))] * 6 for x in (80.0, 120.0, 160.0)]
    reports = played(tracker, [z for life in lives for z in (*life, *[np.empty((0, 2))] * 8)])
    seen = [set().union(*(r.label.tolist() for r in reports[t : t + 14])) for t in (0, 14, 28)]
    assert all(len(s) == 1 for s in seen) and len(set().union(*seen)) == 3


@each
def test_labels_go_on_beyond_32_bits(name):
    tracker, rng = make_tracker(name, meeting_targets().model), np.random.default_rng(2)
    belief = tracker.init()._replace(next_label=2**31)
    for _ in range(8):
        belief, report = tracker.step(belief, around(rng, 1, 0.5))
    assert len(report.label) == 1 and 2**31 <= report.label[0] < belief.next_label


@pytest.mark.parametrize("name", ["pmbm", "delta-glmb", "tomht"])
def test_four_targets_are_tracked_through_their_meeting(name):
    world = meeting_targets(truth_seed=1)
    tracker, episode = make_tracker(name, world.model), draw(world, 0)
    reports = played(tracker, [scan(episode, t).z for t in range(world.horizon)])
    assert all(len(r.x) == 4 for r in reports[20:36]) and np.mean([len(r.x) for r in reports[60:]]) < 3.6


@pytest.mark.parametrize("name", ["pmbm", "delta-glmb", "tomht"])
def test_of_two_equal_motions_each_is_as_likely_and_the_targets_are_the_same(name):
    one = meeting_targets(truth_seed=1)
    told = one.model
    two = multi_target_model(
        (told.motion, told.motion), told.sensor, 0.9, told.survival_probability, told.births, told.clutter,
        initial=told.initial, switching=np.full((2, 2), 0.5),
    )  # fmt: skip
    scans = [scan(draw(one, 0), t).z for t in range(12)]
    for a, b in zip(*(played(make_tracker(name, m), scans) for m in (told, two)), strict=True):
        # gates of half the weight are a little narrower
        assert a.expected_targets == pytest.approx(b.expected_targets, rel=1e-3)
        np.testing.assert_allclose(np.sort(a.x[:, 0]), np.sort(b.x[:, 0]), atol=1e-3)


@each
def test_a_target_sure_to_survive_and_to_be_detected_that_is_not_has_gone(name):
    told, rng = meeting_targets(1.0).model, np.random.default_rng(0)
    told = told._replace(survival_probability=1.0)
    *_, seen, empty = played(make_tracker(name, told), [around(rng, 1, 0.5)] * 12 + [np.empty((0, 2))])
    assert len(seen.x) == 1 and len(empty.x) == 0 and empty.expected_targets < 1e-2


@pytest.mark.parametrize(("name", "option"), [("mbm", {}), ("delta-glmb", {"births": "model"})])
def test_tracks_born_alike_are_not_declared_by_marginals(name, option):
    with pytest.raises(ValueError, match="estimator"):
        make_tracker(name, meeting_targets().model, estimator="marginal", **option)


@pytest.mark.parametrize(
    ("name", "option", "value"),
    [
        ("pmbm", "hypotheses", 0), ("pmbm", "prune_existence", 0.5), ("pmbm", "prune_hypotheses", 1.0),
        ("pmbm", "memory", 0), ("pmbm", "components", 0), ("pmbm", "estimator", "mean"),
        ("pmbm", "samples", -1),
        ("mbm", "tracks", 0.5), ("mbm", "report_threshold", 2.0), ("delta-glmb", "births", "nowhere"),
        ("delta-glmb", "association", "auction"), ("delta-glmb", "hypotheses", 0), ("tomht", "scans", -1),
        ("tomht", "leaves", 0), ("tomht", "prune_leaves", 2.0), ("tomht", "false_tracks", 0.0),
        ("tomht", "memory", 0), ("tomht", "prune_existence", 0.9), ("tomht", "components", 0),
    ],
)  # fmt: skip
def test_a_wrong_option_is_named(name, option, value):
    with pytest.raises(ValueError, match=option):
        make_tracker(name, meeting_targets().model, **{option: value})
