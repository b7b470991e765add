"""How good an estimate is, and when a track is lost. Nothing here knows a tracker."""

import numpy as np

from gmr_gym.association import Gates, gated_distances


def truth_outside_gates(H: np.ndarray, gates: Gates, x: np.ndarray, z: np.ndarray) -> bool:
    """Whether the noise-free detection H x of the true state x (d,) lies in no gate
    (D'Ortenzio, section 4: "not contained in any of the hypotheses gates")."""
    return not np.isfinite(gated_distances(gates, (H @ x)[None])).any()


def detection_outside_gates(gates: Gates, x: np.ndarray, z: np.ndarray) -> bool:
    """Whether the target's own detection z (p,) lies in no gate; so too where there was none, z then being
    nan (Maybeck, section V: "without the target-originated measurement falling within an association
    gate for any of the mixture hypotheses")."""
    return not np.isfinite(z).all() or not np.isfinite(gated_distances(gates, z[None])).any()


def lost_at(off_target: np.ndarray, patience: int) -> np.ndarray:
    """Scan (runs,) at which `patience` scans in a row were off target (runs, T), -1 for never."""
    in_a_row = np.zeros(off_target.shape, int)
    in_a_row[:, 0] = off_target[:, 0]
    for t in range(1, off_target.shape[1]):
        in_a_row[:, t] = (in_a_row[:, t - 1] + 1) * off_target[:, t]
    lost = in_a_row >= patience
    return np.where(lost.any(axis=1), lost.argmax(axis=1), -1)


def nees(error: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Normalised error squared e' P^-1 e (...,) of errors (..., d) with covariances (..., d, d);
    its mean is d for a filter that knows how wrong it is."""
    return np.einsum("...i,...i->...", error, np.linalg.solve(P, error[..., None])[..., 0])


def credibility(
    error: np.ndarray, claimed: np.ndarray, weight: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Noncredibility index and inclination (T,), dB, of errors (runs, T, d) whose normalised squares
    e' P^-1 e by the covariances a filter claims are `claimed` (runs, T), see `nees` (Li and Zhao 2006;
    Zhang, section 6.2):

        rho = 10 log10((e' P^-1 e) / (e' C^-1 e)),  C the mean of e e' over the runs

    index = mean |rho|, 0 for a filter as good as it says; inclination = mean rho, above 0 for one
    that is worse than it says. All means are weighted by weight (runs,) where it is given. Not a number
    at a scan whose C is singular, as with fewer runs than states.
    """
    runs, scans, d = error.shape
    weight = np.ones(runs) if weight is None else weight
    if not weight.any():
        return np.full(scans, np.nan), np.full(scans, np.nan)
    share = weight / weight.sum()
    e = error.transpose(1, 2, 0)
    C = (share * e) @ e.transpose(0, 2, 1)
    known = np.linalg.matrix_rank(C, hermitian=True) == d
    whitener = np.full_like(C, np.nan)
    whitener[known] = np.linalg.solve(np.linalg.cholesky(C[known]), np.eye(d))
    actual = ((whitener @ e) ** 2).sum(axis=1).T
    rho = 10 * np.log10(claimed / actual)
    return share @ np.abs(rho), share @ rho
