"""Features of the scans before: what innovations and misses say of the noise that the filter model assumes.

They follow `FEATURES`, and have a memory: means over recent scans, which a detection moves by its weight.
"""

from collections.abc import Sequence

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared
from gmr_gym.tuning.features import BOUND, FEATURES

# v_i: innovation of a hypothesis with a detection, S_i: its covariance, s^2: mean variance of the measurement
# noise, p: dimension of a detection; means over hypotheses with a detection are by weight
RECENT = (
    "nis",  # log2(0.25 + mean of v' S^-1 v / p) / 2, of this scan
    "nis_mean",  # the same of its mean over about three scans
    "nis_long",  # and over about twenty
    "innovation",  # log2(0.25 + mean of v' v / (p s^2)) / 2 - 0.5: whatever noise was assumed
    "innovation_mean",
    "innovation_long",
    "lag",  # half the mean product of the innovation and that of the scan before, over p s^2, short
    "lag_long",  # and long
    "drift",  # log2(0.25 + u' u / p) / 2 + 0.5, u the mean of v / s over about three scans
    "coasting",  # 2 (weight of the heaviest hypothesis without a detection) - 1
    "misses",  # (expected number of misses in a row) / 2 - 1
    "missed_long",  # 4 (share of misses over about twenty scans, less that of the filter model)
    "process_noise",  # 2/3 log2 of the factor on it under which this scan was predicted
    "process_noise_long",  # its mean over about twenty scans
    "price",  # (log10(price of a unit of work) + 3.5) / 1.5
)
ALL_FEATURES = (*FEATURES, *RECENT)
SETS = {"posterior": FEATURES, "all": ALL_FEATURES}
SHORT, LONG = 0.3, 0.05  # share of a mean that one scan replaces
# nis, short and long, innovation and lag likewise, misses in a row, share of misses, log2 of the factor, and
# of the mean innovation that of the scan before and its mean
MEMORY = 13


def at_first(missed: float) -> np.ndarray:
    """The memory (13,) before the first scan, for the probability of a miss of the filter model."""
    return np.array([1.0, 1.0, 2.0, 2.0, 0.0, 0.0, 0.0, missed, *np.zeros(5)])


@kernel
def observe_recent_into(values, hypotheses, gates, z, sensor, set_to, memory):
    """Writes RECENT, each clipped to +-BOUND, to `values` (15,); `memory` (13,) is brought up to the scan.

    Of the hypotheses there are weights, parents and detections as in an Expansion, `gates` and `sensor` are
    as in `expand_scan`; `set_to` are the probability of a miss, the factor on the process noise under which
    the scan was predicted, and the price of work.
    """
    missed, factor, price = set_to
    (w, parent, detection), (centres, S, _), p = hypotheses, gates, z.shape[1]
    hit, nis, size, coasting = 0.0, 0.0, 0.0, 0.0
    mean, variance = np.zeros(p), np.trace(sensor[1]) / p
    L, y = np.zeros((p, p)), np.empty(p)
    conditioned = -1
    for i in range(len(w)):
        j = detection[i]
        if j < 0:
            coasting = max(coasting, w[i])
            continue
        if parent[i] != conditioned:
            conditioned = parent[i]
            cholesky_into(L, S[conditioned])
        hit += w[i]
        nis += w[i] * mahalanobis_squared(L, z[j], centres[conditioned], y)
        for r in range(p):
            v = z[j, r] - centres[conditioned, r]
            size += w[i] * v * v / variance
            mean[r] += w[i] * v / np.sqrt(variance)
    product, drift = 0.0, 0.0
    for r in range(p):
        product += mean[r] * memory[9 + r] / p
        memory[9 + r] = mean[r]
        memory[11 + r] += SHORT * (mean[r] - memory[11 + r])
        drift += memory[11 + r] ** 2 / p
    if hit > 0.0:
        nis, size = nis / (hit * p), size / (hit * p)
    else:
        nis, size = memory[0], memory[2]
    for at, value, share in (
        (0, nis, SHORT * hit), (1, nis, LONG * hit), (2, size, SHORT * hit), (3, size, LONG * hit),
        (4, product, SHORT), (5, product, LONG), (7, 1 - hit, LONG), (8, np.log2(factor), LONG),
    ):  # fmt: skip
        memory[at] += share * (value - memory[at])
    memory[6] = (1 - hit) * (1 + memory[6])
    for i, value in enumerate((
        np.log2(0.25 + nis) / 2,
        np.log2(0.25 + memory[0]) / 2,
        np.log2(0.25 + memory[1]) / 2,
        np.log2(0.25 + size) / 2 - 0.5,
        np.log2(0.25 + memory[2]) / 2 - 0.5,
        np.log2(0.25 + memory[3]) / 2 - 0.5,
        memory[4] / 2,
        memory[5] / 2,
        np.log2(0.25 + drift) / 2 + 0.5,
        2 * coasting - 1,
        memory[6] / 2 - 1,
        4 * (memory[7] - missed),
        np.log2(factor) / 1.5,
        memory[8] / 1.5,
        (np.log10(max(price, 1e-9)) + 3.5) / 1.5,
    )):  # fmt: skip
        values[i] = min(max(value, -BOUND), BOUND)


def check_features(names: str | Sequence[str]) -> tuple[str, ...]:
    """The names of features as a tuple: those of `SETS`, or given one by one.

    Raises
    ------
    ValueError
        If they are not a sequence of different known names, at least one.
    """
    if isinstance(names, str) and names in SETS:
        return SETS[names]
    if isinstance(names, str) or not isinstance(names, Sequence) or not names:
        raise ValueError(f"features must be {', '.join(SETS)}, or a list of their names, got {names!r}")
    feature_index(names)
    if len(set(names)) < len(names):
        raise ValueError(f"features must be different ones, got {names!r}")
    return tuple(names)


def feature_index(names: Sequence[str]) -> np.ndarray:
    """Indices of the named features among `ALL_FEATURES`.

    Raises
    ------
    ValueError
        For an unknown name.
    """
    for name in names:
        if name not in ALL_FEATURES:
            raise ValueError(f"unknown feature {name!r}; choose from {', '.join(ALL_FEATURES)}")
    return np.array([ALL_FEATURES.index(name) for name in names])
