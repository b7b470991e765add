"""The notebooks of docs/teaching are what their pages say."""

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "docs"))

import notebooks

PAGE = """# Title

Text with [a page](../watch.md#a-page) and [this](page.ipynb).

```python
print(1)
```

```text
1
```

![A picture](../images/episode.gif)

*Its caption.*

```{include} ../results/add-a-tracker.md
```

<details>
<summary>Answer</summary>

```python
print(2)
```

</details>

```sh
gmr-gym list
```
"""


@pytest.fixture
def page(tmp_path, monkeypatch):
    folder = tmp_path / "docs" / "teaching"
    folder.mkdir(parents=True)
    monkeypatch.setattr(notebooks, "TEACHING", folder)
    file = folder / "page.md"
    file.write_text(PAGE, encoding="utf-8")
    return file


@pytest.mark.parametrize("page", notebooks.pages(), ids=lambda page: page.stem)
def test_a_notebook_is_what_its_page_says(page):
    assert page.with_suffix(".ipynb").read_text("utf-8") == notebooks.notebook(page), (
        "run: python docs/notebooks.py write"
    )


@pytest.mark.parametrize("page", notebooks.pages(), ids=lambda page: page.stem)
def test_a_lesson_has_what_a_class_needs(page):
    text = page.read_text("utf-8")
    for part in (
        "| before |",
        "| time |",
        "| after |",
        f"]({page.stem}.ipynb)",
        "## Exercises",
        "](../images/",
    ):
        assert part in text, part
    exercises = text.partition("## Exercises")[2]
    assert not any(kind for kind, _ in notebooks.parts(exercises)), "an answer is not under a fold"
    assert exercises.count("\n**") == exercises.count("\n<details>") == exercises.count("\n</details>") >= 3


def test_a_page_becomes_cells_of_text_and_code(page):
    book = json.loads(notebooks.notebook(page))
    cells = [(cell["cell_type"], "".join(cell["source"])) for cell in book["cells"]]
    assert cells == [
        ("markdown", "# Title\n\nText with a page (`docs/watch.md`) and this."),
        ("code", "print(1)"),
        ("markdown", "*Its caption.*"),
        (
            "markdown",
            "<details>\n<summary>Answer</summary>\n\n```python\nprint(2)\n```\n\n</details>",
        ),
        ("markdown", "```sh\ngmr-gym list\n```"),
    ]
    assert book["cells"][1]["outputs"][0]["text"] == ["1\n"]
    assert len({cell["id"] for cell in book["cells"]}) == len(book["cells"])


def test_a_page_is_run_with_its_answers_in_a_folder(page, capsys, monkeypatch):
    monkeypatch.chdir(page.parent)
    notebooks.run(page, page.parent / "out")
    assert capsys.readouterr().out == "1\n2\n"
    assert Path.cwd() == page.parent / "out"


def test_check_names_a_notebook_that_is_older_than_its_page(page, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["notebooks.py", "write"])
    with pytest.raises(SystemExit) as done:
        notebooks.main()
    assert not done.value.code
    page.write_text(PAGE.replace("print(1)", "print(3)"), encoding="utf-8")
    monkeypatch.setattr(sys, "argv", ["notebooks.py", "check"])
    with pytest.raises(SystemExit) as done:
        notebooks.main()
    assert done.value.code == 1
    assert "older than its page: page.ipynb" in capsys.readouterr().out
