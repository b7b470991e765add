"""A Kalman filter whose update is left to an agent, for many episodes at once."""

import numpy as np

from gmr_gym.mixture import Mixture
from gmr_gym.models.kalman import predict
from gmr_gym.models.model import Model


class Prediction:
    r"""Predictions of n episodes, each from the estimates submitted in it.

    The agent says where the target is, and a Kalman filter with the first of the model's motions where it
    will be.

    Parameters
    ----------
    model : Model
        The filter model. Its gates are in a space of positions, as in all scenarios of one target.
    mean : ndarray (d,)
    covariance : ndarray (d, d)
        Of the prior, one period before the first scan.
    n : int

    Attributes
    ----------
    m : ndarray (n, d)
        Predicted states.
    P : ndarray (n, d, d)
        Their covariances. They follow from those before as if every scan had one detection of the target.
    at : ndarray (n, p)
        Predicted positions, m.

    Notes
    -----
    An estimate whose position is e from the predicted one is given the other states that a Kalman filter's
    would have, whatever the sensor's noise:

    .. math::

        x = m + P H^\mathsf{T} (H P H^\mathsf{T})^{-1} e
    """

    def __init__(self, model: Model, mean: np.ndarray, covariance: np.ndarray, n: int):
        self._motion, self._sensor = model.motions[0], model.sensor
        self._w = np.ones(n)
        self._first = self._predicted(np.tile(mean, (n, 1)), np.tile(covariance, (n, 1, 1)))
        self.m, self.P, self.at, self._S = (part.copy() for part in self._first)

    def begin(self, rows: np.ndarray) -> None:
        """Predict from the prior in the episodes of a mask (n,)."""
        for now, first in zip((self.m, self.P, self.at, self._S), self._first, strict=True):
            now[rows] = first[rows]

    def estimates(self, e: np.ndarray) -> np.ndarray:
        """The states (n, d) whose positions are e (n, p), m, from the predicted ones."""
        H = self._sensor.H
        HP = H @ self.P
        return self.m + (e[:, None] @ np.linalg.solve(HP @ H.T, HP))[:, 0]

    def move_on(self, x: np.ndarray) -> None:
        """Predict the next scan from the estimates x (n, d) of this one."""
        HP = self._sensor.H @ self.P
        P = self.P - HP.transpose(0, 2, 1) @ np.linalg.solve(self._S, HP)
        self.m, self.P, self.at, self._S = self._predicted(x, (P + P.transpose(0, 2, 1)) / 2)

    def _predicted(self, m: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, ...]:
        ahead = predict(Mixture(self._w, m, P), self._motion)
        return ahead.m, ahead.P, *self._sensor.gates(ahead)
