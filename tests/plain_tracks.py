"""The update of `bernoulli_tracks` written out: tracks are dicts, one pair at a time, exact associations."""

from itertools import product

import numpy as np

from gmr_gym.models.intervals import switching_over, transition


def observe(x, origin, polar, p):
    """Cartesian or polar position and range rate of a state."""
    off, v = x[:p] - origin[:p], x[p : 2 * p]
    far = np.linalg.norm(off)
    place = [far, np.arctan2(off[1], off[0]), np.arcsin(off[-1] / far)][:p] if polar else x[:p]
    return np.array([*place, off @ v / far])


def slope(x, origin, polar, p):
    """Derivatives of `observe`, by central differences."""
    steps = 1e-4 * np.eye(len(x))
    return np.array([
        (observe(x + step, origin, polar, p) - observe(x - step, origin, polar, p)) / 2e-4 for step in steps
    ]).T  # fmt: skip


def carry(x, P, modes, q, dt, p):
    F, Q = transition(modes, q, dt, p, len(x))
    return F @ x, F @ P @ F.T + Q


def pair(x, P, look, j):
    """Updated state and likelihood of one mode at the time of detection j."""
    p = look.z.shape[1]
    rows = slice(0, p + bool(np.isfinite(look.range_rate[j])))
    H = slope(x, look.origin[j], look.polar, p)[rows]
    nu = np.array([*look.z[j], look.range_rate[j]])[rows] - observe(x, look.origin[j], look.polar, p)[rows]
    if look.polar:
        nu[1] = np.angle(np.exp(1j * nu[1]))
    S = H @ P @ H.T + np.diag(look.deviation[rows] ** 2)
    K = P @ H.T @ np.linalg.inv(S)
    likelihood = np.exp(-0.5 * nu @ np.linalg.solve(S, nu)) / np.sqrt(np.linalg.det(2 * np.pi * S))
    return x + K @ nu, P - K @ S @ K.T, likelihood


def associations(n, k):
    """Every assignment of n tracks to k detections, -1 for a miss, no detection twice."""
    for a in product(range(-1, k), repeat=n):
        if len({j for j in a if j >= 0}) == sum(j >= 0 for j in a):
            yield a


def update(tracks, modes, look, detection_probability, other):
    """Tracks (dicts of w, m, P, time, existence) after the look; other (k,) is the density of what is no
    track's."""
    p, r, outcomes = look.z.shape[1], len(modes.motion), []
    for track in tracks:
        switching = switching_over(modes, look.time - track["time"])
        w, mixed = switching @ track["w"], []
        for q in range(r):
            share = switching[q] * track["w"] / w[q]
            x = sum(share[a] * track["m"][a] for a in range(r))
            off = track["m"] - x
            mixed.append((x, sum(share[a] * (track["P"][a] + np.outer(off[a], off[a])) for a in range(r))))
        alive = track["existence"]
        late = look.time - track["time"]
        missing = alive * (1 - detection_probability)
        miss = [(missing * w[q], *carry(*mixed[q], modes, q, late, p)) for q in range(r)]
        found = [(1 - alive * detection_probability, miss)]
        for j in range(len(look.at)):
            hit = []
            for q in range(r):
                x, P = carry(*mixed[q], modes, q, look.at[j] - track["time"], p)
                x, P, likelihood = pair(x, P, look, j)
                weight = alive * detection_probability * w[q] * likelihood / other[j]
                hit.append((weight, *carry(x, P, modes, q, look.time - look.at[j], p)))
            found.append((sum(part[0] for part in hit), hit))
        outcomes.append(found)
    return _collapsed(outcomes, len(tracks), len(look.at), look.time)


def _collapsed(outcomes, n, k, time):
    """Marginals of each track over all associations, and the moment match of every mode."""
    weight = np.zeros((n, k + 1))
    for a in associations(n, k):
        total = np.prod([outcomes[i][a[i] + 1][0] for i in range(n)])
        for i in range(n):
            weight[i, a[i] + 1] += total
    weight /= weight.sum(axis=1, keepdims=True)
    tracks = []
    for i in range(n):
        r = len(outcomes[i][0][1])
        shares = weight[i] / [max(total, 1e-300) for total, _ in outcomes[i]]
        parts = [
            [(share * part[q][0], *part[q][1:]) for share, (_, part) in zip(shares, outcomes[i], strict=True)]
            for q in range(r)
        ]
        w = np.array([sum(part[0] for part in parts[q]) for q in range(r)])
        m = np.array([sum(part[0] * part[1] for part in parts[q]) / w[q] for q in range(r)])
        P = np.array([
            sum(part[0] * (part[2] + np.outer(part[1] - m[q], part[1] - m[q])) for part in parts[q]) / w[q]
            for q in range(r)
        ])  # fmt: skip
        tracks.append({"w": w / w.sum(), "m": m, "P": P, "time": time, "existence": w.sum()})
    return tracks
