"""Track-oriented Poisson multi-Bernoulli trackers (Williams 2015, TOMB/P), one of which learns the clutter it
is in."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_limits, check_probability
from gmr_gym.filters import pmb as multi_bernoulli
from gmr_gym.filters.clutter_estimation import (
    ClutterEstimate,
    EstimatorOptions,
    initial_estimate,
    options,
    update_estimate,
)
from gmr_gym.filters.pmb import MultiBernoulli
from gmr_gym.filters.tracker import MultiTargetReport, check_scan
from gmr_gym.models.multi_target import MultiTargetModel


class LearningPmbBelief(NamedTuple):
    """What is believed of the targets, and of the clutter."""

    targets: MultiBernoulli
    estimate: ClutterEstimate


class PmbLimits(NamedTuple):
    """What is kept and what is named; `limits` checks one."""

    prune_existence: float  # a track less probable goes
    prune_weight: float  # expected number, of a component of the undetected
    tracks: int  # at most, and as many components of the undetected
    report_threshold: float  # a track more probable is named


def limits(prune_existence: float, prune_weight: float, tracks: int, report_threshold: float) -> PmbLimits:
    """Checked Limits; ValueError naming the one that is none."""
    check_limits(prune_weight, 1)
    if not tracks >= 1 or tracks != int(tracks):
        raise ValueError(f"tracks must be a whole number, at least 1, got {tracks}")
    check_probability("report_threshold", report_threshold)
    if not 0 <= prune_existence < report_threshold:
        raise ValueError(
            f"prune_existence must be a probability less than report_threshold {report_threshold}, got "
            f"{prune_existence}"
        )
    return PmbLimits(float(prune_existence), float(prune_weight), int(tracks), float(report_threshold))


@dataclass(frozen=True)
class Pmb:
    """Bernoulli tracks over a Poisson intensity of undetected targets, in the clutter it was told of."""

    model: MultiTargetModel
    limits: PmbLimits

    def init(self) -> MultiBernoulli:
        return multi_bernoulli.no_targets(self.model)

    def step(self, belief: MultiBernoulli, z: np.ndarray) -> tuple[MultiBernoulli, MultiTargetReport]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        targets, _ = _scanned(belief, model, z, model.clutter.density(z), self.limits)
        return targets, multi_bernoulli.report(targets, model.clutter, self.limits.report_threshold)


@dataclass(frozen=True)
class LearningPmb:
    """As Pmb, but the intensity of clutter is fitted to the scans so far, every detection counted by the
    probability that it is of no track, old or new. The scan is judged by what was learned before it."""

    model: MultiTargetModel
    options: EstimatorOptions
    limits: PmbLimits

    def init(self) -> LearningPmbBelief:
        return LearningPmbBelief(multi_bernoulli.no_targets(self.model), initial_estimate(self.model.clutter))

    def step(self, belief: LearningPmbBelief, z: np.ndarray) -> tuple[LearningPmbBelief, MultiTargetReport]:
        model, estimate = self.model, belief.estimate
        z = check_scan(z, len(model.sensor.H))
        targets, p_clutter = _scanned(belief.targets, model, z, estimate.clutter.density(z), self.limits)
        estimate = update_estimate(model.clutter, estimate, z, p_clutter, self.options)
        report = multi_bernoulli.report(targets, estimate.clutter, self.limits.report_threshold)
        return LearningPmbBelief(targets, estimate), report


def pmb(
    model: MultiTargetModel,
    prune_existence: float = 1e-3,
    prune_weight: float = 1e-5,
    tracks: int = 200,
    report_threshold: float = 0.5,
) -> Pmb:
    """Poisson multi-Bernoulli tracker of up to `tracks` tracks, which names those that exist with more than
    `report_threshold`."""
    return Pmb(model, limits(prune_existence, prune_weight, tracks, report_threshold))


def learning_pmb(
    model: MultiTargetModel,
    prune_existence: float = 1e-3,
    prune_weight: float = 1e-5,
    tracks: int = 200,
    report_threshold: float = 0.5,
    memory: int = 20,
    deviation: float = 15.0,
    max_gaussians: int = 12,
    iterations: int = 2,
) -> LearningPmb:
    """As `pmb`, of up to `tracks`, with clutter learned as a uniform and up to `most` Gaussians no narrower
    than `deviation` (m), which forgets within `memory` scans."""
    return LearningPmb(
        model,
        options(memory, deviation, max_gaussians, iterations),
        limits(prune_existence, prune_weight, tracks, report_threshold),
    )


def _scanned(belief, model, z, kappa, limits):
    """The targets after a scan, and the probability (k,) that each detection is false."""
    targets, p_clutter = multi_bernoulli.update(
        multi_bernoulli.predict(belief, model), model.sensor, z,
        model.detection_probability, kappa, limits.prune_existence,
    )  # fmt: skip
    return multi_bernoulli.prune(
        targets, limits.prune_existence, limits.prune_weight, limits.tracks
    ), p_clutter
