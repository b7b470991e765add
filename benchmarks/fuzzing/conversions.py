"""Radar coordinates and conversions as targets."""

from functools import partial

import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import LAYOUTS, Rng, decades, in_layout, spoilt_points
from fuzzing.worlds import possible
from gmr_gym.models import radar

ALONE = ("raw", "debiased", "unbiased", "modified_unbiased")
PREDICTED = ("decorrelated", "debiased_at")


def conversion_targets() -> list[Target]:
    """Every conversion, and the coordinates there and back."""
    converted = [
        Target(
            f"radar/{name}",
            partial(_draw, name),
            getattr(radar, name),
            partial(_check, name),
            partial(_spoil, name),
        )
        for name in (*ALONE, *PREDICTED)
    ]
    return [
        *converted,
        Target("radar/there-and-back", _draw_positions, _there_and_back, _check_back, _spoil_positions),
        Target("radar/wrapped", _draw_angles, lambda given, plain: radar.wrapped(given), _check_angles),
    ]


def detections(rng: Rng, k: int) -> np.ndarray:
    """Detections (k, 3) that a radar might say."""
    z = np.column_stack([decades(rng, -3, 8, k), rng.uniform(-4, 4, k), rng.uniform(-1.6, 1.6, k)])
    if rng.random() < 0.2:
        z[:, 2] = rng.choice([-np.pi / 2, np.pi / 2, 0.0], k)
    return possible(z)


def _draw(name: str, rng: Rng) -> tuple:
    k = int(rng.choice([0, 1, 1, 2, 5, 20]))
    z = detections(rng, k)
    deviations = np.array([decades(rng, -6, 4), *decades(rng, -12, -0.31, 2)])
    if name in ALONE:
        return z, deviations
    n = int(rng.integers(1, 4))
    spread = np.column_stack([decades(rng, -6, 4, n), *decades(rng, -12, 0, (2, n))])
    return z, deviations, detections(rng, n), spread


def _spoil(name: str, rng: Rng, arguments: tuple) -> Spoilt:
    z, deviations, *about = arguments
    kind = rng.integers(4)
    if kind == 0:
        bad = deviations.copy()
        bad[rng.integers(3)] = (np.nan, np.inf, -1.0, 0.0)[rng.integers(4)]
        return Spoilt((z, bad, *about), ("deviations",), f"deviations {bad.tolist()}")
    if kind == 1 and about:
        spoilt = spoilt_points(rng, about[1], ("spread",))
        return Spoilt(
            (z, deviations, about[0], *spoilt.arguments), spoilt.names, f"spread with {spoilt.what}"
        )
    if kind == 2 and len(z):
        bad = z.copy()
        column, value = ((0, 0.0), (0, -1.0), (2, 2.0))[rng.integers(3)]
        bad[rng.integers(len(z)), column] = value
        return Spoilt((bad, deviations, *about), ("z",), "a detection that no radar says")
    spoilt = spoilt_points(rng, z, ("z",))
    return Spoilt((*spoilt.arguments, deviations, *about), spoilt.names, f"z with {spoilt.what}")


def _check(name: str, arguments: tuple, result) -> None:
    z, deviations, *about = arguments
    n, k = (len(about[0]) if about else 0), len(z)
    rows = n if about else k
    if result.z.shape != ((n, k, 3) if name == "debiased_at" else (k, 3)) or result.R.shape != (rows, 3, 3):
        raise Finding("shape", f"z {result.z.shape}, R {result.R.shape}")
    checks.finite("z", result.z)
    checks.finite("R", result.R)
    for R in result.R:
        if not (R == R.T).all() or np.linalg.eigvalsh(R)[0] < -1e-9 * np.abs(R).max():
            raise Finding("indefinite", f"R has eigenvalues {np.linalg.eigvalsh(R)}")
    # noise of at most half a radian moves a mean by no more than twice its square times the range
    far = np.linalg.norm(result.z - radar.cartesian(z), axis=-1)
    allowed = z[:, 0] * 2 * (deviations[1:] ** 2).sum() + 1e-12 * z[:, 0]
    if name != "debiased_at" and (far > allowed).any():
        raise Finding("value", f"moved by {far}, at most {allowed}")


def _draw_positions(rng: Rng) -> tuple:
    x = rng.standard_normal((int(rng.integers(0, 6)), 3)) * decades(rng, -6, 8)
    x[rng.random(x.shape) < 0.1] = 0.0
    given = x
    if rng.random() < 0.2:
        given = in_layout(x, LAYOUTS[rng.integers(len(LAYOUTS))])
        x = np.array(given, float)
    return given, x


def _there_and_back(given, x):
    z = radar.spherical(given)
    return z, radar.cartesian(z)


def _check_back(arguments: tuple, result) -> None:
    _, x = arguments
    z, back = result
    checks.finite("z", z)
    checks.close(
        "value", "there and back", back, x, 1e-14 * 8 * np.abs(x).max(initial=1e-300, axis=-1)[:, None]
    )
    if (z[:, 0] < 0).any() or (np.abs(z[:, 2]) > np.pi / 2).any() or (np.abs(z[:, 1]) > np.pi).any():
        raise Finding("value", f"coordinates {z.tolist()}")


def _spoil_positions(rng: Rng, arguments: tuple) -> Spoilt:
    spoilt = spoilt_points(rng, arguments[1], ("x",))
    return Spoilt((*spoilt.arguments, arguments[1]), spoilt.names, f"positions with {spoilt.what}")


def _draw_angles(rng: Rng) -> tuple:
    angle = rng.uniform(-1, 1, 5) * decades(rng, -3, 8)
    return angle, angle


def _check_angles(arguments: tuple, result) -> None:
    _, angle = arguments
    if (np.abs(result) > np.pi).any():
        raise Finding("value", f"{result} is beyond half a turn")
    off = np.abs(np.exp(1j * result) - np.exp(1j * angle))
    checks.close("value", "wrapped", off, 0.0, 1e-15 * (8 + np.abs(angle)))
