"""Radar in three dimensions: range, azimuth and elevation, and the conversion of their noise to Cartesian.

Positions are (x, y, z) in metres, relative to the radar, along axes that do not turn. A detection is (range
in m, azimuth in rad from x towards y, elevation in rad from the x-y plane towards z).

Two kinds of average occur: over the detections given the truth, and over the truths given a detection. For
Gaussian angles both have a closed form, since

    E cos(a + e) = exp(-s^2 / 2) cos a       for e ~ N(0, s^2), and likewise for the sine
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import doubles
from gmr_gym.mixture import Mixture
from gmr_gym.models import spherical as kernels
from gmr_gym.models.sensing import PredictedDetections
from gmr_gym.points import present

CONVERSIONS = ("raw", "debiased", "unbiased", "modified-unbiased", "decorrelated", "debiased-at-prediction")
UPDATES = (*CONVERSIONS, "extended", "unscented", "cubature")
WIDEST = 0.5  # rad: with a larger standard deviation the Gaussian has weight behind the radar


class Radar(NamedTuple):
    """Radar as a tracker's sensor; the first three entries of the state are a position. `radar` makes a
    checked one.

    Its gates are in Cartesian space and the same for all updates, since they decide when a track is lost. The
    detections are compared in the space of `predict_detections`, which for some updates is range and angles.
    The clutter density is per m rad^2.

    Attributes
    ----------
    deviations : ndarray (3,)
        Standard deviations of the noise of range (m), azimuth and elevation (rad).
    update : str
        Measurement update, one of `UPDATES`.
    H : ndarray (3, d)
        Position of a state.
    """

    deviations: np.ndarray
    update: str
    H: np.ndarray

    @property
    def R(self) -> np.ndarray:
        """Covariance (3, 3) of the noise of range, azimuth and elevation."""
        return np.diag(self.deviations**2)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names (3,) of the coordinates of a detection, with units."""
        return "range_m", "azimuth_rad", "elevation_rad"

    def measure(self, x: np.ndarray) -> np.ndarray:
        """Range, azimuth and elevation (..., 3) of states x (..., d), noise-free."""
        return _by_rows(kernels.spherical_of, np.ascontiguousarray(x[..., :3], float))

    def relative(self, z: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Detections z (..., 3) relative to a centre (3,), azimuths the shorter way round."""
        away = z - centre
        away[..., 1] = wrapped(away[..., 1])
        return away

    def wrap_and_validate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Detections (k, 3) with azimuths wrapped, and a mask (k,) of those with a possible range and
        elevation."""
        return kernels.wrap_and_validate_of(z)

    def gates(self, p: Mixture) -> tuple[np.ndarray, np.ndarray]:
        """Predicted positions (n, 3), and the covariances (n, 3, 3) of converted detections about them."""
        return kernels.gates_of(p.m, p.P, self.deviations)

    def to_gate_space(self, z: np.ndarray) -> np.ndarray:
        """Positions (k, 3) of detections z (k, 3): the gates are in Cartesian space."""
        return _by_rows(kernels.cartesian_of, np.ascontiguousarray(z, float))

    def density(self, density: float, at: np.ndarray) -> np.ndarray:
        """Density per m^3, at positions (n, 3), of clutter with the given density per m rad^2."""
        return kernels.density_of(density, at)

    def predict_detections(
        self, p: Mixture, z_hat: np.ndarray, S: np.ndarray, z: np.ndarray
    ) -> PredictedDetections:
        """Predicted detections of every component by this update, their innovation covariances, and the
        scan in the same coordinates.

        Parameters
        ----------
        p : Mixture
            n predicted components.
        z_hat : ndarray (n, 3)
            Centres of their gates.
        S : ndarray (n, 3, 3)
            Covariances of their gates.
        z : ndarray (k, 3)
            The scan.

        Raises
        ------
        ValueError
            For a range that is not positive, an elevation beyond a right angle, and a component at the
            position of the radar, where the direction is undefined.
        """
        which = UPDATES.index(self.update)
        return PredictedDetections(
            *kernels.predicted_detections(which, p.m, p.P, check_detections(z), self.deviations)
        )


def radar(deviations, states: int = 6, update: str = "debiased") -> Radar:
    """Checked Radar.

    Parameters
    ----------
    deviations : array_like (3,)
        Standard deviations of the noise of range (m), azimuth and elevation (rad).
    states : int
        Dimension d of the state, at least 3.
    update : str
        Measurement update, one of `UPDATES`.

    Raises
    ------
    ValueError
        For deviations that are not positive or angles above `WIDEST`, an unknown update, and fewer than 3
        states.
    """
    if update not in UPDATES:
        raise ValueError(f"update must be one of {', '.join(UPDATES)}, got {update!r}")
    if states < 3:
        raise ValueError(f"states must be at least 3, a position, got {states}")
    return Radar(check_deviations(deviations), update, np.eye(3, states))


class Converted(NamedTuple):
    """Converted detections: positions, and the covariances of their errors.

    Attributes
    ----------
    z : ndarray (k, 3)
        m.
    R : ndarray (k, 3, 3)
        m^2.
    """

    z: np.ndarray
    R: np.ndarray


def spherical(x: np.ndarray) -> np.ndarray:
    """Range, azimuth and elevation of positions; the azimuth is in (-pi, pi].

    The radar's own position, which has no direction, maps to 0, 0, 0.

    Parameters
    ----------
    x : array_like (..., 3)
        Positions, m.

    Returns
    -------
    ndarray (..., 3)
        m, rad, rad.

    Raises
    ------
    ValueError
        For another shape and for a position that is not finite.

    Examples
    --------
    >>> spherical([0.0, 3.0, 4.0]).round(4).tolist()
    [5.0, 1.5708, 0.9273]
    """
    return _by_rows(kernels.spherical_of, _check_triples("x", x))


def cartesian(z: np.ndarray) -> np.ndarray:
    """Positions of detections: range, azimuth and elevation to Cartesian.

    Parameters
    ----------
    z : array_like (..., 3)
        Detections: m, rad, rad.

    Returns
    -------
    ndarray (..., 3)
        m.

    Raises
    ------
    ValueError
        For another shape and for a detection that is not finite.

    References
    ----------
    Li, eq. 2.
    """
    return _by_rows(kernels.cartesian_of, _check_triples("z", z))


def _check_triples(name: str, points) -> np.ndarray:
    points = doubles(name, present(points))
    if points.shape[-1:] != (3,) or not np.isfinite(points).all():
        raise ValueError(f"{name} must be finite with shape (..., 3), got shape {points.shape}")
    return points


def _by_rows(convert: Callable[[np.ndarray], np.ndarray], points: np.ndarray) -> np.ndarray:
    return convert(points.reshape(-1, 3)).reshape(points.shape)


def check_deviations(deviations) -> np.ndarray:
    """The standard deviations (3,) of range (m), azimuth and elevation (rad) as floats; ValueError unless
    they are positive and those of the angles at most `WIDEST`."""
    deviations = doubles("deviations", deviations).copy()
    if deviations.shape != (3,) or not ((deviations > 0) & np.isfinite(deviations)).all():
        raise ValueError(
            f"deviations must be three positive numbers (range in m, azimuth and elevation in rad), got "
            f"{deviations.tolist()}"
        )
    if (deviations[1:] > WIDEST).any():
        raise ValueError(
            f"deviations of angles must be at most {WIDEST} rad, got {deviations[1:].tolist()}: beyond, "
            "the covariance of a converted detection is meaningless"
        )
    return deviations


def check_detections(z, name: str = "z") -> np.ndarray:
    """The detections (k, 3) as floats, without the rows that have a masked entry; ValueError naming the
    row whose range is not positive or whose elevation is beyond a right angle."""
    z = doubles(name, present(z))
    if z.ndim != 2 or z.shape[1] != 3:
        raise ValueError(f"{name} must have shape (k, 3): range, azimuth, elevation; got {z.shape}")
    row = kernels.first_invalid(z)
    if row < 0:
        return z
    if not np.isfinite(z[row]).all():
        raise ValueError(f"{name} must be finite; row {row} is {z[row].tolist()}")
    if not z[row, 0] > 0:
        raise ValueError(f"{name} must have positive ranges; row {row} has {z[row, 0]}")
    raise ValueError(f"{name} must have elevations within a right angle; row {row} has {z[row, 2]} rad")


def raw(z, deviations) -> Converted:
    """Detections as positions, with the covariance to first order.

    Where the noise of the angles matters, the positions are on average too near to the radar and the
    covariance is too small.

    Parameters
    ----------
    z : array_like (k, 3)
        Detections: range (m), azimuth and elevation (rad).
    deviations : array_like (3,)
        Standard deviations of their noise.

    Raises
    ------
    ValueError
        For an impossible detection, and for deviations as in `radar`.

    References
    ----------
    Li, eqs. 2-5.
    """
    return Converted(*kernels.raw_of(check_detections(z), check_deviations(deviations)))


def debiased(z, deviations) -> Converted:
    r"""Debiased converted measurements: positions minus the average bias, with the average covariance.

    Both are averages, over the truths that the detection allows, of the bias and covariance of a detection of
    each truth.

    Parameters
    ----------
    z : array_like (k, 3)
        Detections: range (m), azimuth and elevation (rad).
    deviations : array_like (3,)
        Standard deviations of their noise.

    Raises
    ------
    ValueError
        For an impossible detection, and for deviations as in `radar`.

    Notes
    -----
    With the raw position (x, y, z) and sigma the standard deviations of azimuth (beta) and elevation (theta):

    .. math::

        \mu = \begin{bmatrix} D (D - 1) x \\ D (D - 1) y \\ \lambda_\theta (\lambda_\theta - 1) z
        \end{bmatrix}, \qquad D = \lambda_\beta \lambda_\theta, \qquad \lambda_a = e^{-\sigma_a^2 / 2}

    is the average bias.

    Departs: eq. 6 names elevation eta and azimuth theta; they are theta and beta.

    References
    ----------
    Li, eq. 6; Lerro and Bar-Shalom 1993, extended to three dimensions.

    Examples
    --------
    >>> converted = debiased([[1000.0, 0.0, 0.0]], [10.0, 0.1, 0.1])
    >>> converted.z.round(2).tolist()
    [[1009.85, 0.0, 0.0]]
    """
    return Converted(*kernels.debiased_of(check_detections(z), check_deviations(deviations)))


def unbiased(z, deviations) -> Converted:
    """Unbiased converted measurements: scaled so that their mean given the truth is the truth.

    The covariance is the mean square error given the detection.

    Parameters
    ----------
    z : array_like (k, 3)
        Detections: range (m), azimuth and elevation (rad).
    deviations : array_like (3,)
        Standard deviations of their noise.

    Raises
    ------
    ValueError
        For an impossible detection, and for deviations as in `radar`.

    References
    ----------
    Mo, Song, Zhou, Sun and Bar-Shalom 1998, extended to three dimensions.
    """
    return Converted(*kernels.unbiased_of(check_detections(z), check_deviations(deviations)))


def modified_unbiased(z, deviations) -> Converted:
    """Modified unbiased converted measurements: mean and covariance of the truth given the detection alone.

    Correct for a first detection; in a recursion it pulls every detection towards the radar.

    Parameters
    ----------
    z : array_like (k, 3)
        Detections: range (m), azimuth and elevation (rad).
    deviations : array_like (3,)
        Standard deviations of their noise.

    Raises
    ------
    ValueError
        For an impossible detection, and for deviations as in `radar`.

    References
    ----------
    Duan, Han and Li 2004, extended to three dimensions.
    """
    return Converted(*kernels.modified_unbiased_of(check_detections(z), check_deviations(deviations)))


def decorrelated(z, deviations, at, spread) -> Converted:
    """Decorrelated unbiased converted measurements: scaled as in `unbiased`, with the covariance of the
    prediction.

    The covariance is averaged over the truths that the prediction allows, so it does not depend on the noise
    that it describes.

    Parameters
    ----------
    z : array_like (k, 3)
        Detections: range (m), azimuth and elevation (rad).
    deviations : array_like (3,)
        Standard deviations of their noise.
    at : array_like (n, 3)
        Predicted range, azimuth and elevation.
    spread : array_like (n, 3)
        Standard deviations of the prediction.

    Returns
    -------
    Converted
        Positions (k, 3), and covariances (n, 3, 3), one for each prediction.

    Raises
    ------
    ValueError
        For an impossible detection or prediction, and for deviations as in `radar`.

    References
    ----------
    Bordonaro, Willett and Bar-Shalom 2014.
    """
    about = _check_predictions(at, spread)
    return Converted(*kernels.decorrelated_of(check_detections(z), check_deviations(deviations), *about))


def debiased_at(z, deviations, at, spread) -> Converted:
    """Debiased converted measurements with the bias and covariance of the predicted truth.

    Parameters
    ----------
    z : array_like (k, 3)
        Detections: range (m), azimuth and elevation (rad).
    deviations : array_like (3,)
        Standard deviations of their noise.
    at : array_like (n, 3)
        Predicted range, azimuth and elevation.
    spread : array_like (n, 3)
        Standard deviations of the prediction.

    Returns
    -------
    Converted
        Positions (n, k, 3), since the bias is that of the prediction, and covariances (n, 3, 3).

    Raises
    ------
    ValueError
        For an impossible detection or prediction, and for deviations as in `radar`.
    """
    about = _check_predictions(at, spread)
    return Converted(*kernels.debiased_at_of(check_detections(z), check_deviations(deviations), *about))


def _check_predictions(at, spread) -> tuple[np.ndarray, np.ndarray]:
    at, spread = check_detections(at, "at"), doubles("spread", spread)
    if spread.shape != at.shape or not ((spread >= 0) & np.isfinite(spread)).all():
        raise ValueError(f"spread must be deviations of the shape of at, {at.shape}, got {spread.shape}")
    return at, spread


def wrapped(angle: np.ndarray) -> np.ndarray:
    """The angle wrapped to [-pi, pi)."""
    return kernels.wrapped_angle(angle)
