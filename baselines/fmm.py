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
from gmr_gym.models.multi_target import MultiTargetModel


class Tracks(NamedTuple):
    """What is believed of the targets, and of the clutter."""

    targets: Mixture  # weights are how sure it is of each
    label: np.ndarray  # (n,)
    found: np.ndarray  # (n,), scans in which it was
    missed: np.ndarray  # (n,), scans since it was
    next_label: int  # the next label to give
    clutter: Clutter
    scans: int  # so far: with the seed it makes the generator of the next


class Lifetime(NamedTuple):
    """When a target is begun, named and given up; `PRINTED` is the paper's."""

    patience: int  # scans that a named target may be missed in
    establishing: int  # scans in which it must be found, one after another, before it is named
    spawn_distance: float  # deviations, of the spawned from their parent on either side along every axis
    predicted: bool  # whether a target is looked for with covariance H P H' + R; else survivors with R
    gate: float  # squared Mahalanobis distance from where it was expected, beyond which it is not found


PRINTED = Lifetime(0, 1, 0.0, False, np.inf)


@dataclass(frozen=True)
class Fmm:
    """Every scan a mixture of uniform clutter, Gaussians of clutter, survivors, births and spawned is fitted;
    the mean of a target's part is the detection that updates its Kalman filter (Lv, section 6).

    Of what is told, P_D, the expected number of births and of spawned (but that there are any) and the
    expected clutter have no say: all parts begin alike (eq. 15). A target's existence is the number of
    detections its part explains, at most 1, times P_S for every scan that it coasts."""

    model: MultiTargetModel
    fit: Callable[[np.ndarray, ScanMixture, float, EmOptions, np.random.Generator], ScanMixture]
    options: EmOptions
    life: Lifetime = PRINTED
    gaussians: int = 8  # g0, new of clutter in a scan
    seed: int = 0

    def __post_init__(self):
        check_whole("gaussians", self.gaussians, 0)
        check_whole("seed", self.seed, 0)

    def init(self) -> Tracks:
        no_target, no_label = no_components(len(self.model.motion.F)), np.empty(0, np.int64)
        return Tracks(no_target, no_label, no_label, no_label, 0, self.model.clutter, 0)

    def step(self, belief: Tracks, z: np.ndarray) -> tuple[Tracks, MultiTargetReport]:
        model, clutter = self.model, belief.clutter
        z = check_scan(z, len(model.sensor.H))
        moved = predict(belief.targets, model.motion)
        candidates, predicted_targets = self._candidates(moved, belief.found >= self.life.establishing)
        rng = np.random.default_rng((self.seed, belief.scans))
        # Departs: the g0 places "in the region" are those of detections, drawn at random, and there are none
        # in a scan of fewer than D_c: no Gaussian of clutter could live, and they take a target's with them
        new = self.gaussians if len(z) >= self.options.clutter_least else 0
        places = z[rng.permutation(len(z))[:new]]
        parts = initial(clutter.gaussians, places, z, predicted_targets, self.options.deviation)
        parts = self.fit(z, parts, 1 / clutter.volume, self.options, rng)
        c, weight = parts.gaussians, len(z) * parts.w
        if len(z):  # an empty scan tells nothing of where clutter is
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
        """States of survivors, births and spawned, in this order, and what each is looked for with
        (eqs. 12-14)."""
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
                # an expected detection that is `step` off, by a state that is so
                m = parents.m + step @ np.linalg.pinv(H).T
                parts.append(Mixture(parents.w, m, parents.P + model.spawn_covariance))
                covariances.append(np.tile(around, (len(m), 1, 1)))
        states = joined(parts)
        z_hat, S = model.sensor.gates(states)
        return states, Mixture(states.w, z_hat, S if life.predicted else np.concatenate(covariances))

    def _update_tracks(
        self, belief: Tracks, moved: Mixture, hit: Mixture, at: np.ndarray, clutter: Clutter
    ) -> tuple[Tracks, MultiTargetReport]:
        """The belief after targets `at` (h,) of the candidates were found, and what is said of it."""
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
    """Clutter and targets fitted as a finite mixture by expectation maximisation (Lv, Algorithm 1), as
    printed or, with `repaired`, with targets that coast, spawn aside and are named when established.

    As printed a target that is pruned once is gone, survivors are looked for with covariance R, and the
    spawned at their parent (p = 1, d = 0), with which they merge. Departs, if `repaired`: a target found in
    `establishing` scans running is named, may spawn and may be missed in `patience` scans; the spawned are
    looked for `spawn_distance` deviations aside along every axis, all targets with H P H' + R, and within the
    squared distance `gate` alone, for the mean of a part wanders to what clutter there is. Either way a
    Gaussian of clutter is no narrower than `deviation` (m)."""
    options = em_options(merging, clutter_least, target_least, deviation, tolerance, iterations, repaired)
    life = _life(repaired, patience, establishing, spawn_distance, gate)
    return Fmm(model, _by_em, options, life, gaussians, seed)


def fmm_gibbs(
    model: MultiTargetModel,
    repaired: bool = False,
    gaussians: int = 8,
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
    """As the tracker fmm-em, but the mixture is drawn by Gibbs (Lv, section 5), averaged over `sweeps`."""
    options = em_options(merging, clutter_least, target_least, deviation, repaired=repaired)
    check_whole("burn", burn, 0)
    check_whole("sweeps", sweeps, 1)
    life = _life(repaired, patience, establishing, spawn_distance, gate)
    fit = partial(fit_gibbs, burn=burn, sweeps=sweeps)
    return Fmm(model, fit, options, life, gaussians, seed)


def _life(repaired: bool, patience: int, establishing: int, spawn_distance: float, gate: float) -> Lifetime:
    # checked either way: a wrong parameter is one even where it is not heeded
    check_whole("patience", patience, 0)
    check_whole("establishing", establishing, 1)
    if not 0 <= spawn_distance < np.inf:
        raise ValueError(f"spawn_distance must be non-negative, got {spawn_distance}")
    if not gate > 0:
        raise ValueError(f"gate must be positive, got {gate}")
    return Lifetime(patience, establishing, spawn_distance, True, gate) if repaired else PRINTED


def _by_em(
    z: np.ndarray, parts: ScanMixture, uniform_density: float, options: EmOptions, _: np.random.Generator
) -> ScanMixture:
    return fit_em(z, parts, uniform_density, options)[0]


def _updated(p: Mixture, z: np.ndarray, sensor) -> tuple[Mixture, np.ndarray]:
    """Each of n components conditioned on its own equivalent detection z (n, p) with noise R (eq. 32), and
    the squared Mahalanobis distance (n,) at which that was.

    Departs: R is added to H P H', which the print leaves out, and it is the target's mean, not a clutter's,
    that updates."""
    z_hat, S = sensor.gates(p)
    C = sensor.predict_detections(p, z_hat, S, z).C
    n, off = len(p.w), z - z_hat
    d2 = np.einsum("ni,ni->n", off, np.linalg.solve(S, off[:, :, None])[:, :, 0])
    found = posteriors(np.zeros(n), np.eye(n), p.m, p.P, z_hat, S, C, *sensor, z, 0.0)
    return Mixture(*found[:3]), d2
