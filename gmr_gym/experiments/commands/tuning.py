"""The command that tunes a tracker."""

from pathlib import Path
from typing import Annotated

import typer

from gmr_gym.experiments.options import EnvId, Jobs, Json, Seed, Settings, tracker_option
from gmr_gym.experiments.screen import show


def tune(
    env_id: EnvId,
    tracker: Annotated[str, tracker_option("what is tuned: NAME or NAME:key=value,key=value")],
    *,
    over: Annotated[
        list[str],
        typer.Option(
            "--over",
            help="parameter=low:high, parameter=low:high:log or parameter=one|another; repeatable. Of the "
            "tracker, or assumed_process_noise and others of its filter model",
        ),
    ] = [],  # noqa: B006
    objective: Annotated[
        str, typer.Option("--objective", help="loss, error or work of one target; gospa, ... of many")
    ] = "",
    price: Annotated[
        float, typer.Option("--price", help="of a hypothesis kept, added to the objective", min=0)
    ] = 0.0,
    settings: Settings = [],  # noqa: B006
    budget: Annotated[int, typer.Option("--budget", help="runs of all trials together", min=1)] = 4000,
    runs: Annotated[int, typer.Option("--runs", help="runs of a trial that is not given up", min=2)] = 100,
    held_out: Annotated[
        int,
        typer.Option("--held-out", help="runs on other episodes, which judge the tuned tracker", min=2),
    ] = 200,
    seed: Seed = 0,
    jobs: Jobs = -1,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="folder of results, from which the same command goes on; by default one of its own in "
            "results/tune for every question",
        ),
    ] = None,
    json_file: Json = None,
) -> None:
    """Tune a tracker's parameters, and judge the best on other episodes, with the paired difference."""
    from gmr_gym.envs.lookup import scenario_of
    from gmr_gym.evaluation.workers import check_workers
    from gmr_gym.experiments import records, specs, sweeps
    from gmr_gym.experiments.objectives import check_objective, problem_of
    from gmr_gym.experiments.search_space import space_of, usual
    from gmr_gym.literals import key_values
    from gmr_gym.recorded.extras import module_of

    module_of("tune", "optuna", "tune")
    from gmr_gym.experiments import trials, tuned

    world = key_values(settings)
    scenario = scenario_of(env_id, world)
    problem = problem_of(scenario, tracker, check_objective(objective, scenario), price, seed)
    default = usual(tracker, scenario)
    space = space_of(over, tracker, default, specs.usual_and_given(tracker, scenario)[1])
    plan = trials.Plan(budget, runs, seed, jobs)
    trials.check_plan(plan)
    check_workers(jobs, "loky", None)
    asked = records.question(
        env=env_id, settings=world, tracker=tracker, over=sorted(over), objective=problem.objective,
        price=price, runs=runs, seed=seed,
    )  # fmt: skip
    out = out or Path("results/tune") / f"{env_id.rpartition('/')[2]}-{records.named(asked)}"
    specs.check_writable(out / "tune.json", out / "trials.csv", json_file)
    again = records.command(
        "tune", env_id, tracker=[tracker], over=over, objective=[problem.objective],
        price=[price] if price else [], set=settings, budget=[budget], runs=[runs], seed=[seed],
    )  # fmt: skip
    kept = Path("results/evaluate") / sweeps.BLOCKS  # `evaluate` finds what is run of held-out episodes
    job = tuned.Job(asked, problem, space, default, plan, held_out, settings, kept, again)
    show(tuned.tune(job, out, json_file))
