"""Kernels of range, azimuth and elevation: coordinates, covariances, conversions, predicted detections.

Arrays are float64, and nothing is checked here. `radar` describes the quantities and checks them.
"""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into

RAW, DEBIASED, UNBIASED, MODIFIED_UNBIASED, DECORRELATED, DEBIASED_AT = range(6)
EXTENDED, UNSCENTED, CUBATURE = range(6, 9)


@kernel
def first_invalid(z):
    """First row of z (k, 3) with an impossible range or elevation or a number that is not finite; -1 if
    none."""
    for i in range(len(z)):
        if not (0 < z[i, 0] < np.inf and abs(z[i, 1]) < np.inf and abs(z[i, 2]) <= np.pi / 2):
            return i
    return -1


@kernel
def spherical_of(x):
    """Range, azimuth and elevation (n, 3) of positions (n, >= 3)."""
    out = np.empty((len(x), 3))
    for i in range(len(x)):
        level = np.hypot(x[i, 0], x[i, 1])
        out[i, 0] = np.hypot(level, x[i, 2])
        out[i, 1] = np.arctan2(x[i, 1], x[i, 0])
        out[i, 2] = np.arctan2(x[i, 2], level)
    return out


@kernel
def cartesian_of(z):
    """Positions (k, 3) (Li, eq. 2)."""
    out = np.empty((len(z), 3))
    for i in range(len(z)):
        r, azimuth, elevation = z[i]
        level = r * np.cos(elevation)
        out[i, 0] = level * np.cos(azimuth)
        out[i, 1] = level * np.sin(azimuth)
        out[i, 2] = r * np.sin(elevation)
    return out


@kernel
def wrapped_angle(angle):
    return (angle + np.pi) % (2 * np.pi) - np.pi


@kernel
def wrap_and_validate_of(z):
    """Detections (k, 3) with azimuths wrapped, and a mask (k,) of possible ranges and elevations."""
    out, possible = z.copy(), np.empty(len(z), np.bool_)
    for i in range(len(z)):
        out[i, 1] = wrapped_angle(z[i, 1])
        possible[i] = z[i, 0] > 0 and abs(z[i, 2]) <= np.pi / 2
    return out, possible


@kernel
def log_jacobian_of(z):
    """log(r^2 cos t) (k,): log of the volume in space per unit of range, azimuth and elevation."""
    least = 1e-300
    out = np.empty(len(z))
    for i in range(len(z)):
        out[i] = 2 * np.log(max(z[i, 0], least)) + np.log(max(np.cos(z[i, 2]), least))
    return out


@kernel
def density_of(density, at):
    """Density per m^3 at positions (n, 3) of a density per m rad^2."""
    return density * np.exp(-log_jacobian_of(spherical_of(at)))


@kernel
def jacobian_of(z):
    """Derivatives (k, 3, 3) of position by range, azimuth and elevation (Li, eqs. 3-5)."""
    J = np.empty((len(z), 3, 3))
    for i in range(len(z)):
        r = z[i, 0]
        cb, sb, ct, st = np.cos(z[i, 1]), np.sin(z[i, 1]), np.cos(z[i, 2]), np.sin(z[i, 2])
        J[i, 0, 0], J[i, 0, 1], J[i, 0, 2] = ct * cb, -r * ct * sb, -r * st * cb
        J[i, 1, 0], J[i, 1, 1], J[i, 1, 2] = ct * sb, r * ct * cb, -r * st * sb
        J[i, 2, 0], J[i, 2, 1], J[i, 2, 2] = st, 0.0, r * ct
    return J


@kernel
def inverse_jacobian_of(z):
    """Derivatives (k, 3, 3) of range, azimuth and elevation by position."""
    J = np.empty((len(z), 3, 3))
    for i in range(len(z)):
        r = z[i, 0]
        cb, sb, ct, st = np.cos(z[i, 1]), np.sin(z[i, 1]), np.cos(z[i, 2]), np.sin(z[i, 2])
        level = r * ct
        J[i, 0, 0], J[i, 0, 1], J[i, 0, 2] = ct * cb, ct * sb, st
        J[i, 1, 0], J[i, 1, 1], J[i, 1, 2] = -sb / level, cb / level, 0.0
        J[i, 2, 0], J[i, 2, 1], J[i, 2, 2] = -st * cb / r, -st * sb / r, ct / r
    return J


@kernel
def shrinkage_of(deviations):
    """Factors (3,) by which averaging over the noise of both angles multiplies each coordinate."""
    lb, lt = np.exp(-(deviations[1] ** 2) / 2), np.exp(-(deviations[2] ** 2) / 2)
    return np.array([lb * lt, lb * lt, lt])


@kernel
def scatter_of(z, noise, spread):
    """Covariance (k, 3, 3) of positions whose range, azimuth and elevation have standard deviations
    `noise` about a centre, averaged over centres of mean z (k, 3) and standard deviations `spread`,
    (k, 3), or (1, 3) for all.

    A coordinate is a product of independent factors. E[u v] - E[u] E[v] of such products is computed factor
    by factor, from the covariance and the product of means of each, so that no large numbers are subtracted.
    """
    out = np.empty((len(z), 3, 3))
    V = noise[0] ** 2
    for i in range(len(z)):
        if i == 0 or len(spread) > 1:
            wide = spread[i]
            azimuths, elevations = _averages(noise[1], wide[1]), _averages(noise[2], wide[2])
            left = np.exp(-(noise[1] ** 2 + wide[1] ** 2) / 2)
        N = z[i, 0] ** 2 + wide[0] ** 2
        cb, sb = np.cos(z[i, 1]), np.sin(z[i, 1])
        bcc, Bcc, bss, Bss, bcs, Bcs = _angle(cb, sb, azimuths)
        tcc, Tcc, tss, Tss, tcs, Tcs = _angle(np.cos(z[i, 2]), np.sin(z[i, 2]), elevations)
        out[i, 0, 0] = _product(V, N, tcc, Tcc, bcc, Bcc)
        out[i, 1, 1] = _product(V, N, tcc, Tcc, bss, Bss)
        out[i, 2, 2] = _product(V, N, tss, Tss, 0.0, 1.0)
        out[i, 0, 1] = out[i, 1, 0] = _product(V, N, tcc, Tcc, bcs, Bcs)
        out[i, 0, 2] = out[i, 2, 0] = _product(V, N, tcs, Tcs, 0.0, left * cb)
        out[i, 1, 2] = out[i, 2, 1] = _product(V, N, tcs, Tcs, 0.0, left * sb)
    return out


@kernel
def _product(V, N, Vt, Nt, Vb, Nb):
    """(V + N) (Vt + Nt) (Vb + Nb) - N Nt Nb."""
    return V * (Vt + Nt) * (Vb + Nb) + N * Vt * (Vb + Nb) + N * Nt * Vb


@kernel
def _averages(noise, spread):
    """Factors by which averaging multiplies a squared mean (over `noise`) and a mean of twice the angle
    (over `spread`), each with its complement to 1: kept, lost, wide, narrow."""
    return np.exp(-(noise**2)), -np.expm1(-(noise**2)), np.exp(-2 * spread**2), -np.expm1(-2 * spread**2)


@kernel
def _angle(c, s, averages):
    """Covariance and product of means of cosine and cosine, sine and sine, cosine and sine, for an angle
    of cosine c and sine s."""
    kept, lost, wide, narrow = averages
    cosine, sine = wide * (c * c - s * s), wide * 2 * s * c
    # 1 - kept cosine and 1 + kept cosine, without cancellation
    below = lost + kept * (narrow + 2 * wide * s * s)
    above = lost + kept * (narrow + 2 * wide * c * c)
    return (
        lost * below / 2, kept * (1 + cosine) / 2,
        lost * above / 2, kept * (1 - cosine) / 2,
        -lost * kept * sine / 2, kept * sine / 2,
    )  # fmt: skip


@kernel
def raw_of(z, noise):
    A = jacobian_of(z) * noise
    R = np.zeros((len(z), 3, 3))
    for i in range(len(z)):
        for r in range(3):
            for c in range(3):
                for k in range(3):
                    R[i, r, c] += A[i, r, k] * A[i, c, k]
    return cartesian_of(z), R


@kernel
def debiased_of(z, noise):
    D, x = shrinkage_of(noise), cartesian_of(z)
    return x - D * (D - 1) * x, scatter_of(z, noise, noise.reshape(1, 3))


@kernel
def unbiased_of(z, noise):
    D, x = shrinkage_of(noise), cartesian_of(z)
    R = scatter_of(z, noise, np.zeros((1, 3)))
    for i in range(len(z)):
        off = (1 / D - D) * x[i]
        R[i] += off.reshape(3, 1) * off
    return x / D, R


@kernel
def modified_unbiased_of(z, noise):
    return shrinkage_of(noise) * cartesian_of(z), scatter_of(z, noise, np.zeros((1, 3)))


@kernel
def decorrelated_of(z, noise, at, spread):
    D = shrinkage_of(noise)
    return cartesian_of(z) / D, scatter_of(at, noise, spread) / (D.reshape(3, 1) * D)


@kernel
def debiased_at_of(z, noise, at, spread):
    x, middle, D = cartesian_of(z), cartesian_of(at), shrinkage_of(noise)
    out = np.empty((len(at), len(z), 3))
    for i in range(len(at)):
        out[i] = x - (D - 1) * shrinkage_of(spread[i]) * middle[i]
    return out, scatter_of(at, noise, spread)


@kernel
def gates_of(m, P, noise):
    """Predicted positions (n, 3), and the covariances (n, 3, 3) of converted detections about them."""
    at = np.ascontiguousarray(m[:, :3])
    return at, P[:, :3, :3] + scatter_of(spherical_of(at), noise, np.zeros((1, 3)))


@kernel
def predicted_detections(update, m, P, z, noise):
    """The fields of PredictedDetections, for the scan z (k, 3) and Gaussians of means m (n, d) and
    covariances P (n, d, d), by the update of that index in `radar.UPDATES`."""
    n, k = len(m), len(z)
    at, P_at = np.ascontiguousarray(m[:, :3]), np.ascontiguousarray(P[:, :3, :3])
    C = np.ascontiguousarray(P[:, :3])
    R, points = np.empty((0, 3, 3)), np.empty((1, k, 3))
    place = spherical_of(at)
    if update >= DECORRELATED and not (place[:, 0] > 0).all():
        raise ValueError("a predicted position is that of the radar itself, where the direction is undefined")
    if update >= EXTENDED:
        z_hat = place
        if update == EXTENDED:
            C, S, H = _linearised(z_hat, C)
            own = np.zeros((n, 3, 3))
        else:
            C, S, H, own = _by_points(z_hat, m, P, C, update)
        points = np.empty((n, k, 3))
        for i in range(n):
            for r in range(3):
                S[i, r, r] += noise[r] ** 2
                own[i, r, r] += noise[r] ** 2
            points[i] = z
            for j in range(k):
                points[i, j, 1] = z_hat[i, 1] + wrapped_angle(z[j, 1] - z_hat[i, 1])
        return z_hat, S, C, points, R, np.zeros(k), H, own
    S, D, scale, own = P_at, shrinkage_of(noise), np.ones(3), np.zeros((1, 3, 3))
    if update == RAW:
        points[0], R = raw_of(z, noise)
    elif update == DEBIASED:
        points[0], R = debiased_of(z, noise)
        scale = 1 + D - D**2
    elif update == UNBIASED:
        points[0], R = unbiased_of(z, noise)
        scale = 1 / D
    elif update == MODIFIED_UNBIASED:
        points[0], R = modified_unbiased_of(z, noise)
        scale = D
    else:
        spread = _spread_of(place, P_at)
        if update == DECORRELATED:
            points[0], own = decorrelated_of(z, noise, place, spread)
            scale = 1 / D
        else:
            points, own = debiased_at_of(z, noise, place, spread)
        S = P_at + own
    # a conversion that scales volumes scales the clutter density too
    log_jacobian = log_jacobian_of(z) + np.log(scale).sum()
    return at, S, C, points, R, log_jacobian, np.expand_dims(np.eye(3, m.shape[1]), 0), own


@kernel
def _spread_of(place, P):
    """Standard deviations (n, 3) of range, azimuth and elevation, to first order, of positions of
    covariances P."""
    J = inverse_jacobian_of(place)
    out = np.zeros((len(place), 3))
    for i in range(len(place)):
        for r in range(3):
            for a in range(3):
                for b in range(3):
                    out[i, r] += J[i, r, a] * P[i, a, b] * J[i, r, b]
    return np.sqrt(out)


@kernel
def _linearised(z_hat, PH):
    """Covariances of the predicted detections with the state (n, 3, d) and with themselves (n, 3, 3), to
    first order about the prediction, and their derivatives by the state (n, 3, d). PH (n, 3, d) is the
    covariance of position and state."""
    J = inverse_jacobian_of(z_hat)
    C, S, H = np.zeros(PH.shape), np.zeros((len(PH), 3, 3)), np.zeros(PH.shape)
    H[:, :, :3] = J
    for i in range(len(PH)):
        for r in range(3):
            for c in range(PH.shape[2]):
                for k in range(3):
                    C[i, r, c] += J[i, r, k] * PH[i, k, c]
        for r in range(3):
            for c in range(r + 1):
                for k in range(3):
                    S[i, r, c] += C[i, r, k] * J[i, c, k]
                S[i, c, r] = S[i, r, c]
    return C, S, H


@kernel
def _by_points(z_hat, m, P, PH, update):
    """As `_linearised`, by sigma points of the position, which is all the radar measures: cubature
    (Arasaratnam and Haykin 2009), or unscented with kappa = 3 - n = 0 raised to 1, so that the centre
    has weight (Julier and Uhlmann 1997). z_hat is that of the centre on entry, and becomes the mean of
    the points. The regression on the state takes the place of the derivatives, and its residual
    covariance (n, 3, 3) is also returned."""
    n, d = m.shape
    reach, weight, middle_weight = np.sqrt(3.0), 1 / 6, 0.0
    if update == UNSCENTED:
        reach, weight, middle_weight = 2.0, 1 / 8, 1 / 4
    C, S, H, left = np.zeros((n, 3, d)), np.zeros((n, 3, 3)), np.zeros((n, 3, d)), np.zeros((n, 3, 3))
    L, x, steps, W = np.zeros((3, 3)), np.empty((6, 3)), np.empty((6, 3)), np.empty(3)
    cross = np.empty((3, 3))
    for i in range(n):
        if not cholesky_into(L, P[i, :3, :3]):
            raise ValueError("a position's covariance is not positive definite")
        for j in range(3):
            for a in range(3):
                steps[j, a], steps[3 + j, a] = reach * L[a, j], -reach * L[a, j]
                x[j, a], x[3 + j, a] = m[i, a] + steps[j, a], m[i, a] + steps[3 + j, a]
        off = spherical_of(x)
        shift = np.zeros(3)
        for j in range(6):
            for a in range(3):
                off[j, a] -= z_hat[i, a]
            off[j, 1] = wrapped_angle(off[j, 1])
            shift += weight * off[j]
        cross[:] = 0.0
        for a in range(3):
            for b in range(3):
                S[i, a, b] = middle_weight * shift[a] * shift[b]
                for j in range(6):
                    S[i, a, b] += weight * (off[j, a] - shift[a]) * (off[j, b] - shift[b])
                    cross[a, b] += weight * off[j, a] * steps[j, b]
        # covariance of the detection with the state: that with the position, times its regression
        for c in range(d):
            for a in range(3):
                total = PH[i, a, c]
                for b in range(a):
                    total -= L[a, b] * W[b]
                W[a] = total / L[a, a]
            for a in range(2, -1, -1):
                for b in range(a + 1, 3):
                    W[a] -= L[b, a] * W[b]
                W[a] /= L[a, a]
            for a in range(3):
                for b in range(3):
                    C[i, a, c] += cross[a, b] * W[b]
        _regressed(H[i], left[i], off, shift, reach * L, weight, middle_weight)
        z_hat[i] += shift
    return C, S, H, left


@kernel
def _regressed(H, left, off, shift, steps, weight, middle_weight):
    """Linear regression H (3, >= 3) of the sigma points' deviations off (6, 3) from the centre on their
    positions, plus and then minus the columns of the lower `steps` (3, 3), and the residual covariance
    `left` (3, 3) about the mean `shift`: the odd part in the step is explained, the even part is not."""
    even = np.empty(3)
    for j in range(2, -1, -1):
        for a in range(3):
            total = (off[j, a] - off[3 + j, a]) / 2
            for b in range(j + 1, 3):
                total -= H[a, b] * steps[b, j]
            H[a, j] = total / steps[j, j]
            even[a] = (off[j, a] + off[3 + j, a]) / 2 - shift[a]
        for a in range(3):
            for b in range(3):
                left[a, b] += 2 * weight * even[a] * even[b]
    for a in range(3):
        for b in range(3):
            left[a, b] += middle_weight * shift[a] * shift[b]
