"""The Gaussian-mixture MHT of one target: expand, prune, reduce, prune again.

D'Ortenzio, sections 2.1, 3 and 4.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from gmr_gym.checks import UNLIMITED, check_count, check_limits
from gmr_gym.filters.mht import (
    ESTIMATE_SCAN,
    MAX_HYPOTHESES,
    estimate_clustered_scan,
    estimate_scan,
    expand_and_prune,
    gate_and_log_weights,
    predict_and_prune,
    predict_and_update,
    reduce_and_estimate,
)
from gmr_gym.filters.n_scan import NScanMht
from gmr_gym.filters.trace import Trace, origin_of_reduction, trace_of
from gmr_gym.filters.tracker import ONE_MODE, CompiledTracker, Report, check_scan
from gmr_gym.kernels import compile_ahead, kernel
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.model import Model, check_one_motion
from gmr_gym.reduction import ise as williams
from gmr_gym.reduction import salmond_west
from gmr_gym.reduction.heaviest_first import Clustering, clustering
from gmr_gym.reduction.n_scan import NScan
from gmr_gym.reduction.protocol import Reduced, check_reduced
from gmr_gym.reduction.registry import compilable, hypothesis_reducer
from gmr_gym.reduction.runnalls import Greedy, greedy


@dataclass(frozen=True)
class Mht:
    """Gaussian-mixture MHT: every hypothesis with every gated detection, then SP, `reduce` and NWP.

    Weights are normalised after each step.

    Parameters
    ----------
    model : Model
        The filter model.
    reduce : callable
        A reduction of a Mixture.
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.
    max_hypotheses : int
        Most hypotheses that enter `reduce`; the heaviest are kept.

    References
    ----------
    D'Ortenzio, section 4.
    """

    model: Model
    reduce: Callable[[Mixture], Reduced]
    prune_weight: float = 5e-4
    prune_density: float = 1e-10
    max_hypotheses: int = MAX_HYPOTHESES

    def __post_init__(self):
        check_one_motion(self.model)
        check_limits(self.prune_weight, self.max_hypotheses)
        if not 0 <= self.prune_density < np.inf:
            raise ValueError(f"prune_density must be non-negative and finite, got {self.prune_density}")
        if isinstance(self.reduce, Greedy):
            compile_ahead(estimate_scan, ESTIMATE_SCAN)
        else:
            # wrong parameters fail here rather than at a scan
            check_reduced(self.reduce(collapsed(self.model.prior)), 1)

    @property
    def compiled(self) -> CompiledTracker | None:
        """Its form for compiled loops; None for a radar, for a reduction other than Greedy or Clustering, and
        for another class that inherits from this."""
        model, reduce = self.model, self.reduce
        if type(self) is not Mht or not isinstance(model.sensor, Sensor):
            return None
        if isinstance(reduce, Greedy):
            scan, threshold = _scan, reduce.loss_bound
        elif isinstance(reduce, Clustering):
            scan, threshold = _clustered_scan, reduce.distance
        else:
            return None
        limits = (
            float(self.prune_weight), int(self.max_hypotheses),
            reduce.components, threshold, float(self.prune_density),
        )  # fmt: skip
        told = model.motion[:], model.sensor[:], gate_and_log_weights(model), limits
        return CompiledTracker(scan, told, self.init()[:])

    def init(self) -> Mixture:
        """Belief one period before the first scan."""
        return self.model.prior

    def step(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        z = check_scan(z, len(self.model.sensor.H))
        likely, gates = predict_and_prune(belief, self.model, z, self.prune_weight, self.max_hypotheses)
        posterior, mean, covariance = reduce_and_estimate(
            likely, self.reduce, self.prune_weight, self.prune_density, self.max_hypotheses
        )
        return posterior, Report(mean, covariance, gates, posterior)

    def trace(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report, Trace]:
        """What `step` gives, and what became of every hypothesis with the scan."""
        full, _ = predict_and_update(belief, self.model, check_scan(z, len(self.model.sensor.H)))
        into = origin_of_reduction(
            full.mixture, self.reduce, self.prune_weight, self.prune_density, self.max_hypotheses
        )
        return *self.step(belief, z), trace_of(full, into)


@kernel(inline="always")
def _scan(told, belief, z):
    """`Mht.step` for a linear sensor and Greedy, see `CompiledTracker`."""
    motion, sensor, weights, limits = told
    (w, m, P), gates, hits, _, _ = expand_and_prune(belief, motion, sensor, z, weights, *limits[:2])
    return _reported(estimate_scan(w, m, P, *limits), gates, hits)


@kernel(inline="always")
def _clustered_scan(told, belief, z):
    """`Mht.step` for a linear sensor and Clustering, see `CompiledTracker`."""
    motion, sensor, weights, limits = told
    (w, m, P), gates, hits, _, _ = expand_and_prune(belief, motion, sensor, z, weights, *limits[:2])
    return _reported(estimate_clustered_scan(w, m, P, *limits), gates, hits)


@kernel(inline="always")
def _reported(reduced, gates, hits):
    """What a compiled scan returns of the reduced hypotheses and their moments."""
    (w, m, P, mean, covariance), (centres, S, threshold) = reduced, gates
    report = Report(mean, covariance, Gates(centres, S, threshold), Mixture(w, m, P), True, ONE_MODE)
    return (w, m, P), report, hits


def mht(
    model: Model,
    components: int = 30,
    reduction: str = "runnalls",
    prune_weight: float = 5e-4,
    prune_density: float = 1e-10,
) -> Mht | NScanMht:
    """MHT reduced to `components` by any reduction.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    reduction : str
        Name of a reduction, see `gmr_gym.reduction.registry`, as it is or with parameters of its own:
        "salmond:distance=0.1"; or "n-scan:scans=2".
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.

    Returns
    -------
    Mht or NScanMht
    """
    reduce = compilable(hypothesis_reducer(reduction, components))
    if isinstance(reduce, NScan):
        return NScanMht(model, reduce, prune_weight, prune_density)
    return Mht(model, reduce, prune_weight, prune_density)


def capping(model: Model, components: int = 30, prune_weight: float = 0.0, prune_density: float = 0.0) -> Mht:
    """MHT that keeps the heaviest `components` hypotheses, without other pruning.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.

    Returns
    -------
    Mht

    Notes
    -----
    Pruning is off by default: the paper's changes of gamma do not apply to its capping.

    References
    ----------
    D'Ortenzio, Capping.
    """
    max_hypotheses = min(check_count(components), MAX_HYPOTHESES)
    return Mht(
        model, Greedy(UNLIMITED), prune_weight, prune_density, max_hypotheses
    )  # Greedy without a limit merges nothing


def runnalls(
    model: Model, components: int = 30, prune_weight: float = 5e-4, prune_density: float = 1e-10
) -> Mht:
    """MHT reduced to `components` by Runnalls' greedy merging.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.

    Returns
    -------
    Mht

    References
    ----------
    D'Ortenzio, Runnalls.

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.mixture import gaussian
    >>> from gmr_gym.models import constant_velocity, model, position_sensor
    >>> prior = gaussian(np.zeros(4), np.diag([100.0, 100.0, 25.0, 25.0]))
    >>> assumed = model(constant_velocity(1.0, 0.5), position_sensor(10.0), 0.9, 0.99, 1e-5, prior)
    >>> tracker = runnalls(assumed, components=5)
    >>> belief, report = tracker.step(tracker.init(), np.array([[10.0, 0.0]]))
    >>> report.x.round(1).tolist()
    [[5.5, 0.0, 1.1, 0.0]]
    """
    return Mht(model, Greedy(check_count(components)), prune_weight, prune_density)


def adaptive(
    model: Model,
    components: int | None = 30,
    loss_bound: float = 0.05,
    prune_weight: float = 5e-4,
    prune_density: float = 1e-10,
) -> Mht:
    """MHT merged while the relative loss stays within `loss_bound`, and further down to `components`.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int or None
        Most hypotheses after the reduction; None for no limit.
    loss_bound : float
        alpha, in [0, 1].
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.

    Returns
    -------
    Mht

    References
    ----------
    D'Ortenzio, Adaptive.
    """
    return Mht(model, greedy(components, loss_bound), prune_weight, prune_density)


def cluster(
    model: Model,
    components: int | None = None,
    distance: float = 4.0,
    prune_weight: float = 5e-4,
    prune_density: float = 1e-10,
) -> Mht:
    """MHT whose heaviest hypothesis takes in all within `distance` of it, then the heaviest of the rest.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int or None
        Most hypotheses after the reduction; None for no limit.
    distance : float
        Squared Mahalanobis distance by the covariance of the heaviest.
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.

    Returns
    -------
    Mht

    References
    ----------
    Salmond 1990, section 4.2.
    """
    limit = UNLIMITED if components is None else components
    return Mht(model, clustering(limit, distance), prune_weight, prune_density)


def n_scan(
    model: Model,
    components: int | None = None,
    scans: int = 2,
    prune_weight: float = 5e-4,
    prune_density: float = 1e-10,
) -> NScanMht:
    """MHT that merges the hypotheses with the same detections in the last `scans` scans.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int or None
        Most hypotheses after the reduction: beyond it pairs are merged by cost B. None for no limit.
    scans : int
        N. With 0 all hypotheses are merged, as in a PDA.
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.

    Returns
    -------
    NScanMht

    References
    ----------
    Singer, Sea and Housewright 1974.
    """
    limit = UNLIMITED if components is None else check_count(components)
    return NScanMht(model, NScan(limit, scans), prune_weight, prune_density)


def ise(model: Model, components: int = 15, prune_weight: float = 5e-4, prune_density: float = 1e-10) -> Mht:
    """MHT reduced to `components` by Williams' integral squared error, merging and deleting.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.

    Returns
    -------
    Mht
    """
    merging = partial(williams.integral_squared_error, components=components)
    return Mht(model, merging, prune_weight, prune_density)


def salmond(
    model: Model, components: int = 30, prune_weight: float = 5e-4, prune_density: float = 1e-10
) -> Mht:
    """MHT reduced to `components` by Salmond's joining.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.

    Returns
    -------
    Mht
    """
    return Mht(model, partial(salmond_west.salmond, components=components), prune_weight, prune_density)


def west(model: Model, components: int = 30, prune_weight: float = 5e-4, prune_density: float = 1e-10) -> Mht:
    """MHT reduced to `components` by West's merging of the lightest into its nearest.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    prune_weight : float
        gamma: hypotheses of less weight are pruned before the reduction.
    prune_density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned after it;
        in s^2/m^4 for a planar position and velocity.

    Returns
    -------
    Mht
    """
    return Mht(model, partial(salmond_west.west, components=components), prune_weight, prune_density)
