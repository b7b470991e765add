"""The target of Zhang and Liu: its motions, its switches, its start and its noise are the ones stated."""

from itertools import combinations

import gymnasium as gym
import numpy as np
import pytest
import reference
from scipy.stats import chi2, chisquare

import gmr_gym
from gmr_gym.mixture import Mixture, take
from gmr_gym.models.gating import gate_threshold
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.scenarios.zhang import jump_markov
from gmr_gym.simulation.single_target import draw

T = 1.0  # s
START = np.array([250_000.0, 200_000.0, -100.0, -300.0])
F = np.array([[1.0, 0, T, 0], [0, 1, 0, T], [0, 0, 1, 0], [0, 0, 0, 1]])
# section 6.1 with the states in the order [px, py, vx, vy]
B = {
    "printed": np.array([[0.0, 0], [0, 0], [T, 0], [0, T]]),
    "standard": np.array([[T**2 / 2, 0], [0, T**2 / 2], [T, 0], [0, T]]),
}
G = {"printed": np.array([[T, 0], [0, T], [1, 0], [0, 1]]), "standard": B["standard"]}
TABLE_2 = np.array([[0.0, 0], [0, 2], [2, 0], [0, -2], [-2, 0]])  # m/s^2
DRAWS = 400


def truths(scenario, draws=DRAWS):
    """States (draws, 45, 4) and modes (draws, 45) of as many episodes."""
    drawn = [scenario.truth(np.random.default_rng([7, i])) for i in range(draws)]
    return tuple(np.array(field) for field in zip(*drawn, strict=True))


@pytest.fixture(scope="module")
def default():
    return truths(jump_markov())


@pytest.mark.parametrize("discretisation", ["printed", "standard"])
def test_told_motions_are_equation_1_written_out(discretisation):
    told = jump_markov(discretisation=discretisation, process_variance=0.25).model
    assert len(told.motions) == len(TABLE_2)
    for motion, u in zip(told.motions, TABLE_2, strict=True):
        np.testing.assert_array_equal(motion.F, F)
        np.testing.assert_array_equal(motion.offset, B[discretisation] @ u)
        np.testing.assert_array_equal(motion.Q, 0.25 * G[discretisation] @ G[discretisation].T)


@pytest.mark.parametrize(("discretisation", "tied"), [("printed", 4), ("standard", 1)])
def test_after_one_scan_four_merges_cost_the_same_at_the_printed_input_matrix(discretisation, tied):
    told = jump_markov(discretisation=discretisation).model
    m, P = told.prior.m[0], told.prior.P[0]
    z = m[:2] + m[2:] + [20.0, -7.0]
    found = [reference.kalman(*reference.kalman_predict(m, P, *move), told, z) for move in told.motions]
    p = Mixture(*map(np.array, zip(*found, strict=True)))
    costs = {pair: reference.merge_cost(*take(p, list(pair))) for pair in combinations(range(5), 2)}
    least = [pair for pair, cost in costs.items() if cost < min(costs.values()) * (1 + 1e-9)]
    assert len(least) == tied
    for order, pair in (([0, 1, 2, 3, 4], least[0]), ([4, 3, 2, 1, 0], least[-1])):
        origin = runnalls(take(p, order), 4)[1]
        assert set(np.array(order)[origin == np.bincount(origin).argmax()]) == set(pair)


def test_the_filter_is_told_the_papers_figures():
    scenario = jump_markov()
    told = scenario.model
    for sensor in (told.sensor, scenario.sensor):
        np.testing.assert_array_equal(sensor.H, [[1, 0, 0, 0], [0, 1, 0, 0]])
        np.testing.assert_array_equal(sensor.R, 10 * np.eye(2))
    np.testing.assert_array_equal(told.prior.m, [START])
    np.testing.assert_array_equal(told.prior.P, [np.diag([1000, 1000, 10, 10])])
    np.testing.assert_array_equal(told.motions[0].Q, G["printed"] @ G["printed"].T)  # Q = diag(1, 1)
    assert told.detection_probability == scenario.detection_probability == 1
    assert (scenario.horizon, scenario.period, scenario.patience) == (45, T, 1)
    # the last bit of a probability near 1 moves this gate by 6e-11
    assert gate_threshold(told.gate_probability, 2) == pytest.approx(25, rel=1e-10)


@pytest.mark.parametrize(("modes", "stay"), [(5, 14 / 15), (3, 0.5), (2, 0.0), (1, 0.3)])
def test_the_filter_is_told_to_stay_and_that_the_others_share_the_rest(modes, stay):
    switching = jump_markov(accelerations=TABLE_2[:modes], stay=stay).model.switching
    expected = np.full((modes, modes), (1 - stay) / max(modes - 1, 1))
    np.fill_diagonal(expected, stay if modes > 1 else 1)
    np.testing.assert_allclose(switching, expected, rtol=1e-12, atol=1e-15)  # machine
    np.testing.assert_array_equal(jump_markov().model.switching.diagonal(), 14 / 15)


def test_the_mode_changes_at_scans_16_and_30_and_at_no_other(default):
    _, mode = default
    assert mode.shape == (DRAWS, 45)
    assert (mode[:, :15] == 0).all()
    changes = mode[:, 1:] != mode[:, :-1]
    expected = np.isin(np.arange(2, 46), (16, 30))  # the later scan of each pair, from 1
    assert (changes == expected).all()


def test_each_of_the_other_modes_comes_equally_often(default):
    _, mode = default
    for k in (16, 30):
        before, after = mode[:, k - 2], mode[:, k - 1]
        others = np.bincount((after - before) % 5, minlength=5)  # which of the other four
        assert others[0] == 0
        assert chisquare(others[1:]).pvalue > 1e-4  # seeded: it fails for good or not at all
    assert chisquare(np.bincount(mode[:, 15], minlength=5)[1:]).pvalue > 1e-4
    second = np.bincount(mode[:, 29], minlength=5)
    # back to the first with chance 1/4, to each of the others with 1/4 of the 3/4 that are not there
    assert chisquare(second, DRAWS * np.array([4, 3, 3, 3, 3]) / 16).pvalue > 1e-4


@pytest.mark.parametrize(("modes", "legs"), [(1, {(0, 0, 0)}), (2, {(0, 1, 0)}), (3, None)])
def test_fewer_models_switch_among_themselves(modes, legs):
    _, mode = truths(jump_markov(accelerations=TABLE_2[:modes]), 60)
    drawn = set(map(tuple, mode[:, [0, 15, 29]].tolist()))
    assert drawn == (legs or {(0, 1, 0), (0, 1, 2), (0, 2, 0), (0, 2, 1)})


def test_the_target_starts_from_the_prior():
    scenario = jump_markov(process_variance=1e-12)
    x, _ = truths(scenario)
    started = np.linalg.solve(F, x[:, 0].T).T  # scan 1 is F x_0 and noise of a micrometre
    expected = np.array([1000.0, 1000, 10, 10])
    off = (started - START) / np.sqrt(expected)
    np.testing.assert_allclose(off.mean(axis=0), 0, atol=5 / np.sqrt(DRAWS))  # standard errors
    # a variance of 1 is known to sqrt(2 / n), a covariance of none to 1 / sqrt(n)
    tolerance = 5 * np.sqrt((1 + np.eye(4)) / DRAWS)
    assert (np.abs(np.cov(off.T) - np.eye(4)) < tolerance).all()
    # all the variances together are sharper: a sum of 1600 squares
    assert 1e-4 < chi2.cdf((off**2).sum(), off.size) < 1 - 1e-4


@pytest.mark.parametrize(
    ("discretisation", "variance", "draws"), [("printed", 1.0, DRAWS), ("standard", 0.04, 100)]
)
def test_the_truth_follows_the_motion_of_its_mode(default, discretisation, variance, draws):
    given = {"discretisation": discretisation, "process_variance": variance}
    x, mode = default if draws == DRAWS else truths(jump_markov(**given), draws)
    residual = x[:, 1:] - x[:, :-1] @ F.T - TABLE_2[mode[:, 1:]] @ B[discretisation].T
    w = residual[..., 2:]  # the last two rows of G are the identity
    # eigenvalues of Q that are zero but for rounding, 1e-16, leave noise of 1e-8 m
    np.testing.assert_allclose(residual, w @ G[discretisation].T, rtol=0, atol=1e-6)
    w = w.reshape(-1, 2) / np.sqrt(variance)
    n = len(w)
    np.testing.assert_allclose(w.mean(axis=0), 0, atol=5 / np.sqrt(n))  # standard errors, as above
    assert (np.abs(np.cov(w.T) - np.eye(2)) < 5 * np.sqrt((1 + np.eye(2)) / n)).all()
    lagged = (w.reshape(draws, -1, 2)[:, 1:] * w.reshape(draws, -1, 2)[:, :-1]).mean(axis=(0, 1))
    assert (np.abs(lagged) < 5 / np.sqrt(n - draws)).all()


def test_accelerations_of_ones_own_move_the_target():
    own = np.array([[0.0, 1], [3, 0], [-3, -1]])
    scenario = jump_markov(accelerations=own.tolist(), process_variance=1e-12)
    assert [motion.offset.tolist() for motion in scenario.model.motions] == (own @ B["printed"].T).tolist()
    assert scenario.model.switching.shape == (3, 3) and len(scenario.model.mode_prior) == 3
    x, mode = scenario.truth(np.random.default_rng(1))
    gained = np.diff(x[:, 2:], axis=0)
    # noise of 1e-6 m/s a scan
    np.testing.assert_allclose(gained, own[mode[1:]], rtol=0, atol=1e-5)
    assert len(set(mode)) > 1


@pytest.mark.parametrize(
    ("case", "density", "rate"),
    [("1", 1e-4, 100), ("2", 3e-4, 300), ("stress", 1e-3, 1000), ("clear", 0.0, 0)],
)
def test_a_case_is_a_density_of_clutter(case, density, rate):
    scenario = jump_markov(case)
    assert scenario.clutter_rate == pytest.approx(rate, rel=1e-12)
    assert scenario.model.clutter_density == pytest.approx(density, abs=1e-300)
    wide = jump_markov(case, window=(2000.0, 500.0))  # m
    assert wide.clutter_rate == pytest.approx(rate, rel=1e-12)
    np.testing.assert_array_equal(wide.window.high, [1000, 250])


def test_case_1_is_the_default_and_a_density_takes_its_place():
    assert jump_markov().clutter_rate == jump_markov("1").clutter_rate
    scenario = jump_markov("2", clutter_density=2e-5)
    assert scenario.clutter_rate == pytest.approx(20) and scenario.model.clutter_density == 2e-5
    assert jump_markov(2).clutter_rate == jump_markov("2").clutter_rate  # a command line reads a number


def test_without_clutter_nothing_is_gated_and_the_target_is_all_that_is_seen():
    for scenario in (jump_markov("clear"), jump_markov(clutter_density=0)):
        assert gate_threshold(scenario.model.gate_probability, 2) == np.inf
    env = gym.make("gmr_gym/JumpMarkov-v0", case="clear")
    observation, info = env.reset(seed=0)
    over = False
    while not over:
        assert observation["mask"].tolist() == [1] and info["origin"].tolist() == [0]
        observation, _, terminated, truncated, info = env.step(info["truth"])
        over = terminated or truncated
    assert truncated


def test_the_case_and_the_probability_of_detection_leave_truth_and_noise_alone():
    base = draw(jump_markov(), 3)
    for change in ({"case": "stress"}, {"case": "clear"}, {"detection_probability": 0.5}):
        other = draw(jump_markov(**change), 3)
        for field in ("x", "mode", "z", "slot"):
            np.testing.assert_array_equal(getattr(base, field), getattr(other, field))
    assert base.detected.all() and 0 < other.detected.mean() < 1
    assert other.detected.mean() == pytest.approx(0.5, abs=0.4)  # five standard errors of 45 scans
    assert jump_markov(detection_probability=0.5).model.detection_probability == 0.5


def test_the_region_holds_every_truth_and_its_window(default):
    region = jump_markov().region
    np.testing.assert_array_equal(region.high - region.low, [10_000, 19_000])
    positions = default[0][:300, :, :2]
    assert (positions > region.low + 1000).all() and (positions < region.high - 1000).all()
    # its middle is the middle of a flight without noise or acceleration
    np.testing.assert_allclose((region.low + region.high) / 2, START[:2] + 22.5 * START[2:])


@pytest.mark.parametrize(
    "world", [{"accelerations": [[0, 0], [20, 0], [0, -20]]}, {"process_variance": 100.0}], ids=str
)
def test_the_region_grows_with_what_the_target_can_do(world):
    scenario = jump_markov(**world)
    positions = np.concatenate([draw(scenario, seed).x[:, :2] for seed in range(100)])
    assert (positions > scenario.region.low).all() and (positions < scenario.region.high).all()


def test_info_tells_the_true_mode():
    env = gym.make("gmr_gym/JumpMarkov-v0").unwrapped
    for seed in (0, 1):
        episode = draw(env.scenario, seed)
        _, info = env.reset(seed=seed)
        for t in range(45):
            assert info["mode"] == episode.mode[t]
            np.testing.assert_array_equal(info["truth"], episode.x[t])
            *_, info = env.step(info["truth"])
        assert len(set(episode.mode)) > 1


@pytest.mark.parametrize("name", ["mmg-10", "imm-mht-10", "imm-pda", "gpb1", "gpb2", "b-best-10"])
def test_trackers_with_modes_follow_the_target(name):
    env = gym.make("gmr_gym/JumpMarkov-v0")
    policy = gmr_gym.Policy(gmr_gym.make_tracker(name, env.unwrapped.scenario.model))
    observation, _ = env.reset(seed=1)
    errors, over = [], False
    while not over:
        observation, _, terminated, truncated, info = env.step(policy(observation))
        errors.append(info["error"])
        over = terminated or truncated
    # m; a detection alone is off by 4.0 on average, 10 m^2 on each axis
    assert len(errors) == 45 and np.mean(errors) < 6


@pytest.mark.parametrize("name", ["runnalls-10", "pda", "nearest-neighbour"])
def test_trackers_that_know_one_motion_refuse_it_and_take_it_with_one(name):
    with pytest.raises(ValueError, match="this tracker knows one motion and the model has 5"):
        tracker = gmr_gym.make_tracker(name, jump_markov().model)
        tracker.step(tracker.init(), np.empty((0, 2)))
    tracker = gmr_gym.make_tracker(name, jump_markov(accelerations=[[0, 0]]).model)
    tracker.step(tracker.init(), np.empty((0, 2)))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"case": "3"}, "case must be one of 1, 2, stress, clear, got '3'"),
        ({"discretisation": "exact"}, "discretisation must be one of printed, standard, got 'exact'"),
        ({"accelerations": []}, r"accelerations must have shape \(r, 2\) with r >= 1, got \(0,\)"),
        ({"accelerations": np.empty((0, 2))}, r"accelerations must have shape .*got \(0, 2\)"),
        ({"accelerations": [0, 2]}, r"accelerations must have shape .*got \(2,\)"),
        ({"accelerations": [[0, 0, 0]]}, r"accelerations must have shape .*got \(1, 3\)"),
        ({"accelerations": [[0, 0], [np.nan, 0]]}, "accelerations must be finite and within 100"),
        ({"accelerations": [[0, 0], [0, np.inf]]}, "accelerations must be finite and within 100"),
        ({"accelerations": [[0, 0], [0, -101]]}, "accelerations must be finite and within 100"),
        ({"process_variance": 0}, "process_variance must be positive and at most 1e4, got 0"),
        ({"process_variance": -1.0}, "process_variance must be positive and at most 1e4, got -1"),
        ({"process_variance": np.inf}, "process_variance must be positive and at most 1e4, got inf"),
        ({"process_variance": np.nan}, "process_variance must be positive and at most 1e4, got nan"),
        ({"stay": -0.1}, r"stay must lie in \[0, 1\], got -0.1"),
        ({"stay": 1.1}, r"stay must lie in \[0, 1\], got 1.1"),
        ({"stay": np.nan}, r"stay must lie in \[0, 1\], got nan"),
        ({"detection_probability": 0.0}, r"detection_probability must lie in \(0, 1\], got 0"),
        ({"detection_probability": 1.1}, r"detection_probability must lie in \(0, 1\], got 1.1"),
        ({"clutter_density": -1e-4}, "clutter_density must lie between 0 and 0.1 per m.2, got -"),
        ({"clutter_density": 0.11}, "clutter_density must lie between 0 and 0.1 per m.2, got 0.11"),
        ({"clutter_density": 0.1, "window": (2000, 2000)}, "at most 1e5 false alarms per scan.*got 400000"),
        ({"case": "nonsense", "clutter_density": 1e-4}, "case must be one of 1, 2, stress, clear"),
        ({"accelerations": [[0, 0], [1]]}, "accelerations must be rows"),
        ({"clutter_density": np.nan}, "clutter_density must lie between 0 and 0.1 per m.2, got nan"),
        ({"window": (0, 1000)}, r"window must be two positive lengths \(width, height\)"),
        ({"window": (1000,)}, r"window must be two positive lengths \(width, height\)"),
    ],
)
def test_bad_argument_is_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        jump_markov(**wrong)
