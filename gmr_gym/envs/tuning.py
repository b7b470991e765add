"""The thresholds of a tracker, to be set scan by scan."""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from difflib import get_close_matches
from functools import cache
from numbers import Real
from typing import Any

import gymnasium as gym
import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.envs.episodic import DrawnEnv, check_keywords, keywords
from gmr_gym.envs.tracking import SCANS_OFF
from gmr_gym.simulation.single_target import Episode, Scenario, draw
from gmr_gym.tuning.features import BOUND, FEATURES
from gmr_gym.tuning.hindsight import HINDSIGHT
from gmr_gym.tuning.instances import Instance, world
from gmr_gym.tuning.instances import instances as table_of
from gmr_gym.tuning.scans import EPISODE, STEP, begin, stepped
from gmr_gym.tuning.thresholds import DORTENZIO, Thresholds, check_parameters, from_action, to_action

# of a unit of work; a scan with the target lost costs 1. At the paper's thresholds work then costs about as
# much as the error of a target that is followed
PRICE = 1e-4
ONE = np.zeros(1, np.int64)  # the one row of a batch of one
_world = cache(world)


class ReductionTuningEnv(DrawnEnv):
    """A Gaussian-mixture MHT whose reduction thresholds are set scan by scan.

    ## Description
    The tracker carries its hypotheses forward and expands them by a scan; `reset` shows features of the
    posterior of scan 1. `step(action)` reduces that posterior by the thresholds that the action stands for,
    scores the estimate, and expands the next scan. A constant action is the tracker `adaptive`.

    ## Observation space
    `Box(-2, 2, (k,), float32)`: the features named in `gmr_gym.tuning.features.FEATURES`.

    ## Action space
    `Box(-1, 1, (j,), float32)`: one number for each of `parameters`, the logarithm of the threshold scaled
    over its range in `gmr_gym.tuning.thresholds.RANGES`.

    ## Reward
    Minus the position error, in units of the cutoff of 100 m and no more than 1, minus `price` times the work
    of the scan: the Gaussians that were updated by a detection in their gate, and the costs of pairs that
    merging evaluated.

    ## Starting state
    The prior is the true state with the identity as covariance. Truth, detections and clutter come from
    separate streams of the seed: seed and instance alone decide what there is to see.

    ## Episode end
    `truncated` after the last scan, with zeros to observe. `terminated` when the error has exceeded the
    cutoff in ten scans in a row; the reward of that step is charged 1 for every scan that is left as well.

    ## Info
    `instance_id`; after a step also `error`, m, `work`, `components` (hypotheses kept) and `thresholds`, all
    of the scan that was reduced.

    ## Arguments
    `parameters`: which thresholds an action sets, of `Thresholds`. `instances`: "train", "valid", "test",
    "extrapolation", or a CSV file as `gmr_gym.tuning.instances.instances` reads it. `price`: of a unit of
    work.
    `components`: the limit of hypotheses where it is not one of the parameters. `hindsight`: whether what
    only a simulation knows, `gmr_gym.tuning.hindsight.HINDSIGHT`, stands behind the features: for critics
    that learn, never for policies. `render_mode`: "rgb_array" or "human": the scan last reduced, with what
    was kept of its hypotheses; after `reset` scan 1, with all of them.
    """

    def __init__(
        self,
        parameters: Sequence[str] = ("alpha", "prune"),
        instances: str = "train",
        price: float = PRICE,
        components: int = DORTENZIO.components,
        hindsight: bool = False,
        render_mode: str | None = None,
        **unknown,
    ):
        super().__init__(render_mode)
        check_keywords(unknown, keywords(type(self)))
        self.parameters, self.price = check_parameters(parameters), checked_price(price)
        self._rest = rest_of(components)
        self.instances = table_of(instances)
        self.observation_space, self.action_space = spaces_of(self.parameters, hindsight)
        self._width = self.observation_space.shape[0]
        self._draws = Draws(self.instances)
        self._state = np.zeros(1, EPISODE)
        self._reduced: list[Thresholds] = []  # by which scans were reduced, where someone watches

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Features of scan 1 of a new episode, of the instance options["instance_id"] or, where none is
        named, of the next of all instances in an order that the seed shuffles. Raises ValueError for an
        unknown instance or option."""
        super().reset(seed=seed)
        self.instance_id, self._scenario, self._episode = self._draws.next(seed, self, options or {})
        begin(self._state[0], self._scenario, self._episode, SCANS_OFF)
        observation, _ = self._stepped(DORTENZIO)
        self._reduced = []
        if self.render_mode == "human":
            self.render()
        return observation, {"instance_id": self.instance_id}

    def step(self, action):
        """Reduces the scan just looked at by the thresholds of the action (j,), and looks at the next. Raises
        ValueError for an action of another shape or outside the box, RuntimeError where no episode runs."""
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
            "thresholds": thresholds._asdict(),
        }
        if self.render_mode is not None:
            self._reduced.append(thresholds)
        if self.render_mode == "human":
            self.render()
        return observation, reward, terminated, truncated, info

    def foreseen(self, action, scans: int = 1) -> float:
        """The rewards, in all, that the action would bring if held for so many scans, or to the end of the
        episode. Nothing is changed by it. It sees the truth and the detections to come: for bounds on what
        any policy can reach, not for policies."""
        ahead = copy(self)
        ahead._state, ahead.render_mode = self._state.copy(), None
        total = 0.0
        for _ in range(scans):
            _, reward, terminated, truncated, _ = ahead.step(action)
            total += reward
            if terminated or truncated:
                break
        return total

    def _stepped(self, thresholds: Thresholds) -> tuple[np.ndarray, np.ndarray]:
        observation, steps = np.zeros((1, self._width), np.float32), np.zeros(1, STEP)
        stepped(self._state, ONE, np.array([thresholds], float), self.price, steps, observation)
        return observation[0], steps[0]

    def _has_begun(self) -> bool:
        return bool(self._state["scans"][0])

    def _new_canvas(self, on_screen: bool):
        from gmr_gym.envs.render_tuning import TuningCanvas

        return TuningCanvas(self._scenario, on_screen)

    def _drawn_on(self, canvas):
        return canvas.draw(self._scenario, self._episode, self._reduced)


class Draws:
    """The episodes of one environment: instances come in an order that its generator shuffles, each once
    before any again."""

    def __init__(self, instances: Mapping[str, Instance]):
        self.instances = instances
        self._to_come: list[str] = []  # the next one last

    def next(self, seed: int | None, env: Any, options: dict[str, Any]) -> tuple[str, Scenario, Episode]:
        """Name, scenario and episode of the next instance, or of options["instance_id"], drawn by the seed,
        which begins a new order, or by the generator env.np_random. Raises ValueError for an unknown instance
        or option."""
        if seed is not None:
            self._to_come = []
        else:
            seed = int(env.np_random.integers(2**63))
        name = self._chosen(env, options)
        scenario = _world(self.instances[name])
        return name, scenario, draw(scenario, seed)

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


def checked_price(price: float) -> float:
    """The price; ValueError unless it is non-negative and finite."""
    if not isinstance(price, Real) or not 0 <= price < np.inf:
        raise ValueError(f"price must be a number, non-negative and finite, got {price!r}")
    return price


def rest_of(components: int) -> Thresholds:
    """The thresholds that no action sets; ValueError for a limit of hypotheses that no action could set."""
    rest = DORTENZIO._replace(components=check_count(components))
    to_action(rest, ("components",))
    return rest


def spaces_of(parameters: Sequence[str], hindsight: bool) -> tuple[gym.spaces.Box, gym.spaces.Box]:
    """What is observed of one environment, and what is done to it."""
    if not isinstance(hindsight, bool):
        raise ValueError(f"hindsight must be True or False, got {hindsight!r}")
    seen = len(FEATURES) + len(HINDSIGHT) * hindsight
    return (
        gym.spaces.Box(-BOUND, BOUND, (seen,), np.float32),
        gym.spaces.Box(-1.0, 1.0, (len(parameters),), np.float32),
    )


class ThresholdSchedule(gym.Wrapper):
    """A `ReductionTuning` environment that a policy of `gmr_gym.tuning.policies` drives: `step` takes no
    heed of the action that it is given."""

    def __init__(self, env: gym.Env, policy: Callable[[np.ndarray, int], np.ndarray]):
        super().__init__(env)
        self.policy = policy
        self._observation: np.ndarray | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """As the environment inside does."""
        self._observation, info = self.env.reset(seed=seed, options=options)
        self._t = 0
        return self._observation, info

    def step(self, action=None):
        """One scan under the policy's thresholds. RuntimeError before the first `reset`."""
        if self._observation is None:
            raise RuntimeError("call reset() before step(): no episode is running")
        self._observation, *rest = self.env.step(self.policy(self._observation, self._t))
        self._t += 1
        return self._observation, *rest
