"""Policies that remember the scans before, played as the judge plays others."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from export import normalisation


@dataclass(frozen=True)
class Remembering:
    """The deterministic policy of a recurrent model, and how what it sees is normalised."""

    policy: Any  # of stable-baselines3, with `predict`
    mean: np.ndarray  # (k,)
    deviation: np.ndarray  # (k,)
    reach: float  # deviations

    def watching(self, env: Any):
        """The policy proper for episodes one after another; it forgets at scan 0."""
        state = None

        def act(observation: np.ndarray, t: int) -> np.ndarray:
            nonlocal state
            seen = np.clip((observation - self.mean) / self.deviation, -self.reach, self.reach)
            action, state = self.policy.predict(
                seen.astype(np.float32), state, episode_start=np.array([t == 0]), deterministic=True
            )
            return action

        return act


def remembering(model: Any, venv: Any) -> Remembering:
    """The policy of a recurrent model, with the moments by which `venv` normalises what it sees."""
    return Remembering(model.policy, *normalisation(venv))
