"""What only a simulation knows of a scan: features for critics that learn, never for policies.

The cost of a choice of thresholds depends mostly on chance: whether the target is about to turn or to be
missed, and whether the right hypothesis is still there. A critic with these features explains that part, and
the rest of the reward is due to the choice. No feature depends on the action that is judged, so the gradient
stays unbiased (asymmetric actor-critic, Pinto et al. 2018; input-dependent baselines, Mao et al. 2019).
"""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared
from gmr_gym.simulation.single_target import Episode, Scenario
from gmr_gym.tuning.features import BOUND

HINDSIGHT = (
    "left",  # 2 (scans to come / 100) - 1
    "strayed",  # (scans in a row beyond the cutoff) / 5 - 1
    "error",  # log10(1 + distance of the mean from the truth, m) / 1.5 - 1
    "nearest",  # log10(0.1 + least squared distance of the true position from a hypothesis) / 2
    "holding",  # 2 (weight of the hypotheses that hold the true position in their gate) - 1
    "hope",  # log10(the largest weight of one of them, at least 1e-8) / 4 + 1
    "turning",  # log10(0.1 + distance from its straight path after AHEAD scans, in sigmas of R) - 0.5
    "showing",  # 2 (share of this scan and the AHEAD next in which it is detected) - 1
    "noise",  # 5 log(true / assumed standard deviation of the sensor), the first axis
)
AHEAD = 5  # scans
FORESEEN = 3  # of HINDSIGHT, the last: they do not depend on the tracker


def lookahead(scenario: Scenario, episode: Episode) -> np.ndarray:
    """The features "turning", "showing" and "noise" of every scan of an episode.

    Parameters
    ----------
    scenario : Scenario
    episode : Episode

    Returns
    -------
    ndarray (T, 3)
    """
    T, p = len(episode.x), list(scenario.position)
    x, v = episode.x[:, p], episode.x[:, list(scenario.velocity)]
    later = np.minimum(np.arange(T) + AHEAD, T - 1)
    straight = x + v * (scenario.period * (later - np.arange(T)))[:, None]
    R = scenario.model.sensor.R
    away = np.sqrt(((x[later] - straight) ** 2).sum(axis=1) / np.trace(R) * len(R))
    detections = np.append(0, np.cumsum(episode.detected))
    share = (detections[later + 1] - detections[:T]) / (later + 1 - np.arange(T))
    noise = 2.5 * np.log(scenario.sensor.R[0, 0] / R[0, 0])
    return np.column_stack([np.log10(0.1 + away) - 0.5, 2 * share - 1, np.full(T, noise)])


@kernel
def hindsight(posterior, H, threshold, x, left, scans_off, ahead):
    """HINDSIGHT (9,), each clipped to +-BOUND, of the full posterior, a Mixture, and the true state x (d,).

    `threshold` is that of the gates, `left` the number of scans to come with this one, and `ahead` (3,) the
    scan's row of `lookahead`.
    """
    w, m, P = posterior
    p, d = H.shape
    target, z_hat, y = np.zeros(p), np.zeros(p), np.empty(p)
    L, S, mean = np.zeros((p, p)), np.empty((p, p)), np.zeros(p)
    for r in range(p):
        for c in range(d):
            target[r] += H[r, c] * x[c]
    nearest, holding, hope = np.inf, 0.0, 1e-8
    for i in range(len(w)):
        for r in range(p):
            z_hat[r] = 0.0
            for c in range(d):
                z_hat[r] += H[r, c] * m[i, c]
            mean[r] += w[i] * z_hat[r]
            for s in range(p):
                S[r, s] = 0.0
                for c in range(d):
                    for k in range(d):
                        S[r, s] += H[r, c] * P[i, c, k] * H[s, k]
        cholesky_into(L, S)
        distance = mahalanobis_squared(L, target, z_hat, y)
        nearest = min(nearest, distance)
        if distance <= threshold:
            holding += w[i]
            hope = max(hope, w[i])
    error = np.sqrt(((mean - target) ** 2).sum())
    values = np.array([
        2 * left / 100 - 1,
        scans_off / 5 - 1,
        np.log10(1 + error) / 1.5 - 1,
        np.log10(0.1 + nearest) / 2,
        2 * min(holding, 1.0) - 1,
        np.log10(hope) / 4 + 1,
        ahead[0],
        ahead[1],
        ahead[2],
    ])  # fmt: skip
    return np.minimum(np.maximum(values, -BOUND), BOUND)
