"""States of a track that make objects of Stone Soup only when they are asked for."""

from datetime import datetime
from typing import Any, NamedTuple

import numpy as np
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.types.array import CovarianceMatrix
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import GaussianState, WeightedGaussianState
from stonesoup.types.update import GaussianStateUpdate

from gmr_gym.mixture import Mixture
from gmr_gym.stonesoup.mixtures import components_of, vector


class Origin(NamedTuple):
    """What the hypothesis of a state is made of."""

    near: list  # detections in the gates
    before: GaussianState  # the state of the scan before
    transition_model: Any  # None where there are several

    def hypothesis(self, time: datetime) -> MultipleHypothesis:
        """A hypothesis for each detection, of one prediction."""
        prediction = None
        if self.transition_model is not None:
            last = GaussianState(self.before.mean, self.before.covar, self.before.timestamp)
            prediction = KalmanPredictor(self.transition_model).predict(last, timestamp=time)
        return MultipleHypothesis([SingleHypothesis(prediction, one) for one in self.near])


class Hypotheses:
    """The Gaussian mixture of which a state is the mean and covariance."""

    timestamp: datetime
    mixture: Mixture  # hypotheses kept

    @property
    def components(self) -> list[WeightedGaussianState]:
        """The hypotheses kept."""
        return components_of(self.mixture, self.timestamp)


class MixtureUpdate(GaussianStateUpdate, Hypotheses):
    """State after a scan with detections in the gates, each a hypothesis without a probability.

    All hypotheses have one prediction, that of the last state by Stone Soup's Kalman filter; None where there
    are several motion models.
    """

    _property_hypothesis: Any

    @GaussianStateUpdate.hypothesis.getter  # type: ignore[untyped-decorator]
    def hypothesis(self) -> MultipleHypothesis:
        """Made at first sight."""
        if isinstance(self._property_hypothesis, Origin):
            self._property_hypothesis = self._property_hypothesis.hypothesis(self.timestamp)
        return self._property_hypothesis


class MixturePrediction(GaussianStatePrediction, Hypotheses):
    """State after a scan without any."""


def track_state(
    x: np.ndarray, P: np.ndarray, p: Mixture, time: datetime, origin: Origin
) -> MixtureUpdate | MixturePrediction:
    """The state of mean x (d,) and covariance P (d, d), of the hypotheses p, after a scan."""
    kind: Any = MixtureUpdate if origin.near else MixturePrediction
    state = kind.__new__(kind)  # field by field: their __init__ takes twice as long as a scan of PDA
    state.state_vector, state.covar, state.timestamp = vector(x), P.view(CovarianceMatrix), time
    if origin.near:
        state.hypothesis = origin
    else:
        state.transition_model, state.prior = origin.transition_model, origin.before
    state.mixture = p
    return state
