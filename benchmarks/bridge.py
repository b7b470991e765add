"""What a scan costs through the bridge to Stone Soup: `python benchmarks/bridge.py`, with the extra
`stonesoup`. Processor time, the median of alternating repeats."""

import gc
from collections.abc import Callable
from datetime import datetime, timedelta
from time import process_time

import numpy as np
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.types.state import GaussianState

from gmr_gym.filters.registry import make_tracker
from gmr_gym.stonesoup import SingleTargetTracker, detections_of, model_of, scan_of

START, SECOND = datetime(2024, 5, 1), timedelta(seconds=1)
SCANS, REPEATS = 200, 15
SENSOR = LinearGaussian(4, (0, 2), 100 * np.eye(2))
MOVES = CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0)] * 2)
PRIOR = GaussianState([0, 10, 0, -10], np.diag([100.0, 25.0, 100.0, 25.0]), START)


def main() -> None:
    print("| tracker | false alarms | alone, µs | conversion, µs | both, µs | bridge, µs | rest / alone |")
    print("|---|---|---|---|---|---|---|")
    for name in ("pda", "runnalls-30"):
        for clutter in (20, 150):
            alone, converted, both, bridge = measured(name, clutter)
            figures = f"{alone:.0f} | {converted:.0f} | {both:.0f} | {bridge:.0f}"
            print(f"| {name} | {clutter} | {figures} | {(bridge - converted) / alone:.1f} |")


def measured(name: str, clutter: int) -> np.ndarray:
    """Microseconds a scan: the tracker alone, the conversion of its detections, the two in turn, where the
    objects have filled the caches before the tracker, and the bridge."""
    rng, density = np.random.default_rng(0), clutter / 1e6
    path = [np.array([10.0, -10.0]) * t for t in range(1, SCANS + 1)]
    z = [np.vstack([at + 10 * rng.normal(size=2), at + rng.uniform(-500, 500, (clutter, 2))]) for at in path]
    times = [START + t * SECOND for t in range(1, SCANS + 1)]
    found = [detections_of(scan, time, SENSOR) for scan, time in zip(z, times, strict=True)]
    assumed = model_of(
        MOVES, SENSOR, PRIOR, SECOND, prob_detect=0.9, prob_gate=0.999, clutter_spatial_density=density
    )
    own = make_tracker(name, assumed)

    def alone() -> None:
        belief = own.init()
        for scan in z:
            belief, _ = own.step(belief, scan)

    def conversion() -> None:
        for detections, time in zip(found, times, strict=True):
            scan_of(detections, SENSOR, time)

    def both() -> None:
        belief = own.init()
        for detections, time in zip(found, times, strict=True):
            belief, _ = own.step(belief, scan_of(detections, SENSOR, time)[1])

    def bridge() -> None:
        tracker = next(fresh)
        for detections, time in zip(found, times, strict=True):
            tracker.update_tracker(time, detections)

    made = [
        SingleTargetTracker(
            prior=PRIOR, transition_model=MOVES, measurement_model=SENSOR, clutter_spatial_density=density,
            tracker=name,
        )
        for _ in range(REPEATS + 1)
    ]  # fmt: skip
    fresh = iter(made)
    each: list[Callable[[], None]] = [alone, conversion, both, bridge]
    for run in each:
        run()
    gc.collect()
    gc.disable()  # thousands of detections of other scans are not traversed, as they would not be there
    seconds = np.array([[_timed(run) for run in each] for _ in range(REPEATS)])
    gc.enable()
    return 1e6 * np.median(seconds, axis=0) / SCANS


def _timed(run: Callable[[], None]) -> float:
    started = process_time()
    run()
    return process_time() - started


if __name__ == "__main__":
    main()
