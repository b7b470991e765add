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


class Learning(NamedTuple):
    """What is believed of the targets, and of the clutter."""

    targets: MultiBernoulli
    lessons: ClutterEstimate


class Limits(NamedTuple):
    """What is kept and what is named; `limits` checks one."""

    prune_existence: float  # a track less probable goes
    prune_weight: float  # expected number, of a component of the undetected
    tracks: int  # at most, and as many components of the undetected
    report_threshold: float  # a track more probable is named


def limits(prune_existence: float, prune_weight: float, tracks: int, report_threshold: float) -> Limits:
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
    return Limits(float(prune_existence), float(prune_weight), int(tracks), float(report_threshold))


@dataclass(frozen=True)
class Pmb:
    """Bernoulli tracks over a Poisson intensity of undetected targets, in the clutter it was told of."""

    model: MultiTargetModel
    limits: Limits

    def init(self) -> MultiBernoulli:
        return multi_bernoulli.no_targets(self.model)

    def step(self, belief: MultiBernoulli, z: np.ndarray) -> tuple[MultiBernoulli, MultiTargetReport]:
        told = self.model
        z = check_scan(z, len(told.sensor.H))
        targets, _ = _scanned(belief, told, z, told.clutter.density(z), self.limits)
        return targets, multi_bernoulli.report(targets, told.clutter, self.limits.report_threshold)


@dataclass(frozen=True)
class LearningPmb:
    """As Pmb, but the intensity of clutter is fitted to the scans so far, every detection counted by the
    probability that it is of no track, old or new. The scan is judged by what was learned before it."""

    model: MultiTargetModel
    how: EstimatorOptions
    limits: Limits

    def init(self) -> Learning:
        return Learning(multi_bernoulli.no_targets(self.model), initial_estimate(self.model.clutter))

    def step(self, belief: Learning, z: np.ndarray) -> tuple[Learning, MultiTargetReport]:
        told, lessons = self.model, belief.lessons
        z = check_scan(z, len(told.sensor.H))
        targets, false = _scanned(belief.targets, told, z, lessons.clutter.density(z), self.limits)
        lessons = update_estimate(told.clutter, lessons, z, false, self.how)
        account = multi_bernoulli.report(targets, lessons.clutter, self.limits.report_threshold)
        return Learning(targets, lessons), account


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
    most: int = 12,
    iterations: int = 2,
) -> LearningPmb:
    """As `pmb`, of up to `tracks`, with clutter learned as a uniform and up to `most` Gaussians no narrower
    than `deviation` (m), which forgets within `memory` scans."""
    return LearningPmb(
        model,
        options(memory, deviation, most, iterations),
        limits(prune_existence, prune_weight, tracks, report_threshold),
    )


def _scanned(belief, told, z, kappa, limits):
    """The targets after a scan, and the probability (k,) that each detection is false."""
    targets, false = multi_bernoulli.update(
        multi_bernoulli.predict(belief, told), told.sensor, z,
        told.detection_probability, kappa, limits.prune_existence,
    )  # fmt: skip
    return multi_bernoulli.prune(targets, limits.prune_existence, limits.prune_weight, limits.tracks), false
