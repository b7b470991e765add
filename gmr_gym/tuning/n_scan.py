"""Merging hypotheses that share their last N detections, with labels that keep the last few of each."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.mixture import match

BITS, DEPTH = 12, 5  # of a detection's number in a label, and detections in it
LAST = (1 << BITS) - 1


@kernel
def labels_after(labels, parent, detection):
    """Labels (n,) of hypotheses from those of their parents, and the rows of the scan that they were updated
    with, -1 for a miss."""
    out = np.empty(len(parent), np.int64)
    for i in range(len(parent)):
        out[i] = ((labels[parent[i]] << BITS) | min(detection[i] + 1, LAST)) & ((1 << (BITS * DEPTH)) - 1)
    return out


@kernel
def merge_alike(w, m, P, labels, history):
    """w, m, P and labels of the mixture in which those that share the last `history` detections are merged,
    in the order of their first; each keeps the label of its heaviest."""
    n = len(w)
    shared = labels & ((1 << (BITS * history)) - 1)
    order = np.argsort(shared, kind="mergesort")
    first, group = np.empty(n, np.int64), np.empty(n, np.int64)
    for k in range(n):
        i = order[k]
        first[i] = first[order[k - 1]] if k > 0 and shared[i] == shared[order[k - 1]] else i
    count = 0
    heaviest = np.empty(n, np.int64)
    for i in range(n):
        if first[i] == i:
            group[i], heaviest[count] = count, i
            count += 1
        else:
            g = group[i] = group[first[i]]
            if w[i] > w[heaviest[g]]:
                heaviest[g] = i
    w, m, P = match(w, m, P, group, count)
    return w, m, P, labels[heaviest[:count]]
