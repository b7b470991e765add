"""Distances between Gaussians and between mixtures as targets."""

from functools import partial

import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import Rng, hostile_mixture, spoilt_array, spoilt_mixture
from gmr_gym.mixture import Mixture
from gmr_gym.reduction import distances

PAIRS = ("kullback_leibler", "bhattacharyya", "hellinger", "correlation", "wasserstein")
MIXTURES = (
    "inner_product", "integral_squared_difference", "normalised_integral_squared_difference",
)  # fmt: skip


def distance_targets() -> list[Target]:
    """Every distance in closed form."""
    pairs = [
        Target(
            f"distance/{name}", _draw_pair, getattr(distances, name), partial(_check_pair, name), _spoil_pair
        )
        for name in PAIRS
    ]
    mixtures = [
        Target(
            f"distance/{name}", _draw_two, getattr(distances, name), partial(_check_two, name), _spoil_two,
            refuses="finite",
        )
        for name in MIXTURES
    ]  # fmt: skip
    return [*pairs, *mixtures]


def _draw_pair(rng: Rng) -> tuple:
    p = hostile_mixture(rng, 2)
    return p.m[0], p.P[0], p.m[-1], p.P[-1]


def _spoil_pair(rng: Rng, arguments: tuple) -> Spoilt:
    i = int(rng.integers(4))
    spoilt, what = spoilt_array(rng, arguments[i])
    if i % 2 and rng.random() < 0.3:
        spoilt, what = -arguments[i], "minus signs"
    name = ("m1", "P1", "m2", "P2")[i]
    return Spoilt((*arguments[:i], spoilt, *arguments[i + 1 :]), (name,), f"{name} with {what}")


def _check_pair(name: str, arguments: tuple, result) -> None:
    m1, P1, m2, P2 = arguments
    checks.finite(name, result)
    if not isinstance(result, float) or result < 0:
        raise Finding("value", f"{name} is {result!r}")
    if name in ("hellinger", "correlation") and result > 1:
        raise Finding("value", f"{name} is {result!r}, above 1")
    function = getattr(distances, name)
    condition = max(np.linalg.cond(P1), np.linalg.cond(P2))
    if name != "kullback_leibler":
        back = function(m2, P2, m1, P1)
        if condition < 1e8 and not abs(back - result) <= 1e-6 * max(abs(result), 1e-3):
            if name != "wasserstein" or abs(back - result) > 1e-6 * np.sqrt(
                np.abs(P1).max() + np.abs(P2).max()
            ):
                raise Finding("value", f"{name} is {result} one way and {back} the other")


def _draw_two(rng: Rng) -> tuple:
    p = hostile_mixture(rng, 4)
    return p, hostile_mixture(rng, 4, p.m.shape[1]) if rng.random() < 0.7 else p


def _spoil_two(rng: Rng, arguments: tuple) -> Spoilt:
    side = int(rng.integers(2))
    spoilt, names, what = spoilt_mixture(rng, arguments[side])
    both = [*arguments]
    both[side] = spoilt
    return Spoilt(tuple(both), (*names, "p", "q"), what)


def _check_two(name: str, arguments: tuple[Mixture, Mixture], result) -> None:
    p, q = arguments
    checks.finite(name, result)
    if result < 0 or (name.startswith("normalised") and result > 1 + 1e-9):
        raise Finding("value", f"{name} is {result}")
    if name != "inner_product" and p is q and name.startswith("normalised") and result > 1e-9:
        raise Finding("value", f"{name} of a mixture and itself is {result}")
