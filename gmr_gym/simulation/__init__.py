"""How scenarios are drawn: the truth, the detections and the clutter of one target or many, from a seed.

Stands on `models` and knows no filter. Open `single_target.py` first, then `scans.py`.
"""

from gmr_gym.simulation.multi_target import MultiTargetEpisode, MultiTargetScenario, RecordedScenario
from gmr_gym.simulation.single_target import Episode, Scan, Scenario, Window, draw, scan

__all__ = [
    "Episode",
    "MultiTargetEpisode",
    "MultiTargetScenario",
    "RecordedScenario",
    "Scan",
    "Scenario",
    "Window",
    "draw",
    "scan",
]
