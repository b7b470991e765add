"""Rows on targets that switch between motions: trackers with modes, a radar, and clutter on the ground."""

from collections.abc import Callable, Iterator

import numpy as np
import plain
from problems import drawn, partition
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform
from timing import Plan, Row, compared, timed

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
    yield from _imm_rows(plan)
    yield from _radar_rows(plan)
    yield from _clustering_rows(plan)
    yield from _ground_rows(plan)


def runnalls_plainly(p: Mixture, components: int) -> Reduced:
    """Runnalls in plain compiled loops, as a tracker's reduction."""
    return _merged(p, components, plain.runnalls_compiled)


def williams_plainly(p: Mixture, components: int) -> Reduced:
    """Williams' reduction in plain compiled loops, as a tracker's reduction."""
    return _merged(p, components, plain.williams_compiled)


def _merged(p: Mixture, components: int, form: Callable) -> Reduced:
    if len(p.w) <= components:
        return p, np.arange(len(p.w))
    names, origin = np.unique(form(p, components), return_inverse=True)
    origin -= int(names[0] < 0)  # those deleted come first
    q = matched(p, origin, components)
    return q._replace(w=q.w * (p.w.sum() / q.w.sum())), origin


REDUCTIONS = {"runnalls": runnalls_plainly, "ise": williams_plainly}


def _scan_rows(plan: Plan) -> Iterator[Row]:
    jumping = jump_markov("2"), "five models, clutter 3e-4 per m²"
    flying = agile_flight(horizon=60), "an F-16, clutter 1e-4 per m²"
    for name, (scenario, where), most in (
        ("mmg-15", jumping, 500), ("imm-mht-15", jumping, 500), ("mmae-mht-15", flying, 500),
        ("mmae-of-mhts-15", flying, 100),
    ):  # fmt: skip
        for reduction, form in REDUCTIONS.items():
            ours, same = (
                make_tracker(name, scenario.model, reduction=each, max_hypotheses=most)
                for each in (reduction, f"{__name__}:{form.__name__}")
            )
            given = _acquired(scenario, ours)[::5]
            apart = max(np.abs(ours.step(*one)[1].x - same.step(*one)[1].x).max() for one in given)
            what = f"scan, {name} by {reduction}, {where}, acquired"
            note = f"estimates at most {apart:.0e} m apart"
            watches = timed(ours.step, given), timed(same.step, given)
            yield compared(plan, what, watches[0], "the same in plain compiled loops", watches[1], note)


def _acquired(scenario: Scenario, tracker: Tracker) -> list[tuple]:
    """Every third belief from acquisition on, each with the detections that come next."""
    belief, found = tracker.init(), []
    for played in play(scenario, tracker, draw(scenario, 0)):
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

    what = "scan, IMM, five models, no clutter"
    if not IMMEstimator:
        yield Row(what, "FilterPy", note="filterpy is not installed")
        return
    ours(), filterpys()
    note = f"estimates {np.abs(estimates['ours'] - estimates['FilterPy'].ravel()).max():.0e} m apart"
    yield compared(plan, what, timed(ours, parts=len(z)), "FilterPy", timed(filterpys, parts=len(z)), note)


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
    scenario = airborne_radar("far", horizon=100)
    same = make_tracker("imm-pda", scenario.model, update="debiased-at-prediction")
    in_numpy = make_tracker(
        "imm-dcm-pda-printed", scenario.model, covariance_as_printed=False, likelihood_as_printed=False
    )
    given = _acquired(scenario, same)
    apart = max(np.abs(same.step(*one)[1].x - in_numpy.step(*one)[1].x).max() for one in given)
    trackers = {name: make_tracker(name, scenario.model) for name in ("imm-dcm-pda", "imm-ekf-pda")}
    theirs = "NumPy, debiased at the prediction"
    for name, ours in (trackers | {"imm-pda:update=debiased-at-prediction": same}).items():
        ours.step(*given[0])  # compiles
        note = f"estimates at most {apart:.0e} m apart" if ours is same else "another update"
        what = f"scan, {name}, two models, clutter 25"
        yield compared(plan, what, timed(ours.step, given), theirs, timed(in_numpy.step, given), note)


def _clustering_rows(plan: Plan) -> Iterator[Row]:
    given = [(p,) for p in drawn(100, 4, 2)]

    def ours(p: Mixture) -> np.ndarray:
        return hierarchical(p, 15)[1]

    def scipys(p: Mixture) -> np.ndarray:
        tree = linkage(squareform(dissimilarity(p, "isd"), checks=False), "average")
        return fcluster(tree, 15, "maxclust") - 1

    same = sum(partition(ours(*one)) == partition(scipys(*one)) for one in given)
    theirs = timed(lambda p: matched(p, scipys(p), 15), given)
    what, against = "average linkage on ISD, 4-D 100 to 15", "SciPy's linkage on the same distances"
    note = f"same clusters in {same} of {len(given)}"
    yield compared(plan, what, timed(ours, given), against, theirs, note)


def _ground_rows(plan: Plan) -> Iterator[Row]:
    seen = jump_markov("2")
    whole = jump_markov("2", window=(2 * MARGIN + SCANS * 100, 2 * MARGIN + SCANS * 300))
    middle = np.array(START[:2]) + SCANS / 2 * np.array(START[2:])
    episode = draw(seen, 0)
    ours, theirs = (seen, episode, 20, episode.x[20, :2]), (whole, episode, 20, middle)
    note = f"{len(scan(*ours).z)} points, theirs {len(scan(*theirs).z)}"
    what, against = "a scan of JumpMarkov, clutter 3e-4 per m²", "the whole region drawn"
    yield compared(plan, what, timed(scan, [ours]), against, timed(scan, [theirs]), note)
