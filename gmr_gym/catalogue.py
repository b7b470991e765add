"""What there is by name, read without importing what the names stand for."""

import ast
import sys
from importlib.metadata import EntryPoint, entry_points
from itertools import accumulate
from typing import Any

from gmr_gym.deprecated import warn_renamed

GROUP, MULTI_TARGET_GROUP = "gmr_gym.trackers", "gmr_gym.multi_target_trackers"
FORMER_GROUP = "gmr_gym.crowd_trackers"  # of MULTI_TARGET_GROUP
REDUCTION_GROUP = "gmr_gym.reductions"
REDUCTIONS = {  # each with what it does
    "runnalls": "merges the pair of least cost B, a bound on the Kullback-Leibler divergence",
    "greedy-isd": "merges by moments the pair that changes the mixture least by integral squared difference",
    "adaptive": "runnalls while the relative loss is within loss_bound, and down to the components asked for",
    "ise": "Williams: merges a pair or deletes a component, for the least integral squared error",
    "ise-unscaled": "ise without rescaling the others after a deletion",
    "salmond": "joins the pair nearest relative to the covariance of the whole mixture",
    "west": "merges the lightest component with its nearest neighbour",
    "capping": "keeps the heaviest components and drops the others",
    "k-means": "clusters the means by Lloyd's weighted k-means, and merges each cluster",
    "k-medoids-isd": "clusters around medoids by integral squared difference",
    "k-medoids-correlation": "clusters around medoids by correlation of the densities",
    "k-medoids-runnalls": "clusters around medoids by cost B",
    "average-isd": "merges the clusters of least mean integral squared difference of their members",
    "average-correlation": "merges the clusters of least mean uncorrelatedness of their members",
    "average-runnalls": "merges the clusters of least mean cost B of their members",
    "complete-isd": "merges the clusters whose farthest members are nearest, by integral squared difference",
    "complete-correlation": "merges the clusters whose farthest members are nearest, by correlation",
    "complete-runnalls": "merges the clusters whose farthest members are nearest, by cost B",
    "single-isd": "merges the clusters whose nearest members are nearest, by integral squared difference",
    "single-correlation": "merges the clusters whose nearest members are nearest, by correlation",
    "single-runnalls": "merges the clusters whose nearest members are nearest, by cost B",
    "transportation": "k-means of components by several costs: descends their transportation divergence",
    "dphem": "expectation maximisation on virtual samples of the components, which several may share",
    "brute-force": "the partition of least integral squared error; for 12 components or fewer",
    "transportation-optimum": "the partition of least transportation divergence; for 14 components or fewer",
    "refine": "descends the integral squared error from what another reduction leaves",
    "gmrc": "runnalls, clustering by Kullback-Leibler divergence, and descent of the integral squared error",
    "refit": "another reduction, and then the weights of least integral squared error",
    "cowa": "merges the lightest with its nearest, and fits the weights for the least integral squared error",
    "consistent-reverse-kl": "merges pairs by reverse Kullback-Leibler divergence; not for distant ones",
    "consistent-symmetrised-kl": "merges pairs by the mean of both Kullback-Leibler divergences",
    "consistent-wasserstein": "merges pairs by Wasserstein distance and weights; not for distant ones",
    "consistent-cauchy-schwarz": "merges pairs by the Cauchy-Schwarz divergence, into its barycentre",
    "consistent-isd": "merges pairs by integral squared difference, into its barycentre",
    "greedy-wasserstein": "merges the pair of least Wasserstein distance, whatever the weights",
    "greedy-chi-square": "merges by moments the pair of least chi-square divergence from its merge",
    "prune-or-merge": "merges or prunes, whichever raises the divergence of the result from the whole least",
    "adaptive-2023": "runnalls until the next merge costs much more than those to follow",
    "cluster": "Salmond: the heaviest takes in all within a distance of it, then the heaviest of the rest",
}
HYPOTHESIS_REDUCTIONS = {  # of trackers of one target that keep several hypotheses, and of nothing else
    "n-scan": "merges the hypotheses that share the detections of the last scans, two unless scans is given",
}
BACKENDS = ("loky", "dask", "ray")  # what shares runs among processes


def reduction_entry_points() -> dict[str, EntryPoint]:
    """Entry points by name of the reductions that installed packages add to `REDUCTIONS`."""
    return {point.name: point for point in entry_points(group=REDUCTION_GROUP)}


def reductions() -> tuple[str, ...]:
    """Names of all reductions: `REDUCTIONS`, then what installed packages add, sorted."""
    return tuple(described_reductions())


def described_reductions() -> dict[str, str]:
    """What each of `reductions` does, of what installed packages add as `described` has it."""
    return REDUCTIONS | described(REDUCTION_GROUP) | REDUCTIONS  # first, and the project's own


def tracker_entry_points(group: str) -> dict[str, EntryPoint]:
    """Entry points by name of all that installed packages offer in the group."""
    known = {point.name: point for point in entry_points(group=group)}
    if group == MULTI_TARGET_GROUP:
        for point in entry_points(group=FORMER_GROUP):
            warn_renamed(f"entry-point group {FORMER_GROUP!r} of {point.value}", repr(group))
            known.setdefault(point.name, point)
    return known


def described(group: str) -> dict[str, str]:
    """Names of what is installed in a group, sorted, each with the first paragraph of the docstring that its
    module's source has for it: empty where that is not defined there by `def` or `class`."""
    docstrings: dict[str, dict[str, str]] = {}
    found = {}
    for name, point in sorted(tracker_entry_points(group).items()):
        if point.module not in docstrings:
            docstrings[point.module] = _docstrings(_source(point.module))
        doc = docstrings[point.module].get(point.attr, "")
        found[name] = " ".join(doc.split("\n\n")[0].split())
    return found


def _source(module: str) -> str:
    """Text of a module, empty where there is none to be found; not even its package is imported."""
    path: Any = None
    loader: Any = None
    for name in accumulate(module.split("."), "{}.{}".format):
        finders = (finder.find_spec(name, path) for finder in sys.meta_path)
        spec = next(filter(None, finders), None)
        if spec is None:
            return ""
        path, loader = spec.submodule_search_locations, spec.loader
    return (loader.get_source(module) if hasattr(loader, "get_source") else None) or ""


def _docstrings(source: str) -> dict[str, str]:
    """Docstrings of the functions and classes at the top of a module, by their names."""
    try:
        body = ast.parse(source).body
    except SyntaxError:  # whoever makes the tracker is told
        return {}
    defined = [node for node in body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    return {node.name: ast.get_docstring(node) or "" for node in defined}
