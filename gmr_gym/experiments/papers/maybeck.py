"""Maybeck, Kozak and Smith: Table I and Figs. 3-7 on a reconstructed flight, with other reductions, without
clutter, with a stickier IMM and with missed detections. The paper's sentences are in maybeck_claims."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.summary import Estimate, bootstrap_mean
from gmr_gym.experiments.drawings import by_tracker, canvas, legend_above, save
from gmr_gym.experiments.evidence import Evidence, Results, Rows, all_measured, error_differences, error_rows
from gmr_gym.experiments.papers.maybeck_claims import ASKED, PRINTED
from gmr_gym.experiments.papers.maybeck_numbers import ERRORS, QUANTITIES, SPANS, UNITS, average, rms
from gmr_gym.experiments.tables import Paper, Table, plainly
from gmr_gym.simulation.single_target import Scenario

COLUMNS = (
    "track_loss", *(f"{error}_own" for error in ERRORS.values()), "components", "gate_area", "time_per_scan",
)  # fmt: skip
ROLES = ("aggressive", "mmae", "imm", "mmae_of", "imm_of")
STICKIER = ((0.98, 0.02), (0.02, 0.98))
# Departs: the paper bounds nothing. Hypotheses that enter the reduction of a scan, the heaviest, two MHTs
# sharing alike; the paper counts just over 100 on average, from about 30 to over 200
MOST = 200
BANDS = {"aggressive": "figure-5", "mmae": "figure-6", "imm": "figure-7"}
LABELS = ("north, m", "up, m", "north, m/s", "up, m/s")


def _mhts(reduction: str) -> dict[str, dict[str, Any]]:
    """The trackers of Table I, their hypotheses reduced to 15."""
    return {
        f"one-motion-15:mode=1,reduction={reduction}": {"max_hypotheses": MOST},
        f"mmae-mht-15:reduction={reduction}": {"max_hypotheses": MOST},
        f"imm-mht-15:reduction={reduction}": {"max_hypotheses": MOST},
        f"mmae-of-mhts-15:reduction={reduction}": {"max_hypotheses": MOST // 2},
        f"imm-of-mhts-15:reduction={reduction}": {"max_hypotheses": MOST // 2},
    }


def _rows(scenario: Scenario, results: Results) -> Rows:
    """One row per tracker: share of runs lost; temporally averaged rms errors of position (m) and velocity
    (m/s), of the whole flight and of its level part, `_own` over the runs the tracker kept, as in Table I,
    and `_common` over those that all trackers kept that kept any; components; gate area (m^2) of runs kept;
    time a scan (s)."""
    every = all_measured(QUANTITIES, scenario, results)
    rows = error_rows(every, tuple(ERRORS.values()), _errors)
    for name, one in every.items():
        runs = results[name]
        rows[name] |= {
            "components": bootstrap_mean(runs.components.mean(axis=1)),
            # a track given up coasts, and its gates grow without bound
            "gate_area": bootstrap_mean(runs.gate_volume[one.kept].mean(axis=1)),
            "time_per_scan": Estimate(float(np.median(runs.seconds))),
            "time_worst": Estimate(float(runs.seconds.max())),
        }
    return rows


def _errors(one: Evidence, weight: np.ndarray) -> np.ndarray:
    return np.array([rms(one, quantity, SPANS[span], weight) for quantity, span in ERRORS])


def _table(
    name: str, title: str, trackers: dict[str, dict[str, Any]], roles: tuple[str, ...], **settings: Any
) -> Table:
    rows = PRINTED.get(name, {})
    return Table(
        name, title, "gmr_gym/AgileFlight-v0", settings, trackers,
        published={spec: rows[role] for spec, role in zip(trackers, roles, strict=True) if role in rows},
        runs=50, summarise=_rows, columns=COLUMNS, roles=roles,
        paired=partial(error_differences, QUANTITIES, tuple(ERRORS.values()), _errors),
    )  # fmt: skip


ISE, RUNNALLS = _mhts("ise"), _mhts("runnalls")
CLEAR = plainly(("one-motion:mode=1", "mmae", "imm"))
BENIGN = {
    f"one-motion-15:mode=0,reduction={which}": {"max_hypotheses": MOST} for which in ("ise", "runnalls")
}
TABLES = (
    _table("1", "Table I, reduced by ISE", ISE, ROLES),
    _table("benign", "MHT of benign filters", BENIGN, ("benign", "benign-runnalls")),
    _table("clear", "no clutter", CLEAR, ROLES[:3], clutter_density=0.0),
    _table("1-runnalls", "Table I, reduced by Runnalls", RUNNALLS, ROLES),
    _table("switching", "an IMM that stays with probability 0.98, reduced by ISE",
           dict(list(ISE.items())[:3]), ROLES[:3], switching=STICKIER),
    _table("clear-switching", "no clutter, an IMM that stays with probability 0.98",
           CLEAR, ROLES[:3], clutter_density=0.0, switching=STICKIER),
    _table("missed", "P_D = 0.9, reduced by Runnalls", RUNNALLS, ROLES, detection_probability=0.9),
)  # fmt: skip


def figures(table: Table, scenario: Scenario, results: Results, rows: Rows, out: Path) -> None:
    """Errors and runs not lost by epoch; mode probabilities (Figs. 3-4); for Table I error bands against
    filter bands (Figs. 5-7)."""
    every = all_measured(QUANTITIES, scenario, results)
    epochs = np.arange(1, scenario.horizon + 1)
    save(_errors_by_epoch(every, epochs), out / f"errors-{table.name}.png")
    jerk = _jerk(next(iter(results.values())).truth[0], scenario.period)
    for name, one in every.items():
        if name.startswith("mmae"):
            figure = out / f"probabilities-{table.name}-{name.partition(':')[0]}.png"
            save(_probabilities(name, one, epochs, jerk), figure)
    if table.name == "1":
        aggressive = next(iter(every.values()))
        for name, role in zip(every, ROLES, strict=False):  # without roles: trackers of the user's own
            if role in BANDS:
                save(_bands(name, every[name], aggressive, epochs), out / f"{BANDS[role]}.png")


def _jerk(truth: np.ndarray, period: float) -> np.ndarray:
    """Magnitude of the flight's jerk (T,), m/s^3, from its accelerations."""
    return np.linalg.norm(np.gradient(truth[:, 4:], period, axis=0), axis=1)


def _alive(one: Evidence, epochs: np.ndarray) -> np.ndarray:
    """Runs not lost, by epoch (T,)."""
    at = np.where(one.lost_at < 0, len(epochs), one.lost_at)
    return (at[:, None] >= epochs).sum(axis=0)


def _rms(quantity: str, one: Evidence) -> np.ndarray:
    """Over the runs kept, by epoch (T,)."""
    return np.sqrt(average(getattr(one, quantity), one))


def _errors_by_epoch(every: Mapping[str, Evidence], epochs: np.ndarray) -> Drawing:
    curves = {
        f"{quantity} rms error, {unit}": {name: _rms(quantity, one) for name, one in every.items()}
        for quantity, unit in UNITS.items()
    }
    curves["runs not lost"] = {name: _alive(one, epochs) for name, one in every.items()}
    drawing, (*panels, alive) = by_tracker(9, 9, epochs, curves)
    if any(one.kept.any() for one in every.values()):  # nothing has no logarithm
        for axes in panels:
            axes.set_yscale("log")
    legend_above(drawing, title="over the runs kept by each", ncols=2, fontsize=8)
    alive.set(xlabel="epoch", ylim=(0, None))
    return drawing


def _probabilities(name: str, one: Evidence, epochs: np.ndarray, jerk: np.ndarray) -> Drawing:
    """Mean and deviation over the runs kept of the benign motion's probability, that of the first of them,
    and the flight's jerk."""
    drawing, (many, single, below) = canvas(9, 8, 3, 1, sharex=True)
    benign = 1 - one.aggressive
    middle = average(benign, one)
    deviation = np.sqrt(average((benign - middle) ** 2, one))
    many.plot(epochs, middle, "C0")
    many.fill_between(epochs, middle - deviation, middle + deviation, color="C0", alpha=0.25, lw=0)
    many.set(title=f"{name}: probability of the benign motion, mean and deviation over runs")
    if one.kept.any():
        single.plot(epochs, benign[one.kept.argmax()], "C0", lw=0.9)
    single.set(title="in one run")
    for axes in (many, single):
        axes.set(ylim=(-0.05, 1.05))
    below.plot(epochs, jerk, "0.3")
    below.set(title="jerk of the flight", xlabel="epoch", ylabel="m/s³")
    return drawing


def _bands(name: str, one: Evidence, aggressive: Evidence, epochs: np.ndarray) -> Drawing:
    """Mean error and two deviations of it against two that the filter claims, and those of the aggressive
    filters alone; rms errors; mode probabilities and runs not lost."""
    drawing, panels = canvas(11, 12, 4, 2, sharex=True)
    middle = average(one.error, one)
    actual = 2 * np.sqrt(average((one.error - middle) ** 2, one))
    claimed, bound = (2 * np.sqrt(average(each.claimed, each)) for each in (one, aggressive))
    for i, (axes, label) in enumerate(zip(panels[:2].ravel(), LABELS, strict=True)):
        for sign in (-1, 1):
            axes.plot(epochs, middle[:, i] + sign * actual[:, i], "k", lw=0.8)
            axes.plot(epochs, sign * claimed[:, i], "C1", lw=0.8)
            axes.plot(epochs, sign * bound[:, i], "C1", lw=0.8, ls=":")
        axes.plot(epochs, middle[:, i], "k", lw=1.4)
        axes.set(ylabel=label)
    for axes, (quantity, unit) in zip(panels[2], UNITS.items(), strict=True):
        axes.plot(epochs, _rms(quantity, one), "k", lw=1)
        axes.set(ylabel=f"{quantity} rms, {unit}")
    for label, chances in (("benign", 1 - one.aggressive), ("aggressive", one.aggressive)):
        panels[3, 0].plot(epochs, average(chances, one), label=label)
    panels[3, 0].set(ylabel="probability", xlabel="epoch", ylim=(-0.05, 1.05))
    panels[3, 0].legend(fontsize=8)
    panels[3, 1].plot(epochs, _alive(one, epochs), "k")
    panels[3, 1].set(ylabel="runs not lost", xlabel="epoch", ylim=(0, None))
    drawing.suptitle(f"{name}: error (black) and claimed deviations, twice; dotted: aggressive filters alone")
    return drawing


PAPER = Paper(TABLES, figures, QUANTITIES, ASKED)
