"""The MHT whose process noise is estimated from its innovations."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_choice
from gmr_gym.filters.adaptive_noise import Innovations, Noise, NoiseEstimator, Traces, innovations
from gmr_gym.filters.association import Expansion
from gmr_gym.filters.mht import expand_scan, gate_and_log_weights
from gmr_gym.filters.trace import Trace, trace_of
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.model import Model
from gmr_gym.reduction.n_scan import MISSED, extended
from gmr_gym.tuning.thresholds import DEPTH, DORTENZIO, REDUCERS, Thresholds, origin_in, reduced, to_action


class Belief(NamedTuple):
    """Hypotheses, the process noise of the scan to come, and the work of the last scan.

    Attributes
    ----------
    mixture : Mixture
    history : ndarray of int, shape (n, N)
        Detections of every hypothesis, the latest first.
    noise : Noise
    work : int
        As of `gmr_gym.tuning.thresholds.reduced`.
    """

    mixture: Mixture
    history: np.ndarray
    noise: Noise
    work: int


@dataclass(frozen=True)
class AdaptiveNoise:
    """MHT with a factor on the process noise, or on the covariance that is predicted.

    Parameters
    ----------
    model : Model
        The filter model.
    estimator : NoiseEstimator
        How the factors follow the innovations.
    reducer : str
        One of `gmr_gym.tuning.thresholds.REDUCERS`.
    thresholds : Thresholds
        Of the reduction.

    Raises
    ------
    ValueError
        For a sensor that is not linear, an unknown reducer, and a limit of hypotheses out of range.
    """

    model: Model
    estimator: NoiseEstimator
    reducer: str = "adaptive"
    thresholds: Thresholds = DORTENZIO
    _traces: Traces = field(init=False, repr=False, compare=False)
    _inverse: np.ndarray = field(init=False, repr=False, compare=False)  # pseudo-inverse of Q

    def __post_init__(self) -> None:
        sensor, Q = self.model.sensor, self.model.motion.Q
        if not isinstance(sensor, Sensor):
            raise ValueError("adaptive noise needs a linear sensor of positions; the model has a radar")
        check_choice("reducer", self.reducer, tuple(REDUCERS))
        to_action(self.thresholds, ("components",))  # a limit out of range fails here rather than at a scan
        H, R = sensor.H, sensor.R
        traces = Traces(np.trace(R), np.trace(H @ Q @ H.T), int(np.linalg.matrix_rank(Q)), len(R))
        object.__setattr__(self, "_traces", traces)
        object.__setattr__(self, "_inverse", np.linalg.pinv(Q, hermitian=True))

    def init(self) -> Belief:
        """Belief one period before the first scan."""
        history = np.full((len(self.model.prior.w), DEPTH), MISSED)
        return Belief(self.model.prior, history, self.estimator.at_start(self._traces.sensor), 0)

    def step(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        z = check_scan(z, len(self.model.sensor.H))
        before, motion = self._under_noise(belief)
        full, gates, history = self._expanded(belief, z)
        R = self.model.sensor.R
        scan = Innovations(*innovations(before, motion, full, gates, z, R, self._inverse).tolist())
        gated = int((full.detection >= 0).sum())
        w, m, P, mean, covariance, _, work, history = reduced(
            list(REDUCERS).index(self.reducer), *full.mixture, history, np.array(self.thresholds), 0.0, gated
        )
        left = Mixture(w, m, P)
        after = Belief(left, history, self.estimator.after(belief.noise, scan, self._traces), work)
        return after, Report(mean[None], covariance[None], Gates(*gates), left)

    def trace(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report, Trace]:
        """What `step` gives, and what became of every hypothesis with the scan."""
        full, _, history = self._expanded(belief, check_scan(z, len(self.model.sensor.H)))
        into = origin_in(self.reducer, full.mixture, history, self.thresholds)
        return *self.step(belief, z), trace_of(full, into)

    def _under_noise(self, belief: Belief) -> tuple[tuple, tuple]:
        """Fields of the mixture and of the motion, with the factors of the scan."""
        (w, m, P), (F, Q, offset), noise = belief.mixture, self.model.motion, belief.noise
        return (w, m, noise.fading * P), (F, noise.factor * Q, offset)

    def _expanded(self, belief: Belief, z: np.ndarray) -> tuple[Expansion, tuple, np.ndarray]:
        """The full posterior, the fields of the gates, and the history of the hypotheses."""
        sensor = self.model.sensor
        full, gates = expand_scan(
            *self._under_noise(belief), (sensor.H, sensor.R), z, *gate_and_log_weights(self.model)
        )
        return full, gates, extended(belief.history, full.parent, full.detection)


def adaptive_noise(
    model: Model,
    components: int = 30,
    loss_bound: float = 0.05,
    prune_weight: float = 5e-4,
    prune_density: float = 1e-10,
    reducer: str = "adaptive",
    history: int = 2,
    distance: float = 4.0,
    *,
    method: str = NoiseEstimator.method,
    factor: float = NoiseEstimator.factor,
    memory: float = NoiseEstimator.memory,
    low: float = NoiseEstimator.low,
    high: float = NoiseEstimator.high,
    threshold: float = NoiseEstimator.threshold,
    fading: float = NoiseEstimator.fading,
) -> AdaptiveNoise:
    """MHT whose process noise follows its innovations.

    Parameters
    ----------
    model : Model
        The filter model, of one motion and a linear sensor.
    components : int
        Most hypotheses after the reduction.
    loss_bound : float
        alpha of the reducer "adaptive", in [0, 1].
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.
    reducer : str
        One of `gmr_gym.tuning.thresholds.REDUCERS`.
    history : int
        N of the reducer "n-scan".
    distance : float
        Of the reducer "cluster", squared.
    method, factor, memory, low, high, threshold, fading
        See `gmr_gym.filters.adaptive_noise.NoiseEstimator`.

    Returns
    -------
    AdaptiveNoise
    """
    estimator = NoiseEstimator(method, factor, memory, low, high, threshold, fading)
    thresholds = Thresholds(loss_bound, prune_weight, prune_density, components, history, distance)
    return AdaptiveNoise(model, estimator, reducer, thresholds)
