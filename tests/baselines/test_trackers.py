"""Trackers against exact posteriors, against each other, and against whatever a sensor may send."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import reference
from scipy.stats import chi2

from gmr_gym.baselines.clairvoyant import Clairvoyant
from gmr_gym.baselines.mht import Mht, runnalls
from gmr_gym.baselines.nearest_neighbour import NearestNeighbour
from gmr_gym.baselines.pda import Pda
from gmr_gym.evaluation.metrics import nees
from gmr_gym.evaluation.montecarlo import run, run_once
from gmr_gym.filters.filter_bank import no_interaction
from gmr_gym.filters.registry import make_tracker, trackers
from gmr_gym.filters.tracker import Report
from gmr_gym.mixture import gaussian, mixture, moments
from gmr_gym.models.kalman import Motion, position_sensor
from gmr_gym.models.model import model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.switching import sticky_switching
from gmr_gym.reduction.pruning import capping
from gmr_gym.scenarios.dortenzio import turning_target

WORLD = reference.world_of_its_word()
TOLD = turning_target().model
F, Q, _ = TOLD.motions[0]
# the same target, that may also speed up along x, or along y and with little noise; seldom back
SWITCHING = TOLD._replace(
    motions=(
        *TOLD.motions,
        Motion(F, Q, np.array([2.0, 0.0, 4.0, 0.0])),
        Motion(F, 0.01 * Q, np.array([0.0, -2.0, 0.0, -4.0])),
    ),
    switching=np.array([[0.7, 0.1, 0.0], [0.2, 0.8, 0.1], [0.1, 0.1, 0.9]]),
    mode_prior=np.array([0.5, 0.3, 0.2]),
)
KNOW_ONE_MOTION = {
    "adaptive", "adaptive-noise", "capping", "cluster", "ise", "learned-cluster", "learned-n-scan",
    "learned-thresholds", "mht", "n-scan", "nearest-neighbour", "pda", "runnalls", "salmond", "west",
}  # fmt: skip


OF_A_RADAR = {"imm-dcm-pda", "imm-dcm-pda-printed", "imm-ekf-pda"}
OF_ANY_SENSOR = set(trackers()) - OF_A_RADAR
SET_THE_NOISE = {"adaptive-noise", "learned-cluster", "learned-n-scan"}  # other than the filter model's


def knows_origin(tracker):
    return getattr(tracker, "knows_origin", False)


def everything_kept(p):
    return p, np.arange(len(p.w))


def small_model(axes, parents=1):
    """A model with endless gates, its prior a mixture, over scans that a hand can enumerate."""
    rng = np.random.default_rng(axes)
    prior = mixture(*reference.random_mixture(rng, parents, 2 * axes))
    return model(constant_velocity(1.0, 0.5, axes), position_sensor(2.0, axes), 0.8, 1.0, 0.02, prior)


@pytest.mark.parametrize("axes", [1, 2])
@pytest.mark.parametrize(("parents", "sizes"), [(1, (2, 1, 3)), (2, (1, 0, 2, 2)), (3, (3, 2, 0))])
def test_unreduced_mht_equals_enumerating_every_association(axes, parents, sizes):
    told = small_model(axes, parents)
    rng = np.random.default_rng(sum(sizes))
    scans = [3 * rng.standard_normal((k, axes)) for k in sizes]
    tracker = Mht(told, everything_kept, prune_weight=0.0, prune_density=0.0)
    belief = tracker.init()
    for t, z in enumerate(scans, 1):
        belief, report = tracker.step(belief, z)
        w, m, P, histories = reference.every_history(told, scans[:t])
        assert len(belief.w) == len(histories)
        mine, theirs = np.argsort(belief.w), np.argsort(w)  # no two weights are equal
        # products of a few likelihoods and small inverses: rounding, with room
        np.testing.assert_allclose(belief.w[mine], w[theirs], rtol=1e-9)
        np.testing.assert_allclose(belief.m[mine], m[theirs], rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(belief.P[mine], P[theirs], rtol=1e-8, atol=1e-8)
        _, mean, covariance = reference.moment_match(w, m, P)
        np.testing.assert_allclose(report.x, [mean], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(report.P, [covariance], rtol=1e-9, atol=1e-9)


def test_mht_prunes_by_weight_then_reduces_then_prunes_by_density():
    seen = []

    def spy(p):
        seen.append(p)
        return p, np.arange(len(p.w))

    told, z = small_model(1), np.array([[0.0], [1.0], [8.0]])
    w, _, _, _ = reference.every_history(told, [z])
    w, bound = np.sort(w), np.sort(w)[1:3].mean()  # between the second and the third lightest
    belief, report = Mht(told, spy, prune_weight=bound, prune_density=0.0).step(told.prior, z)
    np.testing.assert_allclose(np.sort(seen[-1].w), w[2:] / w[2:].sum(), rtol=1e-9)
    assert report.mixture is belief and len(belief.w) == 2
    Mht(told, spy, prune_weight=0.0, prune_density=0.0, max_hypotheses=3).step(told.prior, z)
    np.testing.assert_allclose(np.sort(seen[-1].w), w[1:] / w[1:].sum(), rtol=1e-9)
    belief, _ = Mht(told, spy, prune_weight=0.0, prune_density=1e9).step(told.prior, z)
    assert len(seen[-1].w) == 4 and belief.w.tolist() == [1.0]


@pytest.mark.parametrize("pruning", [0.0, 1e-3])
def test_capping_is_the_mht_whose_reduction_caps(pruning):
    world = turning_target(horizon=30)
    mine = run_once(world, make_tracker("capping-7", world.model, prune_weight=pruning), 4)
    reduce = partial(capping, components=7)
    theirs = run_once(world, Mht(world.model, reduce, pruning, prune_density=0.0), 4)
    # weights rescaled before capping or after
    np.testing.assert_allclose(mine.x, theirs.x, rtol=1e-9)
    np.testing.assert_allclose(mine.P, theirs.P, rtol=1e-9)
    assert (mine.components == theirs.components).all() and mine.components.max() == 7


@pytest.mark.parametrize("clutter_rate", [20, 150])
def test_pda_is_the_mht_merged_down_to_one(clutter_rate):
    world = turning_target(clutter_rate=clutter_rate, horizon=30)
    single = run_once(world, Pda(world.model), 4)
    merged = run_once(world, runnalls(world.model, 1, prune_weight=0.0, prune_density=0.0), 4)
    # the same moments summed in another order, over thirty scans
    np.testing.assert_allclose(single.x, merged.x, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(single.P, merged.P, rtol=1e-7, atol=1e-7)
    assert (single.gated.sum() > 30) and (single.components == 1).all()


def test_nearest_neighbour_takes_the_nearest_by_the_innovations_own_measure():
    # P stretched along x: the Euclidean nearest is not the nearest
    told = TOLD._replace(prior=gaussian(np.zeros(4), np.diag([1e4, 1, 1, 1])))
    tracker = NearestNeighbour(told)
    m, P = reference.kalman_predict(told.prior.m[0], told.prior.P[0], *told.motions[0])
    z = np.array([[0.0, 20.0], [60.0, 0.0], [0.0, -25.0], [5000.0, 0.0]])
    belief, report = tracker.step(tracker.init(), z)
    m_hit, P_hit = reference.kalman_update(m, P, *told.sensor, z[1])
    np.testing.assert_allclose(report.x[0], m_hit, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(belief.P[0], P_hit, rtol=1e-9, atol=1e-7)
    _, coasting = tracker.step(tracker.init(), z[3:])
    np.testing.assert_allclose(coasting.x[0], m, atol=1e-12)
    np.testing.assert_allclose(coasting.P[0], P, rtol=1e-12)


def test_without_clutter_and_with_sure_detection_every_tracker_is_the_kalman_filter():
    world = replace(WORLD, clutter_rate=0.0, detection_probability=1.0)
    told = world.model._replace(detection_probability=1.0, gate_probability=1.0, clutter_density=1e-12)
    bound = run_once(world, Clairvoyant(told), 2)
    for name in OF_ANY_SENSOR - SET_THE_NOISE:
        got = run_once(world, make_tracker(name, told), 2)
        # the same arithmetic in another order, over ten scans of coordinates of some 100 m
        np.testing.assert_allclose(got.x, bound.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(got.P, bound.P, rtol=1e-9, atol=1e-9)


@pytest.fixture(scope="module")
def calibrated():
    """Errors squared by the covariance claimed, runs x scans, where the world is as told."""
    told = WORLD.model
    built = {
        "clairvoyant": Clairvoyant(told),
        "mht": runnalls(told, 60, prune_weight=1e-6, prune_density=0.0),
        "nearest": NearestNeighbour(told),
    }
    results = run(WORLD, built, 300, seed=1)
    return {name: nees(runs.x - runs.truth, runs.P) for name, runs in results.items()}


def test_clairvoyant_filter_meets_its_own_covariance(calibrated):
    runs, scans = calibrated["clairvoyant"].shape
    # at each scan the sum over independent runs is exactly chi-square; 1e-6 over all the scans
    low, high = chi2.ppf([5e-7 / scans, 1 - 5e-7 / scans], 4 * runs)
    total = calibrated["clairvoyant"].sum(axis=0)
    assert (total > low).all() and (total < high).all()


def test_mht_meets_its_own_covariance_where_the_nearest_neighbour_boasts(calibrated):
    for name, honest in (("mht", True), ("nearest", False)):
        average = calibrated[name].mean(axis=1)  # one figure a run: scans of a run are not independent
        standard_error = average.std() / np.sqrt(len(average))
        assert (abs(average.mean() - 4) < 4 * standard_error) == honest
    assert calibrated["nearest"].mean() > 4


def test_clairvoyant_refuses_two_detections():
    tracker = Clairvoyant(TOLD)
    with pytest.raises(ValueError, match="the target's detection alone, got 2"):
        tracker.step(tracker.init(), np.zeros((2, 2)))


def test_trackers_lists_the_projects_own_with_a_sentence_each():
    found = trackers()
    with_modes = {"b-best", "clairvoyant", "gpb1", "gpb2", "imm", "imm-mht", "imm-pda", "mmg"}
    assert KNOW_ONE_MOTION | with_modes <= set(found)
    assert all(len(sentence) > 20 for sentence in found.values())


def test_number_at_the_end_of_a_name_is_the_most_components_it_keeps():
    world = turning_target(horizon=25)
    components = run_once(world, make_tracker("runnalls-7", world.model), 0).components
    assert components.max() == 7
    assert run_once(world, make_tracker("runnalls", world.model, components=3), 0).components.max() == 3
    with pytest.raises(ValueError, match="components is given twice, as 7 in the name and as 2"):
        make_tracker("runnalls-7", world.model, components=2)


@pytest.mark.parametrize(
    ("name", "parameters", "message"),
    [
        ("runnals-30", {}, "unknown tracker 'runnals-30'; did you mean 'runnalls'"),
        ("nearest", {}, "unknown tracker 'nearest'.*installed: adaptive, adaptive-noise, b-best, capping"),
        ("", {}, "unknown tracker ''"),
        ("runnalls", {"component": 3}, "no parameter 'component'; it takes components, prune_weight"),
        ("imm-mth-5", {}, "unknown tracker 'imm-mth-5'; did you mean 'imm-mht'"),
        ("pda-5", {}, "tracker 'pda' takes no parameter 'components'; it takes none"),
        ("runnalls-0", {}, "components must be at least 1, got 0"),
        ("adaptive", {"loss_bound": 2.0}, r"loss_bound must lie in \[0, 1\]"),
        ("capping", {"prune_weight": -1.0}, "prune_weight must be non-negative"),
        ("capping", {"prune_density": np.nan}, "prune_density must be non-negative"),
        ("clairvoyant", {"components": 0}, "components must be at least 1, got 0"),
        ("clairvoyant", {"components": 1j}, "components must be at least 1, got 1j"),
        ("mmg", {"max_hypotheses": np.inf}, "max_hypotheses must be a whole number, at least 1, got inf"),
    ],
)
def test_make_tracker_says_what_is_wrong_and_what_there_is(name, parameters, message):
    with pytest.raises(ValueError, match=message):
        make_tracker(name, TOLD, **parameters)


def test_mht_needs_room_for_one_hypothesis():
    with pytest.raises(ValueError, match="max_hypotheses must be a whole number, at least 1, got 0"):
        Mht(TOLD, partial(capping, components=3), max_hypotheses=0)


@pytest.mark.parametrize("name", sorted(KNOW_ONE_MOTION))
def test_tracker_that_knows_one_motion_refuses_several(name):
    with pytest.raises(ValueError, match=r"knows one motion and the model has 3.*imm-pda, imm-mht or mmg"):
        make_tracker(name, SWITCHING)


def checked(report, d=4):
    """The report, sound: finite, of the right shapes, with covariances that are covariances."""
    assert isinstance(report, Report)
    assert report.x.shape == (1, d) and report.P.shape == (1, d, d)
    assert np.isfinite(report.x).all()
    np.testing.assert_allclose(report.P[0], report.P[0].T, rtol=1e-12)
    np.linalg.cholesky(report.P[0])
    assert report.mixture.w.sum() == pytest.approx(1, rel=1e-12) and (report.mixture.w > 0).all()
    mean, _ = moments(report.mixture)
    np.testing.assert_allclose(report.x[0], mean, rtol=1e-9, atol=1e-9)
    return report


def arrays(belief):
    """Every array of a belief, whatever records it is made of, and every number as one."""
    if np.isscalar(belief) or isinstance(belief, np.ndarray):
        return [np.asarray(belief)]
    return [array for part in belief for array in arrays(part)]


@pytest.fixture(params=sorted(OF_ANY_SENSOR - SET_THE_NOISE))
def of_one_motion(request):
    return make_tracker(request.param, TOLD)


@pytest.fixture(
    params=[
        pytest.param((name, told), id=f"{name} of {len(told.motions)}")
        for told, names in ((TOLD, OF_ANY_SENSOR), (SWITCHING, OF_ANY_SENSOR - KNOW_ONE_MOTION))
        for name in sorted(names)
    ]
)
def tracker(request):
    return make_tracker(*request.param)


@pytest.mark.parametrize(
    ("z", "message"),
    [
        ([[np.nan, 0.0]], "z must be finite; row 0 is not"),
        ([[0.0, 0.0], [0.0, np.inf]], "z must be finite; row 1 is not"),
        ([[1.0, 2.0], [3.0]], r"z must be numbers of shape \(k, 2\)"),
        ([["a", "b"]], "z must be numbers"),
        ([[1.0 + 2.0j, 0.0]], "z must be numbers"),
        ([1.0, 2.0], r"z must have shape \(k, 2\)"),
        ([[1.0, 2.0, 3.0]], r"z must have shape \(k, 2\)"),
        (np.zeros((1, 1, 2)), r"z must have shape \(k, 2\)"),
    ],
)
def test_bad_scan_is_refused(tracker, z, message):
    with pytest.raises(ValueError, match=message):
        tracker.step(tracker.init(), z)


def test_step_remembers_nothing_and_changes_neither_belief_nor_scan(tracker):
    rng = np.random.default_rng(0)
    z = 10 * rng.standard_normal((1 if knows_origin(tracker) else 8, 2))
    belief, _ = tracker.step(tracker.init(), z)
    kept = [a.copy() for a in arrays(belief)], z.copy()
    once, again = tracker.step(belief, z), tracker.step(belief, z)
    for a, b in zip(arrays(once[0]), arrays(again[0]), strict=True):
        np.testing.assert_array_equal(a, b)
    for a, b in zip(arrays(belief), kept[0], strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(z, kept[1])
    checked(once[1])


def test_ten_thousand_detections_in_a_scan_are_stood(tracker):
    rng = np.random.default_rng(1)
    belief = tracker.init()
    for _ in range(2):
        z = 60 * rng.standard_normal((1 if knows_origin(tracker) else 10_000, 2))
        belief, report = tracker.step(belief, z)
        checked(report)


def test_ten_thousand_detections_with_nothing_pruned_are_cut_to_the_heaviest_first():
    z = 60 * np.random.default_rng(1).standard_normal((10_000, 2))
    tracker = make_tracker("runnalls-30", TOLD, prune_weight=0.0)
    _, report = tracker.step(tracker.init(), z)
    assert len(checked(report).mixture.w) == 30


@pytest.mark.parametrize("gate_probability", [0.999, 1.0])
def test_detections_far_from_the_prior_are_stood(tracker, gate_probability):
    tracker = replace(tracker, model=tracker.model._replace(gate_probability=gate_probability))
    belief = tracker.init()
    for distance in (1e6, 1e7, -1e7):
        belief, report = tracker.step(belief, np.array([[distance, 0.0]]))
        checked(report)


def test_two_hundred_empty_scans_are_stood(tracker):
    belief = tracker.init()
    for _ in range(200):
        belief, report = tracker.step(belief, np.empty((0, 2)))
    checked(report)


def test_two_hundred_empty_scans_only_spread_the_belief(of_one_motion):
    tracker, m, P = of_one_motion, TOLD.prior.m[0], TOLD.prior.P[0]
    belief = tracker.init()
    for _ in range(200):
        belief, report = tracker.step(belief, np.empty((0, 2)))
        m, P = reference.kalman_predict(m, P, *TOLD.motions[0])
    # sums of two hundred terms: rounding, with room
    np.testing.assert_allclose(report.x[0], m, rtol=1e-9)
    np.testing.assert_allclose(report.P[0], P, rtol=1e-9)


def test_a_mixture_as_prior_is_no_hindrance(tracker):
    prior = mixture([0.3, 0.7], [[0.0] * 4, [50.0, 0, 0, 0]], [np.eye(4)] * 2)
    told = tracker.model._replace(prior=prior)
    tracker = replace(tracker, model=told)
    _, report = tracker.step(tracker.init(), np.empty((0, 2)))
    ahead = [reference.kalman_predict(*moments(prior), *move) for move in told.motions]
    # an MMAE takes the target not to switch
    switches = getattr(tracker, "mixing", getattr(tracker, "before", None) is not no_interaction)
    chances = told.switching @ told.mode_prior if switches else told.mode_prior
    _, m, P = reference.moment_match(chances, *map(np.array, zip(*ahead, strict=True)))
    np.testing.assert_allclose(checked(report).x[0], m, atol=1e-9)
    np.testing.assert_allclose(report.P[0], P, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"motions": ()}, "motions must hold at least one Motion"),
        ({"motions": constant_velocity(1.0, 1.0, axes=3)}, r"motions\[0\] has 6 states"),
        ({"motions": (*TOLD.motions, constant_velocity(1.0, 1.0, axes=3))}, r"motions\[1\] has 6 states"),
        ({"prior": gaussian([0.0], [[1.0]])}, "prior has 1 states"),
        ({"prior": TOLD.prior._replace(w=np.array([0.5]))}, "prior weights sum to 0.5"),
        ({"detection_probability": 0.0}, r"detection_probability must lie in \(0, 1\]"),
        ({"detection_probability": np.nan}, r"detection_probability must lie in \(0, 1\]"),
        ({"gate_probability": 1.01}, r"gate_probability must lie in \(0, 1\]"),
        ({"clutter_density": 0.0}, "clutter_density must be positive and finite.*very small density"),
        ({"clutter_density": np.inf}, "clutter_density must be positive and finite"),
        ({"clutter_density": 1e-310}, "clutter_density must be positive and finite, 2.23e-308 or more"),
    ],
)
def test_model_that_does_not_fit_together_is_refused_by_name(change, message):
    assert model(**TOLD._asdict()).prior is TOLD.prior
    with pytest.raises(ValueError, match=message):
        model(**TOLD._asdict() | change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"switching": None}, "switching must be given for 3 motions"),
        ({"switching": sticky_switching(0.9, 2)}, r"switching must have shape \(3, 3\), got \(2, 2\)"),
        ({"switching": SWITCHING.switching.T}, "its rows do, so pass the transpose"),
        ({"mode_prior": [0.5, 0.5]}, r"mode_prior must be 3 probabilities that sum to 1, got \[0\.5, 0\.5\]"),
        ({"mode_prior": [0.5, 0.4, 0.0]}, "mode_prior must be 3 probabilities that sum to 1"),
        ({"mode_prior": [1.2, -0.2, 0.0]}, "mode_prior must be 3 probabilities that sum to 1"),
        ({"mode_prior": [np.nan, 0.5, 0.5]}, "mode_prior must be 3 probabilities that sum to 1"),
    ],
)
def test_modes_that_do_not_fit_the_motions_are_refused_by_name(change, message):
    with pytest.raises(ValueError, match=message):
        model(**SWITCHING._asdict() | change)


def test_one_motion_needs_no_switching_and_modes_are_alike_unless_told():
    one = model(**TOLD._asdict() | {"switching": None, "mode_prior": None})
    assert one.switching.tolist() == [[1.0]] and one.mode_prior.tolist() == [1.0]
    assert one.motion is one.motions[0]
    several = model(**SWITCHING._asdict() | {"mode_prior": None})
    assert several.mode_prior == pytest.approx([1 / 3] * 3)
    with pytest.raises(ValueError, match="knows one motion and the model has 3: choose one with modes"):
        _ = several.motion
