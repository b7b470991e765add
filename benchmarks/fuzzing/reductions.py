"""Reductions as targets: every one there is by name, the functions of `reduction`, and any of one's own."""

from collections.abc import Callable
from functools import partial

import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import WORDS, Rng, hostile_mixture, mixture_in_layout, spoilt_array, spoilt_mixture
from gmr_gym.mixture import Mixture, collapsed, log_density, moments, normalised
from gmr_gym.reduction.properties import PROPERTIES
from gmr_gym.reduction.pruning import prune, prune_and_cap, prune_density
from gmr_gym.reduction.registry import REDUCERS, reducer
from gmr_gym.reduction.runnalls import adaptive, total_merge_cost
from gmr_gym.reduction.salmond_west import salmond
from gmr_gym.reduction.vo_ma import vo_ma

COUNTS = (0, -1, 1.5, np.nan, "3", ())  # of components, that are none
# what a reduction does besides merging, which keeps total weight, mean and covariance; of any not named here
# all three have to be kept
RESCALES, DROPS = (
    ("ise", "prune-or-merge"),
    ("ise-unscaled", "capping", "vo-ma", "prune", "prune-density", "heaviest"),
)
# where a reduction says that it cannot tell
TOO_FAR = "too far apart|finite integral|outside 1e-300 to 1e300|prune first"


def reduction_targets() -> list[Target]:
    """Every reduction."""
    named = [reduction_target(name, partial(_reduced, reduce)) for name, reduce in REDUCERS.items()]
    others = {
        "vo-ma": vo_ma,
        "adaptive-by": lambda p, components: adaptive(p, 1 / components),
        "salmond-by": lambda p, components: salmond(p, 1, 1 / components),
        "prune": lambda p, components: prune(p, 0.1**components),
        "prune-density": lambda p, components: prune_density(p, 0.1**components),
        "heaviest": lambda p, components: prune_and_cap(p, 0.01, components),
    }
    budgets = {"vo-ma", "heaviest"}
    rest = [
        reduction_target(name, partial(_reduced, reduce), name in budgets) for name, reduce in others.items()
    ]
    large = [
        reduction_target(name, partial(_reduced, REDUCERS[name]), most=most)._replace(
            name=f"{name}/large", share=0.002, patience=6.0
        )
        for name, most in (
            ("runnalls", 600),
            ("adaptive", 600),
            ("ise", 100),
            ("capping", 5000),
            ("west", 300),
        )
    ]
    return [*named, *rest, *large, *mixture_targets()]


def reduction_target(name: str, reduce: Callable, budget: bool = True, most: int = 12) -> Target:
    """The reduction (mixture, components) -> (mixture, origin) as a target. `budget`: whether no more than
    so many components may be left."""
    return Target(
        f"reduction/{name}",
        partial(_draw, most=most),
        reduce,
        partial(_check, name=name, reduce=reduce, budget=budget),
        partial(_spoil, budget=budget),
        share=3.0,
        refuses=TOO_FAR,
    )


def own_target(name: str) -> Target:
    """The reduction "module:function" as a target."""

    def reduce(p, plain, components):
        return reducer(name, components)(p)

    return reduction_target(name, reduce)


def _reduced(reduce, p, plain, components):
    return reduce(p, components=components)


def _draw(rng: Rng, most: int) -> tuple:
    p = plain = hostile_mixture(rng, most if rng.random() < 0.95 else 3 * most)
    if rng.random() < 0.1:
        p, plain = mixture_in_layout(rng, plain)
    return p, plain, int(rng.integers(1, len(plain.w) + 2))


def _spoil(rng: Rng, arguments: tuple, budget: bool) -> Spoilt:
    _p, plain, components = arguments
    if budget and rng.random() < 0.1:
        count = COUNTS[rng.integers(len(COUNTS))]
        return Spoilt((plain, plain, count), ("components", "max_components"), f"components {count!r}")
    spoilt, names, what = spoilt_mixture(rng, plain)
    return Spoilt((spoilt, plain, components), names, what)


def _spoil_weights(rng: Rng, arguments: tuple) -> Spoilt:
    """Of what looks at nothing but the weights."""
    _, plain, components = arguments
    if rng.random() < 0.3:
        spoilt, what = -plain.w, "minus signs"
    else:
        spoilt, what = spoilt_array(rng, plain.w)
    return Spoilt((plain._replace(w=spoilt), plain, components), WORDS["w"], f"w with {what}")


def _check(arguments: tuple, result, name: str, reduce: Callable, budget: bool) -> None:
    given, p, components = arguments
    q, origin = _shaped(p, result)
    n = len(p.w)
    if len(q.w) > min(n, components if budget else n):
        raise Finding("shape", f"{len(q.w)} components are left of {n}, at most {components} were to be")
    checks.finite("w", q.w)
    checks.finite("m", q.m)
    if (q.w < 0).any() or not q.w.any():
        raise Finding("moments", f"weights {q.w.tolist()} of {p.w.tolist()}")
    least = np.linalg.eigvalsh(p.P)[:, 0].min()
    checks.covariances("P", q.P, least)
    if (origin[p.w == 0] != -1).any():
        raise Finding("origin", f"a component of weight zero is kept: {origin.tolist()}")
    before, after = np.sum(p.w, dtype=np.longdouble), np.sum(q.w, dtype=np.longdouble)
    room = checks.ROOM * n * checks.EPS
    kept = p.w[origin >= 0].sum(dtype=np.longdouble)
    rescaled = name in RESCALES and n > components
    if PROPERTIES.get(name, PROPERTIES["runnalls"]).matches or n <= components:
        checks.groups_match(p, q, origin, before / kept if rescaled else 1.0)
    if name in DROPS:
        if after > before * (1 + room):
            raise Finding("moments", f"the weight grew from {before} to {after}")
    elif not abs(after - before) <= room * before:
        raise Finding("moments", f"the total weight went from {before} to {after}")
    if given is not p:
        again = _shaped(p, reduce(p, p, components))
        checks.same("variant", "another layout gives another result", (*q, origin), (*again[0], again[1]))


def _shaped(p: Mixture, result) -> tuple[Mixture, np.ndarray]:
    try:
        q, origin = result
        n, d = len(q.w), p.m.shape[1]
        sound = isinstance(q, Mixture) and (q.m.shape, q.P.shape) == ((n, d), (n, d, d))
        sound &= origin.shape == p.w.shape and origin.dtype.kind == "i"
        sound &= all(a.dtype == float for a in q)
    except (TypeError, ValueError, AttributeError):
        sound = False
    if not sound:
        raise Finding("shape", f"no mixture and origin of {p.m.shape}: {result!r}"[:300])
    if not ((-1 <= origin) & (origin < n)).all():
        raise Finding("origin", f"origin {origin.tolist()} of {n} components")
    return q, origin


def mixture_targets() -> list[Target]:
    """What is asked of whole mixtures."""
    draw = partial(_draw, most=12)
    asked = {
        "moments": (moments, _moments),
        "collapsed": (collapsed, _collapsed),
        "normalised": (normalised, lambda p, q: checks.mixture(q, p.m.shape[1], 1.0)),
        "total_merge_cost": (total_merge_cost, _merge_cost),
        "log_density": (lambda p: log_density(p, p.m), _log_density),
    }
    return [
        Target(
            f"mixture/{name}",
            draw,
            partial(_asked, ask),
            partial(_answered, ask, check),
            _spoil_weights if name == "normalised" else partial(_spoil, budget=False),
            refuses=TOO_FAR,
        )
        for name, (ask, check) in asked.items()
    ]


def _asked(ask, p, plain, components):
    return ask(p)


def _answered(ask, check, arguments, result):
    given, p, _ = arguments
    check(p, result)
    if given is not p:
        again = ask(p)
        checks.same("variant", "another layout gives another result", result, again)


def _moments(p, result):
    mean, covariance = result
    checks.finite("mean", mean)
    checks.covariances("covariance", covariance, np.linalg.eigvalsh(p.P)[:, 0].min())
    whole = Mixture(np.array([p.w.sum()]), mean[None], covariance[None])
    checks.groups_match(p, whole, np.zeros(len(p.w), int))


def _collapsed(p, q):
    checks.groups_match(p, q, np.zeros(len(p.w), int))


def _merge_cost(p, cost):
    checks.finite("cost", cost)
    if cost < -1e-9 * p.w.sum() * np.abs(np.linalg.slogdet(p.P)[1]).max():
        raise Finding("value", f"merging costs {cost}")


def _log_density(p, values):
    if not (np.isfinite(values) | (p.w == 0) & (values == -np.inf)).all():
        raise Finding("not finite", f"log density {values}")
    # at the mean of a component it is at least that of the component alone
    with np.errstate(divide="ignore"):
        alone = np.log(p.w) - 0.5 * np.linalg.slogdet(2 * np.pi * p.P)[1]
    room = 1e-9 + checks.ROOM * checks.EPS * np.linalg.cond(p.P)  # of the determinants
    if (values < alone - 1e-9 * np.abs(alone) - room).any():
        raise Finding("value", f"log density {values} below that of a component alone, {alone}")
