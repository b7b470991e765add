"""WGS-84: geodetic coordinates, Earth-centred ones, and a local frame of east, north and up."""

import numpy as np
from numpy.typing import ArrayLike

RADIUS = 6378137.0  # m, semi-major axis
FLATTENING = 1 / 298.257223563
ECCENTRICITY2 = FLATTENING * (2 - FLATTENING)
POLAR_RADIUS = RADIUS * (1 - FLATTENING)


def to_ecef(geodetic: ArrayLike) -> np.ndarray:
    """Earth-centred, Earth-fixed coordinates.

    Parameters
    ----------
    geodetic : array_like (..., 3)
        Latitude and longitude, deg, and height above the ellipsoid, m.

    Returns
    -------
    ndarray (..., 3)
        m.
    """
    latitude, longitude, height = np.moveaxis(np.asarray(geodetic, float), -1, 0)
    latitude, longitude = np.radians(latitude), np.radians(longitude)
    normal = RADIUS / np.sqrt(1 - ECCENTRICITY2 * np.sin(latitude) ** 2)
    across = (normal + height) * np.cos(latitude)
    up = ((1 - ECCENTRICITY2) * normal + height) * np.sin(latitude)
    return np.stack([across * np.cos(longitude), across * np.sin(longitude), up], axis=-1)


def from_ecef(ecef: ArrayLike) -> np.ndarray:
    """Latitude and longitude, deg, and height, m, (..., 3) of Earth-centred coordinates (..., 3), m.

    The closed form is Vermeille's (2002), for all points but those within some 43 km of the centre.

    References
    ----------
    Vermeille, H. Direct transformation from geocentric coordinates to geodetic coordinates. Journal of
    Geodesy 76 (2002), 451-454.
    """
    x, y, z = np.moveaxis(np.asarray(ecef, float), -1, 0)
    e2, e4 = ECCENTRICITY2, ECCENTRICITY2**2
    across2 = x**2 + y**2
    p, q = across2 / RADIUS**2, (1 - e2) * z**2 / RADIUS**2
    r = (p + q - e4) / 6
    s = e4 * p * q / (4 * r**3)
    t = np.cbrt(1 + s + np.sqrt(s * (2 + s)))
    u = r * (1 + t + 1 / t)
    v = np.sqrt(u**2 + e4 * q)
    w = e2 * (u + v - q) / (2 * v)
    k = np.sqrt(u + v + w**2) - w
    d = k * np.sqrt(across2) / (k + e2)
    far = np.hypot(d, z)
    latitude = 2 * np.arctan2(z, d + far)
    return np.stack([np.degrees(latitude), np.degrees(np.arctan2(y, x)), (k + e2 - 1) / k * far], axis=-1)


def axes_at(reference: ArrayLike) -> np.ndarray:
    """Unit vectors (..., 3, 3), a row each, of east, north and up at (latitude deg, longitude deg, ...)."""
    latitude, longitude = np.moveaxis(np.radians(np.asarray(reference, float)[..., :2]), -1, 0)
    sin, cos, across, along = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    east = np.stack([-across, along, np.zeros_like(across)], axis=-1)
    north = np.stack([-sin * along, -sin * across, cos], axis=-1)
    up = np.stack([cos * along, cos * across, sin], axis=-1)
    return np.stack([east, north, up], axis=-2)


def to_local(geodetic: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """East, north and up of points, from a reference point.

    Parameters
    ----------
    geodetic : array_like (..., 3)
        Latitude and longitude, deg, and height, m.
    reference : array_like (3,)
        Likewise.

    Returns
    -------
    ndarray (..., 3)
        m. The plane is tangent to the ellipsoid at the reference: a point on the ellipsoid 20 km away has
        an `up` of -31 m.

    Examples
    --------
    >>> to_local([50.001, -1.0, 0.0], [50.0, -1.0, 0.0]).round(2).tolist()
    [0.0, 111.23, -0.0]
    """
    return (to_ecef(geodetic) - to_ecef(reference)) @ axes_at(reference).T


def from_local(points: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Latitude, longitude and height (..., 3) of east, north and up (..., 3), m: `to_local` backwards."""
    return from_ecef(np.asarray(points, float) @ axes_at(reference) + to_ecef(reference))
