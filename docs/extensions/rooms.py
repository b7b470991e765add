"""The reference: a page for every module, and on the page of a room a table of its modules.

Both come from the package as it is, so that a module added is a page added."""

import ast
from importlib.util import find_spec
from pathlib import Path
from pkgutil import ModuleInfo, iter_modules

from sphinx.util.docutils import SphinxDirective

PACKAGE = "gmr_gym"
PAGE = "{title}\n{line}\n\n.. automodule:: {name}\n"


def modules(package: str) -> list[str]:
    """Names of the modules that stand in a package itself."""
    return [each.name for each in within(package) if not each.ispkg]


def packages(package: str) -> list[str]:
    """Names of a package and of all below it."""
    return [package, *(name for each in within(package) if each.ispkg for name in packages(each.name))]


def within(package: str) -> list[ModuleInfo]:
    """What stands in a package itself, which is not imported: it may need what is not installed."""
    return [*iter_modules(find_spec(package).submodule_search_locations, f"{package}.")]


def write_pages(app):
    """Writes the page of every module, but where it stands already: Sphinx reads again what is newer."""
    folder = Path(app.srcdir, "reference", "files")
    folder.mkdir(exist_ok=True)
    names = [name for package in packages(PACKAGE) for name in modules(package)]
    for name in names:
        page, title = folder / f"{name}.rst", name.removeprefix("gmr_gym.")
        text = PAGE.format(title=title, line="=" * len(title), name=name)
        if not page.exists() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")
    for page in set(folder.glob("*.rst")) - {folder / f"{name}.rst" for name in names}:
        page.unlink()


class Room(SphinxDirective):
    """The modules of a package with the first sentence of each, and their pages below this one."""

    required_arguments = 1

    def run(self):
        """A table, and a list of pages that is not shown."""
        names = modules(self.arguments[0])
        rows = [f"| [{name}](files/{name}.rst) | {first_sentence(name)} |" for name in names]
        pages = [f"files/{name}" for name in names]
        lines = [
            "| file | what it holds |",
            "|---|---|",
            *rows,
            "",
            "```{toctree}",
            ":hidden:",
            "",
            *pages,
            "```",
        ]
        return self.parse_text_to_nodes("\n".join(lines))


def first_sentence(module: str) -> str:
    """The first sentence of a module's docstring, on one line."""
    text = ast.get_docstring(ast.parse(Path(find_spec(module).origin).read_text(encoding="utf-8"))) or ""
    sentence, stop, _ = " ".join(text.partition("\n\n")[0].split()).partition(". ")
    return (sentence + stop).strip().replace("|", r"\|")


def skipped(app, what, name, member, skip, options):
    """Leaves out what a module imports, and the fields of a NamedTuple, which its signature names."""
    foreign = what == "module" and not getattr(member, "__module__", "").startswith(PACKAGE)
    return True if foreign or type(member).__name__ == "_tuplegetter" else None


def setup(app):
    """Has the pages written before any is read."""
    app.add_directive("room", Room)
    app.connect("builder-inited", write_pages)
    app.connect("autodoc-skip-member", skipped)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
