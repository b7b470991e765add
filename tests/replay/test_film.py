"""Films and pictures: what is drawn is in the file, in its colours, frame by frame."""

import re
from itertools import cycle, islice
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image, ImageColor

from gmr_gym.envs.render import Canvas
from gmr_gym.envs.render_marks import CLUTTER, ESTIMATE, GATES, HYPOTHESIS, INK, TRUTH
from gmr_gym.envs.render_multi_target import MultiTargetCanvas
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import Report
from gmr_gym.models.gating import Gates
from gmr_gym.replay.film import _many, _single, film, write
from gmr_gym.replay.gif import Palette
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.simulation.multi_target import draw as draw_many
from gmr_gym.simulation.single_target import draw

SIZE = 320, 320
SCANS = 3


class Lost:
    """A tracker that reports where nothing is."""

    def __init__(self, scenario):
        self.model = scenario.model

    def init(self):
        return None

    def step(self, belief, z):
        p = self.model.prior
        away = p._replace(m=p.m + 1e5)
        return None, Report(away.m, away.P, Gates(away.m[:, :2], away.P[:, :2, :2], 9.0), away)


@pytest.fixture(scope="module")
def one():
    return turning_target(horizon=SCANS, clutter_rate=20)


@pytest.fixture(scope="module")
def pictures(one):
    """Pictures of a tracked target, and of many."""
    canvas, many = Canvas(one, titles=["a"], size=SIZE, tracked=True), unknown_clutter(horizon=SCANS)
    several = MultiTargetCanvas(many, titles=["b"], size=(400, 480), tracked=True)
    trackers = make_tracker("runnalls-5", one.model), make_tracker("gm-phd", many.model)
    episode, crowd = draw(one, 1), draw_many(many, 1)
    return {
        "one": [canvas.draw(episode, t, [each]) for t, each in enumerate(_single(one, trackers[0], episode))],
        "many": [several.draw(crowd, t, [each]) for t, each in enumerate(_many(many, trackers[1], crowd))],
    }


def frames(file):
    """Frames (height, width, 3) and their durations, ms."""
    with Image.open(file) as shown:
        found = []
        for i in range(shown.n_frames):
            shown.seek(i)
            found.append((np.asarray(shown.convert("RGB")), shown.info["duration"]))
    return found


def packed(colours):
    return np.asarray(colours, np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)


@pytest.mark.parametrize("length", [1, 2, 200])
@pytest.mark.parametrize("what", ["one", "many"])
def test_a_film_of_any_length_keeps_the_colours_of_what_is_drawn(pictures, what, length, tmp_path):
    write(tmp_path / "f.gif", islice(cycle(pictures[what]), length), length)
    found = frames(tmp_path / "f.gif")
    assert len(found) == length
    inks = INK, CLUTTER, TRUTH, ESTIMATE, HYPOTHESIS, *([GATES] if what == "one" else [])
    exact = packed([ImageColor.getrgb(ink) for ink in inks])
    for shown, _ in found:
        assert np.isin(exact, packed(shown)).all()
    for i in {0, 1, length - 1} & set(range(length)):
        drawn = pictures[what][i % SCANS].astype(int)
        off = np.abs(found[i][0] - drawn).max(axis=2)
        for channel in (0, 1):  # the estimate's red and the truth's green, in the legend and out of it
            inked = drawn[..., channel] - np.delete(drawn, channel, axis=2).max(axis=2) > 40
            assert inked.sum() > 10 and off[inked].max() < 40
        assert off.mean() < 0.5


def test_hypotheses_of_little_weight_are_fainter_in_the_file_too():
    palette, ink = Palette(), np.array(ImageColor.getrgb(HYPOTHESIS))
    shares = np.linspace(0.05, 1, 20)
    drawn = np.round(255 + shares[:, None] * (ink - 255.0)).astype(np.uint8)[None]
    shown = palette.colours[palette.indices(drawn)].astype(int)[0]
    assert (np.diff(shown[:, 0]) <= 0).all() and len(np.unique(shown, axis=0)) > 6
    np.testing.assert_array_equal(shown[-1], ink)


@pytest.mark.parametrize(("fps", "duration"), [(10, 100), (25, 40), (3, 330)])
def test_a_frame_a_scan_each_as_long_but_the_last_which_stays(one, fps, duration, tmp_path):
    done = []
    film(
        one, {"lost": Lost(one)}, 1, tmp_path / "f.gif", size=SIZE, fps=fps, scans=2,
        progress=lambda *count: done.append(count),
    )  # fmt: skip
    assert done == [(1, 2), (2, 2)]
    shown = frames(tmp_path / "f.gif")
    assert [each[1] for each in shown] == [duration, duration + 1500]
    assert shown[0][0].shape == (*SIZE, 3)
    assert (shown[0][0] != shown[1][0]).any()


def test_frames_that_do_not_differ_are_frames_all_the_same(tmp_path):
    write(tmp_path / "f.gif", [np.full((8, 8, 3), 255, np.uint8)] * 3, 3)
    assert len(frames(tmp_path / "f.gif")) == 3


def test_a_frame_is_written_before_the_next_is_drawn(tmp_path):
    """So that no film is too long for the memory."""
    rng, held = np.random.default_rng(0), []

    def noise():
        for _ in range(4):
            held.append(sum(file.stat().st_size for file in tmp_path.iterdir()))
            yield rng.integers(0, 256, (300, 300, 3), dtype=np.uint8)

    write(tmp_path / "f.gif", noise(), 4)
    assert np.diff(held).min() > 10_000


def texts(svg):
    return re.findall(r"<!-- (.*?) -->", svg)


def test_a_scan_as_vectors_has_its_titles_ellipses_and_the_one_that_lost_the_target(one, tmp_path):
    trackers = {"mine, the first": make_tracker("runnalls-5", one.model), "the other": Lost(one)}
    film(one, trackers, 1, tmp_path / "f.svg", frame=2)
    svg = (tmp_path / "f.svg").read_text(encoding="utf-8")
    root = ElementTree.fromstring(svg)
    assert root.tag.endswith("svg") and "<image" not in svg
    said = texts(svg)
    assert "mine, the first  t = 2 s" in said and "the other  t = 2 s" in said
    assert said.count("target lost at scan 1") == 1
    for mark in ("detections", "target-originated detection", "truth", "estimate", "gates", "hypotheses,"):
        assert sum(text.startswith(mark) for text in said) == 1, mark  # named once for both
    (paths,) = re.findall(r'<g id="EllipseCollection_1">(.*?)</g>\s*<g id="Ell', svg, re.S)
    assert re.search(r' d="M [^"]* C ', paths.replace("\n", " "))
    film(one, trackers, 1, tmp_path / "again.svg", frame=2)
    assert (tmp_path / "again.svg").read_text(encoding="utf-8") == svg


def test_a_scan_as_pixels_is_of_the_size_that_is_asked_for(one, tmp_path):
    for size, wanted in (((400, 300), (400, 300)), ((402, 0), (402, None))):
        film(one, {"lost": Lost(one)}, 1, tmp_path / "f.png", frame=SCANS, size=size)
        with Image.open(tmp_path / "f.png") as picture:
            width, height = picture.size
            assert width == wanted[0] and height == (wanted[1] or height) and height % 2 == 0


@pytest.mark.parametrize(
    ("out", "number", "how", "message"),
    [
        ("f.avi", 1, {}, "out must end in .gif, .mp4, .png or .svg, got 'f.avi'"),
        ("f.png", 1, {}, "f.png is one picture: say of which scan by frame (--frame K), from 1"),
        ("f.gif", 1, {"frame": 1}, "frame is for one picture, .png or .svg, got 'f.gif'"),
        ("f.png", 1, {"frame": 4}, "frame must be from 1 to the 3 scans of the episode, got 4"),
        ("f.png", 1, {"frame": 3, "scans": 2}, "frame must be from 1 to the 2 scans of the episode, got 3"),
        ("f.svg", 1, {"frame": 0}, "frame must be from 1 to the 3 scans of the episode, got 0"),
        ("f.gif", 1, {"scans": 4}, "scans must be from 1 to the 3 of the episode, got 4"),
        ("f.gif", 1, {"fps": 0}, "fps must be between 0.1 and 50, got 0"),
        ("f.gif", 1, {"fps": float("nan")}, "fps must be between 0.1 and 50, got nan"),
        ("f.gif", 1, {"size": (4001, 0)}, "size must be between 1 and 4000 pixels a side, got 4001"),
        ("f.gif", 1, {"size": (300, -1)}, "size must be between 1 and 4000 pixels a side, got -1"),
        ("f.gif", 4, {"size": (300, 300)}, "size 300x300 leaves no room for 4 panels and the legend"),
        ("f.gif", 5, {}, "trackers must be from 1 to 4, got 5"),
        ("f.gif", 0, {}, "trackers must be from 1 to 4, got 0"),
    ],
)
def test_what_no_film_can_be_made_of_is_named(one, out, number, how, message, tmp_path):
    trackers = {str(i): Lost(one) for i in range(number)}
    with pytest.raises(ValueError, match=re.escape(message)):
        film(one, trackers, 1, tmp_path / out, **how)
    assert list(tmp_path.iterdir()) == []


def test_a_long_name_ends_where_its_panel_does(one, tmp_path):
    trackers = {f"{i}: a name of {40 * 'many '} words": Lost(one) for i in range(2)}
    film(one, trackers, 1, tmp_path / "f.svg", frame=1)
    first, second = (text for text in texts((tmp_path / "f.svg").read_text("utf-8")) if "a name" in text)
    assert first.startswith("0: a name of many") and first.endswith("…  t = 1 s") and len(first) < 70
    assert second.startswith("1: a name of many")


@pytest.mark.parametrize(
    ("seed", "how", "message"),
    [
        (-1, {}, "seed must be at least 0, got -1"),
        (None, {}, "seed must be a whole number, got None"),
        (1, {"scans": 2.5}, "scans must be from 1 to the 3 of the episode, got 2.5"),
        (1, {"frame": 1.5}, "frame must be from 1 to the 3 scans of the episode, got 1.5"),
    ],
)
def test_numbers_that_are_not_whole_are_named(one, seed, how, message, tmp_path):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        film(one, {"lost": Lost(one)}, seed, tmp_path / "f.png", **({"frame": 1} | how))


class Changed(Lost):
    """A tracker with other fields in its reports."""

    def __init__(self, scenario, **fields):
        self.model, self.fields = scenario.model, fields

    def step(self, belief, z):
        return None, super().step(belief, z)[1]._replace(**self.fields)


def test_a_tracker_with_no_hypothesis_is_filmed_and_a_wrong_report_is_named(one, tmp_path):
    nothing = one.model.prior._replace(w=np.empty(0), m=np.empty((0, 4)), P=np.empty((0, 4, 4)))
    film(one, {"empty": Changed(one, mixture=nothing)}, 1, tmp_path / "f.png", frame=1)
    with pytest.raises(ValueError, match=r"^tracker 'mine', x at scan 1: expected shape \(1, 4\), got"):
        film(one, {"mine": Changed(one, x=np.zeros(4))}, 1, tmp_path / "f.gif")
    follows = turning_target(horizon=SCANS, clutter_rate=20, window=(300.0, 300.0))
    with pytest.raises(ValueError, match=r"^tracker 'mine', x at scan 1: the window follows the estimate"):
        film(follows, {"mine": Changed(one, x=np.full((1, 4), np.nan))}, 1, tmp_path / "f.gif")


def test_a_video_without_its_extra_is_refused_before_anything_is_drawn(one, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(ImportError, match=r"a \.mp4 needs the extra `video`"):
        film(one, {"lost": Lost(one)}, 1, tmp_path / "f.mp4", progress=pytest.fail)
