"""A tracker's parameters tuned: what is found, that it is found again, how it is judged, what is refused."""

import csv
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

optuna = pytest.importorskip("optuna")

from gmr_gym.cli import main  # noqa: E402
from gmr_gym.experiments import trials  # noqa: E402
from gmr_gym.experiments.search_space import Choices, Interval, space_of, usual  # noqa: E402
from gmr_gym.experiments.trials import Plan, best, check_plan, is_worse, opened, search  # noqa: E402
from gmr_gym.filters.registry import make_tracker  # noqa: E402
from gmr_gym.scenarios.dortenzio import turning_target  # noqa: E402
from gmr_gym.scenarios.zhang import jump_markov  # noqa: E402

TURNING, JUMP, MANY = (f"gmr_gym/{name}-v0" for name in ("TurningTarget", "JumpMarkov", "UnknownClutter"))
NEAREST = "tune", TURNING, "--tracker", "nearest-neighbour", "--set", "horizon=3"
QUICK = "--budget", "60", "--runs", "20", "--held-out", "4", "--jobs", "1"
START = {"x": 0.9, "n": 9, "how": "slow"}
SPACE = space_of(["x=0:1", "n=1:20:log", "how=slow|quick"], "stand-in", START, ())


class Bowl:
    """An objective whose least value is at x = 0.3, n = 4, "quick", under noise that all trials share."""

    def __init__(self, asked=None, most=np.inf, stop=7):
        self.asked, self.most, self.stop = asked, most, stop

    def check(self, parameters):
        if parameters["n"] > self.most:
            raise ValueError(f"n must be at most {self.most}")

    def values(self, parameters, first, stop):
        if self.asked is not None:
            if len(self.asked) == self.stop:
                raise KeyboardInterrupt
            self.asked.append((parameters["x"], first, stop))
        noise = np.random.default_rng(1).normal(size=200)[first:stop]
        own = np.random.default_rng(int(1e6 * parameters["x"])).normal(size=200)[first:stop]
        bowl = 20 * (parameters["x"] - 0.3) ** 2 + np.log(parameters["n"] / 4) ** 2
        return bowl + (parameters["how"] == "slow") + noise + 0.2 * own


def searched(file, plan, problem=None, default=START):
    study = opened(file, SPACE, default, {"seed": plan.seed})
    return search(study, SPACE, problem or Bowl(), plan)


def plainly(found):
    return [(one.number, one.state, one.parameters, one.values.tolist(), one.error) for one in found]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """All trials of a search that was not stopped."""
    return searched(tmp_path_factory.mktemp("whole") / "trials.log", Plan(2000, 60, 0))


def test_the_optimum_of_a_bowl_is_found_and_poor_trials_are_given_up(whole):
    found = best(whole)
    assert found.parameters["x"] == pytest.approx(0.3, abs=0.15)
    assert found.parameters["n"] in (3, 4, 5) and found.parameters["how"] == "quick"
    assert whole[0].parameters == START and whole[0].state == "complete"  # the default comes first
    states = [one.state for one in whole]
    assert states.count("pruned") > states.count("complete")
    assert sum(one.cost for one in whole) <= 2000
    # by hand: a complete trial is the mean of all its runs, a pruned one is worse than the best before it
    for one in whole:
        assert len(one.values) == 60 if one.state == "complete" else len(one.values) in (20, 40)
        if one.state == "pruned":
            batch = 1 + (one.number - 1) // trials.BATCH * trials.BATCH
            before = best(whole[:batch]).values[: len(one.values)]
            assert is_worse(one.values - before)


def test_the_same_seed_makes_the_same_trials_in_whatever_order_workers_end(whole, tmp_path, monkeypatch):
    def backwards(calls, jobs):
        return [(task, function(*arguments)) for task, (function, *arguments) in [*calls.items()][::-1]]

    monkeypatch.setattr(trials.workers, "results", backwards)
    again = searched(tmp_path / "again.log", Plan(600, 60, 0))
    assert len(again) > 9 and plainly(again)[:9] == plainly(whole)[:9]
    other = searched(tmp_path / "other.log", Plan(300, 60, 1))
    assert plainly(other)[1:] != plainly(again)[1 : len(other)]


@pytest.mark.parametrize("within", [True, False], ids=["default in the space", "default outside"])
def test_a_search_that_was_stopped_goes_on_to_the_same_trials(tmp_path, within):
    default, plan = START if within else {**START, "x": 2.0}, Plan(500, 60, 3)
    wanted = plainly(searched(tmp_path / "whole.log", plan, default=default))
    file, asked = tmp_path / "stopped.log", []
    for _ in range(40):
        try:
            found = searched(file, plan, Bowl(asked), default)
            break
        except KeyboardInterrupt:
            asked.clear()
    assert plainly(found) == wanted and len(asked) < 8


def test_one_that_was_stopped_in_its_last_batch_goes_on_there(tmp_path):
    plan, file = Plan(400, 60, 0), tmp_path / "stopped.log"
    wanted = plainly(searched(tmp_path / "whole.log", plan))
    assert len(wanted) == 7  # the first, five in a batch, and one for what was left of the budget
    with pytest.raises(KeyboardInterrupt):
        searched(file, plan, Bowl([], stop=17))
    assert plainly(searched(file, plan)) == wanted


def test_a_larger_budget_goes_on_where_the_smaller_one_ended(tmp_path):
    first = plainly(searched(tmp_path / "trials.log", Plan(300, 60, 0)))
    more = plainly(searched(tmp_path / "trials.log", Plan(600, 60, 0)))
    assert len(more) > len(first) and more[: len(first)] == first


def test_trials_that_fail_leave_the_others_alone(tmp_path):
    found = searched(tmp_path / "some.log", Plan(700, 60, 0), Bowl(most=6))
    failed = [one for one in found if one.state == "fail"]
    assert failed and all(one.error == "ValueError: n must be at most 6" for one in failed)
    assert best(found).parameters["n"] <= 6
    with pytest.raises(
        ValueError, match=r"none of .* trials came to its end; the last: .*n must be at most 0"
    ):
        searched(tmp_path / "all.log", Plan(200, 60, 0), Bowl(most=0))


def test_an_objective_that_is_no_number_is_a_failure(tmp_path):
    class Undefined(Bowl):
        def values(self, parameters, first, stop):
            found = super().values(parameters, first, stop)
            return np.where(parameters["how"] == "slow", np.nan, found)

    found = searched(tmp_path / "trials.log", Plan(400, 60, 0), Undefined())
    slow = [one for one in found if one.parameters["how"] == "slow"]
    assert slow and {(one.state, one.error) for one in slow} == {
        ("fail", "the objective is not a finite number")
    }


def test_a_trial_is_worse_where_its_mean_difference_is_two_standard_errors_above_zero():
    sure, unsure = np.array([1.0, 2.0, 3.0, 2.0]), np.array([1.0, -2.0, 3.0, -1.0])
    assert sure.mean() > 2 * sure.std(ddof=1) / 2 and is_worse(sure)
    assert unsure.mean() < 2 * unsure.std(ddof=1) / 2 and not is_worse(unsure)
    assert not is_worse(-sure) and not is_worse(np.zeros(5))


def test_another_call_is_not_continued(tmp_path):
    opened(tmp_path / "trials.log", SPACE, START, {"seed": 0})
    with pytest.raises(
        ValueError, match=r"trials of another call \(seed 0, asked 1\); choose another folder"
    ):
        opened(tmp_path / "trials.log", SPACE, START, {"seed": 1})


def test_ranges_are_read_as_they_are_typed():
    known = {"a": 30, "b": 0.5, "c": None, "d": "exact"}
    space = space_of(["c=1:50", "b=1:4", "a=2:64:log", "d=exact|bp|None|2"], "any", known, ())
    assert space == {
        "a": Interval(2, 64, True, True), "b": Interval(1.0, 4.0, False, False),
        "c": Interval(1, 50, False, True), "d": Choices(("exact", "bp", None, 2)),
    }  # fmt: skip
    assert space["b"].rounded(1.234567) == 1.235 and space["b"].rounded(3.99999) == 4.0
    likely = Interval(0.5, 1.0, False, False)
    assert (likely.rounded(0.99999631), likely.rounded(0.93333333)) == (0.9999963, 0.9333)
    assert 3 in space["a"] and 2.5 not in space["a"] and "three" not in space["a"] and 2.5 in space["b"]


def test_what_can_be_tuned_is_as_given_or_by_default():
    known = usual("adaptive-12:assumed_clutter=2", turning_target())
    assert (known["components"], known["loss_bound"], known["assumed_clutter"]) == (12, 0.05, 2)
    assert usual("imm-pda", jump_markov())["assumed_stay"] == pytest.approx(14 / 15)


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """The command line in a folder of its own: (exit code, what it printed, its errors)."""
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["gmr-gym", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return call


def test_tune_judges_the_best_on_other_episodes_by_paired_differences(call):
    words = (
        *NEAREST,
        "--over",
        "assumed_process_noise=0.01:0.02",
        *QUICK,
        "--objective",
        "error",
        "--out",
        "o",
    )
    code, printed, _ = call(*words)
    assert code == 0
    record = json.loads(Path("o/tune.json").read_text())
    with Path("o/trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["state"] for row in rows} <= {"complete", "pruned"} and len(rows) == record["trials"] == 3
    value = record["best"]["assumed_process_noise"]
    assert value in [float(row["assumed_process_noise"]) for row in rows]
    # the paired difference, from the runs of the two trackers on seed 1: none of those that were tuned on
    scenario = turning_target(horizon=3)
    errors = [
        np.array([capped(scenario, noise, np.random.SeedSequence(1, spawn_key=(i,))) for i in range(4)])
        for noise in (1.0, value)
    ]
    (row,) = record["tables"][1]["rows"]
    cell = row["metrics"]["error_capped"]
    assert cell["value"] == pytest.approx((errors[1] - errors[0]).mean())
    assert min(errors[1] - errors[0]) <= cell["low"] <= cell["value"] <= cell["high"]
    assert [one["metrics"]["error_capped"]["value"] for one in record["tables"][0]["rows"]] == pytest.approx(
        [one.mean() for one in errors]
    )
    tuned = f"nearest-neighbour:assumed_process_noise={value}"
    assert f"tuned: {tuned}" in printed and f"--tracker {tuned} --set horizon=3 --runs 4 --seed 1" in printed
    assert call(*words)[1] == printed  # again: nothing is run


def capped(scenario, noise, seed):
    """Mean error of one episode, each scan's at most the cutoff, by a plain loop."""
    from gmr_gym.evaluation.loop import play
    from gmr_gym.simulation.single_target import draw

    tracker, episode = (
        make_tracker("nearest-neighbour", scenario.model, assumed_process_noise=noise),
        draw(scenario, seed),
    )
    off = [
        min(np.linalg.norm(played.report.x[0, :2] - episode.x[played.t, :2]), scenario.cutoff)
        for played in play(scenario, tracker, episode)
    ]
    return np.mean(off)


def test_a_tracker_of_many_targets_is_tuned_by_gospa_and_the_price_of_work(call):
    code, _, error = call(
        "tune", MANY, "--tracker", "gm-phd", "--set", "horizon=2", "--over", "components=1|2", *QUICK,
        "--price", "100", "--out", "o",
    )  # fmt: skip
    assert code == 0, error
    record = json.loads(Path("o/tune.json").read_text())
    assert (record["objective"], record["best"]) == ("gospa", {"components": 1})
    for row in record["tables"][0]["rows"]:
        figures = {name: cell["value"] for name, cell in row["metrics"].items()}
        assert figures["objective"] == pytest.approx(figures["gospa"] + 100 * figures["components"])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "nothing is tuned: give --over .*; nearest-neighbour has .*assumed_process_noise=1"),
        (["--over", "assumed_proces_noise=1:2"], "has no parameter .*did you mean 'assumed_process_noise'"),
        (["--over", "assumed_stay=0.5:0.9"], "has no parameter 'assumed_stay'"),
        (["--over", "assumed_clutter=2:2"], "assumed_clutter must be .* with low below high, got '2:2'"),
        (["--over", "assumed_clutter=3:2"], "with low below high, got '3:2'"),
        (["--over", "assumed_clutter=0:2:log"], "log needs a low end above 0, got '0:2:log'"),
        (["--over", "assumed_clutter=1:inf"], "that are finite, got '1:inf'"),
        (["--over", "assumed_clutter=2"], r"must be low:high or .*, or one\|another, got '2'"),
        (["--over", "assumed_clutter=1:b"], "numbers, .* got '1:b'"),
        (["--over", "assumed_clutter"], "must be parameter=low:high .* got 'assumed_clutter'"),
        (["--over", "assumed_clutter=1|1"], "has the value 1 twice"),
        (["--over", "assumed_clutter=1|"], "must be values with . between"),
        (["--over", "assumed_clutter=1:2", "--over", "assumed_clutter=1:3"], "is given twice"),
        (["--over", "assumed_clutter=1:2", "--objective", "gospa"], "not there for one target; choose from"),
        (["--over", "assumed_clutter=1:2", "--budget", "100"], "--budget 100 is too small: .* need 200"),
        (["--over", "assumed_clutter=1:2", "--price", "inf"], "--price must be finite"),
        (["--over", "assumed_clutter=1:2", "--jobs", "0"], "jobs must be a number of processes"),
        (["--over", "assumed_clutter=-3:-2", *QUICK], "none of 3 trials came to its end; .*must be positive"),
    ],
)  # fmt: skip
def test_what_cannot_be_tuned_is_refused_in_a_line(call, words, said):
    code, _, error = call(*NEAREST, *words)
    *_, line = error.strip().splitlines()
    assert code == 2 and line.startswith("error: ")
    assert re.search(said, line), line


def test_a_parameter_that_is_given_is_not_tuned(call):
    tracker = "tune", TURNING, "--tracker"
    for spec in ("adaptive-30", "adaptive:components=30"):
        code, _, error = call(*tracker, spec, "--over", "components=2:9")
        assert code == 2 and f"components is given by --tracker {spec} already" in error
    code, _, error = call(*tracker, "adaptiv", "--over", "components=2:9")
    assert code == 2 and "unknown tracker 'adaptiv'; did you mean 'adaptive'?" in error


def test_a_budget_of_two_trials_is_enough():
    check_plan(Plan(200, 100, 0))


def test_without_optuna_the_command_that_installs_it_is_shown(call, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    code, _, error = call(*NEAREST, "--over", "assumed_clutter=1:2")
    assert code == 2 and "tune needs the extra `tune`: pip install 'gmr-gym[tune]'" in error


@pytest.fixture
def recording(tmp_path):
    """Files of a target at constant velocity, detected with a deviation of 5 m, and of its truth."""
    rng, times = np.random.default_rng(4), np.arange(1.0, 41.0)
    truth = np.column_stack([10 * times, -5 * times])
    for name, positions in (("d.csv", truth + 5 * rng.normal(size=(40, 2))), ("t.csv", truth)):
        rows = (f"{time},{x},{y}" for time, (x, y) in zip(times, positions, strict=True))
        (tmp_path / name).write_text("\n".join(["time,x,y", *rows]))
    return (
        "tune-recording", "d.csv", "--tracker", "pda", "--sensor-deviation", "50", "--clutter-density",
        "1e-9", "--acceleration-deviation", "0.5", "--prior", "0,0,10,-5", "--prior-deviations", "50,50,5,5",
        "--jobs", "1", "--parts", "5",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("truth", "best"),
    [([], 0.1), (["--truth-file", "t.csv"], 10)],
    ids=["as large as it is, by the likelihood", "the more the better on a straight path, by the error"],
)
def test_a_recording_says_what_noise_to_assume(call, recording, truth, best):
    words = *recording, *truth, "--over", "assumed_measurement_noise=0.1|1|10", "--budget", "6", "--out", "o"
    code, printed, error = call(*words)
    assert code == 0, error
    assert "better: -" in printed and f"--tracker pda:assumed_measurement_noise={best}\n" in printed
    with Path("o/trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 6 and {row["runs"] for row in rows} == {"5"}
    assert rows[0]["assumed_measurement_noise"] == "1"  # as it was


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--parts", "11"], "--parts 11 to tune on and as many held out need 44 scans, got 40"),
        (["--truth-file", "late.csv"], "the truth has no time between scans 1 and 4"),
        (["--truth-file", "wide.csv"], "--truth-file wide.csv must have a time and 2 positions a row"),
        (["--cutoff", "0"], "--cutoff must be positive and finite, got 0.0"),
        (["--prior", ""], "give --prior and --prior-deviations together"),
        (["--tracker", "imm-pda:assumed_stay=0.5"], "the filter model has no assumed_stay"),
    ],
)
def test_what_a_recording_does_not_allow_is_refused_in_a_line(call, recording, words, said):
    Path("late.csv").write_text("time,x,y\n30,0,0\n40,0,0\n")
    Path("wide.csv").write_text("time,x,y,z\n1,0,0,0\n40,0,0,0\n")
    plain = [word for i, word in enumerate(recording) if not {word, recording[i - 1]} & {*words[:1]}]
    code, _, error = call(*plain, *words, "--over", "assumed_measurement_noise=0.1:1")
    assert code == 2 and error.startswith("error: ") and said in error
