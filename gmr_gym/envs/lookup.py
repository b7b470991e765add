"""Scenarios and trackers by what a user types."""

from collections.abc import Mapping
from difflib import get_close_matches
from importlib import import_module
from typing import Any

import gymnasium as gym

from gmr_gym.envs.episodic import make_scenario
from gmr_gym.envs.registry import ENVIRONMENTS, TRACKED
from gmr_gym.filters.registry import make_tracker
from gmr_gym.literals import key_values
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario


def scenario_of(env_id: str, settings: Mapping[str, Any]) -> Any:
    """The scenario of an environment.

    Parameters
    ----------
    env_id : str
        An id that is registered, or MODULE:ID, which imports MODULE.
    settings : mapping of str to object
        Keyword arguments of the scenario.

    Returns
    -------
    Scenario or MultiTargetScenario

    Raises
    ------
    ValueError
        For an unknown id, with the nearest known one; for an environment without a scenario; and for
        settings as `gmr_gym.envs.episodic.make_scenario`.

    Examples
    --------
    >>> from gmr_gym.envs.lookup import scenario_of
    >>> scenario_of("gmr_gym/TurningTarget-v0", {"horizon": 5}).horizon
    5
    """
    kept = spec_of(env_id).kwargs.get("scenario")
    # of the settings only what the scenario of the id takes: no value names code to be imported
    scenario = make_scenario(kept, settings) if kept else None
    if not isinstance(scenario, Scenario | MultiTargetScenario):
        raise ValueError(
            f"{env_id} is not a tracking environment: no tracker runs in it; choose from {', '.join(TRACKED)}"
        )
    return scenario


def spec_of(env_id: str) -> gym.envs.registration.EnvSpec:
    """What is registered under an id.

    Parameters
    ----------
    env_id : str
        An id that is registered, or MODULE:ID, which imports MODULE.

    Returns
    -------
    gymnasium.envs.registration.EnvSpec

    Raises
    ------
    ValueError
        For an unknown id, with the nearest known one.
    """
    module, _, known_as = env_id.rpartition(":")
    bare = {name.partition("/")[2]: name for name in ENVIRONMENTS}
    near = get_close_matches(env_id.partition("/")[2] or env_id, bare, n=1)
    if not module and env_id not in gym.registry and near:
        raise ValueError(f"unknown environment {env_id!r}; did you mean {bare[near[0]]!r}?")
    if module:
        import_module(module)  # `gym.make` does so, and not `gym.spec`
    elif known_as not in gym.registry:
        raise ValueError(
            f"unknown environment {env_id!r}; choose from {', '.join(TRACKED)}, or give "
            "one of your own as MODULE:ID"
        )
    return gym.spec(known_as)


def parsed(spec: str) -> tuple[str, dict[str, Any]]:
    """A tracker's name and parameters from NAME:key=value,key=value."""
    name, _, parameters = spec.partition(":")
    return name, key_values(filter(None, parameters.split(",")))


def tracker_of(spec: str, scenario: Scenario | MultiTargetScenario, **parameters: Any) -> Any:
    """The tracker NAME:key=value,key=value, with further parameters, for the scenario's filter model."""
    name, further = parsed(spec)
    return make_tracker(name, scenario.model, **parameters, **further)
