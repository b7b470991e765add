"""How good fronts are: losses against work and against time, with intervals.

A front is a few policies of one kind, one for each price of work, and their episodes (seeds, instances,
runs): seeds of training, one for what was not trained. Run i of an instance is the same episode for all."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from judge import Episodes
from scores import RESAMPLES

from gmr_gym.evaluation.fronts import at_cost, hypervolume
from gmr_gym.evaluation.summary import CONFIDENCE, Estimate

# the cost of a front, and whether its mean is that of the middle half
AXES = {"work": ("work", False), "work_iqm": ("work", True), "time": ("seconds", False)}
# where a hypervolume ends: a decade above what an ordinary front takes
WORST = {"work": 1e3, "work_iqm": 1e3, "time": 1e-3}
WORST_LOSS = 0.5
BEST_OTHER = "best of the others"


class Drawn(NamedTuple):
    """How often each was drawn in the draws of a bootstrap; once each in the first."""

    seeds: np.ndarray  # (draws, seeds)
    episodes: np.ndarray  # (draws, instances * runs)


class Points(NamedTuple):
    """Where the policies of a front lie in every draw of a bootstrap."""

    log_cost: np.ndarray  # (draws, seeds, n), decades
    lost: np.ndarray  # (draws, seeds, n)
    share: np.ndarray  # (draws, seeds), of the seeds, by how often each was drawn


def drawn_again(seeds: int, instances: int, runs: int, resamples: int = RESAMPLES) -> Drawn:
    """Draws seeds of training, instances and, within each instance, runs.

    The interval is of tables like these, with other instances: `scores.resampled` keeps the instances. It is
    the same for all who played these episodes, so that their differences are paired."""
    rng = np.random.default_rng(0)
    taken = rng.multinomial(seeds, np.full(seeds, 1 / seeds), resamples)
    places = rng.multinomial(instances, np.full(instances, 1 / instances), resamples)
    episodes = rng.multinomial(places * runs, np.full(runs, 1 / runs)).reshape(resamples, -1)
    once = np.ones((1, seeds), int), np.ones((1, instances * runs), int)
    return Drawn(*(np.vstack(pair) for pair in zip(once, (taken, episodes), strict=True)))


def means(values: np.ndarray, drawn: np.ndarray, middle: bool = False) -> np.ndarray:
    """Means (draws, ...) of values (..., e) of the episodes of every draw, or of the middle half of them."""
    if not middle:
        return np.moveaxis(values @ drawn.T, -1, 0) / drawn.sum(axis=1).reshape(-1, *[1] * (values.ndim - 1))
    rows = values.reshape(-1, values.shape[-1])
    found = np.empty((len(drawn), len(rows)))
    for i, row in enumerate(rows):
        order = np.argsort(row)
        ends = np.cumsum(drawn[:, order], axis=1) / drawn.sum(axis=1, keepdims=True)
        inside = np.diff(np.clip(ends, 0.25, 0.75), axis=1, prepend=0.25)
        found[:, i] = inside @ row[order] / 0.5
    return found.reshape(len(drawn), *values.shape[:-1])


def points(front: Sequence[Episodes], axis: str, drawn: Drawn) -> Points:
    """Where a front lies, by one of AXES."""
    field, middle = AXES[axis]
    cost, lost = (
        np.stack([getattr(e, name).reshape(len(e.lost), -1) for e in front], axis=1)
        for name in (field, "lost")
    )
    seeds = drawn.seeds if cost.shape[0] > 1 else np.ones((len(drawn.seeds), 1))
    return Points(
        np.log10(means(cost, drawn.episodes, middle)), means(lost, drawn.episodes),
        seeds / seeds.sum(axis=1, keepdims=True),
    )  # fmt: skip


def compared(
    fronts: Mapping[str, Sequence[Episodes]], reference: str, axis: str, bounds: Sequence[str] = ()
) -> dict[str, dict[str, Estimate]]:
    """Hypervolumes of the fronts, in decades of cost times the share of targets lost, and by how much the
    reference exceeds each of the others and, which flatters them, the best of them in every draw. Those that
    are named as bounds are no rivals, and not among the best.

    ValueError for fronts of other instances and runs, which cannot be paired."""
    shapes = {e.lost.shape[1:] for front in fronts.values() for e in front}
    if len(shapes) > 1:
        raise ValueError(f"fronts are compared on common episodes, got (instances, runs) {sorted(shapes)}")
    drawn = drawn_again(len(fronts[reference][0].lost), *shapes.pop())
    volumes = {name: _volume(points(front, axis, drawn), axis) for name, front in fronts.items()}
    if others := [volume for name, volume in volumes.items() if name not in (reference, *bounds)]:
        volumes[BEST_OTHER] = np.max(others, axis=0)
    return {
        name: {"hypervolume": _estimate(volume)}
        | ({"behind": _estimate(volumes[reference] - volume)} if name != reference else {})
        for name, volume in volumes.items()
    }


def losses_at(
    mine: Sequence[Episodes], other: Sequence[Episodes], axis: str, costs: Sequence[float]
) -> list[dict[str, Estimate]]:
    """At each cost the share of targets that either front loses, and the ratio of both; nan where a front
    begins at more than that cost."""
    drawn = drawn_again(*mine[0].lost.shape)
    fronts = [points(front, axis, drawn) for front in (mine, other)]
    found = []
    for cost in costs:
        lost, others = (
            (p.share * at_cost(p.log_cost, p.lost, float(np.log10(cost)))).sum(axis=1) for p in fronts
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = lost / others
        found.append({"lost": _estimate(lost), "other": _estimate(others), "ratio": _estimate(ratio)})
    return found


def by_instance(front: Sequence[Episodes], prices: Sequence[float]) -> list[Episodes]:
    """In hindsight the best policy of a front (1, instances, runs) for every instance, one point a price.

    It is chosen by the even runs for the odd ones, and by these for the even ones: chosen and scored by the
    same, it would be the luckiest. What an instance has of its own counts as far as both halves agree."""
    reward, work = (
        np.stack([part(e)[0] for e in front]) for part in (lambda e: e.reward, lambda e: e.work * e.scans)
    )
    found = []
    for price in prices:
        value = reward - price * work
        halves = np.array([value[..., i::2].mean(axis=-1) for i in (0, 1)])
        halves -= halves.mean(axis=1, keepdims=True)  # what is hard whatever is done does not matter
        shared = halves.mean(axis=2, keepdims=True)
        own = halves - shared
        scale = np.sqrt((own[0] ** 2).sum() * (own[1] ** 2).sum())
        alike = max((own[0] * own[1]).sum() / scale, 0.0) if scale > 0 else 0.0
        best = (shared + alike * own).argmax(axis=1)  # (half, instances)
        parts = []
        for field in zip(*front, strict=True):
            taken = np.array(field[0], float)
            for i in (0, 1):
                for place, k in enumerate(best[i]):
                    taken[0, place, 1 - i :: 2] = field[k][0, place, 1 - i :: 2]
            parts.append(taken)
        found.append(Episodes(*parts))
    return found


def _volume(p: Points, axis: str) -> np.ndarray:
    worst = float(np.log10(WORST[axis])), WORST_LOSS
    return (p.share * hypervolume(p.log_cost, p.lost, worst)).sum(axis=1)


def _estimate(draws: np.ndarray) -> Estimate:
    """The first of the draws (draws,), with the interval of the others, nan where some is undefined."""
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(draws[1:], (tail, 100 - tail))
    return Estimate(float(draws[0]), float(low), float(high))
