"""A mixture reduced by several methods side by side, as a page and in a notebook."""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.evaluation.reductions import Step, steps
from gmr_gym.literals import name_and_parameters
from gmr_gym.mixture import Mixture, checked
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.registry import reducer
from gmr_gym.replay.notebook import NotebookPage
from gmr_gym.replay.page import PLAYER, document
from gmr_gym.version import __version__

HERE = Path(__file__).with_suffix("")  # .js and .css
SHARED = (
    "charts",
    "elements",
    "frame",
    "ground",
    "ink",
    "input",
    "plane",
    "strip",
    "words",
)  # parts of the player
MOST_METHODS, MOST_COMPONENTS = 4, 200  # that are shown
DIGITS = 9  # of the numbers of a page
Method = Callable[..., Reduced]  # of a mixture and components


def method_named(spec: str) -> Method:
    """The reduction NAME or NAME:key=value,key=value, a function of a mixture and the number of components.

    Parameters
    ----------
    spec : str
        A name that `gmr_gym.reduction.reducer` takes, then parameters.

    Raises
    ------
    ValueError
        For an unknown name, with the nearest known one, and for a parameter that it does not take.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.2, 0.7, 0.1], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> method_named("adaptive:loss_bound=0.5")(p, 3)[1].tolist()
    [0, 0, 1]
    """
    if "components" in name_and_parameters(spec)[1]:
        raise ValueError(f"reduction {spec!r} names components, which are given for all reductions together")
    reducer(spec, 1)

    def method(p: Mixture, components: int) -> Reduced:
        try:
            return reducer(spec, components)(p)
        except TypeError as error:  # for example a string for a number
            raise ValueError(f"reduction {spec!r} cannot be made: {error}") from None

    return method


def reduction_page(
    mixture: Mixture,
    methods: Iterable[str] | Mapping[str, Method],
    components: int = 1,
    *,
    axes: tuple[int, int] = (0, 1),
    title: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> str:
    """The page of a mixture that several methods reduce, one component after another.

    Parameters
    ----------
    mixture : Mixture
        From 2 to `MOST_COMPONENTS` components.
    methods : iterable of str, or mapping of str to callable
        From 1 to `MOST_METHODS`: each NAME or NAME:key=value of a reduction, or functions of a mixture and
        the number of components that may remain, by name.
    components : int
        The last number of components.
    axes : tuple of int
        The two coordinates that are drawn, where there are more than two.
    title : str
        Of the page.
    progress : callable, optional
        Called with the numbers of reductions done and of all.

    Returns
    -------
    str
        HTML that loads nothing.

    Raises
    ------
    ValueError
        For another number of components or of methods, a method that is unknown or given twice, coordinates
        that are not there, and as the methods.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.2, 0.7, 0.1], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> "<title>three: runnalls, west</title>" in reduction_page(p, ["runnalls", "west"], title="three")
    True
    """
    p, by_name = checked(mixture), _methods(methods)
    n, d = p.m.shape
    if not 2 <= n <= MOST_COMPONENTS:
        raise ValueError(f"the mixture must have from 2 to {MOST_COMPONENTS} components, got {n}")
    least = check_count(components)
    if least > n:
        raise ValueError(f"components must be at most the {n} of the mixture, got {components}")
    drawn = [0] if d == 1 else _axes(axes, d)
    by_name = _counted(by_name, len(by_name) * (n - least), progress)
    shown = [{"name": name} | _columns(steps(p, by_name[name], least), drawn) for name in by_name]
    title = title or f"{n} components"
    data = {"title": title, "axes": drawn, "versions": {"gmr_gym": __version__}, "methods": shown}
    styles = [PLAYER / "player.css", HERE / "reduction.css"]
    parts = [*(PLAYER / f"{name}.js" for name in SHARED), *sorted(HERE.glob("*.js"))]
    return document(f"{title}: {', '.join(by_name)}", data, "GmrReduction", styles, parts)


def show_reduction(
    mixture: Mixture, *methods: str, components: int = 1, axes: tuple[int, int] = (0, 1), title: str = ""
) -> NotebookPage:
    """Show in a notebook how methods reduce a mixture.

    Parameters
    ----------
    mixture, components, axes, title
        As for `reduction_page`.
    *methods : str
        Each NAME or NAME:key=value of a reduction.

    Returns
    -------
    NotebookPage
        A notebook shows it; `save` writes the same page to a file.

    Raises
    ------
    ValueError
        As `reduction_page`.
    """
    return NotebookPage(reduction_page(mixture, methods, components, axes=axes, title=title))


def _methods(given: Iterable[str] | Mapping[str, Method]) -> dict[str, Method]:
    if isinstance(given, str):
        given = [given]
    by_name: dict[str, Method] = {}
    for name in given:
        if name in by_name:
            raise ValueError(f"method {name!r} is given twice")
        by_name[name] = given[name] if isinstance(given, Mapping) else method_named(name)
    if not 1 <= len(by_name) <= MOST_METHODS:
        raise ValueError(f"methods must be from 1 to {MOST_METHODS}, got {len(by_name)}")
    return by_name


def _counted(
    methods: Mapping[str, Method], total: int, progress: Callable[[int, int], None] | None
) -> dict[str, Method]:
    """The methods, whose calls are counted."""
    done = count(1)

    def counted(p: Mixture, components: int, method: Method) -> Reduced:
        reduced = method(p, components=components)
        if progress:
            progress(next(done), total)
        return reduced

    return {name: partial(counted, method=method) for name, method in methods.items()}


def _axes(axes: tuple[int, int], d: int) -> list[int]:
    try:
        i, j = axes
        good = i != j and {i, j} <= {*range(d)}
    except (TypeError, ValueError):
        good = False
    if not good:
        raise ValueError(f"axes must be two different ones of 0 to {d - 1}, got {axes!r}")
    return [int(i), int(j)]


def _columns(found: list[Step], drawn: list[int]) -> dict[str, Any]:
    """The components of all steps, each of them once, and the rows that each step has of them."""
    parts: dict[bytes, tuple[int, tuple]] = {}

    def row(part: tuple) -> int:
        key = b"".join(np.asarray(array).tobytes() for array in part)
        return parts.setdefault(key, (len(parts), part))[0]

    shown = [
        {
            "kept": [row(part) for part in zip(*step.mixture, strict=True)],
            "origin": step.origin.tolist(),
            "ise": _short(step.ise),
            "into": None if step.into is None else step.into.tolist(),
            "cost": None if np.isnan(step.merge_cost) else _short(step.merge_cost),
        }
        for step in found
    ]
    w, m, P = zip(*(part for _, part in parts.values()), strict=True)
    seen = np.array(P)[:, drawn][:, :, drawn][:, *np.triu_indices(len(drawn))]
    columns = {"w": [*map(_short, w)], "m": [[*map(_short, each)] for each in m]}
    return {"components": columns | {"P": [[*map(_short, each)] for each in seen]}, "steps": shown}


def _short(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
