"""Mixtures to reduce: the two problems that reductions are compared on."""

from dataclasses import dataclass

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.mixture import Mixture, mixture

SIDE = 3.0  # of the cube that the means are drawn in
SCALE = 1 / 50  # of the Wishart distribution of the covariances


@dataclass(frozen=True)
class MixtureProblem:
    """Mixtures to reduce, one a run: a given one, the recorded ones in turn, or each drawn by
    `random_mixture`."""

    mixture: Mixture | None = None
    samples: int = 4000  # that estimate a divergence in more than one dimension
    recorded: tuple[Mixture, ...] = ()

    def draw(self, seed: int | np.random.SeedSequence) -> Mixture:
        """The mixture of a run."""
        if self.recorded:
            run = seed if isinstance(seed, int) else (0, *seed.spawn_key)[-1]
            return self.recorded[run % len(self.recorded)]
        return random_mixture(seed) if self.mixture is None else self.mixture


def crouse() -> Mixture:
    """A mixture of ten components in one dimension.

    References
    ----------
    Crouse, Willett, Pattipati and Svensson, A look at Gaussian mixture reduction algorithms, FUSION 2011,
    fig. 1.
    """
    w = [0.03, 0.18, 0.12, 0.19, 0.02, 0.16, 0.06, 0.10, 0.08, 0.06]
    m = [1.45, 2.20, 0.67, 0.48, 1.49, 0.91, 1.01, 1.42, 2.77, 0.89]
    P = [0.0487, 0.0305, 0.1171, 0.0174, 0.0295, 0.0102, 0.0323, 0.0380, 0.0115, 0.0679]
    return mixture(w, np.array(m)[:, None], np.array(P)[:, None, None])


def random_mixture(seed: int | np.random.SeedSequence, components: int = 10, dimension: int = 4) -> Mixture:
    r"""A mixture drawn at random: the problem of Crouse's table, which reduces ten components to five.

    Parameters
    ----------
    seed : int or SeedSequence
        Of the draw.
    components : int
    dimension : int

    Returns
    -------
    Mixture
        Weights sum to 1.

    Notes
    -----
    With n components in d dimensions

    .. math::

        w \sim \mathrm{Dirichlet}(1, \dots, 1), \qquad m_i \sim \mathrm{U}([0, 3]^d), \qquad
        P_i \sim \mathrm{W}_d(I / 50, d + 1)

    The covariances are Wishart with as few degrees of freedom as d = 4 and 5 in the paper: some are nearly
    singular, and those decide the integral squared error.

    References
    ----------
    Crouse, Willett, Pattipati and Svensson 2011; the distributions are those that give its printed errors.

    Examples
    --------
    >>> p = random_mixture(0)
    >>> p.m.shape, round(float(p.w.sum()), 12)
    ((10, 4), 1.0)
    """
    n, d = check_count(components), check_count(dimension, "dimension")
    rng = np.random.default_rng(seed)
    w, m = rng.dirichlet(np.ones(n)), rng.uniform(0.0, SIDE, (n, d))
    factors = rng.standard_normal((n, d + 1, d))
    return mixture(w, m, SCALE * np.einsum("nki,nkj->nij", factors, factors))
