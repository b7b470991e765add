"""What a tracker is, what it says of a scan, and how trackers are found by name."""

import inspect
from difflib import get_close_matches
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple, Protocol

import numpy as np

from gmr_gym.association import Gates
from gmr_gym.mixture import Mixture
from gmr_gym.models import Model, told_by
from gmr_gym.multitarget import Population
from gmr_gym.points import check_points

GROUP, CROWD_GROUP = "gmr_gym.trackers", "gmr_gym.crowd_trackers"
ALL = 10**9  # hypotheses, for what costs no more than they are many
SURE = np.ones(1)  # of the one motion there is
SURE.setflags(write=False)


class Report(NamedTuple):
    """What a tracker says of one scan."""

    x: np.ndarray  # (j, d), estimates: one for a single-target tracker
    P: np.ndarray  # (j, d, d), the covariances it claims for them
    gates: Gates  # where it looked for the target's detection; of a radar, a yardstick in space
    mixture: Mixture  # the hypotheses it kept
    alive: bool = True  # False when it has given the target up, and only coasts
    modes: np.ndarray = SURE  # (r,), probability of each of the model's motions


class Tracker(Protocol):
    """A frozen dataclass of parameters. The belief is its private affair: it goes in and comes
    out, and nothing is remembered in between."""

    @property
    def model(self) -> Model:
        """What it was told."""

    def init(self) -> Any:
        """The belief one period before the first scan."""

    def step(self, belief: Any, z: np.ndarray) -> tuple[Any, Report]:
        """The belief after the scan z (k, p) one period later, and the report on that scan."""


def trackers(group: str = GROUP) -> dict[str, str]:
    """Names of the installed trackers, of one target or, with `CROWD_GROUP`, of many, each with the first
    paragraph of its description."""
    found = {}
    for name, point in sorted(_entry_points(group).items()):
        doc = inspect.getdoc(point.load()) or ""
        found[name] = " ".join(doc.split("\n\n")[0].split())
    return found


def make_tracker(name: str, model: Model | Population, **parameters) -> Any:
    """The tracker of that name, told `model`: a Tracker, or told a Population a ManyTracker. A number at
    the end of the name is its number of components: `runnalls-30` is `runnalls` with components=30. Every
    tracker of one target takes an `update`, by which it is told another update of its radar, one of
    `gmr_gym.radar.UPDATES`.

    Raises ValueError for a name that no installed package offers, with the nearest that one does,
    and for a parameter the tracker does not take, with those it does.
    """
    known = _entry_points(CROWD_GROUP if isinstance(model, Population) else GROUP)
    base, _, number = name.rpartition("-")
    twice = None
    if name not in known and base in known and number.isdigit():
        twice = parameters.get("components")
        name, parameters = base, {**parameters, "components": int(number)}
    many = isinstance(model, Population)
    if name not in known and {name, base} & _entry_points(GROUP if many else CROWD_GROUP).keys():
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
        if isinstance(model, Population):
            raise ValueError(f"tracker {name!r} of many targets takes no 'update'")
        model = told_by(model, update)
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


def check_scan(z, p: int) -> np.ndarray:
    """The detections as floats (k, p), (0, p) for an empty scan, without those masked; ValueError as in
    `points.check_points`: so no scan that a tracker takes holds a coordinate beyond +-1e10."""
    return check_points(z, p)


def check_limits(prune_weight: float, most: int, hopeless: float = np.inf) -> None:
    """Raise ValueError naming the limit of a tracker's work that is none."""
    if not 0 <= prune_weight < np.inf:
        raise ValueError(f"prune_weight must be non-negative and finite, got {prune_weight}")
    if not most >= 1 or most % 1 != 0:
        raise ValueError(f"most must be a whole number, at least 1, got {most}")
    if not hopeless > 0:
        raise ValueError(f"hopeless must be positive, got {hopeless}")


def _entry_points(group: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=group)}
