"""Targets that switch between motions: Markov modes carried by a mixture, or by a bank of filters.

A switching matrix holds in row q and column p the probability of mode q now, given mode p one scan
before (Zhang's pi(q, p)): every column sums to 1, which is the transpose of much other code.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.mixing import borrow_into
from gmr_gym.mixture import Mixture, joined, match_groups
from gmr_gym.models.kalman import Motion, predict


class FilterBank(NamedTuple):
    """n hypotheses with a filter for each of r modes: w[p, j] is the joint probability of mode p and
    hypothesis j, and N(m[p, j], P[p, j]) the state given both. An IMM is a bank of one hypothesis."""

    w: np.ndarray  # (r, n)
    m: np.ndarray  # (r, n, d)
    P: np.ndarray  # (r, n, d, d)


# ---- a bank of filters in every hypothesis ----


def initial_bank(mode_prior: np.ndarray, prior: Mixture) -> FilterBank:
    """Every component of the prior with a filter for each of r modes, all of which begin as it does; the
    modes are as likely as mode_prior (r,)."""
    r = len(mode_prior)
    w = mode_prior[:, None] * prior.w
    return FilterBank(w, np.repeat(prior.m[None], r, axis=0), np.repeat(prior.P[None], r, axis=0))


def as_mixture(bank: FilterBank) -> Mixture:
    """The r n Gaussians of a bank as one mixture, mode by mode."""
    r, n, d = bank.m.shape
    return Mixture(bank.w.reshape(-1), bank.m.reshape(r * n, d), bank.P.reshape(r * n, d, d))


def as_bank(p: Mixture, modes: int) -> FilterBank:
    """Undoes `flat`: as many hypotheses as there are components for each mode."""
    d = p.m.shape[1]
    return FilterBank(p.w.reshape(modes, -1), p.m.reshape(modes, -1, d), p.P.reshape(modes, -1, d, d))


def predict_bank(bank: FilterBank, motions: tuple[Motion, ...]) -> Mixture:
    """Every filter carried forward by the motion of its mode; flat, mode by mode."""
    parts = [predict(Mixture(*filters), motion) for *filters, motion in zip(*bank, motions, strict=True)]
    return joined(parts)


def imm_mix(bank: FilterBank, switching: np.ndarray, borrowed: np.ndarray | None = None) -> FilterBank:
    """IMM mixing: the mode probabilities one scan on, and for each mode the Gaussian that matches all
    the modes it may have come from (Blom and Bar-Shalom 1988); with `borrowed_states` unbiased."""
    r, n = bank.w.shape
    joint = switching[:, :, None] * bank.w  # mode now, mode before, hypothesis
    into = np.tile(np.arange(r * n).reshape(r, 1, n), (1, r, 1))
    return as_bank(match_groups(_tiled(bank, joint, borrowed), into.ravel(), r * n), r)


def imm_output(bank: FilterBank) -> Mixture:
    """One Gaussian per hypothesis, its modes matched in weight, mean and covariance: the IMM's output
    (n hypotheses)."""
    r, n = bank.w.shape
    return match_groups(as_mixture(bank), np.tile(np.arange(n), r), n)


def merge_hypotheses(bank: FilterBank, origin: np.ndarray, count: int) -> FilterBank:
    """Hypotheses merged mode by mode into `count`, origin (n,) as a reducer returns it, with the joint
    weights of hypothesis and mode, so that the grand mean and covariance stay.

    Departs: how two filter banks merge is not said in Zhang, section 6.3 ("approximated by the fusion
    output of IMM"); fused output alone would lose the modes.
    """
    r = len(bank.w)
    group = np.where(origin < 0, -1, origin + count * np.arange(r)[:, None]).ravel()
    return as_bank(match_groups(as_mixture(bank), group, r * count), r)


def no_interaction(bank: FilterBank, _: np.ndarray) -> FilterBank:
    """The bank as it is: filters that have nothing to do with each other before, or after, an update."""
    return bank


def restart_and_floor(bank: FilterBank, log_density: np.ndarray, floor: float, restart: float) -> FilterBank:
    """An MMAE after its update: filters to which the log density (r, n) of their residual is below that of
    `restart` begin anew from what the others of their hypothesis fuse to, and mode probabilities are kept
    above `floor` (Maybeck, sections III and V). Where all filters of a hypothesis diverge none is restarted.

    Raises ValueError unless restart is a density, 0 for never, and floor as in `floored`.
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
    """Which filters, (r,) or (r, n), have residuals less dense than `restart`, per unit volume of the
    sensor's space, in hypotheses of which not all do; ValueError for a restart that is no density."""
    if not 0 <= restart < np.inf:
        raise ValueError(f"restart must be a density, 0 for never, got {restart}")
    with np.errstate(divide="ignore"):
        low = log_density < np.log(restart)
    return low & ~low.all(axis=0)


def floored(probabilities: np.ndarray, floor: float) -> np.ndarray:
    """Mode probabilities (r,) or (r, n), each column raised to at least `floor` and still summing to 1,
    so that no filter of an MMAE is ever shut out (Maybeck and Smith 2005). What the raised ones need
    is taken from the others in proportion.

    Raises ValueError unless floor lies in [0, 1 / r).
    """
    r = len(probabilities)
    if not 0 <= floor < 1 / r:
        raise ValueError(f"floor must lie in [0, 1 / {r}) for {r} modes, got {floor}")
    out = probabilities / probabilities.sum(axis=0)
    for _ in range(r):  # scaling the others down may bring one more of them to the floor
        low = out <= floor
        rest = np.where(low, 0.0, out)
        out = np.where(low, floor, rest * (1 - floor * low.sum(axis=0)) / rest.sum(axis=0))
    return out


def mmae_weights(probabilities: np.ndarray, log_likelihood: np.ndarray, floor: float = 0.0) -> np.ndarray:
    """Mode probabilities (r,) or (r, n) after a scan that mode p explains with log_likelihood[p]: Bayes'
    rule without switching, floored (Maybeck's multiple model adaptive estimation)."""
    with np.errstate(divide="ignore"):
        log_w = np.log(probabilities) + log_likelihood
    if np.isneginf(log_w).all(axis=0).any():
        raise ValueError("log_likelihood calls every mode impossible")
    return floored(np.exp(log_w - log_w.max(axis=0)), floor)


def _tiled(bank, joint, borrowed):
    r, n, d = bank.m.shape
    m, P = np.broadcast_to(bank.m, (r, r, n, d)), np.broadcast_to(bank.P, (r, r, n, d, d))
    if borrowed is not None and borrowed.any():
        m, P = m.copy(), P.copy()
        for q, p in np.argwhere(borrowed.any(axis=2)):
            borrow_into(m[q, p], P[q, p], bank.m[q], bank.P[q], borrowed[q, p])
    return Mixture(joint.ravel(), m.reshape(-1, d), P.reshape(-1, d, d))
