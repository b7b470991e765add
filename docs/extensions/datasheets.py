"""Docstrings of environments are data sheets as Gymnasium writes them, with Markdown's headings and tables;
here these become reStructuredText, as the other docstrings are."""

import re

HEADING = re.compile(r"^## (.+)$", re.M)
TABLE = re.compile(r"^(\|.+\|)\n\|[-|]+\|\n((?:\|.+\|\n)+)", re.M)


def listed(match) -> str:
    """A table of Markdown as a list-table."""
    rows = [row.strip("| ").split(" | ") for row in (match[1] + "\n" + match[2]).splitlines()]
    lines = [f"   {' ' if i else '*'} - {cell}" for row in rows for i, cell in enumerate(row)]
    return "\n".join([".. list-table::", "   :header-rows: 1", "", *lines, ""])


def read(app, what, name, member, options, lines):
    """Rewrites the lines of a docstring."""
    text = TABLE.sub(listed, "\n".join(lines))
    lines[:] = [*HEADING.sub(r".. rubric:: \1\n", text).splitlines(), ""]  # a blank one ends it


def setup(app):
    """Has every docstring read so, before numpydoc reads it."""
    app.connect("autodoc-process-docstring", read, priority=400)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
