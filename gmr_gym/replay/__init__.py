"""Episodes to watch: recorded with all that trackers report, as a page, in a notebook, as a film; and
reductions of a mixture, step by step.

Stands on everything but `experiments`. Open `recording.py` for what is kept of an episode, `page.py` for how
it is written, `reduction.py` for reductions.
"""

from gmr_gym.replay.notebook import NotebookPage, show
from gmr_gym.replay.page import page, write_page
from gmr_gym.replay.recording import Recording, record
from gmr_gym.replay.reduction import reduction_page, show_reduction

__all__ = [
    "NotebookPage", "Recording", "page", "record", "reduction_page", "show", "show_reduction", "write_page",
]  # fmt: skip
