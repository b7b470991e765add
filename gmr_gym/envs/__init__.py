"""Gymnasium environments: observations are scans or features, actions are estimates or thresholds.

Stands on everything but `experiments`. Open `registry.py` for the ids, `tracking.py` for what one does.
"""

from gmr_gym.envs.registry import ENVIRONMENTS, MULTI_TARGET, RECORDED, TRACKING, TUNING, register_envs

__all__ = ["ENVIRONMENTS", "MULTI_TARGET", "RECORDED", "TRACKING", "TUNING", "register_envs"]
