"""Quality of tracks: with and without a truth, of tracks whose figures are known."""

import json
import re

import numpy as np
import pytest
from made_tracks import made

from gmr_gym.recorded.accuracy import accuracy, label_accuracy
from gmr_gym.recorded.detections import POLAR, SensorSpec, from_arrays, objects
from gmr_gym.recorded.figures import Figure, wilson
from gmr_gym.recorded.innovations import innovations
from gmr_gym.recorded.quality import lives_of, quality
from gmr_gym.recorded.report import in_lines, in_short, write_report
from gmr_gym.recorded.tracks import COASTED, CONFIRMED, Tracks
from gmr_gym.recorded.truth import Truth, at_times, is_autoferry, read_autoferry_truth, truth_from
from gmr_gym.recorded.unused_cells import unused_by_cell

MADE = made(seed=1, scans=300)
TIMES = np.array([scan.time for scan in MADE.scans])


def by_name(figures):
    named = {figure.name: figure for figure in figures}
    assert len(named) == len(figures)
    return named


@pytest.fixture(scope="module")
def told():
    return by_name(quality(MADE.tracks, MADE.detections, MADE.scans))


def test_innovations_are_those_of_the_filter():
    found = innovations(MADE.tracks, MADE.detections, 0)
    nis = np.einsum("ki,ki->k", found.v, np.linalg.solve(found.S, found.v[..., None])[..., 0])
    assert len(found.row) > 700
    assert nis == pytest.approx(MADE.tracks.nis[found.row], rel=1e-6)
    assert (found.cartesian == found.v).all()


def polar(deviations, bias=0.0):
    """One update of a state by range and azimuth from (300, -200), its prediction and its innovation."""
    rng = np.random.default_rng(4)
    origin, x, P = (
        np.array([300.0, -200.0]),
        np.array([900.0, 500.0, 10.0, -4.0]),
        np.diag([400.0, 300, 25, 25]),
    )
    off = x[:2] - origin
    h = np.array([np.hypot(*off), np.arctan2(off[1], off[0])])
    H = np.zeros((2, 4))
    H[:, :2] = [off / h[0], [-off[1] / h[0] ** 2, off[0] / h[0] ** 2]]
    R = np.diag(np.square(deviations))
    S = H @ P @ H.T + R
    v = 0.1 * rng.multivariate_normal(np.zeros(2), S)
    K = P @ H.T @ np.linalg.inv(S)
    return origin, h + v, x + K @ v, (np.eye(4) - K @ H) @ P, v, S


def test_polar_innovations_are_those_of_an_extended_kalman_filter():
    origin, z, x, P, v, S = polar((5.0, 0.01))
    z[1] += 2 * np.pi  # the same azimuth
    spec = SensorSpec("radar", POLAR, (*origin, 0.0), deviation=(5.0, 0.01))
    one, row, status = np.ones(1), np.zeros(1, int), np.array([CONFIRMED], np.int8)
    nis = one * (v @ np.linalg.solve(S, v))
    tracks = Tracks(one, row + 1, status, x[None], P[None], one, one[:, None], row + 1, row, one, nis, row)
    found = innovations(tracks, from_arrays(one, z[None], sensors=[spec]), 0)
    assert found.v[0] == pytest.approx(v, rel=0.02)
    assert found.S[0] == pytest.approx(S, rel=0.03)
    assert np.linalg.norm(found.cartesian[0]) == pytest.approx(np.hypot(v[0], z[0] * v[1]), rel=0.02)


def test_a_filter_that_knows_its_noise_is_as_expected(told):
    names = [name for name in told if name.startswith(("NIS", "correlation", "mean innovation"))]
    assert len(names) == 7
    assert all(told[name].sound for name in names)
    n = told["NIS / degrees of freedom"].of
    assert told["NIS / degrees of freedom"].high - 1 == pytest.approx(2 * np.sqrt(2 / (2 * n)))
    assert told["correlation of successive innovations"].high == pytest.approx(2 / np.sqrt(told[
        "correlation of successive innovations"].of))  # fmt: skip


def test_a_filter_that_doubts_its_detections_is_told(told):
    doubting = made(seed=1, scans=300, assumed=2.0)
    figures = by_name(quality(doubting.tracks, doubting.detections, doubting.scans))
    assert figures["NIS / degrees of freedom"].value < 0.5 < told["NIS / degrees of freedom"].value
    assert not figures["NIS / degrees of freedom"].sound
    assert not figures["correlation of successive innovations"].sound


def test_a_row_without_a_velocity_has_no_course_and_the_others_keep_theirs(told):
    x = MADE.tracks.x.copy()
    rows = innovations(MADE.tracks, MADE.detections, 0).row
    x[rows[np.linalg.norm(x[rows, 2:], axis=1).argmax()], 2:] = 0.0
    found = by_name(quality(MADE.tracks._replace(x=x), MADE.detections, MADE.scans))
    for name in ("mean innovation along track", "mean innovation to the left of the track"):
        assert found[name].of == told[name].of - 1 and np.isfinite(found[name].value)


def test_echoes_that_stand_still_do_not_count(told):
    static = [life.static for life in lives_of(MADE.tracks)]
    assert static == [False, False, True]
    assert told["static tracks"].value == 1
    moving = (
        np.isin(MADE.tracks.track, [1, 2]) & (MADE.tracks.status == CONFIRMED) & (MADE.tracks.weight > 0.9)
    )
    assert told["NIS / degrees of freedom"].of == moving.sum()
    assert told["NIS / degrees of freedom"].value == pytest.approx(MADE.tracks.nis[moving].mean() / 2)


def test_the_probability_of_detection_is_counted_between_the_first_and_the_last_of_a_life(told):
    hits = opportunities = 0
    for track in (1, 2, 3):
        took = MADE.tracks.detection[MADE.tracks.track == track] >= 0
        took = took[2:]  # the third detection confirms
        took = took[1 : np.flatnonzero(took)[-1]]
        hits, opportunities = hits + took.sum(), opportunities + len(took)
    figure = told["detection probability"]
    assert (figure.value, figure.of) == (pytest.approx(hits / opportunities), opportunities)
    assert figure.low < 0.9 < figure.high
    assert told["detection probability, lowest of its 95 % interval"].value < figure.value


def test_reports_of_targets_themselves_have_neither_misses_nor_clutter():
    figures = by_name(quality(MADE.tracks, MADE.detections, MADE.scans, reports=True))
    assert not [name for name in figures if name.startswith(("detection probability", "unused"))]


def test_who_comes_back_to_where_it_was_is_not_static():
    tracks = MADE.tracks
    rows = np.flatnonzero(tracks.track == 3)
    x = tracks.x.copy()
    angle = 2 * np.pi * np.arange(len(rows)) / (len(rows) - 3)  # from the first detection that counts
    x[rows, :2] += 200 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert [life.static for life in lives_of(tracks._replace(x=x))] == [False] * 3


def test_wilsons_interval_has_the_ends_at_which_the_score_test_is_at_its_limit():
    for hits, of in (0, 10), (9, 10), (455, 500):
        for end in wilson(hits, of):
            assert abs(hits / of - end) == pytest.approx(1.959964 * np.sqrt(end * (1 - end) / of), abs=1e-7)


def test_detections_of_no_track_are_clutter(told):
    left = len(MADE.detections.time) - MADE.tracks.weight.sum()
    figure = told["unused detections a scan"]
    assert figure.value == pytest.approx(left / 300)
    still = made(seed=3, scans=200, starts=((0.0, 0.0, 0.0, 0.0),))  # all is in a square of 4 km2
    scattered = by_name(quality(still.tracks, still.detections, still.scans))
    density = scattered["unused detections a scan and km2"].value
    assert density == pytest.approx(scattered["unused detections a scan"].value / 4, rel=0.05)
    assert told["index of dispersion of unused detections"].sound
    bursts = MADE.detections, [scan._replace(rows=scan.rows if t % 10 == 0 else scan.rows[:0]) for t, scan in
                               enumerate(MADE.scans)]  # fmt: skip
    assert not by_name(quality(MADE.tracks, *bursts))["index of dispersion of unused detections"].sound


def test_cells_say_where_the_detections_of_no_track_gather():
    rng = np.random.default_rng(7)
    points, left = rng.uniform(-1000, 1000, (600, 2)), np.ones(600)
    even, *cells = unused_by_cell(points, left, 200)
    assert even.sound and even.name.endswith("over cells of 197 m") and all(cell.sound for cell in cells)
    shore = np.vstack([points, rng.normal((500.0, -300.0), 20.0, (80, 2))])  # 0.4 a scan at one spot
    gathered, first, *_ = unused_by_cell(shore, np.ones(680), 200)
    assert not gathered.sound and not first.sound
    x, y = map(float, re.search(r"cell about (-?\d+), (-?\d+) m", first.name).groups())
    assert np.hypot(x - 500, y + 300) < 150 and 0.25 < first.value < 0.5
    line = np.column_stack([points[:, 0], 1e-6 * points[:, 1]])  # no cell has its middle in so thin a place
    assert len(list(unused_by_cell(line, left, 200))) in (0, 4)
    tracked = np.append(left, np.zeros(80))  # the same detections, but of tracks
    assert [one.value for one in unused_by_cell(shore, tracked, 200)][1] < 0.1


def cut_at(tracks, track, scan, gap):
    """The track as two, numbers and all, with so many scans between them."""
    rows = np.flatnonzero(tracks.track == track)
    numbers = tracks.track.copy()
    numbers[rows[scan:]] = 9
    keep = np.setdiff1d(np.arange(len(numbers)), rows[scan : scan + gap])
    return Tracks(*(column[keep] for column in tracks._replace(track=numbers)))


def test_a_track_that_goes_on_under_another_number_is_broken():
    broken = by_name(quality(cut_at(MADE.tracks, 1, 100, 3), MADE.detections, MADE.scans))
    assert broken["tracks broken in two, an hour"].value == pytest.approx(3600 / TIMES[-1])
    late = by_name(quality(cut_at(MADE.tracks, 1, 100, 40), MADE.detections, MADE.scans))
    assert late["tracks broken in two, an hour"].value == 0


def test_the_coasted_share_and_the_numbers_of_tracks(told):
    status = MADE.tracks.status
    share = (status == COASTED).sum() / np.isin(status, (CONFIRMED, COASTED)).sum()
    assert told["coasted share of confirmed tracks"].value == pytest.approx(share)
    assert (told["tracks"].value, told["tracks confirmed"].value) == (3, 3)
    assert told["median length of confirmed tracks"].value == pytest.approx(TIMES[-1] - TIMES[2])
    assert told["confirmed tracks of fewer than 10 detections"].value == 0


def test_no_tracks_at_all_are_no_error():
    none = Tracks(*(column[:0] for column in MADE.tracks))
    figures = by_name(quality(none, MADE.detections, MADE.scans))
    assert figures["tracks"].value == 0
    assert in_short([*figures.values()])


def truth_of(seen=MADE):
    T, n, _ = seen.truth.shape
    names = np.tile(objects([f"ship {i}" for i in range(n)]), T)
    return Truth(np.repeat([scan.time for scan in seen.scans], n), names, seen.truth.reshape(-1, 2))


def test_figures_with_a_truth():
    figures, over_time = accuracy(MADE.tracks, truth_of(), TIMES, cutoff=40.0)
    named = by_name(figures)
    assert named["coverage of target ship 0"].value == pytest.approx(298 / 300)
    assert named["labels of target ship 0"].value == 1
    assert 3.0 < named["median error of target ship 0"].value < 5.0
    assert named["targets missed a scan"].value == named["T-GOSPA, targets missed a scan"].value == 6 / 300
    assert (named["false tracks a scan"].value, named["T-GOSPA, switches"].value) == (0, 0)
    assert over_time["time"] == TIMES.tolist()
    assert over_time["missed"] == [3, 3, *[0] * 298]
    assert np.mean(over_time["gospa"]) == pytest.approx(named["mean GOSPA"].value)
    assert over_time["gospa"][0] == pytest.approx(np.sqrt(3 * 40.0**2 / 2))


def test_a_track_beyond_the_cutoff_is_of_no_target():
    x = MADE.tracks.x.copy()
    x[MADE.tracks.track == 3, 0] += 120.0  # of a target that stands apart
    named = by_name(accuracy(MADE.tracks._replace(x=x), truth_of(), TIMES, cutoff=50.0)[0])
    assert named["coverage of target ship 2"].value == named["labels of target ship 2"].value == 0
    assert "median error of target ship 2" not in named
    assert named["false tracks a scan"].value == pytest.approx(298 / 300)


def test_a_broken_track_has_two_labels_and_a_switch():
    named = by_name(accuracy(cut_at(MADE.tracks, 1, 100, 0), truth_of(), TIMES)[0])
    assert named["labels of target ship 0"].value == 2
    assert named["T-GOSPA, switches"].value == pytest.approx(1)
    assert named["coverage of target ship 0"].value == pytest.approx(298 / 300)


def test_scans_outside_the_truth_are_left_out_and_none_inside_is_refused():
    truth = truth_of()
    half = Truth(*(column[: 3 * 150] for column in truth))
    assert len(accuracy(MADE.tracks, half, TIMES)[1]["time"]) == 150
    with pytest.raises(ValueError, match="no scan is within the time of the truth"):
        accuracy(MADE.tracks, truth._replace(time=truth.time + 1e9), TIMES)


def test_figures_of_a_column_that_names_targets():
    tracks, n = MADE.tracks, len(MADE.detections.time)
    names = [None] * n
    for track, i in zip(tracks.track, tracks.detection, strict=True):
        if i >= 0:
            names[i] = "b" if track == 2 else "a"
    figures = by_name(label_accuracy(tracks, MADE.detections._replace(truth=objects(names))))
    assert figures["labels of target a"].value == 2
    assert figures["labels of target b"].value == 1
    assert figures["detections of target b in tracks"].value == pytest.approx(1 - 2 / names.count("b"))
    assert figures["detections of a track's own target"].value == 1


def test_the_truth_of_the_autoferry_form(tmp_path):
    file = tmp_path / "truth.json"
    ship = [{"targetID": 1, "position": [84.0 + t, -354.0, 0], "time": 1620114891.5 + t} for t in range(3)]
    file.write_text(json.dumps([[ship[0]], [ship[0]], [ship[1]], [ship[2]]]))
    detections = from_arrays([0.0], [[0.0, 0.0]], start=np.datetime64("2021-05-04T07:54:50.5", "us").item())
    assert is_autoferry(file)
    truth = read_autoferry_truth(file, detections)
    assert truth.time == pytest.approx([1, 2, 3], abs=1e-6)
    assert truth.position.tolist() == [[-354, 84], [-354, 85], [-354, 86]]
    points, names = at_times(*truth, np.array([0.5, 1.5, 3.5]))
    assert names == ["1"]
    assert points[1, 0] == pytest.approx([-354, 84.5])
    assert np.isnan(points[[0, 2]]).all()
    with pytest.raises(ValueError, match="its times are since 1970"):
        read_autoferry_truth(file, detections._replace(start=None))
    file.write_text('[[{"targetID": 1, "position": 3}]]')
    with pytest.raises(
        ValueError, match=r"truth.json: expected lists of targets with targetID, position and time"
    ):
        read_autoferry_truth(file, detections)


def test_a_truth_that_is_read_as_detections_are_is_put_on_their_clock():
    start = np.datetime64("2024-01-01T00:00:00", "us").item()
    later = np.datetime64("2024-01-01T00:00:10", "us").item()
    detections = from_arrays([0.0], [[0.0, 0.0]], start=start)
    truth = truth_from(
        from_arrays([0.0, 1.0], [[1, 2], [3, 4]], identity=["a", "b"], start=later), detections
    )
    assert truth.time.tolist() == [10, 11]
    assert truth.target.tolist() == ["a", "b"]
    counted = truth_from(
        from_arrays([0.0, 1.0], [[1, 2], [3, 4]], zero=7.0, metadata={"target": ["u", "v"]}),
        detections._replace(start=None, zero=5.0),
    )
    assert counted.time.tolist() == [2, 3]
    assert counted.target.tolist() == ["u", "v"]
    with pytest.raises(ValueError, match="must both have absolute times, or neither"):
        truth_from(detections._replace(start=None), detections)


def test_reports_hold_every_figure(tmp_path):
    figures = quality(MADE.tracks, MADE.detections, MADE.scans)
    groups, over = {"Without a truth": figures}, {"time": [0.0], "gospa": [1.5]}
    write_report(
        tmp_path / "a.json", groups, over, command="gmr-gym track a.csv", remarks=["one row dropped"]
    )
    kept = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert [one["name"] for one in kept["figures"]["Without a truth"]] == [figure.name for figure in figures]
    assert kept["figures"]["Without a truth"][0]["value"] == figures[0].value
    assert (kept["over_time"], kept["remarks"]) == (over, ["one row dropped"])
    write_report(tmp_path / "a.md", groups, command="gmr-gym track a.csv")
    lines = (tmp_path / "a.md").read_text(encoding="utf-8").splitlines()
    rows = [line.split(" | ")[0].removeprefix("| ") for line in lines if line.startswith("| ")]
    assert rows[1:] == [figure.name for figure in figures]
    with pytest.raises(ValueError, match=r"a report ends in \.json or \.md, got 'a.txt'"):
        write_report(tmp_path / "a.txt", groups)


def test_a_figure_that_is_not_as_expected_is_marked():
    good, bad, plain = (
        Figure("a", 1.0, "m", 5, 0.5, 1.5),
        Figure("long name", 0.0, "", 5, 0.25, 1.5),
        Figure("b", 3),
    )
    assert in_lines([good, bad, plain]) == [
        "a                   1 m  expected 0.5 to 1.5",
        "long name             0  expected 0.25 to 1.5  !",
        "b                     3",
    ]
    assert 10 <= len(in_short(quality(MADE.tracks, MADE.detections, MADE.scans))) <= 12
