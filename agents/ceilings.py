"""What thresholds by instance or by episode could gain, of trackers that no environment tunes:
`python agents/ceilings.py`.

Constants are played on common episodes. The best of them at a price of work is what a policy has to beat. The
best of each instance, chosen on half of the episodes and judged on the other, is what could be learned of
instances; the best of each episode, in hindsight, is a bound on choices that hold for an episode: it has the
luck of the draw in it."""

from collections.abc import Mapping, Sequence
from itertools import product
from typing import Annotated, Any, NamedTuple

import numpy as np
import typer
from judge import seeds_of
from tracked import Tracked, scans_of

from gmr_gym.evaluation.metrics import gospa
from gmr_gym.experiments.formats import piped
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.scenarios.williams import meeting_targets
from gmr_gym.scenarios.zhang import jump_markov
from gmr_gym.simulation import multi_target
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario

PRICES = 1e-5, 1e-4, 1e-3  # of a unit of work of a scan, whose error is at most 1


class Question(NamedTuple):
    """A tracker, its instances, and the constants among which to choose."""

    tracker: str
    scenarios: Sequence[Scenario | MultiTargetScenario]
    constants: Sequence[Mapping[str, Any]]


def questions() -> list[Question]:
    """Those that are asked."""
    jumps = [
        jump_markov(case, detection_probability=p) for case, p in product(("1", "2", "stress"), (1.0, 0.9))
    ]
    many = [
        unknown_clutter(told="true"), unknown_clutter("dense", told="true"), meeting_targets(),
        meeting_targets(0.75, 40.0),
    ]  # fmt: skip
    return [
        Question("imm-mht", jumps, grid(components=(2, 4, 8, 15), prune_weight=(1e-5, 1e-3, 1e-2, 5e-2))),
        Question("gm-phd", many, grid(components=(10, 30, 100), prune_weight=(1e-6, 1e-4, 1e-3, 1e-2))),
        Question("pmb", many, grid(prune_existence=(1e-4, 1e-3, 1e-2, 5e-2), prune_weight=(1e-5, 1e-3))),
    ]


def grid(**values: Sequence) -> list[dict[str, Any]]:
    """Options of a tracker, of every combination of values."""
    return [dict(zip(values, each, strict=True)) for each in product(*values.values())]


def played(question: Question, runs: int, seed: int) -> np.ndarray:
    """Error and work of a scan (2, instances, runs, constants), the error in cutoffs."""
    return np.array([
        [one(question.tracker, options, scenario, seeds_of(seed, i, runs)) for options in question.constants]
        for i, scenario in enumerate(question.scenarios)
    ]).transpose(3, 0, 2, 1)  # fmt: skip


def one(tracker: str, options: Mapping[str, Any], scenario: Any, seeds: Sequence[int]) -> list[tuple]:
    """Error and work of a scan in the episode of each seed."""
    if isinstance(scenario, MultiTargetScenario):
        return [_of_many(make_tracker(tracker, scenario.model, **options), scenario, seed) for seed in seeds]
    found = []
    for scans, _ in scans_of(Tracked(tracker, options), scenario, seeds, 0.0):
        rewards, _, work, _, _ = np.array(scans).T
        found.append((-rewards.sum() / scenario.horizon, work.sum() / scenario.horizon))
    return found


def _of_many(tracker: Any, scenario: MultiTargetScenario, seed: int) -> tuple[float, float]:
    """GOSPA in cutoffs, and work: components predicted times one more than detections."""
    episode, belief, at, rows = multi_target.draw(scenario, seed), tracker.init(), list(scenario.position), []
    predicted = 0
    for t, x in enumerate(episode.x):
        z = multi_target.scan(episode, t).z
        belief, report = tracker.step(belief, z)
        truth = x[np.isfinite(x).all(axis=1)][:, at]
        distance, *_ = gospa(report.x[:, at], truth, scenario.cutoff, scenario.order)
        rows.append((distance / scenario.cutoff, predicted * (len(z) + 1)))
        predicted = len(report.intensity.w)
    error, work = np.mean(rows, axis=0)
    return float(error), float(work)


def gains(cost: np.ndarray) -> tuple[int, float, float, float]:
    """By costs (instances, runs, constants): the best constant, what it costs, and how much less, as a share,
    the best of each instance costs on other episodes than those it was chosen on, against a constant that is
    chosen like it, and the best of each episode."""
    best = cost.mean((0, 1))
    apart = same = 0.0
    for chosen, judged in ((cost[:, ::2], cost[:, 1::2]), (cost[:, 1::2], cost[:, ::2])):
        own = chosen.mean(1).argmin(1)
        apart += float(np.mean([row[:, k].mean() for row, k in zip(judged, own, strict=True)]))
        same += float(judged[..., chosen.mean((0, 1)).argmin()].mean())
    return int(best.argmin()), float(best.min()), 1 - apart / same, 1 - float(cost.min(2).mean() / best.min())


def main(
    runs: Annotated[int, typer.Option(help="episodes of every instance", min=2)] = 24,
    seed: Annotated[int, typer.Option(help="of the episodes", min=0)] = 1,
) -> None:
    """Prints a row for each tracker and price."""
    rows = []
    for question in questions():
        error, work = played(question, runs, seed)
        for price in PRICES:
            best, cost, instance, episode = gains(error + price * work)
            said = ", ".join(f"{name} {value:g}" for name, value in question.constants[best].items())
            row = f"{price:g}", said, f"{cost:.4f}", f"{100 * instance:.1f}", f"{100 * episode:.1f}"
            rows.append((question.tracker, *row))
    print(piped(("tracker", "price", "best constant", "cost", "by instance, %", "by episode, %"), rows))


if __name__ == "__main__":
    typer.run(main)
