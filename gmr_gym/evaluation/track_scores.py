"""What becomes of labelled targets scan by scan: their trajectories, switched labels and lost tracks, and how
far existence and covariance are to be believed."""

from collections.abc import Sequence
from itertools import count
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from gmr_gym.evaluation.metrics import nees
from gmr_gym.evaluation.trajectory_metrics import by_label, trajectory_costs
from gmr_gym.filters.tracker import MultiTargetReport

SWITCHING = 0.1  # of the cutoff: what trajectory GOSPA charges for a switched label
EXISTENCE = 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.99  # between the bins of existence


class TrackScores(NamedTuple):
    """Scores of one run by scan, (T,), the last three by bin of existence too, (T, b); nan where they need
    labels and no declared target has one."""

    # parts of trajectory GOSPA, m^order
    trajectory_localisation: np.ndarray
    trajectory_missed: np.ndarray
    trajectory_false: np.ndarray
    trajectory_switches: np.ndarray
    switches: np.ndarray  # targets whose label is another than when it was found last
    kept: np.ndarray  # targets that are found by the label by which they were found first
    fragments: np.ndarray  # targets that are found again after a scan at which they were not
    appeared: np.ndarray  # targets that are there for the first time
    unfound: np.ndarray  # targets that are there and were not found yet
    found: np.ndarray  # declared targets that are near a true one, paired off
    existence: np.ndarray  # sum over declared targets of the reported probability
    squared_surprise: np.ndarray  # sum over declared targets of (existence - whether it is found)^2
    nees: np.ndarray  # sum over found targets of the normalised squared error of the state
    believed: np.ndarray  # found targets whose covariance is known
    binned: np.ndarray  # declared targets,
    binned_found: np.ndarray  # those of them that are near a true one, paired off,
    binned_existence: np.ndarray  # and the sum of their reported probabilities


class Declared(NamedTuple):
    """The declared targets of a scan."""

    x: np.ndarray  # (j, d)
    P: np.ndarray  # (j, d, d), nan where it is not known
    existence: np.ndarray  # (j,)
    label: np.ndarray  # (j,)


def declared(report: MultiTargetReport) -> Declared:
    """The declared targets of a report; their covariances are those of the components of the intensity that
    they are the means of."""
    x, p = report.x, report.intensity
    P = np.full((*x.shape, x.shape[1]), np.nan)
    for j, state in enumerate(x):
        of = np.flatnonzero((p.m == state).all(axis=1))
        if len(of):
            P[j] = p.P[of[0]]
    return Declared(x, P, report.existence, report.label)


def track_scores(
    found: Sequence[Declared], truth: np.ndarray, position: Sequence[int], cutoff: float, order: float
) -> TrackScores:
    """Scores of a run.

    Parameters
    ----------
    found : sequence of Declared
        Of every scan.
    truth : ndarray (T, m, d)
        True states, nan where a target is absent.
    position : sequence of int
        Which states are coordinates.
    cutoff : float
        Distance from which on an estimate is none of the target, m.
    order : float

    Returns
    -------
    TrackScores

    Notes
    -----
    A target keeps the label that it was found by last as long as that is near and no other target has been
    found by it since; the others are paired with what is left, the sum of their distances least (Bernardin
    and Stiefelhagen 2008, CLEAR MOT).
    """
    position = list(position)
    last = np.full(truth.shape[1], -1)  # label by which each target was found last
    first = last.copy()  # by which it was found first
    own = last.copy()  # by which it was found last, -1 where another target was found by it since
    before = np.zeros(truth.shape[1], bool)  # whether it was found at the scan before
    ever, seen = before.copy(), before.copy()
    rows = []
    for of, states in zip(found, truth, strict=True):
        there = np.isfinite(states).all(axis=1)
        row = _paired(of, states[:, position], own, position, cutoff)
        now, label = row >= 0, np.append(of.label, -1)[row]
        switched = (label >= 0) & (last >= 0) & (label != last)
        first = np.where(first < 0, label, first)
        rows.append((
            switched.sum(), ((label >= 0) & (label == first)).sum(), (now & ever & ~before).sum(),
            (there & ~seen).sum(), (there & ~(ever | now)).sum(), now.sum(), of.existence.sum(),
            _surprise(of, row[now]), *_errors(of, states, row), *_binned(of, row[now]),
        ))  # fmt: skip
        last = np.where(label >= 0, label, last)
        own = np.where(label >= 0, label, np.where(np.isin(own, label), -1, own))
        before, ever, seen = now, ever | now, seen | there
    counts = [np.array(column, float) for column in zip(*rows, strict=True)]
    labelled = any((of.label >= 0).any() for of in found) or not any(len(of.x) for of in found)
    if labelled:
        costs = _trajectory_costs(found, truth, position, cutoff, order)
    else:
        costs, counts[:2] = np.full((4, len(truth)), np.nan), np.full((2, len(truth)), np.nan)
    return TrackScores(*costs, *counts)


def _trajectory_costs(
    found: Sequence[Declared], truth: np.ndarray, position: list[int], cutoff: float, order: float
) -> np.ndarray:
    """`trajectory_costs` (4, T); an estimate without a label is a trajectory of one scan."""
    nameless = count(-1, -1)
    scans = [
        {label if label >= 0 else next(nameless): x for label, x in zip(of.label.tolist(), of.x, strict=True)}
        for of in found
    ]
    tracks = by_label(scans, truth.shape[2])[..., position]
    return trajectory_costs(tracks, truth[..., position], cutoff, order, SWITCHING * cutoff)


def _paired(
    of: Declared, truth: np.ndarray, own: np.ndarray, position: list[int], cutoff: float
) -> np.ndarray:
    """Row (m,) of the declared target that each true one (m, p) is paired with, -1 for none; `own` (m,) are
    the labels that they keep, distinct."""
    distance = np.linalg.norm(truth[:, None] - of.x[None, :, position], axis=2)  # nan where absent
    near = distance < cutoff
    row = np.full(len(truth), -1)
    kept = np.argwhere(near & (own[:, None] == of.label) & (of.label >= 0))
    row[kept[:, 0]] = kept[:, 1]
    targets, others = row < 0, np.ones(len(of.x), bool)
    others[row[row >= 0]] = False
    left = np.ix_(targets, others)
    cost = np.where(near[left], distance[left], 1e3 * cutoff)  # any pair is better than one that is not near
    one, other = linear_sum_assignment(cost)
    good = near[left][one, other]
    row[np.flatnonzero(targets)[one[good]]] = np.flatnonzero(others)[other[good]]
    return row


def _surprise(of: Declared, found: np.ndarray) -> float:
    real = np.zeros(len(of.x))
    real[found] = 1.0
    return float(((of.existence - real) ** 2).sum())


def _binned(of: Declared, found: np.ndarray) -> list[np.ndarray]:
    """By bin of existence the declared targets, the found ones among them, and the sum of their existence."""
    bins, into = len(EXISTENCE) + 1, np.digitize(of.existence, EXISTENCE)
    weights = np.ones(len(into)), np.bincount(found, minlength=len(into)), of.existence
    return [np.bincount(into, weight, bins) for weight in weights]


def _errors(of: Declared, states: np.ndarray, row: np.ndarray) -> tuple[float, int]:
    """The sum of the normalised squared errors of the found targets, and how many it is of."""
    now = np.flatnonzero(row >= 0)
    P = of.P[row[now]]
    known = np.isfinite(P).all(axis=(1, 2))
    now, P = now[known], P[known]
    return float(nees(of.x[row[now]] - states[now], P).sum()), len(now)
