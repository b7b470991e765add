"""Canvases: one that has drawn other scans draws the same picture, all panels show the same part of the
plane, and every mark has a name beside them."""

import numpy as np
import pytest

from gmr_gym.envs.render import Canvas, Tracked
from gmr_gym.envs.render_multi_target import MultiTargetCanvas
from gmr_gym.envs.render_sheet import LARGEST, Sheet
from gmr_gym.filters.tracker import MultiTargetReport, Report
from gmr_gym.mixture import Mixture
from gmr_gym.models.gating import Gates
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.simulation import multi_target, single_target

SCANS, MARKS = 3, ["detections", "target-originated detection", "truth", "estimate", "gates"]
FAINT = "hypotheses, faint: of low weight"


def one_target(threshold=9.0, **settings):
    """A scenario, an episode, and what is shown of each scan: hypotheses near the truth."""
    scenario = turning_target(horizon=SCANS, clutter_rate=20, **settings)
    episode, shown, path = single_target.draw(scenario, 1), [], []
    for t in range(SCANS):
        m = episode.x[t] + np.array([[5.0, 0, 0, 0], [-8.0, 3, 0, 0]])
        P = np.tile(np.eye(4) * 60.0, (2, 1, 1))
        path.append(m[0])
        gates = Gates(m[:, :2], P[:, :2, :2], threshold)
        report = Report(m[:1], P[:1], gates, Mixture(np.array([0.9, 0.1]), m, P))
        seen = single_target.scan(scenario, episode, t, scenario.centre(m[0]))
        shown.append(Tracked(seen, path[: t + 1], report, [2] * (t + 1), 1 if t > 0 else -1))
    return scenario, episode, shown


def many_targets(**settings):
    """The same of many."""
    scenario = unknown_clutter(horizon=SCANS, **settings)
    episode, shown, path = multi_target.draw(scenario, 1), [], []
    for t in range(SCANS):
        x = episode.x[t][np.isfinite(episode.x[t]).all(axis=1)]
        path.append(x[:, list(scenario.position)])
        p = Mixture(np.ones(len(x)), x, np.tile(np.eye(6) * 60.0, (len(x), 1, 1)))
        report = MultiTargetReport(
            x, np.ones(len(x)), np.full(len(x), -1), float(len(x)), p, scenario.clutter(t)
        )
        shown.append(Tracked(multi_target.scan(episode, t), path[: t + 1], report))
    return scenario, episode, shown


WORLDS = {
    "fixed view": (Canvas, one_target, {}),
    "view that follows": (Canvas, one_target, {"window": (300, 300)}),
    "many targets": (MultiTargetCanvas, many_targets, {}),
}


def canvases(what, count, panels=1):
    make, world, settings = WORLDS[what]
    scenario, episode, shown = world(**settings)
    titles = [f"tracker {i}" for i in range(panels)]
    found = [make(scenario, titles=titles, size=(400 * panels, 0), tracked=True) for _ in range(count)]
    return found, episode, shown


@pytest.mark.parametrize("what", WORLDS)
def test_a_canvas_that_has_drawn_other_scans_draws_the_same_picture(what):
    (used, fresh), episode, shown = canvases(what, 2)
    pictures = [used.draw(episode, t, [shown[t]]) for t in (0, 2, 1)]
    np.testing.assert_array_equal(pictures[2], fresh.draw(episode, 1, [shown[1]]))
    assert (pictures[1] != pictures[2]).any()


@pytest.mark.parametrize("what", WORLDS)
def test_panels_show_the_same_part_of_the_plane_and_one_legend_names_all_marks_beside_them(what):
    (canvas,), episode, shown = canvases(what, 1, panels=2)
    away = shown[2]._replace(estimates=[each + 1e4 for each in shown[2].estimates])
    canvas.draw(episode, 2, [shown[2], away])
    first, second, *strips = canvas.figure.axes
    assert (first.get_xlim(), first.get_ylim()) == (second.get_xlim(), second.get_ylim())
    assert len({strip.get_ylim() for strip in strips}) == 1
    assert [axes.texts[0].get_text() for axes in (first, second)] == [
        "tracker 0  t = 3 s",
        "tracker 1  t = 3 s",
    ]
    (legend,) = canvas.figure.legends
    named = [text.get_text() for text in legend.get_texts()]
    assert len(named) == len({*named})
    marks = ["true clutter, 95 %", "clutter assumed, 95 %", *MARKS[:3], "estimates"]
    assert {*named} == {FAINT, *(marks if what == "many targets" else MARKS)}
    box = legend.get_window_extent()
    assert not any(box.overlaps(axes.get_window_extent()) for axes in canvas.figure.axes)
    assert box.x0 >= 0 and box.x1 <= canvas.figure.bbox.x1 and box.y0 >= 0


def test_gates_without_end_are_not_named_and_only_a_lost_target_is_marked():
    scenario, episode, shown = one_target(threshold=np.inf)
    canvas = Canvas(scenario, tracked=True)
    for t, said in ((0, ""), (1, "target lost at scan 2")):
        canvas.draw(episode, t, [shown[t]])
        assert canvas.figure.axes[0].texts[1].get_text() == said
    assert "gates" not in [text.get_text() for text in canvas.figure.legends[0].get_texts()]


def test_what_is_not_finite_is_left_out_and_the_view_stays_about_the_target():
    scenario, episode, shown = one_target(window=(300, 300))
    p, one = shown[1].report.mixture, shown[1]
    m = p.m.copy()
    m[0] = np.nan
    broken = one._replace(
        estimates=[one.estimates[0], m[0]], report=one.report._replace(mixture=p._replace(m=m))
    )
    canvas = Canvas(scenario, tracked=True)
    canvas.draw(episode, 1, [broken])
    axes = canvas.figure.axes[0]
    np.testing.assert_array_equal(axes.collections[1].get_offsets(), m[1:, :2])
    assert np.allclose(np.mean([axes.get_xlim(), axes.get_ylim()], axis=1), episode.x[1, :2])


@pytest.mark.parametrize("size", [(0, 640), (640, -1), (LARGEST + 1, 640)])
def test_a_size_that_is_absurd_is_named(size):
    (off,) = {*size} - {640}
    with pytest.raises(ValueError, match=f"size must be between 1 and 4000 pixels a side, got {off}$"):
        Sheet(size)


@pytest.mark.parametrize("size", [(640, 120), (100, 640)])
def test_a_size_that_leaves_no_room_is_named(size):
    with pytest.raises(
        ValueError, match=f"size {size[0]}x{size[1]} leaves no room for a panel and the legend"
    ):
        Sheet(size, strips=1, marks=6)
