"""Global nearest neighbour: the most probable assignment of a scan to tracks, which a logic manages."""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from gmr_gym.checks import check_probability, check_whole
from gmr_gym.filters.confirmed_tracks import ConfirmingTracker, Stage
from gmr_gym.filters.mixture_tracks import MixtureTracks, detected
from gmr_gym.filters.pmb import LEAST_MISS
from gmr_gym.filters.target_densities import pair, posteriors
from gmr_gym.filters.track_logic import TrackLogic, track_logic
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
    start_probability: float = 1e-4
    tracks: int = 200

    def __post_init__(self) -> None:
        check_whole("tracks", self.tracks, 1)
        check_probability("start_probability", self.start_probability)

    def associate(self, tracks: MixtureTracks, z: np.ndarray, log_kappa: np.ndarray) -> Stage:
        """Predicted tracks after the detections z (k, p), of clutter of log intensity log_kappa (k,)."""
        p, (n, k) = tracks.densities, (len(tracks.label), len(z))
        seen = detected(p, self.model)
        pairs = pair(p, self.model.sensor, z, log_kappa, seen)
        log_miss = np.log(np.maximum(1.0 - seen, LEAST_MISS))
        log_hit = np.log(seen)[pairs.row] + pairs.log_likelihood - log_kappa[pairs.detection]
        cost = np.full((n, k + n), np.inf)
        cost[pairs.row, pairs.detection] = log_miss[pairs.row] - log_hit
        cost[np.arange(n), k + np.arange(n)] = 0.0
        row, column = linear_sum_assignment(cost)
        of = np.full((n, k), -1)
        of[pairs.row, pairs.detection] = np.arange(len(pairs.row))
        hit = column < k
        chosen = of[row[hit], column[hit]]
        after, gain, unassigned = p._replace(w=p.w.copy(), m=p.m.copy(), P=p.P.copy()), log_miss, np.ones(k)
        for out, part in zip(after, posteriors(p, pairs, chosen), strict=True):
            out[hit] = part
        gain[hit] = log_hit[chosen]
        unassigned[column[hit]] = 0.0
        return Stage(tracks._replace(densities=after), unassigned, hit, gain, 0)


def gnn(
    model: MultiTargetModel,
    logic: str = "score",
    hits: int = 3,
    window: int = 4,
    misses: int = 5,
    *,
    false_confirmation: float = 1e-3,
    missed_confirmation: float = 1e-2,
    start_probability: float = 1e-4,
    tracks: int = 200,
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
        dropped.
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
