"""Filters: from belief and scan to posterior, the recursions of the trackers.

Stands on `reduction` and `models`, and knows no simulation. Open `tracker.py` first, then `association.py`
(`joint_gating.py` where motion models share a gate); for many targets `phd.py`, `cphd.py` and `pmb.py`.
"""

from gmr_gym.filters.association import Expansion, expand
from gmr_gym.filters.registry import make_tracker, trackers
from gmr_gym.filters.trace import Trace, Tracing
from gmr_gym.filters.tracker import MultiTargetReport, MultiTargetTracker, Report, Tracker, check_scan

__all__ = [
    "Expansion", "MultiTargetReport", "MultiTargetTracker", "Report", "Trace", "Tracing", "Tracker",
    "check_scan", "expand", "make_tracker", "trackers",
]  # fmt: skip
