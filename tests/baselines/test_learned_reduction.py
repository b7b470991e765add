"""The tracker whose thresholds and assumed noise a network sets, and the price that it is made for."""

import subprocess
import sys

import numpy as np
import pytest

from gmr_gym.baselines.learned_reduction import LearnedReduction, learned_n_scan
from gmr_gym.evaluation.loop import play
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.simulation.single_target import draw, scan
from gmr_gym.tuning.network import Network, save
from gmr_gym.tuning.recent import ALL_FEATURES
from gmr_gym.tuning.thresholds import Thresholds

WORLD = turning_target(horizon=30)
PARAMETERS = ("history", "prune", "process_noise")


def network():
    """The dearer work is, the more it prunes; the rest stays."""
    k = len(ALL_FEATURES)
    W = np.zeros((3, k))
    W[1, ALL_FEATURES.index("price")] = 0.5
    always = np.array([0.0, 0.5, 0.2])
    return Network(
        ALL_FEATURES, PARAMETERS, np.zeros(k), np.ones(k), 5.0, "tanh", False, (W,), (always,)
    )  # fmt: skip


@pytest.fixture
def policy(tmp_path):
    save(tmp_path / "p.npz", network())
    (tmp_path / "p.csv").write_text("price,work\n1e-05,100\n0.001,10\n")
    return tmp_path / "p.npz"


def test_it_keeps_fewer_hypotheses_where_work_is_dear(policy):
    episode = draw(WORLD, 3)
    kept = {
        price: np.mean([
            len(done.report.mixture.w)
            for done in play(WORLD, learned_n_scan(WORLD.model, policy, price=price), episode)
        ])
        for price in (1e-5, 1e-2)
    }  # fmt: skip
    assert kept[1e-2] < 0.8 * kept[1e-5]


def test_a_step_leaves_the_belief_before_it_as_it_was(policy):
    tracker = learned_n_scan(WORLD.model, policy)
    belief = tracker.init()
    z = np.array([[belief.mixture.m[0, 0], belief.mixture.m[0, 1]]])
    belief, _ = tracker.step(belief, z)
    one, again = tracker.step(belief, z + 5.0), tracker.step(belief, z + 5.0)
    np.testing.assert_array_equal(one[0].recent, again[0].recent)
    np.testing.assert_array_equal(one[1].x, again[1].x)
    assert isinstance(tracker, LearnedReduction) and tracker.compiled is not None


def test_the_price_may_be_said_as_the_work_that_it_leads_to(policy):
    assert learned_n_scan(WORLD.model, policy).price == 1e-4
    assert learned_n_scan(WORLD.model, policy, work=10**1.5).price == pytest.approx(1e-4)
    for how, message in (
        ({"work": 5.0}, r"work must lie in \[10, 100\], got 5.0"),
        ({"work": "little"}, "work must be a number, at least 0, got 'little'"),
        ({"work": 20.0, "price": 1e-3}, "give price or work, not both"),
        ({"price": -1.0}, "price must be"),
        ({"components": 1}, "components must lie in"),
    ):
        with pytest.raises(ValueError, match=message):
            learned_n_scan(WORLD.model, policy, **how)
    for rows, message in (
        ("1e-05,100\n0,10\n", "p.csv must have positive finite prices and works"),
        ("1e-05,nan\n0.001,10\n", "p.csv must have positive finite prices and works"),
        ("0.001,10\n", r"work must lie in \[10, 10\], got 20.0"),
    ):
        policy.with_suffix(".csv").write_text("price,work\n" + rows)
        with pytest.raises(ValueError, match=message):
            learned_n_scan(WORLD.model, policy, work=20.0)
    policy.with_suffix(".csv").unlink()
    with pytest.raises(ValueError, match=r"work needs the table .*p.csv"):
        learned_n_scan(WORLD.model, policy, work=20.0)


def test_a_radar_is_refused(policy):
    with pytest.raises(ValueError, match="learned thresholds need a linear sensor"):
        learned_n_scan(airborne_radar("near", 10.0, trajectory="drawn").model, policy)


def test_the_one_that_is_shipped_widens_too_little_assumed_noise_more_than_too_much():
    network, at = (
        make_tracker("learned-n-scan", WORLD.model).network,
        Thresholds._fields.index("process_noise"),
    )
    motion, means = WORLD.model.motion, []
    for factor in (0.25, 4.0):
        told = WORLD.model._replace(motions=(motion._replace(Q=factor**2 * motion.Q),))
        tracker, set_by_scan = LearnedReduction(told, network, 1e-4), []
        for seed in range(3):
            belief, estimate, episode = tracker.init(), told.prior.m[0], draw(WORLD, seed)
            for t in range(WORLD.horizon):
                belief, report = tracker.step(belief, scan(WORLD, episode, t, WORLD.centre(estimate)).z)
                estimate = report.x[0]
                set_by_scan.append(belief.thresholds[at])
        means.append(np.exp(np.mean(np.log(set_by_scan))))
    assert means[0] > 1.5 * means[1]


def test_torch_is_not_imported(policy):
    code = (
        "import sys\n"
        "from gmr_gym.scenarios.dortenzio import turning_target\n"
        "from gmr_gym.baselines.learned_reduction import learned_n_scan\n"
        f"learned_n_scan(turning_target().model, policy={str(policy)!r})\n"
        "assert not {'torch', 'stable_baselines3'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
