"""A mixture reduced by several methods: what each costs, and the reduced mixture, a picture or a page."""

import warnings
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gmr_gym.catalogue import reductions
from gmr_gym.evaluation.reductions import Cost, cost, reduced
from gmr_gym.evaluation.writing import whole
from gmr_gym.experiments import specs
from gmr_gym.experiments.mixtures import EXAMPLES, FORMATS, read_mixture, write_mixture
from gmr_gym.experiments.screen import progress
from gmr_gym.experiments.sheets import Sheet
from gmr_gym.mixture import Mixture
from gmr_gym.replay.reduction import MOST_METHODS, Method, method_named, reduction_page

PAGE, PICTURES = ".html", (".png", ".svg")
ENDINGS = (PAGE, *PICTURES, *FORMATS)
HEADINGS = ("", "components", "ISE", "NISE", "KL(f||g)", "KL(g||f)", "time, ms")


def mixture_asked(file: Path | None, example: str | None) -> tuple[str, Mixture]:
    """A mixture and its name: of a file, or of an example.

    Raises
    ------
    OSError
        Naming the file.
    ValueError
        For neither or both, another ending, and as `read_mixture`.
    """
    if file is not None and example is None:
        specs.check_ending("MIXTURE", file, *FORMATS)
        return file.stem, read_mixture(file)
    if example is None or file is not None:
        raise ValueError(f"give one mixture: a file, or --example, one of {', '.join(EXAMPLES)}")
    return example, EXAMPLES[example]()


def reduction(
    name: str, p: Mixture, methods: Sequence[str], components: int | None, axes: str, out: Path
) -> Iterator[Any]:
    """Reduces the mixture of that name, writes it, a picture or a page to `out`, and gives what a screen
    shows.

    Raises
    ------
    ValueError
        For components that are not there, several methods where one mixture is written, and as
        `gmr_gym.replay.reduction_page`.
    """
    left, ending = _left(name, p, components), out.suffix.lower()
    if ending in FORMATS and axes:
        raise ValueError(f"--axes is for a page or a picture, and {out.name} is a mixture")
    if ending in FORMATS and len(methods) != 1:
        raise ValueError(
            f"{out.name} takes the mixture of one --method, got {len(methods)}; a page takes more"
        )
    if len(methods) > MOST_METHODS:
        raise ValueError(f"--method is given {len(methods)} times, and {out.name} takes {MOST_METHODS}")
    drawn = _axes(axes, p.m.shape[1]) if axes else (0, 1)
    functions = {method: method_named(method) for method in methods}
    if ending == PAGE:
        with progress("reducing") as tell:
            text = reduction_page(p, functions, components or 1, axes=drawn, title=name, progress=tell)
        with whole(out) as file:
            file.write_text(text, encoding="utf-8")
    elif ending in PICTURES:
        from gmr_gym.experiments.drawings import save
        from gmr_gym.experiments.reduction_pictures import picture

        results = {
            method: reduced(p, partial(function, components=left)) for method, function in functions.items()
        }
        save(picture(p, results, drawn), out)
    else:
        write_mixture(out, *reduced(p, partial(functions[methods[0]], components=left)))
    yield _table(name, p, left, {method: _cost(p, function, left) for method, function in functions.items()})
    yield f"written to {out}"


def comparison(name: str, p: Mixture, components: int | None) -> Iterator[Any]:
    """The mixture of that name reduced by every method there is: a table, the least integral squared error
    first, and a line for each that cannot reduce it, or warns."""
    left, found = _left(name, p, components), {}
    remarks: list[str] = []
    methods = reductions()
    with progress("reducing") as tell:
        for i, method in enumerate(methods):
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always", UserWarning)
                try:
                    found[method] = _cost(p, method_named(method), left)
                except ValueError as error:
                    remarks.append(f"{method} cannot: {error}")
            remarks += dict.fromkeys(f"{method}: {each.message}" for each in said)  # once of many calls
            tell(i + 1, len(methods))
    yield _table(name, p, left, dict(sorted(found.items(), key=lambda item: item[1].ise)))
    yield from remarks


def _left(name: str, p: Mixture, components: int | None) -> int:
    """How many components are to remain; half of them unless that is said."""
    n = len(p.w)
    if components is not None and not 1 <= components <= n:
        raise ValueError(f"--components must be from 1 to the {n} of {name}, got {components}")
    return components or max(n // 2, 1)


def _cost(p: Mixture, method: Method, components: int) -> Cost:
    return cost(p, partial(method, components=components))


def _axes(text: str, d: int) -> tuple[int, int]:
    numbers = specs.numbers("--axes", text)
    if d == 1:
        raise ValueError("--axes is for coordinates of more than one dimension")
    if len(numbers) != 2 or len({*numbers} & {*range(1, d + 1)}) != 2:
        raise ValueError(f"--axes must be two different ones of 1 to {d}, got {text!r}")
    return int(numbers[0]) - 1, int(numbers[1]) - 1


def _table(name: str, p: Mixture, left: int, costs: dict[str, Cost]) -> Sheet:
    title = f"{name}: {len(p.w)} components to {left}"
    return Sheet(title, HEADINGS, [_row(method, found) for method, found in costs.items()])


def _row(method: str, found: Cost) -> list[str]:
    return [
        method, str(found.components), f"{found.ise:.4g}", f"{found.nise:.3g}",
        _estimated(found.divergence, found.standard_error),
        _estimated(found.reverse_divergence, found.reverse_standard_error),
        f"{1000 * found.seconds:.3g}",
    ]  # fmt: skip


def _estimated(value: float, standard_error: float) -> str:
    return f"{value:.4g} ± {standard_error:.2g}" if standard_error else f"{value:.4g}"
