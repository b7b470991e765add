"""Models in the mixture, or in banks of filters? Maybeck, Kozak and Smith (section IV) call the expansion
over modes and associations together inferior; Zhang and Liu's MMG does just that and is called superior.
Either's trackers in either's scenario, the reduction, the number of Gaussians and the work equalised."""

from collections.abc import Mapping
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation.curves import resampled
from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean, errors, not_lost, paired_share, summary
from gmr_gym.experiments.drawings import error_against_time, save
from gmr_gym.experiments.papers.maybeck import MOST, STICKIER
from gmr_gym.experiments.papers.zhang import QUIET
from gmr_gym.experiments.tables import Claim, Table, judged, no_event_width
from gmr_gym.simulation.single_target import Scenario

__all__ = ["TABLES", "claims", "figures"]

COLUMNS = (
    "track_loss", "error_capped", "rmse_own", "rmse_common", "velocity_rmse_own", "components", "gate_area",
    "time_per_scan",
)  # fmt: skip
FLIGHT, JUMP = "gmr_gym/AgileFlight-v0", "gmr_gym/JumpMarkov-v0"


class Outcome(NamedTuple):
    """Run by run (runs,), of one tracker."""

    error: np.ndarray  # m, averaged over the scans, each counted at most as the scenario's cutoff
    lost: np.ndarray


def _rivals(reduction: str, one: int, *mmgs: str) -> dict[str, dict[str, Any]]:
    """MMGs, Maybeck's architectures, and the MHT of one motion."""
    trackers: dict[str, dict[str, Any]] = {}
    for name in (*mmgs, "mmae-mht-15", "imm-mht-15", "mmae-of-mhts-15", "imm-of-mhts-15", "one-motion-15"):
        most = MOST // 2 if "-of-" in name else max(MOST, 4 * int(name.rpartition("-")[2]))
        trackers[name] = {"reduction": reduction, "max_hypotheses": most}  # two MHTs share alike
    trackers["one-motion-15"]["mode"] = one
    return trackers


def _work() -> dict[str, dict[str, Any]]:
    """MMG and the better banks at several numbers of components, reduced by Runnalls."""
    numbers = {"mmg": (5, 10, 15, 30, 60), "mmae-mht": (5, 15, 30), "imm-mht": (5, 15, 30)}
    return {
        f"{name}-{n}": {"max_hypotheses": max(MOST, 4 * n)}
        for name, counts in numbers.items()
        for n in counts
    }


def _outcomes(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, Outcome]:
    return {
        name: Outcome(
            np.minimum(errors(scenario, runs)[0], scenario.cutoff).mean(axis=1), ~not_lost(scenario, runs)
        )
        for name, runs in results.items()
    }


def _rows(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, dict[str, Estimate]]:
    """The figures of `summary`, and error_capped: mean position error (m) over all runs, lost ones too, with
    no scan counted as more than the scenario's cutoff."""
    rows = summary(scenario, results)
    for name, outcome in _outcomes(scenario, results).items():
        rows[name]["error_capped"] = bootstrap_mean(outcome.error)
    return rows


def _differences(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, dict[str, Estimate]]:
    """Every tracker minus the first, run by run over all runs of the same episodes."""
    (reference, against), *others = _outcomes(scenario, results).items()
    return {
        f"{name} - {reference}": {
            "track_loss": paired_share(one.lost - against.lost.astype(float)),
            "error_capped": bootstrap_mean(one.error - against.error),
        }
        for name, one in others
    }


def claims(tables: Mapping[str, Mapping[str, Outcome]]) -> list[dict]:
    """Maybeck's word on each of his four architectures: models and associations expanded together are
    inferior to it. Zhang's is the contrary: where the first fails, the second holds."""
    records = []
    for name, outcomes in tables.items():
        pairs = list(product(*([who for who in outcomes if kind in who] for kind in ("mmg", "-mht"))))
        about = [
            Claim(f"{mmg} is inferior to {bank}", measure, 0.0, partial(value, outcomes[mmg], outcomes[bank]))
            for measure, value in MEASURES.items()
            for mmg, bank in pairs
        ]
        runs = len(next(iter(outcomes.values())).lost)
        measured = no_event_width(resampled(partial(_values, about), np.ones(runs, bool)), runs)
        records += [
            judged(claim, figure, runs, table=name, runs=f"all {runs}")
            for claim, figure in zip(about, measured, strict=True)
        ]
    return records


def _values(about, weight: np.ndarray) -> np.ndarray:
    return np.array([claim.value(weight) for claim in about])


def _worse(mmg: Outcome, bank: Outcome, weight: np.ndarray) -> float:
    return float(weight @ (mmg.error - bank.error) / weight.sum())


def _lost_more(mmg: Outcome, bank: Outcome, weight: np.ndarray) -> float:
    return float(weight @ (mmg.lost.astype(float) - bank.lost) / weight.sum())


def _worse_where_kept(mmg: Outcome, bank: Outcome, weight: np.ndarray) -> float:
    both = weight * ~mmg.lost * ~bank.lost
    return float(both @ (mmg.error - bank.error) / both.sum()) if both.any() else np.nan


MEASURES = {
    "capped error over all runs, its less the other's, m": _worse,
    "share of runs lost, its less the other's": _lost_more,
    "capped error over the runs that both kept, its less the other's, m": _worse_where_kept,
}


def figures(
    table: Table,
    scenario: Scenario,
    results: Mapping[str, Runs],
    rows: Mapping[str, Mapping[str, Estimate]],
    out: Path,
) -> None:
    """Error against time."""
    label = f"position error over all runs, m, at most {scenario.cutoff:g} in a scan"
    drawing = error_against_time(rows, "error_capped", label, str)
    save(drawing, out / f"figure-{table.name}.png")


def _table(name: str, title: str, env_id: str, settings: dict[str, Any], trackers) -> Table:
    return Table(
        name, title, env_id, settings, trackers, summarise=_rows, columns=COLUMNS,
        evidence=None if name.endswith("work") else _outcomes, paired=_differences,
    )  # fmt: skip


_STICKY = {"switching": STICKIER}
_NOISY = {"case": "2"}
_QUIET = _NOISY | {"process_variance": QUIET}
# as many components as a bank has hypotheses, and as many as it has Gaussians, of two motions and of five
_TWO, _FIVE = ("mmg-15", "mmg-30"), ("mmg-15", "mmg-75")
_QUIETLY = f"five accelerations, Q = {QUIET:g} I"
TABLES = (
    _table("flight", "the F-16, Runnalls", FLIGHT, {}, _rivals("runnalls", 1, *_TWO)),
    _table("flight-ise", "the F-16, ISE", FLIGHT, {}, _rivals("ise", 1, "mmg-15")),
    _table("flight-sticky", "the F-16, models that stay with probability 0.98, Runnalls", FLIGHT, _STICKY,
           _rivals("runnalls", 1, *_TWO)),
    _table("drawn", "a target that does as the trackers are told, Runnalls", FLIGHT, {"trajectory": "drawn"},
           _rivals("runnalls", 1, *_TWO)),
    _table("drawn-sticky", "a target that does as the trackers are told, staying with 0.98, Runnalls", FLIGHT,
           {"trajectory": "drawn", **_STICKY}, _rivals("runnalls", 1, *_TWO)),
    _table("jump", "five accelerations, Q = I, Runnalls", JUMP, _NOISY, _rivals("runnalls", 0, *_FIVE)),
    _table("jump-quiet", f"{_QUIETLY}, Runnalls", JUMP, _QUIET, _rivals("runnalls", 0, *_FIVE)),
    _table("jump-quiet-ise", f"{_QUIETLY}, ISE", JUMP, _QUIET, _rivals("ise", 0, "mmg-15")),
    _table("flight-work", "the F-16, staying with 0.98, by number of components", FLIGHT, _STICKY, _work()),
    _table("jump-quiet-work", f"{_QUIETLY}, by number of components", JUMP, _QUIET, _work()),
)  # fmt: skip
