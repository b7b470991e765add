"""Cardinalised PHD filter: prediction and update of the cardinality distribution p(n), n = 0..N.

With Poisson clutter the sums of Vo, Vo and Cantoni (2007, eqs. 13-19) reduce to one polynomial, given in
`update`. All terms are positive and are added as logarithms. One backward and one forward sweep give all
derivatives, in time proportional to the number of detections times N.
"""

from functools import lru_cache

import numpy as np

from gmr_gym.filters.intensity_update import log_ratios, log_sum, posteriors
from gmr_gym.filters.phd import LabelledIntensity
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.models.kalman import Sensor


@lru_cache
def cardinality_transition(
    survival_probability: float, spawned: float, born: float, max_targets: int
) -> np.ndarray:
    """Transition matrix of the cardinality: the probability of n targets after m.

    Each target survives or not and spawns a Poisson number of targets; a Poisson number is born.

    Parameters
    ----------
    survival_probability : float
        P_S.
    spawned : float
        Expected number of targets spawned by each.
    born : float
        Expected number of births.
    max_targets : int
        N.

    Returns
    -------
    ndarray, shape (N + 1, N + 1)
        Read-only. A column sums to less than 1 by the probability of more than N targets.

    Notes
    -----
    Departs: the paper has no spawning.

    References
    ----------
    Vo, Vo and Cantoni 2007.
    """
    from scipy.stats import binom, poisson

    n = np.arange(max_targets + 1)
    out = np.empty((max_targets + 1, max_targets + 1))
    for m in n:
        new = poisson.pmf(n, born + m * spawned)
        out[:, m] = np.convolve(binom.pmf(n, m, survival_probability), new)[: max_targets + 1]
    out.setflags(write=False)
    return out


def poisson(expected: float, max_targets: int) -> np.ndarray:
    """Poisson distribution of up to N targets, normalised.

    Parameters
    ----------
    expected : float
        Expected number, before it is truncated.
    max_targets : int
        N.

    Returns
    -------
    ndarray, shape (N + 1,)
    """
    from scipy.stats import poisson

    p = poisson.pmf(np.arange(max_targets + 1), expected)
    return p / p.sum()


def update(
    predicted: LabelledIntensity,
    cardinality: np.ndarray,
    sensor: Sensor,
    z: np.ndarray,
    detection_probability: float,
    kappa: np.ndarray,
    prune_weight: float,
) -> tuple[LabelledIntensity, np.ndarray]:
    r"""Update the intensity and the cardinality distribution with a scan.

    Parameters
    ----------
    predicted : LabelledIntensity
        Predicted intensity.
    cardinality : ndarray, shape (N + 1,)
        Predicted p(n).
    sensor : Sensor
    z : ndarray, shape (k, p)
        Detections.
    detection_probability : float
        P_D.
    kappa : ndarray, shape (k,)
        Intensity of clutter at the detections.
    prune_weight : float
        Components below this weight are dropped.

    Returns
    -------
    posterior : LabelledIntensity
    cardinality : ndarray, shape (N + 1,)
        Both unchanged for a scan that is impossible under p(n).

    Notes
    -----
    Let :math:`q = 1 - P_D`, :math:`V = \sum_i w_i`, and let :math:`e_j` be the elementary symmetric
    functions of

    .. math::

        l(z) = \frac{P_D \sum_i w_i \mathcal{N}(z; H m_i, S_i)}{V \kappa(z)}

    over all detections. With

    .. math::

        D = \sum_j a_j e_j, \qquad M = \sum_j a_{j+1} e_j, \qquad
        a_j = \sum_n p(n) \frac{n!}{(n - j)!} q^{n - j}

    the update is

    .. math::

        p(n) \leftarrow \frac{p(n)}{D} \sum_j \frac{n!}{(n - j)!} q^{n - j} e_j, \qquad
        w_{i0} = w_i \frac{q M}{V D}, \qquad
        w_i(z) = \frac{w_i P_D \mathcal{N}(z; H m_i, S_i)}{V \kappa(z)}
                 \frac{1}{D} \frac{\partial D}{\partial l(z)}

    The derivative is the paper's sum over the other detections.

    References
    ----------
    Vo, Vo and Cantoni 2007, eqs. 13-20.
    """
    p = predicted.intensity
    if len(p.w) == 0 or not p.w.sum() > 0:
        return predicted, cardinality
    predicted_z = sensor.predict_detections(p, *sensor.gates(p), z)
    with np.errstate(divide="ignore"):
        log_p = np.log(cardinality)
    posterior, parent, after = _updated(
        p, log_p, predicted_z, np.log(kappa), detection_probability, prune_weight
    )
    return predicted._replace(intensity=posterior, label=predicted.label[parent]), after


@kernel
def _updated(predicted, log_p, predicted_z, log_kappa, detection_probability, least):
    w, m, P = predicted
    z_hat, S, z = predicted_z.z_hat, predicted_z.S, predicted_z.z[0]
    table = log_ratios(w, z_hat, S, z, log_kappa, detection_probability)
    n, k = table.shape
    log_V = np.log(w.sum())
    log_q = np.log(1.0 - detection_probability) if detection_probability < 1.0 else -np.inf
    log_l = np.full(k, -np.inf)
    for i in range(n):
        for j in range(k):
            if table[i, j] > -np.inf:
                log_l[j] = log_sum(log_l[j], table[i, j] - log_V)
    near, log_slope = log_l > -np.inf, np.full(k, -np.inf)  # the others leave every e_j unchanged
    log_e, log_D, log_M, log_slope[near] = elementary_symmetric(log_l[near], log_tails(log_p, log_q))
    if log_D == -np.inf:
        return *posteriors(predicted, np.zeros((n, k)), predicted_z, least), np.exp(log_p)
    for i in range(n):
        for j in range(k):
            table[i, j] = np.exp(table[i, j] - log_V + log_slope[j] - log_D)
    missed = Mixture(w * np.exp(log_q - log_V + log_M - log_D), m, P)
    after = log_p.copy()
    for count in range(len(log_p)):
        after[count] += _log_scan_likelihood(count, log_e, log_q)
    found = posteriors(missed, table, predicted_z, least)
    after = np.exp(after - after.max())
    return *found, after / after.sum()


@kernel
def elementary_symmetric(log_l, log_a):
    r"""Logarithms of e_j (N + 1,), D, M and the derivatives of D by each l (k,), see `update`.

    log_l (k,) are the l, log_a (N + 1,) the a_j.

    Notes
    -----
    The elementary symmetric functions of Vo, Vo and Cantoni (2007) and those without one detection

    .. math::

        e_j = \sum_{S,\, |S| = j} \prod_{z \in S} l(z), \qquad
        \frac{\partial e_j}{\partial l(z)} = e_{j-1}(Z \setminus \{z\})

    one detection more, of ratio l, takes :math:`e_j` to :math:`e_j + l\, e_{j-1}`.
    """
    k, orders = len(log_l), len(log_a)
    # back[t, j]: the factor of e_j of the first t detections in D
    back = np.empty((k + 1, orders + 1))
    back[k, :orders], back[:, orders] = log_a, -np.inf
    for t in range(k - 1, -1, -1):
        for j in range(orders):
            back[t, j] = log_sum(back[t + 1, j], log_l[t] + back[t + 1, j + 1])
    log_e, log_slope = np.full(orders, -np.inf), np.empty(k)
    log_e[0] = 0.0
    for t in range(k):
        total = -np.inf
        for j in range(min(t + 1, orders)):
            total = log_sum(total, log_e[j] + back[t + 1, j + 1])
        log_slope[t] = total
        for j in range(min(t + 1, orders - 1), 0, -1):
            log_e[j] = log_sum(log_e[j], log_l[t] + log_e[j - 1])
    log_M = -np.inf
    for j in range(orders - 1):
        log_M = log_sum(log_M, log_a[j + 1] + log_e[j])
    return log_e, back[0, 0], log_M, log_slope


@kernel
def log_tails(log_p, log_q):
    """Logarithms of a_j (N + 1,), see `update`."""
    orders = len(log_p)
    log_a = np.full(orders, -np.inf)
    for n in range(orders):
        falling = 0.0  # log n! / (n - j)!
        for j in range(n + 1):
            falling += np.log(n - j + 1) if j > 0 else 0.0
            log_a[j] = log_sum(log_a[j], log_p[n] + falling + _log_power(log_q, n - j))
    return log_a


@kernel
def _log_scan_likelihood(n, log_e, log_q):
    """Log-likelihood of the scan given n targets, up to a constant."""
    total, falling = -np.inf, 0.0
    for j in range(n + 1):
        falling += np.log(n - j + 1) if j > 0 else 0.0
        total = log_sum(total, falling + _log_power(log_q, n - j) + log_e[j])
    return total


@kernel
def _log_power(log_q, times):
    return times * log_q if times > 0 else 0.0
