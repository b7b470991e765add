"""Many environments of one single-target scenario at once: `TrackingEnv` n times, to the last bit."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numba import config

from gmr_gym.checks import check_count
from gmr_gym.envs.buffers import Buffers
from gmr_gym.envs.episodic import EXTENT, check_keywords, keywords, settings
from gmr_gym.envs.tracking import TrackingEnv, blank, first_beyond, score_into
from gmr_gym.kernels import together
from gmr_gym.points import check_unmasked
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

SHARE = 32  # environments from which another thread pays off
LEAST, SHARES = 256, 4  # environments that a thread takes at once, but not more than so many times
SEEDS = 16  # drawn at a time
UNDRAWN = "vector environments are not rendered; make a single one to render"


class TrackingVectorEnv(gym.vector.VectorEnv):
    """`num_envs` independent episodes of one scenario, stepped by one call.

    Observations, rewards and infos are those of as many `TrackingEnv`s in Gymnasium's `SyncVectorEnv`, bit
    for bit, on any number of threads.

    ## Arguments
    `scenario` and other keywords: as for `TrackingEnv`.
    `autoreset_mode`: what happens after an episode's end. The next step begins another ("NextStep"); the
    same step does, with the last observation in info["final_obs"] and the last info in info["final_info"]
    ("SameStep"); or it waits for `reset(options={"reset_mask": ...})` ("Disabled").
    `copy`: whether every step hands out arrays of its own; if not, the next one overwrites the observation
    and info["origin"]: do not write to them.
    `threads`: number of threads that make scans; by default numba's, `NUMBA_NUM_THREADS` or one per core.
    `render_mode`: only None.
    """

    metadata = {  # noqa: RUF012, gymnasium declares it so
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        scenario: str,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        threads: int | None = None,
        render_mode: None = None,
        **arguments,
    ):
        check_not_drawn(render_mode)
        check_keywords(arguments, [*settings(scenario), *keywords(type(self))])
        num_envs = check_count(num_envs, "num_envs")
        most: int = config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
        limit = most if threads is None else check_count(threads, "threads")
        self.num_envs, self.copy, self.autoreset_mode = num_envs, copy, autoreset_of(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self._single = TrackingEnv(scenario, **arguments)
        self.scenario = self._single.scenario
        self.single_observation_space = self._single.observation_space
        self.single_action_space = self._single.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._threads = min(-(-num_envs // SHARE), limit)
        self._shares = _shares(num_envs, self._threads)
        self._scene = scene_of(self.scenario)
        self._linear = self._scene.window_motion is not None
        self._position = np.array(self.scenario.position)
        self._randoms: list[np.random.Generator | None] = [None] * num_envs
        self._seeds: list[list[int]] = [[] for _ in range(num_envs)]  # of the streams, the next one last
        x, mode = draw_truth(self.scenario, 0)
        # a scripted truth is one for all
        of = np.zeros(num_envs, int) if is_scripted(self.scenario) else np.arange(num_envs)
        truths = of[-1] + 1
        self._x, self._mode = np.tile(x, (truths, 1, 1)), np.tile(mode, (truths, 1))
        self._running = Running(
            np.zeros((num_envs, 2), np.uint32),
            np.tile(self.scenario.sensor.measure(x), (truths, 1, 1)),
            of,
            np.full(num_envs, self.scenario.horizon),
        )
        self._estimates = np.tile(self._single.prior[0], (num_envs, 1))  # of the scan before
        self._scans_off = np.zeros(num_envs, int)
        self._drawn: list[Any] = [None] * num_envs  # whole episodes, where the sensor is not linear
        self._ended = np.zeros(num_envs, bool)  # and not reset yet
        self._buffers = [Buffers(part) for part in blank((num_envs, *self._single.shape))]
        self._emitted: Any = None  # arrays that the next step may overwrite

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ):
        """Begin new episodes.

        Parameters
        ----------
        seed : int or sequence of (int or None), optional
            s stands for s, s + 1, ...; a sequence has one seed per environment. Without one the streams go
            on.
        options : dict, optional
            "reset_mask" (num_envs,): the environments to reset; all by default.

        Returns
        -------
        observations, infos : dict
            Of scan 1.
        """
        seeds = seeds_of(seed, self.num_envs)
        chosen = _chosen(options, self.num_envs)
        for i in np.flatnonzero(chosen):
            if seeds[i] is not None:
                self._randoms[i] = seeding.np_random(seeds[i])[0]
                self._seeds[i].clear()
        self._begin(np.flatnonzero(chosen), seeds)
        return self._emit(chosen)

    def step(self, actions):
        """Score the estimates of the current scans, and emit the next.

        Where an episode has ended, `autoreset_mode` decides.

        Parameters
        ----------
        actions : array_like (num_envs, d)
            Estimates.

        Returns
        -------
        observations, rewards, terminated, truncated, infos

        Raises
        ------
        RuntimeError
            If no episode is running.
        ValueError
            For another shape, or a number that is not finite or out of bounds.
        """
        n, horizon = self.num_envs, self.scenario.horizon
        anew = self._ended if self.autoreset_mode == AutoresetMode.NEXT_STEP else np.zeros(n, bool)
        if ((self._running.t >= horizon) > anew).any():
            raise RuntimeError("call reset() before step(): no episode is running")
        self._estimates = self._checked(actions, anew)
        error, rewards, terminated, truncated = scores = (
            np.empty(n), np.empty(n), np.empty(n, bool), np.empty(n, bool)
        )  # fmt: skip
        score_into(
            scores, self._running, self._scans_off, anew, self._estimates, self._x,
            self._position, float(self.scenario.cutoff),
        )  # fmt: skip
        scored = ~anew
        self._begin(np.flatnonzero(anew), [None] * n)
        self._ended = terminated | truncated
        final = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP and self._ended.any():
            scored = ~self._ended
            final = self._final(np.where(scored, 0.0, error))
            error[~scored] = 0.0
            self._begin(np.flatnonzero(self._ended), [None] * n)
        observation, infos = self._emit(np.ones(n, bool))
        if scored.any():
            infos |= {"error": error, "_error": scored}
        return observation, rewards, terminated, truncated, infos | final

    def _checked(self, actions, passed: np.ndarray) -> np.ndarray:
        """The actions as floats (num_envs, d).

        ValueError for a wrong shape and, except where `passed`, for a number out of bounds.
        """
        shape = self.action_space.shape
        check_unmasked("actions", actions)
        try:
            actions = np.array(actions, order="C")
            if actions.dtype != float:
                actions = actions.astype(float, casting="same_kind")
        except (TypeError, ValueError):
            raise ValueError(f"actions must be numbers of shape {shape}") from None
        if actions.shape != shape:
            raise ValueError(f"actions must have shape {shape}, got {actions.shape}")
        i = first_beyond(EXTENT, passed, actions)
        if i >= 0:
            raise ValueError(
                f"actions must be finite and within +-{EXTENT:g}, got {actions[i].tolist()} in row {i}"
            )
        return actions

    def _begin(self, rows: np.ndarray, given: Sequence[int | None]) -> None:
        """New episodes in the environments of these rows, by the given seeds, or for None by the stream's
        next.
        """
        if not len(rows):
            return
        now = self._running
        now.t[rows], self._scans_off[rows], self._ended[rows] = 0, 0, False
        self._estimates[rows] = self._single.prior[0]
        seeds = [self._next_seed(i) if given[i] is None else given[i] for i in rows.tolist()]
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

    def _next_seed(self, i: int) -> int:
        seeds = self._seeds[i]
        if not seeds:
            random = self._randoms[i]
            if random is None:
                random = self._randoms[i] = seeding.np_random()[0]
            # in one draw, which takes as long as two single ones
            seeds.extend(random.integers(2**63, size=SEEDS)[::-1].tolist())
        return seeds.pop()

    def _emit(self, wanted: np.ndarray):
        """Observations of all environments, and infos of those in the mask `wanted`."""
        n, now = self.num_envs, self._running
        if self.copy or self._emitted is None:
            self._emitted = None  # let go, so that they may be taken again
            self._emitted = tuple(buffer.take() for buffer in self._buffers)
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
        wanted = wanted & shown
        if not wanted.any():
            return observation, {}
        # rows taken by one index: two indices are slower than many scans
        at = now.of * self.scenario.horizon + np.where(wanted, now.t, 0)
        truth, mode = self._x.reshape(-1, self._x.shape[2]).take(at, axis=0), self._mode.take(at)
        if not wanted.all():
            truth[~wanted], mode[~wanted], origin[~wanted] = 0, 0, 0
        return observation, {
            "truth": truth, "mode": mode, "origin": origin,
            "_truth": wanted, "_mode": wanted.copy(), "_origin": wanted.copy(),
        }  # fmt: skip

    def _scans_in_turn(self, shown: np.ndarray) -> None:
        """The scans of a sensor that is not linear."""
        (z, mask, origin), view = self._emitted, self._scene.field_of_view
        for i in range(self.num_envs):
            k, place = 0, -1
            if shown[i]:
                centre, t = self.scenario.centre(self._estimates[i]), int(self._running.t[i])
                k, place = make_scan(z[i], self.scenario, view, self._drawn[i], t, centre)
            label_into(z[i], mask[i], origin[i], k, place)

    def render(self):
        """Raises NotImplementedError."""
        raise NotImplementedError(UNDRAWN)

    def _final(self, error: np.ndarray) -> dict[str, Any]:
        """The infos of the episodes that have just ended."""
        ended = self._ended.copy()
        observations = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(ended):
            observations[i] = self._single.nothing_more()
        return {
            "final_obs": observations, "_final_obs": ended,
            "final_info": {"error": error, "_error": ended.copy()}, "_final_info": ended.copy(),
        }  # fmt: skip


def seeds_of(seed: int | Sequence[int | None] | None, n: int) -> list[int | None]:
    """The seeds of n environments.

    Parameters
    ----------
    seed : int, sequence of (int or None), or None
        s stands for s, s + 1, ...; a sequence has one seed per environment.
    n : int

    Returns
    -------
    list of (int or None)

    Raises
    ------
    ValueError
        For anything else.
    """
    if seed is None:
        return [None] * n
    if isinstance(seed, int | np.integer) and not isinstance(seed, bool):
        return [int(seed) + i for i in range(n)]
    each = list(seed) if isinstance(seed, Sequence | np.ndarray) else []
    if len(each) != n or not all(s is None or isinstance(s, int | np.integer) for s in each):
        raise ValueError(f"seed must be a whole number or {n} of them, got {seed!r}")
    return [None if s is None else int(s) for s in each]


def check_not_drawn(render_mode: str | None) -> None:
    """ValueError for a render mode: vector environments are not rendered."""
    if render_mode is not None:
        raise ValueError(f"{UNDRAWN}: render_mode must be None, got {render_mode!r}")


def autoreset_of(mode: AutoresetMode | str) -> AutoresetMode:
    """The autoreset mode of a name; ValueError for an unknown one."""
    names = [mode.value for mode in AutoresetMode]
    if mode not in [*names, *AutoresetMode]:
        raise ValueError(f"autoreset_mode must be one of {', '.join(names)}, got {mode!r}")
    return AutoresetMode(mode)


def _shares(n: int, threads: int) -> list[tuple[int, int]]:
    """First and last of the environments that a thread takes at once."""
    count = min(max(n // LEAST, threads), SHARES * threads) if threads > 1 else 1
    return list(pairwise(np.linspace(0, n, count + 1).astype(int).tolist()))


def _chosen(options: dict[str, Any] | None, n: int) -> np.ndarray:
    """Mask (n,) of the environments that a reset is for."""
    if options is None or "reset_mask" not in options:
        return np.ones(n, bool)
    mask = np.asarray(options["reset_mask"])
    if mask.shape != (n,) or mask.dtype != bool or not mask.any():
        raise ValueError(f"options['reset_mask'] must be {n} booleans, at least one of them true, got {mask}")
    return mask
