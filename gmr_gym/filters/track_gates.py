"""Pairs of Bernoulli tracks and detections in a gate, each at the detection's own time."""

import numpy as np

from gmr_gym.filters.imm_tracks import at_detection
from gmr_gym.kernels import kernel
from gmr_gym.models.positions import compared
from gmr_gym.models.spherical import cartesian_of

FARTHEST = 1e9  # deviations: the circle about a gate without a limit


@kernel(inline="always")
def gated_pairs(tracks, predicted, modes, look, origins):
    """Pairs (e,) of track and detection in a gate, and log likelihoods (e, r)."""
    banks, r = tracks.banks, predicted.w.shape[1]
    near = _near(tracks, predicted, look, origins)
    track, detection = np.nonzero(near)
    log_likelihood, inside = np.empty((len(track), r)), np.zeros(len(track), np.bool_)
    for a in range(len(track)):
        i, j = track[a], detection[a]
        threshold = origins.gates[1 if np.isfinite(look.range_rate[j]) else 0]
        for q in range(r):
            m, P = at_detection(banks, predicted, modes, look, (i, q, j))
            _, _, _, _, _, d2, log_likelihood[a, q] = compared(m, P, look, j)
            inside[a] |= d2 <= threshold
    kept = np.flatnonzero(inside)
    return track[kept], detection[kept], log_likelihood[kept]


@kernel(inline="always")
def _near(tracks, predicted, look, origins):
    """Which tracks and detections (n, k) may be in a gate: a circle about it, and no other identity."""
    (n, r), (k, axes) = predicted.w.shape, look.z.shape
    place, variance = positions_of(look)
    far, near = min(np.sqrt(origins.gates[1]), FARTHEST), np.zeros((n, k), np.bool_)
    for i in range(n):
        for q in range(r):
            m, P = predicted.m[i, q], predicted.P[i, q]
            wide, loose, speed = 0.0, 0.0, 0.0
            for c in range(axes):
                wide += P[c, c]
                loose += P[axes + c, axes + c]
                speed += m[axes + c] ** 2
            speed = np.sqrt(speed) + far * np.sqrt(loose)
            for j in range(k):
                reach = far * np.sqrt(wide + variance[j]) + speed * abs(look.time - look.at[j])
                d2 = 0.0
                for c in range(axes):
                    d2 += (m[c] - place[j, c]) ** 2
                near[i, j] |= d2 <= reach**2
        for j in range(k):
            own, other = tracks.identity[i], origins.identity[j]
            near[i, j] &= own == other or other < 0 or (own < 0 and not origins.taken[j])
    return near


@kernel
def positions_of(look):
    """Positions (k, p) of detections, and the sums (k,) of the variances of their coordinates."""
    k, p = look.z.shape
    place, variance = look.z.copy(), np.full(k, (look.deviation[:p] ** 2).sum())
    if look.polar:
        spherical = np.zeros((k, 3))
        spherical[:, :p] = look.z
        place = np.ascontiguousarray(cartesian_of(spherical)[:, :p] + look.origin[:, :p])
        across = (look.deviation[1:p] ** 2).sum()
        variance = look.deviation[0] ** 2 + across * look.z[:, 0] ** 2
    return place, variance
