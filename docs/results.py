"""Tables of results as files: each stands in docs/results, under a head that says which command wrote it, of
which version, when and from which code, and pages include it.

`python docs/results.py check` names those that are older than the code they depend on; `write NAME ...` runs
their commands again. A new one begins as a file with `command`, `needs` and what is shown in its head:

- `table`, `columns`: tables of the record that `gmr-gym evaluate`, `leaderboard`, `sweep`, `tune`,
  `reproduce` or `compare-reductions` leaves, and metrics
- `across`: the record's claims, those of a `table` or of runs where one is named; a column for each `table`,
  each of the `runs`, or each `measure`
- `left`: a file that the command leaves, with `figure` a drawing, and what it is called in docs/images, or a
  page of its own, in docs/pages
- none of these: what the command prints

A table that no command makes has the command `none`.
"""

import argparse
import ast
import hashlib
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tokenize
from collections.abc import Iterable, Mapping
from datetime import date
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from result_tables import claims_table, figures_table  # noqa: E402

from gmr_gym.version import __version__  # noqa: E402

FOLDER = ROOT / "docs" / "results"
ASKED = ("command", "needs", "table", "columns", "across", "figure", "left")  # written by hand
BELOW = {"seed": "seed %s", "runs": "%s runs"}  # what a reader sees of them
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.M | re.S)
KNOWN = ("version", "seed", "runs", "date", "source")  # by the command


def read(file: Path) -> tuple[dict[str, str], str]:
    """The head of a file and what stands below it.

    Raises
    ------
    ValueError
        For a file without a head, or one that has not what it needs.
    """
    head, closed, body = file.read_text(encoding="utf-8").removeprefix("<!--\n").partition("-->\n")
    lines = (line.partition(": ") for line in head.splitlines())
    keys = {key: value for key, _, value in lines} if closed else {}
    if missing := {"command", "needs"} - keys.keys():
        raise ValueError(f"{file} has no {' and no '.join(sorted(missing))} in its head")
    if unknown := keys.keys() - {*ASKED, *KNOWN}:
        raise ValueError(f"{file}: a head has no {', '.join(sorted(unknown))}; it has {', '.join(ASKED)}")
    return keys, body


def text(head: Mapping[str, str], body: str) -> str:
    """What a file holds: its head, a table or nothing, and the line that a reader sees below."""
    lines = [f"{key}: {head[key]}" for key in (*ASKED, *KNOWN) if key in head]
    day = date.fromisoformat(head["date"])
    said = [f"gmr_gym {head['version']}", *(form % head[key] for key, form in BELOW.items() if key in head)]
    below = f"*{', '.join([*said, f'{day.day} {day:%B %Y}'])}.*"
    return "\n".join(["<!--", *lines, "-->", "", *([body.strip(), ""] if body.strip() else []), below, ""])


def is_current(head: Mapping[str, str]) -> bool:
    """Whether the code is as it was when the command ran."""
    return head.get("source") == source(*head["needs"].split())


def source(*needs: str) -> str:
    """Digest of the files that are needed, relative to the root, and of what they import from the project:
    of what they say to an interpreter, whatever their comments and docstrings."""
    digest = hashlib.sha256()
    for file in sorted(with_imported(ROOT / name for name in needs)):
        digest.update(f"{file.relative_to(ROOT).as_posix()}\n{meaning(file)}\n".encode())
    return digest.hexdigest()[:12]


def with_imported(files: Iterable[Path]) -> set[Path]:
    """The files, and all of the project that they import."""
    found: set[Path] = set()
    left = [*files]
    while left:
        file = left.pop()
        if file not in found:
            found.add(file)
            left += imported(file)
    return found


@cache
def imported(file: Path) -> tuple[Path, ...]:
    """Files of the project that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(python(file))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    stems = [base / name.replace(".", "/") for name in names for base in (ROOT, file.parent)]
    places = (place for stem in stems for place in (stem.with_suffix(".py"), stem / "__init__.py"))
    return tuple(place.resolve() for place in places if place.exists())  # a file linked is named once


def python(file: Path) -> str:
    """The Python of a file: of a page its blocks, of others but Python none."""
    if file.suffix == ".md":
        return "".join(BLOCK.findall(file.read_text(encoding="utf-8")))
    return file.read_text(encoding="utf-8") if file.suffix == ".py" else ""


@cache
def meaning(file: Path) -> str:
    """The text of a file, whatever its bytes; of Python without comments, docstrings and blank lines, of a
    page its Python alone."""
    if file.suffix not in (".py", ".md"):
        return file.read_text(encoding="utf-8", errors="backslashreplace")
    written = python(file)
    lines = written.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(written).readline):
        if token.type == tokenize.COMMENT:
            line, column = token.start
            lines[line - 1] = lines[line - 1][:column]
    for node in ast.walk(ast.parse(written)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node):
            first = node.body[0]
            lines[first.lineno - 1 : first.end_lineno] = [""] * (first.end_lineno - first.lineno + 1)
    return "\n".join(line.rstrip() for line in lines if line.strip())


def written(head: Mapping[str, str]) -> str:
    """The file anew: its command is run, and what it leaves shown."""
    if head["command"] == "none":
        raise ValueError("no command makes it: it can only be kept, or written by hand")
    of = source(*head["needs"].split())  # before the run: what is edited meanwhile makes it older
    printed, record = ran(head["command"])
    known = {key: str(record[key]) for key in ("seed", "runs") if key in record}
    known |= {"version": __version__, "date": date.today().isoformat(), "source": of}
    return text({key: head[key] for key in ASKED if key in head} | known, shown(head, printed, record))


def shown(head: Mapping[str, str], printed: str, record: Mapping[str, Any]) -> str:
    """What the head asks for of what a command printed and of its record."""
    if "figure" in head:
        folder = "pages" if head["figure"].endswith(".html") else "images"
        shutil.copy(ROOT / head["left"], ROOT / "docs" / folder / head["figure"])
        return ""
    if "left" in head:
        return (ROOT / head["left"]).read_text(encoding="utf-8")
    names = head["table"].split("; ") if "table" in head else []
    if "across" in head:
        claims = [
            claim for claim in record["claims"] if not names or {claim["table"], claim["runs"]} & {*names}
        ]
        return claims_table(claims, head["across"].split())
    if names:
        tables = {table["name"]: table for table in record["tables"]}
        return figures_table([tables[name] for name in names], head.get("columns", "").split())
    return printed


@cache
def ran(command: str) -> tuple[str, dict[str, Any]]:
    """What a command prints, and the record that those leave which take `--json`."""
    name, *words = shlex.split(command)
    with TemporaryDirectory() as folder:
        record = Path(folder, "record.json")
        if words[0] in ("compare-reductions", "evaluate", "leaderboard", "reproduce", "sweep", "tune"):
            words += ["--json", str(record)]
        if name == "gmr-gym":
            words = ["-c", "from gmr_gym.cli import main; main()", *words]
        done = subprocess.run(
            [sys.executable, *words], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, check=True,
            stdout=subprocess.PIPE, encoding="utf-8",
        )  # fmt: skip
        return done.stdout, json.loads(record.read_text(encoding="utf-8")) if record.exists() else {}


def check() -> None:
    """Prints version and date of every file: first those older than the code, then the others."""
    heads = {file.stem: read(file)[0] for file in sorted(FOLDER.glob("*.md"))}
    older = {name for name, head in heads.items() if not is_current(head)}
    for name in sorted(heads, key=lambda name: (name not in older, name)):
        state, head = "older than the code" if name in older else "current", heads[name]
        print(f"{state}: {name}, gmr_gym {head.get('version', 'none')}, {head.get('date', 'never run')}")
    print(f"{len(older)} of {len(heads)} are older than their code; `write NAME ...` runs them again")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description="Tables and figures of the pages, and what they depend on.")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("check", help="name what is older than the code it depends on")
    named = commands.add_parser("write", help="run again what makes a file")
    named.add_argument(
        "names", nargs="+", choices=sorted(file.stem for file in FOLDER.glob("*.md")), metavar="NAME"
    )
    asked = parser.parse_args()
    if asked.command == "check":
        check()
        return
    for file in (FOLDER / f"{name}.md" for name in asked.names):
        try:
            file.write_text(written(read(file)[0]), encoding="utf-8")
        except ValueError as error:
            parser.error(f"{file.stem}: {error}")


if __name__ == "__main__":
    main()
