"""Learning curves of an agent that tracks by itself, beside trackers on the same episodes.

`python agents/estimating/learning_curve.py CSV PNG` trains by `ppo.py` once for every seed, on one processor,
writes what was found, and draws it; where the CSV is there already it is only drawn."""

import csv
from pathlib import Path
from time import process_time
from typing import Annotated

import matplotlib
import numpy as np
import torch
import typer
from ppo import Settings, train
from quiet import HELD_OUT, errors, tracker_errors

from gmr_gym.experiments.output import write_rows

matplotlib.use("Agg")
from matplotlib import pyplot

COLUMNS = "agent", "seed", "steps", "seconds", "error_m", "deviation_m"  # the last of the mean, over episodes
TRACKERS = {"pda": "#1967d2", "nearest-neighbour": "#9aa0a6"}
LIMIT = 1.5  # times the error of PDA


def main(
    table: Path,
    picture: Path,
    seeds: Annotated[int, typer.Option(help="trainings", min=1)] = 3,
    steps: Annotated[int, typer.Option(help="of each", min=1)] = Settings.steps,
    every: Annotated[int, typer.Option(help="updates between two points", min=1)] = 10,
    episodes: Annotated[int, typer.Option(help="that no training meets", min=2)] = len(HELD_OUT),
) -> None:
    """Train, write and draw."""
    torch.set_num_threads(1)
    if not table.exists():
        table.parent.mkdir(parents=True, exist_ok=True)
        write_rows(
            table, COLUMNS, found(seeds, steps, every, range(HELD_OUT.start, HELD_OUT.start + episodes))
        )
    with table.open(encoding="utf-8") as stream:
        draw(list(csv.DictReader(stream)), picture)


def found(seeds: int, steps: int, every: int, episodes: range) -> list[list]:
    """Rows of `COLUMNS`: trackers, and the agents after every so many updates."""
    rows = [[name, "", "", "", *summary(tracker_errors(name, episodes))] for name in TRACKERS]
    for seed in range(seeds):
        spent, start = 0.0, process_time()
        for update, (taken, agent) in enumerate(train(Settings(seed, steps))):
            if update % every == 0:
                spent += process_time() - start
                rows.append(["ppo", seed, taken, f"{spent:.1f}", *summary(errors(agent.act, episodes))])
                print(*rows[-1], flush=True)
                start = process_time()
    return rows


def summary(each: np.ndarray) -> tuple[str, str]:
    """The mean, and its standard deviation."""
    return f"{each.mean():.3f}", f"{each.std(ddof=1) / len(each) ** 0.5:.3f}"


def draw(rows: list[dict[str, str]], picture: Path) -> None:
    """Errors against steps, and the trackers' as lines."""
    figure, axes = pyplot.subplots(figsize=(7, 4), layout="constrained")
    agents = [row for row in rows if row["agent"] == "ppo"]
    for seed in sorted({row["seed"] for row in agents}):
        steps, error = np.array([
            (float(row["steps"]) / 1e6, float(row["error_m"])) for row in agents if row["seed"] == seed
        ]).T  # fmt: skip
        axes.plot(steps, error, color="#c5221f", lw=1.2, label="agent" if seed == "0" else None)
    for row in rows:
        if row["agent"] in TRACKERS:
            axes.axhline(float(row["error_m"]), color=TRACKERS[row["agent"]], label=row["agent"])
    pda = next(float(row["error_m"]) for row in rows if row["agent"] == "pda")
    axes.axhline(LIMIT * pda, color=TRACKERS["pda"], ls=":", label=f"{LIMIT:g} times pda")
    axes.set(xlabel="steps, millions", ylabel="mean error a scan, m", yscale="log", xlim=(0, None))
    axes.set_yticks([7, 10, 20, 50, 100], ["7", "10", "20", "50", "100"], minor=False)
    axes.minorticks_off()
    axes.legend(frameon=False)
    picture.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(picture, dpi=120)


if __name__ == "__main__":
    typer.run(main)
