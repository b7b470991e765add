"""Scores of the estimates of many episodes, as `TrackingEnv` scores one."""

from gmr_gym.envs.tracking import SCANS_OFF, distance
from gmr_gym.kernels import leaf_kernel


@leaf_kernel
def score_into(
    error, reward, terminated, truncated, scans_off, t, passed, estimates, x, of, position, cutoff
):
    """Scores the estimates (n, d) of scan t[i] of n episodes, as `TrackingEnv.step` does, and moves on to the
    next.

    The truth of episode i is x[of[i]], of x (m, T, d). Results (n,) are zeros where `passed`. `scans_off`
    counts the consecutive scans beyond the cutoff.
    """
    horizon = x.shape[1]
    for i in range(len(t)):
        error[i], reward[i], terminated[i], truncated[i] = 0.0, 0.0, False, False
        if passed[i]:
            continue
        error[i] = distance(estimates[i], x[of[i], t[i]], position)
        scans_off[i] = scans_off[i] + 1 if error[i] > cutoff else 0
        t[i] += 1
        left = horizon - t[i]
        reward[i] = -min(error[i], cutoff)
        terminated[i] = scans_off[i] >= SCANS_OFF
        truncated[i] = left == 0 and not terminated[i]
        if terminated[i]:
            reward[i] -= cutoff * left
            t[i] = horizon


@leaf_kernel
def first_beyond(extent, passed, estimates):
    """The first of the estimates (n, d) with a number that is not within +-extent, -1 for none; `passed` ones
    apart.
    """
    for i in range(len(estimates)):
        for c in range(estimates.shape[1]):
            if not (passed[i] or abs(estimates[i, c]) <= extent):
                return i
    return -1
