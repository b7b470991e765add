"""Kernels compiled ahead: which pairs are played, and what is refused."""

import pytest

from gmr_gym.envs.registry import MULTI_TARGET, TUNING
from gmr_gym.experiments import warming

TURNING, CLUTTER = "gmr_gym/TurningTarget-v0", "gmr_gym/UnknownClutter-v0"


@pytest.fixture
def played(monkeypatch):
    """The calls, made in this process."""
    made = []

    def results(calls, jobs):
        for task, (function, *arguments) in calls.items():
            made.append(task)
            yield task, function(*arguments)

    monkeypatch.setattr(warming, "results", results)
    return made


def test_every_tracker_is_played_where_it_fits(played):
    told = []
    assert CLUTTER in MULTI_TARGET
    pairs = warming.warm([TURNING, CLUTTER], ["pda", "gm-phd"], 1, lambda *counts: told.append(counts))
    assert pairs == 2
    assert set(played) == {(e, n) for e in (TURNING, CLUTTER) for n in ("", "pda", "gm-phd")}
    assert told == [(i, 6) for i in range(1, 7)]


def test_a_tracker_that_fits_nowhere_is_told_with_the_reason(played):
    with pytest.raises(ValueError, match=f"'gm-phd' fits none of {TURNING}: .* is for many targets"):
        warming.warm([TURNING], ["pda", "gm-phd"], 1, lambda *_: None)


def test_environments_are_stepped_even_without_trackers(played):
    assert warming.warm([TUNING], [], 1, lambda *_: None) == 0
    assert played == [(TUNING, "")]


def test_the_command_says_how_many_pairs_it_compiled(played, monkeypatch, capsys):
    from gmr_gym.cli import main

    monkeypatch.setattr("sys.argv", ["gmr-gym", "warm", "--env", TURNING, "--tracker", "pda"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code and "compiled: 1\n" in capsys.readouterr().out
