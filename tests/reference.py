"""Slow, transparent forms that the package is compared with: textbook formulae in plain numpy;
and one world, made of the package's own records, that keeps its word to the tracker."""

from functools import partial
from itertools import product

import numpy as np

from gmr_gym.kalman import constant_velocity, position_sensor
from gmr_gym.metrics import truth_outside_gates
from gmr_gym.mixture import gaussian
from gmr_gym.model import model
from gmr_gym.simulate import Scenario, Window


def random_mixture(rng, n, d, spread=3.0, total=1.0):
    """Weights, means and well-conditioned covariances of n components in d dimensions."""
    A = rng.standard_normal((n, d, d))
    w = rng.dirichlet(np.ones(n)) * total
    return w, spread * rng.standard_normal((n, d)), A @ A.transpose(0, 2, 1) + 0.3 * np.eye(d)


def kalman_predict(m, P, F, Q, offset):
    return F @ m + offset, F @ P @ F.T + Q


def kalman_update(m, P, H, R, z):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return m + K @ (z - H @ m), (np.eye(len(m)) - K @ H) @ P


def mahalanobis_squared(x, m, P):
    return (x - m) @ np.linalg.inv(P) @ (x - m)


def gaussian_density(x, m, P):
    return np.exp(-0.5 * mahalanobis_squared(x, m, P)) / np.sqrt(np.linalg.det(2 * np.pi * P))


def moment_match(w, m, P):
    """Total weight, mean (d,) and covariance (d, d): E[x x'] - E[x] E[x]' about the first mean."""
    a, x = w / w.sum(), m - m[0]
    mean = sum(a[i] * x[i] for i in range(len(w)))
    second = sum(a[i] * (P[i] + np.outer(x[i], x[i])) for i in range(len(w)))
    return w.sum(), m[0] + mean, second - np.outer(mean, mean)


def merge_cost(w, m, P):
    """B of merging all the given components: 1/2 (w log|P| - sum of w_i log|P_i|)."""
    total, _, merged = moment_match(w, m, P)
    logs = [a * np.linalg.slogdet(A)[1] for a, A in zip(w, P, strict=True)]
    return 0.5 * (total * np.linalg.slogdet(merged)[1] - sum(logs))


def cheapest_first(w, m, P, stop):
    """Merges the pair of least B until stop(costs so far, next cost, components left); the groups
    of input indices that went together, the mixture that is left and the costs paid."""
    w, m, P = list(w), list(m), list(P)
    groups, costs = [frozenset([i]) for i in range(len(w))], []
    while len(w) > 1:
        pairs = [(i, j) for j in range(len(w)) for i in range(j)]
        price = [merge_cost(*(np.array([a[i], a[j]]) for a in (w, m, P))) for i, j in pairs]
        best = int(np.argmin(price))
        if stop(costs, price[best], len(w)):
            break
        i, j = pairs[best]
        costs.append(price[best])
        w[i], m[i], P[i] = moment_match(*(np.array([a[i], a[j]]) for a in (w, m, P)))
        groups[i] |= groups[j]
        for a in (w, m, P, groups):
            del a[j]
    return set(groups), (np.array(w), np.array(m), np.array(P)), costs


def runnalls(w, m, P, components):
    return cheapest_first(w, m, P, lambda costs, cost, left: left <= components)


def adaptive(w, m, P, loss_bound, components=None):
    """Algorithm 1 with the last accepted mixture returned: stop before the relative loss passes
    the bound, unless more than `components` are left."""
    whole = merge_cost(w, m, P)
    most = len(w) if components is None else components

    def stop(costs, cost, left):
        return left <= most and sum(costs) + cost > loss_bound * whole

    return cheapest_first(w, m, P, stop)


def salmond(w, m, P, components, distance=0.0):
    """Groups of Salmond's joining, with the covariance of the whole mixture."""
    whitener = np.linalg.inv(moment_match(w, m, P)[2])
    groups = [frozenset([i]) for i in range(len(w))]
    while len(groups) > 1:
        parts = [moment_match(*(a[sorted(g)] for a in (w, m, P))) for g in groups]
        price = {
            (i, j): a[0] * b[0] / (a[0] + b[0]) * (a[1] - b[1]) @ whitener @ (a[1] - b[1])
            for j, b in enumerate(parts)
            for i, a in enumerate(parts[:j])
        }
        i, j = min(price, key=price.get)
        if len(groups) <= components and price[i, j] >= distance:
            break
        groups = [g for k, g in enumerate(groups) if k not in (i, j)] + [groups[i] | groups[j]]
    return set(groups)


def west(w, m, P, components):
    """Groups of West's merging: the lightest joins its nearest."""
    whole = moment_match(w, m, P)[2]
    groups = [frozenset([i]) for i in range(len(w))]
    while len(groups) > components:
        parts = [moment_match(*(a[sorted(g)] for a in (w, m, P))) for g in groups]
        i = min(range(len(parts)), key=lambda k: parts[k][0])
        others = [k for k in range(len(parts)) if k != i]
        j = min(others, key=lambda k: mahalanobis_squared(parts[k][1], parts[i][1], whole))
        groups = [g for k, g in enumerate(groups) if k not in (i, j)] + [groups[i] | groups[j]]
    return set(groups)


def every_history(told, scans):
    """Exact posterior of the last state, one component per history of associations: for each prior
    component and each choice of a detection or none in every scan, the states of all scans are one
    joint Gaussian, conditioned at once on all the detections chosen. Gates must leave nothing out.

    Returns weights (N,), means (N, d), covariances (N, d, d) and the histories, tuples
    (prior component, choice in scan 1, ...) with -1 for none.
    """
    (motion,), (H, R) = told.motions, told.sensor
    choices = [range(-1, len(z)) for z in scans]
    histories = list(product(range(len(told.prior.w)), *choices))
    w, m, P = [], [], []
    for component, *chosen in histories:
        mean, covariance = joint_states(told.prior.m[component], told.prior.P[component], motion, len(scans))
        weight = told.prior.w[component]
        rows, seen = [], []
        for t, (j, z) in enumerate(zip(chosen, scans, strict=True)):
            false = len(z) - (j >= 0)
            weight *= told.clutter_density**false
            weight *= told.detection_probability if j >= 0 else 1 - told.detection_probability
            if j >= 0:
                rows.append(np.kron(np.eye(len(scans))[t], H))
                seen.append(z[j])
        if seen:
            G, z = np.vstack(rows), np.concatenate(seen)
            S = G @ covariance @ G.T + np.kron(np.eye(len(seen)), R)
            weight *= gaussian_density(z, G @ mean, S)
            K = covariance @ G.T @ np.linalg.inv(S)
            mean, covariance = mean + K @ (z - G @ mean), covariance - K @ S @ K.T
        d = len(motion.F)
        w.append(weight)
        m.append(mean[-d:])
        P.append(covariance[-d:, -d:])
    w = np.array(w)
    return w / w.sum(), np.array(m), np.array(P), histories


def joint_states(m, P, motion, scans):
    """Mean (scans d,) and covariance of the states at scans 1, 2, ..., stacked."""
    d = len(m)
    mean, covariance = np.zeros(scans * d), np.zeros((scans * d, scans * d))
    for t in range(scans):
        m, P = kalman_predict(m, P, *motion)
        now = slice(t * d, (t + 1) * d)
        mean[now], covariance[now, now] = m, P
        for s in range(t):
            then, before = slice(s * d, (s + 1) * d), slice((t - 1) * d, t * d)
            covariance[now, then] = motion.F @ covariance[before, then]
            covariance[then, now] = covariance[now, then].T
    return mean, covariance


def world_of_its_word(horizon=10, clutter_rate=160.0, gate_probability=0.9999):
    """A Scenario whose truth is drawn from the very model that the tracker is told: the prior, the
    motion and its noise, the sensor, P_D, and clutter in a box so wide that no gate meets its edge."""
    low, high = np.full(2, -200.0), np.full(2, 200.0)
    told = model(
        constant_velocity(1.0, 1.0), position_sensor(3.0), 0.9, gate_probability,
        clutter_rate / 400.0**2, gaussian(np.zeros(4), np.diag([100.0, 100.0, 4.0, 4.0])),
    )  # fmt: skip
    return Scenario(
        told, partial(_truth_of, told, horizon), told.sensor, 0.9, clutter_rate,
        Window(low, high, follows=False), horizon, 1.0, (0, 1), (2, 3),
        partial(truth_outside_gates, told.sensor.H), patience=1, cutoff=100.0,
    )  # fmt: skip


def _truth_of(told, horizon, rng):
    x = rng.multivariate_normal(told.prior.m[0], told.prior.P[0])
    states = []
    for _ in range(horizon):
        x = rng.multivariate_normal(told.motions[0].F @ x, told.motions[0].Q)
        states.append(x)
    return np.array(states)
