"""Films by what the extra `video` installs, read back."""

from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.baselines.nearest_neighbour import NearestNeighbour
from gmr_gym.envs.render import Canvas
from gmr_gym.replay.film import _single, film, write
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.single_target import draw

ffmpeg = pytest.importorskip("imageio_ffmpeg")
SCANS = 4


def pictures(file):
    """Every frame (height, width, 3) of the film."""
    frames = ffmpeg.read_frames(str(file))
    width, height = next(frames)["size"]
    return [np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in frames]


def test_an_mp4_shows_what_was_drawn_scan_by_scan(tmp_path):
    scenario = turning_target(horizon=SCANS, clutter_rate=20)
    tracker, episode = NearestNeighbour(scenario.model), draw(scenario, 1)
    film(scenario, {"nearest": tracker}, 1, tmp_path / "f.mp4", size=(400, 400), fps=20)
    canvas = Canvas(scenario, titles=["nearest"], size=(400, 400), tracked=True)
    drawn = [
        canvas.draw(episode, t, [shown]).astype(float)
        for t, shown in enumerate(_single(scenario, tracker, episode))
    ]
    films = pictures(tmp_path / "f.mp4")
    assert len(films) == len(drawn) == SCANS
    for t, picture in enumerate(films):
        apart = [np.abs(picture - one).mean() for one in drawn]  # of 255; the coding loses some
        assert np.argmin(apart) == t and apart[t] < 3, apart


def test_an_mp4_that_ffmpeg_leaves_unfinished_is_an_error_and_no_file(tmp_path, monkeypatch):
    def cut_off(file, *options, **more):
        Path(file).write_bytes(b"begun")
        while (yield) is not None:
            pass

    monkeypatch.setattr(ffmpeg, "write_frames", cut_off)
    with pytest.raises(OSError, match="ffmpeg could not write the film to its end"):
        write(tmp_path / "f.mp4", [np.zeros((8, 8, 3), np.uint8)] * 2, 2)
    assert list(tmp_path.iterdir()) == []


def test_gymnasium_records_an_environment_to_an_mp4(tmp_path):
    pytest.importorskip("moviepy")
    env = gym.make("gmr_gym/TurningTarget-v0", render_mode="rgb_array", horizon=SCANS)
    env = gym.wrappers.RecordVideo(env, str(tmp_path / "films"), disable_logger=True)
    env.reset(seed=1)
    while not env.step(env.action_space.sample())[3]:
        pass
    env.close()
    (file,) = (tmp_path / "films").glob("*.mp4")
    assert len(pictures(file)) == SCANS + 1
