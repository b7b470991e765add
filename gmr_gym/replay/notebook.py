"""An episode shown in a notebook."""

from html import escape
from pathlib import Path
from typing import Any

from gmr_gym.envs.lookup import scenario_of
from gmr_gym.evaluation.writing import whole
from gmr_gym.replay.lineup import trackers_of
from gmr_gym.replay.page import page
from gmr_gym.replay.recording import record
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario

HEIGHT = 760  # pixels


class NotebookPage:
    """An episode's page, as the value of a notebook's cell.

    Attributes
    ----------
    page : str
        HTML.
    """

    def __init__(self, page: str):
        self.page = page

    def _repr_html_(self) -> str:
        """The page in a frame of its own, which may run its script and nothing else."""
        return (
            f'<iframe srcdoc="{escape(self.page)}" sandbox="allow-scripts" '
            f'style="width: 100%; height: {HEIGHT}px; border: 0"></iframe>'
        )

    def save(self, path: Path | str) -> None:
        """Write the page to a file, whole or not at all; OSError naming the file where that fails."""
        with whole(path) as partial:
            partial.write_text(self.page, encoding="utf-8")


def show(
    environment: str | Scenario | MultiTargetScenario, *trackers: Any, seed: int = 0, scans: int | None = None
) -> NotebookPage:
    """Run trackers through an episode, and show it in a notebook.

    Parameters
    ----------
    environment : str, Scenario or MultiTargetScenario
        Id of an environment, or a scenario.
    *trackers : str, Tracker or MultiTargetTracker
        From 1 to 4; by name "NAME" or "NAME:key=value,key=value", or themselves.
    seed : int
        Of the episode.
    scans : int, optional
        The first scans of the episode; all by default.

    Returns
    -------
    NotebookPage
        A notebook shows it as a player; `save` writes the same page to a file.

    Raises
    ------
    ValueError
        For an unknown environment or tracker, a tracker that does not fit or is given twice, and as
        `gmr_gym.replay.record`.

    Examples
    --------
    >>> import gmr_gym
    >>> shown = gmr_gym.show("gmr_gym/TurningTarget-v0", "pda", "nearest-neighbour", seed=1, scans=3)
    >>> "pda, nearest-neighbour: gmr_gym/TurningTarget-v0 seed 1" in shown.page
    True
    """
    name, scenario = "", environment
    if isinstance(environment, str):
        name, scenario = environment, scenario_of(environment, {})
    if not isinstance(scenario, Scenario | MultiTargetScenario):
        raise ValueError(f"environment must be an id or a scenario, got {environment!r:.60}")
    return NotebookPage(
        page(record(scenario, trackers_of(trackers, scenario, name), seed, scans, environment=name))
    )
