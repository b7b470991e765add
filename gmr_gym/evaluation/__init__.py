"""Running trackers through episodes: the loop, Monte Carlo runs on any number of workers, metrics, summaries.

Stands on `filters` and `simulation`, which meet here for the first time. Open `loop.py` first, then
`montecarlo.py`.
"""

from gmr_gym.evaluation.loop import Played, play
from gmr_gym.evaluation.montecarlo import Runs, run, run_once
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns

__all__ = ["MultiTargetRuns", "Played", "Runs", "play", "run", "run_once"]
