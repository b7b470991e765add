"""The same work by Stone Soup's parts, put together as its tutorials do; the told model goes in as
constant matrices, which is faster than the tutorials' and leaves the estimates comparable."""

from datetime import datetime, timedelta

import numpy as np
from stonesoup.dataassociator.probability import PDA, JPDAwithEHM2
from stonesoup.functions import gm_reduce_single
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.measures import Mahalanobis
from stonesoup.mixturereducer.gaussianmixture import GaussianMixtureReducer
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
    LinearGaussianTimeInvariantTransitionModel,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.simulator.simple import SimpleDetectionSimulator, SingleTargetGroundTruthSimulator
from stonesoup.types.array import StateVectors
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState, TaggedWeightedGaussianState, WeightedGaussianState
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate
from stonesoup.updater.kalman import KalmanUpdater
from stonesoup.updater.pointprocess import PHDUpdater

from gmr_gym.filters.target_densities import Densities
from gmr_gym.mixture import Mixture
from gmr_gym.models.kalman import Motion, Sensor
from gmr_gym.models.model import Model
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.simulation.single_target import Scenario

START = datetime(2000, 1, 1)
WIDE = 1 - 1e-9  # probability of a gate, where ours has none but what is negligible
MERGE = 5  # squared Mahalanobis distance, as in the Gaussian-mixture PHD tutorial


def detections(scans: list[np.ndarray]) -> list[tuple[datetime, set[Detection]]]:
    """Scans as Stone Soup takes them, one a second; made beforehand, so that no tracker is charged
    for it."""
    times = [START + timedelta(seconds=t + 1) for t in range(len(scans))]
    return [
        (time, {Detection(point[:, None], timestamp=time) for point in z})
        for time, z in zip(times, scans, strict=True)
    ]


def _kalman(motion: Motion, sensor: Sensor):
    F, Q, _ = motion
    moves = LinearGaussianTimeInvariantTransitionModel(transition_matrix=F, covariance_matrix=Q)
    sees = LinearGaussian(ndim_state=len(F), mapping=(0, 1), noise_covar=sensor.R)
    return KalmanPredictor(moves), KalmanUpdater(sees)


def _parts(model: Model, normalise: bool):
    predictor, updater = _kalman(model.motions[0], model.sensor)
    hypothesiser = PDAHypothesiser(
        predictor,
        updater,
        clutter_spatial_density=model.clutter_density,
        prob_detect=model.detection_probability,
        prob_gate=model.gate_probability,
        normalise=normalise,
    )
    return updater, hypothesiser


class Pda:
    """Probabilistic data association as in tutorial 7; the belief is a Track."""

    def __init__(self, model: Model):
        self.prior = model.prior
        self.updater, hypothesiser = _parts(model, normalise=True)
        self.associator = PDA(hypothesiser=hypothesiser)

    def init(self) -> Track:
        return Track([GaussianState(self.prior.m[0][:, None], self.prior.P[0], timestamp=START)])

    def step(self, track: Track, scan):
        time, found = scan
        hypotheses = self.associator.associate({track}, found, time)[track]
        states = [self.updater.update(h) if h else h.prediction for h in hypotheses]
        mean, covariance = gm_reduce_single(
            StateVectors([state.state_vector for state in states]),
            np.stack([state.covar for state in states], axis=2),
            np.asarray([h.probability for h in hypotheses]),
        )
        track.append(GaussianStateUpdate(mean, covariance, hypotheses, time))
        return track, track

    @staticmethod
    def estimate(track: Track) -> tuple[np.ndarray, int]:
        """Mean (d,) and number of components."""
        return np.asarray(track.state_vector, float).ravel(), 1


class Jpda:
    """Joint probabilistic data association of given tracks, with its efficient enumeration over a tree."""

    def __init__(self, told: MultiTargetModel):
        predictor, self.updater = _kalman(told.motion, told.sensor)
        hypothesiser = PDAHypothesiser(
            predictor,
            self.updater,
            clutter_spatial_density=told.clutter.density(np.zeros((1, 2)))[0],
            prob_detect=told.detection_probability,
            prob_gate=WIDE,
        )
        self.associator = JPDAwithEHM2(hypothesiser=hypothesiser)

    @staticmethod
    def prepared(densities: Densities, chosen: np.ndarray, z: np.ndarray) -> tuple[list[Track], tuple]:
        """Tracks of the densities that are chosen (n,), of one motion, and the scan that comes next."""
        m, P = densities.m[chosen, 0], densities.P[chosen, 0]
        tracks = [
            Track([GaussianState(mean[:, None], own, timestamp=START)])
            for mean, own in zip(m, P, strict=True)
        ]
        return tracks, detections([z])[0]

    def step(self, tracks: list[Track], scan) -> np.ndarray:
        """Estimates (n, d) after the scan; the tracks stay as they are."""
        time, found = scan
        associated = self.associator.associate(set(tracks), found, time)
        out = []
        for track in tracks:
            states = [self.updater.update(h) if h else h.prediction for h in associated[track]]
            mean, _ = gm_reduce_single(
                StateVectors([state.state_vector for state in states]),
                np.stack([state.covar for state in states], axis=2),
                np.asarray([h.probability for h in associated[track]]),
            )
            out.append(np.asarray(mean, float).ravel())
        return np.array(out)


class MultipleHypotheses:
    """One target's Gaussian mixture: every component with every gated detection, then Stone Soup's
    own reducer. The belief is a list of components."""

    def __init__(self, model: Model, components: int, prune_weight: float, merging: float):
        self.prior = model.prior
        # not normalised by component: a component that explains a detection better must gain
        self.updater, hypothesiser = _parts(model, normalise=False)
        self.hypothesiser = GaussianMixtureHypothesiser(hypothesiser)
        self.reducer = GaussianMixtureReducer(
            prune_threshold=prune_weight,
            pruning=prune_weight > 0,
            merge_threshold=merging,
            max_number_components=components,
        )

    def init(self) -> list[WeightedGaussianState]:
        w, m, P = self.prior
        return [WeightedGaussianState(m[0][:, None], P[0], timestamp=START, weight=w[0])]

    def step(self, components, scan):
        time, found = scan
        updated = []
        for hypotheses in self.hypothesiser.hypothesise(components, found, time):
            for h in hypotheses:
                state = self.updater.update(h) if h else h.prediction
                state.weight = float(h.prediction.weight * h.probability)
                updated.append(state)
        kept = _normalised(self.reducer.reduce(_normalised(updated)))
        return kept, kept

    @staticmethod
    def estimate(components) -> tuple[np.ndarray, int]:
        """Mean (d,) and number of components."""
        means = np.array([np.asarray(c.state_vector, float).ravel() for c in components])
        return np.array([c.weight for c in components]) @ means, len(components)


def reduction(components: int):
    """Stone Soup's own reducer, by a rule of its own, as a function of a mixture that returns a function of
    nothing that returns the weights left."""
    reducer = GaussianMixtureReducer(pruning=False, merge_threshold=MERGE, max_number_components=components)

    def prepared(p: Mixture):
        given = [WeightedGaussianState(m[:, None], P, weight=w) for w, m, P in zip(*p, strict=True)]
        return lambda: [float(c.weight) for c in reducer.reduce(given)]

    return prepared


class Phd:
    """The Gaussian-mixture PHD filter as in its tutorial, without births. The intensity is a list of
    components."""

    def __init__(self, told: MultiTargetModel, components: int, gate: float, merging=4.0, prune_weight=1e-5):
        predictor, updater = _kalman(told.motion, told.sensor)
        self.updater = PHDUpdater(
            updater,
            clutter_spatial_density=told.clutter.density(np.zeros((1, 2)))[0],
            prob_detection=told.detection_probability,
            prob_survival=told.survival_probability,
        )
        distances = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=gate)
        self.hypothesiser = GaussianMixtureHypothesiser(distances, order_by_detection=True)
        self.reducer = GaussianMixtureReducer(
            prune_threshold=prune_weight, merge_threshold=merging, max_number_components=components
        )

    @staticmethod
    def intensity(p: Mixture) -> list[TaggedWeightedGaussianState]:
        """Of new objects: what becomes of old ones the predictor remembers."""
        return [
            TaggedWeightedGaussianState(m[:, None], P, timestamp=START, weight=w)
            for w, m, P in zip(*p, strict=True)
        ]

    def update(self, intensity, scan):
        time, found = scan
        return self.updater.update(self.hypothesiser.hypothesise(intensity, found, time))

    def step(self, intensity, scan):
        return self.reducer.reduce(self.update(intensity, scan))


def _normalised(components):
    total = sum(component.weight for component in components)
    for component in components:
        component.weight /= total
    return components


def simulated(scenario: Scenario, count: int) -> list[set[Detection]]:
    """Scans of a target of its own, nearly constant velocity, in the scenario's clutter."""
    truth = SingleTargetGroundTruthSimulator(
        transition_model=CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0)] * 2),
        initial_state=GaussianState([[0], [10], [0], [-10]], np.eye(4), timestamp=START),
        number_steps=count,
    )
    low, high = scenario.window[:2]
    simulator = SimpleDetectionSimulator(
        groundtruth=truth,
        measurement_model=LinearGaussian(ndim_state=4, mapping=(0, 2), noise_covar=scenario.sensor.R),
        meas_range=np.column_stack([low, high]),
        detection_probability=scenario.detection_probability,
        clutter_rate=scenario.clutter_rate,
        seed=0,
    )
    return [set(found) for _, found in simulator]
