"""Radar in three dimensions: range, azimuth and elevation, and what becomes of their noise in space.

Positions are (x, y, z) in metres, relative to the radar, axes that do not turn; a detection is (range in m,
azimuth in rad from x towards y, elevation in rad from the x-y plane towards z).

Two sorts of average occur. Given the truth, a detection scatters about it; given a detection, the truth does.
With sines and cosines of Gaussian angles both come out in closed form:

    E cos(a + e) = exp(-s^2 / 2) cos a       for e ~ N(0, s^2), and so for the sine
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from gmr_gym.kalman import Look
from gmr_gym.mixture import Mixture

EXACT = np.zeros((1, 3))
CONVERSIONS = ("raw", "debiased", "unbiased", "modified-unbiased", "decorrelated", "debiased-at-prediction")
UPDATES = (*CONVERSIONS, "extended", "unscented", "cubature")
WIDEST = 0.5  # rad: with a wider angle the Gaussian has weight on the far side of the radar


class Radar(NamedTuple):
    """A radar as a tracker's sensor, of states whose first three are a position; `radar` checks one.

    Its gates stand in space, whatever the update looks at. Clutter is told per m rad^2."""

    deviations: np.ndarray  # (3,): m, rad, rad
    update: str  # one of UPDATES: how a detection moves a Gaussian
    states: int

    @property
    def H(self) -> np.ndarray:
        """Position (3, d) of a state."""
        return np.eye(3, self.states)

    @property
    def R(self) -> np.ndarray:
        """Covariance of the noise of range, azimuth and elevation (3, 3)."""
        return np.diag(self.deviations**2)

    def observed(self, x: np.ndarray) -> np.ndarray:
        """Range, azimuth and elevation (..., 3) of states x (..., d)."""
        return spherical(x[..., :3])

    def relative(self, z: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Detections (..., 3) as seen from a centre (3,), by the shorter way round."""
        away = z - centre
        away[..., 1] = wrapped(away[..., 1])
        return away

    def settled(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (k, 3) with their azimuths wrapped, and which of them have a range and an elevation."""
        z = z.copy()
        z[:, 1] = wrapped(z[:, 1])
        return z, (z[:, 0] > 0) & (np.abs(z[:, 2]) <= np.pi / 2)

    def gates(self, p: Mixture) -> tuple[np.ndarray, np.ndarray]:
        """Predicted positions (n, 3) and the covariances (n, 3, 3) of converted detections about them."""
        at = p.m[:, :3]
        return at, p.P[:, :3, :3] + _scatter(spherical(at), self.deviations, EXACT)

    def placed(self, z: np.ndarray) -> np.ndarray:
        """Detections z (k, 3) as positions (k, 3), where the gates stand."""
        return cartesian(z)

    def density(self, density: float, at: np.ndarray) -> np.ndarray:
        """Density per m^3, at positions (n, 3), of clutter whose density per m rad^2 is given."""
        return density * np.exp(-_log_stretch(spherical(at)))

    def look(self, p: Mixture, expected: np.ndarray, S: np.ndarray, z: np.ndarray) -> Look:
        """The scan z (k, 3) as the components of p see it by this update. Raises ValueError for a range that
        is not positive or an elevation beyond a right angle."""
        z = check_detections(z)
        if self.update in CONVERSIONS:
            return self._converted(p, z)
        spread = {"extended": _linearised, "unscented": _unscented, "cubature": _cubature}[self.update]
        expected, C, S = spread(p)
        z = np.repeat(z[None], len(p.w), axis=0)
        z[..., 1] = expected[:, None, 1] + wrapped(z[..., 1] - expected[:, None, 1])
        return Look(expected, S + self.R, C, z, np.empty((0, 3, 3)), np.zeros(z.shape[1]))

    def _converted(self, p, z):
        at, P = p.m[:, :3], p.P[:, :3, :3]
        C, stretch, none = np.ascontiguousarray(p.P[:, :3]), _log_stretch(z), np.empty((0, 3, 3))
        if self.update in PREDICTED:
            place = spherical(at)
            J = np.linalg.inv(_jacobian(place))
            spread = np.sqrt(np.einsum("nij,njk,nik->ni", J, P, J))
            points, R = PREDICTED[self.update](z, self.deviations, place, spread)
            return Look(at, P + R, C, points if points.ndim == 3 else points[None], none, stretch)
        points, R = MEASURED[self.update](z, self.deviations)
        return Look(at, np.ascontiguousarray(P), C, points[None], R, stretch)


def radar(deviations, states: int = 6, update: str = "debiased") -> Radar:
    """Checked Radar; ValueError for deviations as in `check_deviations`, for an update not in UPDATES and
    for fewer than three states."""
    if update not in UPDATES:
        raise ValueError(f"update must be one of {', '.join(UPDATES)}, got {update!r}")
    if states < 3:
        raise ValueError(f"states must be at least 3, a position, got {states}")
    return Radar(check_deviations(deviations), update, states)


class Converted(NamedTuple):
    """Detections as positions, with the covariance of their error."""

    z: np.ndarray  # (k, 3), m
    R: np.ndarray  # (k, 3, 3), m^2


def spherical(x: np.ndarray) -> np.ndarray:
    """Range, azimuth and elevation (..., 3) of positions (..., 3); azimuth in (-pi, pi]. The radar's own
    position, which has no direction, is at 0, 0, 0."""
    x = np.asarray(x, float)
    level = np.hypot(x[..., 0], x[..., 1])
    angles = np.arctan2(x[..., 1], x[..., 0]), np.arctan2(x[..., 2], level)
    return np.stack([np.hypot(level, x[..., 2]), *angles], axis=-1)


def cartesian(z: np.ndarray) -> np.ndarray:
    """Positions (..., 3) of detections (..., 3) (Li, eq. 2)."""
    r, azimuth, elevation = np.moveaxis(np.asarray(z, float), -1, 0)
    level = r * np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), r * np.sin(elevation)], axis=-1)


def check_deviations(deviations) -> np.ndarray:
    """The deviations (3,) of range (m), azimuth and elevation (rad) as floats; ValueError unless they are
    positive, and the angles' at most `WIDEST`."""
    deviations = np.array(deviations, float)
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


def check_detections(z) -> np.ndarray:
    """The detections (k, 3) as floats; ValueError naming the row whose range is not positive or whose
    elevation lies beyond a right angle."""
    z = np.asarray(z, float)
    if z.ndim != 2 or z.shape[1] != 3 or not np.isfinite(z).all():
        raise ValueError(f"z must be finite with shape (k, 3): range, azimuth, elevation; got {z.shape}")
    if not (z[:, 0] > 0).all():
        row = int(np.argmin(z[:, 0] > 0))
        raise ValueError(f"z must have positive ranges; row {row} has {z[row, 0]}")
    if not (np.abs(z[:, 2]) <= np.pi / 2).all():
        row = int(np.argmax(np.abs(z[:, 2])))
        raise ValueError(f"z must have elevations within a right angle; row {row} has {z[row, 2]} rad")
    return z


def raw(z: np.ndarray, deviations: np.ndarray) -> Converted:
    """The detections as positions, with the covariance of first order (Li, eqs. 2-5). Where the angles'
    noise matters the positions are too far out on average, and the covariance too small."""
    A = _jacobian(z) * deviations
    return Converted(cartesian(z), A @ A.transpose(0, 2, 1))


def debiased(z: np.ndarray, deviations: np.ndarray) -> Converted:
    """Debiased converted measurements: less the average true bias, with the average true covariance (Li,
    eq. 6; Lerro and Bar-Shalom 1993, in three dimensions). Averages are over the truths that the
    detection allows, of what the detections of each would scatter.

    Departs: eq. 6 names elevation eta and azimuth theta; they are theta and beta."""
    D, x = _shrinking(deviations), cartesian(z)
    return Converted(x - D * (D - 1) * x, _scatter(z, deviations, deviations[None]))


def unbiased(z: np.ndarray, deviations: np.ndarray) -> Converted:
    """Unbiased converted measurements: stretched so that their mean given the truth is the truth, with the
    mean square error given the detection (Mo, Song, Zhou, Sun and Bar-Shalom 1998, in three dimensions)."""
    D, x = _shrinking(deviations), cartesian(z)
    off = (1 / D - D) * x
    return Converted(x / D, _scatter(z, deviations, EXACT) + off[:, :, None] * off[:, None])


def modified_unbiased(z: np.ndarray, deviations: np.ndarray) -> Converted:
    """Modified unbiased converted measurements: mean and covariance of the truth given the detection and
    nothing else (Duan, Han and Li 2004, in three dimensions). Right for a first detection; in a recursion
    it draws every detection towards the radar."""
    return Converted(_shrinking(deviations) * cartesian(z), _scatter(z, deviations, EXACT))


def decorrelated(z: np.ndarray, deviations: np.ndarray, at: np.ndarray, spread: np.ndarray) -> Converted:
    """Decorrelated unbiased converted measurements (Bordonaro, Willett and Bar-Shalom 2014): stretched as
    in `unbiased`, with the scatter about a truth that is as a prediction says, of spherical mean at (n, 3)
    and deviations spread (n, 3). z (k, 3); the covariances (n, 3, 3) are the predictions', so that they do not
    depend on the noise they describe."""
    D = _shrinking(deviations)
    return Converted(cartesian(z) / D, _scatter(at, deviations, spread) / (D[:, None] * D))


def debiased_at(z: np.ndarray, deviations: np.ndarray, at: np.ndarray, spread: np.ndarray) -> Converted:
    """Debiased converted measurements whose bias and covariance are those of a truth as predicted, of
    spherical mean at (n, 3) and deviations spread (n, 3). The bias is the prediction's, so z is (n, k, 3), and
    the covariances are (n, 3, 3)."""
    bias = (_shrinking(deviations) - 1) * _shrinking(spread) * cartesian(at)
    return Converted(cartesian(z) - bias[:, None], _scatter(at, deviations, spread))


def _shrinking(deviations):
    """What averaging over both angles leaves of each coordinate (..., 3)."""
    _, lb, lt = np.moveaxis(np.exp(-(deviations**2) / 2), -1, 0)
    return np.stack([lb * lt, lb * lt, lt], axis=-1)


@njit(cache=True, error_model="numpy")
def _scatter(z, noise, spread):
    """Covariance (k, 3, 3) of positions whose range, azimuth and elevation scatter with deviations `noise`
    about a middle, averaged over middles of mean z (k, 3) and deviations `spread`, (k, 3), or (1, 3) for all.

    A coordinate is a product of independent factors, and E[u v] - E[u] E[v] of products is formed factor
    by factor, from each factor's own covariance and product of means: nothing large is subtracted."""
    out = np.empty((len(z), 3, 3))
    for i in range(len(z)):
        wide = spread[i] if len(spread) > 1 else spread[0]
        r, b, t = z[i]
        V, N = noise[0] ** 2, r**2 + wide[0] ** 2
        (bcc, Bcc), (bss, Bss), (bcs, Bcs) = _angle(b, noise[1], wide[1])
        (tcc, Tcc), (tss, Tss), (tcs, Tcs) = _angle(t, noise[2], wide[2])
        left = np.exp(-(noise[1] ** 2 + wide[1] ** 2) / 2)
        out[i, 0, 0] = _product(V, N, tcc, Tcc, bcc, Bcc)
        out[i, 1, 1] = _product(V, N, tcc, Tcc, bss, Bss)
        out[i, 2, 2] = _product(V, N, tss, Tss, 0.0, 1.0)
        out[i, 0, 1] = out[i, 1, 0] = _product(V, N, tcc, Tcc, bcs, Bcs)
        out[i, 0, 2] = out[i, 2, 0] = _product(V, N, tcs, Tcs, 0.0, left * np.cos(b))
        out[i, 1, 2] = out[i, 2, 1] = _product(V, N, tcs, Tcs, 0.0, left * np.sin(b))
    return out


@njit(cache=True, error_model="numpy")
def _product(V, N, Vt, Nt, Vb, Nb):
    """(V + N) (Vt + Nt) (Vb + Nb) - N Nt Nb."""
    return V * (Vt + Nt) * (Vb + Nb) + N * Vt * (Vb + Nb) + N * Nt * Vb


@njit(cache=True, error_model="numpy")
def _angle(a, noise, spread):
    """Covariance and product of means of cosine and cosine, sine and sine, cosine and sine of an angle."""
    kept, lost = np.exp(-(noise**2)), -np.expm1(-(noise**2))
    wide, narrow = np.exp(-2 * spread**2), -np.expm1(-2 * spread**2)  # of twice the angle
    cosine, sine = wide * np.cos(2 * a), wide * np.sin(2 * a)
    # 1 - kept cosine and 1 + kept cosine, without cancellation
    below = lost + kept * (narrow + 2 * wide * np.sin(a) ** 2)
    above = lost + kept * (narrow + 2 * wide * np.cos(a) ** 2)
    return (
        (lost * below / 2, kept * (1 + cosine) / 2),
        (lost * above / 2, kept * (1 - cosine) / 2),
        (-lost * kept * sine / 2, kept * sine / 2),
    )


def _jacobian(z):
    """Derivatives (k, 3, 3) of position by range, azimuth and elevation (Li, eqs. 3-5)."""
    r, b, t = np.asarray(z).T
    J = np.empty((len(r), 3, 3))
    J[:, 0] = np.stack([np.cos(t) * np.cos(b), -r * np.cos(t) * np.sin(b), -r * np.sin(t) * np.cos(b)], 1)
    J[:, 1] = np.stack([np.cos(t) * np.sin(b), r * np.cos(t) * np.cos(b), -r * np.sin(t) * np.sin(b)], 1)
    J[:, 2] = np.stack([np.sin(t), np.zeros_like(r), r * np.cos(t)], 1)
    return J


def wrapped(angle: np.ndarray) -> np.ndarray:
    """The angle within half a turn of zero."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def _log_stretch(z):
    """log(r^2 cos t) (k,): the volume in space that a unit of range, azimuth and elevation fills."""
    least = 1e-300
    return 2 * np.log(np.maximum(z[:, 0], least)) + np.log(np.maximum(np.cos(z[:, 2]), least))


def _linearised(p):
    """Expected range, azimuth and elevation (n, 3), their covariance with the state (n, 3, d) and their own
    (n, 3, 3), to first order about the prediction."""
    expected = spherical(p.m[:, :3])
    J = np.linalg.inv(_jacobian(expected))
    return expected, J @ p.P[:, :3], J @ p.P[:, :3, :3] @ J.transpose(0, 2, 1)


def _cubature(p):
    """The same by cubature points of the position: the radar sees nothing else (Arasaratnam and Haykin 2009)."""
    return _by_points(p, np.full(7, 1 / 6) * (np.arange(7) > 0), np.sqrt(3.0))


def _unscented(p):
    """The same by unscented points of the position, kappa = 3 - n = 0 raised to 1 so that the middle counts
    (Julier and Uhlmann 1997)."""
    weights = np.full(7, 1 / 8)
    weights[0] = 1 / 4
    return _by_points(p, weights, 2.0)


def _by_points(p, weights, reach):
    L = np.linalg.cholesky(p.P[:, :3, :3])
    steps = np.concatenate(
        [np.zeros((len(L), 1, 3)), reach * L.transpose(0, 2, 1), -reach * L.transpose(0, 2, 1)], 1
    )
    points = spherical(p.m[:, None, :3] + steps)
    middle = spherical(p.m[:, :3])
    points[..., 1] = middle[:, None, 1] + wrapped(points[..., 1] - middle[:, None, 1])
    expected = weights @ points
    off = points - expected[:, None]
    weighed = weights[:, None] * off
    # the state's covariance with the points is that with the position, carried on by regression
    C = np.einsum("npi,npj->nij", weighed, steps)
    gain = np.linalg.solve(p.P[:, :3, :3], p.P[:, :3])
    return expected, C @ gain, np.einsum("npi,npj->nij", weighed, off)


MEASURED = {
    "raw": raw, "debiased": debiased, "unbiased": unbiased, "modified-unbiased": modified_unbiased,
}  # fmt: skip
PREDICTED = {"decorrelated": decorrelated, "debiased-at-prediction": debiased_at}
