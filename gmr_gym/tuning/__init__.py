"""Thresholds of a tracker as actions: what a policy observes, sets and is rewarded for, scan by scan.

Stands on `evaluation` and all below, without Gymnasium. Open `thresholds.py` first, then `features.py`.
"""

from gmr_gym.tuning.features import FEATURES
from gmr_gym.tuning.instances import Instance
from gmr_gym.tuning.thresholds import Thresholds

__all__ = ["FEATURES", "Instance", "Thresholds"]
