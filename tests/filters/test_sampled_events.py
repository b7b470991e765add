"""Association events drawn by Gibbs sampling."""

from itertools import product

import numpy as np
import pytest

from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.sampled_events import sampled_events
from gmr_gym.scenarios.williams import meeting_targets
from gmr_gym.simulation.multi_target import draw, scan


def enumerated(psi):
    n, k = psi.shape
    events = {}
    for event in product(range(-1, k), repeat=n):
        taken = [j for j in event if j >= 0]
        weight = np.prod([psi[i, j] for i, j in enumerate(event) if j >= 0])
        if len(set(taken)) == len(taken) and weight > 0:
            events[event] = weight
    return events


@pytest.mark.parametrize("seed", range(10))
def test_after_many_sweeps_all_events_are_found_with_their_weights(seed):
    rng = np.random.default_rng(seed)
    psi = 10 ** rng.uniform(-1, 1, (3, 3)) * (rng.random((3, 3)) < 0.8)
    with np.errstate(divide="ignore"):
        events, log_weight = sampled_events(np.log(psi), 20_000, rng)
    truly = enumerated(psi)
    found = dict(zip(map(tuple, events.tolist()), np.exp(log_weight), strict=True))
    assert found.keys() == truly.keys() and (np.diff(log_weight) <= 0).all()
    assert all(found[event] == pytest.approx(weight) for event, weight in truly.items())


def test_few_sweeps_find_the_likely_events():
    psi = np.array([[1e3, 1.0], [1.0, 1e3]])
    events, _ = sampled_events(np.log(psi), 5, np.random.default_rng(0))
    assert events[0].tolist() == [0, 1] and len(events) <= 5


def test_weights_beyond_floating_point_are_no_trouble():
    events, log_weight = sampled_events(
        np.array([[900.0, -np.inf], [901.0, -950.0]]), 50, np.random.default_rng(0)
    )
    assert np.isfinite(log_weight).all()
    assert {tuple(e) for e in events.tolist()} <= {(-1, -1), (0, -1), (-1, 0)}


def said(name, seed):
    world = meeting_targets(truth_seed=1)
    tracker, episode = make_tracker(name, world.model, samples=50, seed=seed), draw(world, 0)
    belief, out = tracker.init(), []
    for t in range(12):
        belief, report = tracker.step(belief, scan(episode, t).z)
        out.append(report.expected_targets)
    return out


@pytest.mark.parametrize("name", ["delta-glmb", "pmbm"])
def test_a_seed_gives_one_run(name):
    assert said(name, 3) == said(name, 3) != said(name, 4)
