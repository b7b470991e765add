"""The N-scan MHT, and N-scan merging in every tracker of many hypotheses."""

from functools import partial

import numpy as np
import pytest
import reference

from gmr_gym.baselines.mht import Mht, n_scan
from gmr_gym.baselines.pda import Pda
from gmr_gym.evaluation.montecarlo import run_once
from gmr_gym.filters.histories import parted_belief
from gmr_gym.filters.mht import predict_and_update
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import mixture
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.model import model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.reduction.protocol import grouped
from gmr_gym.reduction.pruning import prune, prune_density
from gmr_gym.reduction.runnalls import Greedy
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.zhang import jump_markov
from gmr_gym.simulation.single_target import draw, scan

UNPRUNED = {"prune_weight": 0.0, "prune_density": 0.0}
TURNING, JUMPING = turning_target(horizon=30), jump_markov()
OF_BANKS = ("imm-mht", "mmae-mht", "imm-of-mhts", "mmae-of-mhts", "one-motion", "mmg")


def episode_scans(scenario, seed, scans):
    episode = draw(scenario, seed)
    return [scan(scenario, episode, t, scenario.centre(episode.x[t])).z for t in range(scans)]


def reports(tracker, scans):
    belief, out = tracker.init(), []
    for z in scans:
        belief, report = tracker.step(belief, z)
        out.append(report)
    return out


def assert_alike(reports, others, rtol):
    for one, other in zip(reports, others, strict=True):
        assert len(one.mixture.w) == len(other.mixture.w)
        for a, b in zip(one[:2], other[:2], strict=True):
            np.testing.assert_allclose(a, b, rtol=rtol, atol=rtol)


def normalised(p):
    return p._replace(w=p.w / p.w.sum())


@pytest.mark.parametrize("parents", [1, 3])
def test_with_many_scans_nothing_is_merged_and_with_fewer_what_they_share(parents):
    rng = np.random.default_rng(parents)
    prior = mixture(*reference.random_mixture(rng, parents, 2))
    told = model(constant_velocity(1.0, 0.5, 1), position_sensor(2.0, 1), 0.8, 1.0, 0.02, prior)
    scans = [3 * rng.standard_normal((k, 1)) for k in (2, 1, 3)]
    for N in (9, 3, 2, 1):
        tracker = n_scan(told, scans=N, **UNPRUNED)
        belief = tracker.init()
        for t, z in enumerate(scans, 1):
            belief, report = tracker.step(belief, z)
            w, m, P, histories = reference.every_history(told, scans[:t])
            merged = {}
            for i, (start, _, chosen) in enumerate(histories):
                merged.setdefault(chosen[-N:] if t >= N else (start, *chosen), []).append(i)
            assert len(report.mixture.w) == len(merged)
            if t > 1 and N == 9:
                assert len(merged) == len(histories) and (belief.history[:, :t] >= -1).all()
            # merging does not change what is predicted and weighed of a hypothesis but through its moments:
            # the overall mean and covariance stay those of all histories until the first scan after a merge
            if t <= N:
                _, mean, covariance = reference.moment_match(w, m, P)
                np.testing.assert_allclose(report.x, [mean], rtol=1e-9, atol=1e-9)
                np.testing.assert_allclose(report.P, [covariance], rtol=1e-9, atol=1e-9)


def test_with_many_scans_it_is_the_mht_that_merges_nothing():
    scans = episode_scans(TURNING, 3, 6)
    whole = Mht(TURNING.model, Greedy(10**6), prune_weight=1e-6, prune_density=0.0)
    mine = reports(n_scan(TURNING.model, scans=50, prune_weight=1e-6, prune_density=0.0), scans)
    for one, other in zip(mine, reports(whole, scans), strict=True):
        for a, b in zip(one.mixture, other.mixture, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-12)
    assert len(mine[-1].mixture.w) > 100


def test_with_no_scans_it_is_the_pda_and_with_one_there_is_a_hypothesis_for_every_detection():
    single = run_once(TURNING, Pda(TURNING.model), 4)
    merged = run_once(TURNING, n_scan(TURNING.model, scans=0, **UNPRUNED), 4)
    np.testing.assert_allclose(single.x, merged.x, rtol=1e-8, atol=1e-8)
    assert (merged.components == 1).all()
    tracker = n_scan(TURNING.model, scans=1, **UNPRUNED)
    belief = tracker.init()
    for z in episode_scans(TURNING, 4, 8):
        full, _ = predict_and_update(belief.belief, TURNING.model, z)
        belief, _ = tracker.step(belief, z)
        np.testing.assert_array_equal(np.sort(belief.history[:, 0]), np.unique(full.detection))


@pytest.mark.parametrize(("scans", "gamma", "density"), [(2, 7e-4, 1e-10), (3, 1e-3, 1e-8), (1, 1e-4, 0.0)])
def test_it_equals_a_transparent_form(scans, gamma, density):
    told = TURNING.model
    tracker = n_scan(told, scans=scans, prune_weight=gamma, prune_density=density)
    belief, p, histories = tracker.init(), told.prior, [()]
    for z in episode_scans(TURNING, 5, 20):
        belief, report = tracker.step(belief, z)
        full, _ = predict_and_update(p, told, z)
        longer = [(*histories[i], j)[-scans:] for i, j in zip(full.parent, full.detection, strict=True)]
        likely, place = prune(full.mixture, gamma)
        names = {}
        group = [names.setdefault(longer[i], len(names)) for i in np.flatnonzero(place >= 0)]
        merged = normalised(grouped(normalised(likely), np.array(group), len(names)))
        kept, left = prune_density(merged, density)
        p, histories = normalised(kept), [history for history, j in zip(names, left, strict=True) if j >= 0]
        for mine, theirs in zip(report.mixture, p, strict=True):
            np.testing.assert_allclose(mine, theirs, rtol=1e-8, atol=1e-12)
        assert [
            tuple(row[: len(own)][::-1]) for row, own in zip(belief.history, histories, strict=True)
        ] == histories
    assert len(p.w) > 1


@pytest.mark.parametrize("name", OF_BANKS)
def test_in_every_tracker_no_scans_leave_one_hypothesis_and_many_scans_leave_all(name):
    made = partial(make_tracker, name, JUMPING.model, prune_weight=0.0, max_hypotheses=5000)
    scans = episode_scans(JUMPING, 2, 5)
    one = reports(made(components=1, reduction="n-scan:scans=0"), scans)
    assert_alike(one, reports(made(components=1), scans), 1e-7)
    many = made(components=5000, reduction="n-scan:scans=7")
    if name == "imm-of-mhts":  # its mixing merges
        return
    if name != "mmg":
        capped = made(components=5000, reduction="capping")
        assert_alike(reports(many, scans[:3]), reports(capped, scans[:3]), 1e-9)
        return
    belief, histories = many.init(), {0: ()}  # it merges motions
    for z in scans:
        belief, report, trace = many.trace(belief, z)
        rows = zip(trace.into.tolist(), trace.parent.tolist(), trace.detection.tolist(), strict=True)
        now = {(into, *histories[parent], j) for into, parent, j in rows if into >= 0}
        histories = {into: tuple(history) for into, *history in now}
        assert len(now) == len(set(histories.values())) == len(report.mixture.w)


@pytest.mark.parametrize("name", OF_BANKS)
def test_in_every_tracker_hypotheses_keep_the_detections_that_they_share(name):
    tracker = make_tracker(name, JUMPING.model, reduction="n-scan:scans=2", prune_weight=1e-4)
    belief = tracker.init()
    for z in episode_scans(JUMPING, 2, 12):
        belief, report, trace = tracker.trace(belief, z)
        _, histories = parted_belief(belief)
        histories = np.concatenate(histories) if isinstance(histories, tuple) else histories
        went = trace.into >= 0
        assert len(histories) == len(report.mixture.w)
        assert all(len(set(trace.detection[trace.into == j])) == 1 for j in set(trace.into[went]))
