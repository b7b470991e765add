"""Names given up for the words of the field stay away; files and modules that are spoken of are there."""

import re
from pathlib import Path

import pytest

import gmr_gym

ROOT = Path(__file__).parents[2]
FOLDERS = ("gmr_gym", "baselines", "agents", "benchmarks", "tests", "docs")
FILES = [
    ROOT / "README.md",
    *sorted(file for folder in FOLDERS for end in ("py", "md") for file in (ROOT / folder).rglob(f"*.{end}")),
]
FORMER = {"tests/contract/test_names.py", "tests/contract/test_deprecated.py"}  # speak of former names
# the distinctive ones: everyday words, such as `told` or `moved`, have other uses
RETIRED = (
    "ManyScenario", "ManyTracker", "CrowdEnv", "CrowdRuns", "CrowdCanvas", "CrowdPolicy", "CROWD_GROUP",
    "crowd_trackers", "crowd_runs", "crowd_summary", "render_crowd", "Sensing", "log_stretch", "gate_size",
    "told_by", "told_origin", "let_in", "let_out", "fuse_scan", "log_odds", "expand_together",
    "look_together", "hopeless", "hopeless_beyond", "false_expected", "distances_seen", "pairs_gated",
    "outside_all",
    "among_heaviest", "at_least_one", "selected_by", "cost_of_all", "form_costs", "by_entry", "take_in",
    "uncounted", "Modal", "tended", "leave_alone", "mixed_ahead", "Labelled", "Census", "Lessons",
    "first_lesson", "ends_sight", "hear_all", "carry_into", "words_for", "LOOKERS", "claims_grid", "Mhts",
)  # fmt: skip
SHIMS = {
    "CrowdPolicy": "gmr_gym/__init__.py",
    "crowd_trackers": "gmr_gym/catalogue.py",
    "hopeless": "gmr_gym/filters/registry.py",
}
GROUPS = ("trackers", "multi_target_trackers", "crowd_trackers", "reductions")  # of entry points
TEXT = {str(file.relative_to(ROOT)): file.read_text(encoding="utf-8") for file in FILES}


def found(pattern):
    """(file:line, what matched) of every match, but for where former names are spoken of."""
    for file, text in TEXT.items():
        if file not in FORMER:
            for match in re.finditer(pattern, text):
                yield f"{file}:{text.count(chr(10), 0, match.start()) + 1}", match


def test_no_retired_name_is_left_but_where_it_still_works():
    left = [
        (place, match[0])
        for place, match in found(rf"\b(?:{'|'.join(RETIRED)})\b")
        if not place.startswith(f"{SHIMS.get(match[0])}:")
    ]
    assert left == []


@pytest.mark.parametrize(("name", "file"), SHIMS.items())
def test_a_former_name_that_still_works_is_where_the_list_says(name, file):
    assert re.search(rf"\b{name}\b", TEXT[file])


def test_every_file_of_the_library_that_is_spoken_of_is_there():
    named = list(found(r"\b(?:gmr_gym|baselines|agents)/[\w/]+\.py\b"))
    assert len(named) > 50
    assert [(place, match[0]) for place, match in named if not (ROOT / match[0]).is_file()] == []


def test_every_module_of_the_library_that_is_spoken_of_is_there():
    named = list(found(r"\bgmr_gym\.([a-zA-Z]\w*)(?:\.(\w+))?"))
    assert len(named) > 500
    assert [(place, match[0]) for place, match in named if not there(match[1], match[2])] == []


def test_trackers_are_imported_by_one_name_alone():
    assert [place for place, _ in found(r"(?m)^[ \t]*(?:from|import) baselines\b")] == []
    assert len(list(found(r"(?m)^from gmr_gym\.baselines\."))) > 50


def there(room, module):
    """Whether the package has such a room or name, and the room such a module or name on its face."""
    folder = ROOT / "gmr_gym" / room
    if folder.is_dir():
        face = (folder / "__init__.py").read_text(encoding="utf-8")
        return (
            module is None
            or (folder / module).is_dir()
            or (folder / f"{module}.py").is_file()
            or module in face
        )
    return folder.with_suffix(".py").is_file() or room in (*GROUPS, *gmr_gym.__all__)
