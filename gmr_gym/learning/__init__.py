"""What an agent needs to learn to track by itself: scaled observations and actions, and a network for sets.

Stands on `envs`. Open `relative.py` first; `set_features.py` needs the extra `agents`.
"""

from gmr_gym.learning.relative import RelativeTracking, RelativeTrackingVector

__all__ = ["RelativeTracking", "RelativeTrackingVector"]
