"""From nothing to the comparison of fronts, by one command: `python agents/reproduce.py`.

It trains policies of two reducers with every seed, writes the best of each to a file, tunes the rivals,
compares all fronts, and writes the tables and figures of the docs that are made of these. What is there is
not done again: a command that was stopped goes on where it was, and a stage that is over takes seconds. Each
stage is also a script of its own, with more options."""

import csv
import subprocess
import sys
from pathlib import Path
from typing import Annotated

import evaluate_fronts
import export
import train
import tune_rivals
import typer

ROOT = Path(__file__).parents[1]
# what is trained, by reducer: steps, and arguments of the environment
TRAINED: dict[str, tuple[int | None, list[str]]] = {
    "n-scan": (None, []),
    "cluster": (
        2621440,
        [
            "reducer=cluster",
            "parameters=['distance','prune','components','process_noise','fading']",
            "price=[1e-5,0.0316227766]",
        ],
    ),
}
COMPARING = "command: python agents/evaluate_fronts.py"  # in the head of a file of docs/results


def best_of(runs: list[Path]) -> tuple[Path, int]:
    """The run and its chapter of the most return on VALID.

    Parameters
    ----------
    runs : list of Path
        Folders that train.py wrote.

    Returns
    -------
    run : Path
    chapter : int
    """
    scored = []
    for run in runs:
        with (run / "valid.csv").open() as stream:
            scored += [(float(row["reward"]), run, int(row["chapter"])) for row in csv.DictReader(stream)]
    _, run, chapter = max(scored)
    return run, chapter


def results(folder: Path) -> list[str]:
    """Names of the files in docs/results that the comparison of fronts makes."""
    files = sorted(folder.glob("*.md"))
    return [file.stem for file in files if COMPARING in file.read_text(encoding="utf-8").splitlines()[1]]


def main(
    *,
    seeds: Annotated[int, typer.Option(help="policies to train", min=1)] = 5,
    steps: Annotated[int | None, typer.Option(help="of environments for each, as train.py", min=1)] = None,
    candidates: Annotated[int, typer.Option(help="of each family of rivals", min=1)] = 60,
    tracked_candidates: Annotated[int, typer.Option(help="of each family of trackers", min=1)] = 20,
    valid_runs: Annotated[
        int, typer.Option(help="episodes of every instance of VALID, to choose by", min=1)
    ] = 20,
    runs: Annotated[int, typer.Option(help="episodes of every instance, to compare by", min=2)] = 20,
    tables: Annotated[list[str], typer.Option("--table", help="of instances, to compare on")] = [  # noqa: B006
        "wide-test",
        "wide-extrapolation",
        "real",
    ],
    jobs: Annotated[int, typer.Option(help="workers, -1 for all cores")] = -1,
    out: Annotated[Path, typer.Option(help="folder for all of it")] = Path("results/agents"),
    docs: Annotated[bool, typer.Option(help="whether files of docs/results are written")] = False,
) -> None:
    """Does what is not done yet, stage by stage."""
    files = []
    for reducer, (usual, arguments) in TRAINED.items():
        trained = [out / f"{reducer}-{seed}" for seed in range(seeds)]
        for seed, run in enumerate(trained):
            _say(f"training, {reducer}, seed {seed}")
            train.main(
                "ppo",
                seed=seed,
                steps=steps or usual,
                set_=arguments,
                valid_runs=valid_runs,
                jobs=jobs,
                out=run,
            )
        files += [run / "best.npz" for run in trained]
        run, chapter = best_of(trained)
        policy = out / "policies" / f"{run.name}-{chapter}.npz"  # another one is chosen when more is trained
        if not policy.with_suffix(".csv").exists():
            _say(f"the best is {run.name} after chapter {chapter}")
            policy.parent.mkdir(exist_ok=True)
            export.main(run, policy, chapter, valid_runs)
    _say("tuning rivals")
    tune_rivals.main(candidates, tracked_candidates, valid_runs=valid_runs, out=out / "rivals")
    _say("comparing fronts")
    evaluate_fronts.main(
        out / "rivals" / "static.json", files, tables=tables, runs=runs, jobs=jobs, out=out / "fronts"
    )
    names = results(ROOT / "docs" / "results")
    if docs and names:  # their commands find what was played
        subprocess.run([sys.executable, ROOT / "docs" / "results.py", "write", *names], check=True)


def _say(stage: str) -> None:
    print(f"# {stage}", flush=True)


if __name__ == "__main__":
    typer.run(main)
