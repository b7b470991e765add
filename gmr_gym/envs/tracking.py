"""One environment for every single-target scenario."""

from importlib import import_module
from inspect import signature
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np
from scipy.stats import poisson

from gmr_gym.mixture import moments
from gmr_gym.simulate import Episode, Scan, Scenario, draw, scan

if TYPE_CHECKING:  # drawing is imported when something is drawn
    from gmr_gym.envs.render import Canvas

EXTENT = 1e7  # m and m/s: no coordinate, velocity or estimate in any scenario comes near
STRAYED = 10  # scans in a row beyond the cutoff that end an episode


class TrackingEnv(gym.Env):
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
    TurningTarget, RecordedFlight and JumpMarkov, 500 m for AgileFlight, five deviations of the prior's
    position for AirborneRadar).

    ## Starting state
    The prior of the scenario's model; truth, detections and clutter come from separate streams of
    the seed, so that every policy meets the same world, whatever it submits.

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
    """

    metadata = {  # noqa: RUF012, gymnasium declares it so
        "render_modes": ["rgb_array", "human"],
        "render_fps": 10,
    }

    def __init__(self, scenario: str, render_mode: str | None = None, **world):
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise ValueError(
                f"render_mode must be one of {self.metadata['render_modes']}, got {render_mode!r}"
            )
        self.scenario: Scenario = build(scenario, world)
        self.render_mode = render_mode
        p, d = self.scenario.model.sensor.H.shape
        reach = 2 * EXTENT * (1 + max(1.0, self.scenario.period))
        self._capacity = int(poisson.ppf(1 - 1e-12, self.scenario.clutter_rate)) + 1
        self.observation_space = gym.spaces.Dict({
            # wider than the action: a window may be centred on an estimate carried one period on, and a range
            # is up to the root of three times longer than a coordinate
            "scan": gym.spaces.Box(-reach, reach, (self._capacity, p), np.float64),
            "mask": gym.spaces.Box(0, 1, (self._capacity,), np.int8),
            "time": gym.spaces.Box(0.0, (self.scenario.horizon + 1) * self.scenario.period, (1,), np.float64),
            "prior_mean": gym.spaces.Box(-EXTENT, EXTENT, (d,), np.float64),
            "prior_covariance": gym.spaces.Box(-EXTENT**2, EXTENT**2, (d * d,), np.float64),
        })  # fmt: skip
        self.action_space = gym.spaces.Box(-EXTENT, EXTENT, (d,), np.float64)
        mean, covariance = moments(self.scenario.model.prior)
        self._prior = mean, covariance.ravel()
        self._position = list(self.scenario.position)
        self._episode: Episode
        self._scan: Scan
        self._t = self.scenario.horizon  # no episode is running
        self._shown = -1  # the scan last emitted
        self._canvas: Canvas | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
        """Scan 1 of a new episode. `seed` alone decides it; without one the stream goes on."""
        super().reset(seed=seed)
        chosen = seed if seed is not None else int(self.np_random.integers(2**63))
        self._episode = draw(self.scenario, chosen)
        self._t, self._strayed = 0, 0
        self._estimates: list[np.ndarray] = []
        observation, info = self._emit(self._prior[0])
        if self.render_mode == "human":
            self.render()
        return observation, info

    def step(self, action):
        """Scores the estimate (d,) of the scan just seen; the next scan, if there is one."""
        if self._t >= self.scenario.horizon:
            raise RuntimeError("call reset() before step(): no episode is running")
        estimate = self._checked(action)
        difference = (estimate - self._episode.x[self._t])[self._position]
        error = float(np.sqrt(difference @ difference))
        self._strayed = self._strayed + 1 if error > self.scenario.cutoff else 0
        self._estimates.append(estimate)
        self._t += 1
        left = self.scenario.horizon - self._t
        terminated = self._strayed >= STRAYED
        reward = -min(error, self.scenario.cutoff)
        if terminated:
            reward -= self.scenario.cutoff * left
            self._t = self.scenario.horizon
        observation, info = self._emit(estimate)
        info["error"] = error
        if self.render_mode == "human":
            self.render()
        return observation, reward, terminated, not terminated and left == 0, info

    def render(self):
        """The current scan as an image (height, width, 3), or in a window for "human"."""
        if self.render_mode is None:
            gym.logger.warn("render() needs a render_mode: pass render_mode='rgb_array' to make()")
            return None
        if self._shown < 0:
            raise RuntimeError("call reset() before render(): nothing has been seen yet")
        from gmr_gym.envs.render import Canvas

        if self._canvas is None:
            self._canvas = Canvas(self.scenario, on_screen=self.render_mode == "human")
        return self._canvas.draw(self._episode, self._scan, self._shown, self._estimates)

    def close(self):
        """Close the window, if one is open."""
        if self._canvas is not None:
            self._canvas.close()
            self._canvas = None

    def _emit(self, estimate):
        t = self._t
        z = np.zeros((self._capacity, len(self.scenario.sensor.R)))
        mask = np.zeros(self._capacity, np.int8)
        if t < self.scenario.horizon:
            self._scan = scan(self.scenario, self._episode, t, self.scenario.centre(estimate))
            self._shown, k = t, len(self._scan.z)
            z[:k] = self._scan.z
            mask[:k] = 1
            origin = np.full(self._capacity, -2)
            origin[:k] = self._scan.origin
            info = {
                "truth": self._episode.x[t].copy(), "mode": int(self._episode.mode[t]), "origin": origin
            }  # fmt: skip
        else:
            info = {}
        observation = {
            "scan": z,
            "mask": mask,
            "time": np.array([(t + 1) * self.scenario.period]),
            "prior_mean": self._prior[0].copy(),
            "prior_covariance": self._prior[1].copy(),
        }
        return observation, info

    def _checked(self, action) -> np.ndarray:
        estimate = np.array(action, float)
        if estimate.shape != self.action_space.shape:
            raise ValueError(f"action must have shape {self.action_space.shape}, got {estimate.shape}")
        if not (np.abs(estimate) <= EXTENT).all():
            raise ValueError(f"action must be finite and within +-{EXTENT:g}, got {estimate.tolist()}")
        return estimate


def build(scenario: str, world: dict[str, Any]) -> Any:
    """What "module:function" returns for the keywords in `world`; ValueError for one that it does not take,
    or that is of the wrong kind."""
    module, _, function = scenario.partition(":")
    factory = getattr(import_module(module), function)
    takes = list(signature(factory).parameters)
    for name in world:
        if name not in takes:
            raise ValueError(f"unknown argument {name!r}; this environment takes {', '.join(takes)}")
    try:
        return factory(**world)
    except TypeError as error:  # text or a fraction where a number of another kind belongs
        raise ValueError(f"cannot make a scenario of {world}: {error}") from None
