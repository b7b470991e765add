"""The Poisson intensity of targets that no detection has shown yet, and the tracks that detections begin."""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.target_densities import (
    Densities,
    joined,
    merge,
    moved,
    of_mixture,
    outputs,
    pair,
    posteriors,
    take,
)
from gmr_gym.models.multi_target import MultiTargetModel


class Undetected(NamedTuple):
    """Intensity of undetected targets.

    Attributes
    ----------
    expected : ndarray, shape (u,)
        Expected number of targets of each component.
    densities : Densities
    """

    expected: np.ndarray
    densities: Densities


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


def initial(model: MultiTargetModel) -> Undetected:
    """The targets that are there one period before the first scan."""
    return Undetected(model.initial.w, of_mixture(model.initial, model.mode_prior))


def predict(
    undetected: Undetected, model: MultiTargetModel, targets: Densities, existing: np.ndarray
) -> Undetected:
    """Predict by one period: targets survive and move, others are born.

    Predicted targets spawn more, in proportion to the number `existing` (n,) of each.
    """
    survival = model.survival_probability
    parts = [moved(undetected.densities, model), of_mixture(model.births, model.mode_prior)]
    expected = [survival * undetected.expected, model.births.w]
    if model.spawn_weight > 0:
        parts.append(targets._replace(P=targets.P + model.spawn_covariance))
        expected.append(model.spawn_weight * existing)
    return Undetected(np.concatenate(expected), joined(parts))


def missed(undetected: Undetected, model: MultiTargetModel) -> Undetected:
    """Those that a scan has not shown."""
    p_detected = model.detected(outputs(undetected.densities)[0])
    return undetected._replace(expected=undetected.expected * (1.0 - p_detected))


def pruned(undetected: Undetected, weight: float, most: int) -> Undetected:
    """Up to `most` components of an expected number of at least `weight`."""
    expected, densities = undetected
    order = np.argsort(-expected, kind="stable")[:most]
    kept = np.sort(order[(expected[order] >= weight) & (expected[order] > 0)])
    return Undetected(expected[kept], take(densities, kept))


def begun(
    undetected: Undetected, model: MultiTargetModel, z: np.ndarray, log_kappa: np.ndarray, least: float
) -> Begun:
    r"""The tracks that the detections of a scan begin.

    Parameters
    ----------
    undetected : Undetected
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
    expected, densities = undetected
    weight = expected * model.detected(outputs(densities)[0])
    pairs = pair(densities, model.sensor, z, log_kappa, weight)
    log_ratio = pairs.log_likelihood + np.log(weight[pairs.row]) - log_kappa[pairs.detection]
    log_new = np.zeros(len(z))  # log((rho + kappa) / kappa)
    np.logaddexp.at(log_new, pairs.detection, log_ratio)
    existence = -np.expm1(-log_new)
    existence[existence < least] = 0.0
    chosen = np.flatnonzero(existence[pairs.detection] > 0)
    detection, group = np.unique(pairs.detection[chosen], return_inverse=True)
    share = np.exp(log_ratio[chosen] - log_new[pairs.detection[chosen]])
    first = merge(posteriors(densities, pairs, chosen), share, group.reshape(-1), len(detection))
    return Begun(detection, first, existence, log_kappa + log_new)
