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
from gmr_gym.envs.episodic import EXTENT, check_keywords, keywords, settings
from gmr_gym.envs.scores import first_beyond, score_into
from gmr_gym.envs.tracking import TrackingEnv, blank
from gmr_gym.kernels import together
from gmr_gym.points import check_unmasked
from gmr_gym.simulation.scans import label_into, scans_into
from gmr_gym.simulation.seeds import keys_of
from gmr_gym.simulation.single_target import (
    draw,
    draw_truth,
    is_scripted,
    key_of,
    make_scan,
    view_of,
    window_motion,
)

SHARE = 32  # environments that a thread is worth
AHEAD = 16  # seeds drawn at a time
UNDRAWN = "environments side by side are not drawn, make a single one to look at"


class TrackingVectorEnv(gym.vector.VectorEnv):
    """`num_envs` independent episodes of one scenario, stepped by one call.

    Observations, rewards and infos are those of as many `TrackingEnv`s in Gymnasium's `SyncVectorEnv`, bit
    for bit, on any number of threads.

    ## Arguments
    `scenario` and other keywords: as for `TrackingEnv`.
    `autoreset_mode`: what happens after an episode's end. The next step begins another ("NextStep"); the
    same step does, with the last observation in info["final_obs"] and the last info in info["final_info"]
    ("SameStep"); or it waits for `reset(options={"reset_mask": ...})` ("Disabled").
    `copy`: whether every step hands out arrays of its own; if not, the next one writes over the observation
    and info["origin"], or only what has changed of them: write nothing there.
    `threads`: that make scans; None for as many as numba takes, `NUMBA_NUM_THREADS` or one a core.
    `render_mode`: none but None.
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
        **world,
    ):
        check_not_drawn(render_mode)
        check_keywords(world, [*settings(scenario), *keywords(type(self))])
        num_envs = check_count(num_envs, "num_envs")
        most: int = config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
        limit = most if threads is None else check_count(threads, "threads")
        self.num_envs, self.copy, self.autoreset_mode = num_envs, copy, autoreset_of(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self._single = TrackingEnv(scenario, **world)
        self.scenario = self._single.scenario
        self.single_observation_space = self._single.observation_space
        self.single_action_space = self._single.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        bounds = np.linspace(0, num_envs, min(-(-num_envs // SHARE), limit) + 1).astype(int)
        self._shares = list(pairwise(bounds.tolist()))  # of the threads, the caller's own first
        self._view, self._carried = view_of(self.scenario), window_motion(self.scenario)
        self._position = np.array(self.scenario.position)
        self._randoms: list[np.random.Generator | None] = [None] * num_envs
        self._ahead: list[list[int]] = [[] for _ in range(num_envs)]  # seeds of streams, the next one last
        x, mode = draw_truth(self.scenario, 0)
        # which truth is whose: a script's is one for all, for good
        self._of = np.zeros(num_envs, int) if is_scripted(self.scenario) else np.arange(num_envs)
        truths = self._of[-1] + 1
        self._x, self._mode = (np.tile(part, (truths, *[1] * part.ndim)) for part in (x, mode))
        expected = self.scenario.sensor.measure(x)
        self._expected = np.tile(expected, (truths, 1, 1))  # what the sensor would say without noise
        self._keys = np.zeros((num_envs, 2), np.uint32)
        self._drawn: list[Any] = [None] * num_envs  # whole episodes, where the sensor is not linear
        self._t = np.full(num_envs, self.scenario.horizon)  # the scan shown; the horizon for none
        self._estimates = np.tile(self._single.prior[0], (num_envs, 1))  # of the scan before
        self._strayed = np.zeros(num_envs, int)
        self._ended = np.zeros(num_envs, bool)  # and not begun anew
        self._handed_out: Any = None  # arrays that the next step may write over

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ):
        """Scan 1 of new episodes, of the environments in options["reset_mask"] (num_envs,) if it is given. An
        integer seed stands for seed, seed + 1, ...; without one the streams go on."""
        seeds = seeds_of(seed, self.num_envs)
        chosen = _chosen(options, self.num_envs)
        for i in np.flatnonzero(chosen):
            if seeds[i] is not None:
                self._randoms[i] = seeding.np_random(seeds[i])[0]
                self._ahead[i].clear()
        self._begin(np.flatnonzero(chosen), seeds)
        return self._emit(chosen)

    def step(self, actions):
        """Scores the estimates (num_envs, d) of the scans just seen; the next scans, or where an episode has
        ended what `autoreset_mode` says."""
        n, horizon = self.num_envs, self.scenario.horizon
        anew = self._ended if self.autoreset_mode == AutoresetMode.NEXT_STEP else np.zeros(n, bool)
        if ((self._t >= horizon) > anew).any():
            raise RuntimeError("call reset() before step(): no episode is running")
        self._estimates = self._checked(actions, anew)
        error, rewards, terminated, truncated = np.empty(n), np.empty(n), np.empty(n, bool), np.empty(n, bool)
        score_into(
            error, rewards, terminated, truncated, self._strayed, self._t, anew, self._estimates,
            self._x, self._of, self._position, float(self.scenario.cutoff),
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
        """The actions as floats (num_envs, d); ValueError for a wrong shape and, but for those `passed` over,
        for a number out of bounds."""
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
        """A new episode in the environments of these rows, of its seed, or for None of the stream's next."""
        if not len(rows):
            return
        self._t[rows], self._strayed[rows], self._ended[rows] = 0, 0, False
        self._estimates[rows] = self._single.prior[0]
        seeds = [self._next_seed(i) if given[i] is None else given[i] for i in rows.tolist()]
        if self._carried is not None:
            small = max(seeds) < 2**63
            self._keys[rows] = keys_of(np.array(seeds)) if small else [key_of(seed) for seed in seeds]
            if is_scripted(self.scenario):
                return
        for i, seed in zip(rows.tolist(), seeds, strict=True):
            if self._carried is None:
                self._drawn[i] = draw(self.scenario, seed)
                self._x[i], self._mode[i] = self._drawn[i].x, self._drawn[i].mode
            else:
                self._x[i], self._mode[i] = draw_truth(self.scenario, seed)
                self._expected[i] = self.scenario.sensor.measure(self._x[i])

    def _next_seed(self, i: int) -> int:
        ahead = self._ahead[i]
        if not ahead:
            random = self._randoms[i]
            if random is None:
                random = self._randoms[i] = seeding.np_random()[0]
            # in one draw, which takes as long as two of one number
            ahead.extend(random.integers(2**63, size=AHEAD)[::-1].tolist())
        return ahead.pop()

    def _emit(self, told: np.ndarray):
        """Observations of all environments, and infos of those that are told."""
        n, shape = self.num_envs, self._single.shape
        if self.copy or self._handed_out is None:
            self._handed_out = blank((n, *shape))
            self._priors = [np.tile(part, (n, 1)) for part in self._single.prior]
        z, mask, origin, _ = self._handed_out
        shown = self._t < self.scenario.horizon
        if self._carried is None:
            self._scans_in_turn(shown)
        else:
            self._scans_at_once()
        mean, covariance = self._priors
        observation = {
            "scan": z,
            "mask": mask,
            "time": (self._t[:, None] + 1) * self.scenario.period,
            "prior_mean": mean,
            "prior_covariance": covariance,
        }
        told = told & shown
        if not told.any():
            return observation, {}
        # rows taken by one index: by two it is slower than many scans
        at = self._of * self.scenario.horizon + np.where(told, self._t, 0)
        truth, mode = self._x.reshape(-1, self._x.shape[2]).take(at, axis=0), self._mode.take(at)
        if not told.all():
            origin = origin.copy()
            truth[~told], mode[~told], origin[~told] = 0, 0, 0
        return observation, {
            "truth": truth, "mode": mode, "origin": origin,
            "_truth": told, "_mode": told.copy(), "_origin": told.copy(),
        }  # fmt: skip

    def _scans_in_turn(self, shown: np.ndarray) -> None:
        """The scans of a sensor that is not linear."""
        z, mask, origin, was = self._handed_out
        for i in range(self.num_envs):
            k, place = 0, -1
            if shown[i]:
                centre = self.scenario.centre(self._estimates[i])
                k, place = make_scan(z[i], self.scenario, self._view, self._drawn[i], int(self._t[i]), centre)
            label_into(z[i], mask[i], origin[i], was[i], k, place)

    def render(self):
        """Raises NotImplementedError."""
        raise NotImplementedError(UNDRAWN)

    def _scans_at_once(self) -> None:
        """The scans of a linear sensor, each thread making those of a share of the environments."""
        sensor, chance = self.scenario.sensor, float(self.scenario.detection_probability)
        everything = (
            sensor.R, *self._handed_out, self._view, self._carried, chance, self._keys, self._expected,
            self._of, self._t, self._estimates,
        )  # fmt: skip
        together(scans_into, [(*share, *everything) for share in self._shares])

    def _final(self, error: np.ndarray) -> dict[str, Any]:
        """What info holds of the episodes that have just ended."""
        ended = self._ended.copy()
        observations = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(ended):
            observations[i] = self._single.nothing_more()
        return {
            "final_obs": observations, "_final_obs": ended,
            "final_info": {"error": error, "_error": ended.copy()}, "_final_info": ended.copy(),
        }  # fmt: skip


def seeds_of(seed: int | Sequence[int | None] | None, n: int) -> list[int | None]:
    """The seeds of n environments: s, s + 1, ... for a number s, or one each; ValueError for another."""
    if seed is None:
        return [None] * n
    if isinstance(seed, int | np.integer) and not isinstance(seed, bool):
        return [int(seed) + i for i in range(n)]
    each = list(seed) if isinstance(seed, Sequence | np.ndarray) else []
    if len(each) != n or not all(s is None or isinstance(s, int | np.integer) for s in each):
        raise ValueError(f"seed must be a whole number or {n} of them, got {seed!r}")
    return [None if s is None else int(s) for s in each]


def check_not_drawn(render_mode: str | None) -> None:
    """ValueError for a mode in which environments side by side would have to be drawn."""
    if render_mode is not None:
        raise ValueError(f"{UNDRAWN}: render_mode must be None, got {render_mode!r}")


def autoreset_of(mode: AutoresetMode | str) -> AutoresetMode:
    """The mode of that name; ValueError for another."""
    names = [mode.value for mode in AutoresetMode]
    if mode not in [*names, *AutoresetMode]:
        raise ValueError(f"autoreset_mode must be one of {', '.join(names)}, got {mode!r}")
    return AutoresetMode(mode)


def _chosen(options: dict[str, Any] | None, n: int) -> np.ndarray:
    """Which of the n environments a reset is for."""
    if options is None or "reset_mask" not in options:
        return np.ones(n, bool)
    mask = np.asarray(options["reset_mask"])
    if mask.shape != (n,) or mask.dtype != bool or not mask.any():
        raise ValueError(f"options['reset_mask'] must be {n} booleans, at least one of them true, got {mask}")
    return mask
