"""The F-16's flight is believable and as violent as it says; AgileFlight is Maybeck's section V."""

from importlib.resources import files

import gymnasium as gym
import numpy as np
import pytest
import reference

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.data.loader import f16_flight
from gmr_gym.evaluation.montecarlo import run_once
from gmr_gym.filters.registry import make_tracker
from gmr_gym.models.gating import Gates, gate_threshold
from gmr_gym.scenarios.maybeck import agile_flight
from gmr_gym.simulation.loss import detection_outside_gates
from gmr_gym.simulation.single_target import draw, scan

GRAVITY = 9.81  # m/s^2


@pytest.fixture(scope="module")
def rows():
    """Columns of the file by name (350,)."""
    text = (files("gmr_gym.data") / "f16.csv").read_text(encoding="utf-8").splitlines()
    header, *lines = [line for line in text if not line.startswith("#")]
    return dict(zip(header.split(","), np.loadtxt(lines, delimiter=",").T, strict=True))


def test_the_file_says_first_that_it_is_a_reconstruction():
    first = (files("gmr_gym.data") / "f16.csv").read_text(encoding="utf-8").partition("\n")[0]
    assert first.startswith("# A reconstruction, not the flight of Maybeck") and "JSBSim" in first


def test_the_f16_flies_as_an_f16_can(rows):
    assert rows["time_s"].tolist() == (np.arange(1, 351) / 2).tolist()
    load = rows["load_factor_g"]
    assert -3 < load.min() < 0 and 4 < load.max() < 9  # a push-over, and turns of 4 g
    assert (rows["airspeed_mps"] > 200).all() and (rows["airspeed_mps"] < 300).all()
    assert (rows["altitude_m"] > 5000).all() and (rows["altitude_m"] < 7000).all()
    np.testing.assert_allclose(rows["altitude_m"] - rows["altitude_m"][0], rows["up_m"], atol=2e-3)


def test_positions_velocities_and_accelerations_of_the_flight_belong_together():
    x = f16_flight()
    assert x.shape == (350, 6) and np.isfinite(x).all()
    # trapezium over half a second: off by T^2 / 12 of the third derivative, 30 m/s^3 at the most
    steps = (x[1:, :2] - x[:-1, :2]) - (x[1:, 2:4] + x[:-1, 2:4]) / 4
    assert np.abs(steps).max() < 1.0 and np.sqrt((steps**2).mean()) < 0.2
    steps = (x[1:, 2:4] - x[:-1, 2:4]) - (x[1:, 4:] + x[:-1, 4:]) / 4
    assert np.sqrt((steps**2).mean()) < 0.5


def test_it_is_level_then_turns_then_is_level_then_jinks_then_is_level(rows):
    pull = np.hypot(*f16_flight()[:, 4:].T)
    level = np.concatenate([pull[:43], pull[110:198], pull[258:]])
    assert np.quantile(level, 0.9) < 2 and pull[45:100].max() > 20 and pull[200:250].max() > 20
    assert np.abs(rows["load_factor_g"][:43] - 1).max() < 0.1


def lag(jerk):
    """Squared Mahalanobis distance (350,) of the innovations of a filter fed the exact positions."""
    told = agile_flight(jerks=[jerk]).model
    (motion,), (H, R), x = told.motions, told.sensor, f16_flight()
    m, P, d2 = told.prior.m[0], told.prior.P[0], []
    for state in x:
        m, P = reference.kalman_predict(m, P, *motion)
        d2.append(reference.mahalanobis_squared(H @ state, H @ m, H @ P @ H.T + R))
        m, P = reference.kalman_update(m, P, H, R, H @ state)
    return np.array(d2)


def test_the_aggressive_filter_lags_by_what_loses_a_few_tracks_and_the_benign_by_far_more():
    aggressive, benign = lag(4.0), lag(0.5)
    assert 2.0 < aggressive[198:258].max() < 3.5  # near 3, and in the jinking
    assert aggressive.max() == aggressive[198:258].max()
    assert benign[44:105].max() > gate_threshold(0.99, 2) * 3  # well beyond the gate, in the turns


def test_told_motions_are_equation_18():
    told, T = agile_flight().model, 0.5
    for motion, q in zip(told.motions, (0.25, 16.0), strict=True):
        for axis in range(2):
            own = [axis, axis + 2, axis + 4]
            np.testing.assert_allclose(motion.F[np.ix_(own, own)], [[1, T, T**2 / 2], [0, 1, T], [0, 0, 1]])
            G = np.array([T**2 / 2, T, 1])
            np.testing.assert_allclose(motion.Q[np.ix_(own, own)], q * np.outer(G, G))
            assert not motion.F[np.ix_(own, [1 - axis, 3 - axis, 5 - axis])].any()
    np.testing.assert_array_equal(told.switching, [[0.9, 0.1], [0.1, 0.9]])
    np.testing.assert_array_equal(told.sensor.R, 100 * np.eye(2))
    assert told.gate_probability == 0.99 and told.clutter_density == 1e-4


def test_clutter_fills_the_square_about_the_submitted_estimate_with_the_same_offsets_for_all():
    scenario, episode = agile_flight(), draw(agile_flight(), 3)
    assert scenario.clutter_rate == pytest.approx(400)
    here, there = np.array([100.0, -50.0]), np.array([150.0, 20.0])
    one, other = (scan(scenario, episode, 7, centre) for centre in (here, there))
    np.testing.assert_allclose(one.z[one.origin < 0] - here, other.z[other.origin < 0] - there, atol=1e-9)
    assert (np.abs(one.z[one.origin < 0] - here) <= 1000).all()
    seen = [scan(scenario, episode, 7, episode.x[7, :2] + shift) for shift in (0.0, 90.0)]
    np.testing.assert_array_equal(*(s.z[s.origin == 0] for s in seen))  # the target's noise as well


def test_the_scan_of_the_environment_follows_what_was_submitted():
    env = gym.make("gmr_gym/AgileFlight-v0").unwrapped
    observations = []
    for shift in (0.0, 300.0):
        observation, _ = env.reset(seed=4)
        action = observation["prior_mean"].copy()
        action[0] += shift
        observation, *_ = env.step(action)
        observations.append(observation["scan"][observation["mask"] == 1])
    middle = [np.median(z, axis=0) for z in observations]
    # of 400 uniform points in 2 km the median is off by 50 m
    assert middle[1][0] - middle[0][0] == pytest.approx(300, abs=100)


def test_a_track_is_lost_after_five_scans_without_the_targets_detection_in_a_gate():
    gates = Gates(np.zeros((1, 2)), np.eye(2)[None], 9.0)
    assert not detection_outside_gates(gates, np.zeros(6), np.array([2.9, 0.0]))
    assert detection_outside_gates(gates, np.zeros(6), np.array([3.1, 0.0]))
    assert detection_outside_gates(gates, np.zeros(6), np.full(2, np.nan))
    assert agile_flight().patience == 5


def test_trackers_with_modes_follow_the_level_flight():
    world = agile_flight(horizon=40)
    for name in ("mmg-15", "imm-mht-15"):
        runs = run_once(world, make_tracker(name, world.model), 0)
        error = np.linalg.norm((runs.x - runs.truth)[:, :2], axis=1)
        assert np.median(error) < 15 and not runs.off_target[-5:].all()


def test_missed_detections_and_a_flight_of_ones_own_are_flown():
    x = f16_flight()[:60]
    world = agile_flight(trajectory=x.tolist(), detection_probability=0.5)
    episode = draw(world, 0)
    np.testing.assert_array_equal(episode.x, x)
    assert 15 < episode.detected.sum() < 45 and (episode.mode == -1).all()
    assert world.horizon == 60


def test_a_drawn_target_does_as_the_trackers_are_told():
    stay = ((0.95, 0.2), (0.05, 0.8))
    world = agile_flight(trajectory="drawn", switching=stay, clutter_density=0.0)
    truths = [world.truth(np.random.default_rng(seed)) for seed in range(100)]
    modes, x = np.array([truth.mode for truth in truths]), np.array([truth.x for truth in truths])
    assert x.shape == (100, 350, 6)
    before, now = modes[:, :-1].ravel(), modes[:, 1:].ravel()
    for p in (0, 1):  # 7 000 switches at least: 0.01 is two standard errors and more
        assert (now[before == p] != p).mean() == pytest.approx(1 - stay[p][p], abs=0.015)
    F = world.model.motions[0].F
    noise = x[:, 1:] - x[:, :-1] @ F.T
    for p, jerk in enumerate((0.5, 4.0)):
        mine = noise[modes[:, 1:] == p]
        assert mine[:, 4:].std() == pytest.approx(jerk, rel=0.03)
        np.testing.assert_allclose(mine[:, 2:4], 0.5 * mine[:, 4:], atol=1e-6)  # one jerk drives all three
    np.testing.assert_array_equal(x[3], world.truth(np.random.default_rng(3)).x)


def test_exact_posteriors_of_a_drawn_target_are_as_good_as_they_say():
    world = agile_flight(trajectory="drawn", clutter_density=0.0, horizon=30)
    tracker = make_tracker("mmg-30", world.model)
    runs = [run_once(world, tracker, seed) for seed in range(60)]
    error = np.array([run.x - run.truth for run in runs])
    claimed = np.array([run.P for run in runs])
    d2 = np.einsum("rti,rti->rt", error, np.linalg.solve(claimed, error[..., None])[..., 0])
    # mean 6; over 60 runs of 30 scans alike within a run, a tenth is three standard errors
    assert d2.mean() == pytest.approx(6, rel=0.1)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"clutter_density": -1.0}, "clutter_density must lie between 0 and 0.1"),
        ({"clutter_density": 0.1, "side": 9000}, "at most 1e5 false alarms per scan"),
        ({"side": 0}, "window must be two positive lengths"),
        ({"jerks": [0.5, 0]}, "jerks must be positive"),
        ({"jerks": [1.0, 2, 3]}, r"switching must have shape \(3, 3\)"),
        ({"switching": [[0.9, 0.2], [0.2, 0.8]]}, "column-stochastic"),
        ({"trajectory": "straight"}, r"trajectory must be states \(T, 6\) or 'drawn', got 'straight'"),
        ({"trajectory": [[0, 0]] * 5}, r"trajectory must have shape \(T, 6\)"),
        ({"trajectory": [[np.nan] * 6]}, "trajectory must be finite"),
        ({"horizon": 351}, "horizon must be between 1 and the 350"),
        ({"detection_probability": 0}, "detection_probability must lie in"),
    ],
)
def test_bad_argument_is_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        agile_flight(**wrong)
