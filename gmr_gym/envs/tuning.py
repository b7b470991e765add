"""Environments whose actions are the thresholds of a tracker, set scan by scan."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from difflib import get_close_matches
from functools import cache
from numbers import Real
from typing import Any

import gymnasium as gym
import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.deprecated import warn_renamed
from gmr_gym.envs.episodic import DrawnEnv, check_keywords, keywords
from gmr_gym.simulation.single_target import Episode, Scenario, draw
from gmr_gym.tuning.features import BOUND
from gmr_gym.tuning.hindsight import HINDSIGHT
from gmr_gym.tuning.instances import Instance, world
from gmr_gym.tuning.instances import instances as table_of
from gmr_gym.tuning.recent import check_features, feature_index
from gmr_gym.tuning.scans import EPISODE, STEP, begin, stepped
from gmr_gym.tuning.thresholds import (
    DORTENZIO,
    REDUCERS,
    Thresholds,
    check_parameters,
    from_action,
    to_action,
)

# of a unit of work; a scan with a lost target costs 1. At the paper's thresholds work then costs about as
# much as the error of a tracked target
PRICE = 1e-4
PRICES = 1e-5, 1e-2  # between which that of an episode is drawn in v1
OF_PRICES = 24  # of the random stream of a seed that draws the price
ONE = np.zeros(1, np.int64)  # the one row of a batch of one
_world = cache(world)


class ReductionTuningEnv(DrawnEnv):
    r"""A Gaussian-mixture MHT whose reduction thresholds and assumed noise are set scan by scan.

    ## Description
    The tracker predicts its hypotheses and updates them by a scan; `reset` emits features of the posterior of
    scan 1. `step(action)` reduces that posterior by the thresholds that the action stands for, scores the
    estimate, and processes the next scan, predicted and updated under the factors that the action stands for.
    With a constant action it is an MHT with that reducer: `adaptive` in v0.

    ## Observation space
    `Box(-2, 2, (k,), float32)`: the features asked for, by default those named in
    `gmr_gym.tuning.features.FEATURES` in v0, and in `gmr_gym.tuning.recent.ALL_FEATURES` in v1.

    ## Action space
    `Box(-1, 1, (j,), float32)`: one number for each of `parameters`, the logarithm of the threshold or factor
    scaled over its range in `gmr_gym.tuning.thresholds.RANGES`.

    ## Reward
    Minus the position error, in units of the cutoff of 100 m and no more than 1, minus `price` times the work
    of the scan: the Gaussians that were updated by a detection in their gate, and what merging evaluated,
    costs of pairs for "adaptive", labels of hypotheses for "n-scan", distances for "cluster". With error e,
    cutoff c, price q and work k,

    .. math:: r = -\min(e / c, 1) - q k

    and a loss with n scans left adds -n.

    ## Starting state
    The prior is the true state with the identity as covariance. Truth, detections and clutter come from
    separate streams of the seed: seed and instance alone decide the detections.

    ## Episode end
    `truncated` after the last scan, with an observation of zeros. `terminated` when the error has exceeded
    the cutoff in ten scans in a row; the reward of that step also charges 1 for every scan that is left.

    ## Info
    `instance_id`, and `price` where it is drawn; after a step also `error`, m, `work`, `components`
    (hypotheses kept) and `thresholds`, all of the scan that was reduced.

    ## Arguments
    `parameters`: what an action sets: thresholds that the reducer heeds, see
    `gmr_gym.tuning.thresholds.REDUCERS`, and `FACTORS`. `instances`: one of
    `gmr_gym.tuning.instances.TABLES`, or a CSV file as `gmr_gym.tuning.instances.instances` reads it.
    `price`: of a unit of work; two numbers stand for one that is drawn between them in every episode,
    uniformly in its logarithm, by the seed.
    `components`: the limit of hypotheses where it is not one of the parameters. `reducer`: "adaptive",
    "n-scan", which merges hypotheses that share their last detections, or "cluster", which merges what lies
    near the heaviest. `features`: "posterior", "all", or names of `gmr_gym.tuning.recent.ALL_FEATURES`.
    `hindsight`: whether the features are followed by `gmr_gym.tuning.hindsight.HINDSIGHT`, which only a
    simulation knows: for critics that learn, never for policies. `render_mode`: "rgb_array" or "human": the
    posterior of the scan last reduced, before and after the reduction, and by scan the numbers of hypotheses
    and the actions; after `reset` the posterior of scan 1.
    """

    def __init__(
        self,
        parameters: Sequence[str] = ("alpha", "prune"),
        instances: str = "train",
        price: float | Sequence[float] = PRICE,
        components: int = DORTENZIO.components,
        hindsight: bool = False,
        render_mode: str | None = None,
        *,
        reducer: str = "adaptive",
        features: str | Sequence[str] = "posterior",
        **unknown,
    ):
        super().__init__(render_mode)
        check_keywords(unknown, keywords(type(self)))
        self.parameters, self.reducer = check_parameters(parameters, reducer), reducer
        self.price, self.features = checked_price(price), check_features(features)
        self._rest, self._seen = rest_of(components), feature_index(self.features)
        self.instances = table_of(instances)
        self.observation_space, self.action_space = spaces_of(self.parameters, self.features, hindsight)
        self._width = self.observation_space.shape[0]
        self._draws = Draws(self.instances, self.price)
        self._state = np.zeros(1, EPISODE)
        self._reduced: list[Thresholds] = []  # by which scans were reduced, where there is a render mode

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Begin a new episode.

        Parameters
        ----------
        seed : int, optional
            Decides the episode of an instance. Without one the random stream goes on.
        options : dict, optional
            "instance_id": the instance. By default the next of all instances, in an order that the seed
            shuffles.

        Returns
        -------
        observation : ndarray (k,)
            Features of scan 1.
        info : dict

        Raises
        ------
        ValueError
            For an unknown instance or option.
        """
        super().reset(seed=seed)
        self.instance_id, self._scenario, self._episode, price = self._draws.next(seed, self, options or {})
        begin(self._state[0], self._scenario, self._episode, self.reducer, price)
        observation, _ = self._stepped(DORTENZIO)
        self._reduced = []
        if self.render_mode == "human":
            self.render()
        return observation, {"instance_id": self.instance_id, **self._draws.said(price)}

    def step(self, action):
        """Reduce the current posterior by the thresholds of the action, score it, and process the next scan.

        Parameters
        ----------
        action : array_like (j,)
            Numbers in [-1, 1].

        Returns
        -------
        observation, reward, terminated, truncated, info

        Raises
        ------
        ValueError
            For an action of another shape or outside the box.
        RuntimeError
            If no episode is running.
        """
        if self._state["t"][0] == self._state["scans"][0]:
            raise RuntimeError("call reset() before step(): no episode is running")
        thresholds = from_action(action, self.parameters, self._rest)
        observation, outcome = self._stepped(thresholds)
        reward, error, work, components, _, terminated, truncated = outcome.item()
        info = {
            "instance_id": self.instance_id,
            "error": error,
            "work": work,
            "components": components,
            "thresholds": {name: getattr(thresholds, name) for name in told(self.parameters, self.reducer)},
            **self._draws.said(self._state["price"][0]),
        }
        if self.render_mode is not None:
            self._reduced.append(thresholds)
        if self.render_mode == "human":
            self.render()
        return observation, reward, terminated, truncated, info

    def lookahead_reward(self, action, scans: int = 1) -> float:
        """The total reward of an action held for a number of scans, or to the end of the episode.

        The environment does not change. The result depends on the truth and the detections to come: it serves
        bounds on what any policy can reach, not policies.

        Parameters
        ----------
        action : array_like (j,)
        scans : int

        Returns
        -------
        float
        """
        other = copy(self)
        other._state, other.render_mode = self._state.copy(), None
        total = 0.0
        for _ in range(scans):
            _, reward, terminated, truncated, _ = other.step(action)
            total += reward
            if terminated or truncated:
                break
        return total

    def foreseen(self, action, scans: int = 1) -> float:
        """Former name of `lookahead_reward`."""
        warn_renamed("foreseen", "lookahead_reward")
        return self.lookahead_reward(action, scans)

    def _stepped(self, thresholds: Thresholds) -> tuple[np.ndarray, np.ndarray]:
        observation, steps = np.zeros((1, self._width), np.float32), np.zeros(1, STEP)
        stepped(self._state, ONE, np.array([thresholds], float), steps, observation, self._seen)
        return observation[0], steps[0]

    def _has_begun(self) -> bool:
        return bool(self._state["scans"][0])

    def _new_canvas(self, on_screen: bool):
        from gmr_gym.envs.render_tuning import TuningCanvas

        return TuningCanvas(self._scenario, self.parameters, self.reducer, on_screen)

    def _drawn_on(self, canvas):
        return canvas.draw(self._scenario, self._episode, self._reduced)


class Draws:
    """The episodes of one environment.

    Instances come in an order that its generator shuffles, each once before any again. The price of an
    episode is drawn by its seed, where it is not given.
    """

    def __init__(self, instances: Mapping[str, Instance], price: float | tuple[float, float]):
        self.instances, self.price = instances, price
        self._to_come: list[str] = []  # the next one last

    def said(self, price: float) -> dict[str, float]:
        """What info says of the price of an episode."""
        return {"price": float(price)} if isinstance(self.price, tuple) else {}

    def next(
        self, seed: int | None, env: Any, options: dict[str, Any]
    ) -> tuple[str, Scenario, Episode, float]:
        """Draw the next episode.

        Parameters
        ----------
        seed : int or None
            Draws the episode and begins a new order; for None, env.np_random draws it.
        env
            Has the generator np_random.
        options : dict
            "instance_id": the instance, instead of the next in the order.

        Returns
        -------
        name : str
        scenario : Scenario
        episode : Episode
        price : float

        Raises
        ------
        ValueError
            For an unknown instance or option.
        """
        if seed is not None:
            self._to_come = []
        else:
            seed = int(env.np_random.integers(2**63))
        name = self._chosen(env, options)
        scenario = _world(self.instances[name])
        return name, scenario, draw(scenario, seed), self._price(seed)

    def _price(self, seed: int) -> float:
        if not isinstance(self.price, tuple):
            return self.price
        low, high = self.price
        return float(low * (high / low) ** np.random.default_rng((OF_PRICES, seed)).random())

    def _chosen(self, env: Any, options: dict[str, Any]) -> str:
        for option in options:
            if option != "instance_id":
                raise ValueError(f"unknown option {option!r}; reset takes 'instance_id'")
        if not options:
            if not self._to_come:
                self._to_come = [str(name) for name in env.np_random.permutation(list(self.instances))]
            return self._to_come.pop()
        name = options["instance_id"]
        if not isinstance(name, str) or name not in self.instances:
            near = get_close_matches(str(name), self.instances, n=1) or list(self.instances)[:1]
            raise ValueError(f"unknown instance {name!r}; did you mean {near[0]!r}?")
        return name


def checked_price(price: float | Sequence[float]) -> float | tuple[float, float]:
    """The price, or the two between which it is drawn; ValueError unless they are finite numbers, not
    negative, and where there are two, positive and the lower first."""
    if isinstance(price, Sequence) and not isinstance(price, str):
        if len(price) != 2 or not all(isinstance(p, Real) and 0 < p < np.inf for p in price):
            raise ValueError(f"price must be a number, or two that are positive and finite, got {price!r}")
        if price[0] > price[1]:
            raise ValueError(f"price must have the lower of two numbers first, got {price!r}")
        return float(price[0]), float(price[1])
    if not isinstance(price, Real) or not 0 <= price < np.inf:
        raise ValueError(f"price must be a number, non-negative and finite, got {price!r}")
    return price


def rest_of(components: int) -> Thresholds:
    """The thresholds that no action sets; ValueError for a limit of hypotheses outside its range."""
    rest = DORTENZIO._replace(components=check_count(components))
    to_action(rest, ("components",))
    return rest


def told(parameters: Sequence[str], reducer: str) -> list[str]:
    """What info has under "thresholds": those that the reducer heeds, and factors that an action sets."""
    return [*REDUCERS[reducer], *(name for name in parameters if name not in REDUCERS[reducer])]


def spaces_of(
    parameters: Sequence[str], features: Sequence[str], hindsight: bool
) -> tuple[gym.spaces.Box, gym.spaces.Box]:
    """Observation space and action space of one environment."""
    if not isinstance(hindsight, bool):
        raise ValueError(f"hindsight must be True or False, got {hindsight!r}")
    seen = len(features) + len(HINDSIGHT) * hindsight
    return (
        gym.spaces.Box(-BOUND, BOUND, (seen,), np.float32),
        gym.spaces.Box(-1.0, 1.0, (len(parameters),), np.float32),
    )


class ThresholdSchedule(gym.Wrapper):
    """A `ReductionTuning` environment driven by a policy of `gmr_gym.tuning.policies`; `step` ignores its
    action.
    """

    def __init__(self, env: gym.Env, policy: Callable[[np.ndarray, int], np.ndarray]):
        super().__init__(env)
        self.policy = policy
        self._observation: np.ndarray | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """As the wrapped environment."""
        self._observation, info = self.env.reset(seed=seed, options=options)
        self._t = 0
        return self._observation, info

    def step(self, action=None):
        """One scan under the policy's thresholds; RuntimeError before the first `reset`."""
        if self._observation is None:
            raise RuntimeError("call reset() before step(): no episode is running")
        self._observation, *rest = self.env.step(self.policy(self._observation, self._t))
        self._t += 1
        return self._observation, *rest
