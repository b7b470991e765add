"""What a tracker is tuned for: a figure of every run, the smaller the better."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.envs.lookup import parsed
from gmr_gym.evaluation.metrics import cardinality_error
from gmr_gym.evaluation.montecarlo import run_block
from gmr_gym.evaluation.multi_target_summary import track_figures
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean, capped_error, not_lost, paired_share
from gmr_gym.filters.registry import make_tracker
from gmr_gym.simulation.multi_target import MultiTargetScenario


class Objective(NamedTuple):
    """A figure: its unit, and how runs come to it, (runs,)."""

    unit: str
    of: Callable[[Any, Any], np.ndarray]


def _work(scenario: Any, runs: Any) -> np.ndarray:
    return runs.components.mean(axis=1)


ONE_TARGET = {
    "loss": Objective("", lambda scenario, runs: (~not_lost(scenario, runs)).astype(float)),
    "error": Objective("m", capped_error),
    "work": Objective("components", _work),
}
MANY_TARGETS = {
    "gospa": Objective("m", lambda scenario, runs: runs.gospa.mean(axis=1)),
    "ospa": Objective("m", lambda scenario, runs: runs.ospa.mean(axis=1)),
    "trajectory-gospa": Objective(
        "m", lambda scenario, runs: track_figures(scenario, runs)["trajectory_gospa"]
    ),
    "cardinality": Objective(
        "targets", lambda scenario, runs: cardinality_error(runs.named, runs.targets).mean(axis=1)
    ),
    "work": Objective("components", _work),
}


def objectives_of(scenario: Any) -> dict[str, Objective]:
    """What trackers in a scenario can be tuned for; first what is usual."""
    return MANY_TARGETS if isinstance(scenario, MultiTargetScenario) else ONE_TARGET


METRIC = {  # what an objective is called in records
    "loss": "track_loss", "error": "error_capped", "work": "components", "gospa": "gospa", "ospa": "ospa",
    "trajectory-gospa": "trajectory_gospa", "cardinality": "cardinality_error",
}  # fmt: skip


def shown_with(scenario: Any) -> tuple[str, ...]:
    """Figures of runs that are shown beside the objective."""
    if isinstance(scenario, MultiTargetScenario):
        return "gospa", "cardinality_error", "components", "time_per_scan"
    return "track_loss", "error_common", "components", "time_per_scan"


def check_objective(name: str, scenario: Any) -> str:
    """The objective, or what is usual; ValueError for one that the scenario's runs do not have."""
    known = objectives_of(scenario)
    if name and name not in known:
        many = "many targets" if isinstance(scenario, MultiTargetScenario) else "one target"
        raise ValueError(f"--objective {name!r} is not there for {many}; choose from {', '.join(known)}")
    return name or next(iter(known))


class Tuned(NamedTuple):
    """What is tuned: a tracker in a scenario, for an objective and a price of work."""

    scenario: Any
    spec: str  # NAME:key=value,key=value
    objective: str
    price: float  # of a component kept, in units of the objective
    seed: int

    def check(self, parameters: Mapping[str, Any]) -> None:
        """Makes the tracker and runs it for a moment: workers then find it compiled."""
        run_block(self.scenario, self.tracker(parameters), self.seed, 0, 1, scans=3)

    def values(self, parameters: Mapping[str, Any], first: int, stop: int) -> np.ndarray:
        """The figure of runs first, ..., stop - 1, each on an episode of its own that is the same for all
        parameters."""
        return self.figure(run_block(self.scenario, self.tracker(parameters), self.seed, first, stop))

    def figure(self, runs: Any) -> np.ndarray:
        """The figure of each run."""
        found = objectives_of(self.scenario)[self.objective].of(self.scenario, runs)
        return found + self.price * _work(self.scenario, runs) if self.price else found

    @property
    def figure_name(self) -> str:
        """What the figure is called in records."""
        return "objective" if self.price else METRIC[self.objective]

    def tracker(self, parameters: Mapping[str, Any]) -> Any:
        """The tracker with these parameters."""
        name, fixed = parsed(self.spec)
        return make_tracker(name, self.scenario.model, **fixed, **parameters)


def problem_of(scenario: Any, spec: str, objective: str, price: float, seed: int) -> Tuned:
    """What is tuned; ValueError for a tracker that cannot be made as it is, and for a price that is none."""
    if not 0 <= price < np.inf:
        raise ValueError(f"--price must be finite and at least 0, got {price}")
    problem = Tuned(scenario, spec, objective, price, seed)
    problem.tracker({})
    return problem


def paired(objective: str, price: float, difference: np.ndarray) -> Estimate:
    """Mean of paired differences of an objective, run by run, with its 95 % interval."""
    return paired_share(difference) if objective == "loss" and not price else bootstrap_mean(difference)
