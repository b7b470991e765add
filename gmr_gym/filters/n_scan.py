"""The N-scan MHT: hypotheses with the detections of their last scans, merged by them."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from gmr_gym.checks import check_limits, check_not_negative
from gmr_gym.filters.histories import WithHistory
from gmr_gym.filters.mht import MAX_HYPOTHESES, expand_and_prune, gate_and_log_weights, predict_and_update
from gmr_gym.filters.trace import Trace, origin_of_reduction, trace_of
from gmr_gym.filters.tracker import ONE_MODE, CompiledTracker, Report, check_scan
from gmr_gym.kernels import ONE, kernel
from gmr_gym.linalg import root_determinants
from gmr_gym.mixture import Mixture, match, rescaled
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.model import Model, check_one_motion
from gmr_gym.reduction.n_scan import NScan, extended, inherited, merge_by_history
from gmr_gym.reduction.pruning import above_threshold, entering, heaviest_mask, select


@dataclass(frozen=True)
class NScanMht:
    """Gaussian-mixture MHT as `gmr_gym.baselines.mht.Mht`, reduced by what its hypotheses share of the last scans.

    Parameters
    ----------
    model : Model
        The filter model.
    reduce : NScan
        The reduction.
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.
    max_hypotheses : int
        Most hypotheses that enter the reduction; the heaviest are kept.

    References
    ----------
    Singer, Sea and Housewright 1974.
    """

    model: Model
    reduce: NScan
    prune_weight: float = 5e-4
    prune_density: float = 1e-10
    max_hypotheses: int = MAX_HYPOTHESES

    def __post_init__(self):
        check_one_motion(self.model)
        check_limits(self.prune_weight, self.max_hypotheses)
        check_not_negative("prune_density", self.prune_density)

    @property
    def compiled(self) -> CompiledTracker | None:
        """Its form for compiled loops; None for a radar, and for another class that inherits from this."""
        sensor = self.model.sensor
        if type(self) is not NScanMht or not isinstance(sensor, Sensor):
            return None
        mixture, history = self.init()
        return CompiledTracker(_scan, self._told(sensor), (mixture[:], history))

    def init(self) -> WithHistory:
        """Belief one period before the first scan."""
        prior = self.model.prior
        return WithHistory(prior, self.reduce.at_start(len(prior.w)))

    def step(self, belief: WithHistory, z: np.ndarray) -> tuple[WithHistory, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        sensor = self.model.sensor
        z = check_scan(z, len(sensor.H))
        if isinstance(sensor, Sensor):
            *reduced, gates, _ = scan_by_history(self._told(sensor), (belief.belief[:], belief.history), z)
        else:
            full, gates = predict_and_update(belief.belief, self.model, z)
            history = extended(belief.history, full.parent, full.detection)
            reduced = n_scan_estimate(*full.mixture, history, *self._limits())
        w, m, P, history, mean, covariance = reduced
        mixture = Mixture(w, m, P)
        return WithHistory(mixture, history), Report(mean, covariance, Gates(*gates), mixture)

    def trace(self, belief: WithHistory, z: np.ndarray) -> tuple[WithHistory, Report, Trace]:
        """What `step` gives, and what became of every hypothesis with the scan."""
        full, _ = predict_and_update(belief.belief, self.model, check_scan(z, len(self.model.sensor.H)))
        _, place = entering(full.mixture, self.prune_weight, self.max_hypotheses)
        history = extended(belief.history, full.parent, full.detection)[place >= 0]
        into = origin_of_reduction(
            full.mixture, partial(self.reduce, history=history),
            self.prune_weight, self.prune_density, self.max_hypotheses,
        )  # fmt: skip
        return *self.step(belief, z), trace_of(full, into)

    def _limits(self) -> tuple[float, int, int, float]:
        return (
            float(self.prune_weight), int(self.max_hypotheses), self.reduce.components,
            float(self.prune_density),
        )  # fmt: skip

    def _told(self, sensor: Sensor) -> tuple:
        return self.model.motion[:], sensor[:], gate_and_log_weights(self.model), self._limits()


@kernel
def scan_by_history(told, belief, z):
    """A scan by a linear sensor: what `n_scan_estimate` returns, the fields of the gates, and the detections
    in them, counted in each."""
    motion, sensor, weights, limits = told
    (w, m, P), history, gates, hits = expand_with_history(belief, motion, sensor, z, weights, *limits[:2])
    w, m, P, history, mean, covariance = n_scan_estimate(w, m, P, history, *limits)
    return w, m, P, history, mean, covariance, gates, hits


@kernel(inline="always")
def _scan(told, belief, z):
    """`NScanMht.step` for a linear sensor, see `CompiledTracker`."""
    w, m, P, history, mean, covariance, (centres, S, threshold), hits = scan_by_history(told, belief, z)
    report = Report(mean, covariance, Gates(centres, S, threshold), Mixture(w, m, P), True, ONE_MODE)
    return ((w, m, P), history), report, hits


@kernel
def expand_with_history(belief, motion, sensor, z, weights, prune_weight, max_hypotheses):
    """`expand_and_prune` of a mixture and its history, both in `belief`: the fields of a Mixture, not
    normalised, their history, the fields of the Gates, and the number of detections in them."""
    mixture, history = belief
    likely, gates, hits, parent, detection = expand_and_prune(
        mixture, motion, sensor, z, weights, prune_weight, max_hypotheses
    )
    return likely, extended(history, parent, detection), gates, hits


@kernel
def n_scan_estimate(w, m, P, history, prune_weight, max_hypotheses, components, density):
    """The reduced w, m, P and history of `n_scan_reduce`, and their mean (1, d) and covariance (1, d, d)."""
    w, m, P, history, _ = n_scan_reduce(
        (w, m, P), history, history.shape[1], prune_weight, max_hypotheses, components, density
    )
    _, mean, covariance = match(w, m, P, np.zeros(len(w), np.int64), ONE)
    return w, m, P, history, mean, covariance


@kernel(inline="always")
def n_scan_reduce(mixture, history, scans, prune_weight, max_hypotheses, components, density):
    """Prune by weight, merge by the first `scans` columns of the history and prune by density (see
    `gmr_gym.filters.mht.prune_and_reduce`).

    Returns the reduced w, m, P and history, and the work, see `gmr_gym.reduction.n_scan.merge_by_history`.
    """
    w, m, P = mixture
    kept = heaviest_mask(w, max_hypotheses) & above_threshold(w, w, prune_weight)
    if kept.sum() < len(w):
        before = w
        w, m, P, origin = select(w, m, P, kept)
        history = inherited(history, before, origin, len(w))
    before = w = rescaled(w)
    w, m, P, origin, work = merge_by_history(w, m, P, history, scans, components)
    history = inherited(history, before, origin, len(w))
    before = w = rescaled(w)
    w, m, P, origin = select(w, m, P, above_threshold(w, w / root_determinants(P), density))
    history = inherited(history, before, origin, len(w))
    return rescaled(w), m, P, history, work
