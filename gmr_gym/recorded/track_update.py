"""A scan, or a report of one target, through the engine: tracks updated, started, ended, and written down."""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters import bernoulli_tracks as engine
from gmr_gym.filters.bernoulli_tracks import Associated, Origins
from gmr_gym.filters.imm_tracks import Banks, carried
from gmr_gym.models.gating import gate_threshold
from gmr_gym.models.intervals import Modes
from gmr_gym.models.positions import Look
from gmr_gym.recorded.array_records import chosen, joined
from gmr_gym.recorded.model import TrackingModel
from gmr_gym.recorded.origins import densities, learned, undetected_until
from gmr_gym.recorded.track_following import followed
from gmr_gym.recorded.track_leaves import Leaves
from gmr_gym.recorded.track_rules import Rules, follow, passes, rules, started
from gmr_gym.recorded.track_state import State, Targets
from gmr_gym.recorded.tracks import DELETED, TENTATIVE, Tracks

Azimuths = tuple[float, float] | None  # rad, from and to; None for all directions
LEAST_DENSITY = 1e-300  # of clutter and new targets where there are none: a detection needs an explanation
NO_OTHER = np.log([LEAST_DENSITY])


class Assumed(NamedTuple):
    """A model, and what kernels take of it."""

    model: TrackingModel
    kernels: tuple[Modes, Rules, float]  # motion models, rules of tracks, survival probability of a second
    gates: np.ndarray  # (2,) largest squared distances without and with range rate


class Seen(NamedTuple):
    """What a row says of each of n tracks beside what is kept of it."""

    x: np.ndarray  # (n, 2 p) position and velocity
    P: np.ndarray  # (n, 2 p, 2 p)
    gated: np.ndarray  # (n,) int, number of detections in the gate
    best: np.ndarray  # (n,) int, the one of most weight, or -1
    weight: np.ndarray  # (n,)
    nis: np.ndarray  # (n,)


def assumed(model: TrackingModel) -> Assumed:
    """The model for kernels."""
    gates = [gate_threshold(model.gate_probability, p) for p in (model.axes, model.axes + 1)]
    return Assumed(model, (model.bank(), rules(model), model.survival_probability), np.array(gates))


def scan(
    state: State, of: Assumed, look: Look, sensor: int, identity: np.ndarray, azimuths: Azimuths = None
) -> tuple[State, Tracks]:
    """State and rows after a scan; identity (k,) of each detection, -1 for none."""
    model, spec = of.model, of.model.sensors[sensor]
    undetected = undetected_until(look.time, state, model)
    clutter, new = densities(look, state, model, sensor, undetected)
    other = np.maximum(clutter + new, LEAST_DENSITY)
    taken = (identity >= 0) & np.isin(identity, state.targets.identity)
    origins = Origins(spec.detection_probability, np.log(other), identity, taken, of.gates)
    targets = chosen(state.targets, np.arange(len(state.targets.existence)))
    x, P, found, leaves = _followed(targets, state.leaves, of, look, origins, sensor, azimuths)
    _adopt(targets, found, identity, taken)
    swept = 1.0 if azimuths is None else min(abs(azimuths[1] - azimuths[0]) / (2 * np.pi), 1.0)
    state = state._replace(
        time=look.time,
        leaves=leaves,
        undetected=undetected * (1.0 - spec.detection_probability * swept),
        clutter=learned(look, state, model, sensor, found.unassigned * clutter / other),
    )
    rows = _beginning(targets, of, look, identity, found.unassigned * new / other)
    begun, first = _begun(of, look, sensor, rows, identity, (found.unassigned * new / other)[rows])
    targets, seen = joined(targets, begun), joined(Seen(x, P, *found[2:]), first)
    _thin(targets, of, seen)
    unseen = (targets.lives.status == DELETED) & (targets.lives.label == 0)
    if unseen.any():
        targets, seen = chosen(targets, ~unseen), chosen(seen, ~unseen)
    return completed(state, targets, seen, np.arange(len(targets.existence)))


def report(state: State, of: Assumed, look: Look, sensor: int, identity: int) -> tuple[State, Tracks]:
    """State and rows after one detection of a target that names itself; only its own track is touched, in
    place."""
    targets, state = state.targets, state._replace(time=look.time)
    silent = look.time - targets.lives.hit_time > of.model.max_coast
    own = np.flatnonzero(targets.identity == identity)[:1]
    if len(own):
        silent[own] = False
        origins = Origins(1.0, NO_OTHER, np.array([identity]), np.ones(1, bool), of.gates)
        x, P, found = follow(
            targets, (own[0], own[0] + 1), of.kernels, look, origins, (look.at, np.zeros(1, bool)), sensor
        )
        changed, seen = own, Seen(x, P, *found[2:])
    else:
        begun, seen = _begun(of, look, sensor, np.zeros(1, int), np.array([identity]), np.ones(1))
        changed, targets = np.array([len(silent)]), joined(targets, begun)
    ended = np.flatnonzero(silent)
    if len(ended):
        targets.lives.status[ended] = DELETED
        order = np.argsort(np.append(changed, ended), kind="stable")
        changed, seen = (
            np.append(changed, ended)[order],
            chosen(joined(seen, _not_seen(targets, ended, of, look.time)), order),
        )
    return completed(state, targets, seen, changed)


def _followed(
    targets: Targets, leaves: tuple[Leaves, ...], of: Assumed, look: Look, origins: Origins, sensor: int,
    azimuths: Azimuths,
) -> tuple[np.ndarray, np.ndarray, Associated, tuple[Leaves, ...]]:  # fmt: skip
    """`followed`, where the sensor has looked: a miss counts once a turn."""
    model, spec, p = of.model, of.model.sensors[sensor], of.model.axes
    first, last = (look.at.min(), look.at.max()) if len(look.at) else (look.time, look.time)
    sweep = (float(first), float(last), *map(float, azimuths or (np.nan, np.nan)))
    origin = look.origin[0, :p] if len(look.at) else np.array(spec.position[:p])
    passed = passes(targets.banks, look.time, origin, sweep)
    again = passed - targets.lives.look_time[:, sensor] <= spec.rotation_period / 2
    beam = passed, np.isfinite(passed) & ~again
    x, P, found, leaves = followed(model.tracker, targets, leaves, of.kernels, look, origins, beam, sensor)
    return x, P, Associated(*found), leaves


def _adopt(targets: Targets, found: Associated, identity: np.ndarray, taken: np.ndarray) -> None:
    """A track of unknown identity takes that of a detection that is its own, in place."""
    anonymous = np.flatnonzero((targets.identity < 0) & (found.best >= 0) & (found.weight >= 0.5))
    for i in anonymous:
        name = identity[found.best[i]]
        if name >= 0 and not taken[found.best[i]] and name not in targets.identity:
            targets.identity[i] = name


def _beginning(
    targets: Targets, of: Assumed, look: Look, identity: np.ndarray, existence: np.ndarray
) -> np.ndarray:
    """Detections that start a track, the likeliest first and one of each identity; in an order that does not
    depend on theirs."""
    free = (identity < 0) | ~np.isin(identity, targets.identity)
    rows = np.flatnonzero(free & (existence >= of.model.prune_existence) & (existence > 0))
    order = np.lexsort((*look.z[rows].T, -existence[rows].round(9)))
    rows = rows[order][: of.model.max_tracks]
    named, first = np.unique(identity[rows], return_index=True)
    once = np.isin(np.arange(len(rows)), first[named >= 0])
    return rows[once | (identity[rows] < 0)]


def _begun(
    of: Assumed, look: Look, sensor: int, rows: np.ndarray, identity: np.ndarray, existence: np.ndarray
) -> tuple[Targets, Seen]:
    """New targets of the detections `rows`."""
    modes, axes = of.kernels[0], of.model.axes
    banks = Banks(*engine.started(modes, look, rows, of.model.max_speed, modes.states(axes)))
    x, P = engine.outputs(banks, axes)
    lives = started(x, P, look.at[rows], of.model)
    lives.look_time[:, sensor] = lives.hit_time
    n = len(rows)
    seen = Seen(x, P, np.ones(n, int), rows, existence, np.full(n, np.nan))
    return Targets(banks, existence, identity[rows], lives), seen


def _not_seen(targets: Targets, which: np.ndarray, of: Assumed, time: float) -> Seen:
    """Rows of targets without detections, brought to `time`."""
    n, axes = len(which), of.model.axes
    banks = Banks(*carried(chosen(targets.banks, which), of.kernels[0], time, axes))
    x, P = engine.outputs(banks, axes)
    return Seen(x, P, np.zeros(n, int), np.full(n, -1), np.zeros(n), np.full(n, np.nan))


def _thin(targets: Targets, of: Assumed, seen: Seen) -> None:
    """Delete the later of two tracks on one target, and the least likely ones beyond `max_tracks`, in
    place."""
    status, existence = targets.lives.status, targets.existence
    order = np.lexsort((np.arange(len(status)), status == TENTATIVE))
    order = order[status[order] != DELETED]
    first = engine.first_of_each(seen.x, seen.P, targets.identity, order, of.model.merge_distance)
    again = first != np.arange(len(first))
    np.maximum.at(existence, first[again], existence[again])
    status[again] = DELETED
    order = np.lexsort((-existence, status == TENTATIVE, status == DELETED))
    status[order[of.model.max_tracks :]] = DELETED


def completed(state: State, targets: Targets, seen: Seen, changed: np.ndarray) -> tuple[State, Tracks]:
    """The state without the tracks deleted now, new ones labelled, and rows of those changed, indices."""
    lives = targets.lives
    new = changed[lives.label[changed] == 0]
    lives.label[new] = state.next_label + np.arange(len(new))
    status, existence, w = lives.status[changed], targets.existence[changed], targets.banks.w[changed]
    rows = Tracks(
        np.full(len(seen.x), state.time), lives.label[changed], status, seen.x, seen.P, existence, w,
        seen.gated, seen.best, seen.weight, seen.nis, lives.age[changed],
    )  # fmt: skip
    if (status == DELETED).any():
        targets = chosen(targets, lives.status != DELETED)
    return state._replace(targets=targets, next_label=state.next_label + len(new)), rows
