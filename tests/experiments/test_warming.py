"""Kernels compiled ahead: which pairs are played, and what is refused."""

import gymnasium as gym
import pytest

from gmr_gym.catalogue import GROUP
from gmr_gym.envs.registry import MULTI_TARGET, TUNING
from gmr_gym.experiments import warming
from gmr_gym.filters import bernoulli_tracks, imm_smoothing
from gmr_gym.recorded import LiveTracker, SensorSpec, track_rules, tracking_model

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
    assert set(played) == {(TURNING, ""), (CLUTTER, ""), (TURNING, "pda"), (CLUTTER, "gm-phd")}
    assert told == [(i, 4) for i in range(1, 5)]


def test_a_tracker_is_played_where_an_action_has_more_rows(played):
    assert warming.warm(["gmr_gym/DenseTargets-v0"], ["gm-phd"], 1, lambda *_: None) == 1


def test_a_tracker_that_fits_nowhere_is_told_with_the_reason(played):
    with pytest.raises(ValueError, match=f"'gm-phd' fits none of {TURNING}: .* is for many targets"):
        warming.warm([TURNING], ["pda", "gm-phd"], 1, lambda *_: None)
    assert played == []  # before anything is compiled


def test_of_all_trackers_those_that_fit_are_played(played, monkeypatch):
    monkeypatch.setattr(warming, "described", lambda group: {"pda": ""} if group == GROUP else {"gm-phd": ""})
    assert warming.warm([TURNING], [], 1, lambda *_: None) == 1
    assert played == [(TURNING, ""), (TURNING, "pda")]


def test_a_tracker_may_have_parameters(played):
    assert warming.warm([TURNING], ["runnalls:components=2"], 1, lambda *_: None) == 1
    with pytest.raises(ValueError, match=r"'pda:components=2' fits none .* takes no parameter 'components'"):
        warming.warm([TURNING], ["pda:components=2"], 1, lambda *_: None)


def test_what_tracks_files_is_compiled_too_where_it_is_asked_for(played):
    assert warming.warm([], [], 1, lambda *_: None, files=True) == 0
    assert played == [("", "")]
    kernels = (
        bernoulli_tracks.started, bernoulli_tracks.outputs, bernoulli_tracks.first_of_each,
        imm_smoothing.smoothed, imm_smoothing.advanced, track_rules.follow, track_rules.passes,
    )  # fmt: skip
    compiled = [len(kernel.overloads) for kernel in kernels]
    assert min(compiled) > 0
    sensor = SensorSpec("", deviation=(5.0, 5.0), detection_probability=0.9, clutter_per_scan=1.0)
    tracker = LiveTracker(tracking_model([sensor], (-1e3, -1e3), (1e3, 1e3)), lag=1)
    for t in range(3):  # of another sensor, with a beam and with identities
        tracker.update(2.0 * t, [[10.0 * t, 0.0]], azimuths=(0.0, 6.0))
        tracker.update(2.0 * t + 1.0, [[0.0, 500.0]], identity="a")
        tracker.smoothed()
    assert [len(kernel.overloads) for kernel in kernels] == compiled


def test_an_environment_without_trackers_is_stepped(played):
    assert warming.warm([TUNING], [], 1, lambda *_: None) == 0
    assert played == [(TUNING, "")]
    with pytest.raises(ValueError, match=f"'pda' fits none of {TUNING}: no tracker runs there"):
        warming.warm([TUNING], ["pda"], 1, lambda *_: None)


@pytest.mark.parametrize("env_id", [TURNING, CLUTTER])
def test_every_environment_is_stepped_side_by_side_too(monkeypatch, env_id):
    envs = gym.make_vec(env_id, 2)
    stepped = []
    monkeypatch.setattr(envs, "step", lambda actions: stepped.append(actions.shape))
    monkeypatch.setattr(gym, "make_vec", lambda *named, **told: envs)
    warming._step_all(env_id)
    assert stepped == [envs.action_space.shape]


def test_no_jobs_are_refused(played):
    with pytest.raises(ValueError, match=r"jobs must be a number of processes, or -1 .*, got 0"):
        warming.warm([TURNING], ["pda"], 0, lambda *_: None)
    assert not played


def test_the_command_says_how_many_pairs_it_compiled(played, monkeypatch, capsys):
    from gmr_gym.cli import main

    monkeypatch.setattr("sys.argv", ["gmr-gym", "warm", "--env", TURNING, "--tracker", "pda"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code and "compiled: 1\n" in capsys.readouterr().out
