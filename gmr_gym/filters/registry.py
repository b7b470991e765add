"""Trackers found by name, through entry points."""

import inspect
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from gmr_gym.deprecated import warn_renamed
from gmr_gym.models.model import Model, with_radar_update
from gmr_gym.models.multi_target import MultiTargetModel

GROUP, MULTI_TARGET_GROUP = "gmr_gym.trackers", "gmr_gym.multi_target_trackers"
FORMER_GROUP = "gmr_gym.crowd_trackers"  # of MULTI_TARGET_GROUP
FORMER_PARAMETERS = {  # each with the names it may have now
    "hopeless": ("give_up_ratio",),
    "most": ("max_hypotheses", "max_gaussians"),
    "naming": ("report_threshold",),
}


def trackers(group: str = GROUP) -> dict[str, str]:
    """Names of the installed trackers, of one target or, with `MULTI_TARGET_GROUP`, of many, each with the
    first paragraph of its description."""
    found = {}
    for name, point in sorted(_entry_points(group).items()):
        doc = inspect.getdoc(point.load()) or ""
        found[name] = " ".join(doc.split("\n\n")[0].split())
    return found


def make_tracker(name: str, model: Model | MultiTargetModel, **parameters) -> Any:
    """The tracker of that name for a filter model: a Tracker, or for a MultiTargetModel a MultiTargetTracker.
    A number at the end of the name is its number of components: `runnalls-30` is `runnalls` with
    components=30. Every tracker of one target takes an `update`, another update of its radar, one of
    `gmr_gym.models.radar.UPDATES`.

    Raises ValueError for a name that no installed package offers, with the nearest that one does,
    and for a parameter the tracker does not take, with those it does.
    """
    known = _entry_points(MULTI_TARGET_GROUP if isinstance(model, MultiTargetModel) else GROUP)
    base, _, number = name.rpartition("-")
    other_components = None
    if name not in known and base in known and number.isdigit():
        other_components = parameters.get("components")
        name, parameters = base, {**parameters, "components": int(number)}
    multi_target = isinstance(model, MultiTargetModel)
    if (
        name not in known
        and {name, base} & _entry_points(GROUP if multi_target else MULTI_TARGET_GROUP).keys()
    ):
        kind = (
            "one target, and here there are many" if multi_target else "many targets, and here there is one"
        )
        raise ValueError(f"tracker {name!r} is for {kind}")
    if name not in known:
        near = get_close_matches(name.rstrip("-0123456789"), known, n=1) or get_close_matches(name, known)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(f"unknown tracker {name!r}{hint} (installed: {', '.join(sorted(known))})")
    factory = known[name].load()
    accepted = list(inspect.signature(factory).parameters)[1:]
    update = parameters.pop("update", None)
    if update is not None:
        if isinstance(model, MultiTargetModel):
            raise ValueError(f"tracker {name!r} of many targets takes no 'update'")
        model = with_radar_update(model, update)
    for former, candidates in FORMER_PARAMETERS.items():
        new = next((name for name in candidates if name in accepted), None)
        if former in parameters and former not in accepted and new is not None:
            warn_renamed(f"parameter {former!r}", repr(new))
            parameters[new] = parameters.pop(former)
    for parameter in parameters:
        if parameter not in accepted:
            raise ValueError(
                f"tracker {name!r} takes no parameter {parameter!r}; it takes {', '.join(accepted) or 'none'}"
            )
    if other_components is not None:
        raise ValueError(f"components is given twice, as {number} in the name and as {other_components!r}")
    try:
        tracker = factory(model, **parameters)
    except TypeError as error:  # text where a number belongs
        raise ValueError(f"tracker {name!r} cannot be made with {parameters}: {error}") from None
    if update is not None and getattr(tracker.model.sensor, "update", None) != update:
        raise ValueError(f"tracker {name!r} has an update of its own and takes no {update!r}")
    return tracker


def _entry_points(group: str) -> dict[str, EntryPoint]:
    known = {point.name: point for point in entry_points(group=group)}
    if group == MULTI_TARGET_GROUP:
        for point in entry_points(group=FORMER_GROUP):
            warn_renamed(f"entry-point group {FORMER_GROUP!r} of {point.value}", repr(group))
            known.setdefault(point.name, point)
    return known
