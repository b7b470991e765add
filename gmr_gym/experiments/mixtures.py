"""Mixtures in files, JSON, .npz or CSV, and some to try reductions on."""

import csv
import json
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.checks import check_covariance, doubles
from gmr_gym.evaluation import archive
from gmr_gym.evaluation.loop import play
from gmr_gym.evaluation.mixture_problems import crouse, random_mixture
from gmr_gym.evaluation.writing import whole
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import Mixture, mixture, normalised
from gmr_gym.reduction.pruning import prune_and_cap
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.single_target import draw

FORMATS = (".json", ".npz", ".csv")
ARRAYS = ("w", "m", "P")
SCANS, LEAST_WEIGHT, MOST = 20, 1e-3, 40  # of `posterior`


def read_mixture(file: Path) -> Mixture:
    """The mixture of a file.

    Parameters
    ----------
    file : Path
        `.json`: an object with "w", "m" and "P". `.npz`: arrays of these names. `.csv`: a component a row
        under the header of `header`. What else a file has beside them is not read.

    Returns
    -------
    Mixture

    Raises
    ------
    OSError
        Naming the file.
    ValueError
        Naming the file, the component, counted from 1, and what was expected.
    """
    file.open("rb").close()
    read = {".json": _from_json, ".npz": _from_npz, ".csv": _from_csv}[file.suffix.lower()]
    try:
        return _checked(read(file))
    except (ValueError, csv.Error) as error:
        raise ValueError(f"{file}: {error}") from None


def write_mixture(file: Path, reduced: Mixture, origin: np.ndarray) -> None:
    """Write a reduced mixture and what it came from, whole or not at all; `read_mixture` reads it.

    Parameters
    ----------
    file : Path
        Its ending, one of `FORMATS`, is the format.
    reduced : Mixture
    origin : ndarray of int (n,)
        Component that each of n others went into, -1 where it was dropped: "origin" of a JSON or .npz. A CSV
        names in the column `from` those that went into each component, counted from 1.

    Raises
    ------
    OSError
        Naming the file.
    """
    arrays = {**reduced._asdict(), "origin": origin}
    if file.suffix.lower() == ".npz":
        archive.save(file, arrays)
        return
    with whole(file) as partial, partial.open("w", encoding="utf-8", newline="") as stream:
        if file.suffix.lower() == ".csv":
            csv.writer(stream, lineterminator="\n").writerows(_rows(reduced, origin))
        else:
            json.dump({name: array.tolist() for name, array in arrays.items()}, stream)
            stream.write("\n")


def header(d: int) -> list[str]:
    """Columns of a CSV of a mixture in d dimensions: weight, mean, and the upper triangle of the covariance
    row by row.

    Examples
    --------
    >>> header(2)
    ['w', 'm1', 'm2', 'P11', 'P12', 'P22']
    """
    triangle = zip(*np.triu_indices(d), strict=True)
    return ["w", *(f"m{i + 1}" for i in range(d)), *(f"P{i + 1}{j + 1}" for i, j in triangle)]


def posterior(seed: int = 0) -> Mixture:
    """The heaviest hypotheses of a turning target in dense clutter before their reduction, at scan 20 of an
    episode: positions (m) and velocities (m/s).

    Parameters
    ----------
    seed : int
        Of the episode.
    """
    scenario = turning_target(clutter_rate=170, detection_probability=0.7)
    tracker = make_tracker("runnalls-30", scenario.model)
    *_, before, last = islice(play(scenario, tracker, draw(scenario, seed)), SCANS)
    _, _, trace = tracker.trace(before.report.mixture, last.scan.z)
    return normalised(prune_and_cap(trace.full, LEAST_WEIGHT, MOST)[0])


EXAMPLES: dict[str, Callable[[], Mixture]] = {
    "crouse": crouse,
    "posterior": posterior,
    "random": partial(random_mixture, 0),
}


def _from_json(file: Path) -> tuple[Sequence, ...]:
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, RecursionError) as error:
        raise ValueError(f"it is no JSON: {error}") from None
    return _arrays(found if isinstance(found, dict) else {})


def _from_npz(file: Path) -> tuple[Sequence, ...]:
    return _arrays(archive.load(file))


def _arrays(found: dict[str, Any]) -> tuple[Sequence, ...]:
    """Weights, means and covariances, equally many."""
    parts = [found.get(name, 0) for name in ARRAYS]
    for name, part in zip(ARRAYS, parts, strict=True):
        if not isinstance(part, list) and not np.ndim(part):
            raise ValueError(f"expected {name}, a list with one of every component; there are {[*found]}")
    lengths = [len(part) for part in parts]
    if len(set(lengths)) > 1:
        raise ValueError(f"expected w, m and P of equally many components, got {lengths}")
    return tuple(parts)


def _from_csv(file: Path) -> tuple[Sequence, ...]:
    with file.open(encoding="utf-8-sig", newline="") as stream:
        names, *rows = [row for row in csv.reader(stream) if row] or [[]]
    names = [name.strip() for name in names]
    d = max(sum(name.startswith("m") for name in names), 1)
    wanted = header(d)
    if names[: len(wanted)] != wanted or names[len(wanted) :] not in ([], ["from"]):
        raise ValueError(f"expected the header {','.join(wanted)}, got {','.join(names)!r:.80}")
    parts = [_of_row(f"component {i + 1}", row, names, d) for i, row in enumerate(rows)]
    return tuple(zip(*parts, strict=True)) or ((), (), ())


def _of_row(at: str, row: Sequence[str], names: Sequence[str], d: int) -> tuple[float, list, np.ndarray]:
    if len(row) != len(names):
        raise ValueError(f"{at}: expected {len(names)} columns, got {len(row)}")
    numbers = []
    for name, text in zip(names, row, strict=True):
        if name != "from":
            try:
                numbers.append(float(text))
            except ValueError:
                raise ValueError(f"{at}: {name} must be a number, got {text!r}") from None
    P = np.zeros((d, d))
    P[np.triu_indices(d)] = numbers[1 + d :]
    return numbers[0], numbers[1 : 1 + d], P + np.triu(P, 1).T


def _rows(reduced: Mixture, origin: np.ndarray) -> Iterable[Sequence[Any]]:
    d = reduced.m.shape[1]
    yield [*header(d), "from"]
    for i, (w, m, P) in enumerate(zip(*reduced, strict=True)):
        inputs = " ".join(str(row + 1) for row in np.flatnonzero(origin == i))
        yield [*map(float, (w, *m, *P[np.triu_indices(d)])), inputs]


def _checked(parts: tuple[Sequence, ...]) -> Mixture:
    """The mixture of weights, means and covariances; ValueError naming the component that is none."""
    if not len(parts[0]):
        raise ValueError("expected one component or more, got none")
    means = []
    for i, (w, m, P) in enumerate(zip(*parts, strict=True)):
        at = f"component {i + 1}: "
        w, m, P = (doubles(name, a, at) for name, a in zip(ARRAYS, (w, m, P), strict=True))
        if w.ndim or not 0 < w < np.inf:
            raise ValueError(f"{at}w must be a positive, finite number, got {w.tolist()}")
        if m.ndim != 1 or not len(m) or not np.isfinite(m).all():
            raise ValueError(f"{at}m must be a list of finite numbers, got {m.tolist()}")
        check_covariance(f"{at}P", P)
        if P.shape != (len(m), len(m)):
            raise ValueError(f"{at}P must have shape {(len(m), len(m))} to fit m, got {P.shape}")
        means.append(len(m))
    for i, (d, other) in enumerate(pairwise(means)):
        if d != other:
            raise ValueError(f"component {i + 2}: expected {d} dimensions as before, got {other}")
    return mixture(*parts)
