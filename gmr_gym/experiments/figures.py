"""What figures are called, their units, and which of them a command shows."""

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any, NamedTuple


class Metric(NamedTuple):
    """How a figure is called, its unit in files, and on a screen where that is another one."""

    heading: str
    unit: str = "1"
    shown: str = ""
    scale: float = 1  # from the one to the other


SHARE, TIME = ("1", "%", 100), ("s", "ms", 1e3)
METRICS = {
    "track_loss": Metric("lost", *SHARE), "components": Metric("components"),
    "error_capped": Metric("capped error", "m"), "anees_own": Metric("ANEES"),
    **{f"error_{over}": Metric(f"error {over}", "m") for over in ("own", "common")},
    **{f"{part}rmse_{over}": Metric(f"{words}RMSE {over}", unit) for part, words, unit in (
        ("", "", "m"), ("velocity_", "velocity ", "m/s"), ("level_", "level ", "m"),
        ("level_velocity_", "level velocity ", "m/s"), *((f"{axis}_", f"{axis} ", "m") for axis in "xyz"),
    ) for over in ("own", "common", "all")},
    **{f"{field}_{over}": Metric(words if over == "own" else f"{words} {over}", "dB")
       for field, words in (("nci", "NCI"), ("inclination", "inclination"))
       for over in ("own", "common", "all")},
    "sight_bias_own": Metric("bias along the line of sight", "m"),
    "position_anees_own": Metric("ANEES of position"),
    "gate_area": Metric("gate area", "m^2 (volume, m^3)"), "gate_volume": Metric("gate volume", "m^3"),
    "time_per_scan": Metric("time a scan", *TIME), "time_worst": Metric("longest", *TIME),
    "time_in_pda_scans": Metric("time, in scans of PDA"),
    "ospa": Metric("OSPA", "m"), "gospa": Metric("GOSPA", "m"),
    **{part: Metric(part, "m^2") for part in ("localisation", "missed", "false")},
    "gospa_rms": Metric("RMS GOSPA", "m"),
    **{f"gospa_{phase}": Metric(f"RMS GOSPA {words}", "m")
       for phase, words in (("before", "before"), ("meeting", "at the meeting"), ("after", "after"))},
    "trajectory_gospa": Metric("T-GOSPA", "m"),
    **{f"trajectory_{part}": Metric(f"T-GOSPA {part}", "m^2")
       for part in ("localisation", "missed", "false", "switches")},
    "switches": Metric("switches"), "fragments": Metric("fragments"),
    **{f"labels_kept{key}": Metric(f"labels kept{words}", *SHARE)
       for key, words in (("", ""), ("_before", " before"), ("_after", " after"))},
    "time_to_find": Metric("time to find", "s"), "existence_bias": Metric("existence bias"),
    "existence_brier": Metric("Brier score"), "anees": Metric("ANEES"),
    "cardinality_bias": Metric("cardinality bias"), "cardinality_error": Metric("cardinality error"),
    "wasserstein": Metric("Wasserstein", "m"), "wasserstein_printed": Metric("Wasserstein by eq. 41", "m"),
    **{f"{measure}{key}": Metric(f"{words}{name}")
       for measure, name in (("ise", "ISE"), ("nise", "NISE"), ("divergence", "KL(f||g)"),
                             ("reverse_divergence", "KL(g||f)"))
       for key, words in (("", ""), ("_median", "median "))},
    "time_per_reduction": Metric("time a call", *TIME),
    "track_loss_difference": Metric("lost, difference", *SHARE),
    "error_difference": Metric("capped error, difference", "m"),
    "wasserstein_undefined": Metric("Wasserstein undefined", *SHARE),
    "density_error": Metric("clutter error"), "objective": Metric("objective"),
}  # fmt: skip
HEADINGS = {
    name: ", ".join(filter(None, (
        one.heading, one.shown or one.unit.replace("^2", "²").replace("^3", "³").removeprefix("1"),
    )))
    for name, one in METRICS.items()
}  # fmt: skip
LEGEND = {
    "RMSE": "root mean square error", "error": "mean distance from the truth",
    "own": "over the runs that a tracker kept", "common": "over those that every tracker kept",
    "all": "over all runs",
}  # fmt: skip


class Evaluated(NamedTuple):
    """The figures of one target or of many: those a table shows, those that are left to files, and those that
    a grid of settings is read by."""

    shown: tuple[str, ...]
    left: tuple[str, ...]
    swept: tuple[str, ...]


ONE_TARGET = Evaluated(
    ("track_loss", "rmse_own", "error_common", "velocity_rmse_own", "anees_own", "components", "gate_area",
     "time_per_scan"),
    ("rmse_common", "error_own", "nci_own", "inclination_own"),
    ("track_loss", "error_common", "components", "time_per_scan"),
)  # fmt: skip
MULTI_TARGET = Evaluated(
    ("ospa", "gospa", "localisation", "missed", "false", "cardinality_bias", "cardinality_error",
     "density_error", "components", "trajectory_gospa", "switches", "fragments", "time_to_find",
     "time_per_scan"),
    ("wasserstein", "wasserstein_undefined", "trajectory_localisation", "trajectory_missed",
     "trajectory_false", "trajectory_switches", "labels_kept", "existence_bias", "existence_brier", "anees"),
    ("gospa", "cardinality_error", "components", "time_per_scan"),
)  # fmt: skip
ALL_FIGURES = {
    metric: HEADINGS[metric] for of in (ONE_TARGET, MULTI_TARGET) for metric in (*of.shown, *of.left)
}


def check_known(asked: Sequence[str], of: Evaluated) -> None:
    """ValueError for a figure that there is not."""
    known = (*of.shown, *of.left)
    for name in asked:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"unknown metric {name!r}{hint} (there are {', '.join(known)})")


def cell_name(cell: Mapping[str, Any]) -> str:
    """What a cell of a grid of settings is called."""
    return ", ".join(f"{setting}={value}" for setting, value in cell.items())


def heading(metric: str) -> str:
    """What a figure is called above a table, with the unit of a screen."""
    return HEADINGS.get(metric, metric)


def legend(metrics: Iterable[str]) -> list[str]:
    """A line on the words in the headings of these metrics; none where no word needs one."""
    words = {word for metric in metrics for word in heading(metric).replace(",", "").split()}
    said = [f"{word}: {meaning}" for word, meaning in LEGEND.items() if word in words]
    return ["; ".join(said)] if said else []


def counted(number: int, name: str) -> str:
    """A number of things: `1 track`, `2 tracks`."""
    return f"{number} {name}" + "s" * (number != 1)
