"""Trackers among the policies: rivals that are no policy of thresholds, with their work counted alike."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np

from gmr_gym.baselines.mht_of_banks import MhtOfBanks
from gmr_gym.filters.registry import make_tracker
from gmr_gym.literals import name_and_parameters
from gmr_gym.models.model import Model
from gmr_gym.models.switching import sticky_switching
from gmr_gym.reduction.merge_cost import merge_costs
from gmr_gym.simulation.reward import distance, score
from gmr_gym.simulation.single_target import Scenario, draw, scan


@dataclass(frozen=True)
class Tracked:
    """A tracker by its name and options, with one motion for each factor on the assumed process noise."""

    tracker: str
    options: Mapping[str, Any] = field(default_factory=dict)
    factors: Sequence[float] = (1.0,)  # on the standard deviation
    stay: float = 0.9  # probability that the motion stays the same from scan to scan

    def tracking(self, model: Model) -> Any:
        """The tracker for a filter model; of several motions as it is."""
        if len(model.motions) > 1:
            return make_tracker(self.tracker, model, **self.options)
        F, Q, offset = model.motion
        motions = tuple(type(model.motion)(F, factor**2 * Q, offset) for factor in self.factors)
        r = len(motions)
        several = model._replace(
            motions=motions, switching=sticky_switching(self.stay, r), mode_prior=np.full(r, 1 / r)
        )
        return make_tracker(self.tracker, several, **self.options)


def scans_of(
    policy: Tracked, scenario: Scenario, seeds: Sequence[int], price: float
) -> Iterator[tuple[list[tuple], bool]]:
    """Reward, error, work, components and seconds, scan by scan, of the episode of each seed, and whether a
    loss ended it: what the environment of the scenario gives a policy."""
    tracker, prior = policy.tracking(scenario.model), scenario.model.prior
    reduction, _ = name_and_parameters(policy.options.get("reduction", "runnalls"))
    for seed in seeds:
        episode, belief = draw(scenario, seed), tracker.init()
        centre, scans, off, over, lost = scenario.centre(prior.w @ prior.m), [], 0, False, False
        while not over:
            t = len(scans)
            z = scan(scenario, episode, t, centre).z
            started = perf_counter()
            belief, report, work = counted(tracker, reduction, belief, z)
            seconds = perf_counter() - started
            error = distance(report.x[0], episode.x[t], scenario.position)
            reward, off, lost, late = score(
                error / scenario.cutoff, 1.0, price * work, off, len(episode.x) - t - 1
            )
            scans.append((reward, error, work, len(report.mixture.w), seconds))
            centre, over = scenario.centre(report.x[0]), lost or late
        yield scans, lost


def counted(tracker: Any, reduction: str, belief: Any, z: np.ndarray) -> tuple[Any, Any, int]:
    """Belief and report of a scan, and its work: Gaussians updated by a detection, and what the reduction
    looks at to merge those that enter it."""
    if hasattr(belief, "work"):  # counts it itself
        belief, report = tracker.step(belief, z)
        return belief, report, belief.work
    belief, report, full = tracker.trace(belief, z)
    into = full.into
    if isinstance(tracker, MhtOfBanks):  # the outputs of its banks enter, not every filter
        into = into[: len(into) // len(tracker.model.motions)]
    sizes = np.bincount(into[into >= 0])
    return belief, report, int((full.detection >= 0).sum()) + WORK[reduction](sizes)


def _costs_of_pairs(sizes: np.ndarray) -> int:
    return int(merge_costs(sizes.sum(), len(sizes)))


def _looked_up(sizes: np.ndarray) -> int:
    return int(sizes.sum())


# of a reduction that merges groups of these sizes, as `gmr_gym.tuning.thresholds.reduced` counts it
WORK = {"runnalls": _costs_of_pairs, "adaptive": _costs_of_pairs, "n-scan": _looked_up}
