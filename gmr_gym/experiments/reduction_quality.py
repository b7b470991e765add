"""What reductions lose of a mixture, and the time they take: random mixtures and trackers' posteriors."""

from collections.abc import Callable, Mapping, Sequence
from time import thread_time
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.envs.lookup import scenario_of
from gmr_gym.envs.registry import TRACKING
from gmr_gym.evaluation.mixture_problems import MixtureProblem
from gmr_gym.evaluation.posteriors import posteriors
from gmr_gym.evaluation.reduction_runs import ReductionRuns
from gmr_gym.evaluation.summary import CONFIDENCE, Estimate, bootstrap_mean
from gmr_gym.experiments.evidence import Rows
from gmr_gym.experiments.screen import progress
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.registry import reducer
from gmr_gym.simulation.multi_target import MultiTargetScenario

MEASURES = ("ise", "nise", "divergence", "reverse_divergence")
RANDOM, EVERY = "random mixtures, 10 to 5", "posteriors of all environments, to 10"
# whose posteriors are reduced: those of other environments of many targets are of the same kind as the last
POSED = (*TRACKING, "gmr_gym/UnknownClutter-v0")
TRIED = 20  # mixtures that a reduction is tried on, the first
LONGEST = 1.0  # s, processor time of a call: what takes longer is left out


class Problem(NamedTuple):
    """So many mixtures to be reduced to so many components."""

    mixtures: MixtureProblem
    number: int
    components: int

    def first(self, seed: int) -> list[Mixture]:
        """Those that reductions are tried on."""
        runs = range(min(TRIED, self.number))
        return [self.mixtures.draw(np.random.SeedSequence(seed, spawn_key=(i,))) for i in runs]


class Trial(NamedTuple):
    """Processor times of a reduction for mixtures of a problem, s, and why it is left out, if it is."""

    times: tuple[float, ...]
    reason: str = ""

    @property
    def seconds(self) -> float:
        """The median."""
        return float(np.median(self.times)) if self.times else np.nan


def problems(count: int, seed: int) -> dict[str, Problem]:
    """Crouse's random mixtures, as many as in the paper, and `count` posteriors of every environment in
    POSED."""
    found = {RANDOM: Problem(MixtureProblem(samples=1000), 500, 5)}
    for env_id in POSED:
        scenario = scenario_of(env_id, {})
        # components that it keeps; of many targets as many as by default
        tracker = tracker_with(scenario, **({} if _many(scenario) else {"components": 20}))
        recorded = posteriors(scenario, tracker, count, seed, more_than=10, most=150)
        found[of_environment(env_id)] = Problem(MixtureProblem(recorded=tuple(recorded)), count, 10)
    return found


def of_environment(env_id: str) -> str:
    """The name of the problem of an environment's posteriors."""
    return f"posteriors of {env_id.rpartition('/')[2]}, to 10"


def tracker_with(scenario: Any, **parameters: Any) -> Any:
    """The tracker whose reduction is compared: an MHT, MMG where there are several motion models, and a
    GM-PHD filter of many targets."""
    if _many(scenario):
        name = "gm-phd"
    else:
        name = "mht" if len(scenario.model.motions) == 1 else "mmg"
    return make_tracker(name, scenario.model, **parameters)


def _many(scenario: Any) -> bool:
    return isinstance(scenario, MultiTargetScenario)


def trials(names: Sequence[str], asked: Mapping[str, Problem], seed: int) -> dict[str, dict[str, Trial]]:
    """Tries every reduction on the first mixtures of every problem."""
    found: dict[str, dict[str, Trial]] = {}
    with progress("reductions tried") as report:
        for i, (problem, each) in enumerate(asked.items()):
            mixtures = each.first(seed)
            found[problem] = {name: trial(reducer(name, each.components), mixtures) for name in names}
            report(i + 1, len(asked))
    return found


def trial(reduce: Callable[[Mixture], Reduced], mixtures: Sequence[Mixture]) -> Trial:
    """Calls one after another. A reduction is left out that takes longer than LONGEST, or refuses a
    mixture."""
    times: list[float] = []
    try:
        reduce(mixtures[0])  # compiles
        for p in mixtures:
            begun = thread_time()
            reduce(p)
            times.append(thread_time() - begun)
            if times[-1] > LONGEST:
                return Trial((times[-1],), f"{times[-1]:.3g} s for a mixture of {len(p.w)} components")
    except ValueError as error:
        return Trial((), str(error))
    return Trial(tuple(times))


def pooled(
    runs: Mapping[str, Mapping[str, ReductionRuns]], tried: Mapping[str, Mapping[str, Trial]]
) -> tuple[dict[str, ReductionRuns], dict[str, Trial]]:
    """The runs and trials on all posteriors together, of what is left out of none."""
    where = [problem for problem in runs if problem != RANDOM]
    names = [name for name in runs[where[0]] if all(name in runs[problem] for problem in where)]
    together = {
        name: ReductionRuns(
            *map(np.concatenate, zip(*(runs[problem][name] for problem in where), strict=True))
        )
        for name in names
    }
    times = {name: Trial(sum((tried[problem][name].times for problem in where), ())) for name in names}
    return together, times


def quality_rows(runs: Mapping[str, ReductionRuns], tried: Mapping[str, Trial]) -> Rows:
    """Means and medians over mixtures, and the median time of a call, the quickest first. A call among others
    of its kind is timed, as in tracking: alone, it waits for memory."""
    rows: Rows = {}
    for name, found in runs.items():
        values = {measure: getattr(found, measure)[:, 0] for measure in MEASURES}
        rows[name] = {measure: bootstrap_mean(value) for measure, value in values.items()}
        rows[name] |= {f"{measure}_median": median(value) for measure, value in values.items()}
        rows[name]["time_per_reduction"] = Estimate(tried[name].seconds)
    return dict(sorted(rows.items(), key=lambda row: row[1]["time_per_reduction"].value))


def median(values: np.ndarray) -> Estimate:
    """Median with its 95 % interval by order statistics, whatever the distribution; without one for fewer
    than six values.

    Examples
    --------
    >>> import numpy as np
    >>> [round(number) for number in median(np.arange(1.0, 102.0))]
    [51, 41, 61]
    """
    from scipy.stats import binom

    ordered, rank = np.sort(values), int(binom.ppf((1 - CONFIDENCE) / 2, len(values), 0.5))
    value = float(np.median(values))
    return Estimate(value, float(ordered[rank - 1]), float(ordered[-rank])) if rank else Estimate(value)
