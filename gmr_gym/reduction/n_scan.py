"""N-scan merging: hypotheses that share their last N detections become one."""

from dataclasses import dataclass

import numpy as np

from gmr_gym.checks import check_whole
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, match
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.runnalls import merge_down

MISSED = -1  # in the history of a hypothesis; lower numbers are of before the first scan
_SPREAD = np.uint64(0x9E3779B97F4A7C15)  # odd, of well mixed bits


@dataclass(frozen=True)
class NScan:
    r"""N-scan merging: the hypotheses with the same detections in the last N scans become one.

    Parameters
    ----------
    components : int
        Upper limit of the number of hypotheses that remain: beyond it pairs are merged by cost B.
    scans : int
        N. With 0 all are merged, as in a PDA; with 1 there remains one hypothesis for every detection of the
        last scan, and one for a missed detection.

    Notes
    -----
    A missed detection counts as a detection of its own, and a merged hypothesis has the history that its
    members share, so that histories of N scans are known exactly. Beyond the limit it has that of its
    heaviest member.

    References
    ----------
    Singer, Sea and Housewright 1974.
    """

    components: int
    scans: int = 2

    def __post_init__(self):
        check_whole("scans", self.scans, 0)
        object.__setattr__(self, "scans", int(self.scans))

    def at_start(self, hypotheses: int) -> np.ndarray:
        """Histories (n, N) before the first scan, each its own."""
        return np.tile(MISSED - np.arange(hypotheses)[:, None], self.scans)

    def __call__(self, p: Mixture, history: np.ndarray) -> Reduced:
        """The reduced mixture and the origin (n,) of hypotheses with detections `history` (n, N), the latest
        first."""
        *merged, origin, _ = merge_by_history(*p, history, self.scans, self.components)
        return Mixture(*merged), origin


@kernel
def extended(history, parent, detection):
    """Histories (n, N), the latest detection first, of hypotheses that come from the rows `parent` (n,) of
    `history` and were updated with the rows `detection` (n,) of the scan, -1 for a missed detection."""
    n, scans = len(parent), history.shape[1]
    out = np.empty((n, scans), np.int64)
    for i in range(n):
        for s in range(scans):
            out[i, s] = history[parent[i], s - 1] if s > 0 else detection[i]
    return out


@kernel
def inherited(history, w, origin, count):
    """Histories (count, N) of reduced hypotheses: each has that of the heaviest of the hypotheses, with
    weights w (n,), whose origin it is."""
    out, heaviest = np.full((count, history.shape[1]), MISSED), np.zeros(count)
    for i in range(len(w)):
        j = origin[i]
        if j >= 0 and w[i] > heaviest[j]:
            heaviest[j] = w[i]
            for s in range(history.shape[1]):
                out[j, s] = history[i, s]
    return out


@kernel
def merge_by_history(w, m, P, history, scans, components):
    """w, m, P and origin (n,) of N-scan merging by the first N = `scans` columns of `history`, see `NScan`,
    and its work: a look-up of every hypothesis, and the costs of pairs beyond the limit."""
    group, count = _same_history(w, history, scans)
    w, m, P = match(w, m, P, group, count)
    w, m, P, place, costs = merge_down(w, m, P, components)
    for i in range(len(group)):
        if group[i] >= 0:
            group[i] = place[group[i]]
    return w, m, P, group, len(group) + costs


@kernel
def _same_history(w, history, scans):
    """Groups (n,) of hypotheses of the same history, in the order of their first members, -1 for those of
    weight zero; and their number."""
    n, size = len(w), 2
    while size < 2 * n:
        size *= 2
    table, first, group, count = np.full(size, -1), np.empty(n, np.int64), np.full(n, -1), 0
    for i in range(n):
        if w[i] <= 0.0:
            continue
        code = np.uint64(0)
        for s in range(scans):
            code = (code + np.uint64(history[i, s] - MISSED + 1)) * _SPREAD
            code ^= code >> np.uint64(32)
        at = np.int64(code & np.uint64(size - 1))
        while table[at] >= 0 and not _equal(history[first[table[at]]], history[i], scans):
            at = (at + 1) % size
        if table[at] < 0:
            table[at], first[count] = count, i
            count += 1
        group[i] = table[at]
    return group, count


@kernel
def _equal(a, b, scans):
    for s in range(scans):
        if a[s] != b[s]:
            return False
    return True
