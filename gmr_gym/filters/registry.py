"""Trackers found by name through entry points."""

import inspect
from collections.abc import Callable
from difflib import get_close_matches
from typing import Any

from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, described, tracker_entry_points
from gmr_gym.deprecated import warn_renamed
from gmr_gym.models.assumptions import PREFIX, with_assumptions
from gmr_gym.models.model import Model, with_radar_update
from gmr_gym.models.multi_target import MultiTargetModel

FORMER_PARAMETERS = {  # each with its possible new names
    "hopeless": ("give_up_ratio",),
    "most": ("max_hypotheses", "max_gaussians"),
    "naming": ("report_threshold",),
}


def trackers(group: str = GROUP) -> dict[str, str]:
    """Names and descriptions of the installed trackers.

    Parameters
    ----------
    group : str
        Entry-point group: `GROUP` of single-target trackers, or `MULTI_TARGET_GROUP`.

    Returns
    -------
    dict of str to str
        First paragraph of each tracker's description by its name, sorted.

    Examples
    --------
    >>> "runnalls" in trackers(), "gm-phd" in trackers(MULTI_TARGET_GROUP)
    (True, True)
    """
    return described(group)


def make_tracker(name: str, model: Model | MultiTargetModel, **parameters) -> Any:
    """Make the tracker of a name for a filter model.

    Parameters
    ----------
    name : str
        Name of an installed tracker, see `trackers`. A number at its end is the number of components:
        `runnalls-30` is `runnalls` with components=30.
    model : Model or MultiTargetModel
        The filter model.
    **parameters
        Parameters of the tracker. Every single-target tracker also takes `update`, one of
        `gmr_gym.models.radar.UPDATES`: the update of its radar; and every tracker what
        `gmr_gym.models.assumptions.with_assumptions` does, such as `assumed_process_noise`.

    Returns
    -------
    Tracker or MultiTargetTracker
        The latter for a MultiTargetModel.

    Raises
    ------
    ValueError
        For an unknown name, with the nearest known one; for one that cannot be loaded; for a parameter that
        the tracker does not take, with those it does; and for a value out of range.

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.mixture import gaussian
    >>> from gmr_gym.models import constant_velocity, model, position_sensor
    >>> prior = gaussian(np.zeros(4), np.diag([100.0, 100.0, 25.0, 25.0]))
    >>> assumed = model(constant_velocity(1.0, 0.5), position_sensor(10.0), 0.9, 0.99, 1e-5, prior)
    >>> make_tracker("runnalls-5", assumed).reduce.components
    5
    >>> make_tracker("runnals", assumed)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    ValueError: unknown tracker 'runnals'; did you mean 'runnalls'? (installed: ...)
    """
    return tracker_maker(name, isinstance(model, MultiTargetModel), **parameters)(model)


def tracker_maker(name: str, multi_target: bool, /, **parameters) -> Callable[[Any], Any]:
    """`make_tracker` for many filter models: the tracker is looked up once.

    Parameters
    ----------
    name : str
    multi_target : bool
        Whether the models are of many targets.
    **parameters
        As of `make_tracker`.

    Returns
    -------
    callable
        Of a filter model, returns its tracker; raises ValueError for a value out of range.

    Raises
    ------
    ValueError
        As `make_tracker`, for what does not depend on the model.
    """
    own, other = (MULTI_TARGET_GROUP, GROUP) if multi_target else (GROUP, MULTI_TARGET_GROUP)
    known = tracker_entry_points(own)
    base, _, number = name.rpartition("-")
    other_components = None
    if name not in known and base in known and number.isdigit():
        other_components = parameters.get("components")
        name, parameters = base, {**parameters, "components": int(number)}
    if name not in known and {name, base} & tracker_entry_points(other).keys():
        kind = "one target, the model for many" if multi_target else "many targets, the model for one"
        raise ValueError(f"tracker {name!r} is for {kind}")
    if name not in known:
        near = get_close_matches(name.rstrip("-0123456789"), known, n=1) or get_close_matches(name, known)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"unknown tracker {name!r}{hint} (installed: {', '.join(sorted(known))})")
    try:
        factory = known[name].load()
    except (ImportError, AttributeError) as error:
        raise ValueError(f"tracker {name!r} cannot be loaded from {known[name].value}: {error}") from error
    accepted = list(inspect.signature(factory).parameters)[1:]
    assumed = {key: parameters.pop(key) for key in [*parameters] if key.startswith(PREFIX)}
    update = parameters.pop("update", None)
    if update is not None and multi_target:
        raise ValueError(f"multi-target tracker {name!r} takes no 'update'")
    for former, candidates in FORMER_PARAMETERS.items():
        new = next((candidate for candidate in candidates if candidate in accepted), None)
        if former in parameters and former not in accepted and new is not None:
            if new in parameters:
                raise ValueError(f"{new} is given twice, once by its former name {former!r}")
            warn_renamed(f"parameter {former!r}", repr(new))
            parameters[new] = parameters.pop(former)
    for parameter in parameters:
        if parameter not in accepted:
            raise ValueError(
                f"tracker {name!r} takes no parameter {parameter!r}; it takes {', '.join(accepted) or 'none'}"
            )
    if other_components is not None:
        raise ValueError(f"components is given twice, as {number} in the name and as {other_components!r}")

    def make(model: Any) -> Any:
        if update is not None:
            model = with_radar_update(model, update)
        if assumed:
            model = with_assumptions(model, assumed)
        try:
            tracker = factory(model, **parameters)
        except TypeError as error:  # for example a string for a number
            raise ValueError(f"tracker {name!r} cannot be made with {parameters}: {error}") from None
        if update is not None and getattr(tracker.model.sensor, "update", None) != update:
            raise ValueError(f"tracker {name!r} has an update of its own and takes no {update!r}")
        return tracker

    return make
