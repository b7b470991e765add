"""Reductions, the IMM and trackers as components of Stone Soup give the numbers that they give here."""

import importlib
import tomllib
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stonesoup.base", reason="needs stonesoup, of the extra stonesoup")
from stonesoup.dataassociator.neighbour import NearestNeighbour
from stonesoup.deleter.error import CovarianceBasedDeleter
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.gaussianmixture import GaussianMixtureHypothesiser
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToElevationBearingRange
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.simulator.simple import SimpleDetectionSimulator, SingleTargetGroundTruthSimulator
from stonesoup.smoother.kalman import KalmanSmoother
from stonesoup.tracker.pointprocess import PointProcessMultiTargetTracker
from stonesoup.tracker.simple import SingleTargetTracker as TheirTracker
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import GaussianState, TaggedWeightedGaussianState
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate
from stonesoup.updater.kalman import KalmanUpdater
from stonesoup.updater.pointprocess import PHDUpdater

from gmr_gym import make_tracker, model
from gmr_gym.catalogue import reductions
from gmr_gym.mixture import gaussian, mixture
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.kalman import motion, position_sensor, sensor
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.models.radar import radar
from gmr_gym.reduction import reducer
from gmr_gym.stonesoup import (
    ImmPredictor,
    ImmUpdater,
    MhtTracker,
    MultiTargetTracker,
    PdaTracker,
    PriorInitiator,
    Reducer,
    ScanReader,
    SingleTargetTracker,
    components_of,
    detections_of,
    measurement_model_of,
    mixture_of,
    motion_of,
    transition_model_of,
)

ROOT = Path(__file__).parents[2]
START, SECOND = datetime(2024, 5, 1), timedelta(seconds=1)
CLOSE = dict(rtol=1e-9, atol=1e-9)
SMALL = mixture(
    [0.3, 0.25, 0.2, 0.15, 0.1],
    [[0.0, 0.0], [1.0, 0.5], [6.0, 5.0], [6.5, 5.5], [-4.0, 2.0]],
    [np.diag([1.0, 2.0]), np.eye(2), np.eye(2), [[2.0, 0.5], [0.5, 1.0]], np.eye(2)],
)
SENSOR = LinearGaussian(4, (0, 2), 25.0 * np.eye(2))
MOTIONS = [CombinedLinearGaussianTransitionModel([ConstantVelocity(q)] * 2) for q in (0.1, 20.0)]
PRIOR = GaussianState([0.0, 10.0, 0.0, -5.0], np.diag([100.0, 25.0, 100.0, 25.0]), START)
MODEL_PROBS = np.array([[0.9, 0.1], [0.3, 0.7]])  # by rows, as Stone Soup has them
DENSITY = 2e-5


def own_model(motions=1, prior=PRIOR, **changes):
    """The filter model of these, made here without the bridge."""
    parts = [[[1, 1], [0, 1]]] * 2
    F = np.zeros((4, 4))
    F[:2, :2], F[2:, 2:] = parts
    Q = np.kron(np.eye(2), [[1 / 3, 1 / 2], [1 / 2, 1]])
    each = tuple(motion(F, q * Q) for q in (0.1, 20.0)[:motions])
    H = np.eye(4)[[0, 2]]
    given = dict(detection_probability=0.9, gate_probability=0.999, clutter_density=DENSITY) | changes
    start = gaussian(np.ravel(prior.state_vector).astype(float), np.array(prior.covar))
    switching = MODEL_PROBS.T if motions > 1 else None
    return model(each, sensor(H, 25.0 * np.eye(2)), prior=start, switching=switching, **given)


def scans(count, clutter=8, seed=0):
    """Scans of a target that turns, in clutter."""
    rng = np.random.default_rng(seed)
    for t in range(1, count + 1):
        target = np.array([10.0 * t, -5.0 * t + 0.4 * t**2])
        yield np.vstack([target + 5 * rng.normal(size=2), target + rng.uniform(-150, 150, (clutter, 2))])


# the plug-in


def test_stone_soup_finds_the_plug_in():
    points = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    assert points["stonesoup.plugins"] == {"gmr_gym": "gmr_gym.stonesoup"}
    plugins = importlib.import_module("stonesoup.plugins")
    found = plugins.entry_points(group="stonesoup.plugins")
    if "gmr_gym" not in {point.name for point in found}:
        pytest.skip("the package was installed before it had the entry point")
    assert importlib.import_module("stonesoup.plugins.gmr_gym").Reducer is Reducer


# reductions


@pytest.mark.parametrize("name", reductions())
def test_every_reduction_gives_its_own_mixture(name):
    ours, _ = reducer(name, 2)(SMALL)
    theirs = mixture_of(Reducer(name, 2).reduce(components_of(SMALL, START)))
    for a, b in zip(ours, theirs, strict=True):
        np.testing.assert_allclose(b, a, **CLOSE)


def test_a_merged_component_has_the_tag_of_its_heaviest_and_no_tag_is_there_twice():
    given = components_of(SMALL, START, ["a", "b", "c", "b", "a"])
    left = Reducer("runnalls", 3).reduce(given)
    assert all(isinstance(one, TaggedWeightedGaussianState) for one in left)
    near = {int(np.round(one.state_vector[0])): one for one in left}
    assert near[0].tag == "a" and near[6].tag == "c" and near[-4].tag not in {"a", "b", "c"}
    assert [one.timestamp for one in left] == [START] * 3
    assert [one.weight for one in given] == SMALL.w.tolist()  # what is given stays as it was


def test_weights_may_exceed_one_and_light_components_are_dropped_first():
    heavy = SMALL._replace(w=5 * SMALL.w)
    left = Reducer("runnalls", 1).reduce(components_of(heavy))
    assert left[0].weight == pytest.approx(5)
    assert len(Reducer("capping", 9, prune_threshold=0.12).reduce(components_of(SMALL))) == 4
    assert len(Reducer("vo-ma", 9, merge_threshold=1.5).reduce(components_of(SMALL))) == 3
    assert Reducer().reduce([]) == []


def test_an_unknown_reduction_is_refused_when_the_reducer_is_made():
    with pytest.raises(ValueError, match="unknown reduction 'runnals'; did you mean 'runnalls'"):
        Reducer("runnals", 3)


def test_the_reducer_serves_their_phd_filter():
    updater = KalmanUpdater(SENSOR)
    distances = DistanceHypothesiser(KalmanPredictor(MOTIONS[0]), updater, Mahalanobis(), missed_distance=4)
    birth = TaggedWeightedGaussianState(
        PRIOR.state_vector, PRIOR.covar, START, weight=0.3, tag=TaggedWeightedGaussianState.BIRTH
    )
    found = [(START + t * SECOND, detections_of(z, START + t * SECOND)) for t, z in enumerate(scans(6, 3), 1)]
    tracker = PointProcessMultiTargetTracker(
        detector=found,
        updater=PHDUpdater(updater, clutter_spatial_density=3e-5, prob_detection=0.9, prob_survival=0.99),
        hypothesiser=GaussianMixtureHypothesiser(distances, order_by_detection=True),
        reducer=Reducer("runnalls", 5),
        birth_component=birth,
    )
    for _ in tracker:
        assert 1 <= len(tracker.gaussian_mixture) <= 5
    (best,) = tracker.extracted_target_states
    np.testing.assert_allclose(best.state_vector[[0, 2], 0].ravel(), [60, -15.6], atol=15)


# the IMM


def test_the_imm_gives_the_numbers_of_ours():
    """Without clutter and misses ours is the IMM; in their loop of predictor, hypothesis and updater."""
    imm = make_tracker("imm", own_model(2, detection_probability=1.0, gate_probability=1.0))
    predictor, updater = ImmPredictor(MOTIONS, MODEL_PROBS), ImmUpdater(SENSOR)
    belief, track = imm.init(), Track([PRIOR])
    for t, z in enumerate(scans(12, clutter=0), 1):
        belief, report = imm.step(belief, z)
        (detection,) = detections_of(z, START + t * SECOND)
        prediction = predictor.predict(track, timestamp=detection.timestamp)
        track.append(updater.update(SingleHypothesis(prediction, detection)))
        np.testing.assert_allclose(np.array(track.mean, float).ravel(), report.x[0], **CLOSE)
        np.testing.assert_allclose(np.array(track.covar, float), report.P[0], **CLOSE)
        np.testing.assert_allclose(np.array(track.weights, float), report.modes, **CLOSE)


def test_the_predicted_measurement_is_of_all_models_and_serves_their_trackers():
    predictor, updater = ImmPredictor(MOTIONS, MODEL_PROBS, [0.6, 0.4]), ImmUpdater(SENSOR)
    state = predictor.predict(PRIOR, START + SECOND)
    assert predictor.predict(PRIOR, START + SECOND) is state  # hypothesisers ask for every detection
    H, measured = np.eye(4)[[0, 2]], updater.predict_measurement(state)
    np.testing.assert_allclose(measured.covar, H @ state.covar @ H.T + 25 * np.eye(2), **CLOSE)
    np.testing.assert_allclose(measured.cross_covar, state.covar @ H.T, **CLOSE)
    quiet = updater.predict_measurement(state, measurement_noise=False)
    np.testing.assert_allclose(measured.covar - quiet.covar, 25 * np.eye(2), **CLOSE)
    hypothesiser = DistanceHypothesiser(predictor, updater, Mahalanobis(), missed_distance=5)
    tracker = TheirTracker(
        PriorInitiator(PRIOR), CovarianceBasedDeleter(np.inf),
        [(START, set()), *((START + t * SECOND, detections_of(z, START + t * SECOND))
                           for t, z in enumerate(scans(10), 1))],
        NearestNeighbour(hypothesiser), updater,
    )  # fmt: skip
    for _, tracks in tracker:
        (track,) = tracks
    assert len(track) == 11 and len(track.components) == 2
    np.testing.assert_allclose(np.ravel(track.mean)[[0, 2]].astype(float), [100, -10], atol=15)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (dict(model_probs=MODEL_PROBS.T), "model_probs must be 2 rows of 2 probabilities that sum to 1"),
        (dict(model_probs=None), "row i those after model i, got None"),
        (dict(mode_prior=[0.5, 0.6]), "mode_prior must be 2 probabilities that sum to 1"),
    ],
)
def test_probabilities_of_an_imm_that_do_not_sum_to_one_are_refused(given, message):
    with pytest.raises(ValueError, match=message):
        ImmPredictor(**{"transition_model": MOTIONS, "model_probs": MODEL_PROBS} | given)


# trackers of one target


@pytest.mark.parametrize(
    ("made", "name", "parameters", "motions"),
    [
        (MhtTracker, "mht", {"components": 5}, 1),
        (MhtTracker, "mht", {"components": 4, "reduction": "west"}, 1),
        (PdaTracker, "pda", {}, 1),
        (SingleTargetTracker, "runnalls-30", {}, 1),
        (SingleTargetTracker, "imm-pda", {}, 2),
    ],
)
def test_a_tracker_gives_the_numbers_of_ours(made, name, parameters, motions):
    ours = make_tracker(name, own_model(motions), **parameters)
    each = list(scans(10))
    tracker = made(
        prior=PRIOR, transition_model=MOTIONS if motions > 1 else MOTIONS[0], measurement_model=SENSOR,
        clutter_spatial_density=DENSITY, model_probs=MODEL_PROBS if motions > 1 else None, tracker=name,
        parameters=parameters, detector=ScanReader(each, np.arange(1.0, 11.0), START, SENSOR),
    )  # fmt: skip
    belief, states = ours.init(), 1
    for (time, tracks), z in zip(tracker, each, strict=True):
        belief, report = ours.step(belief, z)
        (track,) = tracks
        states += 1
        assert len(track) == states and track.timestamp == time
        np.testing.assert_allclose(track.state_vector.ravel(), report.x[0], **CLOSE)
        np.testing.assert_allclose(track.covar, report.P[0], **CLOSE)
        kept = mixture_of(track.components)
        np.testing.assert_allclose(np.sort(kept.w), np.sort(report.mixture.w), **CLOSE)


def pda_tracker(**changes):
    given = dict(
        prior=PRIOR, transition_model=MOTIONS[0], measurement_model=SENSOR, clutter_spatial_density=DENSITY
    )
    return PdaTracker(**given | changes)


def test_states_tell_updates_from_predictions_and_name_the_detections_in_the_gate():
    tracker = pda_tracker()
    near = Detection(StateVector([10.0, -5.0]), START + SECOND, metadata={"identity": "A"})
    far = Detection(StateVector([900.0, 900.0]), START + SECOND, metadata={"identity": "B"})
    tracker.update_tracker(START + SECOND, {near, far})
    state = tracker.track.state
    assert isinstance(state, GaussianStateUpdate) and not isinstance(state, GaussianStatePrediction)
    (hypothesis,) = state.hypothesis
    assert hypothesis.measurement is near
    theirs = KalmanPredictor(MOTIONS[0]).predict(PRIOR, timestamp=START + SECOND)
    np.testing.assert_allclose(hypothesis.prediction.covar, theirs.covar, **CLOSE)
    assert tracker.track.metadata == {"identity": "A"}
    tracker.update_tracker(START + 2 * SECOND, set())
    assert isinstance(tracker.track.state, GaussianStatePrediction)
    assert tracker.track.metadata == {"identity": "A"}
    assert len(tracker.track.metadatas) == len(tracker.track) == 3


@pytest.mark.parametrize("name", ["pda", "mht", "one-motion"])
def test_scans_at_irregular_times_are_predicted_over_their_intervals(name):
    tracker, times = pda_tracker(tracker=name), [0.0, 0.5, 2.0, 2.25]
    for time, z in zip(times, scans(4), strict=True):
        at = START + time * SECOND
        tracker.update_tracker(at, detections_of(z, at))
    belief, last = make_tracker(name, own_model()).init(), 0.0
    for time, z in zip(times, scans(4), strict=True):
        moved = own_model()._replace(motions=(motion_of(MOTIONS[0], (time - last) * SECOND),))
        belief, report = make_tracker(name, moved).step(belief, z)
        last = time
    np.testing.assert_allclose(tracker.track.state_vector.ravel(), report.x[0], **CLOSE)


def test_their_smoother_smooths_our_tracks():
    """With one detection in every gate, the PDA is the Kalman filter, and the smoothed states are its."""
    tracker = pda_tracker(prob_detect=1.0, prob_gate=1 - 1e-12)
    for t, z in enumerate(scans(6, clutter=0), 1):
        tracker.update_tracker(START + t * SECOND, detections_of(z, START + t * SECOND))
    smoothed = KalmanSmoother(MOTIONS[0]).smooth(tracker.track)
    predictor, updater, theirs = KalmanPredictor(MOTIONS[0]), KalmanUpdater(SENSOR), Track([PRIOR])
    for t, z in enumerate(scans(6, clutter=0), 1):
        (detection,) = detections_of(z, START + t * SECOND)
        prediction = predictor.predict(theirs, timestamp=detection.timestamp)
        theirs.append(updater.update(SingleHypothesis(prediction, detection)))
    for ours, other in zip(smoothed, KalmanSmoother(MOTIONS[0]).smooth(theirs), strict=True):
        np.testing.assert_allclose(ours.state_vector, other.state_vector, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(ours.covar, other.covar, rtol=1e-6, atol=1e-6)


def test_a_track_that_is_given_up_is_no_track_any_more():
    tracker = SingleTargetTracker(
        prior=PRIOR, transition_model=MOTIONS, measurement_model=SENSOR, clutter_spatial_density=1e-2,
        model_probs=MODEL_PROBS, tracker="imm-pda", parameters={"give_up_ratio": 1.0},
    )  # fmt: skip
    for t in range(1, 8):
        _, tracks = tracker.update_tracker(START + t * SECOND, set())
    assert tracks == set() and len(tracker.track) == 8


def test_a_radar_is_tracked_in_states_of_any_order():
    """Theirs are [x, vx, y, vy, z, vz], ours positions first; elevation comes first in their detections."""
    R = np.diag([0.01**2, 0.02**2, 10.0**2])
    sees = CartesianToElevationBearingRange(6, (0, 2, 4), R)
    moves = CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0)] * 3)
    mean = np.array([1000.0, 10.0, 500.0, 5.0, 200.0, 0.0])
    prior = GaussianState(mean, np.diag([100.0, 25.0] * 3), START)
    tracker = PdaTracker(
        prior=prior, transition_model=moves, measurement_model=sees, clutter_spatial_density=1e-6
    )
    order = [0, 2, 4, 1, 3, 5]
    F, Q = (np.asarray(f(time_interval=SECOND))[np.ix_(order, order)] for f in (moves.matrix, moves.covar))
    assumed = model(
        motion(F, Q), radar([10.0, 0.02, 0.01], 6), 0.9, 0.999, 1e-6,
        gaussian(mean[order], np.diag([100.0] * 3 + [25.0] * 3)),
    )  # fmt: skip
    ours = make_tracker("pda", assumed)
    truth = GaussianState(np.add(mean, [10, 0, 5, 0, 0, 0]), np.eye(6), START + SECOND)
    detection = Detection(sees.function(truth), START + SECOND, sees)
    _, report = ours.step(ours.init(), np.array([[float(v) for v in detection.state_vector[::-1]]]))
    tracker.update_tracker(START + SECOND, {detection})
    np.testing.assert_allclose(tracker.track.state_vector.ravel()[order], report.x[0], **CLOSE)
    np.testing.assert_allclose(tracker.track.covar[np.ix_(order, order)], report.P[0], **CLOSE)


# many targets


def test_the_pmb_gives_the_numbers_of_ours_with_a_track_for_each_label():
    rng, box = np.random.default_rng(0), np.array([[-200.0, 300.0]] * 2)
    births = mixture([0.1, 0.1], [[0.0, 0, 0, 0], [100.0, 0, 0, 0]], [np.diag([100.0, 100, 25, 25])] * 2)
    each = [
        np.vstack([[[0, 4 * t], [100, -4 * t]] + 5 * rng.normal(size=(2, 2)), rng.uniform(*box[0], (5, 2))])
        for t in range(8)
    ]
    known = multi_target_model(
        constant_velocity(1.0, 1.0), position_sensor(5.0), 0.9, 0.99, births, uniform_clutter(*box.T, 5.0)
    )
    ours = make_tracker("pmb", known)
    tracker = MultiTargetTracker(
        transition_model=transition_model_of(known.motion), births=components_of(known.births),
        measurement_model=measurement_model_of(known.sensor), meas_range=box, clutter_rate=5.0,
        detector=ScanReader(each, np.arange(8.0), START),
    )  # fmt: skip
    belief = ours.init()
    for (_, tracks), z in zip(tracker, each, strict=True):
        belief, report = ours.step(belief, z)
        found = {track.id: track for track in tracks}
        assert set(found) == {str(label) for label in report.label}
        for x, existence, label in zip(report.x, report.existence, report.label, strict=True):
            state, row = found[str(label)].state, (belief.label == label).argmax()
            np.testing.assert_allclose(state.state_vector.ravel(), x, **CLOSE)
            np.testing.assert_allclose(state.covar, belief.tracks.P[row], **CLOSE)
            assert state.weight == pytest.approx(existence, abs=1e-9)
    assert sorted(len(track) for track in tracks)[0] >= 4 and len(tracks) == 2


def test_their_simulator_feeds_our_tracker():
    truth = SingleTargetGroundTruthSimulator(MOTIONS[0], PRIOR, number_steps=15)
    box = np.array([[-50.0, 200.0], [-150.0, 100.0]])
    found = SimpleDetectionSimulator(truth, SENSOR, box, detection_probability=0.95, clutter_rate=3, seed=1)
    tracker = MhtTracker(
        prior=PRIOR, transition_model=MOTIONS[0], measurement_model=SENSOR, detector=found,
        clutter_spatial_density=found.clutter_spatial_density,
    )  # fmt: skip
    tracks = set()
    for _, current in tracker:
        tracks |= current
    (track,) = tracks
    assert len(track) == 16


def test_position_sensors_and_motions_go_there_and_back():
    moves = constant_velocity(1.0, 0.5)
    back = motion_of(transition_model_of(moves), 3 * SECOND)
    assert np.array_equal(back.F, moves.F) and np.array_equal(back.Q, moves.Q)
    assert tuple(measurement_model_of(position_sensor(5.0)).mapping) == (0, 1)
