"""Rivals of a learned policy: families of policies and of trackers, and the numbers that tuning chooses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np
from judge import Policy
from tracked import Tracked

from gmr_gym.filters.adaptive_noise import METHODS
from gmr_gym.tuning.features import model_features
from gmr_gym.tuning.instances import instances, world
from gmr_gym.tuning.policies import ByTable, Constant, Rule, Schedule
from gmr_gym.tuning.thresholds import DORTENZIO, Thresholds, to_action

REDUCERS = {"adaptive": ("alpha", "prune"), "n-scan": ("history", "prune"), "cluster": ("distance", "prune")}
NOISE, COASTING, FADING, MOST = "process_noise", "coasting_noise", "fading", "components"
ALL = NOISE, FADING, MOST
BEST = "n-scan", "cluster"  # whose thresholds tables, rules and schedules set, with all of these
PIECES, EVERY = 3, 15  # scans
CELLS = 2  # of each number that an engineer knows
KNOWN = ("clutter", "detection")
RULES = (
    ("nis_mean", "spread"), ("innovation_mean", "missed"), ("innovation_long", "missed_long"),
    ("spread", "entropy"),
)  # fmt: skip
CHEAP = -0.5  # below alpha 8e-4 and gamma 1e-5 the costs of pairs are dearer than a lost target
GAIN = 1.0  # of a rule's features, which span about 2


@dataclass(frozen=True)
class Family:
    """Policies of one kind: numbers in ranges, and the policy they stand for."""

    name: str
    ranges: Mapping[str, tuple[float, float]]
    policy: Callable[[np.ndarray], Policy]
    starts: Sequence[np.ndarray]  # the first to be tried, which the front is never worse than on VALID
    env: Mapping[str, Any] = field(default_factory=dict)  # none for trackers


def env_of(reducer: str, *more: str) -> dict[str, Any]:
    """Arguments of an environment in which an action sets the thresholds of a reducer and more."""
    return {"reducer": reducer, "parameters": (*REDUCERS[reducer], *more), "features": "all"}


def constants(reducer: str, *more: str) -> Family:
    """Constant thresholds."""
    env = env_of(reducer, *more)
    name = f"{reducer}, constants" + f" and {', '.join(more)}" * bool(more)
    start = to_action(Thresholds(prune=1e-3), env["parameters"])
    ranges = dict.fromkeys(env["parameters"], (-1.0, 1.0))
    if reducer == "adaptive":
        ranges |= dict.fromkeys(REDUCERS[reducer], (CHEAP, 1.0))
    return Family(name, ranges, Constant, [start], env)


def schedule(reducer: str, tuned: Sequence[np.ndarray]) -> Family:
    """Actions by the clock; it begins with tuned constants (j,), as the next two do."""
    env = env_of(reducer, *ALL)
    j = len(env["parameters"])
    ranges = {f"{name}_{piece}": (-1.0, 1.0) for piece in range(PIECES) for name in env["parameters"]}
    starts = [np.tile(constant, PIECES) for constant in tuned]
    return Family(
        f"{reducer}, schedule", ranges, lambda x: Schedule(x.reshape(PIECES, j), EVERY), starts, env
    )


def table(reducer: str, tuned: Sequence[np.ndarray], train: str) -> Family:
    """Constants by what an engineer knows of the scenario, in cells that are cut where the instances are."""
    env = env_of(reducer, *ALL)
    j = len(env["parameters"])
    known = np.array([model_features(world(row).model)[:2] for row in instances(train).values()])
    shares = (np.arange(CELLS) + 0.5) / CELLS
    cells = np.array(list(product(*(np.quantile(column, shares) for column in known.T))))
    ranges = {f"{name}_{cell}": (-1.0, 1.0) for cell in range(len(cells)) for name in env["parameters"]}
    starts = [np.tile(constant, len(cells)) for constant in tuned]
    name = f"{reducer}, table on {' and '.join(KNOWN)}"
    return Family(name, ranges, lambda x: ByTable(KNOWN, cells, x.reshape(-1, j)), starts, env)


def rule(reducer: str, tuned: Sequence[np.ndarray], names: Sequence[str]) -> Family:
    """Actions linear in a few features."""
    env = env_of(reducer, *ALL)
    j = len(env["parameters"])
    ranges = {f"bias_{name}": (-1.0 - GAIN, 1.0 + GAIN) for name in env["parameters"]}
    ranges |= {f"gain_{name}_{feature}": (-GAIN, GAIN) for name in env["parameters"] for feature in names}
    starts = [np.concatenate((constant, np.zeros(j * len(names)))) for constant in tuned]
    name = f"{reducer}, rule on {' and '.join(names)}"
    return Family(name, ranges, lambda x: Rule(names, x[j:].reshape(j, -1), x[:j]), starts, env)


def in_log(ranges: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Ranges of the logarithms."""
    return {name: (float(np.log(low)), float(np.log(high))) for name, (low, high) in ranges.items()}


def adaptive_noise(method: str) -> Family:
    """The MHT whose process noise follows its innovations."""
    ranges = {"history": (1.0, 5.0), "prune_weight": (1e-6, 1e-2), "factor": (0.25, 16.0)}
    ranges |= {"high": (16.0, 64.0), "threshold": (1.0, 5.0)} if method == "switching" else {}
    ranges |= {"fading": (1.0, 1.5)} if method == "constant" else {"forgetting": (0.02, 0.5)}

    def policy(x: np.ndarray) -> Tracked:
        options = dict(zip(ranges, np.exp(x).tolist(), strict=True))
        options |= {"method": method, "components": DORTENZIO.components, "reducer": BEST[0]}
        options["history"] = round(options["history"])
        if "forgetting" in options:
            options["memory"] = 1 - options.pop("forgetting")
        return Tracked("adaptive-noise", options)

    name = "fading memory" if method == "constant" else method
    return Family(f"adaptive noise, {name}", in_log(ranges), policy, [np.log(_usual(ranges))])


def two_motions(tracker: str, motions: int = 2) -> Family:
    """A bank of motions that differ in their process noise."""
    ranges = {
        "prune_weight": (1e-5, 1e-2), "history": (1.0, 5.0), "low": (0.25, 1.0), "high": (1.0, 6.0),
        "leave": (0.01, 0.5),
    }  # fmt: skip

    def policy(x: np.ndarray) -> Tracked:
        prune, history, low, high, leave = np.exp(x).tolist()
        factors = tuple(np.geomspace(low, high, motions).tolist())
        options = {"prune_weight": prune, "reduction": f"{BEST[0]}:scans={round(history)}"}
        options |= {"components": DORTENZIO.components}
        return Tracked(tracker, options, factors, 1 - leave)

    start = np.log([1e-3, 2, 0.5, 2.0, 0.1])  # a quarter of the process noise, and four times
    return Family(f"{motions} motions, {tracker}", in_log(ranges), policy, [start])


def alone() -> list[Family]:
    """Those that begin with what is usual."""
    return [
        *(adaptive_noise(method) for method in METHODS),
        two_motions("imm-mht"), two_motions("mmg"), two_motions("mmae-mht", 3),
        *(constants(reducer) for reducer in REDUCERS),
        *(constants(reducer, NOISE) for reducer in REDUCERS),
        constants("n-scan", NOISE, COASTING), constants("n-scan", NOISE, FADING),
    ]  # fmt: skip


def beyond(reducer: str, tuned: Sequence[np.ndarray], train: str) -> list[Family]:
    """Those that begin with tuned constants (j,) of all that a reducer's policies set; tables are cut by the
    instances of TRAIN."""
    rules = (rule(reducer, tuned, names) for names in RULES)
    return [*rules, table(reducer, tuned, train), schedule(reducer, tuned)]


def _usual(ranges: Mapping[str, tuple[float, float]]) -> list[float]:
    """What a search begins with: tuned thresholds, the noise of the filter model, the middle of the rest."""
    known = {"history": 2.0, "prune_weight": 1e-3, "factor": 1.0}
    return [known.get(name, float(np.sqrt(low * high))) for name, (low, high) in ranges.items()]
