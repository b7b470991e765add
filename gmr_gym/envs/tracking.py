"""One environment for every single-target scenario."""

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike

from gmr_gym.envs.episodic import EXTENT, ORIGIN, EpisodicEnv
from gmr_gym.kernels import leaf_kernel
from gmr_gym.mixture import moments
from gmr_gym.simulation.reward import SCANS_OFF, distance, score
from gmr_gym.simulation.scans import label_into
from gmr_gym.simulation.single_target import Episode, Scan, Scenario, capacity, draw, make_scan, scan, view_of


class TrackingEnv(EpisodicEnv):
    """One target in clutter, to be estimated scan by scan.

    ## Description
    A sensor reports a scan of points; at most one of them comes from the target. `reset` emits
    scan 1; `step(estimate)` scores the estimate of the scan just seen and emits the next.

    ## Observation space
    A flat `Dict` of float64 boxes (and one of int8), metres, radians and seconds:

    | key | shape | meaning |
    |---|---|---|
    | `scan` | (capacity, p) | detections in random order, padded with zeros; the sensor's own coordinates |
    | `mask` | (capacity,) | 1 where a row of `scan` is a detection |
    | `time` | (1,) | time of the scan, s; the prior is at 0 |
    | `prior_mean` | (d,) | the prior the tracker starts from, one period before scan 1 |
    | `prior_covariance` | (d * d,) | its covariance, row by row |

    The capacity is the Poisson quantile of the clutter at 1 - 1e-12, plus one for the target.

    ## Action space
    `Box(-1e7, 1e7, (d,), float64)`: the estimated state.

    ## Reward
    Minus the position error in metres, no worse than minus the scenario's cutoff (100 m for
    TurningTarget, RecordedFlight and JumpMarkov, 500 m for AgileFlight, five standard deviations of the
    prior's position for AirborneRadar).

    ## Starting state
    The prior of the scenario's model; truth, detections and clutter come from separate streams of
    the seed, so that every policy meets the same episode, whatever it submits.

    ## Episode end
    `truncated` after the last scan, with an empty observation. `terminated` when the error has
    exceeded the cutoff in ten scans in a row; the reward of that step also charges the cutoff for
    every scan that is left, so that losing early never pays.

    ## Info
    `truth` (d,), `mode` (which of the model's motions led to it, -1 for none of them) and `origin`
    (capacity,) (0 the target's, -1 clutter, -2 padding) of the scan observed, and after a step `error`, m.
    They are for scoring and drawing: a policy that reads them cheats.

    ## Arguments
    `scenario`: "module:function" that returns a Scenario; every other keyword goes to it.
    `observe`: "detections", or "truth" for the fully observed twin: the same episodes, scans and rewards,
    and an observation that has `truth` and `mode` of info too, and `scans_off` (1,), the scans in a row
    beyond the cutoff so far. With `time` they decide all that follows but chance, where the target moves by
    the scenario's model or on a given path: no memory is of use.
    """

    scenario: Scenario

    def __init__(
        self,
        scenario: str,
        render_mode: str | None = None,
        observe: str = "detections",
        **arguments,
    ):
        super().__init__(scenario, render_mode, observe, arguments)
        p, d = self.scenario.model.sensor.H.shape
        reach = 2 * EXTENT * (1 + max(1.0, self.scenario.period))
        self._capacity = capacity(self.scenario.clutter_rate)
        self.shape = self._capacity, p
        spaces: dict[str, gym.Space] = {
            # wider than the action: a window may be centred on an estimate predicted one period ahead, and a
            # range is up to the root of three times longer than a coordinate
            "scan": gym.spaces.Box(-reach, reach, (self._capacity, p), np.float64),
            "mask": gym.spaces.Box(0, 1, (self._capacity,), np.int8),
            "time": gym.spaces.Box(0.0, (self.scenario.horizon + 1) * self.scenario.period, (1,), np.float64),
            "prior_mean": gym.spaces.Box(-EXTENT, EXTENT, (d,), np.float64),
            "prior_covariance": gym.spaces.Box(-EXTENT**2, EXTENT**2, (d * d,), np.float64),
        }  # fmt: skip
        if self.shows_truth:
            spaces |= {
                "truth": gym.spaces.Box(-EXTENT, EXTENT, (d,), np.float64),
                "mode": gym.spaces.Box(-1, len(self.scenario.model.motions) - 1, (1,), np.int8),
                "scans_off": gym.spaces.Box(0, SCANS_OFF, (1,), np.int8),
            }
        self.observation_space = gym.spaces.Dict(spaces)
        self.action_space = gym.spaces.Box(-EXTENT, EXTENT, (d,), np.float64)
        mean, covariance = moments(self.scenario.model.prior)
        self.prior = mean, covariance.ravel()
        self._view = view_of(self.scenario)
        self._scans_off = 0  # scans in a row beyond the cutoff

    def step(self, action):
        """Score the estimate of the current scan, and emit the next.

        Parameters
        ----------
        action : array_like (d,)
            Estimate.

        Returns
        -------
        observation, reward, terminated, truncated, info

        Raises
        ------
        RuntimeError
            If no episode is running.
        ValueError
            For another shape, or a number that is not finite or out of bounds.
        """
        estimate = self._checked(action)
        error = distance(estimate.tolist(), self._episode.x[self._t].tolist(), self._position)
        self._estimates.append(estimate)
        self._t += 1
        reward, self._scans_off, terminated, truncated = score(
            error, self.scenario.cutoff, 0.0, self._scans_off, self.scenario.horizon - self._t
        )
        if terminated:
            self._t = self.scenario.horizon
        observation, info = self._emit()
        info["error"] = error
        return observation, reward, terminated, truncated, info

    def _drawn(self, seed: int) -> Episode:
        self._scans_off = 0
        return draw(self.scenario, seed)

    def _seen(self, t: int) -> Scan:
        return scan(self.scenario, self._episode, t, self._centre(t))

    def _centre(self, t: int) -> np.ndarray:
        return self.scenario.centre(self._estimates[t - 1] if t else self.prior[0])

    def nothing_more(self) -> dict[str, np.ndarray]:
        """The observation past the last scan."""
        seen = self._observed(np.zeros(self.shape), np.zeros(self._capacity, np.int8), self.scenario.horizon)
        return seen | (state_of(np.zeros(len(self.prior[0])), [-1], [0]) if self.shows_truth else {})

    def _observed(self, z, mask, t):
        mean, covariance = self.prior
        return {
            "scan": z,
            "mask": mask,
            "time": np.array([(t + 1) * self.scenario.period]),
            "prior_mean": mean.copy(),
            "prior_covariance": covariance.copy(),
        }

    def _emit(self):
        t = self._t
        if t >= self.scenario.horizon:
            observation, info = self.nothing_more(), {}
        else:
            self._shown = t
            z, mask, origin = blank(self.shape)
            made = make_scan(z, self.scenario, self._view, self._episode, t, self._centre(t))
            label_into(z, mask, origin, *made)
            x, mode = self._episode.x[t].copy(), int(self._episode.mode[t])
            observation, info = self._observed(z, mask, t), {"truth": x, "mode": mode, "origin": origin}
            if self.shows_truth:
                observation |= state_of(x, [mode], [self._scans_off])
        if self.render_mode == "human":
            self.render()
        return observation, info

    def _checked(self, action) -> np.ndarray:
        estimate = super()._checked(action)
        if not all(-EXTENT <= value <= EXTENT for value in estimate.tolist()):
            raise ValueError(f"action must be finite and within +-{EXTENT:g}, got {estimate.tolist()}")
        return estimate

    def _new_canvas(self, on_screen: bool):
        from gmr_gym.envs.render import Canvas

        return Canvas(self.scenario, on_screen)


def state_of(x: np.ndarray, mode: ArrayLike, scans_off: ArrayLike) -> dict[str, np.ndarray]:
    """What an observation has besides, with observe="truth", of true states (..., d)."""
    return {"truth": x.copy(), "mode": np.array(mode, np.int8), "scans_off": np.array(scans_off, np.int8)}


def blank(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z (..., capacity, p), mask and origin for `label_into` to write to."""
    return np.empty(shape), np.empty(shape[:-1], np.int8), np.empty(shape[:-1], ORIGIN)


@leaf_kernel
def score_into(scored, running, scans_off, passed, estimates, x, position, cutoff):
    """Scores the estimates (n, d) of the scans shown, as `TrackingEnv.step` does, and moves on to the next.

    `scored` receives error, m, reward, terminated and truncated (n,), zeros where `passed`; it is a plain
    tuple, as a call takes half a microsecond longer for a named one. `scans_off` (n,) counts the scans in a
    row beyond the cutoff, and x (m, T, d) are the true states.
    """
    errors, rewards, terminations, truncations = scored
    of, t, horizon = running.of, running.t, x.shape[1]
    for i in range(len(t)):
        error, reward, terminated, truncated = 0.0, 0.0, False, False
        if not passed[i]:
            error = distance(estimates[i], x[of[i], t[i]], position)
            t[i] += 1
            reward, scans_off[i], terminated, truncated = score(
                error, cutoff, 0.0, scans_off[i], horizon - t[i]
            )
            if terminated:
                t[i] = horizon
        errors[i], rewards[i], terminations[i], truncations[i] = error, reward, terminated, truncated


@leaf_kernel
def first_beyond(extent, passed, estimates):
    """The first of the estimates (n, d) with a number that is not within +-extent, -1 for none; `passed` ones
    apart.
    """
    for i in range(len(estimates)):
        for c in range(estimates.shape[1]):
            if not (passed[i] or abs(estimates[i, c]) <= extent):
                return i
    return -1
