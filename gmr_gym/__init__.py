"""Target tracking in clutter, as something to measure, reproduce and learn on.

Importing registers the environments; trackers and the Monte Carlo harness work without one.
"""

from gmr_gym.envs import register_envs
from gmr_gym.mixture import Mixture
from gmr_gym.model import Model, model
from gmr_gym.policy import CrowdPolicy, Policy
from gmr_gym.tracker import Report, Tracker, make_tracker, trackers
from gmr_gym.version import __version__

__all__ = [
    "CrowdPolicy", "Mixture", "Model", "Policy", "Report", "Tracker", "__version__",
    "make_tracker", "model", "register_envs", "trackers",
]  # fmt: skip

register_envs()
