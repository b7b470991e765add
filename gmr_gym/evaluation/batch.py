"""Many runs of a tracker in one compiled call, each equal to the run alone to the last bit."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.models.gating import mean_volume, outside_all_gates_kernel, unit_ball
from gmr_gym.models.kalman import Sensor
from gmr_gym.simulation.loss import detection_outside_gates, truth_outside_gates
from gmr_gym.simulation.philox import buffer_for
from gmr_gym.simulation.scans import TargetDetection, centre_into, scan_by
from gmr_gym.simulation.single_target import Episode, Scenario, scene_of


def can_batch(scenario: Scenario, tracker: Any) -> bool:
    """Whether `run_batch` can run this tracker in this scenario.

    It can where the tracker has a `gmr_gym.filters.tracker.CompiledTracker`, the sensors are linear, and the
    loss rule is one of `gmr_gym.simulation.loss`.

    Parameters
    ----------
    scenario : Scenario
    tracker : Tracker

    Returns
    -------
    bool
    """
    return (
        getattr(tracker, "compiled", None) is not None
        and all(isinstance(s, Sensor) for s in (scenario.sensor, scenario.model.sensor))
        and _rule(scenario) in (truth_outside_gates, detection_outside_gates)
    )


def run_batch(
    scenario: Scenario, tracker: Any, episodes: Sequence[Episode], scans: int | None = None
) -> tuple[np.ndarray, ...]:
    """Run one tracker through many episodes in one compiled call.

    Parameters
    ----------
    scenario : Scenario
    tracker : Tracker
        One for which `can_batch` holds.
    episodes : sequence of Episode
    scans : int, optional
        Number of scans to run; all by default.

    Returns
    -------
    tuple of ndarray
        truth, x, P, components, gate_volume, gated, off_target and modes, as in `Runs`.
    """
    scan, told, belief = tracker.compiled
    prior = scenario.model.prior
    drawn = Episode(*map(np.array, zip(*episodes, strict=True)))
    x, own = drawn.x[:, :scans], _rule(scenario) is detection_outside_gates
    watched = drawn.z if own else _z_hat(scenario, x)
    (runs, T, d), r = x.shape, len(tracker.model.motions)
    out = (
        np.empty((runs, T, d)), np.empty((runs, T, d, d)), np.empty((runs, T), int),
        np.empty((runs, T)), np.empty((runs, T)), np.empty((runs, T), bool), np.empty((runs, T, r)),
    )  # fmt: skip
    _loop(scan)(
        scene_of(scenario), scenario.centre(prior.w @ prior.m), drawn, (told, belief), watched, own,
        unit_ball(drawn.z.shape[2]), out,
    )  # fmt: skip
    return x, *out


def _rule(scenario: Scenario) -> Any:
    return getattr(scenario.loss_rule, "func", scenario.loss_rule)


def _z_hat(scenario: Scenario, x: np.ndarray) -> np.ndarray:
    """Noise-free measurements of the states x (runs, T, d), as `truth_outside_gates` computes them."""
    (H,) = scenario.loss_rule.args  # type: ignore[attr-defined]
    return np.array([[H @ state for state in run] for run in x])


@lru_cache
def _loop(scan: Callable) -> Callable:
    """The compiled loop of a `CompiledTracker`, from its scan.

    It is the loop of `gmr_gym.evaluation.loop` and the scoring of `montecarlo.run_once`, over the scans of
    all runs. `episodes` is an Episode of arrays over runs, and the first window of each is centred at `start`
    (p,). `tracker` is what the scan is told and the first belief. `watched` (runs, T, p) is the point the
    loss rule looks for; where it is the target's own detection (`own`), a scan without one counts as off
    target.
    """

    @kernel
    def play(scene, start, episodes, tracker, watched, own, ball, out):
        # element by element: slices take long to compile
        x, P, components, volume, gated, off_target, modes = out
        told, first = tracker
        runs, T, d = x.shape
        p, buffer = len(start), buffer_for(scene.capacity)
        z, centre = np.empty((scene.capacity, p)), np.empty(p)
        for i in range(runs):
            belief = first
            for c in range(p):
                centre[c] = start[c]
            for t in range(T):
                target = TargetDetection(episodes.z[i, t], episodes.detected[i, t], episodes.slot[i, t])
                k, place = scan_by(z, scene.field_of_view, episodes.key[i], t, centre, target, buffer)
                belief, report, hits = scan(told, belief, z[:k])
                centres, S, threshold = report.gates
                gated[i, t], volume[i, t] = hits / len(S), mean_volume(S, threshold, ball)
                lost = (own and place < 0) or outside_all_gates_kernel(centres, S, threshold, watched[i, t])
                off_target[i, t] = not report.alive or lost
                components[i, t] = len(report.mixture.w)
                for r in range(d):
                    x[i, t, r] = report.x[0, r]
                    for c in range(d):
                        P[i, t, r, c] = report.P[0, r, c]
                for r in range(len(report.modes)):
                    modes[i, t, r] = report.modes[r]
                centre_into(centre, scene.window_motion, x[i, t])

    return play
