"""Tracks of what a tracker of many targets declares: their numbers, status and rows."""

import numpy as np

from gmr_gym.filters.bernoulli_tracks import outputs
from gmr_gym.filters.imm_tracks import Banks, carried
from gmr_gym.filters.pmb import LEAST_MISS
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.models.gating import gate_threshold
from gmr_gym.models.intervals import Mode
from gmr_gym.models.positions import Look
from gmr_gym.recorded.array_records import chosen, joined
from gmr_gym.recorded.model import TrackingModel
from gmr_gym.recorded.track_rules import reviewed, rules, started
from gmr_gym.recorded.track_state import Targets, initial_state
from gmr_gym.recorded.track_update import Seen, completed
from gmr_gym.recorded.tracks import DELETED, Tracks


class Declared:
    """Tracks of what a tracker declares, scan by scan; with one motion they coast where it declares them no
    more."""

    def __init__(self, model: TrackingModel):
        fastest = max(mode.deviation for mode in model.modes)
        self.model = model._replace(modes=(Mode("constant-velocity", fastest),))
        self.state = initial_state(self.model)
        self.label = np.empty(0, np.int64)  # the tracker's own, of each track
        self.motion, self.rules = self.model.bank(), rules(model)

    def update(
        self, time: float, z: np.ndarray, report: MultiTargetReport, R: np.ndarray, sensor: int
    ) -> Tracks:
        """Rows after a scan of positions z (k, p) with noise R (p, p)."""
        axes, (old, again, new) = self.model.axes, self._matched(report)
        x, P = report.x[:, : 2 * axes], _covariances(report)[:, : 2 * axes, : 2 * axes]
        existence = np.minimum(report.existence, 1.0)
        targets = self._missed(time, self.model.sensors[sensor].detection_probability)
        targets.banks.m[old, 0], targets.banks.P[old, 0] = x[again], P[again]
        targets.existence[old] = existence[again]
        seen, n = self._seen(targets, z, R), len(self.label)
        silent = np.isin(np.arange(n), old, invert=True)  # a detection in the gate is not taken for its own
        seen.best[silent], seen.weight[silent] = -1, 0.0
        at, none = np.full(len(z), time), np.full(len(z), np.nan)
        look = Look(time, at, z, none, np.zeros((len(z), 3)), np.ones(axes + 1), False)
        looked = (np.full(n, time), np.ones(n, bool)), look, sensor
        reviewed(targets, (0, n), self.rules, looked, (seen.weight, seen.best), (seen.x, seen.P))
        begun, born, first = self._begun(time, (x[new], P[new], existence[new]), z, R)
        self.label = np.append(self.label, report.label[new[first]])
        targets, seen = joined(targets, begun), joined(seen, born)
        self.label = self.label[targets.lives.status != DELETED]
        state = self.state._replace(time=time)
        self.state, rows = completed(state, targets, seen, np.arange(len(targets.existence)))
        return rows

    def _missed(self, time: float, detection_probability: float) -> Targets:
        """The targets at a time, as after a missed detection."""
        banks, existence, identity, lives = chosen(self.state.targets, np.arange(len(self.label)))
        r = existence * self.model.survival_probability ** (time - banks.time)
        r *= (1.0 - detection_probability) / np.maximum(1.0 - r * detection_probability, LEAST_MISS)
        return Targets(Banks(*carried(banks, self.motion, time, self.model.axes)), r, identity, lives)

    def _matched(self, report: MultiTargetReport) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Tracks that are declared again, their rows in the report, and the rows of new labels."""
        rows = np.flatnonzero(report.label >= 0)
        _, old, again = np.intersect1d(self.label, report.label[rows], return_indices=True)
        return old, rows[again], np.setdiff1d(rows, rows[again])

    def _seen(self, targets: Targets, z: np.ndarray, R: np.ndarray) -> Seen:
        """What the rows of tracks say, with the nearest detection in the gate as their own."""
        axes, existence = self.model.axes, targets.existence
        x, P = outputs(targets.banks, axes)
        off = z[None] - x[:, None, :axes]
        d2 = (off * np.linalg.solve(P[:, None, :axes, :axes] + R, off[..., None])[..., 0]).sum(axis=2)
        inside = d2 <= gate_threshold(self.model.gate_probability, axes)
        best = np.where(inside.any(axis=1), np.where(inside, d2, np.inf).argmin(axis=1) if len(z) else -1, -1)
        return Seen(
            x, P, inside.sum(axis=1), best, np.where(best >= 0, existence, 0.0), np.full(len(x), np.nan)
        )

    def _begun(
        self, time: float, states: tuple[np.ndarray, np.ndarray, np.ndarray], z: np.ndarray, R: np.ndarray
    ) -> tuple[Targets, Seen, np.ndarray]:
        """Tracks that begin, those with a detection alone, and which these are; states are x, P and
        existence."""
        (x, P, existence), n = states, len(states[0])
        times = np.full(n, time)
        banks = Banks(np.ones((n, 1)), x[:, None].copy(), P[:, None].copy(), times)
        targets = Targets(banks, existence, np.full(n, -1), started(x, P, times, self.model))
        targets.lives.look_time[:] = time
        seen = self._seen(targets, z, R)
        first = np.flatnonzero(seen.best >= 0)
        return chosen(targets, first), chosen(seen, first), first


def _covariances(report: MultiTargetReport) -> np.ndarray:
    """Covariance (j, d, d) of each declared target: that of the nearest Gaussian of the intensity."""
    m, P = report.intensity.m, report.intensity.P
    d2 = ((report.x[:, None] - m) ** 2).sum(axis=2)
    return P[d2.argmin(axis=1)] if len(m) and len(d2) else np.empty((0, *P.shape[1:]))
