"""Scans of MHTs whose thresholds are set from outside, many episodes in one call.

An episode is a record, and n of them are an array (n,): the target and its detections, the filter model, and
the posterior that waits for its thresholds.
"""

import numba
import numpy as np

from gmr_gym.filters.mht import MAX_HYPOTHESES
from gmr_gym.kernels import kernel, together
from gmr_gym.reduction.n_scan import extended
from gmr_gym.reduction.pruning import above_threshold, heaviest_mask
from gmr_gym.simulation.reward import distance, score
from gmr_gym.simulation.scans import View, centre_into, scan_into
from gmr_gym.simulation.single_target import Episode, Scenario, capacity, view_of
from gmr_gym.tuning.assumed import assumed, processed, selected
from gmr_gym.tuning.features import FEATURES, Memory
from gmr_gym.tuning.hindsight import FORESEEN, hindsight, lookahead
from gmr_gym.tuning.instances import SCANS
from gmr_gym.tuning.recent import MEMORY, at_first
from gmr_gym.tuning.thresholds import (
    DEPTH,
    N_SCAN,
    RANGES,
    REDUCERS,
    reduced,
)

LEAST = RANGES["prune"][0]  # hypotheses that weigh less enter no reduction
EPISODE = np.dtype(
    [
        # the scenario
        ("x", "f8", (SCANS, 4)),
        ("z", "f8", (SCANS, 2)),  # detections of the target
        ("slot", "f8", (SCANS,)),
        ("lookahead", "f8", (SCANS, FORESEEN)),  # see `hindsight.lookahead`
        ("key", "u4", (2,)),
        ("clutter_rate", "f8"),
        ("low", "f8", (2,)),
        ("high", "f8", (2,)),
        ("capacity", "i8"),  # detections
        ("position", "i8", (2,)),  # which states are coordinates
        ("cutoff", "f8"),  # m
        # the filter model
        ("prior", "f8", (1, 4)),
        ("prior_covariance", "f8", (1, 4, 4)),
        ("F", "f8", (4, 4)),
        ("Q", "f8", (4, 4)),
        ("offset", "f8", (4,)),
        ("H", "f8", (2, 4)),
        ("R", "f8", (2, 2)),
        ("log_weights", "f8", (3,)),  # see `gate_and_log_weights`
        ("assumed", "f8", (3,)),  # P_D, P_G, clutter density
        ("known", "f8", (3,)),
        ("reducer", "i8"),  # its place among `REDUCERS`
        ("price", "f8"),  # of a unit of work
        # the state of the episode
        ("t", "i8"),  # the scan, from 0, that waits for its thresholds; -1 before the first is processed
        ("scans", "i8"),  # in all; where t equals it, no episode is running
        ("scans_off", "i8"),  # scans in a row beyond the cutoff
        ("hypotheses", "i8"),  # of the posterior that may enter a reduction
        ("w", "f8", (MAX_HYPOTHESES,)),
        ("m", "f8", (MAX_HYPOTHESES, 4)),
        ("P", "f8", (MAX_HYPOTHESES, 4, 4)),
        ("history", "i8", (MAX_HYPOTHESES, DEPTH)),  # detections, see `reduction.n_scan.extended`
        ("recent", "f8", (MEMORY,)),  # see `recent`
        ("cost", "f8"),  # of merging all of the posterior
        ("gated", "i8"),  # Gaussians updated
        ("kept", "i8"),  # of the scan before: see `Memory`
        ("relative_loss", "f8"),
        ("work", "i8"),
        ("detected", "u1", (SCANS,)),
        ("limits_view", "u1"),
    ],
    align=True,
)
STEP = np.dtype(
    [
        ("reward", "f8"),
        ("error", "f8"),  # m
        ("work", "i8"),
        ("components", "i8"),
        ("thresholds", "f8", (len(RANGES),)),
        ("terminated", "?"),
        ("truncated", "?"),
    ],
    align=True,
)


def begin(
    episode: np.ndarray, scenario: Scenario, drawn: Episode, reducer: str = "adaptive", price: float = 0.0
) -> None:
    """Write an episode to its record. Its first scan is not processed yet.

    Parameters
    ----------
    episode : ndarray of EPISODE ()
        Overwritten.
    scenario : Scenario
        Of `instances.world`.
    drawn : Episode
    reducer : str
        One of `REDUCERS`.
    price : float
        Of a unit of work.
    """
    view, model, n = view_of(scenario), scenario.model, scenario.horizon
    episode["x"][:n], episode["z"][:n], episode["slot"][:n] = drawn.x, drawn.z, drawn.slot
    episode["detected"][:n], episode["key"] = drawn.detected, drawn.key
    for name in ("clutter_rate", "low", "high", "limits_view"):
        episode[name] = getattr(view, name)
    episode["lookahead"][:n] = lookahead(scenario, drawn)
    episode["capacity"] = capacity(view.clutter_rate)
    episode["position"], episode["cutoff"] = scenario.position, scenario.cutoff
    episode["prior"], episode["prior_covariance"] = model.prior.m, model.prior.P
    motion, sensor, *rest = assumed(model)
    episode["F"], episode["Q"], episode["offset"] = motion
    episode["H"], episode["R"] = sensor
    episode["log_weights"], episode["assumed"], episode["known"] = rest
    episode["reducer"], episode["price"] = list(REDUCERS).index(reducer), price
    episode["recent"] = at_first(1 - model.detection_probability * model.gate_probability)
    episode["t"], episode["scans"], episode["scans_off"] = -1, n, 0
    episode["kept"], episode["relative_loss"], episode["work"] = 1, 0.0, 0


def stepped(
    episodes: np.ndarray,
    rows: np.ndarray,
    thresholds: np.ndarray,
    steps: np.ndarray,
    observations: np.ndarray,
    seen: np.ndarray,
) -> None:
    """Reduce the posteriors of episodes by thresholds, and process their next scans.

    An episode that has just begun only has its first scan processed: there is no posterior to reduce yet.

    Parameters
    ----------
    episodes : ndarray of EPISODE (n,)
        Overwritten.
    rows : ndarray of int
        The episodes to step.
    thresholds : ndarray (n, 9)
        As `Thresholds`; the factors hold for the scan that is processed.
    steps : ndarray of STEP (n,)
        Receives the results.
    observations : ndarray (n, k)
        Receives features of the next scan, zeros where the episode is over.
    seen : ndarray of int
        Their places among ALL_FEATURES. HINDSIGHT follows where there is room.
    """
    threads = max(1, min(numba.config.NUMBA_NUM_THREADS, len(rows)))  # type: ignore[attr-defined]
    if threads > 1:  # sorted by work, so that each thread has about as much to merge
        rows = rows[np.argsort(-episodes["hypotheses"][rows], kind="stable")]
    shares = [rows[first::threads].copy() for first in range(threads)]
    together(step, [(episodes, share, thresholds, steps, observations, seen) for share in shares], threads)


@kernel(nogil=True)
def step(episodes, rows, thresholds, steps, observations, seen):
    """`stepped` for one thread's rows."""
    for i in rows:
        e = episodes[i]
        w, m, P, estimate = np.ones(1), e.prior[:], e.prior_covariance[:], e.prior[0]
        history = np.zeros((1, DEPTH), np.int64)
        if e.t >= 0:
            n = e.hypotheses
            w, m, P, estimate, _, e.relative_loss, e.work, history = reduced(
                e.reducer, e.w[:n], e.m[:n], e.P[:n], e.history[:n], thresholds[i], e.cost, e.gated
            )
            e.kept = len(w)
            pay(e, estimate, thresholds[i], steps[i])
        e.t += 1
        observations[i] = 0.0
        if e.t < e.scans:
            look(e, (w, m, P), history, estimate, thresholds[i], observations[i], seen)


@kernel
def pay(e, estimate, thresholds, out):
    """Scores the estimate (d,) of the current scan to `out`, in units of the cutoff; a loss moves the episode
    to its end.
    """
    left, error = e.scans - e.t - 1, distance(estimate, e.x[e.t], e.position)
    out.reward, e.scans_off, out.terminated, out.truncated = score(
        error / e.cutoff, 1.0, e.price * e.work, e.scans_off, left
    )
    out.error, out.work, out.components = error, e.work, e.kept
    for i in range(len(thresholds)):
        out.thresholds[i] = thresholds[i]
    if out.terminated:
        e.t += left


@kernel
def look(e, belief, history, estimate, thresholds, observation, seen):
    """Predicts the belief to the current scan and updates it by the detections, under the factors among the
    thresholds; writes the features (k,) in `seen`.

    The window is centred by the estimate (d,).
    """
    p, t = len(e.R), e.t
    centre = np.empty(p)
    centre_into(centre, (e.F[:], e.offset[:], e.H[:]), estimate)
    view = View(e.clutter_rate, e.low[:], e.high[:], e.limits_view > 0, None)
    z = np.empty((e.capacity, p))
    k, _ = scan_into(z, view, e.key[:], t, centre, e.z[t], e.detected[t] > 0, e.slot[t])
    told = (
        (e.F[:], e.Q[:], e.offset[:]), (e.H[:], e.R[:]), e.log_weights[:], e.assumed[:], e.known[:]
    )  # fmt: skip
    memory, every = Memory(e.kept, e.relative_loss, e.work), seen.max() >= len(FEATURES)
    hypotheses, _, features, e.cost, e.gated = processed(
        (belief, history), z[:k], told, thresholds, memory, e.recent[:], e.price, every
    )
    for f in range(len(seen)):
        observation[f] = features[seen[f]]
    w = hypotheses[0]
    if len(observation) > len(seen):
        full = selected(hypotheses, w >= 0.0)
        observation[len(seen) :] = hindsight(
            full[:3], e.H[:], e.log_weights[0], e.x[t], e.scans - t, e.scans_off, e.lookahead[t]
        )
    kept = heaviest_mask(w, len(e.w)) & above_threshold(w, w, LEAST)
    w, m, P, parent, detection = selected(hypotheses, kept)
    e.hypotheses = n = len(w)
    if e.reducer == N_SCAN:
        e.history[:n] = extended(history, parent, detection)
    e.w[:n], e.m[:n], e.P[:n] = w, m, P
