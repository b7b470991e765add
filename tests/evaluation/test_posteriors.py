"""Mixtures recorded before their reduction."""

import numpy as np
import pytest

from gmr_gym.evaluation.loop import play
from gmr_gym.evaluation.posteriors import posteriors
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.single_target import draw

SCENARIO = turning_target(horizon=8)
RUNNALLS = make_tracker("runnalls-5", SCENARIO.model)


def test_recorded_mixtures_are_as_large_as_asked_and_the_first_of_more():
    few, more = (posteriors(SCENARIO, RUNNALLS, n, seed=3, more_than=6, most=30) for n in (4, 9))
    assert len(few) == 4 and len(more) == 9
    for p, q in zip(few, more, strict=False):
        np.testing.assert_array_equal(p.m, q.m)
    for p in more:
        assert 6 < len(p.w) <= 30 and p.w.sum() == pytest.approx(1, abs=1e-12)
    other = posteriors(SCENARIO, RUNNALLS, 4, seed=4, more_than=6, most=30)
    assert not np.array_equal(few[0].m, other[0].m)


def test_what_is_recorded_are_the_heaviest_hypotheses_of_a_scan_before_their_reduction():
    belief, full = RUNNALLS.init(), []
    episode = draw(SCENARIO, np.random.SeedSequence(0, spawn_key=(0,)))
    for played in play(SCENARIO, RUNNALLS, episode):
        belief, _, trace = RUNNALLS.trace(belief, played.scan.z)
        full.append(trace.full)
    for p in posteriors(SCENARIO, RUNNALLS, 3, seed=0, more_than=5, most=500):  # of the first episode
        (scan,) = (q for q in full if np.allclose(q.m[q.w.argmax()], p.m[p.w.argmax()]))
        heaviest = np.sort(np.argsort(scan.w)[len(scan.w) - len(p.w) :])
        np.testing.assert_allclose(p.m, scan.m[heaviest])
        np.testing.assert_allclose(p.w, scan.w[heaviest] / scan.w[heaviest].sum())


@pytest.mark.parametrize(
    ("tracker", "more_than", "message"),
    [("pda", 1, "Pda has no reduction in a field"), ("runnalls-5", 400, "100 episodes have 0 of 1 mixtures")],
)
def test_a_tracker_without_a_reduction_and_too_few_mixtures_are_refused(tracker, more_than, message):
    with pytest.raises(ValueError, match=message):
        posteriors(SCENARIO, make_tracker(tracker, SCENARIO.model), 1, 0, more_than, 500)
