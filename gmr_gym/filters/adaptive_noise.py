"""Process noise that is estimated from the innovations, scan by scan.

In clutter it is not known which detection is the target's: what the literature computes of one innovation is
here the mean over hypotheses, by their weights.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_choice
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared
from gmr_gym.models.kalman import predict_all

SMALLEST = 1e-6  # of a ratio of innovations to what was expected: their mean may come out below the noise


class Innovations(NamedTuple):
    """What a scan says of the process noise, summed over hypotheses by weight.

    nu is the innovation of a hypothesis with a detection, and S = H P^- H' + R its covariance; m^- and P^-
    are the moments of a hypothesis before the update.

    Attributes
    ----------
    detected : float
        Weight of the hypotheses with a detection; the three below are sums over these.
    squared : float
        Of nu' nu.
    normalised : float
        Of nu' S^-1 nu.
    predicted : float
        Of tr(H P^- H').
    moved : float
        Of (m - m^-)' Q^+ (m - m^-), Q^+ the pseudo-inverse of the process noise of the filter model.
    settled : float
        Of tr(Q^+ (P - P^-)), negative.
    """

    detected: float
    squared: float
    normalised: float
    predicted: float
    moved: float
    settled: float


class Noise(NamedTuple):
    """What the next scan is predicted with.

    Attributes
    ----------
    factor : float
        On the process noise Q of the filter model.
    fading : float
        On the covariance before the prediction, F P F'.
    seen, expected : float
        Sums of the last scans, see `NoiseEstimator`; the older a scan, the less it counts.
    """

    factor: float
    fading: float
    seen: float
    expected: float


@dataclass(frozen=True)
class NoiseEstimator:
    r"""Process noise by a method of the literature.

    Parameters
    ----------
    method : str
        "constant": Q is multiplied by `factor`, and F P F' by `fading` (Sorenson and Sacks 1971).
        "innovations": the factor on Q follows the ratio of innovations to what was expected (Ding, Wang,
        Rizos and Kinlyside 2007).
        "sage-husa": it follows Sage and Husa's estimate of Q (1969).
        "strong-tracking": F P F' is multiplied by what the innovations exceed (Zhou and Frank 1996).
        "switching": Q is multiplied by `high` while the innovations exceed `threshold` times what was
        expected, and by `factor` otherwise (Bar-Shalom, Li and Kirubarajan 2001, section 11.2).
    factor : float
        On Q before the first scan, and for good where Q is not adapted; positive.
    memory : float
        By how much a scan counts less with every scan that follows, in [0, 1).
    low, high : float
        Bounds of the factor, positive; `high` also of that on F P F'.
    threshold : float
        Of "switching".
    fading : float
        Of "constant", at least 1.

    Notes
    -----
    With sums over the last scans, "innovations" takes

    .. math:: q \leftarrow q \sqrt{\frac{\sum (\nu^T \nu - tr R)}{\sum tr(H P^- H^T)}}

    "sage-husa", for a process noise q Q of rank r, and d = 1 - `memory`,

    .. math:: q \leftarrow (1 - d) q + \frac{d}{r} tr Q^+ (K \nu \nu^T K^T + P - F P F^T)

    and "strong-tracking"

    .. math:: \lambda = \max\Big(1, \frac{\sum (\nu^T \nu - tr(R + H Q H^T))}{\sum tr(H F P F^T H^T)}\Big)

    Departs: the papers estimate matrices, of which this is the part along Q; they have no clutter; Sage and
    Husa's d begins at 1; and Zhou and Frank's factor is of the scan whose innovation it is computed from.
    """

    method: str = "innovations"
    factor: float = 1.0
    memory: float = 0.9
    low: float = 1 / 16
    high: float = 64.0
    threshold: float = 2.0
    fading: float = 1.0

    def __post_init__(self) -> None:
        check_choice("method", self.method, tuple(METHODS))
        if not 0 < self.low <= self.factor <= self.high < np.inf:
            raise ValueError(
                "0 < low <= factor <= high must hold, "
                f"got low {self.low}, factor {self.factor}, high {self.high}"
            )
        if not 0 <= self.memory < 1:
            raise ValueError(f"memory must lie in [0, 1), got {self.memory}")
        if not 0 < self.threshold < np.inf:
            raise ValueError(f"threshold must be positive and finite, got {self.threshold}")
        if not 1 <= self.fading < np.inf:
            raise ValueError(f"fading must be at least 1 and finite, got {self.fading}")

    def at_start(self, noise: float) -> Noise:
        """The noise of the first scan: sums as though the innovations so far had been `noise`, tr R, and as
        expected."""
        usual = noise / (1 - self.memory)
        return Noise(self.factor, self.fading, usual, usual)

    def after(self, before: Noise, scan: Innovations, traces: "Traces") -> Noise:
        """The noise of the scan to come."""
        return METHODS[self.method](self, before, scan, traces)

    def summed(self, before: Noise, seen: float, expected: float) -> Noise:
        """The sums with those of one scan more."""
        return before._replace(
            seen=self.memory * before.seen + seen, expected=self.memory * before.expected + expected
        )

    def bounded(self, factor: float) -> float:
        """The factor within its bounds."""
        return min(max(factor, self.low), self.high)


class Traces(NamedTuple):
    """Numbers of the filter model: tr R, tr(H Q H'), the rank of Q and the dimension of a detection."""

    sensor: float
    process: float
    rank: int
    p: int


def _constant(own: NoiseEstimator, before: Noise, scan: Innovations, traces: Traces) -> Noise:
    return before


def _innovations(own: NoiseEstimator, before: Noise, scan: Innovations, traces: Traces) -> Noise:
    now = own.summed(before, scan.squared - scan.detected * traces.sensor, scan.predicted)
    ratio = max(now.seen / now.expected, SMALLEST)
    return now._replace(factor=own.bounded(now.factor * ratio**0.5))


def _sage_husa(own: NoiseEstimator, before: Noise, scan: Innovations, traces: Traces) -> Noise:
    # P^- has the process noise in it: F P F' = P^- - q Q
    found = before.factor + (scan.moved + scan.settled) / traces.rank
    return before._replace(factor=own.bounded(own.memory * before.factor + (1 - own.memory) * found))


def _strong_tracking(own: NoiseEstimator, before: Noise, scan: Innovations, traces: Traces) -> Noise:
    process = scan.detected * own.factor * traces.process
    seen = scan.squared - scan.detected * traces.sensor - process
    now = own.summed(before, seen, (scan.predicted - process) / before.fading)
    return now._replace(fading=min(max(1.0, now.seen / now.expected), own.high))


def _switching(own: NoiseEstimator, before: Noise, scan: Innovations, traces: Traces) -> Noise:
    now = own.summed(before, scan.normalised, scan.detected * traces.p)
    return now._replace(factor=own.high if now.seen > own.threshold * now.expected else own.factor)


METHODS: dict[str, Callable[[NoiseEstimator, Noise, Innovations, Traces], Noise]] = {
    "constant": _constant,
    "innovations": _innovations,
    "sage-husa": _sage_husa,
    "strong-tracking": _strong_tracking,
    "switching": _switching,
}


@kernel
def innovations(belief, motion, posterior, gates, z, R, inverse):
    """`Innovations` (6,) of a scan.

    `belief` is w, m, P before the scan, and `motion` F, Q and the offset, both with their factors;
    `posterior` and `gates` are what `expand_scan` returns of them and of the detections z (k, p); and
    `inverse` (d, d) is the pseudo-inverse of Q without a factor.
    """
    (w, m, P), parent, detection, _ = posterior
    centres, S, _ = gates
    before, covariance = predict_all(belief[1], belief[2], motion[0], motion[1], motion[2])
    d, p = m.shape[1], len(R)
    out, L, y = np.zeros(6), np.zeros((p, p)), np.empty(p)
    for i in range(len(w)):
        j, h = detection[i], parent[i]
        if j >= 0:
            cholesky_into(L, S[h])
            out[0] += w[i]
            out[2] += w[i] * mahalanobis_squared(L, z[j], centres[h], y)
            for r in range(p):
                out[1] += w[i] * (z[j, r] - centres[h, r]) ** 2
                out[3] += w[i] * (S[h, r, r] - R[r, r])
        for r in range(d):
            for c in range(d):
                out[4] += w[i] * inverse[r, c] * (m[i, r] - before[h, r]) * (m[i, c] - before[h, c])
                out[5] += w[i] * inverse[r, c] * (P[i, c, r] - covariance[h, c, r])
    return out
