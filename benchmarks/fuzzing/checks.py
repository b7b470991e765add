"""What has to hold of results, judged with more digits than they were made with."""

import numpy as np

from fuzzing.cases import Finding
from gmr_gym.mixture import Mixture

EPS = np.finfo(float).eps
ROOM = 64  # roundings that a number may have gone through, times the components it is made of


def finite(name: str, value) -> None:
    if not np.isfinite(value).all():
        raise Finding("not finite", f"{name} is not finite: {np.asarray(value).ravel()[:6]}")


def covariances(name: str, P: np.ndarray, least: np.ndarray | float = 0.0) -> None:
    """Symmetric to the last bit and positive definite; as definite as rounding allows where the least
    eigenvalue (n,) that they should have is known to drown in it."""
    finite(name, P)
    if not (P == P.swapaxes(-1, -2)).all():
        raise Finding("indefinite", f"{name} is not symmetric: {P.tolist()}")
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        values = np.linalg.eigvalsh(P)
        lost = values[..., 0] <= 0
        drowned = least < ROOM * P.shape[-1] * EPS * values[..., -1]
        far = values[..., 0] < -ROOM * P.shape[-1] * EPS * values[..., -1]
        if (lost & ~(drowned & ~far)).any():
            raise Finding("indefinite", f"{name} has eigenvalues {values[lost][0]}") from None


def mixture(p: Mixture, d: int, total: float | None = None) -> None:
    """A mixture in d dimensions, of weights that sum to `total` where it is given."""
    w, m, P = p
    n = len(w)
    if w.shape != (n,) or m.shape != (n, d) or P.shape != (n, d, d):
        raise Finding("shape", f"mixture of shapes {w.shape}, {m.shape}, {P.shape}, d is {d}")
    finite("w", w)
    finite("m", m)
    if (w < 0).any():
        raise Finding("not finite", f"a weight is negative: {w.min()}")
    covariances("P", P)
    if total is not None and not abs(w.sum() - total) <= 1e-9 * total:
        raise Finding("moments", f"weights sum to {w.sum()!r}, not {total!r}")


def same(outcome: str, what: str, ours, theirs) -> None:
    """Equal to the last bit, in records of records too."""
    if isinstance(ours, tuple):
        for one, other in zip(ours, theirs, strict=True):
            same(outcome, what, one, other)
    elif not np.array_equal(ours, theirs, equal_nan=np.asarray(ours).dtype.kind == "f"):
        raise Finding(outcome, f"{what}: {np.asarray(ours).ravel()[:6]} and {np.asarray(theirs).ravel()[:6]}")


def close(outcome: str, what: str, got, wanted, within) -> None:
    """Within an absolute distance."""
    off = np.abs(np.asarray(got, np.longdouble) - wanted)
    if not (off <= within).all():
        raise Finding(outcome, f"{what}: {got!r}, wanted {wanted!r} within {np.max(within):.2g}")


def groups_match(p: Mixture, q: Mixture, origin: np.ndarray, scale: float = 1.0) -> None:
    """Every component of q is the moment match of the components of p that flowed into it, its weight theirs
    times `scale`: to rounding, as coordinates and covariances of unlike size leave it."""
    room = ROOM * len(p.w) * EPS
    for g in range(len(q.w)):
        members = np.flatnonzero(origin == g)
        if not len(members):
            raise Finding("origin", f"nothing flowed into component {g}: origin {origin.tolist()}")
        w, m, P = (a[members].astype(np.longdouble) for a in p)
        whole = w.sum()
        share = w / whole
        mean = share @ (m - m[0]) + m[0]
        away = m - mean
        covariance = (share[:, None, None] * (P + away[:, :, None] * away[:, None, :])).sum(axis=0)
        close("moments", f"weight of component {g}", q.w[g], whole * scale, room * whole * scale)
        far, wide = np.abs(m).max(), np.abs(away).max()
        close("moments", f"mean of component {g}", q.m[g], mean, room * far)
        within = room * (np.abs(P).max() + wide * wide + far * wide + room * far * far)
        close("moments", f"covariance of component {g}", q.P[g], covariance, within)
