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
REDUCTIONS = (
    "runnalls", "greedy-isd", "adaptive", "ise", "ise-unscaled", "salmond", "west", "capping", "k-means",
    "k-medoids-isd", "k-medoids-correlation", "k-medoids-runnalls",
    "average-isd", "average-correlation", "average-runnalls",
    "complete-isd", "complete-correlation", "complete-runnalls",
    "single-isd", "single-correlation", "single-runnalls",
    "transportation", "dphem", "brute-force", "transportation-optimum",
    "refine", "gmrc", "refit", "cowa",
)  # fmt: skip
BACKENDS = ("loky", "dask", "ray")  # what shares runs among processes


def reduction_entry_points() -> dict[str, EntryPoint]:
    """Entry points by name of the reductions that installed packages add to `REDUCTIONS`."""
    return {point.name: point for point in entry_points(group=REDUCTION_GROUP)}


def reductions() -> tuple[str, ...]:
    """Names of all reductions: `REDUCTIONS`, then what installed packages add, sorted."""
    return (*REDUCTIONS, *sorted(reduction_entry_points().keys() - {*REDUCTIONS}))


def tracker_entry_points(group: str) -> dict[str, EntryPoint]:
    """Entry points by name of all trackers that installed packages offer in the group."""
    known = {point.name: point for point in entry_points(group=group)}
    if group == MULTI_TARGET_GROUP:
        for point in entry_points(group=FORMER_GROUP):
            warn_renamed(f"entry-point group {FORMER_GROUP!r} of {point.value}", repr(group))
            known.setdefault(point.name, point)
    return known


def described(group: str) -> dict[str, str]:
    """Names of the installed trackers of a group, sorted, each with the first paragraph of the docstring that
    its module's source has for it: empty where that is not defined there by `def` or `class`."""
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
