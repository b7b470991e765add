"""Figures of quality on the screen and in files."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.evaluation.writing import whole
from gmr_gym.recorded.figures import Figure
from gmr_gym.version import __version__

ENDINGS = (".json", ".md")
# beginnings of the names of what is printed
SHORT = (
    "tracks", "median length", "static tracks", "NIS / degrees", "NIS beyond", "correlation of",
    "mean innovation along", "detection probability", "unused detections a scan", "coasted share",
)  # fmt: skip
LEFT_OUT = "of its 95 % interval", "and km2", "tracks broken"


def in_short(figures: Sequence[Figure]) -> list[str]:
    """The figures that matter most, a line each.

    Parameters
    ----------
    figures : sequence of Figure
        Those of `gmr_gym.recorded.quality.quality`.
    """
    matter = (one for one in figures if one.name.startswith(SHORT))
    return in_lines([one for one in matter if not any(part in one.name for part in LEFT_OUT)])


def in_lines(figures: Sequence[Figure]) -> list[str]:
    """Figures, a line each, with what is expected and a mark where they lie elsewhere."""
    width = max((len(figure.name) for figure in figures), default=0)
    lines = []
    for figure in figures:
        line = f"{figure.name:{width}}  {_with_unit(figure):>12}"
        if expected := _expected(figure):
            line += f"  expected {expected}" + ("" if figure.sound else "  !")
        lines.append(line)
    return lines


def write_report(
    path: Path | str,
    groups: Mapping[str, Sequence[Figure]],
    over_time: Mapping[str, Sequence[float]] | None = None,
    *,
    command: str = "",
    remarks: Sequence[str] = (),
) -> None:
    """Write figures, as JSON or as Markdown by the ending of the file.

    Parameters
    ----------
    path : Path or str
        Ends in .json or .md.
    groups : mapping of str to sequence of Figure
        By title.
    over_time : mapping of str to sequence of float, optional
        Columns of figures by scan; of JSON alone.
    command : str
        What made the tracks.
    remarks : sequence of str

    Raises
    ------
    ValueError
        For another ending.
    OSError
        Naming the file.
    """
    path = Path(path)
    if path.suffix.lower() not in ENDINGS:
        raise ValueError(f"a report ends in {' or '.join(ENDINGS)}, got {path.name!r}")
    if path.suffix.lower() == ".json":
        text = _json(groups, over_time or {}, command, remarks)
    else:
        text = _markdown(groups, command, remarks)
    with whole(path) as partial:
        partial.write_text(text, encoding="utf-8")


def _json(
    groups: Mapping[str, Sequence[Figure]],
    over_time: Mapping[str, Sequence[float]],
    command: str,
    remarks: Sequence[str],
) -> str:
    figures = {title: [_plain(figure) for figure in group] for title, group in groups.items()}
    record = {"gmr_gym": __version__, "command": command, "remarks": list(remarks), "figures": figures}
    return json.dumps(record | ({"over_time": dict(over_time)} if over_time else {}), indent=1) + "\n"


def _plain(figure: Figure) -> dict[str, Any]:
    """A figure as JSON has it: null for NaN."""
    plain = {name: None if value != value else value for name, value in figure._asdict().items()}
    return plain | {"as_expected": figure.sound if _expected(figure) else None}


def _markdown(groups: Mapping[str, Sequence[Figure]], command: str, remarks: Sequence[str]) -> str:
    lines = [f"gmr-gym {__version__}" + (f": `{command}`" if command else ""), ""]
    for title, figures in groups.items():
        lines += [f"## {title}", "", "| | value | expected | of |", "|---|---|---|---|"]
        for figure in figures:
            mark = "" if figure.sound else " (!)"
            cells = figure.name, _with_unit(figure) + mark, _expected(figure), str(figure.of or "")
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    lines += [f"- {remark}" for remark in remarks]
    return "\n".join(lines).rstrip() + "\n"


def _expected(figure: Figure) -> str:
    low, high = figure.low, figure.high
    if np.isnan(low):
        return ""
    return _digits(low) if low == high else f"{_digits(low)} to {_digits(high)}"


def _with_unit(figure: Figure) -> str:
    return f"{_digits(figure.value)} {figure.unit}".rstrip()


def _digits(value: float) -> str:
    """Three digits, or all of a whole number."""
    if isinstance(value, int) or float(value).is_integer():
        return str(int(value))
    return "none" if np.isnan(value) else f"{value:.3g}"
