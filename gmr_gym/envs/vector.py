"""Many environments of one single-target scenario at once: `TrackingEnv` n times, to the last bit."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from gmr_gym.envs.episodic import EXTENT, check_keywords, keywords, settings
from gmr_gym.envs.episodic_vector import EpisodicVectorEnv, check_not_drawn
from gmr_gym.envs.tracking import TrackingEnv, first_beyond, score_into, state_of
from gmr_gym.kernels import together
from gmr_gym.simulation.scans import Running, label_into, scans_into
from gmr_gym.simulation.seeds import keys_of
from gmr_gym.simulation.single_target import (
    draw,
    draw_truth,
    is_scripted,
    key_of,
    make_scan,
    scene_of,
)


class TrackingVectorEnv(EpisodicVectorEnv):
    """`num_envs` independent episodes of one scenario, stepped by one call.

    Observations, rewards and infos are those of as many `TrackingEnv`s in Gymnasium's `SyncVectorEnv`, bit
    for bit, on any number of threads.

    ## Arguments
    `scenario`, `observe` and other keywords: as for `TrackingEnv`.
    `autoreset_mode`: what happens after an episode's end. The next step begins another ("NextStep"); the
    same step does, with the last observation in info["final_obs"] and the last info in info["final_info"]
    ("SameStep"); or it waits for `reset(options={"reset_mask": ...})` ("Disabled").
    `copy`: whether every step hands out arrays of its own; if not, the next one overwrites the observation
    and info["origin"]: do not write to them.
    `threads`: number of threads that make scans; by default numba's, `NUMBA_NUM_THREADS` or one per core.
    `render_mode`: only None.
    """

    def __init__(
        self,
        scenario: str,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        threads: int | None = None,
        render_mode: None = None,
        observe: str = "detections",
        **arguments,
    ):
        check_not_drawn(render_mode)
        check_keywords(arguments, [*settings(scenario), *keywords(type(self))])
        single = TrackingEnv(scenario, observe=observe, **arguments)
        super().__init__(single, num_envs, autoreset_mode, copy, threads)
        self._scene = scene_of(self.scenario)
        self._linear = self._scene.window_motion is not None
        num_envs = self.num_envs
        x, mode = draw_truth(self.scenario, 0)
        # a scripted truth is one for all
        of = np.zeros(num_envs, int) if is_scripted(self.scenario) else np.arange(num_envs)
        truths = of[-1] + 1
        self._x, self._mode = np.tile(x, (truths, 1, 1)), np.tile(mode, (truths, 1))
        self._running = Running(
            np.zeros((num_envs, 2), np.uint32),
            np.tile(self.scenario.sensor.measure(x), (truths, 1, 1)),
            of,
            self._t,
        )
        self._estimates = np.tile(self._single.prior[0], (num_envs, 1))  # of the scan before
        self._scans_off = np.zeros(num_envs, int)
        self._drawn: list[Any] = [None] * num_envs  # whole episodes, where the sensor is not linear

    def _checked(self, actions, passed: np.ndarray) -> np.ndarray:
        actions = super()._checked(actions, passed)
        i = first_beyond(EXTENT, passed, actions)
        if i >= 0:
            raise ValueError(
                f"actions must be finite and within +-{EXTENT:g}, got {actions[i].tolist()} in row {i}"
            )
        return actions

    def _scored(self, actions: np.ndarray, passed: np.ndarray):
        n, self._estimates = self.num_envs, actions
        error, rewards, terminated, truncated = scores = (
            np.empty(n), np.empty(n), np.empty(n, bool), np.empty(n, bool)
        )  # fmt: skip
        score_into(
            scores, self._running, self._scans_off, passed, self._estimates, self._x,
            self._position, float(self.scenario.cutoff),
        )  # fmt: skip
        return {"error": error}, rewards, terminated, truncated

    def _draw(self, rows: np.ndarray, seeds: Sequence[int]) -> None:
        now = self._running
        self._scans_off[rows], self._estimates[rows] = 0, self._single.prior[0]
        if self._linear:
            small = max(seeds) < 2**63
            now.key[rows] = keys_of(np.array(seeds)) if small else [key_of(seed) for seed in seeds]
            if is_scripted(self.scenario):
                return
        for i, seed in zip(rows.tolist(), seeds, strict=True):
            if not self._linear:
                self._drawn[i] = draw(self.scenario, seed)
                self._x[i], self._mode[i] = self._drawn[i].x, self._drawn[i].mode
            else:
                self._x[i], self._mode[i] = draw_truth(self.scenario, seed)
                now.z_hat[i] = self.scenario.sensor.measure(self._x[i])

    def _emit(self, wanted: np.ndarray):
        n, now = self.num_envs, self._running
        if self._take():
            self._priors = [np.tile(part, (n, 1)) for part in self._single.prior]
        z, mask, origin = self._emitted
        shown = now.t < self.scenario.horizon
        if self._linear:  # threads share the environments
            given = self._emitted, self._scene, now, self._estimates
            together(scans_into, [(*share, *given) for share in self._shares], self._threads)
        else:
            self._scans_in_turn(shown)
        mean, covariance = self._priors
        observation = {
            "scan": z,
            "mask": mask,
            "time": (now.t[:, None] + 1) * self.scenario.period,
            "prior_mean": mean,
            "prior_covariance": covariance,
        }
        if self._single.shows_truth:
            truth, mode = self._states_of(shown)
            truth[~shown], mode[~shown] = 0, -1
            scans_off = np.where(shown, self._scans_off, 0)
            observation |= state_of(truth, mode[:, None], scans_off[:, None])
        wanted = wanted & shown
        if not wanted.any():
            return observation, {}
        truth, mode = self._states_of(wanted)
        if not wanted.all():
            truth[~wanted], mode[~wanted], origin[~wanted] = 0, 0, 0
        return observation, {
            "truth": truth, "mode": mode, "origin": origin,
            "_truth": wanted, "_mode": wanted.copy(), "_origin": wanted.copy(),
        }  # fmt: skip

    def _states_of(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True states (n, d) and modes (n,) at the scans shown, where `wanted` (n,)."""
        # rows taken by one index: two indices are slower than many scans
        at = self._running.of * self.scenario.horizon + np.where(wanted, self._running.t, 0)
        return self._x.reshape(-1, self._x.shape[2]).take(at, axis=0), self._mode.take(at)

    def _scans_in_turn(self, shown: np.ndarray) -> None:
        """The scans of a sensor that is not linear."""
        (z, mask, origin), view = self._emitted, self._scene.field_of_view
        for i in range(self.num_envs):
            k, place = 0, -1
            if shown[i]:
                centre, t = self.scenario.centre(self._estimates[i]), int(self._running.t[i])
                k, place = make_scan(z[i], self.scenario, view, self._drawn[i], t, centre)
            label_into(z[i], mask[i], origin[i], k, place)
