"""The thresholds of a tracker, to be set scan by scan."""

from collections.abc import Callable, Sequence
from copy import copy
from difflib import get_close_matches
from typing import Any

import gymnasium as gym
import numpy as np

from gmr_gym.envs.tracking import STRAYED
from gmr_gym.hypotheses import expanded
from gmr_gym.instances import instances as table_of
from gmr_gym.instances import world
from gmr_gym.mixture import Mixture, moments
from gmr_gym.reduction import at_least_one
from gmr_gym.simulate import Scenario, draw, scan
from gmr_gym.threshold_features import BOUND, FEATURES, at_start, features, remembered, told
from gmr_gym.threshold_hindsight import HINDSIGHT, ahead, hindsight
from gmr_gym.thresholds import PAPER, adapted, check_parameters, decoded, encoded

# of a unit of work; a scan with the target lost costs 1. At the paper's thresholds work then costs about as
# much as the error of a target that is followed
PRICE = 1e-4


class ReductionTuningEnv(gym.Env):
    """A Gaussian-mixture MHT whose reduction thresholds are set scan by scan.

    ## Description
    The tracker carries its hypotheses forward and expands them by a scan; `reset` shows features of the
    posterior of scan 1. `step(action)` reduces that posterior by the thresholds that the action stands for,
    scores the estimate, and expands the next scan. A constant action is the tracker `adaptive`.

    ## Observation space
    `Box(-2, 2, (k,), float32)`: the features named in `gmr_gym.threshold_features.FEATURES`.

    ## Action space
    `Box(-1, 1, (j,), float32)`: one number for each of `parameters`, the logarithm of the threshold scaled
    over its range in `gmr_gym.thresholds.RANGES`.

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
    "extrapolation", or a CSV file as `gmr_gym.instances.instances` reads it. `price`: of a unit of work.
    `components`: the limit of hypotheses where it is not one of the parameters. `hindsight`: whether what
    only a simulation knows, `gmr_gym.threshold_hindsight.HINDSIGHT`, stands behind the features: for critics
    that learn, never for policies.
    """

    metadata = {"render_modes": []}  # noqa: RUF012, gymnasium declares it so

    def __init__(
        self,
        parameters: Sequence[str] = ("alpha", "prune"),
        instances: str = "train",
        price: float = PRICE,
        components: int = PAPER.components,
        hindsight: bool = False,
    ):
        self.hindsight = hindsight
        self.parameters = check_parameters(parameters)
        if not 0 <= price < np.inf:
            raise ValueError(f"price must be non-negative and finite, got {price}")
        self.price = price
        self._rest = PAPER._replace(components=at_least_one(components))
        encoded(self._rest, ("components",))  # a limit out of range is an error here, not in a scan
        self.instances = table_of(instances)
        self._width = len(FEATURES) + len(HINDSIGHT) * hindsight
        self.observation_space = gym.spaces.Box(-BOUND, BOUND, (self._width,), np.float32)
        self.action_space = gym.spaces.Box(-1.0, 1.0, (len(self.parameters),), np.float32)
        self._worlds: dict[str, Scenario] = {}
        self._to_come: list[str] = []  # instances, the next one last
        self._left = 0  # scans, with that which waits for its thresholds

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Features of scan 1 of a new episode, of the instance options["instance_id"] or, where none is
        named, of the next of all instances in an order that the seed shuffles. Raises ValueError for an
        unknown instance or option."""
        super().reset(seed=seed)
        if seed is not None:
            self._to_come = []
        episode_seed = seed if seed is not None else int(self.np_random.integers(2**63))
        self.instance_id = self._chosen(options or {})
        if self.instance_id not in self._worlds:
            self._worlds[self.instance_id] = world(self.instances[self.instance_id])
        self._scenario = self._worlds[self.instance_id]
        model = self._scenario.model
        self._known, self._memory = told(model), at_start(model)
        self._episode = draw(self._scenario, episode_seed)
        self._left, self._strayed = self._scenario.horizon, 0
        if self.hindsight:
            self._ahead = ahead(self._scenario, self._episode)
        return self._look(model.prior, moments(model.prior)[0]), {"instance_id": self.instance_id}

    def step(self, action):
        """Reduces the scan just looked at by the thresholds of the action (j,), and looks at the next. Raises
        ValueError for an action of another shape or outside the box, RuntimeError where no episode runs."""
        if self._left == 0:
            raise RuntimeError("call reset() before step(): no episode is running")
        thresholds = decoded(action, self.parameters, self._rest)
        kept = adapted(self._full.posterior.mixture, thresholds)
        self._memory = remembered(self._full, kept)
        estimate, _ = moments(kept.mixture)
        difference = (estimate - self._episode.x[-self._left])[list(self._scenario.position)]
        error, cutoff = float(np.sqrt(difference @ difference)), self._scenario.cutoff
        self._strayed = self._strayed + 1 if error > cutoff else 0
        reward = -min(error / cutoff, 1.0) - self.price * self._memory.work
        self._left -= 1
        terminated = self._strayed >= STRAYED
        if terminated:
            reward -= self._left
            self._left = 0
        info = {
            "instance_id": self.instance_id,
            "error": error,
            "work": self._memory.work,
            "components": self._memory.kept,
            "thresholds": thresholds._asdict(),
        }
        over = self._left == 0
        observation = np.zeros(self._width, np.float32) if over else self._look(kept.mixture, estimate)
        return observation, reward, terminated, over and not terminated, info

    def foreseen(self, action, scans: int = 1) -> float:
        """The rewards, in all, that the action would bring if held for so many scans, or to the end of the
        episode. Nothing is changed by it. It sees the truth and the detections to come: for bounds on what
        any policy can reach, not for policies."""
        ahead = copy(self)  # a step binds new values and changes none in place
        total = 0.0
        for _ in range(scans):
            _, reward, terminated, truncated, _ = ahead.step(action)
            total += reward
            if terminated or truncated:
                break
        return total

    def _chosen(self, options: dict[str, Any]) -> str:
        for option in options:
            if option != "instance_id":
                raise ValueError(f"unknown option {option!r}; reset takes 'instance_id'")
        if not options:
            if not self._to_come:
                self._to_come = [str(name) for name in self.np_random.permutation(list(self.instances))]
            return self._to_come.pop()
        name = options["instance_id"]
        if name not in self.instances:
            near = get_close_matches(str(name), self.instances, n=1) or list(self.instances)[:1]
            raise ValueError(f"unknown instance {name!r}; did you mean {near[0]!r}?")
        return name

    def _look(self, belief: Mixture, estimate: np.ndarray) -> np.ndarray:
        """Features of the next scan, expanded from the belief; the window is centred by the estimate."""
        scenario = self._scenario
        z = scan(scenario, self._episode, scenario.horizon - self._left, scenario.centre(estimate)).z
        self._full = expanded(belief, scenario.model, z)
        seen = features(self._full, self._memory, scenario.model, self._known)
        if self.hindsight:
            full, t = self._full, scenario.horizon - self._left
            beside = hindsight(
                full.posterior.mixture, scenario.model.sensor.H, full.gates.size, self._episode.x[t],
                self._left, self._strayed,
            )  # fmt: skip
            seen = np.concatenate(
                (seen, np.clip(beside, -BOUND, BOUND), np.clip(self._ahead[t], -BOUND, BOUND))
            )
        return seen.astype(np.float32)


class ThresholdSchedule(gym.Wrapper):
    """A `ReductionTuning` environment that a policy of `gmr_gym.threshold_policies` drives: `step` takes no
    heed of the action that it is given."""

    def __init__(self, env: gym.Env, policy: Callable[[np.ndarray, int], np.ndarray]):
        super().__init__(env)
        self.policy = policy

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """As the environment inside does."""
        self._observation, info = self.env.reset(seed=seed, options=options)
        self._t = 0
        return self._observation, info

    def step(self, action=None):
        """One scan under the policy's thresholds."""
        self._observation, *rest = self.env.step(self.policy(self._observation, self._t))
        self._t += 1
        return self._observation, *rest
