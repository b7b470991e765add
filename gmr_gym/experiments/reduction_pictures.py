"""A mixture beside what reductions leave of it: densities in one dimension, ellipses in two."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from gmr_gym.envs.render_marks import CLUTTER, HYPOTHESIS, INK, TRUTH, add_ellipses, ring
from gmr_gym.experiments.drawings import canvas
from gmr_gym.mixture import Mixture, log_density, take
from gmr_gym.reduction.protocol import Reduced

SIGMAS, REACH = 2.0, 4.0  # standard deviations: of an ellipse, and that are drawn of a density
POINTS, OF_EACH = 1000, 41  # where densities are drawn: on the whole, and beside those for each component


def picture(p: Mixture, reduced: Mapping[str, Reduced], axes: Sequence[int]) -> Drawing:
    """A panel for every title with the mixture and what is left of it, in one dimension, or in the two
    coordinates `axes`."""
    columns = 2 - len(reduced) % 2
    rows = len(reduced) // columns
    drawing, panels = canvas(
        1 + 5 * columns, 0.6 + 3.2 * rows, rows, columns, sharex=True, sharey=True, squeeze=False
    )
    draw = _densities if p.m.shape[1] == 1 else _ellipses
    with rc_context({"text.parse_math": False}):
        for panel, (title, (q, origin)) in zip(panels.flat, reduced.items(), strict=True):
            marks = draw(panel, p, q, origin, [*axes])
            panel.set_title(title, fontsize=9)
    panels[0, 0].legend(handles=marks, fontsize=7)
    return drawing


def _densities(axes: Any, p: Mixture, q: Mixture, origin: np.ndarray, _: list[int]) -> list[Line2D]:
    """Draw the densities, and give what stands for them in a legend."""
    x = _points(p, q)
    full = axes.plot(x, np.exp(log_density(p, x)), color=TRUTH, lw=2, label="full")
    reduced = axes.plot(x, np.exp(log_density(q, x)), color=INK, lw=1, label="reduced")
    for j in range(len(q.w)):
        one = np.exp(log_density(take(q, np.array([j])), x))
        part = axes.plot(x, one, color=HYPOTHESIS, lw=1, ls=":", label="its components")
    axes.set(ylim=(0, None))
    return [*full, *reduced, *part]


def _points(p: Mixture, q: Mixture) -> np.ndarray:
    """Points (k, 1), in order, as far as p reaches, that show every component of both, however narrow."""
    reach = REACH * np.sqrt(p.P[:, 0])
    low, high = (p.m - reach).min(), (p.m + reach).max()
    about = [(m + np.sqrt(P[:, 0]) * np.linspace(-REACH, REACH, OF_EACH)).ravel() for _, m, P in (p, q)]
    return np.unique(np.clip(np.concatenate([np.linspace(low, high, POINTS), *about]), low, high))[:, None]


def _ellipses(axes: Any, p: Mixture, q: Mixture, origin: np.ndarray, drawn: list[int]) -> list[Line2D]:
    """Draw the ellipses and which goes into which, and give what stands for them in a legend."""
    for i, j in enumerate(origin):
        if j >= 0:
            axes.plot(*np.array([p.m[i, drawn], q.m[j, drawn]]).T, color=CLUTTER, lw=0.5)
    for mixture, colour in ((p, CLUTTER), (q, HYPOTHESIS)):
        m, P = mixture.m[:, drawn], mixture.P[:, drawn][:, :, drawn]
        axes.plot(*m.T, ".", color=colour, ms=3)
        reach = SIGMAS * np.sqrt(np.diagonal(P, axis1=1, axis2=2))
        axes.update_datalim(np.concatenate([m - reach, m + reach]))
        add_ellipses(axes, m, SIGMAS**2 * P, colour, 1.0)
    axes.autoscale_view()
    axes.set(xlabel=f"x{drawn[0] + 1}", ylabel=f"x{drawn[1] + 1}")
    return [ring(CLUTTER, "full"), ring(HYPOTHESIS, "reduced")]
