"""Slow, transparent forms that the package is compared with: textbook formulae in plain numpy;
and models and a world, made of the package's own records, that keep their word to the tracker."""

from functools import partial
from itertools import product
from math import factorial, perm

import numpy as np
from scipy.stats import chi2, poisson

from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.mixture import gaussian, mixture
from gmr_gym.models.kalman import motion, position_sensor
from gmr_gym.models.model import model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.simulation.loss import truth_outside_gates
from gmr_gym.simulation.single_target import Scenario, Truth, Window


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
    """Exact posterior of the last state, one component per history of motions and associations: for
    each prior component, each sequence of motions and each choice of a detection or none in every
    scan, the states of all scans are one joint Gaussian, conditioned at once on all the detections
    chosen. Gates must leave nothing out; a sure target is missed in empty scans alone.

    Returns weights (N,), means (N, d), covariances (N, d, d) and the histories, tuples
    (prior component, motions of scans 1, 2, ..., choices in them) with -1 for no detection.
    """
    H, R = told.sensor
    missed = 1 - told.detection_probability
    choices = [range(-1 if missed > 0 or len(z) == 0 else 0, len(z)) for z in scans]
    sequences = product(range(len(told.motions)), repeat=len(scans))
    histories = list(product(range(len(told.prior.w)), sequences, product(*choices)))
    w, m, P = [], [], []
    for component, sequence, chosen in histories:
        motions = [told.motions[p] for p in sequence]
        mean, covariance = joint_states_along(told.prior.m[component], told.prior.P[component], motions)
        weight = told.prior.w[component] * sequence_probability(told, sequence)
        rows, seen = [], []
        for t, (j, z) in enumerate(zip(chosen, scans, strict=True)):
            false = len(z) - (j >= 0)
            weight *= told.clutter_density**false
            weight *= told.detection_probability if j >= 0 else missed
            if j >= 0:
                rows.append(np.kron(np.eye(len(scans))[t], H))
                seen.append(z[j])
        if seen:
            G, z = np.vstack(rows), np.concatenate(seen)
            S = G @ covariance @ G.T + np.kron(np.eye(len(seen)), R)
            weight *= gaussian_density(z, G @ mean, S)
            K = covariance @ G.T @ np.linalg.inv(S)
            mean, covariance = mean + K @ (z - G @ mean), covariance - K @ S @ K.T
        d = H.shape[1]
        w.append(weight)
        m.append(mean[-d:])
        P.append(covariance[-d:, -d:])
    w = np.array(w)
    return w / w.sum(), np.array(m), np.array(P), histories


def sequence_probability(told, sequence):
    """Probability of the motions of scans 1, 2, ..., summed over the mode before the first scan."""
    total = 0.0
    for before, chance in enumerate(told.mode_prior):
        for now in sequence:
            chance *= told.switching[now, before]
            before = now
        total += chance
    return total


def last_mode(w, histories, modes):
    """Probability of each mode in the last scan (r,), from the histories of `every_history`."""
    return np.array([
        sum(a for a, (_, sequence, _) in zip(w, histories, strict=True) if sequence[-1] == p)
        for p in range(modes)
    ])  # fmt: skip


def joint_states(m, P, motion, scans):
    """Mean (scans d,) and covariance of the states at scans 1, 2, ..., stacked."""
    return joint_states_along(m, P, [motion] * scans)


def joint_states_along(m, P, motions):
    """The same where every scan has a motion of its own."""
    d, scans = len(m), len(motions)
    mean, covariance = np.zeros(scans * d), np.zeros((scans * d, scans * d))
    for t, move in enumerate(motions):
        m, P = kalman_predict(m, P, *move)
        now = slice(t * d, (t + 1) * d)
        mean[now], covariance[now, now] = m, P
        for s in range(t):
            then, before = slice(s * d, (s + 1) * d), slice((t - 1) * d, t * d)
            covariance[now, then] = move.F @ covariance[before, then]
            covariance[then, now] = covariance[now, then].T
    return mean, covariance


# ---- one scan of the textbook's multiple model filters ----
# `update` takes a predicted mean and covariance and returns likelihood, mean and covariance. Mode
# weights come back as joint densities of mode and scan: they sum to the likelihood of the scan.


def kalman(m, P, told, z):
    """Likelihood, mean and covariance of a filter that is given its detection z (p,)."""
    H, R = told.sensor
    return gaussian_density(z, H @ m, H @ P @ H.T + R), *kalman_update(m, P, H, R, z)


def pda(m, P, told, z):
    """Likelihood of the detections z (k, p) relative to clutter alone, (1 - P_D P_G) + sum P_D N / density,
    and the mean and covariance over who is the target's."""
    w, means, covariances = [1 - told.detection_probability * told.gate_probability], [m], [P]
    for row in z:
        density, m_hit, P_hit = kalman(m, P, told, row)
        w.append(told.detection_probability * density / told.clutter_density)
        means.append(m_hit)
        covariances.append(P_hit)
    return moment_match(np.array(w), np.array(means), np.array(covariances))


def imm_step(w, m, P, told, update):
    """Mixing probabilities, mixing, filtering, mode probabilities: w (r,), m (r, d), P (r, d, d) of
    the filters before the scan and after it (Bar-Shalom, Li and Kirubarajan 2001, section 11.6)."""
    modes, after = range(len(w)), []
    for q in modes:
        ahead = sum(told.switching[q, p] * w[p] for p in modes)
        mixing = np.array([told.switching[q, p] * w[p] / ahead for p in modes])
        _, mean, covariance = moment_match(mixing, m, P)
        likelihood, mean, covariance = update(*kalman_predict(mean, covariance, *told.motions[q]))
        after.append((ahead * likelihood, mean, covariance))
    return tuple(map(np.array, zip(*after, strict=True)))


def gpb1_step(w, m, P, told, update):
    """Mode weights w (r,) and the one Gaussian m (d,), P (d, d), moved by each motion and merged
    (Bar-Shalom, Li and Kirubarajan 2001, section 11.6)."""
    modes, after = range(len(w)), []
    for q in modes:
        ahead = sum(told.switching[q, p] * w[p] for p in modes)
        likelihood, mean, covariance = update(*kalman_predict(m, P, *told.motions[q]))
        after.append((ahead * likelihood, mean, covariance))
    w, means, covariances = map(np.array, zip(*after, strict=True))
    return w, *moment_match(w, means, covariances)[1:]


def gpb2_step(w, m, P, told, update):
    """As in `imm_step`, but every filter moved by every motion, r^2 in all, and merged after the scan
    into one for each mode now (Bar-Shalom, Li and Kirubarajan 2001, section 11.6)."""
    modes, after = range(len(w)), []
    for q in modes:
        branches = []
        for p in modes:
            likelihood, mean, covariance = update(*kalman_predict(m[p], P[p], *told.motions[q]))
            branches.append((told.switching[q, p] * w[p] * likelihood, mean, covariance))
        after.append(moment_match(*map(np.array, zip(*branches, strict=True))))
    return tuple(map(np.array, zip(*after, strict=True)))


def jumping_model(seed, modes, axes=1, parents=1, detection_probability=1.0, gate_probability=1.0):
    """A Model whose motions differ in F, Q and offset, that switches more readily one way than back,
    with modes that are not alike at the start."""
    rng, d = np.random.default_rng(seed), 2 * axes
    F = constant_velocity(1.0, 1.0, axes).F
    motions = tuple(
        motion(
            F + 0.1 * rng.standard_normal((d, d)),
            0.3 * random_mixture(rng, 1, d)[2][0],
            2 * rng.standard_normal(d),
        )
        for _ in range(modes)
    )
    return model(
        motions, position_sensor(1.0, axes), detection_probability, gate_probability, 0.02,
        mixture(*random_mixture(rng, parents, d)),
        switching=rng.dirichlet(np.ones(modes), modes).T, mode_prior=rng.dirichlet(np.ones(modes)),
    )  # fmt: skip


def flown(told, scans, rng, clutter=0, reach=8.0):
    """Detections (k, p) of `scans` scans of a target drawn from the model, shuffled among `clutter`
    false ones within `reach` of where it is."""
    H, R = told.sensor
    x = rng.multivariate_normal(told.prior.m[0], told.prior.P[0])
    mode, out = rng.choice(len(told.motions), p=told.mode_prior), []
    for _ in range(scans):
        mode = rng.choice(len(told.motions), p=told.switching[:, mode])
        F, Q, offset = told.motions[mode]
        x = rng.multivariate_normal(F @ x + offset, Q)
        z = H @ x + rng.uniform(-reach, reach, (clutter, len(H)))
        if rng.random() < told.detection_probability:
            z = np.vstack([z, rng.multivariate_normal(H @ x, R)])
        out.append(rng.permutation(z))
    return out


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
    return Truth(np.array(states), np.zeros(horizon, int))


# ---- a radar, detection by detection ----


def stretched(z, deviations):
    """Mean (3,) of a position whose range, azimuth and elevation scatter about z with these deviations."""
    (r, azimuth, elevation), (_, wide, high) = z, deviations
    level = r * np.cos(elevation) * np.exp(-(high**2) / 2)
    shrunk = np.exp(-(wide**2) / 2)
    up = r * np.sin(elevation) * np.exp(-(high**2) / 2)
    return np.array([level * np.cos(azimuth) * shrunk, level * np.sin(azimuth) * shrunk, up])


def second_moment(z, deviations):
    """E[x x'] (3, 3) of such a position."""
    (r, b, t), (long, wide, high) = z, deviations
    cb, sb, ct, st = (
        np.exp(-2 * s**2) * f(2 * a) for a, s in ((b, wide), (t, high)) for f in (np.cos, np.sin)
    )
    halves = np.array([[(1 + cb) / 2, sb / 2], [sb / 2, (1 - cb) / 2]])  # cosine and sine of azimuth
    out = np.empty((3, 3))
    out[:2, :2] = (1 + ct) / 2 * halves
    out[2, :2] = out[:2, 2] = st / 2 * np.exp(-(wide**2) / 2) * np.array([np.cos(b), np.sin(b)])
    out[2, 2] = (1 - ct) / 2
    return (r**2 + long**2) * out


def debiased(z, deviations):
    """The detection (3,) as a position less its average true bias, and the average true covariance: of what
    is detected of a truth that itself scatters about the detection (Li, eq. 6)."""
    deviations, none = np.array(deviations), np.zeros(3)
    twice = np.sqrt(2) * deviations
    bias = stretched(z, twice) - stretched(z, deviations)
    shrunk = np.exp(-(deviations[1:] ** 2) / 2)
    left = np.array([shrunk.prod(), shrunk.prod(), shrunk[1]])
    scatter = second_moment(z, twice) - np.outer(left, left) * second_moment(z, deviations)
    return stretched(z, none) - bias, scatter


def radar_near(m, P, told, z):
    """Which detections z (k, 3) of a radar lie in the gate of a prediction, each with its own noise."""
    limit = chi2.ppf(told.gate_probability, 3)
    seen = [debiased(row, told.sensor.deviations) for row in z]
    return np.array([mahalanobis_squared(at, m[:3], P[:3, :3] + R) <= limit for at, R in seen], bool)


def radar_pda(m, P, told, z):
    """As `pda` with a radar's debiased detections z (k, 3): each has a noise, an innovation covariance and
    a gain of its own, and clutter of density L per m rad^2 is that over the volume a unit of it is
    debiased into."""
    H = np.eye(3, len(m))
    w, means, covariances = [1 - told.detection_probability * told.gate_probability], [m], [P]
    for row in z:
        at, R = debiased(row, told.sensor.deviations)
        J = [
            (
                debiased(row + step, told.sensor.deviations)[0]
                - debiased(row - step, told.sensor.deviations)[0]
            )
            / 2
            for step in np.diag([1.0, 1e-4, 1e-4])
        ]
        false = told.clutter_density * 1e-8 / abs(np.linalg.det(J))
        density = gaussian_density(at, m[:3], P[:3, :3] + R)
        m_hit, P_hit = kalman_update(m, P, H, R, at)
        w.append(told.detection_probability * density / false)
        means.append(m_hit)
        covariances.append(P_hit)
    return moment_match(np.array(w), np.array(means), np.array(covariances))


# ---- many targets ----


def phd_predicted(w, m, P, told):
    """Survivors, spawned and born, one after another."""
    moved = [kalman_predict(m[i], P[i], *told.motion) for i in range(len(w))]
    born = list(zip(*told.births, strict=True))
    out = [(told.survival_probability * a, x, A) for a, (x, A) in zip(w, moved, strict=True)]
    out += [(told.spawn_weight * a, x, A + told.spawn_covariance) for a, (x, A) in zip(w, moved, strict=True)]
    return tuple(map(np.array, zip(*(out + born), strict=True)))


def phd_updated(w, m, P, told, kappa, z):
    """Every component missed, then with every detection z (k, p); kappa (k,) of clutter there."""
    H, R = told.sensor
    density = np.array(
        [[gaussian_density(row, H @ x, H @ A @ H.T + R) for row in z] for x, A in zip(m, P, strict=True)]
    )
    found = told.detection_probability * w[:, None] * density.reshape(len(w), len(z))
    found = found / (kappa + found.sum(axis=0))
    return _every_pair((1 - told.detection_probability) * w, found, m, P, told, z)


def cphd_updated(w, m, P, p, told, kappa, clutter, z):
    """The same, and p(n) after the scan, by the printed sums (Vo, Vo and Cantoni 2007, eqs. 13-19); `clutter`
    is the expected number of false detections, Poisson."""
    H, R = told.sensor
    P_D, V, k = told.detection_probability, w.sum(), len(z)
    density = np.array(
        [[gaussian_density(row, H @ x, H @ A @ H.T + R) for row in z] for x, A in zip(m, P, strict=True)]
    )
    psi = (clutter / kappa * P_D * density.reshape(len(w), k)).T  # (k, n)

    def upsilon(u, psi):
        e = np.abs(np.poly(psi @ w))  # elementary symmetric functions
        left = len(psi)
        return np.array([
            sum(
                factorial(left - j) * poisson.pmf(left - j, clutter) * perm(n, j + u)
                * ((1 - P_D) * V) ** (n - j - u) / V**n * e[j]
                for j in range(min(left, n) + 1)
                if n >= j + u
            )
            for n in range(len(p))
        ])  # fmt: skip

    whole = upsilon(0, psi) @ p
    missed = (1 - P_D) * w * (upsilon(1, psi) @ p) / whole
    found = np.array([w * psi[j] * (upsilon(1, np.delete(psi, j, 0)) @ p) / whole for j in range(k)])
    mixture = _every_pair(missed, found.reshape(k, len(w)).T, m, P, told, z)
    return mixture, upsilon(0, psi) * p / whole


def _every_pair(missed, found, m, P, told, z):
    out = []
    for i in range(len(m)):
        out.append((missed[i], m[i], P[i]))
        out += [(found[i, j], *kalman_update(m[i], P[i], *told.sensor, z[j])) for j in range(len(z))]
    return tuple(map(np.array, zip(*out, strict=True)))


def vo_ma_groups(w, m, P, distance):
    """Groups of Vo and Ma's merging, the heaviest first."""
    left, groups = set(range(len(w))), []
    while left:
        j = max(left, key=lambda i: w[i])
        near = {i for i in left if mahalanobis_squared(m[j], m[i], P[i]) <= distance}
        groups.append(frozenset(near))
        left -= near
    return groups


def runs_of(error, off=None, claimed=None, seed=0):
    """Runs with these errors (runs, T, d), and off target in the scans of `off` (runs, T)."""
    rng = np.random.default_rng(seed)
    n, scans, d = error.shape
    truth = rng.standard_normal(error.shape)
    P = np.tile(np.eye(d), (n, scans, 1, 1)) if claimed is None else claimed
    return Runs(
        truth, truth + error, P, rng.integers(1, 9, (n, scans)), rng.exponential(50, (n, scans)),
        np.ones((n, scans)), np.zeros((n, scans), bool) if off is None else off, np.ones((n, scans, 1)),
        rng.exponential(1e-3, (n, scans)),
    )  # fmt: skip


def false_alarms(clutter, rng):
    """The false alarms (k, p) of one scan, part by part."""
    low, high = clutter.low, clutter.high
    p = len(low)
    parts = [low + (high - low) * rng.random((rng.poisson(clutter.uniform), p))]
    for w, m, P in zip(*clutter.gaussians, strict=True):
        parts.append(m + rng.standard_normal((rng.poisson(w), p)) @ np.linalg.cholesky(P).T)
    for w, m, P in zip(*clutter.ellipses, strict=True):
        ball = rng.standard_normal((rng.poisson(w), p))
        ball *= (rng.random(len(ball)) ** (1 / p) / np.linalg.norm(ball, axis=1))[:, None]
        parts.append(m + ball @ np.linalg.cholesky(P).T)
    z = np.concatenate(parts)
    return z[np.all((low <= z) & (z <= high), axis=1)]


def scans_of_many(clutter, measured, detected, ranks, rng):
    """Detections (k, p) and origins (k,) of each scan, the targets' and the false alarms by their ranks."""
    for t, one in enumerate(clutter):
        seen = [
            i for i, z in enumerate(measured[t]) if detected[t, i] and all((one.low <= z) & (z <= one.high))
        ]
        false = false_alarms(one, rng)
        order = np.argsort([*ranks[t, seen], *rng.random(len(false))])
        origin = np.array([*seen, *np.full(len(false), -1)], int)
        yield np.concatenate((measured[t, seen], false))[order], origin[order]
