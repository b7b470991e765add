"""Radar in three dimensions: range, azimuth and elevation, and what becomes of their noise in space.

Positions are (x, y, z) in metres, relative to the radar, axes that do not turn; a detection is (range in m,
azimuth in rad from x towards y, elevation in rad from the x-y plane towards z).

Two sorts of average occur. Given the truth, a detection scatters about it; given a detection, the truth does.
With sines and cosines of Gaussian angles both come out in closed form:

    E cos(a + e) = exp(-s^2 / 2) cos a       for e ~ N(0, s^2), and so for the sine
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
WIDEST = 0.5  # rad: with a wider angle the Gaussian has weight on the far side of the radar


class Radar(NamedTuple):
    """A radar as a tracker's sensor, of states whose first three are a position; `radar` checks one.

    Its gates stand in space and are the same for all updates: a yardstick by which tracks are called lost.
    Where detections are looked for is what `look` says, for some updates in range and angles. Clutter is
    told per m rad^2."""

    deviations: np.ndarray  # (3,): m, rad, rad
    update: str  # one of UPDATES: how a detection moves a Gaussian
    H: np.ndarray  # (3, d), position of a state

    @property
    def R(self) -> np.ndarray:
        """Covariance of the noise of range, azimuth and elevation (3, 3)."""
        return np.diag(self.deviations**2)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names (3,), with units, of what it detects."""
        return "range_m", "azimuth_rad", "elevation_rad"

    def measure(self, x: np.ndarray) -> np.ndarray:
        """Range, azimuth and elevation (..., 3) of states x (..., d)."""
        return _by_rows(kernels.spherical_of, np.ascontiguousarray(x[..., :3], float))

    def relative(self, z: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Detections (..., 3) as seen from a centre (3,), by the shorter way round."""
        away = z - centre
        away[..., 1] = wrapped(away[..., 1])
        return away

    def wrap_and_validate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (k, 3) with their azimuths wrapped, and which of them have a range and an elevation."""
        return kernels.settled_of(z)

    def gates(self, p: Mixture) -> tuple[np.ndarray, np.ndarray]:
        """Predicted positions (n, 3) and the covariances (n, 3, 3) of converted detections about them."""
        return kernels.gates_of(p.m, p.P, self.deviations)

    def to_gate_space(self, z: np.ndarray) -> np.ndarray:
        """Detections z (k, 3) as positions (k, 3), where the gates stand."""
        return _by_rows(kernels.cartesian_of, np.ascontiguousarray(z, float))

    def density(self, density: float, at: np.ndarray) -> np.ndarray:
        """Density per m^3, at positions (n, 3), of clutter whose density per m rad^2 is given."""
        return kernels.density_of(density, at)

    def predict_detections(
        self, p: Mixture, z_hat: np.ndarray, S: np.ndarray, z: np.ndarray
    ) -> PredictedDetections:
        """The scan z (k, 3) as the components of p see it by this update. Raises ValueError for a range that
        is not positive, an elevation beyond a right angle and a component at the radar itself, where there
        is no direction."""
        which = UPDATES.index(self.update)
        return PredictedDetections(
            *kernels.predicted_detections(which, p.m, p.P, check_detections(z), self.deviations)
        )


def radar(deviations, states: int = 6, update: str = "debiased") -> Radar:
    """Checked Radar; ValueError for deviations as in `check_deviations`, for an update not in UPDATES and
    for fewer than three states."""
    if update not in UPDATES:
        raise ValueError(f"update must be one of {', '.join(UPDATES)}, got {update!r}")
    if states < 3:
        raise ValueError(f"states must be at least 3, a position, got {states}")
    return Radar(check_deviations(deviations), update, np.eye(3, states))


class Converted(NamedTuple):
    """Detections as positions, with the covariance of their error."""

    z: np.ndarray  # (k, 3), m
    R: np.ndarray  # (k, 3, 3), m^2


def spherical(x: np.ndarray) -> np.ndarray:
    """Range, azimuth and elevation (..., 3) of positions (..., 3); azimuth in (-pi, pi]. The radar's own
    position, which has no direction, is at 0, 0, 0. Raises ValueError for another shape and for what is not
    finite."""
    return _by_rows(kernels.spherical_of, _check_triples("x", x))


def cartesian(z: np.ndarray) -> np.ndarray:
    """Positions (..., 3) of detections (..., 3) (Li, eq. 2). Raises as `spherical`."""
    return _by_rows(kernels.cartesian_of, _check_triples("z", z))


def _check_triples(name: str, points) -> np.ndarray:
    points = doubles(name, present(points))
    if points.shape[-1:] != (3,) or not np.isfinite(points).all():
        raise ValueError(f"{name} must be finite with shape (..., 3), got shape {points.shape}")
    return points


def _by_rows(convert: Callable[[np.ndarray], np.ndarray], points: np.ndarray) -> np.ndarray:
    return convert(points.reshape(-1, 3)).reshape(points.shape)


def check_deviations(deviations) -> np.ndarray:
    """The deviations (3,) of range (m), azimuth and elevation (rad) as floats; ValueError unless they are
    positive, and the angles' at most `WIDEST`."""
    deviations = doubles("deviations", deviations).copy()
    if deviations.shape != (3,) or not ((deviations > 0) & np.isfinite(deviations)).all():
        raise ValueError(
            f"deviations must be three positive numbers (range in m, azimuth and elevation in rad), got "
            f"{deviations.tolist()}"
        )
    if (deviations[1:] > WIDEST).any():
        raise ValueError(
            f"deviations of angles must be at most {WIDEST} rad, got {deviations[1:].tolist()}: beyond, no "
            "conversion's covariance means anything"
        )
    return deviations


def check_detections(z, name: str = "z") -> np.ndarray:
    """The detections (k, 3) as floats; ValueError naming the row whose range is not positive or whose
    elevation lies beyond a right angle. A row of which anything is masked is absent."""
    z = doubles(name, present(z))
    if z.ndim != 2 or z.shape[1] != 3:
        raise ValueError(f"{name} must have shape (k, 3): range, azimuth, elevation; got {z.shape}")
    row = kernels.first_wrong(z)
    if row < 0:
        return z
    if not np.isfinite(z[row]).all():
        raise ValueError(f"{name} must be finite; row {row} is {z[row].tolist()}")
    if not z[row, 0] > 0:
        raise ValueError(f"{name} must have positive ranges; row {row} has {z[row, 0]}")
    raise ValueError(f"{name} must have elevations within a right angle; row {row} has {z[row, 2]} rad")


def raw(z, deviations) -> Converted:
    """The detections as positions, with the covariance of first order (Li, eqs. 2-5). Where the angles'
    noise matters the positions are too far in on average, and the covariance too small."""
    return Converted(*kernels.raw_of(check_detections(z), check_deviations(deviations)))


def debiased(z, deviations) -> Converted:
    """Debiased converted measurements: less the average true bias, with the average true covariance (Li,
    eq. 6; Lerro and Bar-Shalom 1993, in three dimensions). Averages are over the truths that the
    detection allows, of what the detections of each would scatter.

    Departs: eq. 6 names elevation eta and azimuth theta; they are theta and beta."""
    return Converted(*kernels.debiased_of(check_detections(z), check_deviations(deviations)))


def unbiased(z, deviations) -> Converted:
    """Unbiased converted measurements: stretched so that their mean given the truth is the truth, with the
    mean square error given the detection (Mo, Song, Zhou, Sun and Bar-Shalom 1998, in three dimensions)."""
    return Converted(*kernels.unbiased_of(check_detections(z), check_deviations(deviations)))


def modified_unbiased(z, deviations) -> Converted:
    """Modified unbiased converted measurements: mean and covariance of the truth given the detection and
    nothing else (Duan, Han and Li 2004, in three dimensions). Right for a first detection; in a recursion
    it draws every detection towards the radar."""
    return Converted(*kernels.modified_unbiased_of(check_detections(z), check_deviations(deviations)))


def decorrelated(z, deviations, at, spread) -> Converted:
    """Decorrelated unbiased converted measurements (Bordonaro, Willett and Bar-Shalom 2014): stretched as
    in `unbiased`, with the scatter about a truth that is as a prediction says, of spherical mean at (n, 3)
    and deviations spread (n, 3). z (k, 3); the covariances (n, 3, 3) are the predictions', so that they do
    not depend on the noise they describe."""
    about = _check_predictions(at, spread)
    return Converted(*kernels.decorrelated_of(check_detections(z), check_deviations(deviations), *about))


def debiased_at(z, deviations, at, spread) -> Converted:
    """Debiased converted measurements whose bias and covariance are those of a truth as predicted, of
    spherical mean at (n, 3) and deviations spread (n, 3). The bias is the prediction's, so z is (n, k, 3),
    and the covariances are (n, 3, 3)."""
    about = _check_predictions(at, spread)
    return Converted(*kernels.debiased_at_of(check_detections(z), check_deviations(deviations), *about))


def _check_predictions(at, spread) -> tuple[np.ndarray, np.ndarray]:
    at, spread = check_detections(at, "at"), doubles("spread", spread)
    if spread.shape != at.shape or not ((spread >= 0) & np.isfinite(spread)).all():
        raise ValueError(f"spread must be deviations of the shape of at, {at.shape}, got {spread.shape}")
    return at, spread


def wrapped(angle: np.ndarray) -> np.ndarray:
    """The angle within half a turn of zero."""
    return kernels.wrapped_angle(angle)
