"""Local coordinates are those of the ellipsoid."""

import numpy as np
import pytest

from gmr_gym.recorded.geodesy import axes_at, from_ecef, from_local, to_ecef, to_local


def places(rng, reference, degrees, n=300):
    """Points (n, 3) about a reference."""
    latitude = np.clip(reference[0] + rng.uniform(-degrees, degrees, n), -90, 90)
    longitude = reference[1] + rng.uniform(-degrees, degrees, n)
    return np.column_stack([latitude, longitude, rng.uniform(-100, 20_000, n)])


@pytest.mark.parametrize("degrees", [0.01, 1, 40])
@pytest.mark.parametrize("reference", [(0, 0, 0), (63.4, 10.4, 30), (-79, 179.9, 2800), (89.9, -60, 0)])
def test_local_coordinates_are_those_of_pymap3d_and_come_back(reference, degrees):
    pymap3d = pytest.importorskip("pymap3d")
    there = places(np.random.default_rng(1), reference, degrees)
    local = to_local(there, reference)
    np.testing.assert_allclose(
        local, np.column_stack(pymap3d.geodetic2enu(*there.T, *reference)), rtol=0, atol=1e-6
    )
    back = from_local(local, reference)
    np.testing.assert_allclose(to_ecef(back), to_ecef(there), rtol=0, atol=1e-6)
    np.testing.assert_allclose(back[:, 2], there[:, 2], rtol=0, atol=1e-6)


def test_the_horizon_falls_and_slant_ranges_are_straight():
    far = to_local([50 + np.degrees(20_000 / 6_390_000), 0, 0], (50, 0, 0))
    assert far[2] == pytest.approx(-(20_000**2) / (2 * 6.38e6), abs=0.2)  # -31 m
    chord = np.linalg.norm(to_ecef([50, 0, 0]) - to_ecef([51, 1, 9000]))
    assert np.linalg.norm(to_local([51, 1, 9000], (50, 0, 0))) == pytest.approx(chord, abs=1e-6)


def test_poles_equator_and_axes():
    np.testing.assert_allclose(to_ecef([0, 90, 0]), [0, 6378137, 0], atol=1e-9)
    np.testing.assert_allclose(to_ecef([90, 0, 0]), [0, 0, 6356752.314245], atol=1e-6)
    np.testing.assert_allclose(from_ecef([0, 0, -6356752.314245]), [-90, 0, 0], atol=1e-6)
    axes = axes_at((12, -77))
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1)
