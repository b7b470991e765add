"""Radar in three dimensions: range, azimuth and elevation, and what becomes of their noise in space.

Positions are (x, y, z) in metres, relative to the radar, axes that do not turn; a detection is (range in m,
azimuth in rad from x towards y, elevation in rad from the x-y plane towards z).

Two sorts of average occur. Given the truth, a detection scatters about it; given a detection, the truth does.
With sines and cosines of Gaussian angles both come out in closed form:

    E cos(a + e) = exp(-s^2 / 2) cos a       for e ~ N(0, s^2), and so for the sine
"""

from typing import NamedTuple

import numpy as np

EXACT = np.zeros(3)
WIDEST = 0.5  # rad: with a wider angle the Gaussian has weight on the far side of the radar


class Converted(NamedTuple):
    """Detections as positions, with the covariance of their error."""

    z: np.ndarray  # (k, 3), m
    R: np.ndarray  # (k, 3, 3), m^2


def spherical(x: np.ndarray) -> np.ndarray:
    """Range, azimuth and elevation (..., 3) of positions (..., 3); azimuth in (-pi, pi].

    Raises ValueError for a position that is the radar's own: it has no direction."""
    x = np.asarray(x, float)
    distance = np.linalg.norm(x, axis=-1)
    if not (distance > 0).all():
        raise ValueError("x must lie away from the radar: a target at range 0 has no direction")
    azimuth = np.arctan2(x[..., 1], x[..., 0])
    return np.stack([distance, azimuth, np.arctan2(x[..., 2], np.hypot(x[..., 0], x[..., 1]))], axis=-1)


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
    J = _jacobian(z)
    return Converted(cartesian(z), (J * deviations**2) @ J.transpose(0, 2, 1))


def debiased(z: np.ndarray, deviations: np.ndarray) -> Converted:
    """Debiased converted measurements: less the average true bias, with the average true covariance (Li,
    eq. 6; Lerro and Bar-Shalom 1993, in three dimensions). Averages are over the truths that the
    detection allows, of what the detections of each would scatter.

    Departs: eq. 6 names elevation eta and azimuth theta; they are theta and beta."""
    D, x = _shrinking(deviations), cartesian(z)
    return Converted(x - D * (D - 1) * x, _scatter(z, deviations, deviations))


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


def _scatter(z, noise, spread):
    """Covariance (k, 3, 3) of positions whose range, azimuth and elevation scatter with deviations `noise`
    about a middle, averaged over middles of mean z (k, 3) and deviations `spread`, (3,) or (k, 3).

    A coordinate is a product of independent factors, and E[u v] - E[u] E[v] of products is formed factor
    by factor, from each factor's own covariance and product of means: nothing large is subtracted."""
    r, b, t = z.T
    spread = np.broadcast_to(spread, z.shape)
    distance = np.full_like(r, noise[0] ** 2), r**2 + spread[:, 0] ** 2
    azimuth, elevation = _angle(b, noise[1], spread[:, 1]), _angle(t, noise[2], spread[:, 2])
    cosine, sine = (
        (np.zeros_like(b), np.exp(-(noise[1] ** 2 + spread[:, 1] ** 2) / 2) * f(b)) for f in (np.cos, np.sin)
    )
    one = np.zeros_like(b), np.ones_like(b)
    out = np.empty((len(z), 3, 3))
    for i, j, vertical, level in (
        (0, 0, "cc", azimuth["cc"]), (1, 1, "cc", azimuth["ss"]), (2, 2, "ss", one),
        (0, 1, "cc", azimuth["cs"]), (0, 2, "cs", cosine), (1, 2, "cs", sine),
    ):  # fmt: skip
        (V, N), (Vt, Nt), (Vb, Nb) = distance, elevation[vertical], level
        out[:, i, j] = out[:, j, i] = V * (Vt + Nt) * (Vb + Nb) + N * Vt * (Vb + Nb) + N * Nt * Vb
    return out


def _angle(a, noise, spread):
    """Covariance and product of means of the cosine and sine of an angle, by pair: cc, ss and cs."""
    kept, lost = np.exp(-(noise**2)), -np.expm1(-(noise**2))
    wide = np.exp(-2 * spread**2)  # what averaging leaves of the cosine of twice the angle
    cosine, sine = wide * np.cos(2 * a), wide * np.sin(2 * a)
    # 1 - kept cosine, and with the sine, without cancellation
    narrow = -np.expm1(-2 * spread**2)
    below = lost + kept * (narrow + 2 * wide * np.sin(a) ** 2)
    above = lost + kept * (narrow + 2 * wide * np.cos(a) ** 2)
    return {
        "cc": (lost * below / 2, kept * (1 + cosine) / 2),
        "ss": (lost * above / 2, kept * (1 - cosine) / 2),
        "cs": (-lost * kept * sine / 2, kept * sine / 2),
    }


def _jacobian(z):
    """Derivatives (k, 3, 3) of position by range, azimuth and elevation (Li, eqs. 3-5)."""
    r, b, t = np.asarray(z).T
    J = np.empty((len(r), 3, 3))
    J[:, 0] = np.stack([np.cos(t) * np.cos(b), -r * np.cos(t) * np.sin(b), -r * np.sin(t) * np.cos(b)], 1)
    J[:, 1] = np.stack([np.cos(t) * np.sin(b), r * np.cos(t) * np.cos(b), -r * np.sin(t) * np.sin(b)], 1)
    J[:, 2] = np.stack([np.sin(t), np.zeros_like(r), r * np.cos(t)], 1)
    return J
