"""The airborne radar's world: the flight and its loads, what is detected of it, and the clutter about an
estimate, seen from a radar that moves."""

from functools import cache

import numpy as np
import pytest
import reference
from scipy.stats import kstest

from gmr_gym.evaluation.loop import play
from gmr_gym.evaluation.metrics import nees
from gmr_gym.filters.registry import make_tracker
from gmr_gym.models.radar import UPDATES
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.simulation.single_target import draw, scan

FAR = np.array([51_500.0, 18_800.0, 4_000.0])  # m
RADAR = np.array([250.0, 0.0, 0.0])  # m/s, of the aircraft that carries it
# s, s and g of the legs with a load
LOADS = [(8, 17, 5.5), (23, 32, 6.0), (38, 42, 5.0), (42, 50, 5.0), (50, 54, 5.0)]
STRAIGHT = [(0, 8), (17, 23), (32, 38), (54, 60)]
REGIMES = {"near": (10e3, 15e3, 0.0025), "far": (50e3, 62e3, 1.7), "extreme": (140e3, 155e3, 47.0)}


world = cache(airborne_radar)


def shift(scenario, x):
    """By how much (6,) an episode's target is elsewhere than expected before the first scan, and drifts."""
    start = scenario.model.prior.m[0]
    return np.append(x[0, :3] - scenario.period * x[0, 3:6], x[0, 3:6]) - start[:6]


def unshifted(scenario, x):
    """The states without that."""
    off, x = shift(scenario, x), x.copy()
    x[:, :3] -= off[:3] + scenario.period * np.arange(1, len(x) + 1)[:, None] * off[3:]
    x[:, 3:6] -= off[3:]
    return x


@cache
def flown(regime="far", **parameters):
    """States (T, 9) of the target, relative to the radar, where it is expected to be."""
    scenario = world(regime, **parameters)
    return unshifted(scenario, draw(scenario, 0).x)


def angles(x):
    """Range, azimuth and elevation (..., 3) of positions, in plain trigonometry."""
    r = np.sqrt((x[..., :3] ** 2).sum(axis=-1))
    return np.stack([r, np.angle(x[..., 0] + 1j * x[..., 1]), np.arcsin(x[..., 2] / r)], axis=-1)


def round_the_circle(angle):
    return np.angle(np.exp(1j * angle))


# ---- the flight ----


def test_the_flight_is_a_minute_at_one_speed():
    x = flown()
    assert x.shape == (600, 9)
    speed = np.linalg.norm(x[:, 3:6] + RADAR, axis=1)
    np.testing.assert_allclose(speed, 298.0, rtol=1e-9)
    # and the positions say so too: a chord of an arc of a tenth of a second at 6 g is shorter by 2e-5
    steps = np.diff(x[:, :3], axis=0) / 0.1 + RADAR
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), 298.0, rtol=1e-4)


def test_the_flight_pulls_five_to_six_g_where_it_turns_and_nothing_where_it_does_not():
    x = flown()
    pulled = np.linalg.norm(np.diff(x[:, :3], 2, axis=0), axis=1) / 0.1**2 / 9.80665
    times = 0.1 * np.arange(2, len(x))  # scan t is at 0.1 (t + 1)
    for begins, ends, load in LOADS:
        full = (times > begins + 0.7) & (times < ends - 0.2)  # it comes on within half a second
        np.testing.assert_allclose(pulled[full], load, rtol=5e-3)
    for begins, ends in STRAIGHT:
        np.testing.assert_allclose(pulled[(times > begins + 0.7) & (times < ends - 0.2)], 0, atol=1e-3)
    assert pulled.max() < 6.03
    # and the accelerations that the truth states are those
    stated = np.linalg.norm(x[:, 6:], axis=1)[1:-1] / 9.80665
    assert np.abs(stated - pulled).max() < 0.7 and np.abs(stated - pulled).mean() < 0.03


def test_the_flight_begins_straight_ahead_one_period_after_its_start():
    for period in (0.1, 0.25, 0.03):
        x = flown(period=period)
        t = period * np.arange(1, len(x) + 1)
        before = (t < 8)[:, None]
        velocity = 298 * np.array([np.cos(0.1), -np.sin(0.1), 0.0]) - RADAR
        wanted = FAR + t[:, None] * velocity
        np.testing.assert_allclose((x[:, :3] - wanted) * before, 0, atol=1e-6)
        np.testing.assert_allclose((x[:, 3:6] - velocity) * before, 0, atol=1e-9)


def test_the_flight_turns_left_and_back_then_climbs_and_dives():
    velocity = flown()[:, 3:6] + RADAR
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    at = lambda t: round(t / 0.1) - 1  # noqa: E731
    g = 9.80665
    assert heading[at(20)] - heading[at(5)] == pytest.approx(9 * 5.5 * g / 298, rel=5e-3)
    assert heading[at(35)] - heading[at(20)] == pytest.approx(-9 * 6 * g / 298, rel=5e-3)
    # pulled up by as much as it is pushed down, and level again
    climbing = np.arcsin(velocity[:, 2] / 298)
    assert climbing[at(42)] == pytest.approx(4 * 5 * g / 298, rel=0.1)
    assert climbing[at(50)] == pytest.approx(-4 * 5 * g / 298, rel=0.1)
    np.testing.assert_allclose(climbing[[at(20), at(35), at(58)]], 0, atol=2e-3)


@pytest.mark.parametrize("regime", REGIMES)
def test_what_counts_of_a_regime_is_what_is_meant(regime):
    nearest, farthest, wanted = REGIMES[regime]
    r = angles(flown(regime))[:, 0]
    assert nearest < r.min() and r.max() < farthest
    along, across, up = world(regime).sensor.deviations
    assert across == up
    np.testing.assert_allclose(r * across**2 / along, wanted, rtol=0.06)


def test_another_period_is_the_same_flight():
    fast, slow = flown(), flown(period=0.5)
    assert len(slow) == 120 and world(period=0.5).period == 0.5
    np.testing.assert_allclose(slow, fast[4::5], rtol=1e-12, atol=1e-9)
    with pytest.raises(ValueError, match="horizon must be between 1 and the 120 scans"):
        world(period=0.5, horizon=121)


@pytest.mark.parametrize("regime", REGIMES)
def test_the_prior_knows_of_the_position_what_one_detection_tells(regime):
    told = world(regime).model
    z, deviations = angles(told.prior.m[0]), world(regime).sensor.deviations
    mean = reference.stretched(z, deviations)
    wanted = reference.second_moment(z, deviations) - np.outer(mean, mean)
    scale = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(
        told.prior.P[0, :3, :3] / np.outer(scale, scale), wanted / np.outer(scale, scale), atol=1e-5
    )
    assert (told.prior.P[0, :3, 3:] == 0).all()


@pytest.mark.parametrize("regime", REGIMES)
def test_every_episode_flies_elsewhere_by_as_much_as_the_prior_allows(regime):
    scenario, runs = world(regime), 2000
    flights = np.array([scenario.truth(np.random.default_rng(seed)).x for seed in range(runs)])
    shifts = np.array([shift(scenario, x) for x in flights])
    # the whole path, and nothing but its place and drift
    still = [unshifted(scenario, x) for x in flights[:10]]
    np.testing.assert_allclose(still, np.tile(flown(regime), (10, 1, 1)), rtol=1e-9, atol=1e-6)
    scaled = np.linalg.solve(np.linalg.cholesky(scenario.model.prior.P[0, :6, :6]), shifts.T)
    for axis in scaled:
        assert kstest(axis, "norm").pvalue > 0.01
    assert np.abs(scaled.mean(axis=1)).max() < 4 / np.sqrt(runs)
    assert np.abs(np.cov(scaled) - np.eye(6)).max() < 4 * np.sqrt(2 / runs)


# ---- what is detected ----


@pytest.mark.parametrize("regime", REGIMES)
def test_the_target_is_detected_about_the_truth_with_the_deviations_that_are_stated(regime):
    scenario = world(regime)
    episodes = [draw(scenario, seed) for seed in range(20)]
    away = np.concatenate([episode.z - angles(episode.x) for episode in episodes])
    away[:, 1] = round_the_circle(away[:, 1])
    scaled = away / scenario.sensor.deviations
    assert scaled.shape == (12_000, 3)
    for axis in range(3):
        assert kstest(scaled[:, axis], "norm").pvalue > 0.01
    # mean and covariance to four standard errors
    assert np.abs(scaled.mean(axis=0)).max() < 4 / np.sqrt(12_000)
    assert np.abs(np.cov(scaled.T) - np.eye(3)).max() < 4 * np.sqrt(2 / 12_000)
    hits = np.concatenate([episode.detected for episode in episodes]).mean()
    assert abs(hits - 0.9) < 4 * np.sqrt(0.9 * 0.1 / 12_000)


@pytest.mark.parametrize("azimuth", [0.35, np.pi - 0.01])
@pytest.mark.parametrize("regime", ["near", "far"])
def test_clutter_is_uniform_about_the_estimate_and_as_many_as_its_rate(regime, azimuth):
    scenario = world(regime, clutter_rate=12.0, detection_probability=1e-9)
    # about a place that is not where the target is
    centre = np.array([21_000.0, azimuth, -0.2])
    low, high = scenario.window.low, scenario.window.high
    counts, places = [], []
    for seed in range(3):
        episode = draw(scenario, seed)
        for t in range(len(episode.x)):
            seen = scan(scenario, episode, t, centre)
            assert (seen.origin == -1).all()
            counts.append(len(seen.z))
            places.append(seen.z)
    places = np.concatenate(places)
    assert (np.abs(places[:, 1]) <= np.pi).all()
    away = places - centre
    away[:, 1] = round_the_circle(away[:, 1])
    share = (away - low) / (high - low)
    for axis in range(3):
        assert kstest(share[:, axis], "uniform").pvalue > 0.01
    loose = np.corrcoef(share.T)[np.triu_indices(3, 1)]
    assert np.abs(loose).max() < 4 / np.sqrt(len(share))
    counts, many = np.array(counts), 3 * 600
    assert abs(counts.mean() - 12) < 4 * np.sqrt(12 / many)
    # of a Poisson number the variance is the mean
    assert abs(counts.var() - 12) < 4 * 12 * np.sqrt(2 / many)
    told = scenario.model.clutter_density
    assert told == pytest.approx(12 / np.prod(high - low), rel=1e-12)


def test_the_window_is_eight_deviations_of_an_angle_either_way_and_half_a_kilometre_deep():
    scenario = world("near")
    np.testing.assert_allclose(scenario.window.high, [500.0, 0.016, 0.016])
    np.testing.assert_array_equal(scenario.window.low, -scenario.window.high)
    assert scenario.window.follows


def test_a_target_outside_the_window_of_the_estimate_is_not_detected():
    # so little clutter that there is none
    scenario = world("near", clutter_rate=1e-9, detection_probability=1.0)
    episode = draw(scenario, 0)
    clear = world("near", clutter_rate=0.0, detection_probability=1.0)
    for t in range(0, 600, 60):
        at = episode.z[t]
        assert len(scan(clear, draw(clear, 0), t, at + 5000.0).z) == 1  # which could betray nothing
        for off, seen in (([499.0, 0, 0], 1), ([501.0, 0, 0], 0), ([0, 0.017, 0], 0), ([0, 0, -0.015], 1)):
            assert len(scan(scenario, episode, t, at + off).z) == seen


def test_the_window_is_centred_on_the_estimate_carried_forward():
    scenario = world("far")
    estimate = np.array([-40_000.0, 9_000.0, -3_000.0, -200.0, -150.0, 40.0, 50.0, 60.0, 70.0])
    x, y, z = (
        estimate[:3] + 0.1 * estimate[3:6]
    )  # as the first of its motions goes, which has no acceleration
    wanted = [np.sqrt(x**2 + y**2 + z**2), np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))]
    np.testing.assert_allclose(scenario.centre(estimate), wanted, rtol=1e-12)


def test_the_same_seed_is_the_same_episode_and_another_is_not():
    for scenario in (world("far"), airborne_radar(trajectory="drawn"), airborne_radar(trajectory=circling())):
        one, again, other = draw(scenario, 5), draw(scenario, 5), draw(scenario, 6)
        for a, b in zip(one, again, strict=True):
            np.testing.assert_array_equal(a, b)
        assert not np.allclose(one.z, other.z)
        # of a trajectory that is given chance has no part but in what is detected
        assert np.array_equal(one.x, other.x) == (len(one.x) == 40)


# ---- trajectories and platforms of one's own ----


def circling(scans=40, period=0.1):
    """Positions (T, 3) of a target that crosses the x-axis ahead of a radar at the origin, turning."""
    t = period * np.arange(scans)
    return np.stack([12_000.0 - 20 * t**2, -500.0 + 250 * t, 1_000.0 + 0 * t], axis=1)


HALF_TURN = np.diag([-1.0, -1.0, 1.0])


@pytest.mark.parametrize("update", UPDATES)
@pytest.mark.parametrize("regime", ["near", "extreme"])
def test_a_target_that_crosses_the_seam_of_azimuth_is_tracked_as_one_that_does_not(regime, update):
    path = circling() * ([12.0, 12.0, 1.0] if regime == "extreme" else 1.0)
    still = np.zeros_like(path)
    ahead = airborne_radar(regime, 20.0, trajectory=path, platform=still, update=update)
    behind = airborne_radar(regime, 20.0, trajectory=path @ HALF_TURN, platform=still, update=update)
    crossed = angles(draw(behind, 1).x)[:, 1]
    assert (crossed > 3.05).any() and (crossed < -3.05).any() and np.abs(crossed).min() > 3
    turn = np.kron(np.eye(3), HALF_TURN)
    flights = [play(one, make_tracker("imm-pda", one.model), draw(one, 1)) for one in (ahead, behind)]
    for one, other in zip(*flights, strict=True):
        assert len(one.scan.z) == len(other.scan.z)
        half_round = round_the_circle(other.scan.z[:, 1] - one.scan.z[:, 1])
        np.testing.assert_allclose(np.abs(half_round), np.pi, atol=1e-9)
        # to a share of a deviation, rounded angles of kilometres apart
        deviation = np.sqrt(np.diag(one.report.P[0]))
        np.testing.assert_allclose((other.report.x[0] @ turn - one.report.x[0]) / deviation, 0, atol=1e-6)
        scale = np.outer(deviation, deviation)
        np.testing.assert_allclose((turn @ other.report.P[0] @ turn - one.report.P[0]) / scale, 0, atol=1e-6)
        np.testing.assert_allclose(other.report.modes, one.report.modes, atol=1e-6)
        off = np.linalg.norm(one.report.x[0, :3] - path[one.t])
        assert off < 4 * angles(path[one.t])[0] * ahead.sensor.deviations[1]


def test_only_the_motion_of_the_target_relative_to_the_platform_is_seen():
    rng = np.random.default_rng(0)
    path, carried = circling(), np.stack([25.0 * np.arange(40), np.zeros(40), np.zeros(40)], axis=1)
    shift = np.cumsum(rng.integers(-40, 40, (40, 3)), axis=0).astype(float)
    plain = airborne_radar("near", trajectory=path, platform=carried)
    both = airborne_radar("near", trajectory=path + shift, platform=carried + shift)
    relative = airborne_radar("near", trajectory=path - carried, platform=np.zeros((40, 3)))
    episode = draw(plain, 2)
    for other in (both, relative):
        again = draw(other, 2)
        # integers differ exactly; the path is rounded at 1e-12 m, its differences at a hundred times that
        np.testing.assert_allclose(again.x, episode.x, atol=1e-7)
        np.testing.assert_allclose(again.z, episode.z, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(other.model.prior.m, plain.model.prior.m, rtol=1e-9, atol=1e-7)
        for t in range(40):
            centre = angles(episode.x[t])
            one, two = scan(plain, episode, t, centre), scan(other, again, t, centre)
            np.testing.assert_array_equal(one.origin, two.origin)
            np.testing.assert_allclose(one.z, two.z, rtol=1e-12, atol=1e-12)


def test_without_a_platform_the_radar_flies_straight_ahead():
    path = circling()
    t = 0.1 * np.arange(1, 41)[:, None]
    plain = airborne_radar("near", trajectory=path)
    told = airborne_radar("near", trajectory=path, platform=np.hstack([t * RADAR, np.tile(RADAR, (40, 1))]))
    np.testing.assert_allclose(draw(plain, 0).x, draw(told, 0).x, atol=1e-9)
    np.testing.assert_allclose(draw(plain, 0).x[:, :3], path - t * RADAR, atol=1e-9)


def test_velocities_that_are_given_are_kept_and_others_are_differences():
    path, still = circling(), np.zeros((40, 3))
    t = 0.1 * np.arange(40)
    velocity = np.stack([-40 * t, 250 + 0 * t, 0 * t], axis=1)
    given = draw(airborne_radar("near", trajectory=np.hstack([path, velocity]), platform=still), 0).x
    np.testing.assert_array_equal(given[:, :6], np.hstack([path, velocity]))
    np.testing.assert_allclose(given[:, 6:], np.tile([-40.0, 0, 0], (40, 1)), atol=1e-9)
    differences = draw(airborne_radar("near", trajectory=path, platform=still), 0).x
    np.testing.assert_allclose(differences[1:-1, 3:6], velocity[1:-1], atol=1e-9)  # of a parabola, exact


# ---- a target that does as the tracker is told ----


@pytest.mark.parametrize("regime", REGIMES)
def test_a_drawn_target_has_the_moments_of_prior_and_motion(regime):
    scenario, runs = airborne_radar(regime, trajectory="drawn", horizon=5), 1500
    told = scenario.model
    assert len(told.motions) == 1
    x = np.array([scenario.truth(np.random.default_rng(seed)).x for seed in range(runs)])
    mean, covariance = reference.joint_states(told.prior.m[0], told.prior.P[0], told.motions[0], 5)
    for t in (0, 4):
        now = slice(9 * t, 9 * t + 9)
        away = x[:, t] - mean[now]
        scaled = np.linalg.solve(np.linalg.cholesky(covariance[now, now]), away.T)
        # four and a half standard errors, of the largest of 9 and of 45
        assert np.abs(scaled.mean(axis=1)).max() < 4.5 / np.sqrt(runs)
        assert np.abs(np.cov(scaled) - np.eye(9)).max() < 4.5 * np.sqrt(2 / runs)
    # and the noise is new in every scan: of position, half a period's of velocity
    jolts = x[:, 1:, 3:6] - x[:, :-1, 3:6]
    assert jolts.std() == pytest.approx(2.0 * 0.1, rel=0.02)
    follow = np.corrcoef(jolts.transpose(1, 0, 2).reshape(4, -1))
    assert np.abs(follow - np.eye(4)).max() < 4.5 / np.sqrt(3 * runs)


@pytest.mark.parametrize("regime", REGIMES)
def test_a_drawn_target_is_about_where_the_flight_begins_and_in_sight_of_who_is_told_so(regime):
    scenario = airborne_radar(regime, 0.0, 1.0, trajectory="drawn", horizon=20)
    start = scenario.model.prior.m[0]
    np.testing.assert_allclose(start[:6], world(regime).model.prior.m[0, :6], rtol=1e-9, atol=1e-6)
    tracker = make_tracker("clairvoyant", scenario.model)
    seen = [[len(p.scan.z) for p in play(scenario, tracker, draw(scenario, seed))] for seed in range(50)]
    assert np.mean(seen) > 0.9


def test_without_clutter_a_drawn_target_is_as_far_from_the_estimate_as_the_estimate_says():
    scenario, runs = airborne_radar("near", 0.0, trajectory="drawn", horizon=30), 200
    tracker, normalised = make_tracker("imm-pda", scenario.model), []
    for seed in range(runs):
        episode = draw(scenario, seed)
        *_, last = play(scenario, tracker, episode)
        normalised.append(nees((last.report.x[0] - episode.x[-1])[:6], last.report.P[0, :6, :6]))
    # chi-square with six degrees of freedom: a mean of 6, to four standard errors
    assert abs(np.mean(normalised) - 6) < 4 * np.sqrt(12 / runs)


# ---- what is refused ----


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"regime": "middling"}, "regime must be one of near, far, extreme, got 'middling'"),
        ({"clutter_rate": -1.0}, "clutter_rate must lie between 0 and 1e5 per scan, got -1"),
        ({"period": 0.001}, "period must lie between 0.01 and 10 s, got 0.001"),
        ({"detection_probability": 0.0}, "detection_probability must"),
        ({"update": "debias"}, "update must be one of raw, debiased"),
        ({"range_deviation": 0.0}, "range_deviation must be positive and finite, got 0"),
        ({"angle_deviation": 0.6}, "angle_deviation must be positive and at most 0.5 rad, got 0.6"),
        ({"time_constant": 0.0}, "time_constant must be positive and finite, got 0"),
        ({"trajectory": np.zeros((5, 2))}, r"trajectory must have shape \(T, 3\) or \(T, 6\)"),
        ({"trajectory": [["a", "b", "c"]] * 3}, r"trajectory must be numbers of shape \(T, 3\)"),
        ({"trajectory": np.full((5, 3), 1e7)}, "trajectory must be finite and within a million metres"),
        (
            {"trajectory": circling(), "platform": np.zeros((39, 3))},
            "platform must have as many scans.*40, got 39",
        ),
        ({"trajectory": circling(), "platform": circling() + 50.0}, "must keep 10 sigma of the range apart"),
    ],
)
def test_a_wrong_world_is_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        airborne_radar(**{"regime": "near", "trajectory": circling(), **wrong})
