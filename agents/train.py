"""Train an agent that sets reduction thresholds: `python agents/train.py ppo --seed 0`."""

import csv
import json
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
import typer
from export import network_of
from judge import played
from learner import RECURRENT, Run, collected, settings
from recurrent import remembering
from stable_baselines3.common.callbacks import ProgressBarCallback

from gmr_gym.experiments.output import write_rows
from gmr_gym.literals import key_values
from gmr_gym.tuning.network import save
from gmr_gym.tuning.policies import ByNetwork

COLUMNS = ("chapter", "steps", "reward", "error_m", "lost", "work")


def main(
    algorithm: Annotated[str, typer.Argument(help="ppo or sac; with sb3-contrib also tqc and ppo_lstm")],
    *,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    steps: Annotated[
        int | None,
        typer.Option(help="of environments, up to whole rollouts; as the YAML says unless given", min=1),
    ] = None,
    chapter: Annotated[int, typer.Option(help="steps between two states on disk", min=1)] = 131072,
    set_: Annotated[list[str], typer.Option("--set", help="key=value for the environment")] = [],  # noqa: B006
    hindsight: Annotated[bool, typer.Option(help="whether the critic knows the truth")] = True,
    hyperparameters: Annotated[Path | None, typer.Option(help="another YAML file")] = None,
    valid_runs: Annotated[
        int, typer.Option(help="episodes of every instance of VALID, after a chapter", min=1)
    ] = 40,
    jobs: Annotated[int, typer.Option(help="workers on VALID, -1 for all cores")] = 1,
    out: Annotated[Path | None, typer.Option(help="folder; a stopped run goes on there")] = None,
) -> None:
    """Learns, chapter by chapter; keeps every chapter, its score on VALID, and the best as a policy."""
    torch.set_num_threads(1)  # small networks run no faster on more
    env = key_values(set_)
    said = settings(algorithm, seed, steps, chapter, env, hyperparameters, hindsight)
    unit = collected(algorithm, said.envs, said.hyperparameters)
    for name, asked, kept in (("steps", steps, said.steps), ("chapter", chapter, said.chapter)):
        if asked is not None and asked != kept:
            print(f"{name} {asked} rounded up to {kept}: {algorithm} collects {unit} at a time", flush=True)
    run = Run(out or Path("results/agents") / f"{algorithm}-{seed}", said)
    scores = run.folder / "valid.csv"
    while run.chapter > len(_kept(scores)) or not run.over:
        if run.chapter == len(_kept(scores)):
            run.learn(ProgressBarCallback() if sys.stderr.isatty() else None)
        _judge(
            run,
            {name: value for name, value in env.items() if name != "instances"},
            valid_runs,
            jobs,
            scores,
        )


def _judge(run: Run, env: dict[str, Any], runs: int, jobs: int, scores: Path) -> None:
    """Scores the last chapter on VALID and keeps its policy, but for one that remembers: no file holds that,
    and it is in the chapter's own."""
    recurrent = run.settings.algorithm in RECURRENT
    network = None if recurrent else network_of(run.model, run.venv)
    policy = ByNetwork(network) if network else remembering(run.model, run.venv)
    found = played({"learned": policy}, "wide-valid", runs, env=env, jobs=jobs)["learned"]
    row = [run.chapter, run.model.num_timesteps, *(float(np.mean(part)) for part in found[:4])]
    best = max((other[2] for other in _kept(scores)), default=-np.inf)
    if network:
        save(run.folder / "last.npz", network)
        if row[2] > best:
            save(run.folder / "best.npz", network)
    _append(scores, row)
    print(json.dumps(dict(zip(COLUMNS, row, strict=True))), flush=True)


def _kept(file: Path) -> list[list[float]]:
    if not file.exists():
        return []
    with file.open() as stream:
        return [[float(cell) for cell in row] for row in list(csv.reader(stream))[1:]]


def _append(file: Path, row: list) -> None:
    kept = list(csv.reader(file.read_text().splitlines()))[1:] if file.exists() else []
    write_rows(file, COLUMNS, [*kept, row])


if __name__ == "__main__":
    typer.run(main)
