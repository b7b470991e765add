"""The adaptive MHT whose thresholds are set by a trained network at every scan."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import gmr_gym
from gmr_gym.checks import check_count
from gmr_gym.filters.mht import MAX_HYPOTHESES, expand_scan, gate_and_log_weights
from gmr_gym.filters.trace import Trace, origin_of_reduction, trace_of
from gmr_gym.filters.tracker import ONE_MODE, CompiledTracker, Report, check_scan
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.model import Model
from gmr_gym.reduction.merge_cost import total_cost
from gmr_gym.reduction.runnalls import Greedy
from gmr_gym.tuning.features import FEATURES, Memory, at_start, model_features, observe_into
from gmr_gym.tuning.network import Network, forward, load
from gmr_gym.tuning.thresholds import (
    DORTENZIO,
    REDUCERS,
    Thresholds,
    adapt,
    from_actions,
    threshold_index,
    to_action,
)

SHIPPED = Path(gmr_gym.__file__).parent / "data" / "policies" / "thresholds.npz"


class Belief(NamedTuple):
    """Hypotheses, and the features that carry over to the next scan.

    Attributes
    ----------
    mixture : Mixture
    memory : Memory
    """

    mixture: Mixture
    memory: Memory


@dataclass(frozen=True)
class LearnedThresholds:
    """D'Ortenzio's Adaptive with thresholds that a network computes from the full posterior of every scan.

    Parameters
    ----------
    model : Model
        The filter model.
    network : Network
        The policy.
    rest : Thresholds
        Values of the thresholds that the network does not set.

    Raises
    ------
    ValueError
        For a sensor that is not linear, and for a threshold out of range.
    """

    model: Model
    network: Network
    rest: Thresholds = DORTENZIO
    # constant arguments of `_scan`, as plain tuples, which enter compiled code sooner than NamedTuples
    _same: tuple[Any, ...] = field(init=False, repr=False, compare=False)

    def __post_init__(self):
        model = self.model
        if not isinstance(model.sensor, Sensor):
            raise ValueError("learned thresholds need a linear sensor of positions; the model has a radar")
        to_action(self.rest, ("components",))  # a limit out of range fails here rather than at a scan
        policy = *self.network.packed(), threshold_index(self.network.parameters), np.array(self.rest, float)
        same = model.motion[:], model.sensor[:], gate_and_log_weights(model), model_features(model), policy
        object.__setattr__(self, "_same", same)

    @property
    def compiled(self) -> CompiledTracker | None:
        """Its form for compiled loops; None for another class that inherits from this."""
        if type(self) is not LearnedThresholds:
            return None
        mixture, memory = self.init()
        return CompiledTracker(_compiled_scan, self._same, (mixture[:], memory[:]))

    def init(self) -> Belief:
        """Belief one period before the first scan."""
        return Belief(self.model.prior, at_start(self.model))

    def step(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        z = check_scan(z, len(self.model.sensor.H))
        gates, _, w, m, P, mean, covariance, given_up, work = _scan(
            belief.mixture[:], belief.memory[:], z, *self._same
        )
        mixture = Mixture(w, m, P)
        report = Report(mean[None], covariance[None], Gates(*gates), mixture)
        return Belief(mixture, Memory(len(w), given_up, work)), report

    def trace(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report, Trace]:
        """What `step` gives, and what became of every hypothesis with the scan."""
        scan = check_scan(z, len(self.model.sensor.H))
        full, _, row, _, _ = _expand_and_set(belief.mixture[:], belief.memory[:], scan, *self._same)
        alpha, prune_weight, density, components = row[:4].tolist()
        into = origin_of_reduction(
            full.mixture, Greedy(int(components), alpha), prune_weight, density, MAX_HYPOTHESES
        )
        return *self.step(belief, z), trace_of(full, into)


@kernel
def _scan(mixture, memory, z, motion, sensor, weights, known, policy):
    """A scan in one call: the fields of the gates, the detections in them, counted in each, and what `adapt`
    returns for the network's thresholds.

    The arguments are those of `_expand_and_set`.
    """
    full, gates, thresholds, cost, gated = _expand_and_set(
        mixture, memory, z, motion, sensor, weights, known, policy
    )
    w, m, P = full.mixture
    w, m, P, mean, covariance, given_up, work = adapt(w, m, P, thresholds, cost, gated)
    return gates, gated, w, m, P, mean, covariance, given_up, work


@kernel(inline="always")
def _expand_and_set(mixture, memory, z, motion, sensor, weights, known, policy):
    """The Expansion of a scan, the fields of the gates, the thresholds (4,) that the network sets, the cost
    of merging the full posterior, and the detections in the gates, counted in each.

    `weights` is `gate_and_log_weights`, `known` is `model_features`, and `policy` is the packed network, the
    indices of the thresholds that it sets, and the rest of them.
    """
    (threshold, log_miss, log_detect), (layout, numbers, set_by, rest) = weights, policy
    full, gates = expand_scan(mixture, motion, sensor, z, threshold, log_miss, log_detect)
    (w, m, P), _, detection, log_density = full
    merged, features = total_cost(w, m, P), np.empty(len(FEATURES))
    gated = observe_into(
        features, (w, detection, log_density), merged, gates[1], sensor[:2], log_detect, known, memory
    )
    single = features.astype(np.float32).astype(np.float64).reshape(1, -1)  # as in training
    return full, gates, from_actions(forward(single, layout, numbers), set_by, rest)[0], merged[0], gated


@kernel(inline="always")
def _compiled_scan(told, belief, z):
    """`LearnedThresholds.step`, see `CompiledTracker`."""
    mixture, memory = belief
    (centres, S, threshold), hits, w, m, P, mean, covariance, given_up, work = _scan(
        mixture, memory, z, *told
    )
    d = len(mean)
    report = Report(
        mean.reshape(1, d), covariance.reshape(1, d, d),
        Gates(centres, S, threshold), Mixture(w, m, P), True, ONE_MODE,
    )  # fmt: skip
    return ((w, m, P), (len(w), given_up, work)), report, hits


def learned_thresholds(
    model: Model, policy: str | Path | None = None, components: int = DORTENZIO.components
) -> LearnedThresholds:
    """MHT of up to `components` hypotheses whose thresholds are set by a network.

    Parameters
    ----------
    model : Model
        The filter model, of one motion and a linear sensor.
    policy : str or Path, optional
        File of the network as agents/export.py writes it; by default the one shipped with gmr_gym.
    components : int
        Most hypotheses after the reduction.

    Returns
    -------
    LearnedThresholds

    Raises
    ------
    ValueError
        For an invalid file, see `gmr_gym.tuning.network.load`, and for a model of another kind.
    """
    network = load(SHIPPED if policy is None else policy, FEATURES, REDUCERS["adaptive"])
    return LearnedThresholds(model, network, DORTENZIO._replace(components=check_count(components)))
