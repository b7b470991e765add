"""Banks of filters, one per motion model, in every hypothesis: IMM and MMAE.

Row q and column p of a transition matrix hold the probability of mode q now given mode p one scan before
(Zhang's pi(q, p)). Every column sums to 1: the transpose of the convention in much other code.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.mixing import borrow_into
from gmr_gym.mixture import Mixture, joined, match_groups
from gmr_gym.models.kalman import Motion, predict


class FilterBank(NamedTuple):
    """n hypotheses with one filter for each of r modes; an IMM is a bank of one hypothesis.

    Attributes
    ----------
    w : ndarray, shape (r, n)
        Joint probability of mode and hypothesis.
    m : ndarray, shape (r, n, d)
        Mean of the state given both.
    P : ndarray, shape (r, n, d, d)
        Its covariance.
    """

    w: np.ndarray
    m: np.ndarray
    P: np.ndarray


def initial_bank(mode_prior: np.ndarray, prior: Mixture) -> FilterBank:
    """Start every filter of every hypothesis from the prior.

    Parameters
    ----------
    mode_prior : ndarray, shape (r,)
        Prior mode probabilities.
    prior : Mixture
        n components, one hypothesis each.

    Returns
    -------
    FilterBank
    """
    r = len(mode_prior)
    w = mode_prior[:, None] * prior.w
    return FilterBank(w, np.repeat(prior.m[None], r, axis=0), np.repeat(prior.P[None], r, axis=0))


def as_mixture(bank: FilterBank) -> Mixture:
    """The r n Gaussians of a bank as one mixture, ordered by mode.

    Parameters
    ----------
    bank : FilterBank

    Returns
    -------
    Mixture
    """
    r, n, d = bank.m.shape
    return Mixture(bank.w.reshape(-1), bank.m.reshape(r * n, d), bank.P.reshape(r * n, d, d))


def as_bank(p: Mixture, modes: int) -> FilterBank:
    """The bank of a mixture whose components are ordered by mode; undoes `as_mixture`.

    Parameters
    ----------
    p : Mixture
        r n components.
    modes : int
        r.

    Returns
    -------
    FilterBank
    """
    d = p.m.shape[1]
    return FilterBank(p.w.reshape(modes, -1), p.m.reshape(modes, -1, d), p.P.reshape(modes, -1, d, d))


def predict_bank(bank: FilterBank, motions: tuple[Motion, ...]) -> Mixture:
    """Predict every filter by the motion model of its mode.

    Parameters
    ----------
    bank : FilterBank
    motions : tuple of Motion
        r motion models.

    Returns
    -------
    Mixture
        r n components, ordered by mode.
    """
    parts = [predict(Mixture(*filters), motion) for *filters, motion in zip(*bank, motions, strict=True)]
    return joined(parts)


def imm_mix(bank: FilterBank, switching: np.ndarray, borrowed: np.ndarray | None = None) -> FilterBank:
    r"""Mix the filters of every hypothesis as the IMM does before its prediction.

    Parameters
    ----------
    bank : FilterBank
    switching : ndarray, shape (r, r)
        Transition matrix; columns sum to 1.
    borrowed : ndarray of bool, shape (r, r, d), optional
        States lent in unbiased mixing, see `gmr_gym.filters.mixing.borrowed_states`.

    Returns
    -------
    FilterBank
        Predicted mode probabilities, and for each mode the moment-matched Gaussian.

    Notes
    -----
    With :math:`\mu_p` the probability of mode p and :math:`\pi_{qp}` the transition matrix

    .. math::

        \bar\mu_q = \sum_p \pi_{qp} \mu_p, \qquad \mu_{p|q} = \pi_{qp} \mu_p / \bar\mu_q, \qquad
        \bar m_q = \sum_p \mu_{p|q} m_p,

    .. math::

        \bar P_q = \sum_p \mu_{p|q} \left( P_p + (m_p - \bar m_q) (m_p - \bar m_q)^T \right)

    References
    ----------
    Blom and Bar-Shalom 1988.
    """
    r, n = bank.w.shape
    joint = switching[:, :, None] * bank.w  # mode now, mode before, hypothesis
    into = np.tile(np.arange(r * n).reshape(r, 1, n), (1, r, 1))
    return as_bank(match_groups(_tiled(bank, joint, borrowed), into.ravel(), r * n), r)


def imm_output(bank: FilterBank) -> Mixture:
    """Merge the filters of every hypothesis into their moment-matched Gaussian: the output of an IMM.

    Parameters
    ----------
    bank : FilterBank

    Returns
    -------
    Mixture
        n hypotheses.
    """
    r, n = bank.w.shape
    return match_groups(as_mixture(bank), np.tile(np.arange(n), r), n)


def merge_hypotheses(bank: FilterBank, origin: np.ndarray, count: int) -> FilterBank:
    """Merge hypotheses mode by mode, as a reduction of their outputs decided.

    Joint weights of hypothesis and mode are used, so the overall mean and covariance are preserved.

    Parameters
    ----------
    bank : FilterBank
        n hypotheses.
    origin : ndarray, shape (n,)
        Index of the merged hypothesis, -1 for one that is pruned, as a reduction returns it.
    count : int
        Number of merged hypotheses.

    Returns
    -------
    FilterBank
        `count` hypotheses.

    Notes
    -----
    Departs: Zhang, section 6.3, does not say how two filter banks merge ("approximated by the fusion output
    of IMM"); the output alone would lose the modes.
    """
    r = len(bank.w)
    group = np.where(origin < 0, -1, origin + count * np.arange(r)[:, None]).ravel()
    return as_bank(match_groups(as_mixture(bank), group, r * count), r)


def no_interaction(bank: FilterBank, _: np.ndarray) -> FilterBank:
    """Return the bank unchanged: its filters do not interact.

    Parameters
    ----------
    bank : FilterBank

    Returns
    -------
    FilterBank
    """
    return bank


def restart_and_floor(bank: FilterBank, log_density: np.ndarray, floor: float, restart: float) -> FilterBank:
    r"""Restart diverged filters of an MMAE and floor its mode probabilities.

    A filter whose residual has log density below log(restart) is reset to the moment match of the other
    filters of its hypothesis. Where all filters of a hypothesis diverge none is restarted.

    Parameters
    ----------
    bank : FilterBank
        Bank after its update.
    log_density : ndarray, shape (r, n)
        Log density of each filter's residual.
    floor : float
        Least mode probability, see `floored`.
    restart : float
        Density below which a filter is restarted, 0 for never.

    Returns
    -------
    FilterBank

    Raises
    ------
    ValueError
        If `restart` is negative or not finite, or `floor` outside [0, 1 / r).

    Notes
    -----
    With :math:`L = \{p : \mathcal{N}(r_p; 0, A_p) < \text{restart}\}` the diverged filters of a hypothesis,
    those of :math:`L` take the mean and covariance of

    .. math::

        \sum_{p \notin L} \mu_p \mathcal{N}(x; m_p, P_p) \Big/ \sum_{p \notin L} \mu_p

    and the mode probabilities are floored as in `floored`.

    References
    ----------
    Maybeck, sections III and V.
    """
    diverged = diverging(log_density, restart)
    if diverged.any():
        rest = imm_output(bank._replace(w=np.where(diverged, 0.0, bank.w)))
        m = np.where(diverged[..., None], rest.m, bank.m)
        bank = FilterBank(bank.w, m, np.where(diverged[..., None, None], rest.P, bank.P))
    total = bank.w.sum(axis=0)
    mode_probabilities = np.full(bank.w.shape, 1 / len(bank.w))
    mode_probabilities[:, total > 0] = floored(bank.w[:, total > 0], floor)
    return bank._replace(w=total * mode_probabilities)


def diverging(log_density: np.ndarray, restart: float) -> np.ndarray:
    """Which filters have a residual less dense than `restart`, in hypotheses where not all have.

    Parameters
    ----------
    log_density : ndarray, shape (r,) or (r, n)
        Log density of the residuals per unit volume of the sensor's space.
    restart : float
        Density, 0 for never.

    Returns
    -------
    ndarray of bool
        Of the shape of `log_density`.

    Raises
    ------
    ValueError
        If `restart` is negative or not finite.
    """
    if not 0 <= restart < np.inf:
        raise ValueError(f"restart must be a density, 0 for never, got {restart}")
    with np.errstate(divide="ignore"):
        low = log_density < np.log(restart)
    return low & ~low.all(axis=0)


def floored(probabilities: np.ndarray, floor: float) -> np.ndarray:
    r"""Floor mode probabilities, so that no filter of an MMAE is excluded for good.

    Parameters
    ----------
    probabilities : ndarray, shape (r,) or (r, n)
        Non-negative; each column is normalised.
    floor : float
        Least probability, in [0, 1 / r).

    Returns
    -------
    ndarray
        Of the same shape; columns sum to 1.

    Raises
    ------
    ValueError
        If `floor` lies outside [0, 1 / r).

    Notes
    -----
    With :math:`L` the set of floored modes

    .. math::

        \mu_p = f \quad (p \in L), \qquad
        \mu_p \leftarrow \mu_p \frac{1 - f |L|}{\sum_{q \notin L} \mu_q} \quad (p \notin L)

    repeated until no other mode falls below :math:`f`.

    References
    ----------
    Maybeck and Smith 2005.

    Examples
    --------
    >>> import numpy as np
    >>> floored(np.array([0.999, 0.001, 0.0]), 0.1).round(3).tolist()
    [0.8, 0.1, 0.1]
    """
    r = len(probabilities)
    if not 0 <= floor < 1 / r:
        raise ValueError(f"floor must lie in [0, 1 / {r}) for {r} modes, got {floor}")
    out = probabilities / probabilities.sum(axis=0)
    for _ in range(r):  # scaling may bring another mode down to the floor
        low = out <= floor
        rest = np.where(low, 0.0, out)
        out = np.where(low, floor, rest * (1 - floor * low.sum(axis=0)) / rest.sum(axis=0))
    return out


def mmae_weights(probabilities: np.ndarray, log_likelihood: np.ndarray, floor: float = 0.0) -> np.ndarray:
    r"""Mode probabilities of an MMAE after a scan: Bayes' rule without switching, then floored.

    Parameters
    ----------
    probabilities : ndarray, shape (r,) or (r, n)
        Mode probabilities before the scan.
    log_likelihood : ndarray, shape (r,) or (r, n)
        Log-likelihood of the scan under each mode.
    floor : float
        Least mode probability.

    Returns
    -------
    ndarray
        Of the same shape; columns sum to 1.

    Raises
    ------
    ValueError
        If every mode is impossible, or for a floor outside [0, 1 / r).

    Notes
    -----
    .. math:: \mu_p \leftarrow \frac{\mu_p \Lambda_p}{\sum_q \mu_q \Lambda_q}

    References
    ----------
    Maybeck, section III.
    """
    with np.errstate(divide="ignore"):
        log_w = np.log(probabilities) + log_likelihood
    if np.isneginf(log_w).all(axis=0).any():
        raise ValueError("every mode is impossible by log_likelihood")
    return floored(np.exp(log_w - log_w.max(axis=0)), floor)


def _tiled(bank, joint, borrowed):
    r, n, d = bank.m.shape
    m, P = np.broadcast_to(bank.m, (r, r, n, d)), np.broadcast_to(bank.P, (r, r, n, d, d))
    if borrowed is not None and borrowed.any():
        m, P = m.copy(), P.copy()
        for q, p in np.argwhere(borrowed.any(axis=2)):
            borrow_into(m[q, p], P[q, p], bank.m[q], bank.P[q], borrowed[q, p])
    return Mixture(joint.ravel(), m.reshape(-1, d), P.reshape(-1, d, d))
