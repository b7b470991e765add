"""From episodes to figures with intervals.

Arrays are (seeds, instances, runs): seeds of training, one for what was not trained. Run i of an instance
is the same episode for every competitor and seed, so that differences are formed episode by episode."""

from collections.abc import Callable, Sequence
from warnings import catch_warnings, simplefilter

import numpy as np
from judge import Episodes
from scipy.stats import DegenerateDataWarning, bootstrap, trim_mean

from gmr_gym.evaluation.summary import CONFIDENCE, Estimate

RESAMPLES = 1000
Pick = Callable[[np.ndarray], np.ndarray]


def interquartile_mean(values: np.ndarray) -> float:
    """Mean of the middle half of all values: a few huge ones do not decide it, as they do the mean."""
    return float(trim_mean(values, 0.25, axis=None))


def improvement(values: np.ndarray, reference: np.ndarray) -> float:
    """Share of episodes in which the value is above that of the reference, half of it for ties.

    Departs: Agarwal et al. 2021 compare independent runs; here both play the same episode.
    """
    return float(np.mean((values > reference) + (values == reference) / 2))


def resampled(statistic: Callable[[Pick], Sequence[float]], shape: tuple[int, int, int]) -> list[Estimate]:
    """statistic(pick) -> f numbers, each with its interval by a stratified bootstrap (Agarwal et al. 2021):
    seeds are drawn again and, within each instance, runs. pick(array (seeds, instances, runs)) are the drawn
    ones; an array of one seed goes with every seed. The instances are what they are: the interval is of
    these tables, not of others like them. ValueError for fewer than two runs."""
    seeds, places, runs = shape
    if runs < 2:
        raise ValueError(f"an interval takes at least two runs of each instance, got {runs}")
    rows = np.arange(places)[:, None]

    def of(*drawn):
        chosen = np.array(drawn[:places], int)
        several = np.array(drawn[places:], int).ravel()  # none for one seed, of which scipy would not draw

        def pick(array):
            again = array[several] if len(array) > 1 else array
            return again[:, rows, chosen]

        return np.asarray(statistic(pick), float)

    data = [np.arange(runs)] * places + [np.arange(seeds)] * (seeds > 1)
    value = np.asarray(statistic(lambda array: array), float)
    with catch_warnings():
        simplefilter("ignore", DegenerateDataWarning)  # a share that is the same in every draw
        interval = bootstrap(
            data, of, vectorized=False, n_resamples=RESAMPLES, batch=100, confidence_level=CONFIDENCE,
            method="percentile", rng=np.random.default_rng(0),
        ).confidence_interval  # fmt: skip
    return [Estimate(*map(float, row)) for row in zip(value, interval.low, interval.high, strict=True)]


def together(seeds: Sequence[Episodes]) -> Episodes:
    """Episodes of several seeds of training as arrays (seeds, instances, runs)."""
    return Episodes(*(np.stack(parts) for parts in zip(*seeds, strict=True)))


def figures(episodes: Episodes) -> dict[str, Estimate]:
    """Of one competitor: track_loss (share), error_kept (m, over episodes that were not lost), error_capped
    (m), work and reward, each as mean and, `_iqm`, as interquartile mean, and time_per_scan (s, median)."""

    def statistic(pick):
        e = Episodes(*map(pick, episodes))
        held = e.lost == 0
        return (
            e.lost.mean(), e.error[held].mean() if held.any() else np.nan, e.capped.mean(),
            interquartile_mean(e.capped), e.work.mean(), interquartile_mean(e.work), e.reward.mean(),
            interquartile_mean(e.reward), np.median(e.seconds),
        )  # fmt: skip

    names = (
        "track_loss", "error_kept", "error_capped", "error_capped_iqm", "work", "work_iqm", "reward",
        "reward_iqm", "time_per_scan",
    )  # fmt: skip
    found = dict(zip(names, resampled(statistic, episodes.reward.shape), strict=True))
    # one episode of each instance is timed: there is nothing to draw again
    return found | {"time_per_scan": Estimate(found["time_per_scan"].value, np.nan, np.nan)}


def against(episodes: Episodes, reference: Episodes) -> dict[str, Estimate]:
    """One competitor minus a reference of one seed, episode by episode of those that both played:
    track_loss, error_kept (m, over episodes that neither lost), error_capped (m), reward;
    work_ratio and work_iqm_ratio of their means; and the probability of improvement of the reward."""
    runs = min(episodes.reward.shape[2], reference.reward.shape[2])
    mine, other = (Episodes(*(part[..., :runs] for part in e)) for e in (episodes, reference))

    def statistic(pick):
        a, b = Episodes(*map(pick, mine)), Episodes(*map(pick, other))
        both = (a.lost == 0) & (b.lost == 0)
        gain = a.error - b.error
        return (
            (a.lost - b.lost).mean(), gain[both].mean() if both.any() else np.nan,
            (a.capped - b.capped).mean(), (a.reward - b.reward).mean(), a.work.mean() / b.work.mean(),
            interquartile_mean(a.work) / interquartile_mean(b.work), improvement(a.reward, b.reward),
        )  # fmt: skip

    names = (
        "track_loss", "error_kept", "error_capped", "reward", "work_ratio", "work_iqm_ratio", "improvement",
    )  # fmt: skip
    return dict(zip(names, resampled(statistic, mine.reward.shape), strict=True))


def against_front(episodes: Episodes, constants: Episodes) -> dict[str, Estimate]:
    """Work as a share of that which the front of constants (n, instances, runs) takes at the same
    error_capped, and at the same track_loss, on the episodes that all of them played; nan where no constant
    is as good. A front of noisy points flatters the constants."""
    runs = min(episodes.reward.shape[2], constants.reward.shape[2])
    mine = [part[..., :runs] for part in (episodes.work, episodes.capped, episodes.lost)]
    # (1, instances, runs, n): all of them are drawn again together, with the competitor
    cloud = [
        np.moveaxis(part[..., :runs], 0, -1)[None]
        for part in (constants.work, constants.capped, constants.lost)
    ]

    def statistic(pick):
        work, *errors = (pick(part).mean() for part in mine)
        front_work, *front_errors = (pick(part).mean(axis=(0, 1, 2)) for part in cloud)
        return [
            work / work_on(np.column_stack((corners, front_work)), error)
            for corners, error in zip(front_errors, errors, strict=True)
        ]

    shares = resampled(statistic, mine[0].shape)
    return dict(zip(("work_at_equal_error", "work_at_equal_loss"), shares, strict=True))


def place(episodes: Episodes) -> dict[str, float]:
    """Where episodes lie in a plot of error or losses against work."""
    return {
        "track_loss": float(episodes.lost.mean()), "error_capped": float(episodes.capped.mean()),
        "work": float(episodes.work.mean()), "work_iqm": interquartile_mean(episodes.work),
    }  # fmt: skip


def front(points: np.ndarray) -> np.ndarray:
    """Indices of the points (n, 2) that no other is at most equal to in both and less in one, by the
    first coordinate; of equal points the first."""
    kept, least = [], np.inf
    for i in np.lexsort((points[:, 1], points[:, 0])):
        if points[i, 1] < least:
            kept.append(i)
            least = points[i, 1]
    return np.array(kept, int)


def work_on(points: np.ndarray, error: float) -> float:
    """The work that the front of points (n, 2), error and work, takes for no more than an error: between its
    corners the logarithm of work is linear. nan where no point is as good."""
    corners = points[front(points)]
    if error < corners[0, 0]:
        return np.nan
    return float(np.exp(np.interp(error, corners[:, 0], np.log(corners[:, 1]))))


def surface(actions: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The quadratic in actions (n, j) that is nearest to values (n, i), at the actions: what neighbours have
    in common, without the noise of each."""
    ones = np.column_stack([np.ones(len(actions)), actions])
    i, k = np.triu_indices(ones.shape[1])
    terms = ones[:, i] * ones[:, k]
    return terms @ np.linalg.lstsq(terms, values, rcond=None)[0]


def chosen_by_instance(actions: np.ndarray, seen: Episodes, price: float, cutoff: float) -> np.ndarray:
    """For each instance the place among actions (n, j) of that with the least cost of a scan, capped error
    over cutoff plus price times work, by what they did in episodes (n, instances, runs).

    Of a few dozen episodes each, the best would be the luckiest. Error and work are therefore smoothed over
    the actions, and what the error of an instance has of its own counts as far as two halves of the runs
    agree on it."""
    halves = np.array([surface(actions, seen.capped[..., i::2].mean(axis=-1)) / cutoff for i in (0, 1)])
    halves -= halves.mean(axis=1, keepdims=True)  # what is hard whatever is done does not matter
    shared = halves.mean(axis=2, keepdims=True)
    own = halves - shared
    scale = np.sqrt((own[0] ** 2).sum() * (own[1] ** 2).sum())
    alike = max((own[0] * own[1]).sum() / scale, 0.0) if scale > 0 else 0.0
    reliable = 2 * alike / (1 + alike)  # of the mean of both (Spearman and Brown)
    work = np.exp(surface(actions, np.log(seen.work.mean(axis=-1))))
    return (shared.mean(axis=0) + reliable * own.mean(axis=0) + price * work).argmin(axis=0)


def hindsight_front(
    actions: np.ndarray, seen: Episodes, scored: Episodes, prices: Sequence[float], cutoff: float
) -> list[dict[str, float]]:
    """Where constants lie that are chosen instance by instance, one place for each price of work: chosen by
    what the actions (n, j) did in the episodes `seen`, and placed by others, (n, instances, runs) both."""
    rows = np.arange(seen.work.shape[1])
    chosen = (chosen_by_instance(actions, seen, price, cutoff) for price in prices)
    return [place(Episodes(*(part[best, rows] for part in scored))) for best in chosen]
