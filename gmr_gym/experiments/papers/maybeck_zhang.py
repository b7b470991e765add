"""Models in the mixture, or in banks of filters? Maybeck, Kozak and Smith (section IV) call the expansion
over modes and associations together inferior; Zhang and Liu's MMG does just that and is called superior.
Either's trackers in either's scenario, the reduction, the number of Gaussians and the work equalised."""

from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.evaluation.summary import Estimate, bootstrap_mean, capped_error, not_lost, summary
from gmr_gym.experiments.claims import Asked, Claim
from gmr_gym.experiments.drawings import error_against_time, save
from gmr_gym.experiments.evidence import Evidence, Quantities, Results, Rows, all_measured, differences, mean
from gmr_gym.experiments.papers.maybeck import MOST, STICKIER
from gmr_gym.experiments.papers.zhang import QUIET
from gmr_gym.experiments.tables import Paper, Table
from gmr_gym.simulation.single_target import Scenario

COLUMNS = (
    "track_loss", "error_capped", "rmse_own", "rmse_common", "velocity_rmse_own", "components", "gate_area",
    "time_per_scan",
)  # fmt: skip
FLIGHT, JUMP = "gmr_gym/AgileFlight-v0", "gmr_gym/JumpMarkov-v0"


QUANTITIES: Quantities = {"error": capped_error, "kept": not_lost}


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


def _rows(scenario: Scenario, results: Results) -> Rows:
    """The figures of `summary`, and error_capped: mean position error (m) over all runs, lost ones too, with
    no scan counted as more than the scenario's cutoff."""
    rows = summary(scenario, results)
    for name, one in all_measured(QUANTITIES, scenario, results).items():
        rows[name]["error_capped"] = bootstrap_mean(one.error)
    return rows


def _gain(one: Evidence, against: Evidence) -> dict[str, Estimate]:
    return {"error_capped": bootstrap_mean(one.error - against.error)}


def worse(weight: np.ndarray, mmg: Evidence, bank: Evidence) -> float:
    """By how much MMG's error exceeds the other's; nan for no runs."""
    return mean(weight, mmg.error - bank.error)


def lost_more(weight: np.ndarray, mmg: Evidence, bank: Evidence) -> float:
    """By how much MMG's share of lost runs exceeds the other's."""
    return mean(weight, bank.kept.astype(float) - mmg.kept)


def worse_where_kept(weight: np.ndarray, mmg: Evidence, bank: Evidence) -> float:
    """By how much MMG's error exceeds the other's over the runs that both kept."""
    return worse(weight * mmg.kept * bank.kept, mmg, bank)


MEASURES = {
    "capped error over all runs, its less the other's, m": worse,
    "share of runs lost, its less the other's": lost_more,
    "capped error over the runs that both kept, its less the other's, m": worse_where_kept,
}


def figures(table: Table, scenario: Scenario, results: Results, rows: Rows, out: Path) -> None:
    """Error against time."""
    label = f"position error over all runs, m, at most {scenario.cutoff:g} in a scan"
    save(error_against_time(rows, "error_capped", label, str), out / f"figure-{table.name}.png")


_table = partial(Table, summarise=_rows, columns=COLUMNS, paired=partial(differences, QUANTITIES, _gain))
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
    _table("drawn", "a target that moves as the trackers assume, Runnalls", FLIGHT, {"trajectory": "drawn"},
           _rivals("runnalls", 1, *_TWO)),
    _table("drawn-sticky", "a target that moves as the trackers assume, staying with 0.98, Runnalls", FLIGHT,
           {"trajectory": "drawn", **_STICKY}, _rivals("runnalls", 1, *_TWO)),
    _table("jump", "five accelerations, Q = I, Runnalls", JUMP, _NOISY, _rivals("runnalls", 0, *_FIVE)),
    _table("jump-quiet", f"{_QUIETLY}, Runnalls", JUMP, _QUIET, _rivals("runnalls", 0, *_FIVE)),
    _table("jump-quiet-ise", f"{_QUIETLY}, ISE", JUMP, _QUIET, _rivals("ise", 0, "mmg-15")),
    _table("flight-work", "the F-16, staying with 0.98, by number of components", FLIGHT, _STICKY, _work()),
    _table("jump-quiet-work", f"{_QUIETLY}, by number of components", JUMP, _QUIET, _work()),
)  # fmt: skip


def _asked(table: Table) -> Asked:
    """Maybeck's word on each of his four architectures: models and associations expanded together are
    inferior to it. Zhang's is the contrary: where the first fails, the second holds."""
    mmgs, banks = ([name for name in table.trackers if kind in name] for kind in ("mmg", "-mht"))
    claims = tuple(
        Claim(f"{mmg} is inferior to {bank}", measure, 0.0, value, mmg, bank)
        for (measure, value), mmg, bank in product(MEASURES.items(), mmgs, banks)
    )
    return Asked(claims, (table.name,))


PAPER = Paper(
    TABLES,
    figures,
    QUANTITIES,
    tuple(_asked(table) for table in TABLES if not table.name.endswith("work")),
)
