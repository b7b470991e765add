"""Interacting multiple models as a predictor and an updater of Stone Soup.

A state is a GaussianMixture: one component for each model, in their order, weighted by its probability.
"""

from collections.abc import Callable, Sequence
from datetime import datetime, timedelta
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.predictor.base import Predictor
from stonesoup.types.array import CovarianceMatrix
from stonesoup.types.mixture import GaussianMixture
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.types.prediction import GaussianMeasurementPrediction, Prediction
from stonesoup.types.state import StateMutableSequence
from stonesoup.types.update import GaussianMixtureUpdate
from stonesoup.updater.base import Updater

from gmr_gym.filters.association import expand_into_hypotheses
from gmr_gym.filters.imm import mix_and_predict
from gmr_gym.filters.mixing import MIXINGS, borrowed_states
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.models.kalman import Motion
from gmr_gym.models.model import check_modes
from gmr_gym.stonesoup.detections import scan_of
from gmr_gym.stonesoup.mixtures import components_of, mixture_of, vector
from gmr_gym.stonesoup.models import linear_sensor, motion_of, switching_of

NO_GATE = np.inf
CERTAIN = -np.inf, 0.0  # log weights of a miss and a detection, where the detection is the target's


class ImmPrediction(Prediction, GaussianMixture):
    """Predicted state of an IMM: a component for each model."""


class ImmPredictor(Predictor):
    """Mixes the models of an IMM, and predicts each by its own.

    The prior is a state of the IMM, or the state before the first: a GaussianState, from which all models
    start, or a GaussianMixture of another number of components, which is merged before. Models switch
    at every prediction, whatever its interval.

    Parameters
    ----------
    transition_model : sequence of r TransitionModel
        Linear and Gaussian.
    model_probs : array_like (r, r)
        Transition matrix; row i holds the probabilities of each model after model i, as of Stone Soup's
        simulators that switch.
    mode_prior : array_like (r,), optional
        Probability of each model before the first prediction; by default all are equal.
    mixing : {"augmented", "unbiased"}
        Mixing of motions of different state, see `gmr_gym.filters.mixing.borrowed_states`.

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    References
    ----------
    Blom and Bar-Shalom 1988.
    """

    transition_model: Sequence[Any] = Property()
    model_probs: np.ndarray = Property()
    mode_prior: np.ndarray = Property(default=None)
    mixing: str = Property(default=MIXINGS[0])

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        r = len(self.transition_model)
        switching = switching_of(self.model_probs, r)
        self._switching, self._initial = check_modes(r, switching, self.mode_prior)

    @cached_property
    def _cached(self) -> Callable:
        return lru_cache(self._predicted)  # hypothesisers predict once for every detection

    @cached_property
    def _moves(self) -> Callable:
        return lru_cache(self._motions)

    def predict(self, prior: Any, timestamp: datetime | None = None, **kwargs: Any) -> ImmPrediction:
        """Predict to a time.

        Parameters
        ----------
        prior : GaussianState, GaussianMixture or Track
        timestamp : datetime, optional
            Not before that of the prior. Without one, of either, transition models must not vary with time.
        **kwargs
            Not used.

        Returns
        -------
        ImmPrediction
        """
        return self._cached(prior.state if isinstance(prior, StateMutableSequence) else prior, timestamp)

    def _predicted(self, prior: Any, timestamp: datetime | None) -> ImmPrediction:
        r, p = len(self.transition_model), mixture_of(prior)
        if len(p.w) != r or not isinstance(prior, GaussianMixture):
            _, m, P = collapsed(p)
            p = Mixture(self._initial, m.repeat(r, axis=0), P.repeat(r, axis=0))
        interval = timestamp - prior.timestamp if timestamp and prior.timestamp else None
        if interval is not None and interval < timedelta(0):
            raise ValueError(
                f"timestamp must not be before that of the prior, {prior.timestamp}, got {timestamp}"
            )
        moves, borrowed = self._moves(interval)
        predicted = Mixture(*mix_and_predict(*p, self._switching, borrowed, *moves))
        return ImmPrediction(
            components=components_of(predicted, timestamp),
            transition_model=self.transition_model,
            prior=prior,
        )

    def _motions(self, interval: timedelta | None) -> tuple[Motion, np.ndarray]:
        each = tuple(motion_of(one, interval) for one in self.transition_model)
        return Motion(*map(np.array, zip(*each, strict=True))), borrowed_states(each, self.mixing)


class ImmUpdater(Updater):
    """Updates every model of an IMM with a detection, and the probabilities of the models.

    In clutter, a `SingleTargetTracker` with tracker "imm-pda" has the likelihoods of all detections in each
    model, which a hypothesis of Stone Soup has not.

    Parameters
    ----------
    measurement_model : LinearGaussian, optional
        Not needed where detections have one of their own.

    References
    ----------
    Blom and Bar-Shalom 1988.
    """

    measurement_model: Any = Property(default=None)

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._measured = lru_cache(self._predicted_measurement)

    def predict_measurement(
        self,
        predicted_state: Any,
        measurement_model: Any = None,
        measurement_noise: bool = True,
        **kwargs: Any,
    ) -> GaussianMeasurementPrediction:
        """The measurement predicted by all models together, as gates and hypothesisers take it.

        Parameters
        ----------
        predicted_state : ImmPrediction
        measurement_model : LinearGaussian, optional
            That of the updater unless given.
        measurement_noise : bool
            Whether the covariance has the noise.
        **kwargs
            Not used.

        Returns
        -------
        GaussianMeasurementPrediction

        Raises
        ------
        ValueError
            For a measurement model that is not linear.
        """
        model = self._check_measurement_model(measurement_model)
        return self._measured(predicted_state, model, measurement_noise)

    def update(self, hypothesis: Any, **kwargs: Any) -> GaussianMixtureUpdate:
        """Update with the detection of a hypothesis.

        Parameters
        ----------
        hypothesis : SingleHypothesis
            Of an ImmPrediction.
        **kwargs
            Not used.

        Returns
        -------
        GaussianMixtureUpdate
            A component for each model.

        Raises
        ------
        ValueError
            For several hypotheses, and as `predict_measurement`.
        """
        if isinstance(hypothesis, MultipleHypothesis):
            raise ValueError(
                "hypothesis must be of one detection, got a MultipleHypothesis; in clutter take "
                'SingleTargetTracker with tracker="imm-pda"'
            )
        detection = hypothesis.measurement
        model = self._check_measurement_model(detection.measurement_model)
        sensor, p = linear_sensor(model), mixture_of(hypothesis.prediction)
        _, z = scan_of([detection], model, detection.timestamp)
        z_hat, S = sensor.gates(p)
        predicted_z = sensor.predict_detections(p, z_hat, S, z)
        posterior = expand_into_hypotheses(p[:], predicted_z[:], NO_GATE, *CERTAIN).mixture
        return GaussianMixtureUpdate(
            hypothesis=hypothesis, components=components_of(posterior, detection.timestamp)
        )

    def _predicted_measurement(self, state: Any, model: Any, noise: bool) -> GaussianMeasurementPrediction:
        sensor, p = linear_sensor(model), collapsed(mixture_of(state))
        (z,), (S,) = sensor.gates(p)
        cross = CovarianceMatrix(p.P[0] @ sensor.H.T)
        S = CovarianceMatrix(S if noise else S - sensor.R)
        return GaussianMeasurementPrediction(vector(z), S, timestamp=state.timestamp, cross_covar=cross)
