"""Wrappers for agents that track by themselves: detections about their predictions, and answers likewise."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector.utils import batch_space

from gmr_gym.checks import _check_positive, check_count, check_not_negative
from gmr_gym.envs.tracking import TrackingEnv
from gmr_gym.envs.vector import TrackingVectorEnv
from gmr_gym.learning.prediction import Prediction
from gmr_gym.points import check_unmasked

NEAREST = 8  # detections that an agent sees, unless it is given another number
MOST_NEAREST = 10_000  # where a scan has not more rows: beyond them all are empty


class RelativeTracking(gym.Wrapper, RecordConstructorArgs):
    """A tracking environment of one target in the agent's frame: everything in [-1, 1], about a prediction.

    ## Description
    The prediction is a Kalman filter's with the first of the scenario's motion models, from the agent's own
    estimate of the scan before, and from the prior at first. The agent decides what a tracker's update does:
    which detections are the target's, and how far to follow them. How the other states follow from the
    position is in `gmr_gym.learning.prediction.Prediction`.

    ## Observation space
    A `Dict`, in units of `reach` from the predicted position:

    | key | shape | meaning |
    |---|---|---|
    | `detections` | (nearest, p) float32 | positions of the nearest detections within reach on every axis, the nearest first; zeros after the last |
    | `mask` | (nearest,) int8 | 1 where a row is a detection |
    | `truth` | (p,) float32 | with observe="truth" alone: where the target is, cut off at [-1, 1] |

    ## Action space
    `Box(-1, 1, (p,), float32)`: the target's position, in the same units.

    ## Reward
    That of the environment, divided by the scenario's cutoff: from -1 to 0 a scan, but for the charge of a
    target given up.

    ## Arguments
    `env`: an environment of one target; `nearest`: rows of an observation, None for as many as a scan has
    room for; `reach`: m, by default the scenario's cutoff.
    """  # noqa: E501, the rows of a table

    def __init__(self, env: gym.Env, nearest: int | None = NEAREST, reach: float | None = None):
        RecordConstructorArgs.__init__(self, nearest=nearest, reach=reach)
        if not isinstance(env.unwrapped, TrackingEnv):
            raise ValueError(f"env must be a tracking environment of one target, got {env.unwrapped}")
        super().__init__(env)
        self._frame = Frame(env.unwrapped, 1, nearest, reach)
        self.observation_space, self.action_space = self._frame.spaces

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin a new episode, as `TrackingEnv.reset` does."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._frame.begin(np.ones(1, bool))
        return self._seen(observation), info

    def step(self, action: Any) -> tuple[dict[str, np.ndarray], Any, bool, bool, dict[str, Any]]:
        """Submit the position of the target about the prediction, and see the next scan.

        Parameters
        ----------
        action : array_like (p,)
            In [-1, 1].

        Returns
        -------
        observation, reward, terminated, truncated, info

        Raises
        ------
        RuntimeError
            If no episode is running.
        ValueError
            For another shape, or a number outside [-1, 1].
        """
        action = checked_actions("action", action, (self._frame.p,))
        estimates = self._frame.estimates(action[None])
        observation, reward, terminated, truncated, info = self.env.step(estimates[0])
        self._frame.move_on(estimates)
        return self._seen(observation), float(reward) / self._frame.cutoff, terminated, truncated, info

    def _seen(self, observation: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        several = {key: part[None] for key, part in observation.items()}
        return {key: part[0] for key, part in self._frame.seen(several).items()}


class RelativeTrackingVector(gym.vector.VectorWrapper):
    """`RelativeTracking` of vector environments: as many single ones, bit for bit, in one call.

    ## Arguments
    `env`: a vector environment of one target, as `gymnasium.make_vec` makes it; `nearest` and `reach`: as for
    `RelativeTracking`.
    """

    def __init__(self, env: gym.vector.VectorEnv, nearest: int | None = NEAREST, reach: float | None = None):
        if not isinstance(env.unwrapped, TrackingVectorEnv):
            raise ValueError(f"env must be vector environments of one target, got {env.unwrapped}")
        super().__init__(env)
        self.autoreset_mode = env.unwrapped.autoreset_mode  # where Gymnasium's own have it
        self._frame = Frame(env.unwrapped._single, env.num_envs, nearest, reach)
        self.single_observation_space, self.single_action_space = self._frame.spaces
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)
        self.action_space = batch_space(self.single_action_space, env.num_envs)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin new episodes, as `TrackingVectorEnv.reset` does."""
        envs: Any = self.env  # which takes a seed of each
        observation, infos = envs.reset(seed=seed, options=options)
        self._frame.begin(np.array((options or {}).get("reset_mask", np.ones(self.num_envs, bool))))
        return self._frame.seen(observation), infos

    def step(self, actions: Any) -> tuple[dict[str, np.ndarray], Any, Any, Any, dict[str, Any]]:
        """Submit positions about the predictions, and see the next scans.

        Parameters
        ----------
        actions : array_like (num_envs, p)
            In [-1, 1]. What is given where an episode is only begun anew does not count.

        Returns
        -------
        observations, rewards, terminated, truncated, infos

        Raises
        ------
        RuntimeError
            If no episode is running.
        ValueError
            For another shape, or a number outside [-1, 1].
        """
        estimates = self._frame.estimates(checked_actions("actions", actions, (self.num_envs, self._frame.p)))
        observation, rewards, terminated, truncated, infos = self.env.step(estimates)
        self._frame.move_on(estimates)
        self._frame.begin(observation["time"][:, 0] == self._frame.first)
        if "final_obs" in infos:
            for i in np.flatnonzero(infos["_final_obs"]):
                infos["final_obs"][i] = {key: part.copy() for key, part in self._frame.nothing.items()}
        return self._frame.seen(observation), rewards / self._frame.cutoff, terminated, truncated, infos


class Frame:
    """What agents see and say in n episodes: positions about their predictions, in units of `reach`.

    Parameters
    ----------
    env : TrackingEnv
        One of the environments.
    n : int
    nearest : int or None
        Detections that are seen, None for all within reach.
    reach : float or None
        m; None for the scenario's cutoff.
    """

    def __init__(self, env: TrackingEnv, n: int, nearest: int | None, reach: float | None):
        scenario = env.scenario
        self.reach = scenario.cutoff if reach is None else check_not_negative("reach", reach)
        _check_positive(reach=self.reach)
        (capacity, p), self.p = env.shape, env.shape[1]
        self.rows = capacity if nearest is None else check_count(nearest, "nearest")
        if self.rows > max(capacity, MOST_NEAREST):
            raise ValueError(f"nearest must be at most {max(capacity, MOST_NEAREST)}, got {nearest}")
        self.cutoff, self.first = scenario.cutoff, scenario.period
        self._end = scenario.horizon * scenario.period
        self._sensor = scenario.model.sensor
        mean, covariance = env.prior
        self._prediction = Prediction(scenario.model, mean, covariance.reshape(len(mean), -1), n)
        spaces: dict[str, gym.Space] = {
            "detections": gym.spaces.Box(-1.0, 1.0, (self.rows, p), np.float32),
            "mask": gym.spaces.Box(0, 1, (self.rows,), np.int8),
        }
        if env.shows_truth:
            spaces["truth"] = gym.spaces.Box(-1.0, 1.0, (p,), np.float32)
        self.nothing = {key: np.zeros(space.shape or (), space.dtype) for key, space in spaces.items()}
        self.spaces = gym.spaces.Dict(spaces), gym.spaces.Box(-1.0, 1.0, (p,), np.float32)
        self.begin, self.move_on = self._prediction.begin, self._prediction.move_on

    def estimates(self, actions: np.ndarray) -> np.ndarray:
        """States (n, d) of the positions (n, p) that agents give."""
        return self._prediction.estimates(self.reach * actions)

    def seen(self, observation: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """What agents see of observations, arrays of n rows."""
        scan, at = observation["scan"], self._prediction.at[:, None]
        n, p = len(scan), scan.shape[2]
        away = (self._sensor.to_gate_space(scan.reshape(-1, p)).reshape(scan.shape) - at) / self.reach
        within = (observation["mask"] == 1) & (np.abs(away) <= 1).all(axis=2)
        far = np.where(within, (away**2).sum(axis=2), np.inf)
        order = np.argsort(far, axis=1, kind="stable")[:, : self.rows]
        detections, mask = np.zeros((n, self.rows, p), np.float32), np.zeros((n, self.rows), np.int8)
        mask[:, : order.shape[1]] = kept = np.take_along_axis(within, order, axis=1)
        nearest = np.take_along_axis(away, order[:, :, None], axis=1)
        detections[:, : order.shape[1]] = np.where(kept[:, :, None], nearest, 0.0)
        seen: dict[str, np.ndarray] = {"detections": detections, "mask": mask}
        if "truth" in observation:
            away = (observation["truth"] @ self._sensor.H.T - at[:, 0]) / self.reach
            over = observation["time"] > self._end
            seen["truth"] = np.where(over, 0.0, away.clip(-1, 1)).astype(np.float32)
        return seen


def checked_actions(name: str, actions: Any, shape: tuple[int, ...]) -> np.ndarray:
    """The actions as floats; ValueError for another shape, or a number outside [-1, 1]."""
    check_unmasked(name, actions)
    try:
        actions = np.array(actions, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be numbers of shape {shape}") from None
    if actions.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {actions.shape}")
    if not (np.abs(actions) <= 1).all():
        raise ValueError(f"{name} must lie in [-1, 1], got {actions.tolist()}")
    return actions
