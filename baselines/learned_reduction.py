"""An MHT whose reduction thresholds and assumed noise are set by a trained network at every scan."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import gmr_gym
from gmr_gym.checks import check_choice, check_count, check_not_negative
from gmr_gym.filters.mht import MAX_HYPOTHESES
from gmr_gym.filters.trace import Trace, trace_of
from gmr_gym.filters.tracker import ONE_MODE, CompiledTracker, Report, check_scan
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.model import Model, check_one_motion
from gmr_gym.reduction.n_scan import extended
from gmr_gym.reduction.pruning import above_threshold, heaviest_mask
from gmr_gym.tuning.assumed import assumed, every, processed, selected
from gmr_gym.tuning.features import at_start
from gmr_gym.tuning.network import Network, forward, load
from gmr_gym.tuning.recent import ALL_FEATURES, at_first
from gmr_gym.tuning.thresholds import (
    DEPTH,
    DORTENZIO,
    FACTORS,
    PRUNE,
    REDUCERS,
    from_actions,
    from_row,
    origin_in,
    reduced,
    threshold_index,
    to_action,
)

SHIPPED = Path(gmr_gym.__file__).parent / "data" / "policies"  # one for each reducer


class Belief(NamedTuple):
    """Hypotheses, and what carries over to the next scan.

    Attributes
    ----------
    mixture : Mixture
    history : ndarray of int (n, DEPTH)
        Last detections of every hypothesis, see `gmr_gym.reduction.n_scan.extended`.
    thresholds : ndarray (11,)
        As `gmr_gym.tuning.thresholds.Thresholds`: its factors hold for the next scan.
    memory : tuple
        The fields of `gmr_gym.tuning.features.Memory`.
    recent : ndarray (13,)
        Of `gmr_gym.tuning.recent.observe_recent_into`.
    """

    mixture: Mixture
    history: np.ndarray
    thresholds: np.ndarray
    memory: tuple[int, float, int]
    recent: np.ndarray


@dataclass(frozen=True)
class LearnedReduction:
    """A reduction with thresholds, and factors on the assumed noise, that a network computes from the full
    posterior of every scan.

    Parameters
    ----------
    model : Model
        The filter model.
    network : Network
        The policy.
    price : float
        Of a unit of work, which the network is shown.
    reducer : str
        One of `gmr_gym.tuning.thresholds.REDUCERS`.
    components : int
        Most hypotheses after the reduction, where the network does not set it.

    Raises
    ------
    ValueError
        For a sensor that is not linear, more than one motion, an unknown reducer, and a limit or price out of
        range.
    """

    model: Model
    network: Network
    price: float
    reducer: str = "n-scan"
    components: int = DORTENZIO.components
    # constant arguments of `_scan`, as plain tuples, which enter compiled code sooner than NamedTuples
    _same: tuple[Any, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        check_one_motion(self.model)
        if not isinstance(self.model.sensor, Sensor):
            raise ValueError("learned thresholds need a linear sensor of positions; the model has a radar")
        price = check_not_negative("price", self.price)
        check_choice("reducer", self.reducer, tuple(REDUCERS))
        rest = DORTENZIO._replace(components=check_count(self.components))
        to_action(rest, ("components",))  # a limit out of range fails here rather than at a scan
        policy = *self.network.packed(), threshold_index(self.network.parameters), np.array(rest, float)
        reducer = tuple(REDUCERS).index(self.reducer)
        object.__setattr__(self, "_same", (assumed(self.model), policy, price, reducer))

    @property
    def compiled(self) -> CompiledTracker | None:
        """Its form for compiled loops; None for another class that inherits from this."""
        if type(self) is not LearnedReduction:
            return None
        start = self.init()
        return CompiledTracker(_compiled_scan, self._same, (start.mixture[:], *start[1:]))

    def init(self) -> Belief:
        """Belief one period before the first scan."""
        model = self.model
        recent = at_first(1 - model.detection_probability * model.gate_probability)
        history = np.zeros((len(model.prior.w), DEPTH), np.int64)
        rest = DORTENZIO._replace(components=self.components)
        return Belief(model.prior, history, np.array(rest, float), at_start(model)[:], recent)

    def step(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        z = check_scan(z, len(self.model.sensor.H))
        plain = belief.mixture[:], *belief[1:]
        gates, _, mean, covariance, (left, *rest) = _scan(plain, z, *self._same)
        mixture = Mixture(*left)
        return Belief(mixture, *rest), Report(mean, covariance, Gates(*gates), mixture)

    def trace(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report, Trace]:
        """What `step` gives, and what became of every hypothesis with the scan."""
        after, report = self.step(belief, z)
        told, _, price, _ = self._same
        hypotheses, *_ = processed(
            (belief.mixture[:], belief.history), check_scan(z, len(self.model.sensor.H)), told,
            belief.thresholds, belief.memory, belief.recent.copy(), price, True,
        )  # fmt: skip
        full = every(hypotheses)
        history = extended(belief.history, full.parent, full.detection)
        into = origin_in(self.reducer, full.mixture, history, from_row(after.thresholds))
        return after, report, trace_of(full, into)


@kernel
def _scan(belief, z, told, policy, price, reducer):
    """A scan in one call: the fields of the gates, the detections in them, counted in each, the mean (1, d)
    and covariance (1, d, d) of the result, and the belief, its fields and theirs as plain tuples.

    `told` is what `assumed` returns, and `policy` is the packed network, the indices of what it sets, and the
    rest of the thresholds; the reducer is a place among `REDUCERS`.
    """
    mixture, history, thresholds, memory, recent = belief
    layout, numbers, set_by, rest = policy
    recent = recent.copy()
    hypotheses, gates, features, cost, gated = processed(
        (mixture, history), z, told, thresholds, memory, recent, price, True
    )
    for f in range(len(features)):
        features[f] = np.float32(features[f])  # as in training
    thresholds = from_actions(forward(features.reshape(1, -1), layout, numbers), set_by, rest)[0]
    kept = heaviest_mask(hypotheses[0], np.int64(MAX_HYPOTHESES))
    kept &= above_threshold(hypotheses[0], hypotheses[0], thresholds[PRUNE])
    w, m, P, parent, detection = selected(hypotheses, kept)
    history = extended(history, parent, detection)
    w, m, P, mean, covariance, relative_loss, work, history = reduced(
        reducer, w, m, P, history, thresholds, cost, gated
    )
    after = (w, m, P), history, thresholds, (len(w), relative_loss, work), recent
    d = len(mean)
    return gates, gated, mean.reshape(1, d), covariance.reshape(1, d, d), after


@kernel(inline="always")
def _compiled_scan(told, belief, z):
    """`LearnedReduction.step`, see `CompiledTracker`."""
    (centres, S, threshold), hits, mean, covariance, after = _scan(belief, z, *told)
    w, m, P = after[0]
    report = Report(mean, covariance, Gates(centres, S, threshold), Mixture(w, m, P), True, ONE_MODE)
    return after, report, hits


def price_of(work: float, file: Path) -> float:
    """The price of work at which the policy in the file does so much a scan, by the table of both beside it.

    Raises
    ------
    ValueError
        Naming the table where there is none or no sound one, or the work where no price in it leads there.
    """
    work, table = check_not_negative("work", work), file.with_suffix(".csv")
    try:
        prices, works = np.loadtxt(table, delimiter=",", skiprows=1, unpack=True, ndmin=2)
    except (OSError, ValueError) as error:
        raise ValueError(f"work needs the table {table}, which agents/export.py writes: {error}") from None
    if not ((0 < prices) & (prices < np.inf) & (0 < works) & (works < np.inf)).all():
        raise ValueError(f"{table} must have positive finite prices and works")
    if not works.min() <= work <= works.max():
        raise ValueError(f"work must lie in [{works.min():.3g}, {works.max():.3g}], got {work}")
    order = np.argsort(works, kind="stable")
    return float(np.exp(np.interp(np.log(work), np.log(works[order]), np.log(prices[order]))))


def learned_n_scan(
    model: Model,
    policy: str | Path | None = None,
    price: float | None = None,
    work: float | None = None,
    components: int = DORTENZIO.components,
) -> LearnedReduction:
    """N-scan MHT whose thresholds and assumed process noise are set by a network, the thriftier the dearer
    work is.

    Parameters
    ----------
    model : Model
        The filter model, of one motion and a linear sensor.
    policy : str or Path, optional
        File of the network as agents/export.py writes it; by default the one shipped with gmr_gym.
    price : float, optional
        Of a unit of work, in losses of a scan; 1e-4 unless given. The one shipped was trained with 1e-5 to
        1e-2.
    work : float, optional
        Of a scan, on average over the instances of VALID: instead of the price that leads there.
    components : int
        Most hypotheses after the reduction, where the network does not set it.

    Returns
    -------
    LearnedReduction

    Raises
    ------
    ValueError
        For an invalid file, see `gmr_gym.tuning.network.load`, for a model of another kind, and for price and
        work given both.
    """
    return _learned("n-scan", model, policy, price, work, components)


def learned_cluster(
    model: Model,
    policy: str | Path | None = None,
    price: float | None = None,
    work: float | None = None,
    components: int = DORTENZIO.components,
) -> LearnedReduction:
    """MHT reduced by clustering, whose distance, other thresholds and assumed process noise are set by a
    network.

    Parameters, what is returned and raised are those of `learned_n_scan`; the policy that is shipped was
    trained with prices of 1e-5 to 3e-2.
    """
    return _learned("cluster", model, policy, price, work, components)


def _learned(
    reducer: str,
    model: Model,
    policy: str | Path | None,
    price: float | None,
    work: float | None,
    components: int,
) -> LearnedReduction:
    file = SHIPPED / f"{reducer}.npz" if policy is None else Path(policy)
    if work is not None:
        if price is not None:
            raise ValueError("give price or work, not both")
        price = price_of(work, file)
    network = load(file, ALL_FEATURES, (*REDUCERS[reducer], *FACTORS))
    return LearnedReduction(model, network, 1e-4 if price is None else price, reducer, components)
