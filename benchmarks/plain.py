"""The same work written plainly, in NumPy or in straightforward compiled loops."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import LOG_2PI
from gmr_gym.mixture import Mixture, moments
from gmr_gym.models.gating import gate_threshold
from gmr_gym.models.model import Model
from gmr_gym.simulation.single_target import Scenario


def runnalls_in_numpy(p: Mixture, components: int, budget: float = np.inf) -> np.ndarray:
    """Origin (n,) of Runnalls' merging as long as the costs add up to no more than the budget: pair costs
    kept in a table whose lower half is used and searched whole for each minimum; a row is formed at once."""
    w, m, P = (a.copy() for a in p)
    n, spent = len(w), 0.0
    into, log_det = np.arange(n), np.linalg.slogdet(P)[1]
    table = np.full((n, n), np.inf)

    def costs(i, others):
        a = w[i] / (w[i] + w[others])
        _, merged = matched(i, others, a)
        total = (w[i] + w[others]) * np.linalg.slogdet(merged)[1]
        return 0.5 * (total - w[i] * log_det[i] - w[others] * log_det[others])

    def matched(i, others, a):
        d = m[i] - m[others]
        a, b = a[:, None], 1 - a[:, None]
        spread = (a * b * d)[:, :, None] * d[:, None, :]
        return a * m[i] + b * m[others], a[:, :, None] * P[i] + b[:, :, None] * P[others] + spread

    for i in range(1, n):
        table[i, :i] = costs(i, np.arange(i))
    alive = np.arange(n)
    while len(alive) > components:
        j, i = divmod(int(table.argmin()), n)  # i < j: only the lower half is finite
        spent += table[j, i]
        if spent > budget:
            break
        mean, merged = matched(i, np.array([j]), np.array([w[i] / (w[i] + w[j])]))
        m[i], P[i], w[i] = mean[0], merged[0], w[i] + w[j]
        log_det[i] = np.linalg.slogdet(P[i])[1]
        into[into == j] = i
        table[j, :], table[:, j] = np.inf, np.inf
        alive = alive[alive != j]
        below, above = alive[alive < i], alive[alive > i]
        table[i, below], table[above, i] = costs(i, below), costs(i, above)
    return np.searchsorted(alive, into)


def adaptive_in_numpy(p: Mixture, loss_bound: float) -> np.ndarray:
    """Origin (n,) of D'Ortenzio's merging while the relative loss stays within the bound."""
    _, P = moments(p)
    total = p.w.sum() * np.linalg.slogdet(P)[1] - p.w @ np.linalg.slogdet(p.P)[1]
    return runnalls_in_numpy(p, 1, loss_bound * 0.5 * total)


def williams_in_numpy(p: Mixture, components: int) -> np.ndarray:
    """Origin (n,) of Williams' reduction: the error of every merge and deletion from sums formed anew."""
    w, m, P = (a.copy() for a in p)
    origin = np.arange(len(w))
    while len(w) > components:
        i, j = np.triu_indices(len(w), 1)
        a, b, w_c = w[i] / (w[i] + w[j]), w[j] / (w[i] + w[j]), w[i] + w[j]
        e = m[i] - m[j]
        m_c = a[:, None] * m[i] + b[:, None] * m[j]
        spread = (a * b)[:, None, None] * e[:, :, None] * e[:, None, :]
        P_c = a[:, None, None] * P[i] + b[:, None, None] * P[j] + spread
        f, f_c = p.w @ _products(p.m, p.P, m, P), p.w @ _products(p.m, p.P, m_c, P_c)
        G, G_c = _products(m, P, m, P), _products(m, P, m_c, P_c)
        own_c = 1 / np.sqrt(np.linalg.det(4 * np.pi * P_c))
        g, own, k = G @ w, np.diag(G), np.arange(len(i))
        gone_f, gone_g = w * f, 2 * w * g - w**2 * own
        less_g = gone_g[i] + gone_g[j] - 2 * w[i] * w[j] * G[i, j]
        more_g = 2 * w_c * (w @ G_c - w[i] * G_c[i, k] - w[j] * G_c[j, k]) + w_c**2 * own_c
        merged = (w @ f - gone_f[i] - gone_f[j] + w_c * f_c, w @ g - less_g + more_g)
        s, s_k = p.w.sum() / w.sum(), p.w.sum() / (w.sum() - w)
        by_merging = -2 * s * merged[0] + s**2 * merged[1]
        by_deleting = -2 * s_k * (w @ f - gone_f) + s_k**2 * (w @ g - gone_g)
        if by_merging.min() < by_deleting.min():
            k = by_merging.argmin()
            w[i[k]], m[i[k]], P[i[k]], gone = w_c[k], m_c[k], P_c[k], j[k]
            origin[origin == gone] = i[k]
        else:
            gone = by_deleting.argmin()
            origin[origin == gone] = -1
        origin[origin > gone] -= 1
        w, m, P = (np.delete(part, gone, axis=0) for part in (w, m, P))
    return origin


def _products(m, P, other_m, other_P):
    """Integrals (n, k) of the products of n Gaussians and k others."""
    S, e = P[:, None] + other_P, (m[:, None] - other_m)[..., None]
    d2 = (e * np.linalg.solve(S, e)).sum((-2, -1))
    return np.exp(-0.5 * d2) / np.sqrt(np.linalg.det(2 * np.pi * S))


def runnalls_compiled(p: Mixture, components: int) -> np.ndarray:
    """Origin (n,) of Runnalls' merging, as in `runnalls_in_numpy` but in compiled loops, a pair at
    a time."""
    return _runnalls(p.w.copy(), p.m.copy(), p.P.copy(), components)


@kernel
def _runnalls(w, m, P, components):
    n, d = m.shape
    into, alive = np.arange(n), np.ones(n, np.bool_)
    L, merged = np.zeros((d, d)), np.empty((d, d))
    log_det, table = np.empty(n), np.empty((n, n))
    for i in range(n):
        log_det[i] = _log_determinant(P[i], L)
    for i in range(n):
        for j in range(i):
            table[i, j] = _cost(i, j, w, m, P, log_det, merged, L)
    for _ in range(n - components):
        least, i, j = np.inf, 0, 0
        for r in range(n):
            for c in range(r):
                if alive[r] and alive[c] and table[r, c] < least:
                    least, i, j = table[r, c], c, r
        _matched(i, j, w, m, P, merged)
        P[i] = merged
        m[i] = (w[i] * m[i] + w[j] * m[j]) / (w[i] + w[j])
        w[i] += w[j]
        log_det[i] = _log_determinant(P[i], L)
        alive[j] = False
        into[into == j] = i
        for k in range(n):
            if alive[k] and k != i:
                table[max(i, k), min(i, k)] = _cost(i, k, w, m, P, log_det, merged, L)
    return into


@kernel
def _cost(i, j, w, m, P, log_det, merged, L):
    _matched(i, j, w, m, P, merged)
    total = (w[i] + w[j]) * _log_determinant(merged, L)
    return 0.5 * (total - w[i] * log_det[i] - w[j] * log_det[j])


@kernel
def _matched(i, j, w, m, P, out):
    a = w[i] / (w[i] + w[j])
    b = 1 - a
    for r in range(len(out)):
        for c in range(r + 1):
            spread = a * b * (m[i, r] - m[j, r]) * (m[i, c] - m[j, c])
            out[r, c] = out[c, r] = a * P[i, r, c] + b * P[j, r, c] + spread


@kernel
def _log_determinant(A, L):
    out = 0.0
    for r in range(len(A)):
        for c in range(r + 1):
            total = A[r, c]
            for k in range(c):
                total -= L[r, k] * L[c, k]
            if r == c:
                L[r, r] = np.sqrt(total)
                out += np.log(L[r, r])
            else:
                L[r, c] = total / L[c, c]
    return 2 * out


def williams_compiled(p: Mixture, components: int) -> np.ndarray:
    """Origin (n,) of Williams' reduction, as in `williams_in_numpy` but in compiled loops, a pair at a time:
    the products of every merge are kept, and of those with the other components three terms change a step."""
    return _williams(p.w, p.m, p.P, components)


@kernel
def _williams(w_f, m_f, P_f, components):
    n, d = m_f.shape
    w, m, P = w_f.copy(), m_f.copy(), P_f.copy()
    origin, alive, total = np.arange(n), np.ones(n, np.bool_), w.sum()
    f, G = np.zeros(n), np.empty((n, n))  # <f, M[a]>, <M[a], M[b]>
    # of the merge C of a < b: <f, C>, <C, C> and its products with the components other than a and b
    pairs = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    room = np.empty((d, d)), np.zeros((d, d)), np.empty(d), np.empty(d), np.empty((d, d))
    change, m_k, P_k = np.empty(3), np.empty((3, d)), np.empty((3, d, d))
    for a in range(n):
        for b in range(n):
            G[a, b] = _product(m[a], P[a], m[b], P[b], room)
            f[a] += w[b] * G[a, b]
    for a in range(n):
        for b in range(a + 1, n):
            _pair_products(a, b, w_f, m_f, P_f, w, m, P, alive, pairs, room)
    for _ in range(n - components):
        i, j = _cheapest(total, w, alive, f, G, pairs)
        for k, a in enumerate((i, j)):
            change[k], m_k[k], P_k[k] = -w[a], m[a], P[a]
        origin[origin == j] = i if i != j else -1
        alive[j] = False
        count = 1
        if i != j:
            _matched(i, j, w, m, P, P[i])
            m[i] = (w[i] * m[i] + w[j] * m[j]) / (w[i] + w[j])
            w[i] += w[j]
            f[i] = pairs[0][i, j]
            change[2], m_k[2], P_k[2], count = w[i], m[i], P[i], 3
        _update_pairs(i, change[:count], m_k, P_k, w, m, P, alive, pairs[2], room)
        if i != j:
            for a in range(n):
                if alive[a]:
                    G[a, i] = G[i, a] = _product(m[i], P[i], m[a], P[a], room)
            for a in range(n):
                if alive[a] and a != i:
                    _pair_products(min(a, i), max(a, i), w_f, m_f, P_f, w, m, P, alive, pairs, room)
    return origin


@kernel
def _cheapest(total, w, alive, f, G, pairs):
    """The pair whose merge, or twice the component whose deletion, adds least to the error: that of the
    reduced mixture g and f is <f, f> - 2 s <f, g> + s^2 <g, g>, with s such that s g has the weight of f."""
    n = len(w)
    g, W, fg, gg = np.zeros(n), 0.0, 0.0, 0.0
    for a in range(n):
        if alive[a]:
            for b in range(n):
                g[a] += w[b] * G[a, b] if alive[b] else 0.0
            W, fg, gg = W + w[a], fg + w[a] * f[a], gg + w[a] * g[a]
    s, least, i, j = total / W, np.inf, 0, 0
    for a in range(n):
        if alive[a]:
            grown = s * w[a] / (W - w[a])
            after = s + grown
            gone = 2.0 * w[a] * g[a] - w[a] ** 2 * G[a, a]
            cost = 2.0 * (after * w[a] * f[a] - grown * fg) + grown * (after + s) * gg - after**2 * gone
            if cost < least:
                least, i, j = cost, a, a
    for a in range(n):
        for b in range(a + 1, n):
            if alive[a] and alive[b]:
                c = w[a] + w[b]
                of_f = w[a] * f[a] + w[b] * f[b] - c * pairs[0][a, b]
                gone = 2.0 * (w[a] * g[a] + w[b] * g[b] - w[a] * w[b] * G[a, b])
                gone -= w[a] ** 2 * G[a, a] + w[b] ** 2 * G[b, b]
                come = c * (2.0 * pairs[2][a, b] + c * pairs[1][a, b])
                cost = 2.0 * s * of_f + s**2 * (come - gone)
                if cost < least:
                    least, i, j = cost, a, b
    return i, j


@kernel
def _pair_products(a, b, w_f, m_f, P_f, w, m, P, alive, pairs, room):
    """Sets all products of the merge of a < b."""
    with_f, own, with_others = pairs
    m_c, P_c = room[3:]
    _pair(a, b, w, m, P, m_c, P_c)
    own[a, b] = _product(m_c, P_c, m_c, P_c, room)
    with_f[a, b] = with_others[a, b] = 0.0
    for k in range(len(w)):
        with_f[a, b] += w_f[k] * _product(m_c, P_c, m_f[k], P_f[k], room)
        if alive[k] and k != a and k != b:
            with_others[a, b] += w[k] * _product(m_c, P_c, m[k], P[k], room)


@kernel
def _update_pairs(changed, weights, m_k, P_k, w, m, P, alive, with_others, room):
    """Adds weighted components to the others of every pair, but for those of the changed one."""
    m_c, P_c = room[3:]
    for a in range(len(w)):
        for b in range(a + 1, len(w)):
            if alive[a] and alive[b] and a != changed and b != changed:
                _pair(a, b, w, m, P, m_c, P_c)
                for k in range(len(weights)):
                    with_others[a, b] += weights[k] * _product(m_c, P_c, m_k[k], P_k[k], room)


@kernel
def _pair(a, b, w, m, P, mean, covariance):
    _matched(a, b, w, m, P, covariance)
    for r in range(len(mean)):
        mean[r] = (w[a] * m[a, r] + w[b] * m[b, r]) / (w[a] + w[b])


@kernel
def _product(m_a, P_a, m_b, P_b, room):
    """Integral of the product of two Gaussians."""
    S, L, e = room[:3]
    d2 = 0.0
    for r in range(len(e)):
        for c in range(r + 1):
            S[r, c] = P_a[r, c] + P_b[r, c]
    log_det = _log_determinant(S, L)
    for r in range(len(e)):
        e[r] = m_a[r] - m_b[r]
        for c in range(r):
            e[r] -= L[r, c] * e[c]
        e[r] /= L[r, r]
        d2 += e[r] ** 2
    return np.exp(-0.5 * (d2 + log_det + len(e) * LOG_2PI))


class Pda:
    """Probabilistic data association in NumPy; the belief is a mean (d,) and a covariance (d, d)."""

    def __init__(self, model: Model):
        self.model = model
        self.size = gate_threshold(model.gate_probability, len(model.sensor.H))

    def init(self):
        return self.model.prior.m[0], self.model.prior.P[0]

    @staticmethod
    def estimate(belief) -> tuple[np.ndarray, int]:
        """Mean (d,) and number of components."""
        return belief[0], 1

    def step(self, belief, z):
        """The belief after the scan z (k, p), twice: there is nothing to report beside it."""
        m, P = belief
        (F, Q, offset), (H, R) = self.model.motions[0], self.model.sensor
        m, P = F @ m + offset, F @ P @ F.T + Q
        S = H @ P @ H.T + R
        S_inverse = np.linalg.inv(S)
        nu = z - H @ m
        d2 = np.einsum("ki,ij,kj->k", nu, S_inverse, nu)
        gated = d2 <= self.size
        nu, d2 = nu[gated], d2[gated]
        detected = self.model.detection_probability / self.model.clutter_density
        likelihood = detected * np.exp(-0.5 * d2) / np.sqrt(np.linalg.det(2 * np.pi * S))
        miss = 1 - self.model.detection_probability * self.model.gate_probability
        beta = likelihood / (miss + likelihood.sum())
        K = P @ H.T @ S_inverse
        mean = beta @ nu
        spread = (beta[:, None] * nu).T @ nu - np.outer(mean, mean)
        belief = m + K @ mean, P - beta.sum() * K @ S @ K.T + K @ spread @ K.T
        return belief, belief


def simulated(scenario: Scenario, rng: np.random.Generator) -> list[np.ndarray]:
    """The scans of one episode, each drawn when its turn comes."""
    low, high = scenario.window[:2]
    H, R = scenario.sensor
    sides, root = high - low, np.linalg.cholesky(R)
    out = []
    for x in scenario.truth(rng).x:
        z = low + sides * rng.random((rng.poisson(scenario.clutter_rate), len(R)))
        if rng.random() < scenario.detection_probability:
            target = H @ x + root @ rng.standard_normal(len(R))
            slot = int(rng.random() * (len(z) + 1))
            z = np.concatenate((z[:slot], target[None], z[slot:]))
        out.append(z)
    return out
