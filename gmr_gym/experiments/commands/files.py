"""Commands on files of detections."""

from pathlib import Path
from typing import Annotated, Any

import typer

from gmr_gym.experiments.detection_options import ALL_GROUPS, INPUT_GROUPS, takes
from gmr_gym.experiments.options import TARGETS, EnvId, MotionModel, Seed, Settings, choice, tracker_option
from gmr_gym.experiments.screen import show, waiting


def record(
    env_id: EnvId,
    tracker: Annotated[
        str, tracker_option("tracker that a moving field of view follows; by default pda or imm-pda")
    ] = "",
    settings: Settings = [],  # noqa: B006
    seed: Seed = 0,
    out: Annotated[Path, typer.Option("--out", help="CSV of detections")] = Path("detections.csv"),
    truth: Annotated[Path | None, typer.Option("--truth", help="also a CSV of the truth")] = None,
) -> None:
    """Write the detections of one episode to a file. `track` reads it, unless they are ranges and angles."""
    from gmr_gym.experiments import specs
    from gmr_gym.experiments.tracks import record_episode
    from gmr_gym.literals import key_values

    specs.check_writable(out, truth)
    specs.check_ending("--out", out, ".csv")
    specs.check_ending("--truth", truth, ".csv")
    scenario = specs.single_target(env_id, key_values(settings))
    tracker = tracker or ("imm-pda" if len(scenario.model.motions) > 1 else "pda")
    with waiting("recording"):
        record_episode(scenario, tracker, seed, out, truth)
    show([f"written to {out}"])


@takes(*ALL_GROUPS)
def track(
    file: Annotated[Path, typer.Argument(help="CSV, text, JSON, Parquet, AIS or ASTERIX, also in gzip")],
    *,
    targets: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(TARGETS),
            help="how many are in the file; by default many",
            **choice("targets", TARGETS),
        ),
    ] = None,
    tracker: Annotated[
        str | None,
        tracker_option(
            "of many targets pmb (default), pda, gnn, mht, phd, or another; of one target by default "
            "runnalls-30. NAME or NAME:key=value,key=value"
        ),
    ] = None,
    model: MotionModel = "constant-velocity",
    prior: Annotated[
        str | None,
        typer.Option(help="initial state of one target: positions, then velocities, with commas between"),
    ] = None,
    prior_deviations: Annotated[
        str | None, typer.Option(help="standard deviations of --prior, in the same order")
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(help="standard deviation of one target's unknown initial velocity, m/s; by default 150"),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(help="s between scans of one target, if empty scans have no row in the file"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="CSV of estimates; by default track.csv (one target) or tracks.csv"),
    ] = None,
    **given: Any,
) -> None:
    """Track the targets in a file of detections, and write labelled tracks of many, or the track of one.

    Both have covariances. Without --prior one target may be any detection of the first scan.
    """
    from gmr_gym.experiments.reading import configuration_of
    from gmr_gym.experiments.track_files import targets_asked, track_many
    from gmr_gym.experiments.track_one import track_one

    own = {
        "tracker": tracker, "prior": prior, "prior_deviations": prior_deviations, "speed": speed,
        "period": period,
    }  # fmt: skip
    settings = configuration_of(given)
    run = track_many if targets_asked(targets, settings) == "many" else track_one
    show(run(file, out, settings, given, own))


@takes(*INPUT_GROUPS)
def inspect(
    file: Annotated[Path, typer.Argument(help="CSV, text, JSON, Parquet, AIS or ASTERIX, also in gzip")],
    *,
    write: Annotated[
        Path | None,
        typer.Option(
            "--write",
            help="also estimate deviations, clutter and motion, and write them as TOML for `track --config`",
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the file of --write")] = False,
    **given: Any,
) -> None:
    """Show how a file of detections is read: columns, units, times, scans, sensors.

    With --write, also estimate from the file what `track` needs to know.
    """
    from gmr_gym.experiments import reading, specs
    from gmr_gym.recorded import cut
    from gmr_gym.recorded.description import described

    specs.check_ending("--write", write, ".toml")
    specs.check_absent("--write", write, overwrite)
    specs.check_writable(write, beside=[file])
    settings = reading.configuration_of(given)
    found = reading.detections_of(file, settings)
    scans = cut(found, window=given["scan_window"])
    show(described(found, scans))
    if write:
        from gmr_gym.experiments.proposing import write_proposal

        show(write_proposal(write, file, found, scans, settings))
