"""Many environments of one scenario of many targets at once: `MultiTargetEnv` n times, to the last bit."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode

from gmr_gym.envs.episodic import EXTENT, ORIGIN, check_keywords, keywords, settings
from gmr_gym.envs.episodic_vector import EpisodicVectorEnv, check_not_drawn
from gmr_gym.envs.labels import labels_of
from gmr_gym.envs.multi_target import (
    COLUMN,
    EXISTENCE_THRESHOLD,
    PARTS,
    TRAJECTORY,
    MultiTargetEnv,
    estimates,
    targets_at,
)
from gmr_gym.envs.tracking import first_beyond
from gmr_gym.evaluation.set_distances import distances_by, rule_of, set_distances, workspace
from gmr_gym.kernels import kernel, leaf_kernel, together
from gmr_gym.points import absent
from gmr_gym.simulation.multi_target import draw
from gmr_gym.simulation.scans import label_into


class Episodes(NamedTuple):
    """n episodes of m targets that are played side by side."""

    x: np.ndarray  # (n, T, m, d), true states, nan where a target is absent
    z: np.ndarray  # (n, N, p), the detections of all scans, one scan after the other
    origin: np.ndarray  # (n, N), index of the target, -1 clutter
    first: np.ndarray  # (n, T + 1), scan t of episode i has z[i, first[i, t] : first[i, t + 1]]
    t: np.ndarray  # (n,), the scan shown, T for none


class MultiTargetVectorEnv(EpisodicVectorEnv):
    """`num_envs` independent episodes of one scenario of many targets, stepped by one call.

    Observations, rewards and infos are those of as many `MultiTargetEnv`s in Gymnasium's `SyncVectorEnv`, bit
    for bit, on any number of threads.

    ## Arguments
    `scenario`, `targets`, `metric`, `labels`, `switching`, `observe` and other keywords: as for
    `MultiTargetEnv`.
    `autoreset_mode`, `copy`, `threads` and `render_mode`: as for `TrackingVectorEnv`.
    """

    def __init__(
        self,
        scenario: str,
        num_envs: int = 1,
        targets: int = 10,
        metric: str = "gospa",
        labels: bool = False,
        switching: float | None = None,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        threads: int | None = None,
        render_mode: None = None,
        observe: str = "detections",
        **arguments,
    ):
        check_not_drawn(render_mode)
        check_keywords(arguments, [*settings(scenario), *keywords(type(self))])
        single = MultiTargetEnv(scenario, targets, metric, labels, switching, observe=observe, **arguments)
        super().__init__(single, num_envs, autoreset_mode, copy, threads)
        self._rule = rule_of(self.scenario.cutoff, self.scenario.order)
        n, scans, m = self.num_envs, self.scenario.horizon, self.scenario.targets
        p, d = self.scenario.sensor.H.shape
        rows = self.scenario.most
        self._episodes = Episodes(
            np.empty((n, scans, m, d)), np.empty((n, rows, p)), np.empty((n, rows), ORIGIN),
            np.zeros((n, scans + 1), int), self._t,
        )  # fmt: skip
        self._trajectories = [single.new_trajectories() for _ in range(n)]
        self._labels = [np.empty(0, int)] * n  # of the estimates submitted last

    def _checked(self, actions, passed: np.ndarray) -> np.ndarray:
        if absent(actions) is not None:
            actions = np.ma.array(actions)
            hidden = np.ma.getmaskarray(actions).any(axis=-1, keepdims=True)
            actions = np.where(hidden, 0.0, np.ma.getdata(actions))
        actions = super()._checked(actions, passed)
        existence = actions[:, :, 0]
        wrong = ~((existence >= 0) & (existence <= 1)).all(axis=1) & ~passed
        if wrong.any():
            i = int(np.argmax(wrong))
            raise ValueError(
                "existence, the first column, must lie in [0, 1], "
                f"got {existence[i].tolist()} in environment {i}"
            )
        i = first_beyond(EXTENT, passed, actions.reshape(self.num_envs, -1))
        if i >= 0:
            raise ValueError(
                f"actions must be finite and within +-{EXTENT:g} in every row, and are not in environment {i}"
            )
        if self._single.labels:
            for i in np.flatnonzero(~passed).tolist():
                counted = actions[i, :, 0] >= EXISTENCE_THRESHOLD
                self._labels[i] = labels_of(actions[i], counted, f" of environment {i}")
        return actions

    def _scored(self, actions: np.ndarray, passed: np.ndarray):
        now, scores = self._episodes, np.full((5, self.num_envs), np.nan)
        if self._rule is not None:
            given = scores, now, actions, passed, self._position, self._rule
            together(score_sets_into, [(*share, *given) for share in self._shares], self._threads)
        else:
            scores[:, passed] = 0.0
        for i in np.flatnonzero(np.isnan(scores[0])):
            at = estimates(actions[i], self._position)
            truth = targets_at(now.x[i, now.t[i]], self._position)
            scores[:, i] = set_distances(at, truth, self.scenario.cutoff, self.scenario.order)
        error = self._errors(scores, actions, passed)
        now.t[~passed] += 1
        infos = {"error": error, **dict(zip(PARTS, scores[1:4], strict=True))}
        over = ~passed & (now.t >= self.scenario.horizon)
        return infos, np.where(passed, 0.0, -error), np.zeros(self.num_envs, bool), over

    def _errors(self, scores: np.ndarray, actions: np.ndarray, passed: np.ndarray) -> np.ndarray:
        """What is charged in each environment, m, of the distances (5, n) between sets."""
        if self._single.metric != TRAJECTORY:
            return scores[COLUMN[self._single.metric]]
        grown, now = np.zeros(self.num_envs), self._episodes
        for i in np.flatnonzero(~passed):
            at = estimates(actions[i], self._position)
            truth = now.x[i, now.t[i]][:, self._position]
            grown[i] = self._trajectories[i].grown_by(at, self._labels[i], truth)
        return grown

    def _draw(self, rows: np.ndarray, seeds: Sequence[int]) -> None:
        shares = list(zip(rows.tolist(), seeds, strict=True))
        together(self._draw_one, shares, self._threads)

    def _draw_one(self, i: int, seed: int) -> None:
        x, z, origin, first = draw(self.scenario, seed)
        now, n = self._episodes, len(z)
        now.x[i], now.z[i, :n], now.origin[i, :n], now.first[i] = x, z, origin, first
        if self._single.metric == TRAJECTORY:
            self._trajectories[i] = self._single.new_trajectories()

    def _emit(self, wanted: np.ndarray) -> tuple[dict[str, Any], dict[str, Any]]:
        self._take()
        z, mask, origin = self._emitted
        now, horizon = self._episodes, self.scenario.horizon
        together(show_into, [(*share, self._emitted, now) for share in self._shares], self._threads)
        observation = {"scan": z, "mask": mask, "time": (now.t[:, None] + 1) * self.scenario.period}
        if self._single.shows_truth:
            x, present = self._targets_of(now.t < horizon)
            observation |= {"truth": x, "present": present.astype(np.int8)}
        wanted = wanted & (now.t < horizon)
        if not wanted.any():
            return observation, {}
        truth, present = self._targets_of(wanted)
        origin[~wanted] = 0
        return observation, {
            "truth": truth, "present": present, "origin": origin,
            "_truth": wanted, "_present": wanted.copy(), "_origin": wanted.copy(),
        }  # fmt: skip

    def _targets_of(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States (n, m, d) of the targets at the scans shown and whether they exist (n, m), zeros where they
        do not or are not `wanted` (n,)."""
        now, horizon = self._episodes, self.scenario.horizon
        # rows taken by one index, which is faster than by two
        at = np.arange(self.num_envs) * horizon + np.where(wanted, now.t, 0)
        truth = now.x.reshape(-1, *now.x.shape[2:]).take(at, axis=0)
        present = ~np.isnan(truth).any(axis=2) & wanted[:, None]
        truth[~present] = 0.0
        return truth, present


@kernel(nogil=True)
def score_sets_into(first, last, scores, episodes, actions, passed, position, rule):
    """Compares the estimates of the actions (n, targets, 1 + d) with the targets of the scans shown, in the
    episodes first, ..., last - 1.

    Writes to `scores` (5, n) what `distances_by` returns, and zeros where `passed` (n,).
    """
    targets, m, p = actions.shape[1], episodes.x.shape[2], len(position)
    at, truth, work = np.empty((targets, p)), np.empty((m, p)), workspace(max(targets, m))
    for i in range(first, last):
        if passed[i]:
            for part in range(len(scores)):
                scores[part, i] = 0.0
            continue
        j, k = 0, 0
        for row in range(targets):
            if actions[i, row, 0] >= EXISTENCE_THRESHOLD:
                j += take_into(at[j], actions[i, row, 1:], position)
        for target in range(m):
            k += take_into(truth[k], episodes.x[i, episodes.t[i], target], position)
        found = distances_by(at[:j], truth[:k], rule, work)
        for part in range(len(found)):
            scores[part, i] = found[part]


@leaf_kernel
def take_into(point, state, position):
    """Writes the coordinates of a state (d,) to the point (p,); returns whether all are numbers."""
    there = True
    for c in range(len(point)):
        point[c] = state[position[c]]
        there = there and not np.isnan(point[c])
    return there


@leaf_kernel
def show_into(first, last, emitted, episodes):
    """Writes the scans shown of the episodes first, ..., last - 1 to `emitted`, empty past the last scan.

    These are z (n, capacity, p), and mask and origin (n, capacity) as in observations and infos.
    """
    z, mask, origin = emitted
    for i in range(first, last):
        k, start, t = 0, 0, episodes.t[i]
        if t < episodes.x.shape[1]:
            start = episodes.first[i, t]
            k = min(episodes.first[i, t + 1] - start, z.shape[1])
        label_into(z[i], mask[i], origin[i], k, -1)
        for row in range(k):
            origin[i, row] = episodes.origin[i, start + row]
            for c in range(z.shape[2]):
                z[i, row, c] = episodes.z[i, start + row, c]
