"""Joint gating of components of different motion models, and when to give a track up."""

from dataclasses import dataclass

import numpy as np

from gmr_gym.checks import check_limits
from gmr_gym.filters.association import Expansion, expand
from gmr_gym.mixture import Mixture, joined, take
from gmr_gym.models.gating import Gates, gated_distances, gates, volumes
from gmr_gym.models.kalman import predict
from gmr_gym.models.model import Model


@dataclass(frozen=True)
class Limits:
    """Limits of the work of a tracker with modes.

    Parameters
    ----------
    prune_weight : float
        Hypotheses of less weight are pruned before the reduction.
    max_hypotheses : int
        Most hypotheses that enter the reduction, whose work may grow as their square; the heaviest are kept.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).

    Raises
    ------
    ValueError
        Naming the first invalid limit.
    """

    prune_weight: float = 1e-5
    max_hypotheses: int = 500
    give_up_ratio: float = 20.0

    def __post_init__(self) -> None:
        check_limits(self.prune_weight, self.max_hypotheses, self.give_up_ratio)


def expand_jointly(
    predicted: Mixture, model: Model, z: np.ndarray, give_up_limit: float
) -> tuple[Expansion, np.ndarray, Gates, bool]:
    """Expand components of different motion models with one common list of detections.

    Components whose likelihoods are compared must account for the same detections; see
    `association.expand`.

    Parameters
    ----------
    predicted : Mixture
        Components of all modes.
    model : Model
    z : ndarray, shape (k, p)
        Detections.
    give_up_limit : float
        See `gate_jointly`.

    Returns
    -------
    expansion : Expansion
        Its `detection` counts those that are near alone.
    near : ndarray of bool, shape (k,)
        Which detections are in the gate of any component, see `gate_jointly`.
    gates_used : Gates
    alive : bool
        False where the track is to be given up.
    """
    own, near, gates_used, alive = gate_jointly(predicted, model, z, give_up_limit)
    posterior = expand(
        predicted, own, model.sensor, z[near],
        model.detection_probability, model.gate_probability, model.clutter_density,
    )  # fmt: skip
    return posterior, near, gates_used, alive


def gate_jointly(
    predicted: Mixture, model: Model, z: np.ndarray, give_up_limit: float
) -> tuple[Gates, np.ndarray, Gates, bool]:
    """Find the detections in any component's gate.

    Where more than `give_up_limit` false alarms are expected within one standard deviation of the
    predictions the track is to be given up: nothing is gated, which bounds the work on a lost track.

    Parameters
    ----------
    predicted : Mixture
        Components of all modes.
    model : Model
    z : ndarray, shape (k, p)
        Detections.
    give_up_limit : float
        Expected false alarms, see `give_up_limit`.

    Returns
    -------
    unbounded : Gates
        Gates without a threshold for every component.
    near : ndarray of bool, shape (k,)
        Which detections are in the gate of any component of positive weight.
    gates_used : Gates
        Gates of the components of positive weight.
    alive : bool
        False where the track is to be given up.
    """
    own = gates(predicted, model.sensor, model.gate_probability)
    possible = predicted.w > 0  # an impossible mode has no gate
    gates_used = own if possible.all() else Gates(own.z[possible], own.S[possible], own.threshold)
    density = model.sensor.density(model.clutter_density, own.z)
    alive = expected_false_alarms(own, predicted.w, density) <= give_up_limit
    near = np.zeros(len(z), bool)
    if alive:
        distances = gated_distances(take(predicted, possible), gates_used, model.sensor, z)
        near = np.isfinite(distances).any(axis=0)
    return own._replace(threshold=np.inf), near, gates_used, alive


def give_up_limit(model: Model, ratio: float) -> float:
    """Expected false alarms within one standard deviation at which a tracker gives up.

    Parameters
    ----------
    model : Model
    ratio : float
        Multiple of max(1, the expected number at the first scan).

    Returns
    -------
    float
    """
    moved = joined([predict(model.prior, motion) for motion in model.motions])
    w = np.outer(model.switching @ model.mode_prior, model.prior.w).ravel()
    gates_used = gates(moved, model.sensor, 1.0)
    density = model.sensor.density(model.clutter_density, gates_used.z)
    return ratio * max(1.0, expected_false_alarms(gates_used, w, density))


def expected_false_alarms(gates: Gates, w: np.ndarray, clutter_density: float | np.ndarray) -> float:
    """Expected false alarms within one standard deviation of a prediction: a measure of uncertainty.

    It does not depend on the gate threshold.

    Parameters
    ----------
    gates : Gates
    w : ndarray, shape (n,)
        Weights of the components, by which the number is averaged.
    clutter_density : float or ndarray of shape (n,)
        Clutter density everywhere, or at each gate.

    Returns
    -------
    float
    """
    return float((w * clutter_density) @ volumes(gates._replace(threshold=1.0)) / w.sum())
