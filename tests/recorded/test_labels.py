"""Rows of the input with their tracks: nothing else of them changes."""

import gzip
import json

import numpy as np
import pytest
from made_tracks import made

from gmr_gym.recorded.labels import labels, write_labelled
from gmr_gym.recorded.reading import read

MADE = made(seed=5, scans=6)


def plots(delimiter=",", ending="\n"):
    """The detections as text, with a comment before the header."""
    z, time = MADE.detections.z.tolist(), MADE.detections.time.tolist()
    rows = [[f"{t}", f"{x}", f"{y}", f"plot {i}"] for i, (t, (x, y)) in enumerate(zip(time, z, strict=True))]
    head = ["# from a radar", delimiter.join(["time_s", "x_m", "y_m", "note"])]
    return ending.join([*head, *(delimiter.join(row) for row in rows)]) + ending


def test_the_heaviest_track_is_a_detections_own():
    tracks = MADE.tracks
    first = np.flatnonzero(tracks.detection >= 0)[0]
    again = type(tracks)(*(np.concatenate([column, column[first : first + 1]]) for column in tracks))
    again.track[-1], again.weight[-1] = 7, 0.3
    track, weight = labels(again, len(MADE.detections.time))
    for i in range(len(track)):
        rows = np.flatnonzero(tracks.detection == i)
        assert track[i] == (tracks.track[rows[0]] if len(rows) else 0)
        assert weight[i] == (tracks.weight[rows[0]] if len(rows) else 0)


@pytest.mark.parametrize(("delimiter", "ending"), [(",", "\n"), (";", "\r\n"), ("\t", "\n")])
def test_lines_of_text_stay_as_they_are(tmp_path, delimiter, ending):
    source, out = tmp_path / "plots.csv", tmp_path / "labelled.csv"
    text = plots(delimiter, ending)
    source.write_bytes(gzip.compress(text.encode()) if delimiter == "\t" else text.encode())
    found = read(source)
    write_labelled(out, MADE.tracks, found, source)
    before, after = text.split(ending), out.read_bytes().decode().split(ending)
    assert after[0] == before[0]
    assert after[1] == delimiter.join([before[1], "track_id", "weight"])
    track, weight = labels(MADE.tracks, len(found.time))
    for i in range(len(track)):
        own = [str(track[i]), f"{weight[i]:.6g}"] if track[i] else ["", ""]
        assert after[2 + i] == delimiter.join([before[2 + i], *own])
    assert after[-1] == before[-1] == ""


def test_signs_that_end_no_line_of_a_file_end_none_here(tmp_path):
    source, out = tmp_path / "plots.csv", tmp_path / "labelled.csv"
    text = plots().replace("plot", "a\u2028b\x0bc")
    source.write_text(text, encoding="utf-8")
    write_labelled(out, MADE.tracks, read(source), source)
    assert [line.rsplit(",", 2)[0] for line in out.read_text(encoding="utf-8").split("\n")[2:-1]] == (
        text.split("\n")[2:-1]
    )
    track, _ = labels(MADE.tracks, len(MADE.detections.time))
    found = [line.split(",")[-2] for line in out.read_text(encoding="utf-8").split("\n")[2:-1]]
    assert found == [str(one or "") for one in track]


def test_rows_that_were_not_tracked_have_no_label(tmp_path):
    source, out = tmp_path / "plots.csv", tmp_path / "labelled.csv"
    lines = plots().splitlines()
    source.write_text("\n".join([*lines, lines[-1]]) + "\n")  # the last row twice
    found = read(source)
    assert len(found.time) == len(MADE.detections.time)
    write_labelled(out, MADE.tracks, found, source)
    assert out.read_text().splitlines()[-1] == lines[-1] + ",,"


def test_of_json_the_detections_are_written(tmp_path):
    source, out = tmp_path / "plots.json", tmp_path / "labelled.csv"
    z, time = MADE.detections.z.tolist(), MADE.detections.time.tolist()
    source.write_text(
        json.dumps([{"time_s": t, "x_m": x, "y_m": y} for t, (x, y) in zip(time, z, strict=True)])
    )
    write_labelled(out, MADE.tracks, read(source), source)
    header, *rows = (line.split(",") for line in out.read_text().splitlines())
    assert header[0] == "record" and header[-2:] == ["track_id", "weight"]
    track, _ = labels(MADE.tracks, len(time))
    assert [row[0] for row in rows] == [str(i + 1) for i in range(len(time))]
    assert [int(row[-2] or 0) for row in rows] == track.tolist()


def test_detections_that_are_no_text_are_written_where_they_are(tmp_path):
    """Whatever the file's own coordinates are: metres east and north, and degrees."""
    source, out = tmp_path / "plots.json", tmp_path / "labelled.csv"
    places = [(58.0, 10.0), (58.01, 10.02)]
    source.write_text(json.dumps([{"time_s": i, "lat": a, "lon": b} for i, (a, b) in enumerate(places)]))
    found = read(source)
    write_labelled(
        out, MADE.tracks._replace(detection=np.full_like(MADE.tracks.detection, -1)), found, source
    )
    header, *rows = (line.split(",") for line in out.read_text().splitlines())
    assert header == ["record", "time", "x_m", "y_m", "lat", "lon", "identity", "track_id", "weight"]
    np.testing.assert_allclose(np.array([row[4:6] for row in rows], float), places, atol=1e-6)
    np.testing.assert_allclose(np.array([row[2:4] for row in rows], float), found.z)
