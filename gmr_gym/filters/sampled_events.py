"""Association events drawn by Gibbs sampling."""

import numpy as np

from gmr_gym.kernels import kernel


@kernel
def sampled_events(log_psi, count, rng):
    r"""Different association events among `count` sweeps of a Gibbs sampler, by decreasing weight.

    Parameters
    ----------
    log_psi : ndarray, shape (n, k)
        log weight of each pair of track and detection; minus infinity where it is impossible.
    count : int
        Sweeps. The first event has no pair.
    rng : numpy.random.Generator

    Returns
    -------
    detection : ndarray of int, shape (j, n)
        That of each track, -1 for none.
    log_weight : ndarray, shape (j,)
        Computed, not counted.

    Notes
    -----
    A sweep draws the detection of each track given those of the others:

    .. math:: P(\gamma_i = j) \propto \psi_{ij}, \qquad P(\gamma_i = 0) \propto 1

    over the detections that no other track has.

    References
    ----------
    Vo, Vo and Hoang 2017.
    """
    n, k = log_psi.shape
    events, weight, same = np.empty((count, n), np.int64), np.empty(count), np.empty(count, np.uint64)
    event, taken, found, share = np.full(n, -1), np.zeros(k, np.bool_), 0, np.empty(k + 1)
    for sweep in range(count):
        for i in range(n if sweep else 0):
            if event[i] >= 0:
                taken[event[i]] = False
            top = 0.0
            for j in range(k):
                top = top if taken[j] else max(top, log_psi[i, j])
            share[0] = np.exp(-top)
            for j in range(k):
                share[j + 1] = share[j] + (0.0 if taken[j] else np.exp(log_psi[i, j] - top))
            event[i] = min(np.searchsorted(share, rng.random() * share[k], side="right"), k) - 1
            if event[i] >= 0:
                taken[event[i]] = True
        key, total = np.uint64(0), 0.0
        for i in range(n):
            key = (key ^ np.uint64(event[i] + 2)) * np.uint64(0x9E3779B97F4A7C15)
            total += log_psi[i, event[i]] if event[i] >= 0 else 0.0
        known = False
        for c in range(found):
            if same[c] == key and (events[c] == event).all():
                known = True
        if not known:
            events[found], weight[found], same[found] = event, total, key
            found += 1
    order = np.argsort(-weight[:found], kind="mergesort")
    return events[order], weight[order]
