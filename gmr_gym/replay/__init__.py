"""Episodes to watch: recorded with all that trackers report, as a page, in a notebook, as a film.

Stands on everything but `experiments`. Open `recording.py` for what is kept of an episode, `page.py` for how
it is written.
"""

from gmr_gym.replay.notebook import NotebookPage, show
from gmr_gym.replay.page import page, write_page
from gmr_gym.replay.recording import Recording, record

__all__ = ["NotebookPage", "Recording", "page", "record", "show", "write_page"]
