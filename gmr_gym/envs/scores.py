"""What the estimates of many episodes are worth, as `TrackingEnv` says it of one."""

from gmr_gym.envs.tracking import SCANS_OFF, distance
from gmr_gym.kernels import leaf_kernel


@leaf_kernel
def score_into(error, reward, terminated, truncated, strayed, t, passed, estimates, x, of, position, cutoff):
    """What `TrackingEnv.step` says, all of them (n,), of the estimates (n, d) of scan t[i] of n episodes,
    whose truth x (m, T, d) has in the row of[i], and moves on to the next; zeros of those that are `passed`
    over. Moves the `strayed` in a row too."""
    horizon = x.shape[1]
    for i in range(len(t)):
        error[i], reward[i], terminated[i], truncated[i] = 0.0, 0.0, False, False
        if passed[i]:
            continue
        error[i] = distance(estimates[i], x[of[i], t[i]], position)
        strayed[i] = strayed[i] + 1 if error[i] > cutoff else 0
        t[i] += 1
        left = horizon - t[i]
        reward[i] = -min(error[i], cutoff)
        terminated[i] = strayed[i] >= SCANS_OFF
        truncated[i] = left == 0 and not terminated[i]
        if terminated[i]:
            reward[i] -= cutoff * left
            t[i] = horizon


@leaf_kernel
def first_beyond(extent, passed, estimates):
    """The first of the estimates (n, d), those `passed` over apart, with a number that is not within
    +-extent; -1 for none."""
    for i in range(len(estimates)):
        for c in range(estimates.shape[1]):
            if not (passed[i] or abs(estimates[i, c]) <= extent):
                return i
    return -1
