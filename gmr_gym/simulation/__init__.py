"""How any world is drawn: truth, detections and clutter of one target or many, each scan from its seed.

Stands on `models`, and knows no filter. Open `single_target.py` first, then `scans.py`.
"""

from gmr_gym.simulation.multi_target import Crowd, ManyScenario
from gmr_gym.simulation.single_target import Episode, Scan, Scenario, Window, draw, scan

__all__ = ["Crowd", "Episode", "ManyScenario", "Scan", "Scenario", "Window", "draw", "scan"]
