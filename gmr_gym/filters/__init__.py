"""Belief and scan to posterior: the recursions that trackers are made of.

Stands on `reduction` and `models`, and knows no simulated world. Open `tracker.py` first, then
`association.py`.
"""

from gmr_gym.filters.association import Expansion, expand
from gmr_gym.filters.registry import make_tracker, trackers
from gmr_gym.filters.tracker import MultiTargetReport, MultiTargetTracker, Report, Tracker, check_scan

__all__ = [
    "Expansion", "MultiTargetReport", "MultiTargetTracker", "Report", "Tracker", "check_scan", "expand",
    "make_tracker", "trackers",
]  # fmt: skip
