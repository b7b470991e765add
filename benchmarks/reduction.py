"""The rows of the table on reduction."""

from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec

import numpy as np
import plain
import plain_reductions
from problems import drawn, partition, posteriors
from timing import Plan, Row, compared, timed

from gmr_gym.mixture import Mixture
from gmr_gym.reduction.consistent_merging import consistent
from gmr_gym.reduction.distances import integral_squared_difference
from gmr_gym.reduction.ise import integral_squared_error
from gmr_gym.reduction.refinement import refine
from gmr_gym.reduction.runnalls import adaptive, runnalls
from gmr_gym.reduction.transportation import transportation

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
COUNT = 4  # mixtures
SLOW = 100  # components from which nrl-tracker takes more than ten seconds


def reduction_rows(plan: Plan) -> Iterator[Row]:
    plainly = {"plain, compiled": plain.runnalls_compiled, "plain, NumPy": plain.runnalls_in_numpy}
    for n, components, clutter_rate in SIZES:
        met = posteriors(n, components, clutter_rate, COUNT)
        for source, given in {"tracker posteriors": met, "random mixtures": drawn(n, 4, COUNT)}.items():
            what = f"Runnalls 4-D {n} to {components}, {source}"
            yield from _reducer_rows(plan, what, runnalls, plainly, components, given)
        for library, reduce in _peers(n, components).items():
            yield _peer_row(plan, n, components, met, library, reduce)
    what, plainly = "adaptive 4-D 150, loss bound 0.05", {"plain, NumPy": plain.adaptive_in_numpy}
    yield from _reducer_rows(plan, what, adaptive, plainly, 0.05, posteriors(150, 30, 150.0, COUNT))
    plainly = {"plain, compiled": plain.williams_compiled, "plain, NumPy": plain.williams_in_numpy}
    for n, components in ((40, 10), (150, 15)):
        what, given = f"Williams ISE 6-D {n} to {components}, weights nearly equal", drawn(n, 6, 1, 100.0)
        yield from _reducer_rows(plan, what, integral_squared_error, plainly, components, given)
        plainly = {"plain, compiled": plain.williams_compiled}
    reduce, given = partial(consistent, measure="reverse-kl"), drawn(150, 4, COUNT)
    plainly = {
        "plain, compiled": plain_reductions.reverse_kl_compiled,
        "plain, NumPy": plain_reductions.reverse_kl_in_numpy,
    }
    yield from _reducer_rows(plan, "merging by reverse KL 4-D 150 to 30", reduce, plainly, 30, given)
    plainly = {"plain, NumPy": plain_reductions.transportation_in_numpy}
    yield from _reducer_rows(plan, "transportation 4-D 150 to 30", transportation, plainly, 30, given)
    yield _refinement_row(plan)


def _refinement_row(plan: Plan) -> Row:
    arguments = [(p, 5) for p in drawn(10, 4, 1)]  # theirs takes seconds
    forms = (lambda p, limit: refine(p, limit)[0]), plain_reductions.refine_in_scipy
    errors = [np.mean([integral_squared_difference(p, form(p, 5)) for p, _ in arguments]) for form in forms]
    note = f"mean errors {errors[0]:.3g}, theirs {errors[1]:.3g}"
    ours, theirs = (timed(form, arguments) for form in (refine, forms[1]))
    return compared(plan, "refinement of the ISE 4-D 10 to 5", ours, "SciPy's BFGS on NumPy", theirs, note)


def _reducer_rows(plan: Plan, what: str, reduce: Callable, plainly: dict, limit: float, given: list):
    """Ways of forming the same reduction: what the note says of their merges is checked first."""
    merges = [partition(reduce(p, limit)[1]) for p in given]  # which compiles, too
    arguments = [(p, limit) for p in given]
    for name, form in plainly.items():
        same = sum(one == partition(form(p, limit)) for one, p in zip(merges, given, strict=True))
        note = f"same merges in {same} of {len(given)}"
        yield compared(plan, what, timed(reduce, arguments), name, timed(form, arguments), note)


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


def _peer_row(plan: Plan, n: int, components: int, given: list, library: str, reduce: Reduce | None) -> Row:
    what = f"Runnalls 4-D {n} to {components}, tracker posteriors"
    if not reduce:
        return Row(what, library, note="not installed")
    given = given[: 1 if library == "nrl-tracker" else 2]
    same = sum(_alike(runnalls(p, components)[0].w, reduce(p)()) for p in given)
    # made anew for each call, which may write into it
    theirs = timed(lambda call: call(), [(p,) for p in given], prepare=lambda p: (reduce(p),))
    ours = timed(runnalls, [(p, components) for p in given])
    return compared(plan, what, ours, library, theirs, f"same weights in {same} of {len(given)}")


def _alike(w: np.ndarray, theirs: list[float]) -> bool:
    return len(w) == len(theirs) and np.allclose(np.sort(w), np.sort(theirs))
