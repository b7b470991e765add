"""What the alternatives are given: mixtures that a tracker met, drawn mixtures, scans."""

import numpy as np

from gmr_gym.baselines.mht import Mht
from gmr_gym.evaluation.loop import play
from gmr_gym.mixture import Mixture, normalised
from gmr_gym.reduction.pruning import capping
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.single_target import Scenario, draw, scan


def posteriors(n: int, components: int, clutter_rate: float, count: int) -> list[Mixture]:
    """Full posteriors that a tracker which does not prune had to reduce to `components`, of n to
    1.5 n hypotheses, cut to the n heaviest; no more than two from one run."""
    scenario = turning_target(clutter_rate=clutter_rate)
    found: list[Mixture] = []
    seed = 0
    while len(found) < count:
        met: list[Mixture] = []

        def reduce(p: Mixture, met=met):
            met.append(p)
            return runnalls(p, components)

        tracker = Mht(scenario.model, reduce, prune_weight=0.0, prune_density=0.0)
        for _ in play(scenario, tracker, draw(scenario, seed)):
            pass
        fitting = [p for p in met if n <= len(p.w) <= 1.5 * n]
        found += fitting[:: max(1, len(fitting) // 2)][:2]
        seed += 1
    return [normalised(capping(p, n)[0]) for p in found[:count]]


def drawn(n: int, d: int, count: int, concentration: float = 1.0) -> list[Mixture]:
    """Random mixtures; a large concentration makes the weights nearly equal."""
    rng = np.random.default_rng(n)
    return [
        Mixture(
            rng.dirichlet(np.full(n, concentration)),
            3.0 * rng.standard_normal((n, d)),
            A @ A.transpose(0, 2, 1) + 0.3 * np.eye(d),
        )
        for A in rng.standard_normal((count, n, d, d))
    ]


def scans(scenario: Scenario, seed: int, count: int) -> list[np.ndarray]:
    """The first detections of an episode, the same for every tracker: the window must be fixed."""
    episode = draw(scenario, seed)
    return [scan(scenario, episode, t, np.zeros(2)).z for t in range(count)]


def partition(origin: np.ndarray) -> set[frozenset[int]]:
    """Sets of inputs that were merged into one output."""
    return {frozenset(np.flatnonzero(origin == i).tolist()) for i in np.unique(origin[origin >= 0])}
