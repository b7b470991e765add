"""Trackers by name: their former parameters, and the examples of filters and trackers."""

import doctest
from importlib import import_module
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from gmr_gym.catalogue import GROUP
from gmr_gym.filters import registry
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.lv import unknown_clutter

ROOT = Path(__file__).parents[2]
FILES = sorted([*(ROOT / "gmr_gym" / "baselines").glob("*.py"), *(ROOT / "gmr_gym" / "filters").glob("*.py")])
WITH_EXAMPLES = [
    ".".join(file.relative_to(ROOT).with_suffix("").parts)
    for file in FILES
    if ">>>" in file.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("name", ["learning-phd", "learning-pmb"])
def test_the_former_name_of_the_number_of_clutter_gaussians_warns_and_works(name):
    model = unknown_clutter().model
    with pytest.warns(DeprecationWarning, match="parameter 'most' is now 'max_gaussians'"):
        former = make_tracker(name, model, most=5)
    assert former.options == make_tracker(name, model, max_gaussians=5).options
    assert former.options.max_gaussians == 5


@pytest.mark.parametrize("value", ["gmr_gym.filters.mht:Missing", "no_such_package:Tracker"])
def test_a_tracker_that_cannot_be_loaded_is_named_with_the_place(value, monkeypatch):
    known = {"broken": EntryPoint("broken", value, GROUP)}
    monkeypatch.setattr(registry, "tracker_entry_points", lambda group: known)
    with pytest.raises(ValueError, match=f"^tracker 'broken' cannot be loaded from {value}: "):
        make_tracker("broken", turning_target().model)


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_examples_print_what_they_say(name):
    found = doctest.testmod(import_module(name))
    assert found.attempted > 0 and found.failed == 0


def test_there_are_examples():
    assert len(WITH_EXAMPLES) >= 4
