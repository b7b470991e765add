"""MHT reduced by clustering: the heaviest hypothesis takes in all that lie near it."""

from dataclasses import dataclass

import numpy as np

from gmr_gym import Mixture, Model, Report
from gmr_gym.checks import check_count, check_not_negative
from gmr_gym.filters.association import expand
from gmr_gym.filters.tracker import check_scan
from gmr_gym.mixture import collapsed, moments, normalised, take
from gmr_gym.models.gating import gates
from gmr_gym.models.kalman import predict
from gmr_gym.models.model import check_one_motion
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.pruning import capping, prune


def cluster(p: Mixture, distance: float, components: int) -> Reduced:
    """Merges the heaviest component with all within `distance` of it, squared Mahalanobis by its own
    covariance; then the heaviest of the rest likewise. Keeps the `components` heaviest clusters."""
    group = np.where(p.w > 0, len(p.w), -1)  # len(p.w): in no cluster yet
    clusters = []
    while (free := group == len(p.w)).any():
        i = np.argmax(np.where(free, p.w, -np.inf))
        away = p.m - p.m[i]
        near = np.einsum("nd,nd->n", away, np.linalg.solve(p.P[i], away.T).T) <= distance
        group[free & near] = len(clusters)
        clusters.append(collapsed(take(p, free & near)))
    merged = Mixture(*map(np.concatenate, zip(*clusters, strict=True)))
    kept, place = capping(merged, components)
    return kept, np.where(group < 0, -1, place[group])


@dataclass(frozen=True)
class Clustering:
    """MHT of one target, reduced to `components` by clustering."""

    model: Model
    components: int = 30
    distance: float = 2.0  # squared Mahalanobis

    def __post_init__(self):
        check_one_motion(self.model)
        check_count(self.components)
        check_not_negative("distance", self.distance)

    def init(self) -> Mixture:
        return self.model.prior

    def step(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        predicted = predict(belief, model.motion)
        gates_used = gates(predicted, model.sensor, model.gate_probability)
        posterior = expand(
            predicted,
            gates_used,
            model.sensor,
            z,
            model.detection_probability,
            model.gate_probability,
            model.clutter_density,
        ).mixture
        posterior = normalised(prune(posterior, 5e-4)[0])
        posterior = normalised(cluster(posterior, self.distance, self.components)[0])
        mean, covariance = moments(posterior)
        return posterior, Report(mean[None], covariance[None], gates_used, posterior)
