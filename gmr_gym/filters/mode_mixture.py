"""A mixture whose components carry mode probabilities, and how these ride along through a reduction."""

from typing import NamedTuple

import numpy as np

from gmr_gym.mixture import Mixture, joined, match_groups
from gmr_gym.models.kalman import Motion, predict
from gmr_gym.reduction.protocol import Reduced


class MixtureWithModes(NamedTuple):
    """A mixture whose every component knows how likely each mode is, given the component."""

    mixture: Mixture  # n components
    modes: np.ndarray  # (n, r), rows sum to 1: a_k^j in Zhang's eq. 6


# ---- a mixture that carries its modes (Zhang, section 4) ----


def predict_every_mode(
    belief: MixtureWithModes, motions: tuple[Motion, ...], switching: np.ndarray
) -> tuple[Mixture, np.ndarray]:
    """Every component under every motion, and the mode (r n,) of each of the r n components: component
    j moves by motion p with probability (switching a_j)(p) (Zhang, eq. 8 and Table 1, step 2)."""
    w = switching @ (belief.modes * belief.mixture.w[:, None]).T
    predicted = joined([
        predict(belief.mixture._replace(w=share), motion) for share, motion in zip(w, motions, strict=True)
    ])  # fmt: skip
    return predicted, np.repeat(np.arange(len(motions)), len(belief.mixture.w))


def merge_mode_probabilities(
    posterior: Mixture, mode: np.ndarray, reduced: Reduced, modes: int
) -> MixtureWithModes:
    """The reduced mixture with its modes: the share of each mode in what every component is made of
    (Zhang, eq. 6). mode (N,) is the mode of each posterior component.

    Departs: eq. 6 sums over the components that remain; it is the N before reduction that count.
    """
    mixture, origin = reduced
    alive = origin >= 0
    into = np.zeros((len(mixture.w), modes))
    np.add.at(into, (origin[alive], mode[alive]), posterior.w[alive])
    return MixtureWithModes(mixture, into / into.sum(axis=1, keepdims=True))


def gpb1(posterior: Mixture, mode: np.ndarray) -> Reduced:
    """Everything merged into one Gaussian: the first-order generalised pseudo-Bayesian merge, all
    model sequences alike (Ackerson and Fu 1970; Zhang, section 4, GPBn with n = 1)."""
    return _grouped(posterior, np.zeros(len(mode), np.int64))


def gpb2(posterior: Mixture, mode: np.ndarray) -> Reduced:
    """One Gaussian per current mode: the second-order merge, model sequences alike that end alike
    (Chang and Athans 1978; Zhang, section 4, GPBn with n = 2)."""
    return _grouped(posterior, mode)


def _grouped(posterior, group):
    alive = posterior.w > 0
    used, into = np.unique(group[alive], return_inverse=True)
    origin = np.full(len(group), -1)
    origin[alive] = into
    return match_groups(posterior, origin, len(used)), origin
