"""One list of detections for components of unlike motions, and when to give a target up."""

import numpy as np

from gmr_gym.filters.association import Expansion, expand
from gmr_gym.mixture import Mixture, joined, take
from gmr_gym.models.gating import Gates, gated_distances, gates, volumes
from gmr_gym.models.kalman import predict
from gmr_gym.models.model import Model


def expand_jointly(
    predicted: Mixture, model: Model, z: np.ndarray, give_up_limit: float
) -> tuple[Expansion, Gates, bool]:
    """`expand` of components of unlike motions, which are to be weighed against each other and so have one
    list of detections to explain, that of `gate_jointly`; the gates looked through, and whether there is
    hope."""
    own, listed, gates_used, alive = gate_jointly(predicted, model, z, give_up_limit)
    posterior = expand(
        predicted, own, model.sensor, listed,
        model.detection_probability, model.gate_probability, model.clutter_density,
    )  # fmt: skip
    return posterior, gates_used, alive


def gate_jointly(
    predicted: Mixture, model: Model, z: np.ndarray, give_up_limit: float
) -> tuple[Gates, np.ndarray, Gates, bool]:
    """Unbounded gates for every component, the detections of z (k, p) that lie in any component's gate, the
    gates used, and False where the track is to be given up: where more than `give_up_limit` false alarms are
    expected within one standard deviation of the predictions nothing is gated, which bounds the work on a
    track that is lost."""
    own = gates(predicted, model.sensor, model.gate_probability)
    possible = predicted.w > 0  # an impossible mode looks nowhere
    gates_used = own if possible.all() else Gates(own.z[possible], own.S[possible], own.threshold)
    density = model.sensor.density(model.clutter_density, own.z)
    alive = expected_false_alarms(own, predicted.w, density) <= give_up_limit
    near = np.zeros(len(z), bool)
    if alive:
        distances = gated_distances(take(predicted, possible), gates_used, model.sensor, z)
        near = np.isfinite(distances).any(axis=0)
    return own._replace(threshold=np.inf), z[near], gates_used, alive


def give_up_limit(model: Model, ratio: float) -> float:
    """False detections expected within one deviation of its predictions at which a tracker gives up:
    `times` as many as at the first scan, and as one."""
    moved = joined([predict(model.prior, motion) for motion in model.motions])
    w = np.outer(model.switching @ model.mode_prior, model.prior.w).ravel()
    gates_used = gates(moved, model.sensor, 1.0)
    density = model.sensor.density(model.clutter_density, gates_used.z)
    return ratio * max(1.0, expected_false_alarms(gates_used, w, density))


def expected_false_alarms(gates: Gates, w: np.ndarray, clutter_density: float | np.ndarray) -> float:
    """False detections expected within one standard deviation of a prediction, on average over
    components of weights w (n,): how unsure of its target a tracker is, whatever the size of its gates.
    The density is one for all, or (n,), that at each gate."""
    return float((w * clutter_density) @ volumes(gates._replace(threshold=1.0)) / w.sum())
