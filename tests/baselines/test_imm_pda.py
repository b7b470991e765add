"""IMM-PDA in three calls a scan against the engine of any number of hypotheses, and against a slow PDA of a
radar's detections one by one; and every tracker on the radar by every sort of update."""

from functools import partial

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from gmr_gym.baselines.imm_pda import ImmPda
from gmr_gym.baselines.mht_of_banks import MhtOfBanks
from gmr_gym.checks import UNLIMITED
from gmr_gym.evaluation.loop import play
from gmr_gym.filters.filter_bank import imm_mix, no_interaction
from gmr_gym.filters.joint_gating import Limits
from gmr_gym.filters.registry import make_tracker, trackers
from gmr_gym.mixture import collapsed, gaussian
from gmr_gym.models.kalman import Motion
from gmr_gym.models.model import with_radar_update
from gmr_gym.models.radar import UPDATES, cartesian, spherical
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.simulation.single_target import draw, scan

WITH_NUMBERS = {"runnalls": "runnalls-30", "mmg": "mmg-15", "imm-mht": "imm-mht-15"}
ONE_MOTION = {
    "adaptive", "capping", "cluster", "ise", "mht", "n-scan", "nearest-neighbour", "pda", "runnalls",
    "salmond", "west",
}  # fmt: skip
LINEAR = {"adaptive-noise", "learned-cluster", "learned-n-scan", "learned-thresholds"}  # of positions alone
OF_A_RADAR = sorted(set(trackers()) - LINEAR)


def general(told, give_up_ratio=20.0):
    """The engine of many hypotheses, all merged into one after every scan."""
    return MhtOfBanks(told, one_left, imm_mix, no_interaction, Limits(0.0, UNLIMITED, give_up_ratio))


def one_left(p):
    return collapsed(p), np.zeros(len(p.w), int)


def turning(regime, clutter_rate=25.0, straight=10, scans=40):
    """The radar with a target at 298 m/s that flies straight for some scans and then turns at 5.5 g."""
    speed, load = 298.0, 5.5 * 9.80665
    t = 0.1 * np.arange(scans)
    turned = load / speed * np.maximum(t - 0.1 * straight, 0.0)
    flown = speed * np.minimum(t, 0.1 * straight) + speed**2 / load * np.sin(turned)
    aside = speed**2 / load * (1 - np.cos(turned))
    start = {"near": [11_200.0, 4_100.0, 1_500.0], "far": [51_500.0, 18_800.0, 4_000.0]}
    position = np.stack([flown, aside, 0 * t], axis=1) + start.get(regime, [137_500.0, 50_000.0, 8_000.0])
    velocity = speed * np.stack([np.cos(turned), np.sin(turned), 0 * t], axis=1)
    return airborne_radar(regime, clutter_rate, trajectory=np.hstack([position, velocity]))


def about_the_truth(scenario, seed, count):
    """The scans that a tracker would meet whose estimates are the truth, the sixth of them empty."""
    episode = draw(scenario, seed)
    scans = [scan(scenario, episode, t, spherical(episode.x[t, :3])).z for t in range(count)]
    scans[5:6] = [z[:0] for z in scans[5:6]]
    return scans


def same(got, wanted, rtol=1e-8):
    """Two arrays of means and covariances alike to a share of the deviations that are wanted."""
    (m, P), (mean, covariance) = got, wanted
    deviation = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    np.testing.assert_allclose((m - mean) / deviation, 0, atol=rtol)
    scale = deviation[..., :, None] * deviation[..., None, :]
    np.testing.assert_allclose((P - covariance) / scale, 0, atol=rtol)


def assert_same(got, wanted, rtol=1e-8):
    """Beliefs and reports of two trackers, to rounding that the recursion enlarges."""
    (belief, report), (other, wish) = got, wanted
    np.testing.assert_allclose(belief.w, other.w, rtol=rtol, atol=1e-14)
    same((belief.m, belief.P), (other.m, other.P), rtol)
    same((report.x, report.P), (wish.x, wish.P), rtol)
    np.testing.assert_allclose(report.modes, wish.modes, rtol=rtol, atol=1e-14)
    assert report.gates.z.shape == wish.gates.z.shape and report.gates.threshold == wish.gates.threshold
    np.testing.assert_allclose(report.gates.z, wish.gates.z, rtol=rtol, atol=rtol)
    np.testing.assert_allclose(
        report.gates.S, wish.gates.S, rtol=rtol, atol=rtol * np.abs(wish.gates.S).max()
    )
    assert len(report.mixture.w) == len(wish.mixture.w) == 1
    same((report.mixture.m, report.mixture.P), (wish.mixture.m, wish.mixture.P), rtol)
    assert report.alive == wish.alive


def flown_alike(told, scans, give_up_ratio=20.0):
    """Belief and report after each scan, the same by both."""
    fast, slow = ImmPda(told, give_up_ratio), general(told, give_up_ratio)
    belief, other, out = fast.init(), slow.init(), []
    for z in scans:
        belief, report = fast.step(belief, z)
        other, wish = slow.step(other, z)
        assert_same((belief, report), (other, wish))
        out.append((belief, report))
    return out


# ---- the engine of many hypotheses ----


@pytest.mark.parametrize("count", [1, 2, 4])
@pytest.mark.parametrize("axes", [1, 2])
def test_imm_pda_is_the_engine_of_many_hypotheses_with_one(count, axes):
    told = reference.jumping_model(count, count, axes, 1, detection_probability=0.8, gate_probability=0.95)
    scans = reference.flown(told, 20, np.random.default_rng(axes), clutter=4)
    scans[3] = scans[3][:0]
    scans[4] = np.empty((0, 0))
    out = flown_alike(told, scans, give_up_ratio=np.inf)
    assert all(report.alive for _, report in out)


@pytest.mark.parametrize("sure", [0.9, 1.0])
def test_imm_pda_is_the_engine_of_many_hypotheses_where_every_gate_is_empty(sure):
    told = reference.jumping_model(8, 3, detection_probability=sure)  # a gate of all there is, or a sure hit
    far_off = np.array([[1e3], [-1e3]])
    scans = [
        far_off if told.gate_probability < 1 else far_off[:0],
        *reference.flown(told, 5, np.random.default_rng(0)),
    ]
    flown_alike(told, scans)


@pytest.mark.parametrize("regime", ["near", "far", "extreme"])
@pytest.mark.parametrize("update", UPDATES)
def test_imm_pda_is_the_engine_of_many_hypotheses_on_a_radar(regime, update):
    scenario = turning(regime)
    out = flown_alike(with_radar_update(scenario.model, update), about_the_truth(scenario, 3, 30))
    # it has something to weigh: both motions are likely at some time
    chances = np.array([report.modes for _, report in out])
    assert chances.min() < 0.5 < chances.max()


def test_it_gives_up_with_the_engine_of_many_hypotheses_and_then_looks_at_nothing():
    told = reference.jumping_model(2, 2, 2, detection_probability=0.8, gate_probability=0.99)
    scans = [np.empty((0, 2))] * 4 + reference.flown(
        told, 8, np.random.default_rng(0), clutter=30, reach=60.0
    )
    out = flown_alike(told, scans, give_up_ratio=2.0)
    alive = [report.alive for _, report in out]
    assert alive[0] and not alive[-1]
    last = alive.index(False) - 1
    tracker = ImmPda(told, 2.0)
    with_scan = tracker.step(out[last][0], scans[last + 1])
    assert_same(with_scan, tracker.step(out[last][0], scans[0]))
    # it would have looked, had it had more patience
    patient = ImmPda(told, 1e6).step(out[last][0], np.vstack([scans[-1], with_scan[1].gates.z]))
    assert not np.allclose(patient[0].w, with_scan[0].w)


def test_it_gives_up_on_a_radar_where_the_engine_of_many_hypotheses_does():
    scenario = turning("far", 5_000.0)
    scans = about_the_truth(scenario, 0, 5) + [np.empty((0, 3))] * 25
    for update in ("debiased", "extended"):
        alive = [
            report.alive for _, report in flown_alike(with_radar_update(scenario.model, update), scans, 1.05)
        ]
        assert alive[0] and not alive[-1]


# ---- the textbook, slowly ----


@pytest.mark.parametrize("regime", ["near", "far", "extreme"])
@pytest.mark.parametrize("drawn", [True, False])
def test_on_a_radar_it_weighs_every_detection_by_a_noise_and_a_clutter_density_of_its_own(regime, drawn):
    if drawn:
        scenario = airborne_radar(regime, 25.0, trajectory="drawn", horizon=40)
    else:
        scenario = turning(regime)
    told, count = scenario.model, len(scenario.model.motions)
    assert count == (1 if drawn else 2)
    tracker = ImmPda(told)
    belief, moved, weighed = tracker.init(), np.inf, 0
    w, m, P = told.mode_prior, np.repeat(told.prior.m, count, 0), np.repeat(told.prior.P, count, 0)
    for z in about_the_truth(scenario, 1, 25):
        belief, report = tracker.step(belief, z)
        assert report.alive
        near = []
        reference.imm_step(w, m, P, told, lambda m, P: (near.append((m, P)), (1.0, m, P))[1])  # noqa: B023
        listed = z[np.any([reference.radar_near(*one, told, z) for one in near], axis=0)] if len(z) else z
        w, m, P = reference.imm_step(w, m, P, told, partial(reference.radar_pda, told=told, z=listed))
        w /= w.sum()
        weighed += len(listed) > 1
        moved = min(moved, np.linalg.det(P[0, :3, :3]) / np.linalg.det(told.prior.P[0, :3, :3]))
        np.testing.assert_allclose(belief.w[:, 0], w, rtol=1e-6, atol=1e-12)
        # the plain forms subtract squares of kilometres
        same((belief.m[:, 0], belief.P[:, 0]), (m, P), 1e-6)
        same((report.x[0], report.P[0]), reference.moment_match(w, m, P)[1:], 1e-6)
    assert weighed > 5 and moved < 0.5  # else there was nothing to weigh


# ---- what must not matter, and what cannot be ----


@given(st.randoms(use_true_random=False), st.sampled_from(UPDATES))
@settings(max_examples=25, deadline=None)
def test_the_order_of_detections_does_not_matter(random, update):
    scenario = turning("far")
    tracker = ImmPda(with_radar_update(scenario.model, update))
    belief = other = tracker.init()
    for z in about_the_truth(scenario, 2, 8):
        shuffled = z[random.sample(range(len(z)), len(z))]
        belief, report = tracker.step(belief, z)
        other, wish = tracker.step(other, shuffled)
        assert_same((belief, report), (other, wish))


def test_an_impossible_mode_is_not_looked_for_and_stays_impossible():
    still, fast = (Motion(np.eye(2), np.eye(2), np.array([x, 0.0])) for x in (0.0, 50.0))
    told = reference.jumping_model(0, 2, detection_probability=0.9, gate_probability=0.99)
    told = told._replace(
        motions=(still, fast), prior=gaussian([0.0, 0.0], np.eye(2)),
        switching=np.eye(2), mode_prior=np.array([1.0, 0.0]),
    )  # fmt: skip
    alone = told._replace(motions=(still,), switching=np.eye(1), mode_prior=np.ones(1))
    tracker, only = ImmPda(told), ImmPda(alone)
    belief, other = tracker.init(), only.init()
    for near in ([0.5], [-1.0], [], [2.0]):
        # where the fast one would be
        z = np.array([*near, belief.m[1, 0, 0] + 50.0])[:, None]
        belief, report = tracker.step(belief, z)
        other, wish = only.step(other, z[: len(near)])
        assert belief.w[1, 0] == report.modes[1] == 0 and belief.w[0, 0] == pytest.approx(1, rel=1e-14)
        assert np.isfinite(belief.m).all() and np.isfinite(belief.P).all()
        assert len(report.gates.z) == len(report.gates.S) == 1
        same((report.x, report.P), (wish.x, wish.P), 1e-12)
    flown_alike(told, [np.array([[0.5], [50.0]]), np.empty((0, 1)), np.array([[1.0]])])


def test_ten_thousand_detections_in_a_gate_are_weighed_one_by_one():
    told = reference.jumping_model(3, 2, 2, detection_probability=0.8)  # a gate of everything
    told = told._replace(clutter_density=10.0)
    z = told.prior.m[0, :2] + np.random.default_rng(0).uniform(-15, 15, (10_000, 2))
    ((belief, report),) = flown_alike(told, [z], give_up_ratio=1e9)
    assert report.alive
    prior = np.repeat(told.prior.m, 2, 0), np.repeat(told.prior.P, 2, 0)
    w, m, P = reference.imm_step(told.mode_prior, *prior, told, partial(reference.pda, told=told, z=z))
    np.testing.assert_allclose(belief.w[:, 0], w / w.sum(), rtol=1e-9)
    same((belief.m[:, 0], belief.P[:, 0]), (m, P), 1e-8)


@pytest.mark.parametrize("update", ["debiased", "debiased-at-prediction", "extended"])
def test_ten_thousand_detections_of_a_radar_are_no_trouble(update):
    scenario = turning("far", 10_000.0)
    scans = about_the_truth(scenario, 0, 3)
    assert min(map(len, scans)) > 9_000
    for _, report in flown_alike(with_radar_update(scenario.model, update), scans, give_up_ratio=1e9):
        assert report.alive and np.isfinite(report.x).all()


# ---- by name ----


def flown_by(tracker, scans):
    belief, out = tracker.init(), []
    for z in scans:
        belief, report = tracker.step(belief, z)
        out.append((report.x, report.P, report.modes))
    return out


def identical(flown, others):
    return all(
        np.array_equal(a, b) for x, y in zip(flown, others, strict=True) for a, b in zip(x, y, strict=True)
    )


def test_lis_trackers_are_imm_pda_told_another_update():
    scenario = turning("far")
    scans = about_the_truth(scenario, 0, 10)
    told = with_radar_update(scenario.model, "unscented")  # of which neither takes any notice
    by_name = {name: flown_by(make_tracker(name, told), scans) for name in ("imm-dcm-pda", "imm-ekf-pda")}
    for name, update in (("imm-dcm-pda", "debiased"), ("imm-ekf-pda", "extended")):
        assert identical(by_name[name], flown_by(make_tracker("imm-pda", told, update=update), scans))
    assert not identical(*by_name.values())
    assert not identical(by_name["imm-ekf-pda"], flown_by(make_tracker("imm-pda", told), scans))


def test_an_update_that_is_none_is_refused():
    with pytest.raises(ValueError, match=r"update must be one of raw, debiased, .*, got 'debias'"):
        make_tracker("imm-pda", turning("far").model, update="debias")


@pytest.mark.parametrize(("name", "own"), [("imm-dcm-pda", "debiased"), ("imm-ekf-pda", "extended")])
def test_a_tracker_named_after_its_update_takes_no_other(name, own):
    told = turning("far").model
    with pytest.raises(ValueError, match=f"{name}' has an update of its own and takes no 'cubature'"):
        make_tracker(name, told, update="cubature")
    assert make_tracker(name, told, update=own).model.sensor.update == own


@pytest.mark.parametrize(("name", "parameters"), [("imm-pda", {"update": "extended"}), ("imm-dcm-pda", {})])
def test_an_update_of_a_sensor_that_is_linear_is_refused(name, parameters):
    with pytest.raises(ValueError, match="needs a radar; the model's sensor is linear"):
        make_tracker(name, reference.jumping_model(0, 2), **parameters)


# ---- every tracker on the radar ----


def assert_follows(scenario, name, bound, **parameters):
    """Thirty scans by four updates, never further off than `bound` deviations across the line of sight."""
    for update in ("debiased", "debiased-at-prediction", "extended", "unscented"):
        if "dcm" in name or "ekf" in name:  # these have their own
            tracker = make_tracker(name, scenario.model, **parameters)
        else:
            tracker = make_tracker(name, scenario.model, update=update, **parameters)
        episode = draw(scenario, 4)
        for t, _, report, _ in play(scenario, tracker, episode):
            assert report.alive
            assert all(np.isfinite(a).all() for a in (report.x, report.P, report.modes, *report.mixture))
            np.linalg.cholesky(report.P)
            away = np.linalg.norm(report.x[0, :3] - episode.x[t, :3])
            cross = np.linalg.norm(episode.x[t, :3]) * scenario.model.sensor.deviations[1]
            assert away < bound * cross, (update, t, away / cross)


@pytest.mark.parametrize("name", OF_A_RADAR)
def test_every_tracker_follows_a_target_that_does_as_it_is_told(name):
    # the start is known to a deviation, and the velocity to six of them in these scans
    scenario = airborne_radar("near", 10.0, trajectory="drawn", horizon=30)
    assert_follows(scenario, WITH_NUMBERS.get(name, name), 4.0)


@pytest.mark.parametrize("name", sorted(set(OF_A_RADAR) - ONE_MOTION))
def test_every_tracker_that_knows_modes_follows_a_turn_at_five_g(name):
    scenario = turning("near", 10.0, 0, 30)
    # what flies on straight is ten deviations off at the end
    parameters = {"mode": 1} if name == "one-motion" else {}
    assert_follows(scenario, WITH_NUMBERS.get(name, name), 4.0, **parameters)


@pytest.mark.parametrize("name", sorted(ONE_MOTION))
def test_a_tracker_of_one_motion_is_refused_on_a_radar_told_of_two(name):
    scenario = turning("near", 10.0, 0, 30)
    with pytest.raises(ValueError, match="this tracker knows one motion and the model has 2"):
        make_tracker(name, scenario.model)


def test_detections_stand_where_the_slow_conversion_puts_them():
    # of the slow form itself: a sharp radar's is the position alone
    for z in ([1000.0, 2.0, 0.3], [500.0, -1.0, -1.1]):
        at, R = reference.debiased(np.array(z), [1.0, 1e-4, 1e-4])
        np.testing.assert_allclose(at, cartesian(np.array(z)), rtol=1e-6)
        assert np.linalg.eigvalsh(R)[0] > 0
