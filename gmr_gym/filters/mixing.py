"""Mixing of motion models of different state: states that one model lacks are borrowed from another."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.models.kalman import Motion

MIXINGS = ("augmented", "unbiased")  # the first is the default


def borrowed_states(motions: tuple[Motion, ...], mixing: str) -> np.ndarray:
    """Which states each filter of an IMM borrows when it is mixed.

    Parameters
    ----------
    motions : tuple of Motion
        r motion models.
    mixing : {"augmented", "unbiased"}
        "augmented" borrows none: the IMM of the motions as given. With "unbiased" the filter of mode p,
        mixed into mode q, borrows the states that motion q has and motion p lacks. A motion lacks a state
        that its F neither reads nor writes, as after `with_accelerations`.

    Returns
    -------
    ndarray of bool, shape (r, r, d)
        Row q and column p hold the states borrowed from mode q by mode p.

    Raises
    ------
    ValueError
        For another mixing.

    References
    ----------
    Yuan, Bar-Shalom, Willett et al. 2012; Granstrom, Willett and Bar-Shalom 2015.
    """
    if mixing not in MIXINGS:
        raise ValueError(f"mixing must be one of {', '.join(map(repr, MIXINGS))}, got {mixing!r}")
    known = np.array([motion.F.any(axis=0) | motion.F.any(axis=1) for motion in motions])
    return (known[:, None] & ~known) & (mixing == "unbiased")


@kernel
def borrow_into(m, P, other_m, other_P, states):
    """Copy the `states` (d,) of other Gaussians into the Gaussians m (n, d), P (n, d, d), in place.

    Their cross-covariances with the remaining states become zero.
    """
    n, d = m.shape
    for i in range(n):
        for r in range(d):
            if states[r]:
                m[i, r] = other_m[i, r]
            for c in range(d):
                if states[r] or states[c]:
                    P[i, r, c] = other_P[i, r, c] if states[r] and states[c] else 0.0
