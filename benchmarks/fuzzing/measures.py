"""Metrics, distances between Gaussians and radar conversions as targets, against forms of their own."""

from collections.abc import Callable
from functools import partial
from itertools import permutations

import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import LAYOUTS, Rng, decades, hostile_mixture, in_layout, spoilt_points
from gmr_gym.evaluation import metrics

SETS = ("ospa", "gospa", "wasserstein")
ORDERS = (1.0, 1.5, 2.0, 2.0, 2.0, 7.0, 155.0, 400.0, 1e6)


def metric_targets() -> list[Target]:
    """Every metric there is."""
    sets = [
        Target(
            f"metric/{name}",
            partial(_draw_sets, name),
            partial(_measured, getattr(metrics, name)),
            partial(_check_sets, name),
            partial(_spoil_sets, name),
            share=2.0,
            refuses="order must be finite and leave",
        )
        for name in SETS
    ]
    return [
        *sets,
        Target("metric/nees", _draw_errors, _nees, _check_nees, _spoil_errors),
        Target("metric/credibility", _draw_runs, _credibility, _check_credibility, _spoil_runs, share=0.5),
        Target("metric/lost_at", _draw_off, metrics.lost_at, _check_lost, share=0.3),
    ]


def _points(rng: Rng, d: int) -> np.ndarray:
    k = int(rng.choice([0, 1, 1, 2, 3, 3, 4, 12])) if rng.random() < 0.999 else 150
    kind = rng.integers(4)
    if kind == 0:
        return np.repeat(rng.standard_normal((1, d)), k, axis=0) * decades(rng, -8, 8)
    if kind == 1:
        return decades(rng, 0, 8) + rng.standard_normal((k, d)) * decades(rng, -6, 2)
    return rng.standard_normal((k, d)) * decades(rng, -8, 8, (k, 1) if kind == 2 else None)


def _draw_sets(name: str, rng: Rng) -> tuple:
    d = int(rng.integers(1, 4))
    plain = [_points(rng, d), _points(rng, d)]
    if rng.random() < 0.2:
        plain[1] = plain[0][rng.permutation(len(plain[0]))]
    numbers = {"order": float(rng.choice(ORDERS))}
    if name != "wasserstein":
        numbers["cutoff"] = float(decades(rng, -8, 8))
    given = plain
    if rng.random() < 0.1:
        layout = LAYOUTS[rng.integers(len(LAYOUTS))]
        given = [in_layout(z, layout) for z in plain]
        plain = [np.array(z, float) for z in given]
    return *given, numbers, plain


def _measured(metric: Callable, x, y, numbers: dict, plain):
    return metric(x, y, **numbers)


def _spoil_sets(name: str, rng: Rng, arguments: tuple) -> Spoilt:
    _x, _y, numbers, plain = arguments
    if rng.random() < 0.3:
        key = list(numbers)[rng.integers(len(numbers))]
        value = (np.nan, -np.inf, -1.0, 0.0, "two", None, 1j)[rng.integers(7)]
        return Spoilt((*plain, numbers | {key: value}, plain), (key,), f"{key} {value!r}")
    side = int(rng.integers(2))
    spoilt = spoilt_points(rng, plain[side], ("estimates", "targets"))
    sets = [*plain]
    sets[side] = spoilt.arguments[0]
    if spoilt.what == "a coordinate too many" and len(plain[1 - side].shape) == 2:
        sets[side] = np.zeros((2, plain[1 - side].shape[1] + 1))
    return Spoilt((*sets, numbers, sets), spoilt.names, f"a set with {spoilt.what}")


def _check_sets(name: str, arguments: tuple, result) -> None:
    _, _, numbers, (x, y) = arguments
    total = result.total if name == "gospa" else result
    if name == "wasserstein" and min(len(x), len(y)) == 0:
        return checks.same("value", "of nothing there is no distance", total, np.nan)
    checks.finite(name, total)
    if name == "gospa" and numbers["cutoff"] ** numbers["order"] < 1e300:
        checks.finite("parts", np.array(result))
    wanted = set_distance(name, x, y, **numbers)
    if wanted is not None:
        checks.close("value", name, total, wanted, 1e-9 * wanted + 1e-300)
    if name == "ospa" and total > numbers["cutoff"] * (1 + 1e-12):
        raise Finding("value", f"{total} is beyond the cutoff {numbers['cutoff']}")


def set_distance(name: str, x, y, order: float, cutoff: float = np.inf) -> float | None:
    """A distance of sets by trying every assignment, nothing raised to a power before it is scaled; None for
    sets too large for that."""
    if len(x) > len(y):
        x, y = y, x
    j, k = len(x), len(y)
    if k > 4:
        return None
    if k == 0 or (name == "wasserstein" and (j == 0 or j != k)):
        return 0.0 if k == 0 or j == 0 else None
    away = np.minimum(np.sqrt(((x[:, None] - y[None]) ** 2).sum(axis=2)), cutoff)
    surplus = (
        [] if name == "wasserstein" else [cutoff * (0.5 if name == "gospa" else 1.0) ** (1 / order)] * (k - j)
    )
    best = np.inf
    for chosen in permutations(range(k), j):
        terms = np.array([*(away[i, c] for i, c in enumerate(chosen)), *surplus], np.longdouble)
        top = terms.max()
        if top > 0:
            whole = ((terms / top) ** order).sum() / (1 if name == "gospa" else k)
            best = min(best, float(top * whole ** (np.longdouble(1) / order)))
        else:
            best = 0.0
    return best


def _draw_errors(rng: Rng) -> tuple:
    p = hostile_mixture(rng, 4)
    return p.m, p.P


def _nees(e, P):
    return metrics.nees(e, P)


def _check_nees(arguments: tuple, result) -> None:
    e, P = arguments
    checks.finite("nees", result)
    conditions = np.linalg.cond(P)
    wanted = [x @ np.linalg.solve(C.astype(float), x) for x, C in zip(e, P, strict=True)]
    checks.close("value", "nees", result, np.array(wanted), 1e-13 * conditions * (np.abs(wanted) + 1e-300))
    if (result < -1e-12 * conditions * np.abs(result)).any():
        raise Finding("value", f"a square is negative: {result.tolist()}")


def _spoil_errors(rng: Rng, arguments: tuple) -> Spoilt:
    e, P = arguments
    if rng.random() < 0.5:
        e = (e[:, :, None, None], np.array([["x"]]), e + 1j)[rng.integers(3)]
        return Spoilt((e, P), ("error",), "errors of another kind")
    P = P[:, :, :0] if rng.random() < 0.5 else P + 1j
    return Spoilt((e, P), ("P",), "covariances of another kind")


def _draw_runs(rng: Rng) -> tuple:
    runs, scans, d = int(rng.integers(1, 8)), int(rng.integers(1, 4)), int(rng.integers(1, 4))
    error = decades(rng, -6, 8) * rng.standard_normal((runs, scans, d))
    claimed = decades(rng, -8, 8, (runs, scans))
    weight = None if rng.random() < 0.5 else (rng.random(runs) < 0.7).astype(float)
    return error, claimed, weight


def _credibility(error, claimed, weight):
    return metrics.credibility(error, claimed, weight)


def _check_credibility(arguments: tuple, result) -> None:
    error, _claimed, weight = arguments
    index, inclination = result
    runs, scans, d = error.shape
    if index.shape != (scans,) or inclination.shape != (scans,):
        raise Finding("shape", f"{index.shape}, {inclination.shape}")
    counted = runs if weight is None else int(weight.sum())
    if counted > d + 1 and not np.isfinite(index).all():
        raise Finding("not finite", f"index {index} of {counted} runs in {d} dimensions")
    if (index < np.abs(inclination) - 1e-9).any():
        raise Finding("value", f"index {index} is below inclination {inclination}")


def _spoil_runs(rng: Rng, arguments: tuple) -> Spoilt:
    error, claimed, weight = arguments
    kind = rng.integers(4)
    if kind == 0:
        return Spoilt((error[0], claimed, weight), ("error",), "errors of two axes")
    if kind == 1:
        return Spoilt((error, claimed[:, :0], weight), ("claimed",), "claims of no scan")
    if kind == 2:
        return Spoilt((error, claimed, np.ones(len(error) + 1)), ("weight",), "a weight too many")
    return Spoilt((error, claimed, np.full(len(error), -1.0)), ("weight",), "negative weights")


def _draw_off(rng: Rng) -> tuple:
    return rng.random((int(rng.integers(1, 5)), int(rng.integers(1, 30)))) < 0.7, int(rng.integers(1, 6))


def _check_lost(arguments: tuple, result) -> None:
    off, patience = arguments
    for row, at in zip(off, result, strict=True):
        text = "".join("x" if lost else "." for lost in row)
        first = text.find("x" * patience)
        if at != (first + patience - 1 if first >= 0 else -1):
            raise Finding("value", f"{text} with patience {patience} is lost at {at}")
