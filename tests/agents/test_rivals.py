"""Rivals and how they are tuned: episodes played at once, trackers among policies, searches that go on."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("optuna")
sys.path.insert(0, str(Path(__file__).parents[2] / "agents"))

import evaluate_fronts
import tune_rivals
from batches import Batch, Outcome
from competitors import Rival, read_fronts, write_fronts
from judge import played, seeds_of
from rivals import ALL, BEST, alone, beyond, constants, env_of
from tracked import Tracked, counted, scans_of

from gmr_gym.reduction.merge_cost import merge_costs
from gmr_gym.tuning.instances import Instance, world
from gmr_gym.tuning.policies import Constant, Rule
from gmr_gym.tuning.recent import ALL_FEATURES
from gmr_gym.tuning.thresholds import Thresholds, to_action

SHORT = Instance("sure", "jump-markov-7", 0, 0.3, 40.0, 0.95, 6.0, 6.5, 2.0)  # 44 scans
LOST = SHORT._replace(instance_id="lost", manoeuvre=3.0, told_acceleration_deviation=0.05)
ENV = env_of("n-scan", "process_noise")
ACTION = to_action(Thresholds(history=2, prune=1e-3, process_noise=1.5), ENV["parameters"])


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Two instances, one of which is always lost."""
    file = tmp_path_factory.mktemp("instances") / "few.csv"
    rows = (Instance._fields, SHORT, LOST)
    file.write_text("\n".join(",".join(map(str, row)) for row in rows) + "\n")
    return str(file)


@pytest.fixture(scope="module")
def judged(table):
    return played({"it": Constant(ACTION)}, table, 2, 5, env=ENV | {"price": 0.0}, jobs=1)["it"]


def test_a_batch_plays_the_episodes_that_the_judge_plays(table, judged):
    found = Batch(table, 2, seed=5).played(Constant(ACTION), ENV["reducer"], ENV["parameters"])
    assert found.reward == pytest.approx(judged.reward.ravel())
    assert found.work.tolist() == pytest.approx((judged.work * judged.scans).ravel())
    assert found.lost.tolist() == judged.lost.ravel().tolist() == [0, 0, 1, 1]
    assert found.value(2e-3) == pytest.approx(np.mean(found.reward - 2e-3 * found.work))


def test_a_batch_asks_a_policy_about_the_features_of_every_episode(table):
    batch = Batch(table, 2, seed=5)
    steady = Rule(("nis_mean",), np.zeros((3, 1)), ACTION)
    turning = Rule(("nis_mean",), np.array([[0.0], [0.0], [0.5]]), ACTION)
    constant, same, other = (
        batch.played(policy, ENV["reducer"], ENV["parameters"])
        for policy in (Constant(ACTION), steady, turning)
    )
    assert constant.reward.tolist() == same.reward.tolist()
    assert (constant.reward != other.reward).all()


def test_a_tracker_is_scored_and_its_work_counted_as_in_the_environment(table):
    # with the noise of the filter model, which the environment always assumes in the first scan
    action = to_action(Thresholds(history=2, prune=1e-3), ENV["parameters"])
    judged = played({"it": Constant(action)}, table, 2, 5, env=ENV | {"price": 0.0}, jobs=1)["it"]
    options = {
        "method": "constant",
        "reducer": "n-scan",
        "history": 2,
        "prune_weight": 1e-3,
        "components": 100,
    }
    tracker = Tracked("adaptive-noise", options)
    found = played({"it": tracker}, table, 2, 5, env={"price": 0.0}, jobs=1)["it"]
    for name in ("reward", "error", "lost", "work", "components", "capped", "scans"):
        assert getattr(found, name) == pytest.approx(getattr(judged, name)), name
    dear = played({"it": tracker}, table, 2, 5, env={"price": 1e-3}, jobs=1)["it"]
    assert dear.reward == pytest.approx(found.reward - 1e-3 * found.work * found.scans)


@pytest.mark.parametrize("name", ["mmg", "imm-mht"])
@pytest.mark.parametrize("reduction", ["runnalls", "n-scan:scans=1"])
def test_the_work_of_several_motions_is_that_of_every_gaussian_and_of_the_reduction(name, reduction):
    scenario = world(SHORT)
    policy = Tracked(name, {"components": 4, "prune_weight": 0.0, "reduction": reduction}, (0.5, 2.0), 0.9)
    tracker, Q = policy.tracking(scenario.model), scenario.model.motion.Q
    assert [m.Q[0, 0] / Q[0, 0] for m in tracker.model.motions] == pytest.approx([0.25, 4.0])
    assert tracker.model.switching == pytest.approx(np.array([[0.9, 0.1], [0.1, 0.9]]))
    ahead = scenario.model.sensor.H @ scenario.model.motion.F @ scenario.model.prior.m[0]
    z = ahead + np.array([[0.0, 5.0], [3.0, -4.0], [-6.0, 2.0]])
    base = reduction.split(":")[0]
    _, report, work = counted(tracker, base, tracker.init(), z)
    # from one Gaussian: two motions, each with three detections or none
    hypotheses = 8 if name == "mmg" else 4
    expected = 6 + (hypotheses if base == "n-scan" else merge_costs(hypotheses, 4))
    assert len(report.mixture.w) == 4 and work == expected


def test_fronts_are_read_as_they_were_written(tmp_path):
    file = tmp_path / "static.json"
    fronts = {
        "rules": [Rival(1e-4, Rule(("nis",), np.ones((3, 1)), np.zeros(3)), ENV)],
        "trackers": [Rival(1e-3, Tracked("mmg", {"components": 4}, (0.5, 2.0), 0.8), {})],
    }
    write_fronts(file, fronts)
    found = read_fronts(file)
    assert found["trackers"] == fronts["trackers"]
    (rule,) = found["rules"]
    assert rule.price == 1e-4 and rule.policy.names == ("nis",) and rule.policy.gain.tolist() == [[1.0]] * 3
    assert rule.env["reducer"] == "n-scan"
    file.write_text("{}")
    with pytest.raises(ValueError, match=r"holds no fronts of tune_rivals\.py"):
        read_fronts(file)


class Bowl:
    """Episodes that want a number near 0.5 where work is cheap, near 0 where it is dear; it counts calls."""

    table, runs, tracked_runs, seed, calls = "valid", 1, 1, 0, 0

    def outcome(self, family, numbers):
        self.calls += 1
        return Outcome(np.array([-((numbers[0] - 0.5) ** 2)]), np.array([100 * abs(numbers[0])]), np.zeros(1))


FAMILY = constants("n-scan")


def test_a_search_finds_the_best_of_every_price(tmp_path):
    found = tune_rivals.front_of(FAMILY, Bowl(), Bowl(), 60, tmp_path)
    at = [one.numbers[0] for _, one in found]
    # at the price q the best is 0.5 - 50 q, but not below 0
    assert at == pytest.approx([max(0.0, 0.5 - 50 * price) for price in tune_rivals.PRICES], abs=0.07)


def test_a_search_that_was_stopped_goes_on_as_if_it_had_not_been(tmp_path):
    whole = Bowl()
    expected = tune_rivals.front_of(FAMILY, whole, Bowl(), 20, tmp_path / "whole")
    first, again = Bowl(), Bowl()
    tune_rivals.front_of(FAMILY, first, Bowl(), 12, tmp_path / "stopped")
    for file in (tmp_path / "stopped").glob("*.valid"):
        file.unlink()
    (file,) = (tmp_path / "stopped").glob("*.train")
    file.write_text(file.read_text()[:-10])  # in the middle of a line
    assert tune_rivals.front_of(FAMILY, again, Bowl(), 20, tmp_path / "stopped") == expected
    assert (first.calls, again.calls) == (12, 9) and whole.calls == 20


def test_every_family_begins_within_its_ranges_and_makes_a_policy(table):
    names, every = set(), alone() + [constants(reducer, *ALL) for reducer in BEST]
    tuned = [np.zeros(5), np.full(5, 0.5)]
    every += [family for reducer in BEST for family in beyond(reducer, tuned, table)]
    for family in every:
        low, high = np.array(list(family.ranges.values())).T
        for start in family.starts:
            assert ((low <= start) & (start <= high)).all(), family.name
        policy = family.policy(family.starts[-1])
        assert isinstance(policy, Tracked) == (not family.env)
        if isinstance(policy, Tracked):
            policy.tracking(world(SHORT).model)
        else:
            assert len(policy(np.zeros(len(ALL_FEATURES)), 0)) == len(family.env["parameters"])
        names.add(family.name)
    assert len(names) == len(every)
    for family in beyond("cluster", tuned, table):  # they begin with the constants, whatever is seen
        assert family.policy(family.starts[1])(np.ones(len(ALL_FEATURES)), 3).tolist() == tuned[1].tolist()


def test_the_seeds_of_episodes_are_of_their_place_and_run():
    assert seeds_of(1, 2, 3)[:2] == seeds_of(1, 2, 2)
    assert len({*seeds_of(1, 2, 3), *seeds_of(1, 3, 3), *seeds_of(2, 2, 3)}) == 9


def test_a_tracker_s_scans_end_with_a_loss():
    scenario = world(LOST)
    ((scans, lost),) = scans_of(Tracked("adaptive", {"components": 5}), scenario, [3], 0.0)
    assert lost and len(scans) < scenario.horizon
    assert scans[-1][0] == -1 - (scenario.horizon - len(scans))  # what is left counts as the cutoff


def test_fronts_are_compared_on_a_table_of_instances(table, tmp_path):
    static = tmp_path / "static.json"
    other = to_action(Thresholds(history=1, prune=1e-2), ENV["parameters"])
    rivals = {
        "n-scan, constants": [Rival(1e-4, Constant(ACTION), ENV), Rival(1e-3, Constant(other), ENV)],
        "the same twice": [Rival(1e-4, Constant(ACTION), ENV), Rival(1e-3, Constant(ACTION), ENV)],
        "a tracker": [Rival(1e-4, Tracked("adaptive", {"components": 4}), {})],
    }
    write_fronts(static, rivals)
    out = tmp_path / "out"
    evaluate_fronts.main(
        static,
        [],
        tables=[table],
        runs=2,
        exact_runs=1,
        seed=1,
        jobs=1,
        reference="n-scan, constants",
        out=out,
    )
    found = json.loads((out / "fronts.json").read_text())["tables"]["few"]
    assert [len(found["points"][name]) for name in rivals] == [2, 1, 1]
    volumes = found["volumes"]["work"]
    assert volumes["n-scan, constants"]["hypervolume"][0] >= volumes["the same twice"]["hypervolume"][0]
    assert found["points"]["near exact"][0]["work"] > found["points"]["a tracker"][0]["work"]
    played_before = set((out / "episodes").iterdir())
    evaluate_fronts.main(
        static,
        [],
        tables=[table],
        runs=2,
        exact_runs=1,
        seed=1,
        jobs=1,
        reference="n-scan, constants",
        out=out,
    )
    assert set((out / "episodes").iterdir()) == played_before and (out / "fronts-few.png").exists()
    assert "### few" in (out / "fronts.md").read_text()
