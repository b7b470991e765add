"""Values as a user types them: key=value, and parameters after a name."""

import ast
import re
from collections.abc import Iterable
from typing import Any


def key_value(text: str) -> tuple[str, Any]:
    """key=value with the value read as a Python literal where it is one."""
    key, sign, value = text.partition("=")
    if not sign or not key:
        raise ValueError(f"expected key=value, got {text!r}")
    for read in (ast.literal_eval, float):  # float reads nan and inf, which are then refused by name
        try:
            return key, read(value)
        except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):  # two of deep nesting
            pass
    if value.startswith(("[", "(", "{")):
        raise ValueError(f"{key} cannot be read as a list: {value}")
    return key, value


def key_values(texts: Iterable[str]) -> dict[str, Any]:
    """Values by key, of key=value each; ValueError for a key that is there twice."""
    found: dict[str, Any] = {}
    for key, value in map(key_value, texts):
        if key in found:
            raise ValueError(f"{key} is given twice, as {found[key]!r} and as {value!r}")
        found[key] = value
    return found


def name_and_parameters(spec: str) -> tuple[str, dict[str, Any]]:
    """Name and parameters from NAME:key=value:key=value, or with commas, which a tracker's parameter cannot
    have. NAME may be MODULE:FUNCTION. ValueError for what is no key=value, and for a key that is there twice.

    Examples
    --------
    >>> name_and_parameters("adaptive:loss_bound=0.1")
    ('adaptive', {'loss_bound': 0.1})
    >>> name_and_parameters("mine:function:distance=2,measure=isd")
    ('mine:function', {'distance': 2, 'measure': 'isd'})
    """
    name, *parts = re.split("[:,]", spec)
    if parts and parts[0] and "=" not in parts[0]:
        name = f"{name}:{parts.pop(0)}"
    return name, key_values(filter(None, parts))
