"""The work of many targets written plainly, in NumPy."""

import numpy as np

from gmr_gym.filters.clutter_estimation import NEIGHBOURHOOD, ClutterEstimate, EstimatorOptions
from gmr_gym.filters.finite_mixture import LEAST_UNIFORM, EmOptions, ScanMixture
from gmr_gym.mixture import Mixture, joined, take
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel


def phd_scan(
    p: Mixture,
    told: MultiTargetModel,
    z: np.ndarray,
    components: int,
    merging: float = 4.0,
    prune: float = 1e-5,
) -> Mixture:
    """The intensity after one scan of the GM-PHD filter, without births and spawning."""
    (F, Q, offset), (H, R) = told.motion, told.sensor
    w, m, P = told.survival_probability * p.w, p.m @ F.T + offset, F @ p.P @ F.T + Q
    S = H @ P @ H.T + R
    nu = z - (m @ H.T)[:, None]
    found = told.detection_probability * w[:, None] * _densities(nu, S)
    found /= told.clutter.density(z) + found.sum(axis=0)
    # the first column is of none, whose innovation is zero
    weights = np.column_stack([(1 - told.detection_probability) * w, found])
    nu = np.concatenate([np.zeros_like(nu[:, :1]), nu], axis=1)
    K = P @ H.T @ np.linalg.inv(S)
    P_hit = P - K @ S @ K.transpose(0, 2, 1)
    parent, seen = np.nonzero(weights >= prune)
    q = Mixture(
        weights[parent, seen],
        m[parent] + (K[parent] @ nu[parent, seen][:, :, None])[:, :, 0],
        np.where(seen[:, None, None] > 0, P_hit[parent], P[parent]),
    )
    q = _merged(q, _near(q, merging, by_its_own=True))
    return take(q, np.argsort(-q.w, kind="stable")[:components])


def fit(z: np.ndarray, parts: ScanMixture, flat: float, how: EmOptions) -> float:
    """Log-likelihood of the finite mixture fitted to the scan by expectation maximisation."""
    n, c, origin, m = len(z), parts.gaussians, parts.origin, parts.m
    P = np.concatenate([_floored(parts.P[:c], how.deviation), parts.P[c:]])
    share, value = _shares(z, parts.w, m, P, flat)
    for _ in range(how.iterations):
        before, count = value, len(m)
        w, m, scatter = _weighted_moments(z, share)
        P[:c] = _floored(scatter[:c], how.deviation)
        w = np.append(max(w[0] / n, LEAST_UNIFORM), w[1:] / n)
        w /= w.sum()
        clutter, targets = Mixture(w[1 : c + 1], m[:c], P[:c]), Mixture(w[c + 1 :], m[c:], P[c:])
        clutter = _merged(clutter, _near(clutter, how.merging))
        clutter = take(clutter, n * clutter.w >= how.clutter_least)
        groups = sorted(_near(targets, how.merging), key=min)
        first = np.array([min(group) for group in groups], int)
        targets = _merged(targets, groups)._replace(P=targets.P[first])
        settled = not how.repaired or len(clutter.w) == c
        kept = n * targets.w >= (how.target_least if settled else 0.0)
        targets, origin, c = take(targets, kept), origin[first[kept]], len(clutter.w)
        w, m, P = np.concatenate([w[:1], clutter.w, targets.w]), *joined([clutter, targets])[1:]
        share, value = _shares(z, w / w.sum(), m, P, flat)
        if len(m) == count and abs(value - before) <= how.tolerance * abs(before):
            break
    return value


def lesson(
    told: Clutter, estimate: ClutterEstimate, z: np.ndarray, p_clutter: np.ndarray, how: EstimatorOptions
) -> Clutter:
    """What is believed of the clutter after one scan more."""
    kept = estimate.age + 1 < 2 * how.memory
    points = np.concatenate([estimate.z[kept], z])
    age = np.concatenate([estimate.age[kept] + 1, np.zeros(len(z))])
    weight = np.concatenate([estimate.p_clutter[kept], p_clutter]) * np.exp(-age / how.memory)
    scans = np.exp(-np.arange(min(estimate.scans + 1, 2 * how.memory)) / how.memory).sum()
    flat, p = 1 / np.prod(told.high - told.low), z.shape[1]
    cost, floor = (p + p * (p + 1) / 2) / 2, how.deviation**2 * np.eye(p)
    w, m, P = estimate.clutter.gaussians
    w = np.append(estimate.clutter.uniform, w) * scans
    if len(m) < how.max_gaussians:
        left = weight * _shares(points, w, m, P, flat)[0][:, 0]
        side = flat ** (-1 / p) / NEIGHBOURHOOD
        about = ((np.abs(z[:, None] - points) <= side / 2).all(axis=2) * left).sum(axis=1)
        expected = left.sum() * flat * side**p
        excess = about.max() - expected
        if excess >= 3 * np.sqrt(expected) + cost:
            w = np.append(w, excess)
            w[0] -= min(excess, w[0] / 2)
            m = np.concatenate([m, z[about.argmax()][None]])
            P = np.concatenate([P, (side**2 / 12 * np.eye(p) + floor)[None]])
    for _ in range(how.iterations):
        total, m, P = _weighted_moments(points, weight[:, None] * _shares(points, w, m, P, flat)[0])
        w = np.maximum(total - cost, 0)
        w[0] = total.sum() - w[1:].sum()
        alive = w[1:] > 0
        w, m, P = np.append(w[0], w[1:][alive]), m[alive], P[alive] + floor
    w = w / (scans + 1)
    return told._replace(uniform=w[0] + told.expected / (scans + 1), gaussians=Mixture(w[1:], m, P))


def _densities(off, S):
    """Normal densities (n, k) of k points that lie `off` (n, k, p) the means of covariances S (n, p, p)."""
    d2 = ((off @ np.linalg.inv(S)) * off).sum(axis=2)
    return np.exp(-0.5 * d2) / np.sqrt(np.linalg.det(2 * np.pi * S))[:, None]


def _shares(z, w, m, P, flat):
    """Which part each point is of (n, 1 + g), the first that of the uniform one; the log-likelihood."""
    joint = w * np.column_stack([np.full(len(z), flat), _densities(z - m[:, None], P).T])
    density = joint.sum(axis=1)
    return joint / density[:, None], float(np.log(density).sum())


def _weighted_moments(z, share):
    """Of the points, those of part i share[:, i + 1] times: how many (1 + g,), means and covariances."""
    number = share.sum(axis=0)
    a = (share[:, 1:] / np.maximum(number[1:], np.finfo(float).tiny)).T
    m = a @ z
    off = z - m[:, None]
    return number, m, (a[:, :, None] * off).transpose(0, 2, 1) @ off


def _floored(P, deviation):
    values, vectors = np.linalg.eigh(P)
    return vectors * np.maximum(values, deviation**2)[:, None] @ vectors.transpose(0, 2, 1)


def _near(p: Mixture, distance: float, by_its_own: bool = False) -> list[np.ndarray]:
    """Groups about the heaviest component, then about the heaviest of the rest: what lies within the squared
    distance by the heaviest's covariance, or `by_its_own`."""
    inverse, groups = np.linalg.inv(p.P), []
    left = np.argsort(-p.w, kind="stable")
    left = left[p.w[left] > 0]
    while len(left):
        off = p.m[left] - p.m[left[0]]
        d2 = (off[:, None] @ inverse[left if by_its_own else left[:1]] @ off[:, :, None])[:, 0, 0]
        groups.append(left[d2 <= distance])
        left = left[d2 > distance]
    return groups


def _merged(p: Mixture, groups: list[np.ndarray]) -> Mixture:
    """The moment match of each group."""
    out = []
    for group in groups:
        w, m, P = take(p, group)
        mean = w @ m / w.sum()
        off = m - mean
        spread = P + off[:, :, None] * off[:, None, :]
        out.append((w.sum(), mean, (w[:, None, None] * spread).sum(axis=0) / w.sum()))
    return Mixture(*map(np.array, zip(*out, strict=True))) if out else take(p, np.empty(0, int))
