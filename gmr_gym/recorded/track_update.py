"""A scan, or a report of one target, through the engine: tracks updated, started, ended, and written down."""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters import bernoulli_tracks as engine
from gmr_gym.filters.bernoulli_tracks import Associated, Bernoullis, Origins
from gmr_gym.filters.imm_tracks import Banks, carried
from gmr_gym.models.gating import gate_threshold
from gmr_gym.models.intervals import Modes
from gmr_gym.models.positions import Look
from gmr_gym.recorded.model import TrackingModel
from gmr_gym.recorded.origins import densities, learned, undetected_until
from gmr_gym.recorded.track_rules import Rules, passes, review, rules, started
from gmr_gym.recorded.track_state import State, Targets, chosen, joined
from gmr_gym.recorded.tracks import DELETED, TENTATIVE, Tracks

Azimuths = tuple[float, float] | None  # rad, from and to; None for all directions
Beam = tuple[np.ndarray, np.ndarray]  # when it passed each track, and whether a miss then counts
LEAST_DENSITY = 1e-300  # of clutter and new targets where there are none: a detection needs an explanation


class Assumed(NamedTuple):
    """A model, and what kernels take of it."""

    model: TrackingModel
    modes: Modes
    rules: Rules
    gates: np.ndarray


class Seen(NamedTuple):
    """Detections of n tracks: how many in the gate, and the one of most weight (see `Associated`)."""

    gated: np.ndarray
    best: np.ndarray
    weight: np.ndarray
    nis: np.ndarray


def assumed(model: TrackingModel) -> Assumed:
    """The model for kernels."""
    gates = [gate_threshold(model.gate_probability, p) for p in (model.axes, model.axes + 1)]
    return Assumed(model, model.bank(), rules(model), np.array(gates))


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
    passed, looked = _looked(targets, of, look, sensor, azimuths)
    found = _update(targets, of, look, looked * spec.detection_probability, origins)
    _review(targets, of, look, sensor, found, (passed, looked))
    _adopt(targets, found, identity, taken)
    swept = 1.0 if azimuths is None else min(abs(azimuths[1] - azimuths[0]) / (2 * np.pi), 1.0)
    state = state._replace(
        time=look.time,
        undetected=undetected * (1.0 - spec.detection_probability * swept),
        clutter=learned(look, state, model, sensor, found.unassigned * clutter / other),
    )
    rows = _beginning(targets, of, identity, found.unassigned * new / other)
    begun = _begun(of, look, sensor, rows, identity, (found.unassigned * new / other)[rows])
    targets, seen = joined(targets, begun), joined(Seen(*found[2:]), _first_seen(rows, begun.existence))
    _thin(targets, of)
    unseen = (targets.lives.status == DELETED) & (targets.lives.label == 0)
    if unseen.any():
        targets, seen = chosen(targets, ~unseen), chosen(seen, ~unseen)
    return _completed(state, targets, of, seen, np.arange(len(targets.existence)))


def report(state: State, of: Assumed, look: Look, sensor: int, identity: int) -> tuple[State, Tracks]:
    """State and rows after one detection of a target that names itself; only its own track is touched, in
    place."""
    targets, state = state.targets, state._replace(time=look.time)
    silent = look.time - targets.lives.hit_time > of.model.max_coast
    own = np.flatnonzero(targets.identity == identity)[:1]
    if len(own):
        silent[own] = False
        one, none = chosen(targets, slice(own[0], own[0] + 1)), np.zeros(1)
        origins = Origins(1.0, np.log([LEAST_DENSITY]), one.identity, none == 0, of.gates)
        found = _update(one, of, look, none, origins)
        _review(one, of, look, sensor, found, (none + look.time, none > 0))
        changed, seen = own, Seen(*found[2:])
    else:
        first = np.zeros(1, int)
        begun = _begun(of, look, sensor, first, np.array([identity]), np.ones(1))
        changed, seen = np.array([len(silent)]), _first_seen(first, begun.existence)
        targets = joined(targets, begun)
    ended = np.flatnonzero(silent)
    if len(ended):
        targets.lives.status[ended] = DELETED
        order = np.argsort(np.append(changed, ended), kind="stable")
        changed, seen = np.append(changed, ended)[order], chosen(joined(seen, _not_seen(len(ended))), order)
    return _completed(state, targets, of, seen, changed)


def _looked(targets: Targets, of: Assumed, look: Look, sensor: int, azimuths: Azimuths) -> Beam:
    """When the beam passed each track (n,), NaN where it did not, and whether a miss then counts: once a
    turn."""
    period = of.model.sensors[sensor].rotation_period
    first, last = (look.at.min(), look.at.max()) if len(look.at) else (look.time, look.time)
    sweep = (float(first), float(last), *map(float, azimuths or (np.nan, np.nan)))
    origin = look.origin[0] if len(look.at) else np.array(of.model.sensors[sensor].position)
    passed = passes(targets.banks, look.time, origin[: of.model.axes].copy(), sweep)
    again = passed - targets.lives.look_time[:, sensor] <= period / 2
    return passed, np.isfinite(passed) & ~again


def _update(targets: Targets, of: Assumed, look: Look, looked: np.ndarray, origins: Origins) -> Associated:
    """Update the targets in place."""
    alive = targets.existence * of.model.survival_probability ** (look.time - targets.banks.time)
    tracks = Bernoullis(targets.banks, alive, targets.identity, looked)
    found = Associated(*engine.update(tracks, of.modes, look, origins))
    targets.existence[:] = alive
    return found


def _review(targets: Targets, of: Assumed, look: Look, sensor: int, found: Associated, beam: Beam) -> None:
    """Note in the lives of the targets what the look has shown, in place."""
    (passed, looked), lives = beam, targets.lives
    hit = (found.best >= 0) & (found.hit >= 0.5 * targets.existence)
    lives.hit_time[hit] = look.at[found.best[hit]]
    lives.look_time[looked, sensor] = passed[looked]
    lives.look_time[hit, sensor] = lives.hit_time[hit]
    x, P = engine.outputs(targets.banks, of.model.axes)
    review(lives, of.rules, looked, hit, targets.existence, x, P, look.time)


def _adopt(targets: Targets, found: Associated, identity: np.ndarray, taken: np.ndarray) -> None:
    """A track of unknown identity takes that of a detection that is its own, in place."""
    anonymous = np.flatnonzero((targets.identity < 0) & (found.best >= 0) & (found.weight >= 0.5))
    for i in anonymous:
        name = identity[found.best[i]]
        if name >= 0 and not taken[found.best[i]] and name not in targets.identity:
            targets.identity[i] = name


def _beginning(targets: Targets, of: Assumed, identity: np.ndarray, existence: np.ndarray) -> np.ndarray:
    """Detections that start a track, the likeliest first and one of each identity; the order of detections
    does not matter but for equal ones."""
    free = (identity < 0) | ~np.isin(identity, targets.identity)
    rows = np.flatnonzero(free & (existence >= of.model.prune_existence) & (existence > 0))
    rows = rows[np.argsort(-existence[rows], kind="stable")][: of.model.max_tracks]
    named, first = np.unique(identity[rows], return_index=True)
    once = np.isin(np.arange(len(rows)), first[named >= 0])
    return rows[once | (identity[rows] < 0)]


def _begun(
    of: Assumed, look: Look, sensor: int, rows: np.ndarray, identity: np.ndarray, existence: np.ndarray
) -> Targets:
    """New targets of the detections `rows`."""
    d = of.modes.states(of.model.axes)
    banks = Banks(*engine.started(of.modes, look, rows, of.model.max_speed, d))
    lives = started(banks, look.at[rows], of.model)
    lives.look_time[:, sensor] = lives.hit_time
    return Targets(banks, existence, identity[rows], lives)


def _first_seen(rows: np.ndarray, existence: np.ndarray) -> Seen:
    return Seen(np.ones(len(rows), int), rows, existence, np.full(len(rows), np.nan))


def _not_seen(count: int) -> Seen:
    return Seen(np.zeros(count, int), np.full(count, -1), np.zeros(count), np.full(count, np.nan))


def _thin(targets: Targets, of: Assumed) -> None:
    """Delete the later of two tracks on one target, and the least likely ones beyond `max_tracks`, in
    place."""
    status, existence = targets.lives.status, targets.existence
    x, P = engine.outputs(targets.banks, of.model.axes)
    order = np.lexsort((np.arange(len(status)), status == TENTATIVE))
    order = order[status[order] != DELETED]
    first = engine.first_of_each(x, P, targets.identity, order, of.model.merge_distance)
    again = first != np.arange(len(first))
    np.maximum.at(existence, first[again], existence[again])
    status[again] = DELETED
    order = np.lexsort((-existence, status == TENTATIVE, status == DELETED))
    status[order[of.model.max_tracks :]] = DELETED


def _completed(
    state: State, targets: Targets, of: Assumed, seen: Seen, changed: np.ndarray
) -> tuple[State, Tracks]:
    """The state without the tracks deleted now, new ones labelled, and rows of those changed, indices."""
    lives = targets.lives
    new = changed[lives.label[changed] == 0]
    lives.label[new] = state.next_label + np.arange(len(new))
    rows = _rows(state.time, of, targets, changed, seen)
    if (rows.status == DELETED).any():
        targets = chosen(targets, lives.status != DELETED)
    return state._replace(targets=targets, next_label=state.next_label + len(new)), rows


def _rows(time: float, of: Assumed, targets: Targets, which: np.ndarray, seen: Seen) -> Tracks:
    """Rows of the targets `which`, brought to `time`."""
    axes, lives = of.model.axes, targets.lives
    banks = Banks(*carried(chosen(targets.banks, which), of.modes, time, axes))
    x, P = engine.outputs(banks, axes)
    label, status, age = lives.label[which], lives.status[which], lives.age[which]
    return Tracks(np.full(len(x), time), label, status, x, P, targets.existence[which], banks.w, *seen, age)
