"""Targets followed through a look by the association of the model's `tracker`."""

from typing import Any

import numpy as np

from gmr_gym.filters.bernoulli_tracks import Bernoullis, Origins, concluded, judged, outputs
from gmr_gym.filters.pmb import LEAST_MISS
from gmr_gym.filters.track_associations import RULES, Rule
from gmr_gym.models.intervals import Modes
from gmr_gym.models.positions import Look
from gmr_gym.recorded.track_leaves import Leaves, grown
from gmr_gym.recorded.track_rules import follow, reviewed

Beam = tuple[np.ndarray, np.ndarray]  # when it passes each target, and whether a miss then counts


def followed(
    tracker: str, targets: Any, leaves: tuple[Leaves, ...], assumed: tuple, look: Look, origins: Origins,
    beam: Beam, sensor: int,
) -> tuple[np.ndarray, np.ndarray, tuple, tuple[Leaves, ...]]:  # fmt: skip
    """`track_rules.follow` of all targets, in place, with associations by the tracker of this name.

    Returns positions and velocities, covariances, the fields of `Associated`, and the leaves.
    """
    whole = 0, len(targets.existence)
    if tracker == "pmb":
        return *follow(targets, whole, assumed, look, origins, beam, sensor), leaves
    modes, rules, survival = assumed
    looked = beam[1] * origins.detection_probability
    if leaves:
        grew, found = grown(leaves[0], targets, modes, survival, look, origins, looked)
        leaves = (grew,)
    else:
        targets.existence[:] *= survival ** (look.time - targets.banks.time)
        found = _associated(RULES[tracker], targets, modes, look, origins, looked)
    x, P = outputs(targets.banks, look.z.shape[1])
    reviewed(targets, whole, rules, (beam, look, sensor), (found[1], found[3]), (x, P))
    return x, P, found, leaves


def _associated(
    rule: Rule, targets: Any, modes: Modes, look: Look, origins: Origins, looked: np.ndarray
) -> tuple:
    """The targets updated, in place; the fields of `Associated`."""
    tracks = Bernoullis(targets.banks, targets.existence, targets.identity, looked)
    predicted, pairs, gated = judged(tracks, modes, look, origins)
    miss = np.maximum(1.0 - targets.existence * looked, LEAST_MISS)
    assigned, missed, unassigned = rule(*pairs[:3], targets.existence, miss, len(look.at))
    hit, best, weight, nis = concluded(tracks, modes, look, (predicted, pairs), (assigned, missed))
    return unassigned, hit, gated, best, weight, nis
