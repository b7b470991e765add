"""A mixture whose components have mode probabilities, and how a reduction merges these (Zhang, section 4)."""

from typing import NamedTuple

import numpy as np

from gmr_gym.mixture import Mixture, joined, match_groups
from gmr_gym.models.kalman import Motion, predict
from gmr_gym.reduction.protocol import Reduced


class MixtureWithModes(NamedTuple):
    """A mixture with the mode probabilities of every component.

    Attributes
    ----------
    mixture : Mixture
        n components.
    modes : ndarray, shape (n, r)
        Mode probabilities given the component, a_k^j in Zhang's eq. 6; rows sum to 1.
    """

    mixture: Mixture
    modes: np.ndarray


def predict_every_mode(
    belief: MixtureWithModes, motions: tuple[Motion, ...], switching: np.ndarray
) -> tuple[Mixture, np.ndarray]:
    r"""Predict every component by every motion model.

    Parameters
    ----------
    belief : MixtureWithModes
    motions : tuple of Motion
        r motion models.
    switching : ndarray, shape (r, r)
        Transition matrix; columns sum to 1.

    Returns
    -------
    predicted : Mixture
        r n components, ordered by mode.
    mode : ndarray, shape (r n,)
        Mode of each.

    Notes
    -----
    Component j under motion q has the weight

    .. math:: w_{qj} = w_j \sum_p \pi_{qp} a_j(p)

    References
    ----------
    Zhang, eq. 8 and Table 1, step 2.
    """
    w = switching @ (belief.modes * belief.mixture.w[:, None]).T
    predicted = joined([
        predict(belief.mixture._replace(w=share), motion) for share, motion in zip(w, motions, strict=True)
    ])  # fmt: skip
    return predicted, np.repeat(np.arange(len(motions)), len(belief.mixture.w))


def merge_mode_probabilities(
    posterior: Mixture, mode: np.ndarray, reduced: Reduced, modes: int
) -> MixtureWithModes:
    r"""Mode probabilities of a reduced mixture: the share of each mode in every merged component.

    Parameters
    ----------
    posterior : Mixture
        N components before the reduction.
    mode : ndarray, shape (N,)
        Mode of each.
    reduced : tuple
        Reduced mixture and the origin of its components, as a reduction returns them.
    modes : int
        r.

    Returns
    -------
    MixtureWithModes

    Notes
    -----
    With :math:`G_j` the components merged into component j

    .. math:: a_j(q) = \frac{\sum_{i \in G_j,\, q_i = q} w_i}{\sum_{i \in G_j} w_i}

    Departs: eq. 6 sums over the components that remain; the sum is over the N before the reduction.

    References
    ----------
    Zhang, eq. 6.
    """
    mixture, origin = reduced
    alive = origin >= 0
    into = np.zeros((len(mixture.w), modes))
    np.add.at(into, (origin[alive], mode[alive]), posterior.w[alive])
    return MixtureWithModes(mixture, into / into.sum(axis=1, keepdims=True))


def gpb1(posterior: Mixture, mode: np.ndarray) -> Reduced:
    """Merge everything into one Gaussian: the first-order generalised pseudo-Bayesian filter.

    Parameters
    ----------
    posterior : Mixture
        N components.
    mode : ndarray, shape (N,)
        Mode of each.

    Returns
    -------
    mixture : Mixture
    origin : ndarray, shape (N,)

    References
    ----------
    Ackerson and Fu 1970; Zhang, section 4, GPBn with n = 1.
    """
    return _grouped(posterior, np.zeros(len(mode), np.int64))


def gpb2(posterior: Mixture, mode: np.ndarray) -> Reduced:
    """Merge to one Gaussian per mode: the second-order generalised pseudo-Bayesian filter.

    Parameters
    ----------
    posterior : Mixture
        N components.
    mode : ndarray, shape (N,)
        Mode of each.

    Returns
    -------
    mixture : Mixture
    origin : ndarray, shape (N,)

    References
    ----------
    Chang and Athans 1978; Zhang, section 4, GPBn with n = 2.
    """
    return _grouped(posterior, mode)


def _grouped(posterior, group):
    alive = posterior.w > 0
    used, into = np.unique(group[alive], return_inverse=True)
    origin = np.full(len(group), -1)
    origin[alive] = into
    return match_groups(posterior, origin, len(used)), origin
