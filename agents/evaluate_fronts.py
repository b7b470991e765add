"""The comparison of fronts: `python agents/evaluate_fronts.py results/agents/rivals/static.json */best.npz`.

Every policy plays the same episodes. What has been played is kept, and found again by the same command."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from competitors import Rival, read_fronts
from drawings import draw_losses
from front_scores import AXES, by_instance, compared, losses_at
from judge import Episodes, played
from report import plain, table_of
from rivals import env_of as rivals_env
from scores import place, together
from tune_rivals import ANY, PRICES

from gmr_gym.evaluation.writing import whole
from gmr_gym.experiments.output import write_json
from gmr_gym.experiments.records import question
from gmr_gym.experiments.screen import progress
from gmr_gym.tuning.network import load
from gmr_gym.tuning.policies import ByNetwork, Constant
from gmr_gym.tuning.recent import ALL_FEATURES
from gmr_gym.tuning.thresholds import Thresholds, to_action

LEARNED, HINDSIGHT, EXACT = "learned", "by instance, in hindsight", "near exact"
OTHERS = 5  # of the others, that are named in a figure
REDUCER = "n-scan"  # of policies whose run names none
NEAR_EXACT = Thresholds(alpha=1e-4, prune=1e-6)
COSTS = {"work": (15.0, 30.0, 100.0), "work_iqm": (10.0, 30.0, 100.0), "time": (1e-4, 2e-4, 4e-4)}
AXES_NAMED = {"work": "work", "work_iqm": "interquartile mean of work", "time": "seconds a scan"}
BEHIND = {"hypervolume": ("hypervolume", 1)} | {
    axis: (f"behind, {name}", 1) for axis, name in AXES_NAMED.items()
}
AT = {"lost": ("lost, %", 100), "other": ("the other, %", 100), "ratio": ("ratio", 1)}


def env_of(policy: Path) -> dict[str, Any]:
    """Arguments of the environment that a policy was trained in, without the price."""
    run = policy.resolve().parent / "run.json"
    env = json.loads(run.read_text())["settings"]["env"] if run.exists() else {}
    return {name: value for name, value in env.items() if name not in ("price", "instances")}


class Games:
    """Fronts on one table of instances, and where what was played is kept."""

    def __init__(self, table: str, runs: int, seed: int, jobs: int, folder: Path):
        self.table, self.runs, self.seed, self.jobs, self.folder = table, runs, seed, jobs, folder

    def of_rivals(self, name: str, front: Sequence[Rival]) -> list[Episodes]:
        """One point for each different policy."""
        different = {repr((rival.policy, rival.env)): rival for rival in front}
        return [
            together([self._played(f"{name} {i}", rival.policy, rival.env, 0.0)])
            for i, rival in enumerate(different.values())
        ]

    def of_networks(self, files: Sequence[Path], prices: Sequence[float]) -> list[Episodes]:
        """One point a price: the same networks, one a seed of training, at every price."""
        networks = [ByNetwork(load(file, ALL_FEATURES, Thresholds._fields)) for file in files]
        return [
            together([
                self._played(f"{LEARNED} {i} {price:.0e}", network, env_of(file), price)
                for i, (file, network) in enumerate(zip(files, networks, strict=True))
            ])
            for price in prices
        ]  # fmt: skip

    def learned(
        self, files: Sequence[Path], prices: Sequence[float], choosing: int
    ) -> dict[str, list[Episodes]]:
        """One front for each reducer that policies were trained with, and that of the reducer which is best
        at each price: on VALID, in so many episodes of every instance."""
        by_reducer: dict[str, list[Path]] = {}
        for file in files:
            by_reducer.setdefault(env_of(file).get("reducer", REDUCER), []).append(file)
        if len(by_reducer) == 1:
            return {LEARNED: self.of_networks(files, prices)}
        valid = Games("wide-valid", choosing, self.seed, self.jobs, self.folder)
        reward = [
            [float(e.reward.mean()) for e in valid.of_networks(group, prices)]
            for group in by_reducer.values()
        ]
        fronts = [self.of_networks(group, prices) for group in by_reducer.values()]
        best = np.argmax(reward, axis=0)
        named = {f"{LEARNED}, {reducer}": front for reducer, front in zip(by_reducer, fronts, strict=True)}
        return {LEARNED: [fronts[k][i] for i, k in enumerate(best)]} | named

    def near_exact(self, runs: int) -> dict[str, float]:
        """Where the posterior lies that is hardly reduced: a mark, in fewer episodes."""
        action = to_action(NEAR_EXACT, ("alpha", "prune"))
        few = Games(self.table, runs, self.seed, self.jobs, self.folder)
        return place_of(together([few._played(EXACT, Constant(action), rivals_env("adaptive"), 0.0)]))

    def _played(self, label: str, policy: Any, env: Mapping[str, Any], price: float) -> Episodes:
        with progress(f"{self.table}, {label}") as tell:
            return played(
                {label: policy}, self.table, self.runs, self.seed, env={**env, "price": price},
                jobs=self.jobs, folder=self.folder, progress=tell,
            )[label]  # fmt: skip


def record(fronts: Mapping[str, Sequence[Episodes]], reference: str) -> dict[str, Any]:
    """Hypervolumes on every axis, how far the others are behind the reference, its losses at equal cost
    against the best of them, and where the points of the fronts lie. What is in hindsight, or learned too, is
    not among these others."""
    apart = [name for name in fronts if name == HINDSIGHT or name.startswith(f"{LEARNED}, ")]
    found: dict[str, Any] = {"reference": reference, "volumes": {}, "at": {}}
    for axis in AXES:
        found["volumes"][axis] = volumes = compared(fronts, reference, axis, apart)
        others = [name for name in fronts if name not in (reference, *apart)]
        if others:
            best = max(others, key=lambda name: volumes[name]["hypervolume"].value)
            rows = losses_at(fronts[reference], fronts[best], axis, COSTS[axis])
            found["at"][axis] = {
                f"{cost:g}, against {best}": row for cost, row in zip(COSTS[axis], rows, strict=True)
            }
    found["points"] = {name: [place_of(e) for e in front] for name, front in fronts.items()}
    return found


def place_of(episodes: Episodes) -> dict[str, float]:
    """Where episodes lie in a plot, with the time of a scan."""
    return place(episodes) | {"time": float(episodes.seconds.mean())}


def shown(found: Mapping[str, Any]) -> list[str]:
    """What is learned, what bounds it, and the best of the others by the hypervolume below 10^3 of work."""
    volumes = found["volumes"]["work"]
    marks = [name for name in found["points"] if name.startswith(LEARNED) or name in (ANY, HINDSIGHT, EXACT)]
    others = [name for name in found["points"] if name not in marks]
    others.sort(key=lambda name: volumes[name]["hypervolume"].value, reverse=True)
    return marks + others[:OTHERS]


def markdown(title: str, found: Mapping[str, Any]) -> str:
    """Two tables under a heading: hypervolumes, the best front by work first, and losses at equal cost."""
    volumes = found["volumes"]
    by_work = volumes["work"]
    names = sorted(by_work, key=lambda name: by_work[name]["hypervolume"].value, reverse=True)
    rows = {
        name: {"hypervolume": by_work[name]["hypervolume"]}
        | {axis: volumes[axis][name]["behind"] for axis in AXES if "behind" in volumes[axis][name]}
        for name in names
    }
    equal = {
        f"{AXES_NAMED[axis]} {cost}": row for axis, at in found["at"].items() for cost, row in at.items()
    }
    said = f"Hypervolumes by the mean of work, and by how much that of `{found['reference']}` exceeds them:"
    return "\n\n".join([f"### {title}", said, table_of(BEHIND, rows), "At equal cost:", table_of(AT, equal)])


def main(
    static: Annotated[Path, typer.Argument(help="what tune_rivals.py wrote")],
    policies: Annotated[list[Path], typer.Argument(help="learned ones, one a seed of training")] = [],  # noqa: B006
    *,
    tables: Annotated[list[str], typer.Option("--table", help="of instances")] = ["wide-valid"],  # noqa: B006
    runs: Annotated[int, typer.Option(help="episodes of every instance", min=2)] = 10,
    exact_runs: Annotated[
        int,
        typer.Option(
            help="the same of the posterior that is hardly reduced, which is slow; 0 for none", min=0
        ),
    ] = 0,
    choosing_runs: Annotated[
        int,
        typer.Option(help="the same of VALID, on which the best reducer is chosen at each price", min=2),
    ] = 10,
    seed: Annotated[int, typer.Option(help="of the episodes", min=0)] = 1,
    jobs: Annotated[int, typer.Option(help="workers, -1 for all cores")] = -1,
    reference: Annotated[
        str, typer.Option(help="front that others are held against, where none is learned")
    ] = "n-scan, constants and process_noise, fading, components",
    out: Annotated[Path, typer.Option(help="folder for results")] = Path("results/fronts"),
) -> None:
    """Plays what has not been played yet, and writes fronts.json, fronts.md and a figure for each table."""
    records, text = {}, []
    for table in tables:
        games = Games(table, runs, seed, jobs, out / "episodes")
        fronts = {name: games.of_rivals(name, front) for name, front in read_fronts(static).items()}
        constants = [e for name, front in fronts.items() if "constants" in name for e in front]
        fronts[HINDSIGHT] = by_instance(constants, PRICES.tolist())
        if policies:
            fronts = games.learned(policies, PRICES.tolist(), choosing_runs) | fronts
        stem = Path(table).stem
        records[stem] = record(fronts, LEARNED if policies else reference)
        if exact_runs:
            records[stem]["points"][EXACT] = [games.near_exact(exact_runs)]
        text.append(markdown(stem, records[stem]))
        draw_losses(out / f"fronts-{stem}.png", records[stem]["points"], shown(records[stem]))
        write_json(out / "fronts.json", question(seed=seed, runs=runs) | {"tables": plain(records)})
        with whole(out / "fronts.md") as partial:
            partial.write_text("\n\n".join(text) + "\n", encoding="utf-8")
    print(f"written to {out}")


if __name__ == "__main__":
    typer.run(main)
