"""The command that tunes a tracker."""

from pathlib import Path
from typing import Annotated, Any

import typer

from gmr_gym.experiments.detection_options import INPUT_GROUPS, takes
from gmr_gym.experiments.options import EnvId, Jobs, Json, Seed, Settings, tracker_option
from gmr_gym.experiments.screen import show

Over = Annotated[
    list[str],
    typer.Option(
        "--over",
        help="parameter=low:high, parameter=low:high:log or parameter=one|another; repeatable. Of the "
        "tracker, or assumed_process_noise and others of its filter model",
    ),
]


def tune(
    env_id: EnvId,
    tracker: Annotated[str, tracker_option("what is tuned: NAME or NAME:key=value,key=value")],
    *,
    over: Over = [],  # noqa: B006
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
    from gmr_gym.evaluation import source
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
        price=price, runs=runs, seed=seed, source=source.code(problem.tracker({})),
    )  # fmt: skip
    out = out or Path("results/tune") / f"{env_id.rpartition('/')[2]}-{records.named(asked)}"
    specs.check_writable(out / "tune.json", out / "trials.csv", json_file)
    again = records.command(
        "tune", env_id, tracker=[tracker], over=over, objective=[problem.objective],
        price=[price] if price else [], set=settings, budget=[budget], runs=[runs], held_out=[held_out],
        seed=[seed],
    )  # fmt: skip
    kept = Path("results/evaluate") / sweeps.BLOCKS  # `evaluate` finds what is run of held-out episodes
    job = tuned.Job(asked, problem, space, default, plan, held_out, settings, kept, again)
    show(tuned.tune(job, out, json_file))


@takes(*INPUT_GROUPS)
def tune_recording(
    file: Annotated[Path, typer.Argument(help="detections of one target, as for `track --targets one`")],
    *,
    tracker: Annotated[str, tracker_option("what is tuned: NAME or NAME:key=value,key=value")],
    over: Over = [],  # noqa: B006
    truth_file: Annotated[
        Path | None,
        typer.Option("--truth-file", help="CSV of times and positions; without it the likelihood counts"),
    ] = None,
    cutoff: Annotated[float, typer.Option("--cutoff", help="m; an error beyond counts as this much")] = 100.0,
    parts: Annotated[
        int, typer.Option("--parts", help="of the first half, tuned on; as many judge it", min=2)
    ] = 10,
    passes: Annotated[
        int, typer.Option("--budget", help="trials, each a pass through the first half", min=2)
    ] = 50,
    acceleration_deviation: Annotated[str, typer.Option(help="m/s^2, as for `track`; by default 3")] = "",
    prior: Annotated[str, typer.Option(help="initial state, as for `track`")] = "",
    prior_deviations: Annotated[str, typer.Option(help="standard deviations of --prior")] = "",
    speed: Annotated[float, typer.Option(help="as for `track`, m/s")] = 150.0,
    period: Annotated[float | None, typer.Option(help="as for `track`, s")] = None,
    seed: Seed = 0,
    jobs: Jobs = -1,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="folder of results; by default one of its own in results/tune"),
    ] = None,
    **given: Any,
) -> None:
    """Tune a tracker of one target on the first half of a recording, and judge it on the rest.

    With a truth by its error, without one by how likely it held the detections before it saw them.
    """
    from gmr_gym.evaluation.workers import check_workers
    from gmr_gym.experiments import reading, records, specs, track_one
    from gmr_gym.experiments.search_space import space_of, usual
    from gmr_gym.recorded.extras import module_of

    module_of("tune", "optuna", "tune-recording")
    from gmr_gym.experiments import trials, tuned_recording

    own = {"prior": prior, "prior_deviations": prior_deviations, "speed": speed, "period": period}
    track_one.check_start(own)
    check_workers(jobs, "loky", None)
    if not 0 < cutoff < float("inf"):
        raise ValueError(f"--cutoff must be positive and finite, got {cutoff}")
    settings = reading.configuration_of(given)
    assumed = reading.one_target_model(settings, given | {"acceleration_deviation": acceleration_deviation})
    scans = reading.one_target_scans(file, settings, given)
    scans, start, prior_time = track_one.started(file, scans, own, assumed)
    true = tuned_recording.truth_at(truth_file, scans)
    problem = tuned_recording.TunedRecording(
        scans, start, prior_time, period, assumed, tracker, true, cutoff, parts
    )
    _, _, built = problem.prepared({})
    tuned_recording.check_parts(problem)
    default = usual(tracker, next(iter(built.values())))
    space = space_of(over, tracker, default, specs.usual_and_given(tracker, None)[1])
    plan = trials.Plan(parts * passes, parts, seed, jobs)
    asked = records.question(
        file=str(file), truth=str(truth_file), tracker=tracker, over=sorted(over), assumed=assumed,
        cutoff=cutoff, parts=parts, **own, seed=seed,
    )  # fmt: skip
    out = out or Path("results/tune") / f"{file.stem}-{records.named(asked)}"
    specs.check_writable(out / "trials.csv")
    show(tuned_recording.tune_recording(problem, space, default, plan, asked, out))
