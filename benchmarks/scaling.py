"""How times grow: curves in clutter, components, dimension, environments and workers, and peak memory:
`python benchmarks/scaling.py docs/images/scaling.png`."""

import argparse
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import plain
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from problems import drawn, scans
from rows import Tracked
from start import COMMAND, peak
from timing import interleaved, timed
from vectors import side_by_side

from gmr_gym.evaluation import montecarlo
from gmr_gym.filters.registry import make_tracker
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.scenarios.dortenzio import turning_target

FEW = 4  # points that need no logarithmic scale
Curves = Mapping[str, tuple[list[float], list[float]]]  # name to x and y


def main() -> None:
    parser = argparse.ArgumentParser(description="Draw how times and memory grow.")
    parser.add_argument("file", type=Path)
    file = parser.parse_args().file
    measured = []
    for _, _, curves in PANELS:
        measured.append(curves())
        for name, points in measured[-1].items():
            print(name, *(f"{a:g}: {b:.4g}" for a, b in zip(*points, strict=True)), sep="\t", flush=True)
    draw(measured, file)


def draw(measured: Sequence[Curves], file: Path) -> None:
    """One panel for the curves of each of the PANELS; the number of a thing is its own tick."""
    figure = Figure(figsize=(12, 7), layout="constrained")
    axes = figure.subplots(2, 3).flat
    for ax, (x, y, _), curves in zip(axes, PANELS, measured, strict=True):
        for name, points in curves.items():
            ax.plot(*points, "o-", label=name)
        numbers = next(iter(curves.values()))[0]
        ax.set(xlabel=x, ylabel=y, xscale="log")
        ax.set_xticks(numbers, [f"{number:g}" for number in numbers])
        ax.set_xticks([], minor=True)
        if len(numbers) > FEW:
            ax.set_yscale("log")
            ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            ax.yaxis.set_major_formatter("{x:,.10g}")
            ax.yaxis.set_minor_formatter(NullFormatter())
        else:
            ax.set_ylim(bottom=0)
        ax.grid(alpha=0.3)
        ax.legend()
    figure.savefig(file, dpi=120)


def by_clutter() -> Curves:
    def at(rate: float) -> dict[str, float]:
        scenario = turning_target(clutter_rate=rate)
        seen = [scans(scenario, seed, 60) for seed in range(2)]
        trackers = {
            name: Tracked(
                make_tracker(name, scenario.model), seen, lambda p: (p.w @ p.m, len(p.w)), process_time
            )
            for name in ("runnalls-30", "adaptive", "pda")
        }
        return _milliseconds(interleaved(trackers, len(seen), 1))

    return _curves((25, 50, 100, 200, 400), at)


def by_components() -> Curves:
    return _curves((25, 50, 100, 200, 400, 800), lambda n: _merging(int(n), 4, int(n) // 5))


def by_dimension() -> Curves:
    return _curves((2, 3, 4, 6, 9, 12), lambda d: _merging(100, int(d), 20))


def _merging(n: int, d: int, components: int) -> dict[str, float]:
    given = drawn(n, d, 2)
    forms = {"Runnalls": runnalls, "plain, compiled": plain.runnalls_compiled}
    for reduce in forms.values():
        reduce(given[0], components)  # compiles
    return _milliseconds(
        interleaved(
            {
                name: timed(lambda p, reduce=reduce: reduce(p, components), *given, clock=process_time)
                for name, reduce in forms.items()
            },
            len(given),
            1,
        )
    )


def by_environments() -> Curves:
    def at(n: float) -> dict[str, float]:
        return {"TurningTarget": 1 / interleaved({"": side_by_side(int(n))}, 1, 3)[""].median}

    return _curves((1, 4, 16, 64, 256, 1024, 4096), at)


def by_workers() -> Curves:
    scenario = turning_target()
    trackers = {"runnalls-30": make_tracker("runnalls-30", scenario.model)}
    runs = 200

    def at(jobs: float) -> dict[str, float]:
        montecarlo.run(scenario, trackers, 40, jobs=int(jobs))  # starts them
        started = perf_counter()
        montecarlo.run(scenario, trackers, runs, jobs=int(jobs))
        return {"runnalls-30": runs / (perf_counter() - started)}

    return _curves(range(1, (os.cpu_count() or 1) + 1), at)


def by_runs() -> Curves:
    def at(runs: float) -> dict[str, float]:
        with TemporaryDirectory() as out:
            table = f"reproduce dortenzio --table 1 --jobs 1 --runs {int(runs)} --out".split()
            return {"all of it": peak(*COMMAND, *table, out).median}

    return _curves((20, 60, 180), at)


def _milliseconds(timings: Mapping) -> dict[str, float]:
    return {name: 1e3 * timing.median for name, timing in timings.items()}


def _curves(xs: Iterable[float], at: Callable[[float], Mapping[str, float]]) -> Curves:
    curves: dict[str, tuple[list[float], list[float]]] = {}
    for x in xs:
        for name, y in at(x).items():
            xs_so_far, ys = curves.setdefault(name, ([], []))
            xs_so_far.append(x)
            ys.append(y)
    return curves


PANELS: tuple[tuple[str, str, Callable[[], Curves]], ...] = (
    ("false detections a scan", "ms a scan", by_clutter),
    ("components before merging, a fifth of them after", "ms", by_components),
    ("dimension of the state; 100 to 20 components", "ms", by_dimension),
    ("environments side by side", "scans a second, by the clock", by_environments),
    ("workers", "runs a second, by the clock", by_workers),
    ("runs of Table 1 of D'Ortenzio", "peak memory, MB", by_runs),
)

if __name__ == "__main__":
    main()
