"""The rows of the table on reduction."""

from collections.abc import Callable, Iterator
from importlib.util import find_spec

import numpy as np
import plain
from problems import drawn, partition, posteriors
from timing import Plan, Row, interleaved, timed

from gmr_gym.mixture import Mixture
from gmr_gym.reduction.ise import integral_squared_error
from gmr_gym.reduction.runnalls import adaptive, runnalls

if find_spec("stonesoup"):
    import stone_soup
else:
    stone_soup = None
if find_spec("pytcl"):
    from pytcl.clustering import GaussianComponent, reduce_mixture_runnalls
else:
    GaussianComponent = None

Reduce = Callable[[Mixture], Callable[[], list[float]]]  # a mixture, made ready, to the weights left

SIZES = ((50, 5, 300.0), (150, 30, 150.0), (400, 50, 300.0))  # components, target, clutter a scan
SLOW = 100  # components from which nrl-tracker takes more than ten seconds


def reduction_rows(plan: Plan) -> Iterator[Row]:
    rounds, count = (1, 4) if plan.quick else (5, 8)
    plainly = {"plain, compiled": plain.runnalls_compiled, "plain, NumPy": plain.runnalls_in_numpy}
    for n, components, clutter_rate in SIZES:
        mixtures = {
            "tracker posteriors": posteriors(n, components, clutter_rate, count),
            "random mixtures": drawn(n, 4, count),
        }
        for source, given in mixtures.items():
            forms = {"ours": lambda p, k: runnalls(p, k)[1], **plainly}
            yield from _reducer_rows(
                f"Runnalls 4-D {n} to {components}, {source}", forms, components, given, rounds, plan.clock
            )
        for library, reduce in _peers(n, components).items():
            yield _peer_row(n, components, mixtures["tracker posteriors"], library, reduce, plan.clock)
    given = posteriors(150, 30, 150.0, count)
    forms = {"ours": lambda p, bound: adaptive(p, bound)[1], "plain, NumPy": plain.adaptive_in_numpy}
    yield from _reducer_rows("adaptive 4-D 150, loss bound 0.05", forms, 0.05, given, rounds, plan.clock)
    williams = {"ours": lambda p, k: integral_squared_error(p, k)[1], "plain, NumPy": plain.williams_in_numpy}
    given = drawn(40, 6, 1 if plan.quick else 3, concentration=100.0)
    what = "Williams ISE 6-D {} to {}, weights nearly equal"
    yield from _reducer_rows(what.format(40, 10), williams, 10, given, 1, plan.clock)
    given = drawn(150, 6, 1 if plan.quick else 3, concentration=100.0)
    ours = timed(lambda p: integral_squared_error(p, 15), *given, clock=plan.clock)
    yield Row(what.format(150, 15), interleaved({"ours": ours}, len(given), rounds)["ours"], "none", None)


def _reducer_rows(what: str, forms: dict, limit: float, given: list, rounds: int, clock) -> Iterator[Row]:
    """Ways of forming the same reduction: what the note says of their merges is checked first."""
    # which compiles, too
    merges = {name: [partition(reduce(p, limit)) for p in given] for name, reduce in forms.items()}
    timings = interleaved(
        {
            name: timed(lambda p, reduce=reduce: reduce(p, limit), *given, clock=clock)
            for name, reduce in forms.items()
        },
        len(given),
        rounds,
    )
    for name in list(forms)[1:]:
        same = sum(ours == theirs for ours, theirs in zip(merges["ours"], merges[name], strict=True))
        note = f"same merges in {same} of {len(given)}"
        yield Row(what, timings["ours"], name, timings[name], note)


def _peers(n: int, components: int) -> dict[str, Reduce | None]:
    """Reductions of other libraries, None where one is not installed."""
    peers: dict[str, Reduce | None] = {"Stone Soup, by another rule": None}
    if stone_soup:
        peers["Stone Soup, by another rule"] = stone_soup.reduction(components)
    if n < SLOW:
        peers["nrl-tracker"] = _by_nrl_tracker(components) if GaussianComponent else None
    return peers


def _by_nrl_tracker(components: int) -> Reduce:
    def prepared(p: Mixture):
        given = [GaussianComponent(*part) for part in zip(*p, strict=True)]
        return lambda: [c.weight for c in reduce_mixture_runnalls(given, components, 0.0).components]

    return prepared


def _peer_row(n: int, components: int, given: list, library: str, reduce: Reduce | None, clock) -> Row:
    what = f"Runnalls 4-D {n} to {components}, tracker posteriors"
    alternatives = {"ours": timed(lambda p: runnalls(p, components), *given, clock=clock)}
    note = "not installed"
    if reduce:
        # made anew for each call, which may write into it, and not charged for
        alternatives[library] = lambda i: timed(reduce(given[i]), clock=clock)(0)
        same = sum(_alike(runnalls(p, components)[0].w, reduce(p)()) for p in given)
        note = f"same weights in {same} of {len(given)}"
    timings = interleaved(alternatives, len(given), 1)
    return Row(what, timings["ours"], library, timings.get(library), note)


def _alike(w: np.ndarray, theirs: list[float]) -> bool:
    return len(w) == len(theirs) and np.allclose(np.sort(w), np.sort(theirs))
