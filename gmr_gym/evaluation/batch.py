"""Many runs of an MHT in one compiled call, each equal to the run alone to the last bit."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gmr_gym.filters.mht import expand_scan, gate_and_log_weights, reduce_scan
from gmr_gym.kernels import ONE, kernel
from gmr_gym.mixture import match
from gmr_gym.models.gating import mean_volume, outside_all_gates_kernel, unit_ball
from gmr_gym.models.kalman import Sensor
from gmr_gym.simulation.loss import detection_outside_gates, truth_outside_gates
from gmr_gym.simulation.philox import buffer_for
from gmr_gym.simulation.scans import TargetDetection, centre_into, scan_by
from gmr_gym.simulation.single_target import Episode, Scenario, scene_of


def can_batch(scenario: Scenario, tracker: Any) -> bool:
    """Whether `run_batch` can run this tracker in this scenario.

    It can where the tracker has `limits`, the sensors are linear, and the loss rule is one of
    `gmr_gym.simulation.loss`.

    Parameters
    ----------
    scenario : Scenario
    tracker : Tracker

    Returns
    -------
    bool
    """
    return (
        getattr(tracker, "limits", None) is not None
        and all(isinstance(s, Sensor) for s in (scenario.sensor, scenario.model.sensor, tracker.model.sensor))
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
        truth, x, P, components, gate_volume, gated and off_target, as in `Runs`.
    """
    model, prior = tracker.model, scenario.model.prior
    drawn = Episode(*map(np.array, zip(*episodes, strict=True)))
    x, own = drawn.x[:, :scans], _rule(scenario) is detection_outside_gates
    watched = drawn.z if own else _z_hat(scenario, x)
    runs, T, d = x.shape
    out = (
        np.empty((runs, T, d)), np.empty((runs, T, d, d)), np.empty((runs, T), int),
        np.empty((runs, T)), np.empty((runs, T)), np.empty((runs, T), bool),
    )  # fmt: skip
    told = model.motion[:], model.sensor[:], gate_and_log_weights(model)
    _play(
        scene_of(scenario), scenario.centre(prior.w @ prior.m), drawn,
        (tracker.init(), told, tracker.limits), watched, own, unit_ball(drawn.z.shape[2]), out,
    )  # fmt: skip
    return x, *out


def _rule(scenario: Scenario) -> Any:
    return getattr(scenario.loss_rule, "func", scenario.loss_rule)


def _z_hat(scenario: Scenario, x: np.ndarray) -> np.ndarray:
    """Noise-free measurements of the states x (runs, T, d), as `truth_outside_gates` computes them."""
    (H,) = scenario.loss_rule.args  # type: ignore[attr-defined]
    return np.array([[H @ state for state in run] for run in x])


@kernel
def _play(scene, start, episodes, tracker, watched, own, ball, out):
    """The loop of `gmr_gym.evaluation.loop` and the scoring of `montecarlo.run_once`, over the scans of all
    runs.

    `episodes` is an Episode of arrays over runs, and the first window of each is centred at `start` (p,).
    `tracker` holds the first belief, the model and the limits. `watched` (runs, T, p) is the point the loss
    rule looks for; where it is the target's own detection (`own`), a scan without one counts as off target.
    """
    # element by element: slices take long to compile
    x, P_out, components, volume, gated, off_target = out
    runs, T, d = x.shape
    belief, (motion, sensor, (threshold, log_miss, log_detect)), limits = tracker
    p, buffer = len(start), buffer_for(scene.capacity)
    z, centre = np.empty((scene.capacity, p)), np.empty(p)
    for i in range(runs):
        w, m, P = belief
        for c in range(p):
            centre[c] = start[c]
        for t in range(T):
            target = TargetDetection(episodes.z[i, t], episodes.detected[i, t], episodes.slot[i, t])
            k, place = scan_by(z, scene.field_of_view, episodes.key[i], t, centre, target, buffer)
            full, (centres, S, _) = expand_scan(
                (w, m, P), motion, sensor, z[:k], threshold, log_miss, log_detect
            )
            w, m, P = full.mixture
            hits = 0
            for j in full.detection:
                hits += j >= 0
            gated[i, t], volume[i, t] = hits / len(S), mean_volume(S, threshold, ball)
            off_target[i, t] = (own and place < 0) or outside_all_gates_kernel(
                centres, S, threshold, watched[i, t]
            )
            w, m, P, _, _ = reduce_scan(w, m, P, *limits)
            _, mean, covariance = match(w, m, P, np.zeros(len(w), np.int64), ONE)
            components[i, t] = len(w)
            for r in range(d):
                x[i, t, r] = mean[0, r]
                for c in range(d):
                    P_out[i, t, r, c] = covariance[0, r, c]
            centre_into(centre, scene.window_motion, x[i, t])
