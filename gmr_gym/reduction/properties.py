"""What every reduction keeps of a mixture, what maps of the states it follows, and how its work grows."""

from typing import NamedTuple

MOMENTS = ("weight", "mean", "covariance")
AFFINE = "affine"  # maps x -> A x + b: to reduce and to map is to map and to reduce
RIGID = "rigid"  # rotations, reflections and translations alone: the units of the states matter


class Properties(NamedTuple):
    """Of a reduction of N components to L in d dimensions.

    Attributes
    ----------
    keeps : tuple of str
        Those of `MOMENTS` that the reduced mixture has in common with the full one.
    follows : str
        `AFFINE` or `RIGID`.
    work : str
        Order of its operations, as a formula.
    matches : bool
        Whether each component left has the mean and covariance of those that the origin sends into it.
    bounded : bool
        Whether it merges as far as a bound allows, though no more than L components are there.
    most : int or None
        The largest N that it takes.
    """

    keeps: tuple[str, ...]
    follows: str
    work: str
    matches: bool = True
    bounded: bool = False
    most: int | None = None


_BY_PAIRS = Properties(MOMENTS, AFFINE, "N^2 d^3")
_FITTED = Properties(("weight",), AFFINE, "N^2 d^3", matches=False)
PROPERTIES = {
    "runnalls": _BY_PAIRS,
    "greedy-isd": _BY_PAIRS,
    "adaptive": _BY_PAIRS._replace(bounded=True),
    "ise": Properties(("weight",), AFFINE, "N^3 d^3"),
    "ise-unscaled": Properties((), AFFINE, "N^3 d^3"),
    "salmond": Properties(MOMENTS, AFFINE, "N^3 d"),
    "west": Properties(MOMENTS, AFFINE, "N^2 d"),
    "capping": Properties((), AFFINE, r"N \log N"),
    "k-means": Properties(MOMENTS, AFFINE, "N L d"),
    **{f"{form}-{measure}": _BY_PAIRS for form in ("k-medoids", "average", "complete", "single")
       for measure in ("isd", "correlation", "runnalls")},
    "transportation": _BY_PAIRS,
    "dphem": _BY_PAIRS._replace(matches=False),
    "brute-force": Properties(MOMENTS, AFFINE, "S(N, L) L + 3^N d^3", most=12),
    "transportation-optimum": Properties(MOMENTS, AFFINE, "3^N L", most=14),
    "refine": _FITTED._replace(work="N^2 d^3 + L^2 d^4"),
    "gmrc": _FITTED._replace(work="N^2 d^3 + L^2 d^4"),
    "refit": _FITTED._replace(work="N^2 d^3 + L^3"),
    "cowa": _FITTED._replace(work="N^3 d^3 + N^4"),
    "consistent-reverse-kl": _FITTED,
    "consistent-symmetrised-kl": _FITTED,
    "consistent-wasserstein": Properties(("weight", "mean"), RIGID, "N^2 d^3", matches=False),
    "consistent-cauchy-schwarz": _FITTED,
    "consistent-isd": _FITTED,
    "greedy-wasserstein": Properties(("weight", "mean"), RIGID, "N^2 d^3", matches=False),
    "greedy-chi-square": _BY_PAIRS,
    "prune-or-merge": Properties(("weight",), AFFINE, "N^2 d^3"),
    "adaptive-2023": _BY_PAIRS._replace(bounded=True),
    "cluster": _BY_PAIRS._replace(bounded=True),
}  # fmt: skip
