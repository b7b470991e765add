"""Marginal association probabilities by loopy belief propagation."""

import numpy as np

from gmr_gym.kernels import kernel

TOLERANCE = 1e-6  # largest change of a log message at which rounds end
ROUNDS = 1000  # most rounds of messages


@kernel
def propagate(track, detection, log_psi, n, k):
    r"""Marginal association probabilities by loopy belief propagation (Williams and Lau 2014).

    Returns those of each pair (e,), of a missed track (n,) and of an unassigned detection (k,), exact where
    the e pairs form no loop.

    log_psi (e,) is the log weight of the pair of track (e,) and detection (e,) relative to a missed track
    and an unassigned detection. Messages are logarithms too, because with little clutter psi overflows. No
    pair may occur twice.

    Notes
    -----
    Messages of tracks and of detections, from :math:`\nu_{ji} = 1` until they converge

    .. math::

        \mu_{ij} = \frac{\psi_{ij}}{1 + \sum_{l \ne j} \psi_{il} \nu_{li}}, \qquad
        \nu_{ji} = \frac{1}{1 + \sum_{l \ne i} \mu_{lj}}

    and the marginals of a pair, of a missed track and of an unassigned detection

    .. math::

        \bar p_{ij} = \frac{\psi_{ij} \nu_{ji}}{1 + \sum_l \psi_{il} \nu_{li}}, \qquad
        \bar p_{i0} = \frac{1}{1 + \sum_l \psi_{il} \nu_{li}}, \qquad
        u_j = \frac{1}{1 + \sum_l \mu_{lj}}
    """
    e = len(log_psi)
    by_track, first_track = grouped(track, n)
    by_detection, first_detection = grouped(detection, k)
    to_track, to_detection, value = np.zeros(e), np.empty(e), np.empty(e)
    missed, unassigned = np.zeros(n), np.zeros(k)
    for _ in range(ROUNDS):
        for a in range(e):
            value[a] = log_psi[a] + to_track[a]
        _others(to_detection, missed, value, by_track, first_track)
        for a in range(e):
            to_detection[a] = log_psi[a] - to_detection[a]
        change = 0.0
        _others(value, unassigned, to_detection, by_detection, first_detection)
        for a in range(e):
            change = max(change, abs(to_track[a] + value[a]))
            to_track[a] = -value[a]
        if change <= TOLERANCE:
            break
    for a in range(e):
        value[a] = log_psi[a] + to_track[a]
    _others(to_detection, missed, value, by_track, first_track)
    for a in range(e):
        value[a] = np.exp(value[a] - missed[track[a]])
    return value, np.exp(-missed), np.exp(-unassigned)


@kernel
def grouped(group, count):
    """Members (e,) ordered by group, and the start of each group (count + 1,)."""
    first = np.zeros(count + 1, np.int64)
    for a in range(len(group)):
        first[group[a] + 1] += 1
    for g in range(count):
        first[g + 1] += first[g]
    member, at = np.empty(len(group), np.int64), first[:count].copy()
    for a in range(len(group)):
        member[at[group[a]]] = a
        at[group[a]] += 1
    return member, first


@kernel
def _others(out, whole, value, member, first):
    """log(1 + sum of exp) of the values of the other members of a group, and of all members.

    The first goes into out (e,), the second into whole (groups,).
    """
    share = np.empty(len(value))
    for g in range(len(first) - 1):
        top, largest, second = 0.0, -1, 0.0
        for b in range(first[g], first[g + 1]):
            a = member[b]
            if value[a] > top:
                top, largest, second = value[a], a, top
            else:
                second = max(second, value[a])
        whole[g], rest = np.exp(-top), np.exp(-second)
        for b in range(first[g], first[g + 1]):
            a = member[b]
            share[a] = np.exp(value[a] - top)
            whole[g] += share[a]
            rest += np.exp(value[a] - second) if a != largest else 0.0
        for b in range(first[g], first[g + 1]):
            a = member[b]
            # for the largest, subtracting it from the sum would cancel
            out[a] = top + np.log(whole[g] - share[a]) if a != largest else second + np.log(rest)
        whole[g] = top + np.log(whole[g])
