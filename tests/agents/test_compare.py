"""The comparison of policies that set thresholds: its statistics, its episodes, and what is found again."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
pytest.importorskip("optuna")
sys.path.insert(0, str(ROOT / "agents"))

import competitors  # noqa: E402
import evaluate  # noqa: E402
import scores  # noqa: E402
import tune_static  # noqa: E402
from hindsight import ByInstance, Greedy, grid  # noqa: E402
from judge import V0, Episodes, played  # noqa: E402
from report import markdown, plain  # noqa: E402

from gmr_gym.envs.tuning import ReductionTuningEnv  # noqa: E402
from gmr_gym.evaluation.summary import Estimate  # noqa: E402
from gmr_gym.tuning.features import FEATURES  # noqa: E402
from gmr_gym.tuning.instances import Instance  # noqa: E402
from gmr_gym.tuning.network import Network, save  # noqa: E402
from gmr_gym.tuning.policies import ByTable, Constant, Random, Rule, Schedule  # noqa: E402
from gmr_gym.tuning.thresholds import DORTENZIO, to_action  # noqa: E402

SHORT = Instance("sure", "jump-markov-7", 0, 0.3, 40.0, 0.95, 6.0, 6.5, 2.0)  # 44 scans
LOST = SHORT._replace(instance_id="lost", manoeuvre=3.0, told_acceleration_deviation=0.05)
NAMES = ("alpha", "prune")


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Two instances, one of which is always lost."""
    file = tmp_path_factory.mktemp("instances") / "few.csv"
    rows = (Instance._fields, SHORT, LOST)
    file.write_text("\n".join(",".join(map(str, row)) for row in rows) + "\n")
    return str(file)


def made_up(rng, seeds=1, places=3, runs=8):
    """Episodes (seeds, places, runs) of numbers."""
    shape = (len(Episodes._fields), seeds, places, runs)
    e = Episodes(*rng.lognormal(size=shape))
    return e._replace(lost=(e.lost > 1.5).astype(float), reward=-e.reward)


def test_the_interquartile_mean_is_that_of_the_middle_half():
    assert scores.interquartile_mean(np.arange(8.0)[::-1].reshape(2, 4)) == 3.5  # of 2, 3, 4, 5
    assert scores.interquartile_mean(np.array([0, 1, 2, 1e9])) == 1.5


def test_improvement_counts_pairs_and_half_of_the_ties():
    assert scores.improvement(np.array([1.0, 2, 3, 4]), np.array([0.0, 2, 5, 1])) == 0.625
    rng = np.random.default_rng(0)
    a, b = rng.integers(3, size=(2, 2, 3, 4)).astype(float)
    pairs = [(x > y) + 0.5 * (x == y) for x, y in zip(a.ravel(), b.ravel(), strict=True)]
    assert scores.improvement(a, b) == pytest.approx(np.mean(pairs))


def test_the_stratified_bootstrap_draws_runs_within_instances():
    # instances far apart, of which either's runs are all but alike: strata take that spread out
    # and run i of one has nothing to do with run i of another, or these would cancel
    noise = np.random.default_rng(0).normal(size=400)
    x = np.stack([noise, 100 - noise])[None]
    (figure,) = scores.resampled(lambda pick: [pick(x).mean()], x.shape)
    error = np.sqrt(x.var(axis=-1).sum() / 4 / 400)  # of the mean over two strata
    assert figure.value == x.mean()
    # a percentile of 1000 draws is off by some 7 %, and so is the difference of two
    assert figure.high - figure.low == pytest.approx(2 * 1.96 * error, rel=0.15)


def test_the_bootstrap_draws_seeds_too_and_pairs_run_with_run():
    x = np.repeat(np.array([0.0, 1.0])[:, None, None], 3, axis=1).repeat(5, axis=2)
    (figure,) = scores.resampled(lambda pick: [pick(x).mean()], x.shape)
    assert figure == (0.5, 0.0, 1.0)  # two seeds, each the same in every run
    base = np.random.default_rng(0).normal(size=(1, 3, 5))
    (figure,) = scores.resampled(lambda pick: [(pick(base + 2 * x) - pick(base)).mean()], x.shape)
    assert figure == pytest.approx((1.0, 0.0, 2.0))
    (figure,) = scores.resampled(lambda pick: [(pick(base + 2) - pick(base)).mean()], base.shape)
    assert figure == pytest.approx((2.0, 2.0, 2.0))
    with pytest.raises(ValueError, match="at least two runs of each instance, got 1"):
        scores.resampled(lambda pick: [0.0], (1, 3, 1))


def test_figures_and_differences_are_what_they_are_called():
    rng = np.random.default_rng(1)
    mine, other = made_up(rng, seeds=2), made_up(rng, runs=12)
    found = scores.figures(mine)
    assert found["track_loss"].value == mine.lost.mean()
    assert found["error_kept"].value == pytest.approx(np.mean(mine.error[mine.lost == 0]))
    assert found["work"].value == mine.work.mean() > found["work_iqm"].value  # of a skewed law
    assert np.isnan(found.pop("time_per_scan").low)
    for figure in found.values():
        assert figure.low <= figure.value <= figure.high
    other = other._replace(error=np.where(other.lost == 1, 1e9, other.error))
    minus = scores.against(mine, other)
    common = Episodes(*(part[0, :, :8] for part in other))
    pairs = [
        mine.error[s, i, r] - common.error[i, r]
        for s in range(2) for i in range(3) for r in range(8)
        if not mine.lost[s, i, r] and not common.lost[i, r]
    ]  # fmt: skip
    assert minus["error_kept"].value == pytest.approx(np.mean(pairs))
    assert minus["work_ratio"].value == pytest.approx(mine.work.mean() / common.work.mean())
    assert minus["reward"].value == pytest.approx(mine.reward.mean() - common.reward.mean())


def test_the_front_holds_what_no_other_point_beats():
    points = np.random.default_rng(2).integers(0, 9, (60, 2)).astype(float)
    kept = scores.front(points)
    beaten = [any((q <= p).all() and (q < p).any() for q in points) for p in points]
    assert {tuple(points[i]) for i in kept} == {
        tuple(p) for p, b in zip(points, beaten, strict=True) if not b
    }
    assert (np.diff(points[kept, 0]) > 0).all() and (np.diff(points[kept, 1]) < 0).all()


def test_the_front_is_played_again_by_those_that_nobody_beats_and_that_can_be_paid():
    # work, capped error, losses: b is beaten by a, c is best in losses alone, d costs too much
    places = {"a": (10, 5.0, 0.2), "b": (11, 6.0, 0.3), "c": (20, 7.0, 0.1), "d": (5000, 1.0, 0.0)}
    names = list(places)
    empty = Episodes(*np.zeros((len(Episodes._fields), 2, 3)))
    seen = scores.together([
        empty._replace(work=empty.work + work, capped=empty.capped + error, lost=empty.lost + lost)
        for work, error, lost in places.values()
    ])  # fmt: skip
    assert evaluate.on_front(names, seen, 1e-4) == ["a", "c"]
    assert evaluate.on_front(names, seen, 1e-5) == ["a", "c", "d"]
    assert evaluate.on_front(names, seen, 1.0) == []


def test_work_on_a_front_is_geometric_between_its_corners():
    points = np.array([[1.0, 100.0], [3.0, 1.0], [2.0, 500.0]])
    assert [scores.work_on(points, error) for error in (1, 2, 3, 9)] == pytest.approx([100, 10, 1, 1])
    assert np.isnan(scores.work_on(points, 0.9))


def test_a_constant_of_the_front_takes_all_of_its_work():
    rng = np.random.default_rng(3)
    constants = scores.together([Episodes(*(part[0] for part in made_up(rng))) for _ in range(2)])
    best = constants.capped.mean(axis=(1, 2)).argmin()  # the least error is always a corner
    shares = scores.against_front(Episodes(*(part[best][None] for part in constants)), constants)
    assert shares["work_at_equal_error"].value == pytest.approx(1)


def test_constants_by_instance_are_those_of_the_least_cost_of_a_smooth_law():
    actions, rng = grid(2), np.random.default_rng(4)
    target = np.array([[0.25, 0.5], [0.75, 0.0]])  # two instances
    capped = 30 + 40 * ((actions[:, None] - target) ** 2).sum(axis=-1)
    np.testing.assert_allclose(scores.surface(actions, capped), capped)
    blank = scores.together([Episodes(*(part[0] for part in made_up(rng, places=2))) for _ in actions])

    def chosen(work, price, noise):  # noise (m) of an episode; neighbours differ by 2.5 m and more
        errors = capped[..., None] + rng.normal(0, noise, (*capped.shape, 8))
        seen = blank._replace(capped=errors, work=np.repeat(work, 8).reshape(errors.shape))
        return actions[scores.chosen_by_instance(actions, seen, price, 100)]

    np.testing.assert_allclose(chosen(np.full(capped.shape, 20.0), 1e-5, 3), target)
    work = np.exp(8 - 3 * actions.sum(axis=1, keepdims=True) + 0 * capped)
    assert (chosen(work, 1.0, 3) == 1).all()  # where work is all that counts


def test_an_instance_that_noise_hides_is_left_with_what_is_best_for_all():
    actions, rng = grid(2), np.random.default_rng(5)
    law = 30 + 40 * ((actions - 0.5) ** 2).sum(axis=1)
    errors = law[:, None, None] + rng.normal(0, 30, (36, 40, 8))  # m, as episodes are
    blank = scores.together([Episodes(*(part[0] for part in made_up(rng, places=40))) for _ in actions])
    seen = blank._replace(capped=errors, work=np.ones(errors.shape))
    chosen = actions[scores.chosen_by_instance(actions, seen, 1e-5, 100)]
    lucky = actions[errors.mean(axis=-1).argmin(axis=0)]
    assert (chosen == 0.5).all() and np.abs(lucky - 0.5).max() >= 0.5


def test_an_episode_of_a_constant_is_that_of_the_environment(table):
    action = to_action(DORTENZIO, NAMES)
    found = played({"paper": Constant(action)}, table, 2, env=V0, jobs=1)["paper"]
    env = ReductionTuningEnv(instances=table)
    for place, row in enumerate((SHORT, LOST)):
        key = np.random.SeedSequence((0, place, 1)).generate_state(2)
        env.reset(seed=int(key[0]) << 31 | int(key[1]) >> 1, options={"instance_id": row.instance_id})
        rewards, infos, over, lost = [], [], False, False
        while not over:
            _, reward, lost, late, info = env.step(action)
            rewards.append(reward)
            infos.append(info)
            over = lost or late
        error, work = (np.array([info[name] for info in infos]) for name in ("error", "work"))
        assert lost == (row is LOST) and (lost or len(error) == 44)
        capped = (np.minimum(error, 100).sum() + 100 * (44 - len(error))) / 44
        wanted = (sum(rewards), error.mean(), float(lost), work.mean(), capped, len(error))
        parts = (found.reward, found.error, found.lost, found.work, found.capped, found.scans)
        assert [part[place, 1] for part in parts] == pytest.approx(wanted)
        assert capped == pytest.approx(100 * -(sum(rewards) + env.price * work.sum()) / 44)


def test_runs_and_instances_are_the_same_however_many_there_are(table):
    policy = {"random": Random(2, 5, np.random.default_rng(0)), "constant": Constant(np.full(2, 0.4))}
    many = played(policy, table, 3, env=V0, jobs=1)
    few = played(policy, table, 2, env=V0, jobs=1, only=["lost"])
    for name in policy:
        np.testing.assert_array_equal(many[name].reward[1:, :2], few[name].reward)
        assert not np.array_equal(many[name].reward, played(policy, table, 3, 1, env=V0, jobs=1)[name].reward)


def test_what_was_played_is_found_again(table, tmp_path, monkeypatch):
    policy = {"one": Constant(np.full(2, 0.4)), "two": Random(2, 5, np.random.default_rng(0))}
    told = []
    how = {"env": V0, "jobs": 1, "folder": tmp_path}
    first = played(policy, table, 2, **how, progress=lambda *so_far: told.append(so_far))
    assert told == [(1, 4), (2, 4), (3, 4), (4, 4)]
    with monkeypatch.context() as patch:
        patch.setattr("judge._of_instance", None)
        again = played(policy, table, 2, **how)
    for name in policy:
        np.testing.assert_array_equal(first[name], again[name])
    assert len(list(tmp_path.glob("few-*.npz"))) == 2
    played(policy, table, 2, **how | {"env": V0 | {"price": 3e-4}})  # another problem is another file
    assert len(list(tmp_path.glob("few-*.npz"))) == 4


def test_the_oracle_takes_no_less_in_a_scan_than_any_of_its_actions(table):
    actions = grid(2, np.array([0.0, 0.5, 1.0]))
    env = ReductionTuningEnv(instances=table)
    act = Greedy(actions, scans=1).watching(env)
    observation, _ = env.reset(seed=5, options={"instance_id": "sure"})
    for t in range(12):
        offered = [env.lookahead_reward(action) for action in actions]
        observation, reward, *_ = env.step(act(observation, t))
        assert reward == max(offered) >= min(offered)


def test_constants_by_instance_are_played_by_instance(table):
    actions = {"sure": np.full(2, 0.3), "lost": np.full(2, 0.8)}
    found = played(
        {"both": ByInstance(actions)} | {name: Constant(a) for name, a in actions.items()}, table, 2,
        env=V0, jobs=1,
    )  # fmt: skip
    np.testing.assert_array_equal(found["both"].reward[0], found["sure"].reward[0])
    np.testing.assert_array_equal(found["both"].reward[1], found["lost"].reward[1])


def test_policies_come_back_from_their_file(tmp_path):
    cells = np.array([[0.1, 0.2], [0.3, 0.4]])
    policies = {
        "constant": Constant(np.array([0.1, 0.2])),
        "schedule": Schedule(cells, 15),
        "rule": Rule(("kept",), cells[:, :1], cells[0]),
        "table": ByTable(("clutter", "detection"), cells, cells),
    }
    competitors.write(tmp_path / "static.json", {"price": 1e-4}, policies)
    env, again = competitors.read(tmp_path / "static.json")
    assert env == {"price": 1e-4} and list(again) == list(policies)
    features = np.random.default_rng(0).uniform(-1, 1, len(FEATURES))
    for name, policy in policies.items():
        assert type(again[name]) is type(policy)
        for t in (0, 20):
            np.testing.assert_array_equal(again[name](features, t), policy(features, t))


@pytest.mark.parametrize("text", ["", "[]", '{"env": {}}', '{"env": {}, "policies": {"a": {"kind": "Net"}}}'])
def test_a_file_without_policies_is_refused(tmp_path, text):
    (tmp_path / "static.json").write_text(text)
    with pytest.raises(ValueError, match=r"static.json holds no policies of tune_static.py"):
        competitors.read(tmp_path / "static.json")


def tuner(folder, table):
    return tune_static.Tuner(folder, V0 | {"components": 20}, table, table, 1, 0, 1)


def test_a_search_that_was_stopped_goes_on_as_if_it_had_not_been(table, tmp_path, monkeypatch):
    monkeypatch.setattr(tune_static, "ROUNDS", 1)
    monkeypatch.setattr(tune_static, "FINALISTS", 100)
    search = tune_static.constant_search(np.zeros(2))
    whole = tuner(tmp_path / "whole", table).finalists(search, 1000)
    tuner(tmp_path / "parts", table).finalists(search, 300)
    np.testing.assert_array_equal(tuner(tmp_path / "parts", table).finalists(search, 1000), whole)
    assert len(whole) == len(np.unique(whole, axis=0)) > 11  # by then it no longer draws evenly
    assert any((numbers == 0).all() for numbers in whole)


def test_searches_begin_with_the_constant_and_stay_in_the_box():
    constant, features = np.array([0.4, 0.3]), np.random.default_rng(0).uniform(-2, 2, len(FEATURES))
    searches = [tune_static.schedule_search(constant)]
    searches += [tune_static.rule_search(names, constant) for names in tune_static.RULES]
    for search in searches:
        policy = search.policy(search.start)
        for t in (0, 30, 99):
            np.testing.assert_array_equal(policy(features, t), constant)
        for end in (0, 1):
            action = search.policy(np.array([ends[end] for ends in search.ranges.values()]))(features, 0)
            assert (np.abs(action) <= 1).all()
        assert all(
            low <= x <= high for x, (low, high) in zip(search.start, search.ranges.values(), strict=True)
        )


@pytest.fixture(scope="module")
def compared(table, tmp_path_factory):
    """The folder of a comparison from the tuning to the figures, with two seeds of a policy."""
    folder = tmp_path_factory.mktemp("comparison")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tune_static, "ROUNDS", 1)
        patch.setattr(tune_static, "RULES", (("kept",),))
        tune_static.main(
            steps=150, seed=0, set_=[f"instances={table}", "components=20"], valid=table, valid_runs=1,
            jobs=1, out=folder,
        )  # fmt: skip
    rng = np.random.default_rng(0)
    for seed in (0, 1):
        (folder / f"net-{seed}").mkdir()
        weights = (0.1 * rng.normal(size=(2, len(FEATURES))),)
        network = Network(
            FEATURES, NAMES, np.zeros(len(FEATURES)), np.ones(len(FEATURES)), 10.0, "tanh", False, weights,
            (np.full(2, 0.5),),
        )  # fmt: skip
        save(folder / f"net-{seed}" / "best.npz", network)
    return folder


def compare(folder, table):
    evaluate.main(
        folder / "static.json", [folder / f"net-{seed}" / "best.npz" for seed in (0, 1)], tables=[table],
        runs=3, grid_runs=2, slow_runs=2, seed=1, jobs=1, out=folder / "out",
    )  # fmt: skip
    return json.loads((folder / "out" / "comparison.json").read_text())["tables"]["few"]


def test_a_comparison_from_end_to_end(compared, table, monkeypatch):
    monkeypatch.setattr(scores, "RESAMPLES", 50)
    found = compare(compared, table)
    names = [
        "paper", "best constant", "table", "best schedule", "best rule", "constant by instance", "net",
        "random", "greedy oracle",
    ]  # fmt: skip
    assert list(found["competitors"]) == names
    assert found["shape"]["net"] == [2, 2, 3] and found["shape"]["greedy oracle"] == [1, 2, 2]
    reward = {name: np.array(found["instance_means"][name]["reward"]) for name in names}
    for name in names:
        assert found["competitors"][name]["reward"][0] == pytest.approx(reward[name].mean())
        assert found["competitors"][name]["track_loss"][0] >= 0.5  # one instance is lost
    gain = found["split"]["tuning (best constant over paper)"]["reward"][0]
    assert gain == pytest.approx(reward["best constant"].mean() - reward["paper"].mean())
    assert "learned beyond the instance (net over constant by instance)" in found["split"]
    assert found["competitors"]["best constant"]["work_at_equal_error"][0] >= 1  # it is one of the front
    assert len(found["constants"]) == 36 and len(found["constants_by_instance"]) == len(evaluate.PRICES)
    for file in ("fronts-few.png", "instances-few.png"):
        assert (compared / "out" / file).stat().st_size > 10_000
    text = (compared / "out" / "comparison.md").read_text()
    assert (
        "3 episodes of each of 2 instances; fewer: random 2, greedy oracle 2; seeds of training: net 2."
        in text
    )
    assert text.count("\n| paper |") == 2
    monkeypatch.setattr("judge._of_instance", None)  # nothing is played a second time
    assert compare(compared, table) == found


def test_a_policy_of_other_thresholds_and_a_file_without_a_constant_are_refused(compared, tmp_path):
    with pytest.raises(ValueError, match=r"best.npz sets .'alpha', 'prune'.*, but the others set .'alpha',"):
        evaluate.learned([compared / "net-0" / "best.npz"], ["alpha"], {})
    files = [compared / f"net-{seed}" / "best.npz" for seed in (0, 1)]
    with pytest.raises(ValueError, match="net-1 is given twice"):
        evaluate.learned([files[1], files[1]], NAMES, {})
    groups = evaluate.learned(files, NAMES, {})
    assert list(groups) == ["net"] and len(groups["net"]) == 2
    competitors.write(tmp_path / "static.json", {}, {})
    with pytest.raises(ValueError, match="holds no 'best constant'"):
        evaluate.Comparison(tmp_path / "static.json", [], tmp_path, 0, 2, 1)


def test_nan_becomes_null_and_a_dash():
    assert plain({"a": Estimate(1.0), "b": [2, np.nan]}) == {"a": [1.0, None, None], "b": [2, None]}
    row = {name: Estimate(np.nan) for name in ("track_loss", "error_kept", "error_capped", "reward")}
    row |= {
        "work_ratio": Estimate(0.5, 0.4, 0.6),
        "work_iqm_ratio": Estimate(1.0),
        "improvement": Estimate(0.5),
    }
    text = markdown(
        "x",
        {"shape": {"a": (1, 0, 2)}, "instances": [], "competitors": {}, "against": {"a": row}, "split": {}},
    )
    assert "| a | – | – | – | 50 (40 to 60) | 100 | – | 50 |" in text


@pytest.mark.parametrize("script", ["tune_static", "evaluate"])
def test_the_scripts_say_how_they_are_used(script):
    done = subprocess.run(
        [sys.executable, str(ROOT / f"agents/{script}.py"), "--help"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0 and "--jobs" in done.stdout
