"""Conditions on rows of a file, such as `snr>10`."""

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gmr_gym.recorded.times import is_number
from gmr_gym.recorded.units import did_you_mean

COMPARED = {
    ">=": operator.ge, "<=": operator.le, "!=": operator.ne, "==": operator.eq, "=": operator.eq,
    ">": operator.gt, "<": operator.lt,
}  # fmt: skip


def kept_rows(
    conditions: Sequence[str], names: Sequence[str], cells: Mapping[str, Sequence], n: int, decimal: str = "."
) -> np.ndarray:
    """Mask (n,) of the rows that fulfil all conditions, such as `snr>10` or `type=plot`; `decimal` stands
    before the decimals of numbers."""
    mask = np.ones(n, bool)
    for text in conditions:
        name, compare, value = condition(text, names)
        column = list(map(str, cells[name]))
        number = value.replace(decimal, ".")
        if is_number(number):
            written = [cell.replace(decimal, ".") for cell in column]
            held = [float(cell) if is_number(cell) else np.nan for cell in written]
            mask &= np.array([compare(cell, float(number)) for cell in held], bool)
        else:
            mask &= np.array([compare(cell, value) for cell in column], bool)
    return mask


def condition(text: str, names: Sequence[str]) -> tuple[str, Callable[[Any, Any], bool], str]:
    """Column, comparison and value of a condition."""
    found = re.fullmatch(r"\s*(.+?)\s*(>=|<=|!=|==|=|>|<)\s*(.*?)\s*", text)
    if not found:
        raise ValueError(f"--where must be COLUMN, a comparison and a value, such as 'snr>10', got {text!r}")
    if found[1] not in names:
        raise ValueError(
            f"--where {text!r}: no column {found[1]!r}{did_you_mean(found[1], names)}; "
            f"there are {', '.join(names)}"
        )
    return found[1], COMPARED[found[2]], found[3]
