"""Fronts held against each other: means, hypervolumes and intervals against closed forms."""

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("optuna")
sys.path.insert(0, str(Path(__file__).parents[2] / "agents"))

from front_scores import BEST_OTHER, WORST_LOSS, by_instance, compared, drawn_again, losses_at, means, points
from judge import Episodes
from scores import interquartile_mean


def episodes(work, lost, shape=(1, 6, 10)):
    """Episodes of that work and share of losses; numbers, or arrays of the shape."""
    work, lost = (np.broadcast_to(np.asarray(x, float), shape) for x in (work, lost))
    return Episodes(-lost, lost, lost, work, work, lost, work, work * 1e-6)


def test_the_first_draw_is_the_sample_and_the_others_draw_as_many_episodes():
    drawn = drawn_again(3, 6, 10, resamples=200)
    assert (drawn.seeds[0] == 1).all() and (drawn.episodes[0] == 1).all()
    assert (drawn.seeds.sum(axis=1) == 3).all() and (drawn.episodes.sum(axis=1) == 60).all()
    places = drawn.episodes.reshape(-1, 6, 10).sum(axis=2)
    assert (places % 10 == 0).all() and (places[1:] == 0).any()  # whole instances, some not at all


def test_means_and_interquartile_means_are_those_of_the_episodes_drawn():
    rng = np.random.default_rng(1)
    values, drawn = rng.lognormal(size=(2, 3, 24)), rng.multinomial(24, np.full(24, 1 / 24), 5)
    for middle, expected in ((False, np.mean), (True, interquartile_mean)):
        found = means(values, drawn, middle)
        assert found.shape == (5, 2, 3)
        for b, i, j in np.ndindex(found.shape):
            assert found[b, i, j] == pytest.approx(expected(np.repeat(values[i, j], drawn[b])))


def test_the_interval_has_the_spread_of_instances_and_of_runs_within_them():
    rng = np.random.default_rng(2)
    instances, runs = 40, 25
    x = rng.normal(size=(instances, 1)) + 3 * rng.normal(size=(instances, runs))
    drawn = drawn_again(1, instances, runs, resamples=4000)
    spread = means(x.ravel(), drawn.episodes)[1:].var()
    # a mean of means: the instances' own spread, and what is left of that of the runs
    expected = x.mean(axis=1).var() / instances + x.var(axis=1).mean() / (instances * runs)
    assert spread == pytest.approx(expected, rel=0.08)


def test_a_front_without_chance_has_its_closed_form_and_no_width():
    front = [episodes(10.0, 0.3), episodes(100.0, 0.2)]
    others = {"dear": [episodes(100.0, 0.3)], "equal": front, "cheap": [episodes(10.0, 0.4)]}
    fronts = {"learned": front} | others
    found = compared(fronts, "learned", "work")
    volume = 1 * (WORST_LOSS - 0.3) + 1 * (WORST_LOSS - 0.2)  # a decade each, up to 1000
    assert found["learned"]["hypervolume"] == pytest.approx((volume, volume, volume))
    assert found["equal"]["behind"] == pytest.approx((0, 0, 0))
    assert found["dear"]["behind"].value == pytest.approx(volume - (WORST_LOSS - 0.3))
    assert found[BEST_OTHER]["hypervolume"].value == pytest.approx(volume)
    assert compared(fronts, "learned", "time")["learned"]["hypervolume"].value == pytest.approx(volume)


def test_a_bound_is_shown_and_not_among_the_best_of_the_others():
    fronts = {"a": [episodes(10.0, 0.3)], "b": [episodes(10.0, 0.4)], "bound": [episodes(10.0, 0.1)]}
    found = compared(fronts, "a", "work", ["bound"])
    assert found["bound"]["behind"].value == pytest.approx(-2 * 0.2)
    assert found[BEST_OTHER]["hypervolume"] == pytest.approx(found["b"]["hypervolume"])


def test_what_is_common_to_both_fronts_does_not_widen_their_difference():
    rng = np.random.default_rng(3)
    hard = rng.random((1, 6, 10))  # how hard an episode is, for whoever plays it
    mine, other = ([episodes(50.0, hard < share)] for share in (0.2, 0.3))
    found = compared({"mine": mine, "other": other}, "mine", "work")["other"]
    alone, over = found["hypervolume"], found["behind"]
    assert over.low > 0 and over.high - over.low < (alone.high - alone.low)


def test_seeds_are_drawn_again_and_a_front_is_one_seed_s():
    # two seeds whose points cross: together their front would be better than either
    work = np.array([10.0, 100.0])[:, None, None]
    front = [episodes(work, 0.3, (2, 6, 10)), episodes(work[::-1], 0.2, (2, 6, 10))]
    alone = [2 * (WORST_LOSS - 0.3) + 1 * 0.1, 2 * (WORST_LOSS - 0.2)]
    volume = compared({"learned": front}, "learned", "work")["learned"]["hypervolume"]
    assert volume == pytest.approx((np.mean(alone), min(alone), max(alone)))


def test_losses_at_equal_work_lie_on_the_line_between_corners():
    mine, other = [episodes(10.0, 0.3), episodes(1000.0, 0.1)], [episodes(50.0, 0.4)]
    at, before = losses_at(mine, other, "work", [100.0, 20.0])
    assert at["lost"].value == pytest.approx(0.2) and at["ratio"].value == pytest.approx(0.5)
    assert np.isnan(before["other"].value) and np.isnan(before["ratio"].low)


def test_fronts_of_other_episodes_are_refused():
    with pytest.raises(ValueError, match=r"common episodes, got .*\[\(6, 9\), \(6, 10\)\]"):
        compared({"a": [episodes(1.0, 0.1)], "b": [episodes(1.0, 0.1, (1, 6, 9))]}, "a", "work")


def test_a_front_of_one_seed_goes_with_every_seed():
    drawn = drawn_again(3, 6, 10, resamples=5)
    assert points([episodes(10.0, 0.3)], "work_iqm", drawn).share.tolist() == [[1.0]] * 6


def test_what_is_best_for_an_instance_is_chosen_by_the_other_half_of_its_runs():
    even, odd = np.arange(10) % 2 == 0, np.arange(10) % 2 == 1
    easy = np.arange(6)[:, None] < 3  # the first policy is better in these, the second in the others
    front = [episodes(1.0, np.broadcast_to(first, (1, 6, 10))) for first in (~easy, easy)]
    (found,) = by_instance(front, [0.0])
    assert found.lost.sum() == 0
    # one is good in even runs, the other in odd ones: neither half says what is good in the other
    luck = [episodes(1.0, np.broadcast_to(lost, (1, 6, 10))) for lost in (even, odd)]
    (found,) = by_instance(luck, [0.0])
    assert found.lost.mean() == 1
    cheap, dear = episodes(1.0, 0.3), episodes(100.0, 0.1)
    works = [e.work.mean() for e in by_instance([cheap, dear], [0.0, 1.0])]
    assert works == [100.0, 1.0]
