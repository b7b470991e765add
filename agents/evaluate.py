"""The comparison: `python agents/evaluate.py results/agents/static/static.json results/agents/*/best.npz`.

Every competitor plays the same episodes of TEST and of EXTRAPOLATION. What has been played is kept, and found
again by the same command."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
import typer
from competitors import read
from drawings import draw_fronts, draw_instances
from hindsight import ByInstance, Greedy, grid
from judge import ENV_ID, Episodes, Policy, played
from report import markdown, plain
from scores import (
    against,
    against_front,
    chosen_by_instance,
    figures,
    front,
    hindsight_front,
    place,
    together,
)

from gmr_gym.evaluation.summary import CONFIDENCE
from gmr_gym.evaluation.writing import whole
from gmr_gym.experiments.output import write_json
from gmr_gym.experiments.records import question
from gmr_gym.experiments.screen import console, progress
from gmr_gym.experiments.sheets import figures_table as table_of
from gmr_gym.tuning.features import FEATURES
from gmr_gym.tuning.instances import instances, world
from gmr_gym.tuning.network import load
from gmr_gym.tuning.policies import ByNetwork, Constant, Random
from gmr_gym.tuning.thresholds import DORTENZIO, Thresholds, from_action, to_action

EPISODES = 2000  # of a competitor and table
BEST, BY_INSTANCE, ORACLE = "best constant", "constant by instance", "greedy oracle"
SWITCHING = 10  # scans between two draws of the random policy
ORACLE_LEVELS = np.array([0.0, 0.5, 1.0])  # of each threshold; the best constant is offered as well
DEAR = 0.25  # of a scan's reward, for work: beyond that no front is looked for
PRICES = np.geomspace(1e-7, 1e-3, 17)  # of work, along the front of constants by instance
# of the figures; a screen is only so wide
SCREEN = ("track_loss", "error_capped", "work", "work_iqm", "reward", "work_at_equal_error", "time_per_scan")
# What a gain is due to: its name, who has it, over whom
SPLIT = (
    ("tuning", BEST, "paper"),
    ("time, open loop", "best schedule", BEST),
    ("instance, by what is known of it", "table", BEST),
    ("instance, in hindsight", BY_INSTANCE, BEST),
    ("state, by a hand rule", "best rule", BEST),
    ("state, beyond what is known", "best rule", "table"),
    ("the truth, in hindsight", ORACLE, BEST),
)
# the same of every learned group
LEARNED = (
    ("all that is learned", BEST),
    ("learned beyond what is known", "table"),
    ("learned beyond the instance", BY_INSTANCE),
    ("learned beyond a hand rule", "best rule"),
)


def learned(
    files: Sequence[Path], parameters: Sequence[str], env: Mapping[str, Any]
) -> dict[str, list[Policy]]:
    """Policies of training runs by group, that is by the name of their folder without the number of the seed:
    those in ppo-0 and ppo-1 are two seeds of ppo. ValueError for one that sets other thresholds or was
    trained in an environment of other arguments, and for a run given twice."""
    groups: dict[str, dict[Path, Policy]] = {}
    for file in files:
        network = load(file, FEATURES, Thresholds._fields)
        if network.parameters != tuple(parameters):
            raise ValueError(f"{file} sets {network.parameters}, but the others set {tuple(parameters)}")
        folder = file.resolve().parent
        name, _, number = folder.name.rpartition("-")
        runs = groups.setdefault(name if number.isdigit() else folder.name, {})
        if folder in runs:
            raise ValueError(f"{folder} is given twice: two policies of one run are no two seeds")
        runs[folder] = ByNetwork(network)
        said = folder / "run.json"
        if said.exists() and (other := json.loads(said.read_text())["settings"]["env"]) != dict(env):
            raise ValueError(f"{folder} was trained with {other}, but what is compared is tuned with {env}")
    return {name: list(runs.values()) for name, runs in groups.items()}


class Comparison:
    """The competitors, and where what they did is kept."""

    def __init__(
        self, static: Path, files: Sequence[Path], folder: Path, seed: int, runs: int | None, jobs: int
    ):
        self.env, self.static = read(static)
        if BEST not in self.static:
            raise ValueError(f"{static} holds no {BEST!r}")
        self.folder, self.seed, self.runs, self.jobs = folder, seed, runs, jobs
        problem = gym.make(ENV_ID, **self.env).unwrapped
        self.parameters, self.price = problem.parameters, problem.price
        self.learned = learned(files, self.parameters, self.env)

    def table(self, table: str, grid_runs: int, slow_runs: int) -> dict[str, Any]:
        """Everything on one table of instances: its record, with "episodes" by competitor."""
        rows = instances(table)
        cutoff = world(next(iter(rows.values()))).cutoff
        runs = self.runs or -(-EPISODES // len(rows))
        actions = grid(len(self.parameters))
        cloud = {f"constant {i}": Constant(a) for i, a in enumerate(actions)}
        # constants by instance are chosen on episodes of their own: on those that score them they would look
        # too good. The front may: it is what the others are held against
        seen, scored = (
            together(list(self._played(f"{table}, constants", cloud, table, grid_runs, seed).values()))
            for seed in (self.seed + 1, self.seed)
        )
        chosen = chosen_by_instance(actions, seen, self.price, cutoff)
        field = self._field(ByInstance(dict(zip(rows, actions[chosen], strict=True))))
        policies = {
            f"{name} {i}" if len(group) > 1 else name: policy
            for name, group in field.items()
            for i, policy in enumerate(group)
        }
        found = iter(self._played(table, policies, table, runs, self.seed).values())
        episodes = {name: together([next(found) for _ in group]) for name, group in field.items()}
        pooled = Episodes(*(np.concatenate(parts, axis=-1) for parts in zip(seen, scored, strict=True)))
        best_of = {name: cloud[name] for name in on_front(list(cloud), pooled, self.price)}
        best_of |= {name: field[name][0] for name in ("paper", BEST)}
        corners = self._played(f"{table}, front of constants", best_of, table, runs, self.seed)
        slow = self._played(f"{table}, random and oracle", self._slow(), table, slow_runs, self.seed)
        episodes |= {name: together([e]) for name, e in slow.items()}
        constants = [
            {name: getattr(from_action(action, self.parameters), name) for name in self.parameters}
            | place(Episodes(*(part[i] for part in scored)))
            for i, action in enumerate(actions)
        ]
        return record(episodes, list(self.learned), together(list(corners.values()))) | {
            "front": {name: place(together([e])) for name, e in corners.items()},
            "constants": constants, "grid_runs": grid_runs, "instances": list(rows), "episodes": episodes,
            "constants_by_instance": hindsight_front(actions, seen, scored, PRICES, cutoff),
        }  # fmt: skip

    def _field(self, by_instance: ByInstance) -> dict[str, list[Policy]]:
        """Competitors by name, with as many policies as seeds."""
        paper = Constant(to_action(DORTENZIO, self.parameters))
        alone = {"paper": paper, **self.static, BY_INSTANCE: by_instance}
        return {name: [policy] for name, policy in alone.items()} | self.learned

    def _slow(self) -> dict[str, Policy]:
        """Those that are too slow to play as often."""
        size = len(self.parameters)
        offered = np.vstack([grid(size, ORACLE_LEVELS), self.static[BEST](np.zeros(0), 0)])
        return {"random": Random(size, SWITCHING, np.random.default_rng(0)), ORACLE: Greedy(offered)}

    def _played(
        self, label: str, policies: Mapping[str, Policy], table: str, runs: int, seed: int
    ) -> dict[str, Episodes]:
        with progress(label) as tell:
            return played(
                policies, table, runs, seed,
                env=self.env, jobs=self.jobs, folder=self.folder / "episodes", progress=tell,
            )  # fmt: skip


def on_front(names: Sequence[str], seen: Episodes, price: float) -> list[str]:
    """Which of the constants (n, instances, runs) of these names no other beats in work and in error or
    losses, by what they did in the episodes `seen`. Those whose work costs more than DEAR are left out."""
    work = seen.work.mean(axis=(1, 2))
    fair = np.flatnonzero(price * work < DEAR)
    errors = (seen.capped.mean(axis=(1, 2))[fair], seen.lost.mean(axis=(1, 2))[fair])
    corners = {int(i) for error in errors for i in fair[front(np.column_stack((work[fair], error)))]}
    return [names[i] for i in sorted(corners)]


def record(episodes: Mapping[str, Episodes], trained: Sequence[str], constants: Episodes) -> dict[str, Any]:
    """What a table of instances says: figures of the competitors, of whom some were trained, against the best
    constant and against constants on the front, and what the gain is due to."""
    parts = [*SPLIT, *((what, name, over) for name in trained for what, over in LEARNED)]
    return {
        "shape": {name: e.reward.shape for name, e in episodes.items()},  # seeds, instances, runs
        "competitors": {name: figures(e) | against_front(e, constants) for name, e in episodes.items()},
        "against": {name: against(e, episodes[BEST]) for name, e in episodes.items() if name != BEST},
        "split": {
            f"{what} ({who} over {over})": against(episodes[who], episodes[over])
            for what, who, over in parts
            if who in episodes and over in episodes
        },
        "seed_rewards": {name: e.reward.mean(axis=(1, 2)).tolist() for name, e in episodes.items()},
        "instance_means": {
            name: {f: getattr(e, f).mean(axis=(0, 2)).tolist() for f in ("lost", "capped", "work", "reward")}
            for name, e in episodes.items()
        },
    }


def main(
    static: Annotated[Path, typer.Argument(help="what tune_static.py wrote")],
    policies: Annotated[list[Path], typer.Argument(help="learned ones: GROUP-SEED/best.npz")] = [],  # noqa: B006
    *,
    tables: Annotated[list[str], typer.Option("--table", help="of instances")] = ["test", "extrapolation"],  # noqa: B006
    runs: Annotated[
        int | None, typer.Option(help="of every instance; 2000 a table unless given", min=2)
    ] = None,
    grid_runs: Annotated[int, typer.Option(help="of every instance, for each constant", min=2)] = 40,
    slow_runs: Annotated[int, typer.Option(help="of every instance, for random and oracle", min=2)] = 20,
    seed: Annotated[int, typer.Option(help="of the episodes", min=0)] = 1,
    jobs: Annotated[int, typer.Option(help="workers, -1 for all cores")] = -1,
    out: Annotated[Path, typer.Option(help="folder for results")] = Path("results/comparison"),
) -> None:
    """Plays what has not been played yet, and writes comparison.json, comparison.md and figures."""
    comparison = Comparison(static, policies, out, seed, runs, jobs)
    screen, records, text = console(), {}, []
    for table in tables:
        found = comparison.table(table, grid_runs, slow_runs)
        episodes, stem = found.pop("episodes"), Path(table).stem
        records[stem] = found
        text.append(markdown(stem, found))
        places = {name: place(e) for name, e in episodes.items()}
        fronts = found["constants"], found["front"], found["constants_by_instance"]
        draw_fronts(out / f"fronts-{stem}.png", places, *fronts)
        tuned = {name: e for name, e in episodes.items() if name not in ("random", "paper")}
        draw_instances(out / f"instances-{stem}.png", tuned, BEST)
        asked = question(env=comparison.env, seed=seed)
        write_json(out / "comparison.json", asked | {"level": CONFIDENCE, "tables": plain(records)})
        with whole(out / "comparison.md") as partial:
            partial.write_text("\n\n".join(text) + "\n", encoding="utf-8")
        shown = {name: {f: row[f] for f in SCREEN} for name, row in found["competitors"].items()}
        screen.print(table_of(stem, shown))
        screen.print(table_of(f"{stem}: minus the best constant, episode by episode", found["against"]))
    screen.print(f"written to {out}")


if __name__ == "__main__":
    typer.run(main)
