"""The pages of docs/teaching as Jupyter notebooks beside them, and what their Python leaves.

`python docs/notebooks.py write` makes every notebook anew, and `check` names those that are not what their
page says. `python docs/notebooks.py run PAGE FOLDER` runs the Python of a page there: the figures that it
saves are those of the page.
"""

import argparse
import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

TEACHING = Path(__file__).parent / "teaching"
PIECE = re.compile(r"^<details>$.*?^</details>$\n?|^```(python|text)\n(.*?)^```$\n?", re.M | re.S)
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.M | re.S)
INCLUDE = re.compile(r"^```{include} .*\n```$\n*", re.M)
IMAGE = re.compile(r"^!\[.*?\]\(.*?\)$\n*", re.M)
LINK = re.compile(r"\[([^\]]+)\]\(([^):]+\.(?:md|ipynb))(#[^)]*)?\)")


def pages() -> list[Path]:
    """The pages that are notebooks too: all of the folder but its index."""
    return [page for page in sorted(TEACHING.glob("*.md")) if page.name != "index.md"]


def notebook(page: Path) -> str:
    """The page as a notebook: Python as cells of code with what it prints, a fold as one cell of text."""
    cells: list[dict[str, Any]] = []
    for kind, text in parts(page.read_text(encoding="utf-8")):
        if kind == "python":
            cells.append(code(text))
        elif kind == "text" and cells and cells[-1]["cell_type"] == "code":
            cells[-1]["outputs"] = [{"name": "stdout", "output_type": "stream", "text": lines(text)}]
        elif written := said(text, page):
            cells.append({"cell_type": "markdown", "metadata": {}, "source": lines(written)})
    for number, cell in enumerate(cells):
        cell["id"] = f"cell-{number}"
    python = {"display_name": "Python 3", "language": "python", "name": "python3"}
    whole = {
        "cells": cells,
        "metadata": {"kernelspec": python, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }
    return json.dumps(whole, ensure_ascii=False, indent=1, sort_keys=True) + "\n"


def parts(text: str) -> Iterator[tuple[str, str]]:
    """The text in pieces, in order: ("python", code) and ("text", printed) of fences outside of folds, and
    ("", Markdown)."""
    at = 0
    for piece in PIECE.finditer(text):
        yield "", text[at : piece.start()]
        yield (piece[1], piece[2]) if piece[1] else ("", piece[0])
        at = piece.end()
    yield "", text[at:]


def code(text: str) -> dict[str, Any]:
    """A cell of code that was not run."""
    source = lines(text.rstrip("\n"))
    return {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": source}


def said(text: str, page: Path) -> str:
    """Markdown without what a page includes and shows, which the code draws, and with links to other pages as
    their names."""
    return LINK.sub(lambda link: named(link, page), INCLUDE.sub("", IMAGE.sub("", text))).strip()


def named(link: re.Match, page: Path) -> str:
    """What a link to a page says, and in which file of the project the page is."""
    file = (page.parent / link[2]).resolve().relative_to(TEACHING.parents[1])
    return link[1] if file.suffix == ".ipynb" else f"{link[1]} (`{file.as_posix()}`)"


def lines(text: str) -> list[str]:
    """The lines of a cell, each with its end."""
    return text.splitlines(keepends=True)


def run(page: Path, folder: Path) -> None:
    """Runs the Python of a page, answers too, in a folder."""
    text = page.read_text(encoding="utf-8")
    folder.mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    namespace = {"__name__": "page"}
    for block in PYTHON.findall(text):
        exec(compile(block, page.name, "exec"), namespace)


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Pages of docs/teaching as notebooks.")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("write", help="make every notebook anew")
    commands.add_parser("check", help="name the notebooks that are not what their page says")
    running = commands.add_parser("run", help="run the Python of a page, and keep the figures that it saves")
    running.add_argument("page", type=Path)
    running.add_argument("folder", type=Path)
    asked = parser.parse_args()
    if asked.command == "run":
        run(asked.page.resolve(), asked.folder)
        return
    made = {page.with_suffix(".ipynb"): notebook(page) for page in pages()}
    older = [file for file, text in made.items() if not file.exists() or file.read_text("utf-8") != text]
    for file in older:
        print(f"{'written' if asked.command == 'write' else 'older than its page'}: {file.name}")
        if asked.command == "write":
            file.write_text(made[file], encoding="utf-8")
    sys.exit(bool(older) and asked.command == "check")


if __name__ == "__main__":
    main()
