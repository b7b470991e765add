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
    exactly : bool
        Whether it leaves L components where there are more, and not fewer.
    shares : bool
        Whether a component may give parts of its weight to several; the origin then names the largest part.
    """

    keeps: tuple[str, ...]
    follows: str
    work: str
    exactly: bool = True
    shares: bool = False


_BY_PAIRS = Properties(MOMENTS, AFFINE, "N^2 d^3")
_CLUSTERING = dict.fromkeys(("isd", "correlation", "runnalls"), _BY_PAIRS)
PROPERTIES = {
    "runnalls": _BY_PAIRS,
    "greedy-isd": _BY_PAIRS,
    "adaptive": _BY_PAIRS._replace(exactly=False),
    "ise": Properties(("weight",), AFFINE, "N^3 d^3"),
    "ise-unscaled": Properties((), AFFINE, "N^3 d^3"),
    "salmond": Properties(MOMENTS, AFFINE, "N^3 d"),
    "west": Properties(MOMENTS, AFFINE, "N^2 d"),
    "capping": Properties((), AFFINE, r"N \log N"),
    "k-means": Properties(MOMENTS, AFFINE, "N L d"),
    **{f"{form}-{measure}": row for form in ("k-medoids", "average", "complete", "single")
       for measure, row in _CLUSTERING.items()},
    "transportation": Properties(MOMENTS, AFFINE, "N^2 d^3", exactly=False),
    "dphem": Properties(MOMENTS, AFFINE, "N^2 d^3", exactly=False, shares=True),
    "brute-force": Properties(MOMENTS, AFFINE, "S(N, L) L^2 + 3^N d^3"),
    "transportation-optimum": Properties(MOMENTS, AFFINE, "3^N L"),
    "refine": Properties(("weight",), AFFINE, "N L d^3", exactly=False, shares=True),
    "gmrc": Properties(("weight",), AFFINE, "N^2 d^3", exactly=False, shares=True),
    "refit": Properties(("weight",), AFFINE, "N^2 d^3", exactly=False),
    "cowa": Properties(("weight",), RIGID, "N^2 d^3", exactly=False),
    "consistent-reverse-kl": Properties(("weight",), AFFINE, "N^2 d^3"),
    "consistent-symmetrised-kl": Properties(("weight",), AFFINE, "N^2 d^3"),
    "consistent-wasserstein": Properties(("weight", "mean"), RIGID, "N^2 d^3"),
    "consistent-cauchy-schwarz": Properties(("weight",), AFFINE, "N^2 d^3"),
    "consistent-isd": Properties(("weight",), AFFINE, "N^2 d^3"),
    "greedy-wasserstein": Properties(("weight", "mean"), RIGID, "N^2 d^3"),
    "greedy-chi-square": _BY_PAIRS,
    "prune-or-merge": Properties(("weight",), AFFINE, "N^2 d^3"),
    "adaptive-2023": _BY_PAIRS._replace(exactly=False),
}  # fmt: skip
