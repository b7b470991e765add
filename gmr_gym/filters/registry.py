"""Trackers found by name, through entry points."""

import inspect
from difflib import get_close_matches
from typing import Any

from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, described, tracker_entry_points
from gmr_gym.deprecated import warn_renamed
from gmr_gym.models.model import Model, with_radar_update
from gmr_gym.models.multi_target import MultiTargetModel

FORMER_PARAMETERS = {"hopeless": "give_up_ratio", "most": "max_hypotheses", "naming": "report_threshold"}


def trackers(group: str = GROUP) -> dict[str, str]:
    """Names of the installed trackers, of one target or, with `MULTI_TARGET_GROUP`, of many, each with the
    first paragraph of its description."""
    return described(group)


def make_tracker(name: str, model: Model | MultiTargetModel, **parameters) -> Any:
    """The tracker of that name for a filter model: a Tracker, or for a MultiTargetModel a MultiTargetTracker.
    A number at the end of the name is its number of components: `runnalls-30` is `runnalls` with
    components=30. Every tracker of one target takes an `update`, another update of its radar, one of
    `gmr_gym.models.radar.UPDATES`.

    Raises ValueError for a name that no installed package offers, with the nearest that one does,
    and for a parameter the tracker does not take, with those it does.
    """
    known = tracker_entry_points(MULTI_TARGET_GROUP if isinstance(model, MultiTargetModel) else GROUP)
    base, _, number = name.rpartition("-")
    twice = None
    if name not in known and base in known and number.isdigit():
        twice = parameters.get("components")
        name, parameters = base, {**parameters, "components": int(number)}
    many = isinstance(model, MultiTargetModel)
    if (
        name not in known
        and {name, base} & tracker_entry_points(GROUP if many else MULTI_TARGET_GROUP).keys()
    ):
        kind = "one target, and here there are many" if many else "many targets, and here there is one"
        raise ValueError(f"tracker {name!r} is for {kind}")
    if name not in known:
        near = get_close_matches(name.rstrip("-0123456789"), known, n=1) or get_close_matches(name, known)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"unknown tracker {name!r}{hint} (installed: {', '.join(sorted(known))})")
    factory = known[name].load()
    takes = list(inspect.signature(factory).parameters)[1:]
    update = parameters.pop("update", None)
    if update is not None:
        if isinstance(model, MultiTargetModel):
            raise ValueError(f"tracker {name!r} of many targets takes no 'update'")
        model = with_radar_update(model, update)
    for former, new in FORMER_PARAMETERS.items():
        if former in parameters and former not in takes and new in takes:
            warn_renamed(f"parameter {former!r}", repr(new))
            parameters[new] = parameters.pop(former)
    for parameter in parameters:
        if parameter not in takes:
            raise ValueError(
                f"tracker {name!r} takes no parameter {parameter!r}; it takes {', '.join(takes) or 'none'}"
            )
    if twice is not None:
        raise ValueError(f"components is given twice, as {number} in the name and as {twice!r}")
    try:
        tracker = factory(model, **parameters)
    except TypeError as error:  # text where a number belongs
        raise ValueError(f"tracker {name!r} cannot be made with {parameters}: {error}") from None
    if update is not None and getattr(tracker.model.sensor, "update", None) != update:
        raise ValueError(f"tracker {name!r} has an update of its own and takes no {update!r}")
    return tracker
