"""Films: the colours of what is drawn are those of the file, however long it is."""

from itertools import cycle, islice

import numpy as np
import pytest
from PIL import Image

from gmr_gym.envs.render import Canvas
from gmr_gym.envs.render_multi_target import MultiTargetCanvas
from gmr_gym.evaluation.loop import play
from gmr_gym.experiments.film import _gif
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.simulation.multi_target import draw as draw_crowd
from gmr_gym.simulation.multi_target import scan as crowd_scan
from gmr_gym.simulation.single_target import draw


@pytest.fixture(scope="module")
def pictures():
    """Two pictures of a tracked target, and two of many."""
    scenario, world = turning_target(horizon=2, clutter_rate=20), unknown_clutter(horizon=2)
    episode, canvas, estimates = draw(scenario, 1), Canvas(scenario), []
    one = []
    for t, seen, report, _ in play(scenario, make_tracker("runnalls-5", scenario.model), episode):
        estimates.append(report.x[0])
        one.append(canvas.draw(episode, seen, t, estimates, report))
    crowd, canvas = draw_crowd(world, 1), MultiTargetCanvas(world)
    found = [np.array([[100.0, 200.0]])]
    many = [canvas.draw(crowd, crowd_scan(crowd, t), t, (t + 1) * found) for t in range(2)]
    return {"one": one, "many": many}


@pytest.mark.parametrize("length", [1, 2, 200])
@pytest.mark.parametrize("what", ["one", "many"])
def test_a_film_of_any_length_keeps_the_colours_of_its_legend(pictures, what, length, tmp_path):
    _gif(tmp_path / "f.gif", list(islice(cycle(pictures[what]), length)))
    with Image.open(tmp_path / "f.gif") as film:
        assert film.n_frames == length
        for i in {0, 1, length - 1} & set(range(length)):
            film.seek(i)
            shown, drawn = np.asarray(film.convert("RGB"), int), pictures[what][i % 2].astype(int)
            off = np.abs(shown - drawn).max(axis=2)
            for channel in (0, 1):  # the estimate's red and the truth's green, in the legend and out of it
                inked = drawn[..., channel] - np.delete(drawn, channel, axis=2).max(axis=2) > 40
                assert inked.sum() > 10 and off[inked].max() < 40
            assert off.mean() < 0.5
