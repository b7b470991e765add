"""Mixing of motions of unlike state: what an IMM takes for a state that one of its motions does not have."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.models.kalman import Motion

MIXINGS = ("augmented", "unbiased")  # the first unless told


def borrowed_states(motions: tuple[Motion, ...], mixing: str) -> np.ndarray:
    """(r, r, d): in row q and column p the states that the filter of mode p borrows from that of mode q when
    it is mixed into mode q. None with "augmented" mixing, which is the IMM of the motions as they are given.
    With "unbiased" mixing those that motion q has and motion p lacks, because its F neither reads nor writes
    them, as after `with_accelerations` (Yuan, Bar-Shalom, Willett et al. 2012; Granstrom, Willett and
    Bar-Shalom 2015).

    Raises ValueError for another mixing."""
    if mixing not in MIXINGS:
        raise ValueError(f"mixing must be one of {', '.join(map(repr, MIXINGS))}, got {mixing!r}")
    known = np.array([motion.F.any(axis=0) | motion.F.any(axis=1) for motion in motions])
    return (known[:, None] & ~known) & (mixing == "unbiased")


@kernel
def borrow_into(m, P, other_m, other_P, states):
    """Writes the `states` (d,) of other Gaussians into the Gaussians m (n, d), P (n, d, d), where they then
    correlate with no other state: those are known of one mode, these of another."""
    n, d = m.shape
    for i in range(n):
        for r in range(d):
            if states[r]:
                m[i, r] = other_m[i, r]
            for c in range(d):
                if states[r] or states[c]:
                    P[i, r, c] = other_P[i, r, c] if states[r] and states[c] else 0.0
