"""What an action sets besides thresholds, by which reducer, and the price that is shown."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.baselines.adaptive_noise import adaptive_noise
from gmr_gym.baselines.learned_reduction import LearnedReduction
from gmr_gym.baselines.mht import cluster, n_scan
from gmr_gym.envs.registry import TUNINGS
from gmr_gym.evaluation.loop import play
from gmr_gym.filters.association import log_weights
from gmr_gym.tuning.instances import WIDE, instances, world
from gmr_gym.tuning.network import Network
from gmr_gym.tuning.recent import ALL_FEATURES
from gmr_gym.tuning.thresholds import Thresholds, to_action

_, V1 = TUNINGS
NAME = "wide-valid-01"


def made(parameters, **how):
    return gym.make(V1, instances="wide-valid", price=1e-3, parameters=parameters, **how).unwrapped


def played(env, action, seed=3):
    """Errors, numbers of hypotheses and rewards, scan by scan, of an action that stays."""
    env.reset(seed=seed, options={"instance_id": NAME})
    errors, kept, rewards, over = [], [], [], False
    while not over:
        _, reward, lost, late, info = env.step(action)
        errors.append(info["error"])
        kept.append(info["components"])
        rewards.append(reward + 1e-3 * info["work"])
        over = lost or late
    return errors, kept, rewards


def harness(env, tracker):
    """The same of a tracker in the harness, along the episode that the environment has drawn."""
    scenario, episode = env._scenario, env._episode
    reports = [done.report for done in play(scenario, tracker, episode)]
    errors = [np.linalg.norm((r.x[0] - x)[:2]) for r, x in zip(reports, episode.x, strict=True)]
    return errors, [len(r.mixture.w) for r in reports]


@pytest.mark.parametrize("name", ["n-scan", "cluster"])
def test_a_constant_action_is_the_tracker_of_that_reducer_which_assumes_so_much_noise(name):
    thresholds = Thresholds(
        history=3, distance=2.0, prune=1e-3, components=200, process_noise=2.0, measurement_noise=0.8,
        detection_odds=0.5,
    )  # fmt: skip
    own = {"n-scan": "history", "cluster": "distance"}[name]
    parameters = (own, "prune", "components", "process_noise", "measurement_noise", "detection_odds")
    env = made(parameters, reducer=name)
    errors, kept, rewards = played(env, to_action(thresholds, parameters))
    told = env._scenario.model
    odds = 0.5 * told.detection_probability / (1 - told.detection_probability)
    motion, sensor = told.motion, told.sensor
    told = told._replace(
        motions=(motion._replace(Q=4 * motion.Q),), sensor=sensor._replace(R=0.64 * sensor.R),
        detection_probability=odds / (1 + odds),
    )  # fmt: skip
    # the first scan is processed before the first action
    first = env._scenario.model
    tracker = {
        "n-scan": lambda model: n_scan(model, None, 3, 1e-3),
        "cluster": lambda model: cluster(model, None, 2.0, 1e-3),
    }[name]
    late = First(tracker(first), tracker(told))
    wanted, counts = harness(env, late)
    # an action, decoded, is off by rounding, which a target about to be lost magnifies
    assert errors == pytest.approx(wanted[: len(errors)], rel=1e-6)
    assert kept == counts[: len(kept)] and max(kept) > 3
    assert rewards[:-1] == pytest.approx([-min(e / 100, 1) for e in errors[:-1]], abs=1e-9)


class First:
    """One tracker in the first scan, another in the rest."""

    def __init__(self, first, rest):
        self.first, self.rest = first, rest
        self.model = rest.model

    def init(self):
        return False, self.first.init()

    def step(self, belief, z):
        tracker = self.rest if belief[0] else self.first
        after, report = tracker.step(belief[1], z)
        return (True, after), report


def test_hypotheses_that_coast_are_widened_and_no_others():
    parameters = ("process_noise", "coasting_noise")
    env = made(parameters)
    env.reset(seed=3, options={"instance_id": NAME})
    other = made(parameters)
    other.reset(seed=3, options={"instance_id": NAME})
    for _ in range(5):
        env.step(to_action(Thresholds(), parameters))
        other.step(to_action(Thresholds(coasting_noise=3.0), parameters))
        plain, wide = env._state[0], other._state[0]
        a, b = plain["hypotheses"], wide["hypotheses"]
        if (plain["history"][:a, 1] == -1).any():
            break
    hit = {tuple(h): P[0, 0] for h, P in zip(plain["history"][:a], plain["P"][:a], strict=True)}
    widened = {tuple(h): P[0, 0] for h, P in zip(wide["history"][:b], wide["P"][:b], strict=True)}
    shared = hit.keys() & widened.keys()
    assert {h for h in shared if widened[h] > hit[h] * (1 + 1e-9)} == {h for h in shared if h[1] == -1}


def test_with_fading_a_constant_action_is_the_tracker_whose_memory_fades():
    parameters = ("history", "prune", "process_noise", "fading")
    env = made(parameters)
    thresholds = Thresholds(history=2, prune=1e-3, process_noise=0.5, fading=1.4)
    errors, kept, _ = played(env, to_action(thresholds, parameters))
    told = {"components": 100, "reducer": "n-scan", "prune_weight": 1e-3, "method": "constant"}
    first, rest = (
        adaptive_noise(env._scenario.model, **told, factor=factor, fading=fading)
        for factor, fading in ((1.0, 1.0), (0.25, 1.4))
    )
    errors_there, counts = harness(env, FirstNoise(first, rest))
    assert errors == pytest.approx(errors_there[: len(errors)], rel=1e-6)
    assert kept == counts[: len(kept)]


class FirstNoise(First):
    """`First` of trackers whose belief has the noise of the scan to come."""

    def step(self, belief, z):
        began, report = super().step(belief, z)
        rest = self.rest.init().noise
        return (True, began[1]._replace(noise=rest)), report


def test_the_odds_of_a_detection_are_those_of_another_probability():
    from gmr_gym.tuning.assumed import weights_by_odds

    weights = np.array([9.2, *log_weights(0.8, 0.99, 1e-5)])
    assert weights_by_odds(weights, np.array([0.8, 0.99, 1e-5]), 1.0) == tuple(weights)
    there = weights_by_odds(weights, np.array([0.8, 0.99, 1e-5]), 0.25)
    assert there == pytest.approx((9.2, *log_weights(0.5, 0.99, 1e-5)))


def test_the_price_of_an_episode_is_drawn_by_its_seed_shown_and_charged():
    env, again = gym.make(V1).unwrapped, gym.make(V1).unwrapped
    check_env(env)
    shown, price = [], []
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        assert again.reset(seed=seed)[1] == info
        shown.append(observation[ALL_FEATURES.index("price")])
        price.append(info["price"])
        _, reward, _, _, info = env.step(np.zeros(6, np.float32))
        assert reward == pytest.approx(-min(info["error"] / 100, 1) - price[-1] * info["work"], abs=1e-9)
    np.testing.assert_allclose(shown, (np.log10(price) + 3.5) / 1.5, atol=1e-6)
    assert min(price) < 5e-5 and max(price) > 2e-3 and 1e-5 <= min(price) and max(price) <= 1e-2


def test_side_by_side_it_is_the_same():
    envs = gym.make_vec(V1, 3, vectorization_mode="vector_entry_point", instances="wide-valid")
    observations, infos = envs.reset(seed=7)
    single = gym.make(V1, instances="wide-valid").unwrapped
    for i in range(3):
        observation, info = single.reset(seed=7 + i)
        np.testing.assert_array_equal(observations[i], observation)
        assert infos["price"][i] == info["price"]
    actions = np.full((3, 6), 0.25)
    for _ in range(4):
        observations, rewards, _, _, infos = envs.step(actions)
        observation, reward, _, _, info = single.step(actions[2])
    np.testing.assert_array_equal(observations[2], observation)
    assert rewards[2] == reward and infos["work"][2] == info["work"]
    assert {key: v[2] for key, v in infos["thresholds"].items() if key[0] != "_"} == info["thresholds"]


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"reducer": "salmond"}, "reducer must be one of adaptive, n-scan, cluster, got 'salmond'"),
        ({"parameters": ("alpha",)}, "unknown threshold 'alpha'; choose from history, prune"),
        ({"features": ("size", "weight")}, "unknown feature 'weight'"),
        ({"features": "none"}, "features must be posterior, all, or a list"),
        ({"features": ("size", "size")}, "features must be different ones"),
        ({"price": (1e-3, 1e-5)}, "price must have the lower of two numbers first"),
        ({"price": (0.0, 1e-5)}, "price must be a number, or two that are positive"),
    ],
)
def test_what_is_wrong_is_named(how, message):
    with pytest.raises(ValueError, match=message):
        gym.make(V1, **how)


def test_the_picture_is_of_the_tracker_under_its_factors():
    parameters = ("history", "prune", "process_noise", "coasting_noise", "measurement_noise")
    env = made(parameters, render_mode="rgb_array")
    action = to_action(Thresholds(history=1, process_noise=2.0, coasting_noise=2.0), parameters)
    env.reset(seed=3, options={"instance_id": NAME})
    errors, kept = [], []
    for _ in range(8):
        *_, info = env.step(action)
        errors.append(info["error"])
        kept.append(info["components"])
    env.render()
    canvas = env._canvas
    drawn = [np.linalg.norm((a - x)[:2]) for a, x in zip(canvas._estimates, env._episode.x, strict=False)]
    assert drawn == pytest.approx(errors, rel=1e-9)
    assert [left for _, left in canvas._numbers] == kept
    assert len(canvas._actions) == len(parameters)
    env.close()


def test_what_is_observed_may_be_chosen():
    names = ("price", "nis_long", "size")
    every, some = gym.make(V1, price=1e-3).unwrapped, gym.make(V1, price=1e-3, features=names).unwrapped
    seen, few = every.reset(seed=2)[0], some.reset(seed=2)[0]
    np.testing.assert_array_equal(few, seen[[ALL_FEATURES.index(name) for name in names]])


@pytest.mark.parametrize(("reducer", "parameters"), [
    ("n-scan", ("history", "prune", "process_noise", "coasting_noise")),
    ("cluster", ("distance", "prune", "process_noise", "fading")),
    ("adaptive", ("alpha", "prune", "process_noise", "fading")),
])  # fmt: skip
def test_the_tracker_does_without_gym_what_its_network_does_in_the_environment(reducer, parameters):
    rng, k = np.random.default_rng(0), len(ALL_FEATURES)
    network = Network(
        ALL_FEATURES, parameters, np.zeros(k), np.ones(k), 5.0, "tanh", False,
        (rng.normal(0, 0.3, (8, k)), rng.normal(0, 0.3, (4, 8))), (np.zeros(8), np.array([0, 0.5, 0.2, 0])),
    )  # fmt: skip
    env = made(parameters, reducer=reducer)
    observation, _ = env.reset(seed=4, options={"instance_id": NAME})
    errors, kept, over = [], [], False
    while not over:
        observation, _, lost, late, info = env.step(network(observation))
        errors.append(info["error"])
        kept.append(info["components"])
        over = lost or late
    wanted, counts = harness(env, LearnedReduction(env._scenario.model, network, 1e-3, reducer))
    assert errors == pytest.approx(wanted[: len(errors)], rel=1e-9, abs=1e-9)
    assert kept == counts[: len(kept)]


def test_the_wide_tables_are_apart():
    rows = {name: instances(name) for name in WIDE}
    assert [len(found) for found in rows.values()] == [96, 24, 48, 24, 12]
    paths = {name: {row.trajectory for row in found.values()} for name, found in rows.items()}
    drawn = [{path for path in found if "jump" in path} for found in paths.values()]
    assert all(a.isdisjoint(b) for i, a in enumerate(drawn) for b in drawn[:i])
    seen = set().union(*(paths[name] for name in WIDE[:3]))
    assert seen.isdisjoint(paths["wide-extrapolation"] | paths["real"])
    assert all(row.manoeuvre == 1 for row in rows["real"].values())
    assert world(rows["real"]["real-00"]).horizon == 100
