"""Global nearest neighbour: the most probable assignment of a scan to tracks, which a logic manages."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gmr_gym.checks import check_probability, check_whole
from gmr_gym.filters.confirmed_tracks import ConfirmingTracker, Stage
from gmr_gym.filters.mixture_tracks import MixtureTracks
from gmr_gym.filters.pmb import LEAST_MISS
from gmr_gym.filters.target_densities import pair, posteriors
from gmr_gym.filters.track_logic import TrackLogic, track_logic
from gmr_gym.filters.undetected_targets import detected
from gmr_gym.models.multi_target import MultiTargetModel


@dataclass(frozen=True)
class Gnn(ConfirmingTracker):
    r"""Global nearest neighbour: of all association events the most probable is taken for true.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    logic : TrackLogic
    start_probability : float
        Least probability of a free detection to be of a new target, for a track to start with it.
    tracks : int
        Most tracks.

    Notes
    -----
    The assignment of least cost, where a pair costs

    .. math:: c_{ij} = -\ln \frac{P_D g_{ij}}{(1 - P_D) \kappa_j}

    and a track without a detection nothing.

    References
    ----------
    Blackman and Popoli 1999.
    """

    model: MultiTargetModel
    logic: TrackLogic
    start_probability: float = 1e-5
    tracks: int = 1000

    def __post_init__(self) -> None:
        check_whole("tracks", self.tracks, 1)
        check_probability("start_probability", self.start_probability)

    def associate(
        self, tracks: MixtureTracks, tentative: np.ndarray, z: np.ndarray, log_kappa: np.ndarray
    ) -> Stage:
        """Predicted tracks after the detections z (k, p), of clutter of log intensity log_kappa (k,).

        Those that are `tentative` (n,) have only what the others leave."""
        p, (n, k) = tracks.densities, (len(tracks.label), len(z))
        seen = detected(p, self.model)
        pairs = pair(p, self.model.sensor, z, log_kappa, seen)
        log_miss = np.log(np.maximum(1.0 - seen, LEAST_MISS))
        log_hit = np.log(seen)[pairs.row] + pairs.log_likelihood - log_kappa[pairs.detection]
        which, cost = np.full((n, k), -1), np.full((n, k), np.inf)
        which[pairs.row, pairs.detection] = np.arange(len(pairs.row))
        cost[pairs.row, pairs.detection] = log_miss[pairs.row] - log_hit
        chosen, free = np.full(n, -1), np.ones(k, bool)  # pair of each track
        for rows in (np.flatnonzero(~tentative), np.flatnonzero(tentative)):
            left = np.flatnonzero(free)
            row, column = assigned(cost[np.ix_(rows, left)])
            chosen[rows[row]] = which[rows[row], left[column]]
            free[left[column]] = False
        hit = chosen >= 0
        after, gain = p._replace(w=p.w.copy(), m=p.m.copy(), P=p.P.copy()), log_miss
        for out, part in zip(after, posteriors(p, pairs, chosen[hit]), strict=True):
            out[hit] = part
        gain[hit] = log_hit[chosen[hit]]
        return Stage(tracks._replace(densities=after), free.astype(float), hit, gain, 0)


def assigned(cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the assignment of least cost (n, k), where a row without a column costs nothing."""
    n, k = cost.shape
    alone = np.full((n, n), np.inf)
    np.fill_diagonal(alone, 0.0)
    row, column = linear_sum_assignment(np.hstack([cost, alone]))
    return row[column < k], column[column < k]


def gnn(
    model: MultiTargetModel,
    logic: str = "score",
    hits: int = 3,
    window: int = 4,
    misses: int = 5,
    *,
    false_confirmation: float = 0.1,
    missed_confirmation: float = 1e-2,
    start_probability: float = 1e-5,
    tracks: int = 1000,
) -> Gnn:
    """Global nearest neighbour tracker, of one motion or several.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model: one motion or several, a linear sensor or a radar.
    logic : {"m-of-n", "score"}
        How tracks are confirmed and dropped.
    hits, window : int
        Of "m-of-n": a track is confirmed by M detections in its first N scans.
    misses : int
        Of "m-of-n": a confirmed track is dropped after so many misses in a row.
    false_confirmation, missed_confirmation : float
        Of "score": probabilities that a track of false alarms is confirmed, and that one of a target is
        dropped. The first is a bound that few reach: at 0.1 rather than 1e-3 targets are found sooner by a
        third in MeetingTargets, CrossingTargets and DenseTargets, and the false part of GOSPA is smaller.
    start_probability : float
        Least probability of a free detection to be of a new target, for a track to start with it.
    tracks : int
        Most tracks.

    Returns
    -------
    Gnn

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    References
    ----------
    Blackman and Popoli 1999.
    """
    rules = track_logic(logic, hits, window, misses, false_confirmation, missed_confirmation)
    return Gnn(model, rules, start_probability, tracks)
