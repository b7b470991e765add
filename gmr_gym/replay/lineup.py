"""The trackers that are shown side by side: by name or themselves, each fit for the scenario."""

from collections.abc import Iterable, Mapping
from typing import Any

from gmr_gym.checks import check_whole
from gmr_gym.envs.lookup import tracker_of
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario

MOST_TRACKERS = 4  # that are shown side by side


def trackers_of(
    given: Iterable[Any], scenario: Scenario | MultiTargetScenario, environment: str = ""
) -> dict[str, Any]:
    """Trackers by the names that they are shown under.

    Parameters
    ----------
    given : iterable of str, Tracker or MultiTargetTracker
        NAME or NAME:key=value,key=value of a tracker, or a tracker, which is named after its class.
    scenario : Scenario or MultiTargetScenario
    environment : str
        Its name in messages.

    Returns
    -------
    dict of str to Tracker or MultiTargetTracker

    Raises
    ------
    ValueError
        For one that cannot be made for the scenario, and for the same twice.
    """
    trackers: dict[str, Any] = {}
    for each in given:
        name, tracker = each, each
        if isinstance(each, str):
            name = each.removesuffix(":")
            try:
                tracker = tracker_of(name, scenario)
            except ValueError as error:
                raise ValueError(f"{name!r} cannot run in {environment or 'the scenario'}: {error}") from None
        else:
            name = type(each).__name__
            number = 1 + sum(type(other) is type(each) for other in trackers.values())
            name += f" {number}" if number > 1 else ""
        if name in trackers or any(tracker is other for other in trackers.values()):
            raise ValueError(f"tracker {name!r} is given twice")
        trackers[name] = tracker
    return trackers


def check_shown(
    trackers: Mapping[str, Any], seed: int, scenario: Scenario | MultiTargetScenario, environment: str = ""
) -> None:
    """ValueError for another number of trackers than from 1 to `MOST_TRACKERS`, for one that does not fit the
    scenario, and for what is no seed."""
    if not 1 <= len(trackers) <= MOST_TRACKERS:
        raise ValueError(f"trackers must be from 1 to {MOST_TRACKERS}, got {len(trackers)}")
    check_whole("seed", seed, 0)
    for name, tracker in trackers.items():
        check_fits(name, tracker, scenario, environment)


def scans_shown(there: int, scans: int | None) -> int:
    """How many scans are shown of those that there are: the first, or all; ValueError for another number."""
    if scans is not None and scans not in range(1, there + 1):
        raise ValueError(f"scans must be from 1 to the {there} of the episode, got {scans}")
    return there if scans is None else int(scans)


def check_fits(
    name: str, tracker: Any, scenario: Scenario | MultiTargetScenario, environment: str = ""
) -> None:
    """Check that a tracker can run in a scenario.

    Parameters
    ----------
    name : str
        Of the tracker, in messages.
    tracker : Tracker or MultiTargetTracker
    scenario : Scenario or MultiTargetScenario
    environment : str
        Its name in messages.

    Raises
    ------
    ValueError
        For what is no tracker, and for one of another kind of scenario or sensor.
    """
    where, many = environment or "the scenario", isinstance(scenario, MultiTargetScenario)
    if isinstance(tracker, type) or not all(hasattr(tracker, part) for part in ("model", "init", "step")):
        raise ValueError(f"{name!r} is no tracker: it must have model, init and step")
    if isinstance(tracker.model, MultiTargetModel) != many:
        kinds = "one target", "many targets"
        raise ValueError(f"{name!r} is for {kinds[not many]}, {where} has {kinds[many]}")
    own, wanted = len(tracker.model.sensor.H), len(scenario.model.sensor.H)
    if own != wanted:
        raise ValueError(f"{name!r} takes detections of {own} coordinates, those of {where} have {wanted}")
