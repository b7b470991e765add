"""Li, Wu and Zhang: Figs. 1-4 and what they stand for, over three regimes and every way to take a radar's
detections; the formulas as printed; and a map of where which conversion wins. The paper prints no numbers."""

from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.curves import resampled
from gmr_gym.evaluation.metrics import nees
from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean, not_lost
from gmr_gym.experiments.claims import Asked, Claim, number
from gmr_gym.experiments.drawings import by_tracker, canvas, legend_above, save
from gmr_gym.experiments.evidence import (
    Evidence,
    Quantities,
    Results,
    Rows,
    all_measured,
    error,
    error_differences,
    error_rows,
    mean,
    squared_position,
)
from gmr_gym.experiments.papers.li_map import SAVED, map_figures
from gmr_gym.experiments.tables import Paper, SettingsGrid, Table, plainly
from gmr_gym.models.radar import UPDATES
from gmr_gym.scenarios.li import REGIMES
from gmr_gym.simulation.single_target import Scenario

EKF, DCM = "imm-ekf-pda", "imm-dcm-pda"
OTHERS = tuple(f"imm-pda:update={update}" for update in UPDATES if update not in ("extended", "debiased"))
PRINTED = "imm-dcm-pda-printed"
AXES = ("x", "y", "z")
ERRORS = ("rmse", *(f"{axis}_rmse" for axis in AXES))
COLUMNS = (
    "track_loss", *(f"{error}_own" for error in ERRORS), "sight_bias_own", "position_anees_own",
    "gate_volume", "time_per_scan",
)  # fmt: skip
SETTLED = 20  # scans of the map that are left out: of the first what was told decides
NO_SLOWER = 10.0  # %: a longer scan within this counts as no slower

# quantities, and the numbers that are taken of them


def squared_by_axis(first: int, scenario: Scenario, runs: Runs) -> np.ndarray:
    """Squared error by axis (runs, 3), mean over the scans from the first on, m^2."""
    return (error(scenario, runs)[:, first:, list(scenario.position)] ** 2).mean(axis=1)


QUANTITIES: Quantities = {
    "squared": partial(squared_by_axis, 0),
    "kept": not_lost,
    "seconds": lambda scenario, runs: np.median(runs.seconds, axis=1),  # of a scan
}


def rmse(one: Evidence, weight: np.ndarray) -> np.ndarray:
    """Of the position, and of each axis (4,), m."""
    squared = weight / weight.sum() @ one.squared
    return np.sqrt(np.append(squared.sum(), squared))


def saved(one: Evidence, against: Evidence, weight: np.ndarray) -> np.ndarray:
    """Share (4,) of the error of `against` that `one` does not make, %."""
    return 100 * (1 - rmse(one, weight) / rmse(against, weight))


@number
def error_saved(i: int, weight: np.ndarray, dcm: Evidence, ekf: Evidence) -> float:
    """Over the runs that neither lost, %; of the position, or of an axis."""
    both = weight * (dcm.kept & ekf.kept)
    return float(saved(dcm, ekf, both)[i]) if both.any() else np.nan


def lost_less(weight: np.ndarray, dcm: Evidence, ekf: Evidence) -> float:
    return mean(weight, dcm.kept.astype(float) - ekf.kept)


def time_saved(weight: np.ndarray, dcm: Evidence, ekf: Evidence) -> float:
    return float(100 * (1 - weight @ dcm.seconds / (weight @ ekf.seconds)))


# what the paper says of its IMM-DCM-PDA against IMM-EKF-PDA

_against_ekf = partial(Claim, of=DCM, against=EKF, widened=False)
BETTER = "better tracking performance than IMM-EKF-PDA"
CLAIMS = (
    _against_ekf(BETTER, "position error saved, %", 0.0, error_saved(0)),
    _against_ekf("smaller x error (Fig. 2)", "x error saved, %", 0.0, error_saved(1)),
    _against_ekf("smaller y error (Fig. 3)", "y error saved, %", 0.0, error_saved(2)),
    _against_ekf("smaller z error (Fig. 4)", "z error saved, %", 0.0, error_saved(3)),
    _against_ekf(BETTER, "share of runs lost less", 0.0, lost_less, widened=True),
    _against_ekf("no more computation than IMM-EKF-PDA", "time of a scan saved, %", -NO_SLOWER, time_saved),
)


def _rows(scenario: Scenario, results: Results) -> Rows:
    """One row per tracker: share of runs lost; root mean square errors (m) of the position and by axis, over
    all scans, `_own` over the runs the tracker kept and `_common` over those that all trackers kept that kept
    any; and over the runs it kept mean error along the line of sight (m), normalised error squared of the
    position by the dimension, 1 for a credible tracker, and volume (m^3) of the gates by which tracks are
    called lost, the same for every update; time a scan (s)."""
    every = all_measured(QUANTITIES, scenario, results)
    rows = error_rows(every, ERRORS, rmse)
    for name, one in every.items():
        runs = results[name]
        at = list(scenario.position)
        truth, off = runs.truth[one.kept][..., at], error(scenario, runs)[one.kept][..., at]
        sight = truth / np.linalg.norm(truth, axis=-1, keepdims=True)
        claimed = nees(off, runs.P[one.kept][..., at, :][..., at])
        rows[name] |= {
            "sight_bias_own": bootstrap_mean((off * sight).sum(axis=-1).mean(axis=1)),
            "position_anees_own": bootstrap_mean(claimed.mean(axis=1) / len(at)),
            "gate_volume": bootstrap_mean(runs.gate_volume[one.kept].mean(axis=1)),
            "time_per_scan": Estimate(float(np.median(runs.seconds))),
        }
    return rows


def _cell(scenario: Scenario, results: Results) -> dict[str, Estimate]:
    """Of one cell of the map: the position's error by each update, as so many times the least of them; and
    how much less the debiased conversion's is than the linearised update's, %."""
    settled: Quantities = {**QUANTITIES, "squared": partial(squared_by_axis, SETTLED)}
    updates = [name.partition("=")[2] for name in results]
    every = all_measured(settled, scenario, results, updates)
    whole = np.ones(len(next(iter(every.values())).kept), bool)
    best = min(every.values(), key=lambda one: rmse(one, whole.astype(float))[0])
    row = {update: resampled(partial(_ratio, one, best), whole)[0] for update, one in every.items()}
    gain = partial(saved, every["debiased"], every["extended"])
    return row | {SAVED: resampled(gain, whole)[0]}


def _ratio(one: Evidence, best: Evidence, weight: np.ndarray) -> np.ndarray:
    return rmse(one, weight)[:1] / rmse(best, weight)[:1]


_table = partial(
    Table, env_id="gmr_gym/AirborneRadar-v0", runs=300, summarise=_rows, columns=COLUMNS,
    paired=partial(error_differences, QUANTITIES, ERRORS, rmse),
)  # fmt: skip
_regime = partial(_table, trackers=plainly((EKF, DCM, *OTHERS)), roles=(EKF, DCM))
TABLES = (
    _regime("near", "11-13 km, 20 m, 2 mrad", settings={"regime": "near"}),
    _regime("far", "54-56 km, 20 m, 25 mrad", settings={"regime": "far"}),
    _regime("extreme", "145-147 km, 5 m, 40 mrad", settings={"regime": "extreme"}),
    _table(
        "printed", "the first 20 s of far, the formulas as they are printed",
        settings={"regime": "far", "horizon": 200},
        trackers=plainly((
            "imm-pda:update=debiased-at-prediction", f"{PRINTED}:likelihood_as_printed=False",
            f"{PRINTED}:covariance_as_printed=False", PRINTED,
        )),
    ),
    # constant velocity mixed into Singer's model without an acceleration, and with Singer's
    *(
        _table(
            f"mixing-{regime}-{tracker.split('-')[1]}", f"{tracker} by mixing, {regime}",
            settings={"regime": regime}, trackers=plainly((tracker, f"{tracker}:mixing=unbiased")),
        )
        for regime in REGIMES for tracker in (EKF, DCM)
    ),
)  # fmt: skip
MAPS = (
    SettingsGrid(
        name="map",
        title="a target at nearly constant velocity, 55 km away, 20 m, no clutter",
        env_id="gmr_gym/AirborneRadar-v0",
        settings={
            "regime": "far", "trajectory": "drawn", "clutter_rate": 0.0, "detection_probability": 1.0,
            "horizon": 60,
        },
        axes={
            "period": (0.1, 0.2, 0.5, 1.0, 2.0), "angle_deviation": (0.003, 0.01, 0.025, 0.045, 0.08, 0.14),
        },
        trackers=plainly(f"imm-pda:update={update}" for update in UPDATES),
        share=10,
        summarise=_cell,
        columns=(*UPDATES, SAVED),
    ),
)  # fmt: skip


def figures(table: Table, scenario: Scenario, results: Results, rows: Rows, out: Path) -> None:
    """Of a regime the paper's Fig. 1, and Figs. 2-4 in one; of every table errors by time."""
    time = scenario.period * np.arange(1, scenario.horizon + 1)
    if table.name in REGIMES:
        save(_trajectory(results, time), out / f"figure-1-{table.name}.png")
        two = {name: results[name] for name in (DCM, EKF)}
        save(_errors_by_axis(scenario, two, time), out / f"figures-2-4-{table.name}.png")
    save(_errors(scenario, results, time), out / f"errors-{table.name}.png")


def _trajectory(results: Results, time: np.ndarray) -> Drawing:
    """Of the first run, relative to the radar: from above, and height by time."""
    drawing, (above, side) = canvas(10, 4.5, 1, 2)
    paths = {name: results[name].x[0] / 1e3 for name in (DCM, EKF)} | {"truth": results[DCM].truth[0] / 1e3}
    for (name, path), colour in zip(paths.items(), ("C0", "C1", "k"), strict=True):
        above.plot(path[:, 0], path[:, 1], colour, lw=0.9, label=name)
        side.plot(time, path[:, 2], colour, lw=0.9)
    above.set(xlabel="x, km", ylabel="y, km", title="target relative to the aircraft")
    side.set(xlabel="time, s", ylabel="z, km")
    above.legend(fontsize=8)
    return drawing


def _errors_by_axis(scenario: Scenario, results: Results, time: np.ndarray) -> Drawing:
    """Root mean square over the runs that neither lost, and the mean, its sign shows a bias."""
    drawing, panels = canvas(10, 8, 3, sharex=True)
    common = np.logical_and.reduce([not_lost(scenario, runs) for runs in results.values()])
    if common.any():
        for i, (name, runs) in enumerate(results.items()):
            off = error(scenario, runs)[common][..., list(scenario.position)]
            for axis, axes in enumerate(panels):
                axes.plot(time, np.sqrt((off[..., axis] ** 2).mean(axis=0)), f"C{i}", label=name)
                axes.plot(time, off[..., axis].mean(axis=0), f"C{i}:", lw=0.9)
    for letter, axes in zip(AXES, panels, strict=True):
        axes.set(ylabel=f"{letter} error, m")
        axes.axhline(0, color="0.7", lw=0.6)
    title = f"root mean square and, dotted, mean over the {common.sum()} runs that neither lost"
    panels[0].set_title(title, size=10)
    panels[0].legend(*panels[0].get_legend_handles_labels(), fontsize=8)
    panels[-1].set(xlabel="time, s")
    return drawing


def _errors(scenario: Scenario, results: Results, time: np.ndarray) -> Drawing:
    curves = {}
    for name, runs in results.items():
        own = not_lost(scenario, runs)
        if own.any():
            square = squared_position(scenario, runs)[own]
            curves[f"{name} ({own.sum()} of {len(own)} kept)"] = np.sqrt(square.mean(axis=0))
    drawing, (axes,) = by_tracker(10, 5.5, time, {"position rms error over the runs kept by each, m": curves})
    axes.set(xlabel="time, s", yscale="log" if curves else "linear")
    legend_above(drawing, fontsize=7, ncols=2)
    return drawing


PAPER = Paper(
    TABLES, figures, QUANTITIES, tuple(Asked(CLAIMS, (regime,)) for regime in REGIMES), MAPS, map_figures
)
