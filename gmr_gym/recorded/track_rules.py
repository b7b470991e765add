"""Life of a track: which looks count, when it is confirmed, coasted and deleted."""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.bernoulli_tracks import Bernoullis, outputs, update
from gmr_gym.filters.imm_tracks import Banks
from gmr_gym.kernels import kernel
from gmr_gym.recorded.model import TrackingModel
from gmr_gym.recorded.tracks import COASTED, CONFIRMED, DELETED, TENTATIVE

HIT, MISSED, NO_LOOK = 1, 0, -1


class Rules(NamedTuple):
    """Numbers of the rules, see `TrackingModel`; (0, 0) for a rule by existence, nan for one by M of N."""

    confirm_existence: float
    confirm_hits: int
    confirm_looks: int
    delete_existence: float
    delete_misses: int
    delete_looks: int
    prune_existence: float
    max_coast: float
    min_speed: float


class Lives(NamedTuple):
    """What is kept of n tracks beside their states.

    Attributes
    ----------
    label, age : ndarray of int (n,)
        Label, and scans since the first detection.
    status : ndarray of int8 (n,)
        Index into `tracks.STATUS`.
    hits : ndarray of int8 (n, .)
        The last looks, the latest first: `HIT`, `MISSED` or `NO_LOOK`.
    hit_time, start_time : ndarray (n,)
        Times of the last and of the first detection, s.
    look_time : ndarray (n, sensors)
        When each sensor last looked at the track, s.
    start : ndarray (n, p)
        First position, m.
    start_variance : ndarray (n,)
        Sum of the variances of its coordinates, m^2.
    moved : ndarray of bool (n,)
        Whether it has moved at the least speed.
    """

    label: np.ndarray
    age: np.ndarray
    status: np.ndarray
    hits: np.ndarray
    hit_time: np.ndarray
    start_time: np.ndarray
    look_time: np.ndarray
    start: np.ndarray
    start_variance: np.ndarray
    moved: np.ndarray


def rules(model: TrackingModel) -> Rules:
    """The rules of a model, for kernels."""
    by_existence = (0, 0)
    confirm, delete = (
        rule if isinstance(rule, tuple) else by_existence for rule in (model.confirm, model.delete)
    )
    least = [np.nan if isinstance(rule, tuple) else rule for rule in (model.confirm, model.delete)]
    return Rules(
        least[0], *confirm, least[1], *delete, model.prune_existence, model.max_coast, model.min_speed
    )


def width(model: TrackingModel) -> int:
    """How many looks of a track are kept."""
    return max(1, *(rule[1] for rule in (model.confirm, model.delete) if isinstance(rule, tuple)), 1)


@kernel
def passes(banks, time, origin, sweep):
    """When the beam passes each track (n,); NaN where it does not.

    sweep is (first, last, from, to): the beam turns from azimuth `from` at time `first` to `to` at `last`;
    all are looked at at `time` where the azimuths are NaN.
    """
    first, last, start, stop = sweep
    n, r = banks.w.shape
    out = np.full(n, time)
    if not np.isfinite(start):
        return out
    p, span = len(origin), abs(stop - start)
    for i in range(n):
        x = np.zeros(2)
        for q in range(r):
            for c in range(2):
                ahead = (time - banks.time[i]) * banks.m[i, q, p + c]
                x[c] += banks.w[i, q] * (banks.m[i, q, c] + ahead - origin[c])
        turned = (np.arctan2(x[1], x[0]) - start) * np.sign(stop - start) % (2 * np.pi)
        out[i] = first + turned / span * (last - first) if turned <= span else np.nan
    return out


@kernel
def follow(targets, span, assumed, look, origins, beam, sensor):
    """Update the targets from span[0] to span[1] with a look and review their lives, in place.

    assumed is (modes, rules, survival probability of a second); beam is (passed, looked), when the beam
    passed each of them and whether a miss then counts. Returns their positions and velocities, covariances,
    and the fields of `Associated`.
    """
    (low, high), (modes, rules, survival), looked = span, assumed, beam[1]
    whole = targets.banks
    banks = Banks(whole.w[low:high], whole.m[low:high], whole.P[low:high], whole.time[low:high])
    existence = targets.existence[low:high]
    existence *= survival ** (look.time - banks.time)
    tracks = Bernoullis(banks, existence, targets.identity[low:high], looked * origins.detection_probability)
    unassigned, found, gated, best, weight, nis = update(tracks, modes, look, origins)
    x, P = outputs(banks, look.z.shape[1])
    reviewed(targets, span, rules, (beam, look, sensor), (found, best), (x, P))
    return x, P, (unassigned, found, gated, best, weight, nis)


@kernel(inline="always")
def reviewed(targets, span, rules, looked, associated, state):
    """Review the lives of the targets from span[0] to span[1], in place.

    looked is (beam, look, sensor), as `follow` takes them; associated is (hit, best) of `Associated`, state
    their positions and velocities and covariances.
    """
    ((passed, counted), look, sensor), (found, best), (x, P), low = looked, associated, state, span[0]
    for i in range(span[1] - low):
        hit = best[i] >= 0 and found[i] >= 0.5 * targets.existence[low + i]
        seen = look.at[best[i]] if hit else passed[i]
        if hit:
            targets.lives.hit_time[low + i] = seen
        if hit or counted[i]:
            targets.lives.look_time[low + i, sensor] = seen
        _review(targets, low + i, rules, (counted[i], hit, look.time), (x[i], P[i]))


@kernel(inline="always")
def _review(targets, i, rules, event, state):
    """Note in the life of target i whether a miss counted and whether there was a detection, and set its
    status."""
    (looked, hit, time), (x, P), lives = event, state, targets.lives
    lives.age[i] += 1
    if hit or looked:
        for c in range(lives.hits.shape[1] - 1, 0, -1):
            lives.hits[i, c] = lives.hits[i, c - 1]
        lives.hits[i, 0] = HIT if hit else MISSED
    if rules.min_speed > 0.0 and not lives.moved[i]:
        d2, variance = 0.0, lives.start_variance[i]
        for c in range(lives.start.shape[1]):
            d2 += (x[c] - lives.start[i, c]) ** 2
            variance += P[c, c]
        slowest = rules.min_speed * (time - lives.start_time[i])
        lives.moved[i] = d2 >= slowest**2 and d2 > 9.0 * variance
    known = lives.status[i] != TENTATIVE
    if not known and lives.moved[i]:
        known = _confirmed(lives.hits[i], targets.existence[i], rules)
    if _ended(lives, i, known, targets.existence[i], rules, time):
        lives.status[i] = DELETED
    elif known:
        lives.status[i] = COASTED if lives.hits[i, 0] == MISSED else CONFIRMED


@kernel(inline="always")
def _confirmed(hits, existence, rules):
    if rules.confirm_looks == 0:
        return existence >= rules.confirm_existence
    return (hits[: rules.confirm_looks] == HIT).sum() >= rules.confirm_hits


@kernel(inline="always")
def _ended(lives, i, known, existence, rules, time):
    """Whether track i is to be deleted; a tentative one of M of N also when its N looks are over."""
    hits = lives.hits[i]
    if time - lives.hit_time[i] > rules.max_coast:
        return True
    missed = rules.delete_looks > 0 and (hits[: rules.delete_looks] == MISSED).sum() >= rules.delete_misses
    if known:
        return missed if rules.delete_looks > 0 else existence < rules.delete_existence
    failed = False
    if rules.confirm_looks > 0:
        looks = hits[: rules.confirm_looks]
        failed = (looks == MISSED).sum() > rules.confirm_looks - rules.confirm_hits
    return missed or failed or existence < rules.prune_existence


def started(x: np.ndarray, P: np.ndarray, times: np.ndarray, model: TrackingModel) -> Lives:
    """Lives of new tracks of states x (n, 2 p), P (n, 2 p, 2 p), detected first at these times (n,); no
    label yet."""
    n, p = len(times), model.axes
    hits = np.full((n, width(model)), NO_LOOK, np.int8)
    hits[:, 0] = HIT
    return Lives(
        label=np.zeros(n, np.int64),
        age=np.ones(n, np.int64),
        status=np.full(n, TENTATIVE, np.int8),
        hits=hits,
        hit_time=times.copy(),
        start_time=times.copy(),
        look_time=np.full((n, len(model.sensors)), -np.inf),
        start=x[:, :p].copy(),
        start_variance=np.trace(P[:, :p, :p], axis1=1, axis2=2),
        moved=np.full(n, model.min_speed == 0),
    )
