"""Reductions by name, as the parameter `reduction` of a tracker takes them.

An installed package adds one by an entry point in the group `gmr_gym.reductions`: a function of (mixture,
components).
"""

from collections.abc import Callable
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from inspect import signature
from typing import Any

from gmr_gym.catalogue import reduction_entry_points, reductions
from gmr_gym.checks import check_choice, check_count, check_not_negative
from gmr_gym.literals import name_and_parameters
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.adaptive_merging import adaptive_2023
from gmr_gym.reduction.agglomeration import greedy_isd
from gmr_gym.reduction.clustering import LINKAGES, hierarchical, k_means, k_medoids
from gmr_gym.reduction.consistent_merging import consistent, greedy_chi_square, greedy_wasserstein
from gmr_gym.reduction.dissimilarity import MEASURES
from gmr_gym.reduction.heaviest_first import cluster, clustering
from gmr_gym.reduction.ise import integral_squared_error
from gmr_gym.reduction.measures import MEASURES as BARYCENTRES
from gmr_gym.reduction.measures import TELESCOPING
from gmr_gym.reduction.n_scan import NScan
from gmr_gym.reduction.oracles import brute_force, transportation_optimum
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.prune_or_merge import prune_or_merge
from gmr_gym.reduction.pruning import capping
from gmr_gym.reduction.refinement import gmrc, refine
from gmr_gym.reduction.runnalls import Greedy, adaptive, greedy, runnalls
from gmr_gym.reduction.salmond_west import salmond, west
from gmr_gym.reduction.transportation import dphem, transportation
from gmr_gym.reduction.vo_ma import vo_ma
from gmr_gym.reduction.weight_fit import cowa, refit

REDUCERS: dict[str, Callable] = {
    "runnalls": runnalls,
    "greedy-isd": greedy_isd,
    "adaptive": partial(adaptive, loss_bound=0.05),
    "ise": integral_squared_error,
    "ise-unscaled": partial(integral_squared_error, renormalise=False),
    "salmond": salmond,
    "west": west,
    "capping": capping,
    "k-means": k_means,
    **{f"k-medoids-{measure}": partial(k_medoids, measure=measure) for measure in MEASURES},
    **{
        f"{linkage}-{measure}": partial(hierarchical, linkage=linkage, measure=measure)
        for linkage in LINKAGES
        for measure in MEASURES
    },
    "transportation": transportation,
    "dphem": dphem,
    "brute-force": brute_force,
    "transportation-optimum": transportation_optimum,
    "refine": refine,
    "gmrc": gmrc,
    "refit": refit,
    "cowa": cowa,
    **{f"consistent-{measure}": partial(consistent, measure=measure) for measure in BARYCENTRES[1:]},
    "greedy-wasserstein": greedy_wasserstein,
    "greedy-chi-square": greedy_chi_square,
    "prune-or-merge": prune_or_merge,
    "adaptive-2023": adaptive_2023,
    "cluster": cluster,
}


def reducer(name: str, components: int, **parameters: Any) -> partial:
    """The reduction of that name to `components`, a function of a mixture.

    Parameters
    ----------
    name : str
        A key of `REDUCERS`, the name that an installed package gives one, or "module:function". Each of these
        is a function of (mixture, components). Parameters may follow, as in "adaptive:loss_bound=0.1".
    components : int
        Upper limit of the number of components that remain.
    **parameters
        Further parameters of the reduction.

    Raises
    ------
    ValueError
        For a name that is unknown, suggesting the nearest one, or no text, for a function that cannot be
        imported, and for a parameter that it does not take, or that is given twice.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.2, 0.7, 0.1], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = reducer("runnalls", 2)(p)
    >>> len(q.w)
    2
    """
    if not isinstance(name, str):
        raise ValueError(f"the reduction must be named by a text, got {name!r}")
    name, given = name_and_parameters(name)
    reduction = REDUCERS[name] if name in REDUCERS else _imported(name)
    for parameter in (*given, *parameters):
        _, *accepted = (key for key in signature(reduction).parameters if key != "components")
        if parameter in given and parameter in parameters:
            raise ValueError(f"{parameter} is given twice, once in the name of the reduction {name!r}")
        if parameter not in accepted:
            takes = ", ".join(accepted) or "none"
            raise ValueError(f"reduction {name!r} takes no parameter {parameter!r}; it takes {takes}")
    return partial(reduction, components=components, **given, **parameters)


def compilable(reduce: Callable[..., Reduced]) -> Callable[..., Reduced]:
    """The Greedy of `runnalls` or `adaptive`, or the Clustering of `cluster`, with its parameters; another
    reduction as it is."""
    if not isinstance(reduce, partial):
        return reduce
    keywords = dict(reduce.keywords)
    if reduce.func is runnalls:
        return Greedy(check_count(keywords["components"]))
    if reduce.func is cluster:
        return clustering(**keywords)
    if reduce.func is adaptive:
        measure = keywords.pop("measure", "kl")
        check_choice("measure", measure, TELESCOPING)
        merging = greedy(**keywords)
        return merging if measure == "kl" else reduce
    return reduce


def hypothesis_reducer(name: str, components: int) -> Callable[..., Reduced]:
    """The reduction of that name for hypotheses with detections: NScan, or what `reducer` finds.

    Parameters
    ----------
    name : str
        "n-scan", or a name that `reducer` takes, with parameters or not.
    components : int
        Upper limit of the number of hypotheses that remain.

    Raises
    ------
    ValueError
        As `reducer`.
    """
    base, given = name_and_parameters(name) if isinstance(name, str) else (name, {})
    if base != "n-scan":
        return reducer(name, components)
    for parameter in given:
        if parameter != "scans":
            raise ValueError(f"reduction 'n-scan' takes no parameter {parameter!r}; it takes scans")
    return NScan(check_count(components), **given)


def _imported(name: str) -> Callable:
    """The reduction that an installed package gives the name, or "module:function"."""
    point = reduction_entry_points().get(name)
    if name == "n-scan":
        raise ValueError("reduction 'n-scan' compares the detections of hypotheses, which only MHTs know")
    module, colon, function = (point.value if point else name).partition(":")
    if not colon:
        known = reductions()
        near = get_close_matches(module, known, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise ValueError(
            f"unknown reduction {name!r}{hint} (there are {', '.join(known)}; "
            "one of your own is MODULE:FUNCTION)"
        )
    if module in REDUCERS:
        raise ValueError(f"expected key=value after the reduction {module!r}, got {function!r}")
    try:
        return partial(getattr(import_module(module), function))
    except (ImportError, AttributeError, ValueError, TypeError) as error:
        raise ValueError(f"reduction {name!r} is no function that can be imported: {error}") from None


def reduction_named(name: str, components: int, merging: float) -> Callable[[Mixture], Reduced]:
    """The reduction of that name to `components`, a function of a mixture.

    Parameters
    ----------
    name : str
        "vo-ma", or a name, with parameters or not, that `reducer` takes.
    components : int
        Upper limit of the number of components that remain.
    merging : float
        Merge distance of "vo-ma"; the other reductions, with parameters of their own, ignore it.

    Raises
    ------
    ValueError
        For an unknown name and a negative `merging`.
    """
    merging = check_not_negative("merging", merging)
    if name == "vo-ma":
        return partial(vo_ma, components=components, distance=merging)
    return reducer(name, components)
