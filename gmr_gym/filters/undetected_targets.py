"""The Poisson intensity of targets that no detection has shown yet, and the tracks that detections begin."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.target_densities import (
    Densities,
    Pairs,
    joined,
    merge,
    moved,
    of_mixture,
    outputs,
    pair,
    posteriors,
    take,
)
from gmr_gym.mixture import Mixture
from gmr_gym.models.multi_target import MultiTargetModel


class Intensity(NamedTuple):
    """An intensity of targets over states and modes.

    Attributes
    ----------
    w : ndarray, shape (u,)
        Expected numbers.
    densities : Densities
        u densities.
    """

    w: np.ndarray
    densities: Densities


class Appearing(NamedTuple):
    """What an intensity of targets without tracks makes of the detections of a scan.

    Attributes
    ----------
    intensity : Intensity
    pairs : Pairs
        Of its densities.
    log_part : ndarray, shape (e,)
        log of each pair's share of rho over kappa.
    log_ratio : ndarray, shape (k,)
        log((rho + kappa) / kappa) at each detection.
    """

    intensity: Intensity
    pairs: Pairs
    log_part: np.ndarray
    log_ratio: np.ndarray


class Begun(NamedTuple):
    """What k detections begin that are of no track.

    Attributes
    ----------
    detection : ndarray of int, shape (n,)
        Those that begin a track.
    densities : Densities
        Of the n targets.
    existence : ndarray, shape (k,)
        Probability that the detection is of a target; 0 where it begins no track.
    log_free : ndarray, shape (k,)
        log of the intensity of clutter and of detections of undetected targets.
    """

    detection: np.ndarray
    densities: Densities
    existence: np.ndarray
    log_free: np.ndarray


def intensity_of(p: Mixture, model: MultiTargetModel) -> Intensity:
    """The intensity p of new targets, over the modes of the model."""
    return Intensity(p.w, of_mixture(p, model.mode_prior))


def joined_intensities(parts: Sequence[Intensity]) -> Intensity:
    """The sum of intensities."""
    return Intensity(np.concatenate([part.w for part in parts]), joined([part.densities for part in parts]))


def detected(densities: Densities, model: MultiTargetModel) -> np.ndarray:
    """P_D (n,) of each density.

    Notes
    -----
    Departs: where P_D is a function of the state, its value at the mean stands for its average.
    """
    if callable(model.detection_probability):
        return model.detected(outputs(densities)[0])
    return np.full(len(densities.w), model.detection_probability)


def predict(
    before: Intensity, model: MultiTargetModel, targets: Densities, existing: np.ndarray
) -> Intensity:
    """The undetected targets one period later: those that survive, those born, and those that the predicted
    `targets` spawn, in proportion to the number `existing` (n,) of each before."""
    survived = Intensity(model.survival_probability * before.w, moved(before.densities, model))
    parts = [survived, intensity_of(model.births, model)]
    if model.spawn_weight > 0:
        spread = targets._replace(P=targets.P + model.spawn_covariance)
        parts.append(Intensity(model.spawn_weight * existing, spread))
    return joined_intensities(parts)


def missed(undetected: Intensity, model: MultiTargetModel) -> Intensity:
    """Those that a scan has not shown."""
    return undetected._replace(w=undetected.w * (1.0 - detected(undetected.densities, model)))


def pruned(undetected: Intensity, weight: float, most: int) -> Intensity:
    """Up to `most` components of at least `weight`."""
    w, densities = undetected
    order = np.argsort(-w, kind="stable")[:most]
    kept = np.sort(order[(w[order] >= weight) & (w[order] > 0)])
    return Intensity(w[kept], take(densities, kept))


def undetected_after(
    undetected: Intensity, model: MultiTargetModel, most: int, least: float = 1e-5
) -> Intensity:
    """The targets that a scan has not detected, of at most so many components, each of at least so much
    weight."""
    return pruned(missed(undetected, model), least, most)


def appear(intensity: Intensity, model: MultiTargetModel, z: np.ndarray, log_kappa: np.ndarray) -> Appearing:
    r"""Weigh the detections of a scan as those of targets without a track.

    Parameters
    ----------
    intensity : Intensity
        Predicted intensity of targets without a track.
    model : MultiTargetModel
    z : ndarray, shape (k, p)
        Detections.
    log_kappa : ndarray, shape (k,)
        log of the clutter intensity at them.

    Returns
    -------
    Appearing

    Notes
    -----
    .. math:: \rho_j = \sum_u w_u P_D(m_u) g_{uj}
    """
    expected = intensity.w * detected(intensity.densities, model)
    pairs = pair(intensity.densities, model.sensor, z, log_kappa, expected)
    log_part = np.log(expected[pairs.row]) + pairs.log_likelihood - log_kappa[pairs.detection]
    log_ratio = np.zeros(len(z))
    np.logaddexp.at(log_ratio, pairs.detection, log_part)
    return Appearing(intensity, pairs, log_part, log_ratio)


def begun(
    undetected: Intensity, model: MultiTargetModel, z: np.ndarray, log_kappa: np.ndarray, least: float
) -> Begun:
    r"""The tracks that the detections of a scan begin.

    Parameters
    ----------
    undetected : Intensity
        Predicted.
    model : MultiTargetModel
    z : ndarray, shape (k, p)
        Detections.
    log_kappa : ndarray, shape (k,)
        log of the intensity of clutter at the detections.
    least : float
        No track is begun by a detection that is of a target with less probability.

    Returns
    -------
    Begun

    Notes
    -----
    With :math:`\rho_j = P_D \sum_u w_u g_{uj}` over the undetected targets a detection of no track is of a
    target with probability :math:`\rho_j / (\rho_j + \kappa_j)`; its density is the moment match of their
    posteriors.

    References
    ----------
    Williams 2015.
    """
    _, pairs, log_part, log_new = appear(undetected, model, z, log_kappa)
    existence = -np.expm1(-log_new)
    existence[existence < least] = 0.0
    chosen = np.flatnonzero(existence[pairs.detection] > 0)
    detection, group = np.unique(pairs.detection[chosen], return_inverse=True)
    share = np.exp(log_part[chosen] - log_new[pairs.detection[chosen]])
    first = merge(posteriors(undetected.densities, pairs, chosen), share, group.reshape(-1), len(detection))
    return Begun(detection, first, existence, log_kappa + log_new)
