"""Target tracking in clutter by Gaussian mixture reduction: environments, trackers, reproduced papers.

Importing it registers the environments; trackers and Monte Carlo runs work without them. The names here are
imported when they are first used, because numba, which all of them need, is slow to import.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gmr_gym.envs.registry import register_envs
from gmr_gym.version import __version__

if TYPE_CHECKING:
    from gmr_gym.envs.policy import MultiTargetPolicy, Policy
    from gmr_gym.filters.registry import make_tracker, trackers
    from gmr_gym.filters.tracker import Report, Tracker
    from gmr_gym.mixture import Mixture
    from gmr_gym.models.model import Model, model
    from gmr_gym.replay.notebook import show

__all__ = [
    "Mixture",
    "Model",
    "MultiTargetPolicy",
    "Policy",
    "Report",
    "Tracker",
    "__version__",
    "make_tracker",
    "model",
    "register_envs",
    "show",
    "trackers",
]  # fmt: skip
_HOME = {
    "mixture": ("Mixture",),
    "models.model": ("Model", "model"),
    "envs.policy": ("MultiTargetPolicy", "Policy"),
    "filters.registry": ("make_tracker", "trackers"),
    "filters.tracker": ("Report", "Tracker"),
    "replay.notebook": ("show",),
}

register_envs()


def __getattr__(name: str) -> Any:
    if name == "CrowdPolicy":
        from gmr_gym.deprecated import warn_renamed

        warn_renamed("CrowdPolicy", "MultiTargetPolicy")
        name = "MultiTargetPolicy"
    for module, names in _HOME.items():
        if name in names:
            return getattr(import_module(f"gmr_gym.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
