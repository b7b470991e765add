"""A mixture reduced by several methods: what each costs, and the reduced mixture or a page in a file."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gmr_gym.evaluation.reductions import Cost, cost, reduced
from gmr_gym.evaluation.writing import whole
from gmr_gym.experiments import specs
from gmr_gym.experiments.mixtures import EXAMPLES, FORMATS, read_mixture, write_mixture
from gmr_gym.experiments.screen import progress
from gmr_gym.experiments.sheets import Sheet
from gmr_gym.mixture import Mixture
from gmr_gym.replay.reduction import method_named, reduction_page

PAGE = ".html"
ENDINGS = (PAGE, *FORMATS)
HEADINGS = ("", "components", "ISE", "NISE", "KL(f||g)", "KL's standard error", "time, ms")
STANDARD_ERROR = 5  # the column, of samples alone


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
    """Reduces the mixture of that name, writes it or a page to `out`, and gives what a screen shows.

    Raises
    ------
    ValueError
        For components that are not there, several methods where one mixture is written, and as
        `gmr_gym.replay.reduction_page`.
    """
    n, page = len(p.w), out.suffix.lower() == PAGE
    if components is not None and not 1 <= components <= n:
        raise ValueError(f"--components must be from 1 to the {n} of {name}, got {components}")
    if not page and axes:
        raise ValueError(f"--axes is for a page, and {out.name} is a mixture")
    if not page and len(methods) != 1:
        raise ValueError(
            f"{out.name} takes the mixture of one --method, got {len(methods)}; a page takes more"
        )
    left = components or max(n // 2, 1)
    functions = {method: partial(method_named(method), components=left) for method in methods}
    if page:
        drawn = _axes(axes, p.m.shape[1]) if axes else (0, 1)
        with progress("reducing") as tell:
            text = reduction_page(p, methods, components or 1, axes=drawn, title=name, progress=tell)
        with whole(out) as file:
            file.write_text(text, encoding="utf-8")
    else:
        write_mixture(out, *reduced(p, functions[methods[0]]))
    rows = [_row(method, cost(p, function)) for method, function in functions.items()]
    table = [HEADINGS, *rows]
    if not any(row[STANDARD_ERROR] for row in rows):
        table = [[*row[:STANDARD_ERROR], *row[STANDARD_ERROR + 1 :]] for row in table]
    yield Sheet(f"{name}: {n} components to {left}", table[0], table[1:])
    yield f"written to {out}"


def _axes(text: str, d: int) -> tuple[int, int]:
    numbers = specs.numbers("--axes", text)
    if d == 1:
        raise ValueError("--axes is for coordinates of more than one dimension")
    if len(numbers) != 2 or len({*numbers} & {*range(1, d + 1)}) != 2:
        raise ValueError(f"--axes must be two different ones of 1 to {d}, got {text!r}")
    return int(numbers[0]) - 1, int(numbers[1]) - 1


def _row(method: str, found: Cost) -> list[str]:
    error = f"{found.standard_error:.2g}" if found.standard_error else ""
    return [
        method, str(found.components), f"{found.ise:.4g}", f"{found.nise:.3g}", f"{found.divergence:.4g}",
        error, f"{1000 * found.seconds:.3g}",
    ]  # fmt: skip
