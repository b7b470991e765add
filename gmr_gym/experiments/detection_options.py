"""Options of the commands that read files of detections: what columns, sensors and targets are."""

import inspect
from collections.abc import Callable, Mapping
from functools import update_wrapper
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import typer


class Option(NamedTuple):
    """An option, by the name of its parameter."""

    type: Any
    help: str
    default: Any = ""
    names: tuple[str, ...] = ()  # on the command line, where they are not made of the parameter's


Columns = list[str]
COLUMN = "COLUMN:UNIT; SENSOR=COLUMN:UNIT for one sensor, repeatable"
ROLES = {
    "time": "COLUMN:UNIT, COLUMN:iso, or COLUMN:FORMAT as in %d/%m/%Y %H:%M:%S",
    "x": f"east: {COLUMN}", "y": "north", "z": "up",
    "lat": "latitude", "lon": "longitude", "alt": "altitude",
    "range": "slant range", "azimuth": "azimuth; see --azimuth-convention",
    "elevation": "elevation above the horizon",
    "range_rate": "range rate; positive away from the sensor",
    "own_x": "x of a moving sensor, from which x, y are measured",
    "own_y": "y of it", "own_z": "z of it",
    "own_lat": "latitude of a moving sensor, from which x, y or range and azimuth are measured",
    "own_lon": "longitude of it", "own_alt": "altitude of it",
    "scan": "number of the scan", "sensor": "name of the sensor", "id": "identity that the sensor reports",
    "truth": "target that a row is of, for evaluation",
}  # fmt: skip
INPUT = {
    "config": Option(str | None, "TOML file of settings, which options override", None),
    **{name: Option(Columns, text, []) for name, text in ROLES.items()},
    "where": Option(Columns, "only rows that satisfy a condition, such as 'snr>10'; repeatable", []),
    "keep": Option(Columns, "column kept as metadata; repeatable; by default all", []),
    "delimiter": Option(str, "one character, tab or space; by default found in the first line"),
    "decimal": Option(str, "decimal separator; by default a point", names=("--decimal",)),
    "encoding": Option(str, "encoding of text; by default utf-8"),
    "header": Option(
        bool | None, "whether the first line has the columns' names (default), else 1, 2, ...",
        None, ("--header/--no-header",),
    ),
    "day": Option(str, "YYYY-MM-DD, date of the first row, where times are seconds of the day"),
    "order": Option(str, "sort rows by time (default), or refuse those that are not sorted: sort|strict"),
    "drop_repeats": Option(
        bool | None, "whether duplicate rows are dropped; by default they are", None,
        ("--drop-repeats/--keep-repeats",),
    ),
    "scan_window": Option(float | None, "s; rows within this time of the first are one scan", None),
}  # fmt: skip
SENSOR = {
    "sensor_position": Option(str, "LAT,LON,ALT of the sensor, in degrees and metres"),
    "reference": Option(str, "LAT,LON,ALT of the origin of x, y; by default the sensor, or the first row"),
    "north_offset": Option(str, "angle from true north to the sensor's north, clockwise, such as 1.5deg"),
    "azimuth_convention": Option(
        str, "compass: clockwise from north (default); math: counter-clockwise from x"
    ),
    "rotation_period": Option(str, "s a turn of the antenna; a turn is a scan"),
    "sensor_deviation": Option(
        str, "standard deviation of a detection: in m, or as range=50,azimuth=0.1deg,range_rate=1, or auto"
    ),
    "detection_probability": Option(
        float | None, "probability that a target is detected in a scan; by default 0.9", None
    ),
    "clutter_density": Option(float | None, "false alarms per scan and m^2 (m^3 in space)", None),
    "clutter_per_scan": Option(float | None, "false alarms per scan", None),
}
TARGET = {
    "motion": Option(
        str, "motion of many targets: imm (default), constant-velocity or constant-acceleration"
    ),
    "acceleration_deviation": Option(
        str, "m/s^2, one target: standard deviation, by default 3; many: for each motion model, how much "
        "the velocity changes in a second, by default 0.1,3, or 0.1 of a single one",
    ),
    "max_speed": Option(float | None, "m/s, the highest speed of a new target", None),
    "stay_probability": Option(float | None, "probability to keep the motion model for a second", None),
    "survival_probability": Option(float | None, "probability to exist a second later", None),
}  # fmt: skip
TRACKS = {
    "confirm": Option(str, "M/N: confirm a track when M of the last N scans detected it"),
    "confirm_existence": Option(
        float | None, "or when its existence has this probability; by default 0.9", None
    ),
    "delete": Option(str, "M/N: delete a track when M of the last N scans missed it; by default 5/5"),
    "delete_existence": Option(
        float | None, "or when the probability of its existence is less than this", None
    ),
    "max_coast": Option(float | None, "s; delete a track that is not detected for so long", None),
    "gate_probability": Option(float | None, "probability that a target's detection is in its gate", None),
    "min_speed": Option(float | None, "m/s; slower tracks are not confirmed", None),
    "learn_clutter": Option(
        bool, "estimate the clutter from the detections of no track", False, ("--learn-clutter",)
    ),
}
OUTPUT = {
    "smooth": Option(
        bool, "also write NAME-smoothed.csv, where tracks use later detections too", False, ("--smooth",)
    ),
    "geojson": Option(Path | None, "GeoJSON of many targets' tracks", None),
    "html": Option(Path | None, "page that shows the tracks scan by scan", None),
    "mot": Option(Path | None, "tracks in the ten columns of the MOTChallenge, .txt", None),
    "labelled": Option(Path | None, "rows of the input, each with its track", None),
    "report": Option(Path | None, "how good the tracks are, .json or .md", None),
    "truth_file": Option(Path | None, "true positions of the targets: a table, or a file of Autoferry", None),
    "cutoff": Option(float, "m; a track farther from a target than this is not counted as its track", 50.0),
    "only": Option(str, "which rows: confirmed (tracks from their confirmation on; default) or all"),
    "overwrite": Option(bool, "replace files that exist", False, ("--overwrite",)),
    "dry_run": Option(bool, "show what would be tracked and written, and do neither", False, ("--dry-run",)),
}  # fmt: skip
INPUT_GROUPS = (("input", INPUT), ("sensor", SENSOR))
ALL_GROUPS = (*INPUT_GROUPS, ("target", TARGET), ("tracks", TRACKS), ("output", OUTPUT))


def takes(*groups: tuple[str, Mapping[str, Option]]) -> Callable[[Callable], Callable]:
    """A decorator of a command that takes the options of these groups as keywords."""

    def decorated(command: Callable) -> Callable:
        signature = inspect.signature(command, eval_str=True)
        own = [p for p in signature.parameters.values() if p.kind is not inspect.Parameter.VAR_KEYWORD]
        parameters = [
            *own,
            *(
                _parameter(name, option, panel)
                for panel, options in groups
                for name, option in options.items()
            ),
        ]

        def taking(*args: Any, **keywords: Any) -> Any:
            return command(*args, **keywords)

        update_wrapper(taking, command)
        # its source has fewer defaults than the signature, and what documents it compares the two
        del taking.__wrapped__  # type: ignore[attr-defined]
        taking.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
        taking.__annotations__ = {p.name: p.annotation for p in parameters}
        return taking

    return decorated


def typed(given: Mapping[str, Any]) -> list[str]:
    """The options that were given, as words of a command."""
    words = []
    for _, options in ALL_GROUPS:
        for name, option in options.items():
            yes, _, no = (option.names[0] if option.names else f"--{name.replace('_', '-')}").partition("/")
            value = given[name]
            if value == option.default:
                continue
            if isinstance(value, bool):
                words.append(yes if value else no)
            else:
                words += [
                    word
                    for one in (value if isinstance(value, list) else [value])
                    for word in (yes, f"{one}")
                ]
    return words


def said_by(given: Mapping[str, Any], *groups: Mapping[str, Option]) -> dict[str, Any]:
    """What was typed of the options of these groups, by name."""
    return {
        name: given[name]
        for group in groups
        for name, option in group.items()
        if given[name] != option.default
    }


def given_columns(given: Mapping[str, Any]) -> dict[str, list[str]]:
    """Columns that were typed, by role."""
    return {role: given[role] for role in ROLES if given[role]}


def _parameter(name: str, option: Option, panel: str) -> inspect.Parameter:
    names = option.names or (f"--{name.replace('_', '-')}",)
    typed = typer.Option(*names, help=option.help, rich_help_panel=panel, show_default=bool(option.default))
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=option.default, annotation=Annotated[option.type, typed]
    )
