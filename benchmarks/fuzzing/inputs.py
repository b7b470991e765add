"""Hostile numbers: mixtures, points, scans; the same in other layouts and kinds; and spoilt ones."""

import numpy as np

from fuzzing.cases import Spoilt
from gmr_gym.mixture import Mixture

Rng = np.random.Generator

WORDS = {
    "w": ("w", "weight", "weights"),
    "m": ("m", "mean", "means"),
    "P": ("P", "covariance", "covariances"),
}
LAYOUTS = ("float32", "whole", "read-only", "fortran", "strided", "masked")


def decades(rng: Rng, low: float, high: float, size=None):
    """Numbers whose logarithm is uniform."""
    return 10.0 ** rng.uniform(low, high, size)


def weights(rng: Rng, n: int) -> np.ndarray:
    """Weights (n,), one at least above 0."""
    kind = rng.integers(8)
    if kind == 0:
        return np.full(n, 1 / n)
    if kind == 1:
        w = decades(rng, -300, 0, n)
        return w / w.sum()
    if kind == 2:
        w = decades(rng, -20, 0, n)
        return w / w.sum()
    if kind == 3:
        return decades(rng, -300, 4) * rng.dirichlet(np.ones(n))
    if kind == 4:
        w = rng.dirichlet(np.ones(n)) * (rng.random(n) < 0.5)
        w[rng.integers(n)] = rng.random() + 0.1
        return w
    return rng.dirichlet(np.ones(n))


def covariances(rng: Rng, n: int, d: int, scale: float) -> np.ndarray:
    """Covariances (n, d, d) that NumPy can factor, condition numbers up to 1e14."""
    condition = rng.choice([0.0, 2.0, 6.0, 12.0, 14.0]) if d > 1 else 0.0
    alike = n > 1 and rng.random() < 0.2
    count = 1 if alike else n
    axes = np.linalg.qr(rng.standard_normal((count, d, d)))[0]
    sizes = scale * decades(rng, -1, 1, (count, 1)) * np.ones(d)
    while True:
        lengths = sizes * 10 ** (-condition * np.linspace(0, 1, d)[rng.permutation(d)])
        P = (axes * lengths[:, None, :]) @ axes.transpose(0, 2, 1)
        P = (P + P.transpose(0, 2, 1)) / 2
        try:
            np.linalg.cholesky(P)
        except np.linalg.LinAlgError:
            condition *= 0.9
            continue
        return np.repeat(P, n, axis=0) if alike else P


def means(rng: Rng, n: int, d: int, scale: float) -> np.ndarray:
    """Means (n, d): apart by some deviations, or coincident, or by far too many; about 0, or far from it."""
    kind = rng.integers(6)
    if kind == 0:
        m = np.repeat(rng.standard_normal((1, d)), n, axis=0)
    elif kind == 1:
        m = rng.standard_normal((1, d)) + 1e-9 * rng.standard_normal((n, d))
    elif kind == 2:
        return decades(rng, 0, 8) * rng.uniform(-1, 1, (n, d))
    else:
        m = 3 * rng.standard_normal((n, d))
        m[rng.random(n) < 0.3] = m[0]
    m = np.sqrt(scale) * m
    return m + decades(rng, 0, 8) * rng.uniform(-1, 1, d) if rng.random() < 0.3 else m


def hostile_mixture(rng: Rng, most: int = 12, d: int | None = None) -> Mixture:
    """A legal mixture; mild in one case of three."""
    n = int(rng.integers(1, most + 1))
    d = int(rng.choice([1, 2, 3, 4, 6])) if d is None else d
    mild = rng.random() < 1 / 3
    scale = 1.0 if mild else decades(rng, *((-18, 12) if rng.random() < 0.3 else (-4, 6)))
    if mild:
        A = rng.standard_normal((n, d, d))
        return Mixture(
            rng.dirichlet(np.ones(n)), 3 * rng.standard_normal((n, d)), A @ A.transpose(0, 2, 1) + np.eye(d)
        )
    return Mixture(weights(rng, n), means(rng, n, d, scale), covariances(rng, n, d, scale))


def in_layout(a: np.ndarray, layout: str) -> np.ndarray:
    """The numbers of an array otherwise laid out, as exactly as the kind of number can hold them."""
    if layout == "float32":
        return np.clip(a, -1e30, 1e30).astype(np.float32)
    if layout == "whole":
        return np.rint(np.clip(a, -(2.0**53), 2.0**53)).astype(np.int64)
    if layout == "fortran":
        return np.asfortranarray(a)
    if layout == "strided":
        wide = np.repeat(a, 2, axis=-1)
        return wide[..., ::2]
    if layout == "masked":
        return np.ma.array(a)
    a = a.copy()
    a.setflags(write=False)
    return a


def mixture_in_layout(rng: Rng, p: Mixture) -> tuple[Mixture, Mixture]:
    """A mixture otherwise laid out, and its plain copy. What rounding would spoil is left as it is."""
    layout = LAYOUTS[rng.integers(len(LAYOUTS))]
    if layout == "float32" or layout == "whole":
        d = p.m.shape[1]
        p = Mixture(
            rng.dirichlet(np.ones(len(p.w))),
            np.rint(np.clip(p.m, -1e6, 1e6)),
            np.eye(d) * rng.integers(1, 9, (len(p.w), 1, 1)),
        )
        given = p._replace(m=in_layout(p.m, layout), P=in_layout(p.P, layout))
        if layout == "float32":
            given = given._replace(w=in_layout(p.w, layout))
            p = p._replace(w=given.w.astype(float))
        return given, p
    return Mixture(*(in_layout(a, layout) for a in p)), p


def spoilt_array(rng: Rng, a: np.ndarray) -> tuple[np.ndarray, str]:
    """An array with something in it that is no finite real number, or of another shape."""
    kind = rng.integers(7)
    out = a.astype(float)
    at = tuple(rng.integers(side) for side in a.shape) if a.size else None
    if kind < 3 and at is not None:
        value = (np.nan, np.inf, -np.inf)[kind]
        out[at] = value
        return out, f"{value} in it"
    if kind == 3 and at is not None:
        return np.ma.array(
            out, mask=np.arange(a.size).reshape(a.shape) == rng.integers(a.size)
        ), "masked in part"
    if kind == 4:
        return out + 1j, "complex"
    if kind == 5 and at is not None:
        out = out.astype(object)
        out[at] = rng.choice(["x", None])
        return out, "objects"
    return out[..., None], "one axis more"


def spoilt_mixture(rng: Rng, p: Mixture) -> tuple[Mixture, tuple[str, ...], str]:
    """An illegal mixture, the words that may name what is wrong, and what is."""
    n, d = p.m.shape
    kind = rng.integers(6)
    i = int(rng.integers(n))
    w, m, P = (np.array(a, float) for a in p)
    if kind == 0:
        w[i] = -w[i] - 0.1 * (w[i] == 0)
        return Mixture(w, m, P), WORDS["w"], "a negative weight"
    if kind == 1:
        P[i] = -P[i] if rng.random() < 0.5 else 0.0
        return Mixture(w, m, P), WORDS["P"], "an indefinite covariance"
    if kind == 2 and d > 1:
        P[i, 0, 1] += np.sqrt(P[i, 0, 0] * P[i, 1, 1]) * 0.1 + 1e-6 * np.abs(P[i]).max()
        return Mixture(w, m, P), WORDS["P"], "an asymmetric covariance"
    if kind == 3:
        cut = rng.integers(3)
        every = sum(WORDS.values(), ())
        if cut == 0:
            return Mixture(np.append(w, 1.0), m, P), every, "a weight too many"
        if cut == 1:
            return Mixture(w, np.hstack([m, m[:, :1]]), P), every, "a coordinate too many"
        return Mixture(w, m, np.concatenate([P, P[:1]])), every, "a covariance too many"
    field = ("w", "m", "P")[rng.integers(3)]
    spoilt, what = spoilt_array(rng, getattr(p, field))
    return p._replace(**{field: spoilt}), WORDS[field], f"{field} with {what}"


def spoilt_points(rng: Rng, z: np.ndarray, names: tuple[str, ...]) -> Spoilt:
    """Points (k, p) that are none; the one argument."""
    if rng.random() < 0.2:
        return Spoilt((np.zeros((len(z) + 1, z.shape[1] + 1)),), names, "a coordinate too many")
    if rng.random() < 0.1:
        return Spoilt((np.zeros(z.shape[1] + 1),), names, "one axis")
    spoilt, what = spoilt_array(rng, z if z.size else np.zeros((1, z.shape[1])))
    while np.ma.isMaskedArray(spoilt):  # of points, what is masked is not there
        spoilt, what = spoilt_array(rng, z if z.size else np.zeros((1, z.shape[1])))
    return Spoilt((spoilt,), names, what)
