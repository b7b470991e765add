"""Models in the mixture, or in banks of filters? Maybeck, Kozak and Smith (section IV) call the expansion
over modes and associations together inferior; Zhang and Liu's MMG does just that and is called superior.
Either's trackers in either's scenario, the reduction, the number of Gaussians and the work equalised."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.curves import resampled
from gmr_gym.montecarlo import Runs
from gmr_gym.reproduce import Claim, Table, judged
from gmr_gym.reproduce.drawings import error_against_time
from gmr_gym.reproduce.maybeck import MOST, STICKIER
from gmr_gym.reproduce.zhang import QUIET
from gmr_gym.simulate import Scenario
from gmr_gym.summary import Figure, errors, kept, mean, paired_share, summary

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
        most = MOST // 2 if "-of-" in name else MOST  # two MHTs share alike
        trackers[name] = {"reduction": reduction, "most": most}
    trackers["one-motion-15"]["mode"] = one
    return trackers


def _work() -> dict[str, dict[str, Any]]:
    """MMG and the better banks at several numbers of components, reduced by Runnalls."""
    numbers = {"mmg": (5, 10, 15, 30, 60), "mmae-mht": (5, 15, 30), "imm-mht": (5, 15, 30)}
    return {f"{name}-{n}": {"most": max(MOST, 4 * n)} for name, counts in numbers.items() for n in counts}


def _outcomes(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, Outcome]:
    return {
        name: Outcome(
            np.minimum(errors(scenario, runs)[0], scenario.cutoff).mean(axis=1), ~kept(scenario, runs)
        )
        for name, runs in results.items()
    }


def _rows(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, dict[str, Figure]]:
    """The figures of `summary`, and error_capped: mean position error (m) over all runs, lost ones too, with
    no scan counted as more than the scenario's cutoff."""
    rows = summary(scenario, results)
    for name, outcome in _outcomes(scenario, results).items():
        rows[name]["error_capped"] = mean(outcome.error)
    return rows


def _differences(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, dict[str, Figure]]:
    """Every tracker minus the first, run by run over all runs of the same episodes."""
    (reference, against), *others = _outcomes(scenario, results).items()
    return {
        f"{name} - {reference}": {
            "track_loss": paired_share(one.lost - against.lost.astype(float)),
            "error_capped": mean(one.error - against.error),
        }
        for name, one in others
    }


def claims(tables: Mapping[str, Mapping[str, Outcome]]) -> list[dict]:
    """Maybeck's word, tracker by tracker: a MMG errs more than a tracker of banks. Zhang's is the contrary:
    where the first fails, the second holds."""
    records = []
    for name, outcomes in tables.items():
        joint = [who for who in outcomes if who.startswith("mmg")]
        about = [(mmg, bank) for bank in outcomes if bank not in joint for mmg in joint]
        pairs = [(outcomes[mmg], outcomes[bank]) for mmg, bank in about]
        everything = np.ones(len(outcomes[joint[0]].error), bool)
        measured = resampled(partial(_excess, pairs), everything)
        records += [
            judged(
                Claim(f"{mmg} is inferior to {bank}", "capped error, its less the other's, m", 0.0, float),
                figure, table=name, runs=f"all {len(everything)}",
            )
            for (mmg, bank), figure in zip(about, measured, strict=True)
        ]  # fmt: skip
    return records


def _excess(pairs, weight: np.ndarray) -> np.ndarray:
    share = weight / weight.sum()
    return np.array([share @ (mmg.error - bank.error) for mmg, bank in pairs])


def figures(
    table: Table,
    scenario: Scenario,
    results: Mapping[str, Runs],
    rows: Mapping[str, Mapping[str, Figure]],
    out: Path,
) -> None:
    """Error against time."""
    label = f"position error over all runs, m, at most {scenario.cutoff:g} in a scan"
    drawing = error_against_time(rows, "error_capped", label, str)
    drawing.savefig(out / f"figure-{table.name}.png", dpi=120)


def _table(name: str, title: str, env_id: str, settings: dict[str, Any], trackers) -> Table:
    return Table(
        name, title, env_id, settings, trackers, summarise=_rows, columns=COLUMNS, evidence=_outcomes,
        paired=_differences,
    )  # fmt: skip


_STICKY = {"switching": STICKIER}
_DRAWN = {"trajectory": "drawn", **_STICKY}
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
    _table("flight-drawn", "a target that does as the trackers are told, staying with 0.98, Runnalls", FLIGHT,
           _DRAWN, _rivals("runnalls", 1, *_TWO)),
    _table("jump", "five accelerations, Q = I, Runnalls", JUMP, _NOISY, _rivals("runnalls", 0, *_FIVE)),
    _table("jump-quiet", f"{_QUIETLY}, Runnalls", JUMP, _QUIET, _rivals("runnalls", 0, *_FIVE)),
    _table("jump-quiet-ise", f"{_QUIETLY}, ISE", JUMP, _QUIET, _rivals("ise", 0, "mmg-15")),
    _table("flight-work", "the F-16, staying with 0.98, by number of components", FLIGHT, _STICKY, _work()),
    _table("jump-quiet-work", f"{_QUIETLY}, by number of components", JUMP, _QUIET, _work()),
)  # fmt: skip
