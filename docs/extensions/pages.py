"""The pages are plain Markdown, to be read as they are; the site adds two things to them.

A fence that names its file, ```python title="nearest.py", is shown with the name above it; and where a page
says in which file a name stands, `prune` in `gmr_gym/reduction/pruning.py`, both lead to the reference."""

import re

TITLED = re.compile(r'^```(\w+) title="([^"\n]+)"$', re.M)
FILE = re.compile(r"`((?:gmr_gym|baselines)/[\w/]+)(?<!__init__)\.py`")
NAMES_IN = re.compile(rf"((?:`\w+`, )*`\w+`) in {FILE.pattern}")


def module_of(file: str) -> str:
    """The module of a file, named without its ending; the trackers' folder is linked into the package."""
    return "gmr_gym." + file.removeprefix("gmr_gym/").replace("/", ".")


def with_links(match) -> str:
    """The names of a match as links to their entries in the reference, and their file as one to its page."""
    names, file = match.groups()
    return re.sub(r"`(\w+)`", rf"{{py:obj}}`\1 <{module_of(file)}.\1>`", names) + f" in `{file}.py`"


def page_of(match) -> str:
    """The file of a match as a link to its page in the reference, without the package that all are in."""
    file = match[1]
    return f"{{doc}}`{file.removeprefix('gmr_gym/')}.py </reference/files/{module_of(file)}>`"


def read(app, docname, source):
    """Rewrites the text of a page."""
    text = TITLED.sub(r"```{code-block} \1\n:caption: \2\n", source[0])
    source[0] = FILE.sub(page_of, NAMES_IN.sub(with_links, text))


def setup(app):
    """Has every page read so."""
    app.connect("source-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
