"""What vector environments of one scenario share: seeds, autoreset, threads, and arrays handed out anew."""

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
from gmr_gym.envs.tracking import blank
from gmr_gym.points import check_unmasked

SHARE = 32  # environments from which another thread pays off
LEAST, SHARES = 256, 4  # environments that a thread takes at once, but not more than so many times
SEEDS = 16  # drawn at a time
UNDRAWN = "vector environments are not rendered; make a single one to render"


class EpisodicVectorEnv(gym.vector.VectorEnv):
    """`num_envs` independent episodes of one scenario, stepped by one call: bit for bit as many single ones.

    A subclass scores actions, begins episodes and emits scans by the methods at the end.
    """

    metadata = {  # noqa: RUF012, gymnasium declares it so
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self, single: Any, num_envs: int, autoreset_mode: AutoresetMode | str, copy: bool, threads: int | None
    ):
        num_envs = check_count(num_envs, "num_envs")
        most: int = config.NUMBA_NUM_THREADS  # type: ignore[attr-defined]
        limit = most if threads is None else check_count(threads, "threads")
        self.num_envs, self.copy, self.autoreset_mode = num_envs, copy, autoreset_of(autoreset_mode)
        self.metadata = self.metadata | {"autoreset_mode": self.autoreset_mode}
        self._single = single
        self.scenario = single.scenario
        self.single_observation_space = single.observation_space
        self.single_action_space = single.action_space
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._threads = min(-(-num_envs // SHARE), limit)
        self._shares = _shares(num_envs, self._threads)
        self._position = np.array(self.scenario.position)
        self._randoms: list[np.random.Generator | None] = [None] * num_envs
        self._seeds: list[list[int]] = [[] for _ in range(num_envs)]  # of the streams, the next one last
        self._t = np.full(num_envs, self.scenario.horizon)  # the scan shown, the horizon for none
        self._ended = np.zeros(num_envs, bool)  # and not reset yet
        self._buffers = [Buffers(part) for part in blank((num_envs, *single.shape))]
        self._emitted: Any = None  # arrays that the next step may overwrite

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, Any], dict[str, Any]]:
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

    def step(self, actions: Any) -> tuple[dict[str, Any], Any, Any, Any, dict[str, Any]]:
        """Score the estimates of the current scans, and emit the next.

        Where an episode has ended, `autoreset_mode` decides.

        Parameters
        ----------
        actions : array_like
            Estimates, one action of a single environment a row.

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
        if ((self._t >= horizon) > anew).any():
            raise RuntimeError("call reset() before step(): no episode is running")
        scores, rewards, terminated, truncated = self._scored(self._checked(actions, anew), anew)
        scored = ~anew
        self._begin(np.flatnonzero(anew), [None] * n)
        self._ended = terminated | truncated
        final = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP and self._ended.any():
            scored = ~self._ended
            final = self._final({key: np.where(scored, 0.0, score) for key, score in scores.items()})
            for score in scores.values():
                score[~scored] = 0.0
            self._begin(np.flatnonzero(self._ended), [None] * n)
        observation, infos = self._emit(np.ones(n, bool))
        if scored.any():
            infos |= _with_masks(scores, scored)
        return observation, rewards, terminated, truncated, infos | final

    def render(self) -> None:
        """Raises NotImplementedError."""
        raise NotImplementedError(UNDRAWN)

    def _next_seed(self, i: int) -> int:
        seeds = self._seeds[i]
        if not seeds:
            random = self._randoms[i]
            if random is None:
                random = self._randoms[i] = seeding.np_random()[0]
            # in one draw, which takes as long as two single ones
            seeds.extend(random.integers(2**63, size=SEEDS)[::-1].tolist())
        return seeds.pop()

    def _take(self) -> bool:
        """Takes z, mask and origin to emit the next scans in; whether they are others than before."""
        if not self.copy and self._emitted is not None:
            return False
        self._emitted = None  # let go, so that they may be taken again
        self._emitted = tuple(buffer.take() for buffer in self._buffers)
        return True

    def _final(self, scores: dict[str, np.ndarray]) -> dict[str, Any]:
        """The infos of the episodes that have just ended."""
        ended = self._ended.copy()
        observations = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(ended):
            observations[i] = self._single.nothing_more()
        return {
            "final_obs": observations, "_final_obs": ended,
            "final_info": _with_masks(scores, ended.copy()), "_final_info": ended.copy(),
        }  # fmt: skip

    def _checked(self, actions: Any, passed: np.ndarray) -> np.ndarray:
        """The actions as floats; ValueError for a wrong shape. A subclass checks their range, except where
        `passed`.
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
        return actions

    def _begin(self, rows: np.ndarray, given: Sequence[int | None]) -> None:
        """New episodes in the environments of these rows, by the given seeds, or for None by the stream's
        next.
        """
        if len(rows):
            self._t[rows], self._ended[rows] = 0, False
            self._draw(rows, [self._next_seed(i) if given[i] is None else given[i] for i in rows.tolist()])

    def _scored(self, actions: np.ndarray, passed: np.ndarray) -> tuple[dict[str, np.ndarray], Any, Any, Any]:
        """Scores, as in info, rewards, terminated and truncated (num_envs,), zeros where `passed`. The others
        move on to their next scan."""
        raise NotImplementedError

    def _draw(self, rows: np.ndarray, seeds: Sequence[int]) -> None:
        """Draws the episodes of the environments of these rows, by a seed each."""
        raise NotImplementedError

    def _emit(self, wanted: np.ndarray) -> tuple[dict[str, Any], dict[str, Any]]:
        """Observations of all environments, and infos of those in the mask `wanted`."""
        raise NotImplementedError


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


def _with_masks(infos: dict[str, np.ndarray], mask: np.ndarray) -> dict[str, np.ndarray]:
    """The infos, each with a mask of its own."""
    return infos | {f"_{key}": mask.copy() for key in infos}
