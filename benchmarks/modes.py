"""Rows on targets that switch between motions: trackers with modes, a radar, and clutter on the ground."""

from collections.abc import Iterator

import numpy as np
import plain
from problems import drawn, partition
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform
from timing import Plan, Row, interleaved, timed

from gmr_gym.evaluation.loop import play
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import Tracker
from gmr_gym.mixture import Mixture, matched
from gmr_gym.reduction.clustering import hierarchical
from gmr_gym.reduction.dissimilarity import dissimilarity
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.maybeck import agile_flight
from gmr_gym.scenarios.zhang import MARGIN, SCANS, START, jump_markov
from gmr_gym.simulation.single_target import Scenario, draw, scan

try:
    from filterpy.kalman import IMMEstimator, KalmanFilter
except ImportError:
    IMMEstimator = None

ACQUIRED = 5  # scans, until the first wide gates have closed


def mode_rows(plan: Plan) -> Iterator[Row]:
    yield from _scan_rows(plan)
    yield from _architecture_rows(plan)
    yield from _imm_rows(plan)
    yield from _radar_rows(plan)
    yield from _clustering_rows(plan)
    yield from _ground_rows(plan)


def plainly_merged(p: Mixture, components: int) -> Reduced:
    """Runnalls in plain compiled loops, as a tracker's reduction."""
    if len(p.w) <= components:
        return p, np.arange(len(p.w))
    origin = np.unique(plain.runnalls_compiled(p, components), return_inverse=True)[1]
    return matched(p, origin, components), origin


def _scan_rows(plan: Plan) -> Iterator[Row]:
    scenario = jump_markov("2")
    for name in ("mmg-15", "imm-mht-15"):
        ours = make_tracker(name, scenario.model)
        same = make_tracker(name, scenario.model, reduction=f"{__name__}:plainly_merged")
        given = _acquired(scenario, ours, 1 if plan.quick else 3)
        apart = max(np.abs(ours.step(*one)[1].x - same.step(*one)[1].x).max() for one in given)
        alternatives = {
            "ours": timed(lambda one, tracker=ours: tracker.step(*one), *given, clock=plan.clock),
            "plain": timed(lambda one, tracker=same: tracker.step(*one), *given, clock=plan.clock),
        }
        timings = interleaved(alternatives, len(given), rounds=1)
        yield Row(
            f"scan, {name}, five models, clutter 3e-4 per m², acquired", timings["ours"],
            "Runnalls in plain compiled loops", timings["plain"], f"estimates at most {apart:.0e} m apart",
        )  # fmt: skip


def _architecture_rows(plan: Plan) -> Iterator[Row]:
    scenario = agile_flight(horizon=60 if plan.quick else 200)
    for name, most in (("mmae-mht-15", 200), ("mmae-of-mhts-15", 100), ("mmg-15", 200)):
        greedy = make_tracker(name, scenario.model, reduction="runnalls", max_hypotheses=most)
        best = make_tracker(name, scenario.model, reduction="ise", max_hypotheses=most)
        given = _acquired(scenario, greedy, 1)
        alternatives = {
            "ours": timed(lambda one, tracker=best: tracker.step(*one), *given, clock=plan.clock),
            "runnalls": timed(lambda one, tracker=greedy: tracker.step(*one), *given, clock=plan.clock),
        }
        timings = interleaved(alternatives, len(given), rounds=1)
        yield Row(
            f"scan, {name} by ISE, an F-16, clutter 1e-4 per m²", timings["ours"], "the same by Runnalls",
            timings["runnalls"],
        )  # fmt: skip


def _acquired(scenario: Scenario, tracker: Tracker, episodes: int) -> list[tuple]:
    """Every third belief from acquisition on, each with the detections that come next."""
    found = []
    for seed in range(episodes):
        belief = tracker.init()
        for played in play(scenario, tracker, draw(scenario, seed)):
            if played.t >= ACQUIRED and played.t % 3 == 0:
                found.append((belief, played.scan.z))
            belief, _ = tracker.step(belief, played.scan.z)
    return found


def _imm_rows(plan: Plan) -> Iterator[Row]:
    scenario = jump_markov("clear")
    tracker = make_tracker("imm", scenario.model)
    z = [played.scan.z for played in play(scenario, tracker, draw(scenario, 0))]
    estimates = {}

    def ours():
        belief = tracker.init()
        for one in z:
            belief, report = tracker.step(belief, one)
        estimates["ours"] = report.x[0]

    def filterpys():
        bank = _filterpy(scenario)
        for one in z:
            bank.predict(u=np.ones(1))
            bank.update(one[0])
        estimates["FilterPy"] = bank.x

    alternatives = {"ours": ours} | ({"FilterPy": filterpys} if IMMEstimator else {})
    watches = {name: timed(run, clock=plan.clock) for name, run in alternatives.items()}
    per_scan = {name: lambda i, watch=watch: watch(i) / len(z) for name, watch in watches.items()}
    for run in alternatives.values():
        run()
    timings = interleaved(per_scan, 1, 3 if plan.quick else 10)
    note = "filterpy is not installed"
    if IMMEstimator:
        note = f"estimates {np.abs(estimates['ours'] - estimates['FilterPy'].ravel()).max():.0e} m apart"
    yield Row(
        "scan, IMM, five models, no clutter", timings["ours"], "FilterPy", timings.get("FilterPy"), note
    )


def _filterpy(scenario: Scenario):
    told, filters = scenario.model, []
    for F, Q, offset in told.motions:
        one = KalmanFilter(dim_x=4, dim_z=2, dim_u=1)
        one.x, one.P = told.prior.m[0].copy(), told.prior.P[0].copy()
        one.F, one.Q, one.B = F, Q, offset[:, None]
        one.H, one.R = told.sensor
        filters.append(one)
    return IMMEstimator(filters, told.mode_prior, told.switching.T)  # its rows are our columns


def _radar_rows(plan: Plan) -> Iterator[Row]:
    scenario = airborne_radar("far", horizon=60 if plan.quick else 300)
    same = make_tracker("imm-pda", scenario.model, update="debiased-at-prediction")
    in_numpy = make_tracker(
        "imm-dcm-pda-printed", scenario.model, covariance_as_printed=False, likelihood_as_printed=False
    )
    given = _acquired(scenario, same, 1)
    apart = max(np.abs(same.step(*one)[1].x - in_numpy.step(*one)[1].x).max() for one in given)
    trackers = {name: make_tracker(name, scenario.model) for name in ("imm-dcm-pda", "imm-ekf-pda")}
    trackers |= {"imm-pda:update=debiased-at-prediction": same, "NumPy": in_numpy}
    watches = {
        name: timed(lambda one, tracker=tracker: tracker.step(*one), *given, clock=plan.clock)
        for name, tracker in trackers.items()
    }
    timings = interleaved(watches, len(given), rounds=1 if plan.quick else 3)
    theirs = timings.pop("NumPy")
    for name, ours in timings.items():
        note = f"estimates at most {apart:.0e} m apart" if trackers[name] is same else "another update"
        yield Row(
            f"scan, {name}, two models, clutter 25", ours, "NumPy, debiased at the prediction", theirs, note
        )


def _clustering_rows(plan: Plan) -> Iterator[Row]:
    given = drawn(100, 4, 2 if plan.quick else 6)

    def scipys(p: Mixture) -> np.ndarray:
        tree = linkage(squareform(dissimilarity(p, "isd"), checks=False), "average")
        return fcluster(tree, 15, "maxclust") - 1

    same = sum(partition(hierarchical(p, 15)[1]) == partition(scipys(p)) for p in given)
    alternatives = {
        "ours": timed(lambda p: hierarchical(p, 15), *given, clock=plan.clock),
        "SciPy": timed(lambda p: matched(p, scipys(p), 15), *given, clock=plan.clock),
    }
    timings = interleaved(alternatives, len(given), rounds=2)
    yield Row(
        "average linkage on ISD, 4-D 100 to 15", timings["ours"], "SciPy's linkage on the same distances",
        timings["SciPy"], f"same clusters in {same} of {len(given)}",
    )  # fmt: skip


def _ground_rows(plan: Plan) -> Iterator[Row]:
    seen = jump_markov("2")
    whole = jump_markov("2", window=(2 * MARGIN + SCANS * 100, 2 * MARGIN + SCANS * 300))
    middle = np.array(START[:2]) + SCANS / 2 * np.array(START[2:])
    episode = draw(seen, 0)
    alternatives = {
        "ours": timed(lambda: scan(seen, episode, 20, episode.x[20, :2]), clock=plan.clock),
        "whole": timed(lambda: scan(whole, episode, 20, middle), clock=plan.clock),
    }
    timings = interleaved(alternatives, 1, 2 if plan.quick else 10)
    points = len(scan(seen, episode, 20, episode.x[20, :2]).z), len(scan(whole, episode, 20, middle).z)
    yield Row(
        "a scan of JumpMarkov, clutter 3e-4 per m²", timings["ours"], "the whole region drawn",
        timings["whole"], f"{points[0]} points, theirs {points[1]}",
    )  # fmt: skip
