"""Truths drawn at once are those that numpy's generator draws scan by scan."""

import numpy as np
import pytest

from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.maybeck import agile_flight
from gmr_gym.scenarios.paths import moving_by_model
from gmr_gym.scenarios.zhang import jump_markov


def scan_by_scan(assumed, mode, rng):
    w, m, P = assumed.prior
    first = rng.choice(len(w), p=w) if len(w) > 1 else 0
    x = rng.multivariate_normal(m[first], P[first], method="cholesky")
    states = []
    for p in mode:
        F, Q, offset = assumed.motions[p]
        x = rng.multivariate_normal(F @ x + offset, Q, method="eigh")
        states.append(x)
    return np.array(states)


@pytest.mark.parametrize(
    "scenario",
    [jump_markov(), jump_markov(discretisation="standard"), airborne_radar(), agile_flight()],
    ids=["singular noise", "standard", "nine states", "two motions"],
)
def test_states_are_those_drawn_scan_by_scan(scenario):
    assumed = scenario.model
    for seed in range(20):
        mode = np.random.default_rng(seed).integers(0, len(assumed.motions), 30)
        one, other = np.random.default_rng(seed), np.random.default_rng(seed)
        truth = moving_by_model(assumed, mode, one)
        # as other libraries may round otherwise
        np.testing.assert_allclose(truth.x, scan_by_scan(assumed, mode, other), rtol=1e-11, atol=1e-8)
        assert one.random() == other.random() and (truth.mode == mode).all()


def test_a_drawn_flights_modes_are_a_markov_chain_drawn_scan_by_scan():
    scenario = agile_flight(trajectory="drawn", horizon=300)
    assumed, modes = scenario.model, np.arange(len(scenario.model.motions))
    for seed in range(20):
        rng, chain = np.random.default_rng(seed), []
        now = rng.choice(modes, p=assumed.mode_prior)
        for _ in range(300):
            now = rng.choice(modes, p=assumed.switching[:, now])
            chain.append(now)
        assert scenario.truth(np.random.default_rng(seed)).mode.tolist() == chain
