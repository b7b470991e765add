"""Tables of results in the pages: written by commands, and known to be older than the code they depend on."""

import re
import sys
import warnings
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "docs"))

import results  # noqa: E402

FILES = sorted(results.FOLDER.glob("*.md"))
PAGES = sorted(set((ROOT / "docs").rglob("*.md")) - set(FILES))
INCLUDED = re.compile(r"^ *```{include} (\S*results/\S+)$", re.M)
TYPED = re.compile(r"^ *\|.*\d \[-?[\d.e-]+, -?[\d.e-]+\]", re.M)
TRACKER = 'from room.gate import gate  # the gate\n\n\ndef step():\n    """A step."""\n    return gate(1)\n'


def tree(root, monkeypatch, **files):
    """The source of tracker.py in a project of these files of one room, and of others."""
    written = {"tracker.py": TRACKER, "room/gate.py": "def gate(x):\n    return x < 9\n"} | files
    for name, text in written.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(results, "ROOT", root)
    return results.source("tracker.py")


@pytest.mark.parametrize(
    ("name", "text", "same"),
    [
        ("tracker.py", TRACKER.replace("(1)", "(2)"), False),
        ("room/gate.py", "def gate(x):\n    return x < 16\n", False),
        ("room/gate.py", "# chi-square\n\n\ndef gate(x):\n    '''Whether.'''\n    return x < 9\n", True),
        ("room/other.py", "x = 1\n", True),
    ],
    ids=["the file itself", "what it imports", "comments and docstrings", "what it does not import"],
)
def test_a_table_is_older_than_its_code_where_that_has_changed(name, text, same, tmp_path, monkeypatch):
    before = tree(tmp_path / "before", monkeypatch)
    after = tree(tmp_path / "after", monkeypatch, **{name: text})
    head = {"command": "none", "needs": "tracker.py", "source": before}
    assert (after == before) is same
    assert results.is_current(head) is same


@pytest.mark.parametrize(
    ("name", "old", "new", "same"),
    [
        ("page.md", "step()", "step(2)", False),
        ("room/gate.py", "9", "16", False),
        ("page.md", "Prose", "More prose", True),
        ("page.md", "# the step", "", True),
    ],
)
def test_of_a_page_its_python_counts_and_what_that_imports(name, old, new, same, tmp_path, monkeypatch):
    files = {
        "page.md": "Prose.\n\n```python\nfrom tracker import step  # the step\n\nstep()\n```\n",
        "room/gate.py": "def gate(x):\n    return x < 9\n",
    }
    tree(tmp_path / "before", monkeypatch, **files)
    before = results.source("page.md")
    tree(tmp_path / "after", monkeypatch, **files | {name: files[name].replace(old, new)})
    assert (results.source("page.md") == before) is same


def test_a_file_of_any_bytes_may_be_needed(tmp_path, monkeypatch):
    tree(tmp_path, monkeypatch)
    for name, content in (("before.npz", b"PK\xff\x00"), ("after.npz", b"PK\xfe\x00")):
        (tmp_path / name).write_bytes(content)
    assert results.meaning(tmp_path / "before.npz") != results.meaning(tmp_path / "after.npz")
    assert len(results.source("before.npz")) == 12


def test_a_file_is_written_by_its_command_and_says_when_and_from_what(tmp_path, monkeypatch):
    source = tree(tmp_path, monkeypatch)
    table = "| tracker | lost, % |\n| --- | --- |\n| pda | 3 |"
    (tmp_path / "print.py").write_text(f"print({table!r})", encoding="utf-8")
    file = tmp_path / "pda.md"
    file.write_text(results.written({"command": "python print.py", "needs": "tracker.py"}), encoding="utf-8")
    head, body = results.read(file)
    assert head["source"] == source
    assert results.is_current(head)
    assert body.startswith(f"\n{table}\n\n*gmr_gym {head['version']}, ")


def test_a_page_says_below_a_table_that_it_is_older_than_its_code(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs" / "extensions"))
    import ages

    source = tree(tmp_path, monkeypatch)
    monkeypatch.setattr(results, "FOLDER", tmp_path / "docs" / "results")
    head = {"command": "none", "needs": "tracker.py", "version": "1", "date": "2026-11-28"}
    results.FOLDER.mkdir(parents=True)
    for name, made_of in (("now", source), ("then", "another")):
        (results.FOLDER / f"{name}.md").write_text(results.text(head | {"source": made_of}, "| a |"))
    shown = {}
    for name in ("now", "then"):
        content = [(results.FOLDER / f"{name}.md").read_text()]
        ages.read(None, Path("results", f"{name}.md"), "page", content)
        shown[name] = content[0].splitlines()[-1]
    assert shown["now"] == "*gmr_gym 1, 28 November 2026.*"
    assert shown["then"] == "*gmr_gym 1, 28 November 2026; the code has changed since.*"


def test_a_table_without_a_command_is_not_written():
    with pytest.raises(ValueError, match="no command makes it"):
        results.written({"command": "none", "needs": "gmr_gym/mixture.py"})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("| a |\n", "has no command and no needs in its head"),
        (
            "<!--\ncommand: none\nneeds: a.py\ncolour: red\n-->\n",
            "a head has no colour; it has command, needs",
        ),
        (
            "<!--\ncommand: none\nneeds: a.py\nwhatever\n-->\n",
            "a head has no whatever; it has command, needs",
        ),
    ],
)
def test_a_file_without_a_sound_head_is_refused_by_name(text, message, tmp_path):
    file = tmp_path / "table.md"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=f"table.md.*{message}"):
        results.read(file)


def cell(value, low, high, **more):
    return {"value": value, "low": low, "high": high, **more}


def test_a_table_shows_figures_in_the_units_of_a_screen_and_the_printed_ones_beside():
    metrics = {
        "track_loss": cell(0.025, 0.017, 0.0366, paper=0.02, verdict="agrees"),
        "rmse_own": cell(None, None, None),
    }
    table = {"name": "1", "rows": [{"tracker": "pda", "metrics": metrics}]}
    assert results.figures_table([table], ["track_loss", "rmse_own"]) == (
        "| tracker | lost, % | RMSE own, m |\n| --- | --- | --- |\n| pda | 2.5 [1.7, 3.66]; 2 agrees | - |"
    )


def test_claims_are_spread_over_what_they_are_judged_on():
    said = {"table": "1", "claim": "it is better", "measure": "error, m", "threshold": 0.0}
    claims = [
        {**said, "runs": "all", "verdict": "tie", **cell(1.0, -1.0, 3.0)},
        {**said, "runs": "kept", "verdict": "holds", **cell(2.0, 1.0, 3.0)},
    ]
    assert results.claims_table(claims, ["runs"]).splitlines() == [
        "| the paper says | all | kept |",
        "| --- | --- | --- |",
        "| it is better | tie 1 [-1, 3] | holds 2 [1, 3] |",
    ]


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_every_file_of_results_has_a_head_and_needs_files_that_are_there(file):
    head, _ = results.read(file)
    assert {"version", "date"} <= head.keys()
    for name in head["needs"].split():
        assert (ROOT / name).is_file(), f"{file.name} needs {name}, which is not there"


def test_pages_include_every_file_of_results_and_no_other():
    included = {
        (page.parent / name).resolve()
        for page in PAGES
        for name in INCLUDED.findall(page.read_text(encoding="utf-8"))
    }
    of_the_readme = {results.FOLDER / "figure-episode.md"}
    assert included == set(FILES) - of_the_readme


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_no_page_has_a_table_of_results_of_its_own(page):
    typed = TYPED.search(page.read_text(encoding="utf-8"))
    assert not typed, f"typed by hand: {typed[0]}; results stand in docs/results, see docs/results.py"


def test_what_is_older_than_its_code_is_told_and_breaks_nothing():
    older = [file.stem for file in FILES if not results.is_current(results.read(file)[0])]
    if older:
        said = f"{len(older)} of {len(FILES)} tables and figures of docs/results are older than their code"
        warnings.warn(f"{said}; `python docs/results.py check` names them", stacklevel=1)
