"""Mixture reduction: each reduction takes a mixture and returns a smaller one with the origin of its
components.

Depends on `mixture` and `linalg` alone. Open `runnalls.py` first; `registry.py` lists every reduction by
name.
"""

from gmr_gym.reduction.ise import integral_squared_error
from gmr_gym.reduction.protocol import Reduced, check_reduced
from gmr_gym.reduction.pruning import capping, prune, prune_and_cap, prune_density
from gmr_gym.reduction.registry import REDUCERS, reducer
from gmr_gym.reduction.runnalls import adaptive, runnalls, total_merge_cost
from gmr_gym.reduction.salmond_west import salmond, west

__all__ = [
    "REDUCERS", "Reduced", "adaptive", "capping", "check_reduced", "integral_squared_error", "prune",
    "prune_and_cap", "prune_density", "reducer", "runnalls", "salmond", "total_merge_cost", "west",
]  # fmt: skip
