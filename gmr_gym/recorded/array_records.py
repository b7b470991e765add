"""Records of arrays, and of such records: rows of them, and their form in a file."""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np


def chosen(tree: Any, rows: Any) -> Any:
    """The tracks of these rows: a record of arrays, and of such records."""
    if isinstance(tree, np.ndarray):
        return tree[rows]
    return type(tree)(*(chosen(branch, rows) for branch in tree))


def joined(first: Any, second: Any) -> Any:
    """The tracks of two records, one after the other."""
    if isinstance(first, np.ndarray):
        return np.concatenate([first, second])
    return type(first)(*map(joined, first, second))


def leaves(tree: Any) -> Iterator[np.ndarray]:
    """The arrays of a state, one after the other; the identities as text."""
    if isinstance(tree, tuple):
        for branch in tree:
            yield from leaves(branch)
    else:
        yield np.asarray(json.dumps(tree) if isinstance(tree, dict) else tree)


def rebuilt(template: Any, found: Iterator[np.ndarray]) -> Any:
    """The state whose `leaves` are `found`, of the form of the template."""
    if isinstance(template, tuple):
        branches = [rebuilt(branch, found) for branch in template]
        return type(template)(*branches) if hasattr(template, "_fields") else tuple(branches)
    leaf = next(found)
    if isinstance(template, np.ndarray):
        return leaf
    return json.loads(str(leaf)) if isinstance(template, dict) else type(template)(leaf)
