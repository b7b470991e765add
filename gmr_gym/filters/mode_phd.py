"""The Gaussian-mixture PHD filter of targets that switch between motions: components are banks of filters.

With one motion it is the filter of `phd`, of a radar too and of a probability of detection by state.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_choice, check_limits
from gmr_gym.filters import phd
from gmr_gym.filters.gm_phd import ESTIMATORS
from gmr_gym.filters.phd import LabelledIntensity
from gmr_gym.filters.target_densities import Densities, joined, merge, moved, outputs, posteriors, take
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport
from gmr_gym.filters.undetected_targets import Intensity, appear, detected, intensity_of, joined_intensities
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced, check_reduced


class LabelledModes(NamedTuple):
    """An intensity over states and modes, whose components have labels of targets.

    Attributes
    ----------
    intensity : Intensity
        n components.
    label : ndarray of int, shape (n,)
        Label of each; several components may share one.
    next_label : int
        Next unused label.
    """

    intensity: Intensity
    label: np.ndarray
    next_label: int


@dataclass(frozen=True)
class ModePhd(KnownClutterTracker):
    r"""GM-PHD filter over modes: predict with births and spawning, update, prune, reduce.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    reduce : callable
        Reduction of the intensity over all modes; what it merges is merged mode by mode.
    prune_weight : float
        Components of less weight, an expected number of targets, are pruned.
    max_components : int
        Most components that enter `reduce`, the heaviest.
    estimator : {"expected", "components"}
        As of `gmr_gym.filters.gm_phd.GmPhd`.

    Notes
    -----
    Departs: Pasha et al. have a mixture for every mode, whose components multiply by the modes in each
    prediction; a component here has all modes, mixed as in an IMM.

    References
    ----------
    Vo and Ma 2006; Pasha, Vo, Tuan and Ma 2009; Blom and Bar-Shalom 1988.
    """

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    prune_weight: float = 1e-5
    max_components: int = 2000
    estimator: str = "expected"

    def __post_init__(self) -> None:
        check_choice("estimator", self.estimator, ESTIMATORS)
        check_limits(self.prune_weight, self.max_components)
        d = len(self.model.motions[0].F)
        check_reduced(self.reduce(Mixture(np.ones(1), np.zeros((1, d)), np.eye(d)[None])), 1)

    def init(self) -> LabelledModes:
        """Belief one period before the first scan."""
        intensity = intensity_of(self.model.initial, self.model)
        return LabelledModes(intensity, np.arange(len(intensity.w)), len(intensity.w))

    def update(
        self, belief: LabelledModes, z: np.ndarray, clutter: Clutter
    ) -> tuple[LabelledModes, np.ndarray]:
        """Posterior of the scan `z` (k, p), and the probability (k,) that each detection is a false alarm."""
        predicted = _predict(belief, self.model)
        (w, densities), label, _ = predicted
        appearing = appear(predicted.intensity, self.model, z, np.log(clutter.density(z)))
        _, pairs, log_part, log_ratio = appearing
        found = np.exp(log_part - log_ratio[pairs.detection])
        missed = w * (1.0 - detected(densities, self.model))
        kept, chosen = (np.flatnonzero((a >= self.prune_weight) & (a > 0)) for a in (missed, found))
        posterior = Intensity(
            np.append(missed[kept], found[chosen]),
            joined([take(densities, kept), posteriors(densities, pairs, chosen)]),
        )
        labels = np.append(label[kept], label[pairs.row[chosen]])
        return predicted._replace(intensity=posterior, label=labels), np.exp(-log_ratio)

    def report(self, posterior: LabelledModes, clutter: Clutter) -> tuple[LabelledModes, MultiTargetReport]:
        """The reduced posterior and its report."""
        total = round(float(posterior.intensity.w.sum()))
        reduced = self._reduced(posterior)
        (w, densities), label, next_label = reduced
        plain = LabelledIntensity(Mixture(w, *outputs(densities)), label, next_label)
        named, report = phd.report(plain, clutter, total if self.estimator == "expected" else None)
        return reduced._replace(label=named.label, next_label=named.next_label), report

    def _reduced(self, posterior: LabelledModes) -> LabelledModes:
        """The posterior, capped and reduced; a merged component keeps the label of its heaviest part."""
        (w, densities), label, _ = posterior
        if len(w) == 0:
            return posterior
        heaviest = np.sort(np.argsort(-w, kind="stable")[: self.max_components])
        w, densities, label = w[heaviest], take(densities, heaviest), label[heaviest]
        p = Mixture(w, *outputs(densities))
        q, origin = self.reduce(p)
        if densities.w.shape[1] == 1:
            after = Densities(np.ones((len(q.w), 1)), q.m[:, None], q.P[:, None])
        else:
            after = merge(densities, w, origin, len(q.w))
        labels = phd.labels_of_heaviest(w, label, origin, len(q.w))
        return posterior._replace(intensity=Intensity(q.w, after), label=labels)


def _predict(belief: LabelledModes, model: MultiTargetModel) -> LabelledModes:
    """The belief one period later; born and spawned targets have new labels."""
    (w, densities), label, next_label = belief
    after = moved(densities, model)
    parts = [Intensity(model.survival_probability * w, after)]
    if model.spawn_weight > 0:
        spawned = after._replace(P=after.P + model.spawn_covariance)
        parts.append(Intensity(model.spawn_weight * w, spawned))
    intensity = joined_intensities([*parts, intensity_of(model.births, model)])
    new = len(intensity.w) - len(w)
    return LabelledModes(intensity, np.append(label, next_label + np.arange(new)), next_label + new)
