"""One list of detections for components of unlike motions, and when to give a target up."""

import numpy as np

from gmr_gym.filters.association import Expansion, expand
from gmr_gym.mixture import Mixture, joined, take
from gmr_gym.models.gating import Gates, distances_seen, gates, volumes
from gmr_gym.models.kalman import predict
from gmr_gym.models.model import Model


def expand_together(
    predicted: Mixture, model: Model, z: np.ndarray, hopeless: float
) -> tuple[Expansion, Gates, bool]:
    """`expand` of components of unlike motions, which are to be weighed against each other and so have one
    list of detections to explain, that of `look_together`; the gates looked through, and whether there is
    hope."""
    own, listed, looked, alive = look_together(predicted, model, z, hopeless)
    posterior = expand(
        predicted, own, model.sensor, listed,
        model.detection_probability, model.gate_probability, model.clutter_density,
    )  # fmt: skip
    return posterior, looked, alive


def look_together(
    predicted: Mixture, model: Model, z: np.ndarray, hopeless: float
) -> tuple[Gates, np.ndarray, Gates, bool]:
    """Gates without end about every component, and the one list of detections for all of them: those of z
    (k, p) that lie in the gate of any. Then the gates looked through, and whether there is hope: beyond
    `hopeless` false detections expected within one deviation of the predictions nothing is looked at,
    which bounds the work on a track that is lost."""
    own = gates(predicted, model.sensor, model.gate_probability)
    possible = predicted.w > 0  # an impossible mode looks nowhere
    looked = own if possible.all() else Gates(own.z[possible], own.S[possible], own.size)
    density = model.sensor.density(model.clutter_density, own.z)
    alive = false_expected(own, predicted.w, density) <= hopeless
    near = np.zeros(len(z), bool)
    if alive:
        seen = distances_seen(take(predicted, possible), looked, model.sensor, z)
        near = np.isfinite(seen).any(axis=0)
    return own._replace(size=np.inf), z[near], looked, alive


def hopeless_beyond(model: Model, times: float) -> float:
    """False detections expected within one deviation of its predictions at which a tracker gives up:
    `times` as many as at the first scan, and as one."""
    moved = joined([predict(model.prior, motion) for motion in model.motions])
    w = np.outer(model.switching @ model.mode_prior, model.prior.w).ravel()
    looked = gates(moved, model.sensor, 1.0)
    density = model.sensor.density(model.clutter_density, looked.z)
    return times * max(1.0, false_expected(looked, w, density))


def false_expected(gates: Gates, w: np.ndarray, clutter_density: float | np.ndarray) -> float:
    """False detections expected within one standard deviation of a prediction, on average over
    components of weights w (n,): how unsure of its target a tracker is, whatever the size of its gates.
    The density is one for all, or (n,), that at each gate."""
    return float((w * clutter_density) @ volumes(gates._replace(size=1.0)) / w.sum())
