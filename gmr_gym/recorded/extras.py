"""What extras read: their modules, imported where a file needs them, and the columns they are made into."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np


class Decoded(NamedTuple):
    """Columns of a file that is no table."""

    where: str  # the file, as in `Columns`
    values: dict[str, Any]  # an array or a list of each
    line: np.ndarray  # (n,) int, line or record, from 1
    remarks: tuple[str, ...]  # what was left out
    usual: Mapping[str, str]  # columns of roles, unless something else is said


def module_of(extra: str, name: str, what: str) -> Any:
    """The module of this name.

    Raises
    ------
    ImportError
        With the command that installs the extra that it is of, which `what` needs.
    """
    try:
        return import_module(name)
    except ImportError:
        raise ImportError(f"{what} needs the extra `{extra}`: pip install 'gmr-gym[{extra}]'") from None
