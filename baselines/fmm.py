"""Targets and clutter fitted together, scan by scan, as one finite mixture (Lv, Lian and Han 2014)."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_whole
from gmr_gym.filters.finite_mixture import EmOptions, ScanMixture, em_options, fit_em, initial
from gmr_gym.filters.gibbs import fit_gibbs
from gmr_gym.filters.intensity_update import posteriors
from gmr_gym.filters.tracker import MultiTargetReport, check_scan
from gmr_gym.mixture import Mixture, joined, take
from gmr_gym.models.clutter import Clutter, no_components
from gmr_gym.models.kalman import predict
from gmr_gym.models.multi_target import MultiTargetModel, check_plain


class Tracks(NamedTuple):
    """Belief of targets and of clutter.

    Attributes
    ----------
    targets : Mixture
        n targets; weights are probabilities of existence.
    label : ndarray, shape (n,)
        Label of each.
    found : ndarray, shape (n,)
        Number of scans in which it was found.
    missed : ndarray, shape (n,)
        Scans since it was last found.
    next_label : int
        Next unused label.
    clutter : Clutter
        Clutter fitted to the last scan with detections.
    scans : int
        Scans so far; with the seed it makes the generator of the next.
    """

    targets: Mixture
    label: np.ndarray
    found: np.ndarray
    missed: np.ndarray
    next_label: int
    clutter: Clutter
    scans: int


class Lifetime(NamedTuple):
    """When targets are started, declared and deleted; `PRINTED` is the paper's.

    Attributes
    ----------
    patience : int
        Scans in which an established target may be missed.
    establishing : int
        Consecutive scans in which a target must be found before it is declared.
    spawn_distance : float
        Distance of spawned targets from their parent in standard deviations, on either side along every axis.
    predicted : bool
        Whether the part of a target has the covariance H P H' + R; otherwise survivors have R.
    gate : float
        Squared Mahalanobis distance from its prediction beyond which a target counts as missed.
    """

    patience: int
    establishing: int
    spawn_distance: float
    predicted: bool
    gate: float


PRINTED = Lifetime(0, 1, 0.0, False, np.inf)


@dataclass(frozen=True)
class Fmm:
    """Finite-mixture tracker: uniform clutter, Gaussians of clutter, and surviving, born and spawned targets.

    The mixture is fitted to every scan. The mean of a target's part is the equivalent detection that updates
    its Kalman filter. A target's existence is the number of detections of its part, at most 1, times P_S for
    every scan in which it coasts.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    fit : callable
        Fit of the mixture to a scan.
    options : EmOptions
        Merging and pruning of its parts.
    life : Lifetime
        When targets are started, declared and deleted.
    gaussians : int
        g0, new Gaussians of clutter per scan.
    seed : int
        Seed of the random numbers.

    Notes
    -----
    P_D, the expected numbers of births and spawned targets (except zero) and the expected clutter of the
    filter model are not used: all parts start with equal weights (eq. 15).

    References
    ----------
    Lv, section 6.
    """

    model: MultiTargetModel
    fit: Callable[[np.ndarray, ScanMixture, float, EmOptions, np.random.Generator], ScanMixture]
    options: EmOptions
    life: Lifetime = PRINTED
    gaussians: int = 8
    seed: int = 0

    def __post_init__(self):
        check_plain(self.model, "the finite mixture model")
        check_whole("gaussians", self.gaussians, 0)
        check_whole("seed", self.seed, 0)

    def init(self) -> Tracks:
        """Belief one period before the first scan."""
        no_target, no_label = no_components(len(self.model.motion.F)), np.empty(0, np.int64)
        return Tracks(no_target, no_label, no_label, no_label, 0, self.model.clutter, 0)

    def step(self, belief: Tracks, z: np.ndarray) -> tuple[Tracks, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        model, clutter = self.model, belief.clutter
        z = check_scan(z, len(model.sensor.H))
        moved = predict(belief.targets, model.motion)
        candidates, predicted_targets = self._candidates(moved, belief.found >= self.life.establishing)
        rng = np.random.default_rng((self.seed, belief.scans))
        # Departs: the g0 places "in the region" are randomly drawn detections. A scan of fewer than D_c
        # detections has none: any Gaussian of clutter would be pruned, and a target's detection with it
        new = self.gaussians if len(z) >= self.options.clutter_least else 0
        places = z[rng.permutation(len(z))[:new]]
        parts = initial(clutter.gaussians, places, z, predicted_targets, self.options.deviation)
        parts = self.fit(z, parts, 1 / clutter.volume, self.options, rng)
        c, weight = parts.gaussians, len(z) * parts.w
        if len(z):  # an empty scan keeps the clutter
            gaussians = Mixture(weight[1 : c + 1], parts.m[:c], parts.P[:c])
            uniform, ellipses = float(weight[0]), no_components(z.shape[1])
            clutter = clutter._replace(uniform=uniform, gaussians=gaussians, ellipses=ellipses)
            at = parts.origin
        else:
            at = np.empty(0, np.int64)
        hit, d2 = _updated(take(candidates, at), parts.m[c:][: len(at)], model.sensor)
        hit = hit._replace(w=np.minimum(weight[c + 1 :][: len(at)], 1.0))
        hit, at = take(hit, d2 <= self.life.gate), at[d2 <= self.life.gate]
        return self._update_tracks(belief, moved, hit, at, clutter)

    def _candidates(self, moved: Mixture, may_spawn: np.ndarray) -> tuple[Mixture, Mixture]:
        """Surviving, born and spawned targets, in this order, and their predicted parts (eqs. 12-14)."""
        model, life = self.model, self.life
        H, R = model.sensor
        parts, covariances = (
            [moved, model.births],
            [np.tile(R, (len(moved.w), 1, 1)), H @ model.births.P @ H.T],
        )
        if model.spawn_weight > 0:
            parents = take(moved, may_spawn)
            around = H @ model.spawn_covariance @ H.T
            steps = np.zeros((1, len(H)))
            if life.spawn_distance > 0:
                axes = life.spawn_distance * np.diag(np.sqrt(np.diag(around + R)))
                steps = np.concatenate([axes, -axes])
            for step in steps:
                # the state whose predicted detection is `step` off
                m = parents.m + step @ np.linalg.pinv(H).T
                parts.append(Mixture(parents.w, m, parents.P + model.spawn_covariance))
                covariances.append(np.tile(around, (len(m), 1, 1)))
        states = joined(parts)
        z_hat, S = model.sensor.gates(states)
        return states, Mixture(states.w, z_hat, S if life.predicted else np.concatenate(covariances))

    def _update_tracks(
        self, belief: Tracks, moved: Mixture, hit: Mixture, at: np.ndarray, clutter: Clutter
    ) -> tuple[Tracks, MultiTargetReport]:
        """Belief and report after the targets `at` (h,) of the candidates were found."""
        n, life = len(moved.w), self.life
        old, new = at < n, int((at >= n).sum())
        lost = np.setdiff1d(np.arange(n), at)
        coasting = (belief.found[lost] >= life.establishing) & (belief.missed[lost] < life.patience)
        lost = lost[coasting]
        label, found = np.empty(len(at), np.int64), np.ones(len(at), np.int64)
        label[old], label[~old] = belief.label[at[old]], belief.next_label + np.arange(new)
        found[old] += belief.found[at[old]]
        coasted = take(moved, lost)
        coasted = coasted._replace(w=self.model.survival_probability * coasted.w)
        after = Tracks(
            joined([hit, coasted]),
            np.append(label, belief.label[lost]),
            np.append(found, belief.found[lost]),
            np.append(np.zeros(len(at), np.int64), belief.missed[lost] + 1),
            belief.next_label + new,
            clutter,
            belief.scans + 1,
        )
        reported = after.found >= life.establishing
        targets = after.targets
        report = MultiTargetReport(
            targets.m[reported],
            targets.w[reported],
            after.label[reported],
            float(targets.w.sum()),
            targets,
            clutter,
        )
        return after, report


def fmm_em(
    model: MultiTargetModel,
    repaired: bool = False,
    gaussians: int = 8,
    *,
    merging: float = 4.0,
    clutter_least: float = 3.0,
    target_least: float = 0.5,
    deviation: float = 15.0,
    tolerance: float = 1e-5,
    iterations: int = 100,
    patience: int = 3,
    establishing: int = 5,
    spawn_distance: float = 3.0,
    gate: float = 9.21,
    seed: int = 0,
) -> Fmm:
    """Finite-mixture tracker fitted by expectation maximisation.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    repaired : bool
        Whether targets are treated as repaired rather than as printed.
    gaussians : int
        g0, new Gaussians of clutter per scan.
    merging : float
        U of eq. 23, squared Mahalanobis distance.
    clutter_least, target_least : float
        D_c and D_t: parts with fewer detections are pruned.
    deviation : float
        Least standard deviation of a Gaussian of clutter, m.
    tolerance : float
        Relative change of the log-likelihood that ends a fit.
    iterations : int
        Most steps of a fit.
    patience : int
        Scans in which an established target may be missed.
    establishing : int
        Consecutive scans in which a target must be found before it is declared.
    spawn_distance : float
        Distance of spawned targets from their parent in standard deviations, on either side along every axis.
    gate : float
        Squared Mahalanobis distance from its prediction beyond which a target counts as missed.
    seed : int
        Seed of the random numbers.

    Returns
    -------
    Fmm

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    Notes
    -----
    As printed, a target is deleted at its first miss, survivors are fitted with covariance R, and spawned
    targets start at their parent (p = 1, d = 0), with which they merge.

    Departs, if `repaired`: a target found in `establishing` consecutive scans is declared, may spawn and may
    be missed in `patience` scans. Spawned targets start `spawn_distance` standard deviations aside along
    every axis. All targets are fitted with H P H' + R, and are found only within the squared distance
    `gate`, because the mean of a part drifts to nearby clutter. Printed or repaired, a Gaussian of clutter
    is no narrower than `deviation`.

    References
    ----------
    Lv, Algorithm 1.
    """
    options = em_options(merging, clutter_least, target_least, deviation, tolerance, iterations, repaired)
    life = Lifetime(patience, establishing, spawn_distance, True, gate)
    return _fmm(model, _by_em, options, life, gaussians, seed)


def fmm_gibbs(
    model: MultiTargetModel,
    repaired: bool = False,
    gaussians: int = 8,
    *,
    merging: float = 4.0,
    clutter_least: float = 3.0,
    target_least: float = 0.5,
    deviation: float = 15.0,
    burn: int = 20,
    sweeps: int = 40,
    patience: int = 3,
    establishing: int = 5,
    spawn_distance: float = 3.0,
    gate: float = 9.21,
    seed: int = 0,
) -> Fmm:
    """Finite-mixture tracker fitted by Gibbs sampling.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    burn : int
        Sweeps before the average.
    sweeps : int
        Sweeps averaged.
    repaired, gaussians, merging, clutter_least, target_least, deviation
        As of `fmm_em`.
    patience, establishing, spawn_distance, gate, seed
        As of `fmm_em`.

    Returns
    -------
    Fmm

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    References
    ----------
    Lv, section 5.
    """
    check_whole("burn", burn, 0)
    check_whole("sweeps", sweeps, 1)
    fit = partial(fit_gibbs, burn=burn, sweeps=sweeps)
    options = em_options(merging, clutter_least, target_least, deviation, repaired=repaired)
    life = Lifetime(patience, establishing, spawn_distance, True, gate)
    return _fmm(model, fit, options, life, gaussians, seed)


def _fmm(
    model: MultiTargetModel, fit: Callable, options: EmOptions, repaired: Lifetime, gaussians: int, seed: int
) -> Fmm:
    """The tracker with the lifetime `repaired` if the options say so."""
    # checked even where they are not used
    check_whole("patience", repaired.patience, 0)
    check_whole("establishing", repaired.establishing, 1)
    if not 0 <= repaired.spawn_distance < np.inf:
        raise ValueError(f"spawn_distance must be non-negative, got {repaired.spawn_distance}")
    if not repaired.gate > 0:
        raise ValueError(f"gate must be positive, got {repaired.gate}")
    return Fmm(model, fit, options, repaired if options.repaired else PRINTED, gaussians, seed)


def _by_em(
    z: np.ndarray, parts: ScanMixture, uniform_density: float, options: EmOptions, _: np.random.Generator
) -> ScanMixture:
    return fit_em(z, parts, uniform_density, options)[0]


def _updated(p: Mixture, z: np.ndarray, sensor) -> tuple[Mixture, np.ndarray]:
    """Update n components, each with its own equivalent detection z (n, p) and noise R (eq. 32).

    Returns them and the squared Mahalanobis distances (n,) of the detections.

    Departs: R is added to H P H', which is missing in print, and the target's mean is updated, not a
    clutter's."""
    predicted_z = sensor.predict_detections(p, *sensor.gates(p), z)
    n, off = len(p.w), z - predicted_z.z_hat
    d2 = np.einsum("ni,ni->n", off, np.linalg.solve(predicted_z.S, off[:, :, None])[:, :, 0])
    return posteriors(p._replace(w=np.zeros(n)), np.eye(n), predicted_z, 0.0)[0], d2
