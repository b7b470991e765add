"""Stone Soup's trackers, simulators and readers here; data both ways; and what is refused, in one line."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

pytest.importorskip("stonesoup.base", reason="needs stonesoup, of the extra stonesoup")
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import (
    CartesianToBearingRange,
    CartesianToElevationBearing,
    CartesianToElevationBearingRange,
)
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.models.transition.nonlinear import ConstantTurn
from stonesoup.plotter import Plotter
from stonesoup.reader.generic import CSVDetectionReader, CSVGroundTruthReader
from stonesoup.simulator.simple import (
    DummyGroundTruthSimulator,
    MultiTargetGroundTruthSimulator,
    SimpleDetectionSimulator,
    SingleTargetGroundTruthSimulator,
)
from stonesoup.types.angle import Bearing
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection, TrueDetection
from stonesoup.types.groundtruth import GroundTruthPath
from stonesoup.types.mixture import GaussianMixture
from stonesoup.types.state import GaussianState, State
from stonesoup.types.track import Track

from gmr_gym import make_tracker
from gmr_gym.evaluation import recordings as one_target
from gmr_gym.evaluation import run, run_once
from gmr_gym.mixture import mixture
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.kalman import motion, sensor
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.models.radar import radar
from gmr_gym.recorded import cut, track, tracking_model
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation import draw
from gmr_gym.stonesoup import (
    ImmUpdater,
    MultiTargetTracker,
    PdaTracker,
    Reducer,
    StoneSoupMultiTargetTracker,
    StoneSoupTracker,
    components_of,
    detections_of,
    episode_of,
    measurement_model_of,
    mixture_of,
    model_of,
    motion_of,
    paths_of,
    pda_of,
    recording_of,
    scan_of,
    scans_of,
    scenario_of,
    seeded_copies,
    sensor_of,
    single_target_scenario_of,
    track_rows_of,
    tracks_of,
    transition_model_of,
    truth_of,
)

START, SECOND = datetime(2024, 5, 1), timedelta(seconds=1)
CLOSE = dict(rtol=1e-9, atol=1e-9)
SENSOR = LinearGaussian(4, (0, 2), 25.0 * np.eye(2))
MOVES = CombinedLinearGaussianTransitionModel([ConstantVelocity(0.1)] * 2)
PRIOR = GaussianState([0.0, 10.0, 0.0, -5.0], np.diag([100.0, 25.0, 100.0, 25.0]), START)
BOX = np.array([[-100.0, 400.0], [-300.0, 200.0]])
ANGLES = CartesianToElevationBearing(6, (0, 2, 4), np.eye(2))
POLAR = CartesianToBearingRange(
    4, (0, 2), np.diag([0.01**2, 5.0**2]), translation_offset=np.array([[7.0], [8.0]])
)
SPHERICAL = CartesianToElevationBearingRange(6, (0, 2, 4), np.diag([0.01**2, 0.02**2, 10.0**2]))
ASSUMED = model_of(
    MOVES, SENSOR, PRIOR, SECOND, prob_detect=0.9, prob_gate=0.999, clutter_spatial_density=4 / 250000
)


def simulator(steps=12, seed=0, **changes):
    truth = SingleTargetGroundTruthSimulator(MOVES, PRIOR, number_steps=steps)
    given = dict(detection_probability=0.95, clutter_rate=4.0, seed=seed) | changes
    return SimpleDetectionSimulator(truth, SENSOR, BOX, **given)


def crowd(steps=10):
    truth = MultiTargetGroundTruthSimulator(
        MOVES, PRIOR, number_steps=steps, birth_rate=0.5, death_probability=0.05, initial_number_targets=2
    )
    return SimpleDetectionSimulator(truth, SENSOR, BOX, clutter_rate=4.0)


def many_targets():
    births = mixture([0.2], [[0.0, 10.0, 0.0, -5.0]], [np.diag([400.0, 25.0, 400.0, 25.0])])
    return multi_target_model(
        motion_of(MOVES, SECOND), sensor_of(SENSOR), 0.9, 0.95, births, uniform_clutter(*BOX.T, 4.0)
    )


# their trackers here


def test_their_pda_gives_the_numbers_of_ours():
    scenario = turning_target(clutter_rate=30, horizon=12)
    ours = run_once(scenario, make_tracker("pda", scenario.model), seed=1)
    theirs = run_once(scenario, StoneSoupTracker(scenario.model, pda_of, scenario.period), seed=1)
    np.testing.assert_allclose(theirs.x, ours.x, **CLOSE)
    np.testing.assert_allclose(theirs.P, ours.P, **CLOSE)
    np.testing.assert_allclose(theirs.gate_volume, ours.gate_volume, **CLOSE)
    assert theirs.off_target.tolist() == ours.off_target.tolist()


def test_their_tracker_runs_beside_ours_and_a_lost_track_is_predicted():
    scenario = turning_target(clutter_rate=5, horizon=4)

    def deleting(model):
        tracker = pda_of(model)
        tracker.deleter.covar_trace_thresh = 1e-9
        tracker.initiator.initiate = lambda detections, time: set()
        return tracker

    trackers = {
        "theirs": StoneSoupTracker(scenario.model, pda_of),
        "lost": StoneSoupTracker(scenario.model, deleting),
    }
    found = run(scenario, trackers, runs=2)
    assert found["theirs"].x.shape == (2, 4, 4) and not found["theirs"].off_target.any()
    assert found["lost"].off_target.all()
    F = scenario.model.motion.F
    np.testing.assert_allclose(found["lost"].x[0, 1], F @ found["lost"].x[0, 0], **CLOSE)


def test_their_tracker_of_many_targets_is_one_of_ours():
    assumed = many_targets()

    def pmb(model):
        return MultiTargetTracker(
            transition_model=transition_model_of(model.motion),
            measurement_model=measurement_model_of(model.sensor), births=components_of(model.births),
            meas_range=BOX, clutter_rate=4.0, prob_survival=0.95,
        )  # fmt: skip

    scenario = scenario_of(
        seeded_copies(crowd(), 2), assumed, SENSOR, position=(0, 2), velocity=(1, 3), cutoff=50.0
    )
    trackers = {"ours": make_tracker("pmb", assumed), "theirs": StoneSoupMultiTargetTracker(assumed, pmb)}
    found = run(scenario, trackers, runs=2)
    np.testing.assert_allclose(found["theirs"].gospa, found["ours"].gospa, **CLOSE)
    assert found["theirs"].named.any()


# their simulators and readers here


def test_a_simulator_is_a_scenario_of_one_target_with_its_own_path():
    scenario = single_target_scenario_of(simulator(), ASSUMED, position=(0, 2), velocity=(1, 3))
    assert (scenario.horizon, scenario.period) == (11, 1.0)
    first, again, other = (draw(scenario, seed).x for seed in (1, 1, 2))
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    steps = first[1:] - first[:-1] @ ASSUMED.motion.F.T
    assert 0 < np.abs(steps).max() < 5  # sigma 0.32 m/s
    runs = run(scenario, {"pda": make_tracker("pda", ASSUMED)}, runs=3)["pda"]
    assert np.linalg.norm((runs.x - runs.truth)[:, :, [0, 2]], axis=2).mean() < 15


def test_copies_of_a_simulator_draw_the_same_for_the_same_seed_alone():
    def drawn(seed):
        return [episode_of(one, SENSOR)[0] for one in seeded_copies(crowd(), 2, seed)]

    (a, b), (c, d), (e, _) = drawn(1), drawn(1), drawn(2)
    assert np.array_equal(a.z, c.z) and np.array_equal(b.z, d.z) and np.array_equal(a.x, c.x, equal_nan=True)
    assert not np.array_equal(a.z[:5], b.z[:5]) and not np.array_equal(a.z[:5], e.z[:5])


def test_an_episode_knows_the_target_of_each_detection():
    (one,) = seeded_copies(crowd(20), 1, seed=3)
    episode, times = episode_of(one, SENSOR)
    assert len(times) == len(episode.x) == 20 and episode.first[-1] == len(episode.z)
    for t in range(20):
        for row in range(episode.first[t], episode.first[t + 1]):
            if (j := episode.origin[row]) >= 0:
                assert np.abs(episode.z[row] - episode.x[t, j, [0, 2]]).max() < 25  # five sigma
    assert (episode.origin >= 0).sum() > 20 and (episode.origin < 0).sum() > 20


def test_a_file_that_their_reader_reads_is_tracked_here(tmp_path):
    times = [(START + t * SECOND).isoformat() for t in range(6)]
    rows = [f"{time},{10 * t},{-5 * t},7" for t, time in enumerate(times)]
    (tmp_path / "d.csv").write_text("\n".join(["time,x,y,snr", *rows]))
    truth = [f"{time},{10 * t},10,{-5 * t},-5,one" for t, time in enumerate(times)]
    (tmp_path / "t.csv").write_text("\n".join(["time,x,vx,y,vy,id", *truth]))
    reader = CSVDetectionReader(tmp_path / "d.csv", ["x", "y"], "time")
    scans, start = scans_of(reader, SENSOR)
    assert start == START and scans.coordinates == ("x_m", "y_m")
    tracker = make_tracker("pda", ASSUMED)
    assert np.abs(one_target.track(scans, lambda _: tracker).x[-1, 0] - 50) < 5
    found = recording_of(reader)
    assert found.metadata == {"snr": ["7"] * 6} and found.start == START.replace(tzinfo=UTC)
    paths = CSVGroundTruthReader(tmp_path / "t.csv", ["x", "vx", "y", "vy"], "time", path_id_field="id")
    paths = set.union(*(current for _, current in paths))
    episode, _ = episode_of(reader, SENSOR, truth=paths)
    assert episode.x.shape == (6, 1, 4) and episode.x[3, 0].tolist() == [30, 10, -15, -5]
    with pytest.raises(ValueError, match="detector must have ground truth, got none"):
        episode_of(reader, SENSOR)


def test_polar_detections_of_a_sensor_that_moves_are_recorded_where_it_was():
    turned = CartesianToBearingRange(
        4, (0, 2), POLAR.noise_covar, translation_offset=np.array([[17.0], [8.0]]),
        rotation_offset=np.array([[0.0], [0.0], [0.5]]),
    )  # fmt: skip
    states = [State([107.0, 0.0, 208.0, 0.0]), State([117.0, 0.0, -92.0, 0.0])]
    path = GroundTruthPath(id="a")
    scans = [
        (
            START + t * SECOND,
            {TrueDetection(seen.function(x), path, START + t * SECOND, seen)},
        )
        for t, (seen, x) in enumerate(zip((POLAR, turned), states, strict=True))
    ]
    found = recording_of([*scans, (START + 2 * SECOND, set())])
    assert found.kind == "polar" and len(found.sensors) == 1 and found.empty_time.tolist() == [2]
    assert found.sensors[0].deviation == pytest.approx((5.0, 0.01)) and found.truth.tolist() == ["a", "a"]
    ranges, azimuths = found.z.T
    places = found.origin[:, :2] + ranges[:, None] * np.column_stack([np.cos(azimuths), np.sin(azimuths)])
    np.testing.assert_allclose(places, [[107, 208], [117, -92]], atol=1e-9)
    model = tracking_model(found.sensors, (-500, -500), (500, 500))
    assert len(track(found, cut(found), model).time) >= 2


# data both ways


def test_states_mixtures_and_tracks_go_there_and_back():
    p = mixture([0.4, 0.6], [[0.0, 1.0], [2.0, 3.0]], [np.eye(2), np.diag([2.0, 3.0])])
    for a, b in zip(p, mixture_of(GaussianMixture(components_of(p, START))), strict=True):
        assert np.array_equal(a, b)
    assert mixture_of(Track([PRIOR])).m.tolist() == [[0.0, 10.0, 0.0, -5.0]]
    x, P = np.arange(12.0).reshape(3, 4), np.tile(np.eye(4), (3, 1, 1))
    whole = one_target.Track(np.array([0.0, 1.0, 2.5]), x, P, np.ones(3, int), np.ones(3, bool))
    (there,) = tracks_of(whole, START)
    assert there.timestamp == START + 2.5 * SECOND
    rows = track_rows_of([there], order=[0, 2, 1, 3])
    assert rows.time.tolist() == [0, 1, 2.5] and rows.track.tolist() == [1] * 3
    assert rows.x.tolist() == x[:, [0, 2, 1, 3]].tolist() and rows.existence.tolist() == [1] * 3
    assert [len(one) for one in tracks_of(rows, START)] == [3]
    ours = PdaTracker(
        prior=PRIOR, transition_model=MOVES, measurement_model=SENSOR, clutter_spatial_density=1e-5
    )
    ours.update_tracker(START + SECOND, set())
    assert track_rows_of({ours.track}).status.tolist() == [1, 2]  # confirmed, coasted


def test_truth_goes_there_and_back():
    times = [START + t * SECOND for t in range(4)]
    x = np.full((4, 2, 3), np.nan)
    x[:, 0], x[1:3, 1] = np.arange(12.0).reshape(4, 3), [[5.0, 6.0, 7.0]] * 2
    paths = paths_of(x, times)
    assert [len(path) for path in paths] == [4, 2]
    assert np.array_equal(truth_of(paths, times), x, equal_nan=True)
    assert np.array_equal(truth_of({*paths}, times), x, equal_nan=True)


def test_scans_go_there_and_back_in_an_order_of_their_own():
    z = np.array([[3.0, 1.0], [-2.0, 5.0], [-2.0, 4.0]])
    found, back = scan_of(detections_of(z, START, SENSOR), SENSOR, START)
    assert back.tolist() == [[-2, 4], [-2, 5], [3, 1]]
    assert [one.state_vector.ravel().tolist() for one in found] == back.tolist()
    polar = np.array([[900.0, 0.5, 0.1]])  # range, azimuth, elevation
    (there,) = detections_of(polar, START, SPHERICAL)
    assert isinstance(there.state_vector[1], Bearing) and there.state_vector[2] == 900
    assert scan_of([there], SPHERICAL, START)[1].tolist() == polar.tolist()
    assert scan_of(set(), SENSOR, START)[1].shape == (0, 2)


def test_a_radar_goes_there_and_back():
    ours = radar([10.0, 0.02, 0.01], 6)
    back = sensor_of(measurement_model_of(ours))
    np.testing.assert_allclose(back.deviations, ours.deviations, rtol=1e-15)
    z = ours.measure(np.array([100.0, 200.0, 50.0, 0, 0, 0]))
    theirs = measurement_model_of(ours).function(State([100.0, 200.0, 50.0, 0, 0, 0]))
    np.testing.assert_allclose([float(v) for v in theirs[::-1]], z, **CLOSE)


def test_their_plotter_draws_our_tracks():
    detector = simulator(6)
    tracker = PdaTracker(
        prior=PRIOR, transition_model=MOVES, measurement_model=SENSOR, detector=detector,
        clutter_spatial_density=detector.clutter_spatial_density,
    )  # fmt: skip
    tracks, seen = set(), set()
    for _, current in tracker:
        tracks |= current
        seen |= detector.detections
    plotter = Plotter()
    plotter.plot_measurements(seen, [0, 2])
    plotter.plot_tracks(tracks, [0, 2], uncertainty=True)
    plotter.plot_ground_truths(detector.groundtruth.groundtruth_paths, [0, 2])
    (line,) = [line for line in plotter.ax.lines if len(line.get_xdata()) == 7][:1]
    np.testing.assert_allclose(
        line.get_xdata(), [float(state.state_vector[0]) for state in next(iter(tracks))]
    )


# what is refused


def pda(**changes):
    given = dict(prior=PRIOR, transition_model=MOVES, measurement_model=SENSOR, clutter_spatial_density=1e-5)
    return PdaTracker(**given | changes)


def at(vector, time=START + SECOND, seen=None):
    return Detection(StateVector(vector), time, seen)


def scanned(*detections, time=START + SECOND, **changes):
    return pda(**changes).update_tracker(time, detections)


def unlabelled():
    births = mixture([2.0], [PRIOR.state_vector.ravel()], [PRIOR.covar])
    tracker = MultiTargetTracker(
        transition_model=MOVES, measurement_model=SENSOR, meas_range=BOX, clutter_rate=4.0,
        births=components_of(births), tracker="fitted-phd",
    )  # fmt: skip
    z = np.array([[0.0, 0.0], [20.0, 20.0], [-20.0, 0.0]])
    for t in range(2):
        tracker.update_tracker(START + t * SECOND, detections_of(z, START + t * SECOND))


REFUSED = {
    "a transition model that is not linear": (
        lambda: pda(transition_model=ConstantTurn(np.array([1.0, 1.0]), 0.1)),
        "transition_model must be linear and Gaussian, got ConstantTurn; there are LinearGaussianTransition",
    ),
    "another polar measurement model": (
        lambda: pda(measurement_model=POLAR),
        "measurement_model CartesianToBearingRange has no sensor here; there are LinearGaussian and Cartes",
    ),
    "a radar elsewhere": (
        lambda: sensor_of(
            CartesianToElevationBearingRange(6, (0, 2, 4), np.eye(3), translation_offset=np.ones((3, 1)))
        ),
        r"translation_offset of measurement_model must be zero, got \[1.0, 1.0, 1.0\]: the radar is the orig",
    ),
    "correlated noise of a radar": (
        lambda: sensor_of(CartesianToElevationBearingRange(6, (0, 2, 4), np.eye(3) + 0.5)),
        "noise_covar of measurement_model must be diagonal",
    ),
    "a radar for an IMM": (
        lambda: ImmUpdater(SPHERICAL).predict_measurement(GaussianState(np.ones(6), np.eye(6), START)),
        "measurement_model must be linear here, got CartesianToElevationBearingRange",
    ),
    "models of different sizes": (
        lambda: pda(transition_model=CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0)] * 3)),
        "transition_model has 6 states, but measurement_model has 4",
    ),
    "a prior of another size": (
        lambda: pda(prior=GaussianState([1.0, 2.0], np.eye(2), START)),
        "prior has 2 states, but measurement_model has 4",
    ),
    "a mapping beyond the states": (
        lambda: pda(measurement_model=LinearGaussian(4, (0, 4), np.eye(2))),
        r"mapping of measurement_model must be of its 4 states, got \(0, 4\)",
    ),
    "times with and without a zone": (
        lambda: scanned(time=(START + SECOND).replace(tzinfo=UTC)),
        "timestamps must all have a time zone, or none, got 2024-05-01 00:00:01.00:00 after 2024-05-01 00",
    ),
    "a motion with an offset": (
        lambda: transition_model_of(motion(np.eye(1), np.eye(1), [2.0])),
        r"motion must have no offset, got \[2.0\]",
    ),
    "a sensor of sums": (
        lambda: measurement_model_of(sensor([[1.0, 1.0]], [[1.0]])),
        r"sensor.H must measure one state in each row, as LinearGaussian does, got \[\[1.0, 1.0\]\]",
    ),
    "a prior without a time": (
        lambda: pda(prior=GaussianState(PRIOR.state_vector, PRIOR.covar)),
        "prior must have a timestamp",
    ),
    "a prior without a covariance": (
        lambda: pda(prior=State(PRIOR.state_vector, START)),
        "a state must be a GaussianState or a GaussianMixture, got a State",
    ),
    "an angle in a state": (
        lambda: mixture_of(GaussianState(StateVector([Bearing(1.0), 2.0]), np.eye(2))),
        "states must be lengths, got an angle, a Bearing",
    ),
    "an angle for a linear sensor": (
        lambda: scanned(at([Bearing(1.0), 2.0])),
        "detections must be lengths, got an angle, a Bearing",
    ),
    "a detection without a time": (
        lambda: scanned(at([1.0, 2.0], None)),
        r"detections must have a timestamp, got one without: \[1. 2.\]",
    ),
    "a detection of another time": (
        lambda: scanned(at([1.0, 2.0], START)),
        "detections of the scan at 2024-05-01 00:00:01 must have that timestamp, got 2024-05-01 00:00:00",
    ),
    "detections of another sensor": (
        lambda: scanned(at([1.0, 2.0], seen=LinearGaussian(4, (1, 3), np.eye(2)))),
        r"detections must be of one sensor, got one of LinearGaussian with mapping \(1, 3\)",
    ),
    "detections of another size": (
        lambda: scanned(at([1.0, 2.0, 3.0])),
        "detections must have 2 coordinates, as measurement_model, got 3",
    ),
    "detections of several sizes": (
        lambda: scanned(at([1.0, 2.0, 3.0]), at([1.0, 2.0])),
        r"detections must have one size, got \[2, 3\]",
    ),
    "a time that goes back": (
        lambda: scanned(time=START - SECOND),
        "scans must be in order of time, but 2024-04-30 23:59:59 follows 2024-05-01 00:00:00",
    ),
    "no detector": (lambda: iter(pda()), "detector must be given to iterate"),
    "an unknown tracker": (lambda: pda(tracker="pdaf"), "unknown tracker 'pdaf'; did you mean 'pda'"),
    "a tracker without labels": (
        unlabelled,
        "tracker 'fitted-phd' has no labels, of which tracks are made; take pmb",
    ),
    "a bearing alone in a recording": (
        lambda: recording_of([(START, {at([0.0, 0.1], START, ANGLES)})]),
        "measurement_model CartesianToElevationBearing cannot be recorded; there are LinearGaussian, Cart",
    ),
    "a recording without a time": (
        lambda: recording_of([(START, {at([1.0, 2.0], None)})]),
        "detections must have a timestamp, got one without in the scan at 2024-05-01 00:00:00",
    ),
    "nothing to record": (lambda: recording_of([(START, set())]), "detector must give at least one detec"),
    "no scans": (lambda: scans_of([], SENSOR), "detector must give at least one scan, got none"),
    "no truth": (lambda: truth_of([], [START]), "paths must be at least one"),
    "no tracks": (lambda: track_rows_of([]), "tracks must be at least one"),
    "a simulator of another kind": (
        lambda: single_target_scenario_of(
            DummyGroundTruthSimulator([START]), ASSUMED, position=(0, 2), velocity=(1, 3)
        ),
        "simulator must be a SimpleDetectionSimulator, got DummyGroundTruthSimulator; of any detector scenar",
    ),
    "no detectors": (
        lambda: scenario_of([], many_targets(), SENSOR, position=(0, 2), velocity=(1, 3), cutoff=50.0),
        "detectors must be at least one",
    ),
    "a state that is no component": (
        lambda: Reducer().reduce([State([1.0])]),
        "a state must be a GaussianState or a GaussianMixture, got a State",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_has_no_counterpart_is_refused_by_name(case):
    call, message = REFUSED[case]
    with pytest.raises(ValueError, match=message) as found:
        call()
    assert "\n" not in str(found.value)
