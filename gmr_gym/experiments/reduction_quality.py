"""What reductions lose of a mixture, and the time they take: random mixtures and trackers' posteriors."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.envs.lookup import scenario_of
from gmr_gym.envs.registry import READY
from gmr_gym.evaluation.mixture_problems import random_mixture
from gmr_gym.evaluation.posteriors import posteriors
from gmr_gym.evaluation.reduction_costs import Costs, Reducing, measured
from gmr_gym.evaluation.summary import CONFIDENCE, Estimate, bootstrap_mean
from gmr_gym.experiments.screen import progress
from gmr_gym.experiments.sweeps import Sweep, saying_what_is_kept
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.registry import reducer
from gmr_gym.simulation.multi_target import MultiTargetScenario

MEASURES = ("ise", "nise", "divergence", "reverse_divergence")
RANDOM, EVERY = "random mixtures, 10 to 5", "posteriors of all environments, to 10"
LONGEST = 0.1  # s, processor time: a reduction that takes more for the first mixture is left out
Rows = dict[str, dict[str, Estimate]]


class Problem(NamedTuple):
    """Mixtures to be reduced to so many components, and the points by which divergences are estimated."""

    mixtures: list[Mixture]
    components: int
    samples: int


def problems(count: int, seed: int) -> dict[str, Problem]:
    """Crouse's random mixtures, as many as in the paper, and `count` posteriors of every environment that
    needs no files."""
    found = {RANDOM: Problem([random_mixture(i) for i in range(500)], 5, 2000)}
    for env_id in READY:
        scenario = scenario_of(env_id, {})
        # components that it keeps; of many targets as many as by default
        tracker = tracker_with(scenario, **({} if _many(scenario) else {"components": 20}))
        found[of_environment(env_id)] = Problem(posteriors(scenario, tracker, count, seed, 10, 150), 10, 5000)
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


def costs_shown(
    names: Sequence[str], asked: Mapping[str, Problem], sweep: Sweep
) -> dict[str, dict[str, Costs]]:
    """What every reduction costs on every problem, under a bar; on Ctrl-C it says what is kept."""
    every = {
        (problem, name): Reducing(reducer(name, components), mixtures, samples, LONGEST)
        for problem, (mixtures, components, samples) in asked.items()
        for name in names
    }
    with saying_what_is_kept(sweep.blocks), progress("mixtures reduced") as report:
        found = measured(every, jobs=sweep.jobs, folder=sweep.blocks, progress=report)
    return {problem: {name: found[problem, name] for name in names} for problem in asked}


def pooled(costs: Mapping[str, Mapping[str, Costs]]) -> dict[str, Costs]:
    """The costs on all posteriors together."""
    parts = [found for problem, found in costs.items() if problem != RANDOM]
    return {
        name: Costs(*(np.concatenate(fields) for fields in zip(*(part[name] for part in parts), strict=True)))
        for name in parts[0]
    }


def quality_rows(costs: Mapping[str, Costs]) -> Rows:
    """Means and medians over mixtures, and the median time of a call, of every reduction that is not left
    out, the quickest first."""
    rows: Rows = {}
    for name, found in costs.items():
        if np.isfinite(found.ise).all():
            values = {measure: getattr(found, measure)[:, 0] for measure in MEASURES}
            means = {measure: bootstrap_mean(value) for measure, value in values.items()}
            medians = {f"{measure}_median": median(value) for measure, value in values.items()}
            rows[name] = means | medians | {"time_per_call": Estimate(float(np.median(found.seconds)))}
    return dict(sorted(rows.items(), key=lambda row: row[1]["time_per_call"].value))


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


def left_out(costs: Mapping[str, Costs]) -> dict[str, str]:
    """Reductions that are left out, each with the reason."""
    absent = {name: found.seconds[0, 0] for name, found in costs.items() if np.isnan(found.ise[0, 0])}
    return {
        name: "it refuses such mixtures" if np.isnan(seconds) else f"{1e3 * seconds:.3g} ms for one mixture"
        for name, seconds in absent.items()
    }
