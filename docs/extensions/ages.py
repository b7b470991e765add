"""A table of results that is older than the code it depends on says so below."""

import results  # of docs: conf.py has it in the path


def read(app, path, docname, content):
    """Adds it to the last line of a file of docs/results that a page includes."""
    file = results.ROOT / "docs" / path
    if file.parent == results.FOLDER and not results.is_current(results.read(file)[0]):
        content[0] = content[0].rstrip().removesuffix(".*") + "; the code has changed since.*\n"


def setup(app):
    """Has every file read so that a page includes."""
    app.connect("include-read", read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
