"""Many environments of thresholds, stepped in one call."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from gmr_gym.checks import check_count
from gmr_gym.envs.episodic import check_keywords, keywords
from gmr_gym.envs.episodic_vector import UNDRAWN, autoreset_of, check_not_drawn, seeds_of
from gmr_gym.envs.tuning import PRICE, Draws, checked_price, rest_of, spaces_of, told
from gmr_gym.tuning.instances import instances as table_of
from gmr_gym.tuning.recent import check_features, feature_index
from gmr_gym.tuning.scans import EPISODE, STEP, begin, stepped
from gmr_gym.tuning.thresholds import (
    DORTENZIO,
    WHOLE,
    Thresholds,
    check_actions,
    check_parameters,
    from_actions,
    threshold_index,
)


class ReductionTuningVectorEnv(VectorEnv):
    """Many `ReductionTuningEnv`, stepped in one call. Environment i equals a single one that is reset with
    the seed plus i, to the last bit, on any number of threads.

    `gym.make_vec("gmr_gym/ReductionTuning-v0", num_envs=64, vectorization_mode="vector_entry_point")`

    ## Arguments
    Those of the single environment. `autoreset_mode`: "NextStep", in which the step after an episode's last
    ignores the action and emits scan 1 of the next, or "SameStep", in which the last step does, with the
    last observation and info as `final_obs` and `final_info`, or "Disabled", in which the environment stops
    until `reset` begins all episodes anew. `copy`: whether every step makes new observations, or overwrites
    the last ones. `render_mode`: only None.
    """

    def __init__(
        self,
        num_envs: int,
        parameters: Sequence[str] = ("alpha", "prune"),
        instances: str = "train",
        price: float | Sequence[float] = PRICE,
        components: int = DORTENZIO.components,
        hindsight: bool = False,
        *,
        reducer: str = "adaptive",
        features: str | Sequence[str] = "posterior",
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        render_mode: None = None,
        **unknown,
    ):
        check_not_drawn(render_mode)
        check_keywords(unknown, keywords(type(self)))
        num_envs = check_count(num_envs, "num_envs")
        mode = autoreset_of(autoreset_mode)
        self.num_envs, self.copy = num_envs, copy
        self.metadata = {"render_modes": [], "autoreset_mode": mode}
        self.parameters, self.reducer = check_parameters(parameters, reducer), reducer
        self.price, self.features = checked_price(price), check_features(features)
        self._seen = feature_index(self.features)
        self._at, self._rest = threshold_index(self.parameters), np.array(rest_of(components), float)
        self.instances = table_of(instances)
        self.single_observation_space, self.single_action_space = spaces_of(
            self.parameters, self.features, hindsight
        )
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._members = [_Member(self.instances, self.price) for _ in range(num_envs)]
        self._names = np.full(num_envs, None, object)  # of instances
        self._state = np.zeros(num_envs, EPISODE)
        self._observations = np.zeros((num_envs, *self.single_observation_space.shape), np.float32)

    def reset(self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None):
        """Begin new episodes.

        Parameters
        ----------
        seed : int or sequence of (int or None), optional
            s stands for s, s + 1, ...; a sequence has one seed per environment.
        options : dict, optional
            As for one environment.

        Returns
        -------
        observations : ndarray (n, k)
            Features of scan 1.
        infos : dict
        """
        seeds = seeds_of(seed, self.num_envs)
        for member, own in zip(self._members, seeds, strict=True):
            if own is not None:
                member.np_random, _ = seeding.np_random(own)
        every = np.ones(self.num_envs, bool)
        self._begin(every, seeds, options or {})
        return self._shown(), self._infos(every, None)

    def step(self, actions: np.ndarray):
        """One scan of every environment.

        Parameters
        ----------
        actions : array_like (n, j)
            Numbers in [-1, 1].

        Returns
        -------
        observations : ndarray (n, k)
        rewards, terminated, truncated : ndarray (n,)
        infos : dict

        Raises
        ------
        ValueError
            For actions of another shape or outside the box.
        RuntimeError
            If no episode is running.
        """
        mode = self.metadata["autoreset_mode"]
        running = self._state["t"] < self._state["scans"]
        if self._names[0] is None:
            raise RuntimeError("call reset() before step(): no episode is running")
        actions = check_actions(actions, self.num_envs, self.parameters, running)
        steps = self._stepped(np.flatnonzero(running), from_actions(actions, self._at, self._rest))
        terminated, truncated = steps["terminated"].copy(), steps["truncated"].copy()
        infos: dict[str, Any] = {}
        over = terminated | truncated
        fresh = ~running & (mode is AutoresetMode.NEXT_STEP)
        if mode is AutoresetMode.SAME_STEP and over.any():
            infos["final_obs"], infos["_final_obs"] = np.full(self.num_envs, None, object), over.copy()
            for i in np.flatnonzero(over):
                infos["final_obs"][i] = self._observations[i].copy()
            infos["final_info"], infos["_final_info"] = self._infos(over, steps), over.copy()
            fresh = over
        self._begin(fresh, [None] * self.num_envs, {})
        infos |= self._infos(np.ones(self.num_envs, bool), steps, running & ~fresh)
        return self._shown(), steps["reward"].copy(), terminated, truncated, infos

    def _begin(self, which: np.ndarray, seeds: Any, options: dict[str, Any]) -> None:
        rows = np.flatnonzero(which)
        drawn = [self._members[i].next(seeds[i], options) for i in rows.tolist()]
        for i, (name, scenario, episode, price) in zip(rows, drawn, strict=True):
            self._names[i] = name
            begin(self._state[i], scenario, episode, self.reducer, price)
        self._stepped(rows, np.tile(self._rest, (self.num_envs, 1)))

    def render(self):
        """Raises NotImplementedError."""
        raise NotImplementedError(UNDRAWN)

    def _stepped(self, rows: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
        steps = np.zeros(self.num_envs, STEP)
        stepped(self._state, rows, thresholds, steps, self._observations, self._seen)
        return steps

    def _shown(self) -> np.ndarray:
        return self._observations.copy() if self.copy else self._observations

    def _infos(self, shown: np.ndarray, steps: np.ndarray | None, scored: np.ndarray | None = None):
        """Infos of the environments in the mask `shown`, with results of those in the mask `scored`."""
        scored = shown if scored is None else scored
        names = self._names.copy()
        names[~shown] = None
        infos: dict[str, Any] = {"instance_id": names, "_instance_id": shown.copy()}
        if isinstance(self.price, tuple):
            infos["price"], infos["_price"] = np.where(shown, self._state["price"], 0), shown.copy()
        if steps is None or not scored.any():
            return infos
        for key in ("error", "work", "components"):
            infos[key] = np.where(scored, steps[key], 0)
            infos[f"_{key}"] = scored.copy()
        infos["thresholds"], infos["_thresholds"] = {}, scored.copy()
        for key in told(self.parameters, self.reducer):
            at = Thresholds._fields.index(key)
            values = np.where(scored, steps["thresholds"][:, at], 0)
            infos["thresholds"][key] = values.astype(int) if WHOLE[at] else values
            infos["thresholds"][f"_{key}"] = scored.copy()
        return infos


class _Member:
    """Generator and episodes of one environment."""

    def __init__(self, instances, price):
        self._draws = Draws(instances, price)
        self.np_random: Any = None

    def next(self, seed: int | None, options: dict[str, Any]):
        if self.np_random is None:
            self.np_random, _ = seeding.np_random()
        return self._draws.next(seed, self, options)
