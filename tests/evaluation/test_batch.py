"""Runs played by one compiled call against the same runs scan by scan."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from gmr_gym.baselines.bank_of_mhts import single_model_mht
from gmr_gym.baselines.imm_pda import ImmPda, imm
from gmr_gym.baselines.learned import LearnedThresholds, learned_thresholds
from gmr_gym.baselines.learned_reduction import learned_cluster, learned_n_scan
from gmr_gym.baselines.learning_pmb import pmb
from gmr_gym.baselines.mht import Mht, adaptive, capping, cluster, n_scan, runnalls
from gmr_gym.baselines.pda import Pda
from gmr_gym.evaluation import batch, montecarlo
from gmr_gym.evaluation.montecarlo import BATCH_FROM, BLOCK, Runs, run, run_once
from gmr_gym.evaluation.summary import summary
from gmr_gym.filters.registry import make_tracker
from gmr_gym.models.motions import constant_velocity, with_accelerations
from gmr_gym.reduction.runnalls import Greedy
from gmr_gym.reduction.salmond_west import salmond
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.scenarios.maybeck import agile_flight
from gmr_gym.scenarios.recorded import recorded_flight
from gmr_gym.scenarios.zhang import jump_markov
from gmr_gym.simulation.loss import detection_outside_gates
from gmr_gym.simulation.single_target import Window, draw

FIELDS = Runs._fields[:8]
FIXED = turning_target(horizon=30, clutter_rate=300)
FOLLOWING = recorded_flight(horizon=30)
RADAR = airborne_radar()
ON_THE_GROUND = replace(
    turning_target(horizon=30, window=(400.0, 300.0)),
    region=Window(np.array([-200.0, -600.0]), np.array([900.0, 100.0]), follows=False),
)
WORLDS = {
    "fixed": FIXED,
    "following": FOLLOWING,
    "own detection": replace(FIXED, loss_rule=detection_outside_gates),
    "own detection in sight": replace(FOLLOWING, loss_rule=detection_outside_gates),
    "on the ground": ON_THE_GROUND,
    "no clutter": turning_target(horizon=30, clutter_rate=0),
    "lost": turning_target(horizon=30, told_acceleration_deviation=0.05),
}
TRACKERS = {
    "runnalls": partial(runnalls, components=5),
    "adaptive": partial(adaptive, components=30),
    "adaptive without limit": partial(adaptive, components=None, loss_bound=0.3),
    "capping": partial(capping, components=8),
    "pruned in whole numbers": partial(runnalls, components=8, prune_weight=0, prune_density=0),
    "few enter": lambda model: Mht(model, Greedy(10), max_hypotheses=25),
    "pda": Pda,
    "imm of one motion": ImmPda,
    "learned": learned_thresholds,
    "learned n-scan": learned_n_scan,
    "learned cluster": learned_cluster,
}
JUMPING = jump_markov("1")
POSSIBLE = np.array([1.0, 0.0, 1.0, 1.0, 1.0])  # the second motion can neither be at the start nor come about
TURNING = agile_flight(horizon=60, jerks=(0.1, 20.0))
SWITCHING = {
    "all possible": JUMPING,
    "one impossible": replace(
        JUMPING,
        model=JUMPING.model._replace(
            mode_prior=POSSIBLE / 4, switching=0.8 * np.diag(POSSIBLE) + 0.05 * POSSIBLE[:, None]
        ),
    ),
    "unlike states": replace(
        TURNING,
        model=TURNING.model._replace(
            motions=(with_accelerations(constant_velocity(TURNING.period, 1.0)), TURNING.model.motions[1])
        ),
    ),
}


@pytest.mark.parametrize("world", WORLDS)
@pytest.mark.parametrize("tracker", TRACKERS)
def test_together_they_are_what_each_is_alone_to_the_last_bit(world, tracker):
    check_equal(WORLDS[world], TRACKERS[tracker](WORLDS[world].model))


@pytest.mark.parametrize("tracker", [cluster, n_scan])
def test_merging_by_distance_and_by_history_is_the_same_together_as_alone(tracker):
    check_equal(FIXED, tracker(FIXED.model))


@pytest.mark.parametrize("mixing", ["augmented", "unbiased"])
@pytest.mark.parametrize("world", SWITCHING)
def test_an_imm_among_several_motions_is_played_together_as_alone(world, mixing):
    told = SWITCHING[world].model
    *_, modes = check_equal(SWITCHING[world], imm(told, mixing=mixing))
    assert modes.shape[2] == len(told.motions) and np.ptp(modes[..., 0]) > 0.5
    assert (modes[:, :, 1] > 0).any() == (world != "one impossible")


def test_a_track_given_up_is_off_target_together_as_alone():
    crowded = jump_markov("stress")
    *_, soon, _ = check_equal(crowded, ImmPda(crowded.model, give_up_ratio=1.01))
    *_, never, _ = check_equal(crowded, ImmPda(crowded.model, give_up_ratio=1e9))
    assert soon.mean() > never.mean()


def check_equal(world, tracker):
    """Checks that three runs together are what each is alone; returns them together."""
    assert batch.can_batch(world, tracker)
    together = batch.run_batch(world, tracker, [draw(world, seed) for seed in range(3)])
    alone = [run_once(world, tracker, seed) for seed in range(3)]
    for field, got in zip(FIELDS, together, strict=True):
        wanted = np.array([getattr(runs, field) for runs in alone])
        assert got.dtype == wanted.dtype and got.tobytes() == wanted.tobytes(), field
    return together


def test_worlds_are_such_that_every_branch_is_taken():
    off = {
        name: batch.run_batch(world, runnalls(world.model, 5), [draw(world, seed) for seed in range(3)])[6]
        for name, world in WORLDS.items()
    }
    assert 0 < off["lost"].mean() < 1 and 0 < off["own detection"].mean() < 1
    assert not np.array_equal(off["own detection"], off["fixed"])


def test_runs_of_a_block_are_the_same_on_two_workers_together_as_on_one_alone(monkeypatch):
    world = turning_target(horizon=3, clutter_rate=20)
    trackers = {
        "mht": runnalls(world.model, 5),
        "imm": imm(world.model),
        "alone": make_tracker("nearest-neighbour", world.model),
    }
    two = run(world, trackers, BATCH_FROM, seed=3, jobs=2)
    monkeypatch.setattr(montecarlo, "BATCH_FROM", BATCH_FROM + 1)
    one = run(world, trackers, BATCH_FROM, seed=3)
    for name in trackers:
        for field in Runs._fields[:-1]:
            np.testing.assert_array_equal(getattr(one[name], field), getattr(two[name], field), err_msg=field)
    assert (one["mht"].seconds > 0).all() and (two["alone"].seconds > 0).all()


def test_the_first_run_of_a_block_is_timed_and_no_other_and_no_figure_is_lost_by_it():
    world = turning_target(horizon=3, clutter_rate=20)
    runs = run(world, {"mht": runnalls(world.model, 5)}, BATCH_FROM)
    timed = np.isfinite(runs["mht"].seconds)
    assert (timed == (np.arange(BATCH_FROM) % BLOCK == 0)[:, None]).all()
    assert summary(world, runs)["mht"]["time_per_scan"].value > 0


class Listening(Mht):
    def step(self, belief, z):
        return super().step(belief, z[:1])


class OwnPda(Pda):
    pass


class OwnImm(ImmPda):
    pass


class OwnLearned(LearnedThresholds):
    pass


@pytest.mark.parametrize(
    ("world", "tracker"),
    [
        (FIXED, Listening(FIXED.model, Greedy(5))),
        (FIXED, Mht(FIXED.model, partial(salmond, components=5))),
        (FIXED, OwnPda(FIXED.model)),
        (FIXED, OwnImm(FIXED.model)),
        (FIXED, OwnLearned(FIXED.model, learned_thresholds(FIXED.model).network)),
        (FIXED, make_tracker("nearest-neighbour", FIXED.model)),
        (FIXED, make_tracker("clairvoyant", FIXED.model)),
        (replace(FIXED, loss_rule=lambda gates, x, z: False), runnalls(FIXED.model)),
        (RADAR, runnalls(single_model_mht(RADAR.model).model)),
        (RADAR, imm(RADAR.model)),
        (RADAR, Pda(single_model_mht(RADAR.model).model)),
        (replace(FIXED, sensor=RADAR.sensor), Pda(FIXED.model)),
        (unknown_clutter(), pmb(unknown_clutter().model)),
    ],
    ids=[
        "own step", "own reduction", "own pda", "own imm", "own learned", "none", "told the origin",
        "own loss rule", "radar", "imm of radar", "pda of radar", "true sensor a radar", "many targets",
    ],
)  # fmt: skip
def test_what_the_call_does_not_know_is_played_scan_by_scan(world, tracker):
    assert not batch.can_batch(world, tracker)
