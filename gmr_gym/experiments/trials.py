"""Trials of parameters, by Optuna: all on the same runs, given up after a block of runs where poor, and
kept in a file from which the same call goes on.

Trials are made in batches of a fixed size, smaller where the budget ends, each before any of it is run, with
random numbers that depend on the seed and the trial's number alone. So they are the same on any number of
workers, and whether or not the call was stopped in between.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend, JournalFileOpenLock
from optuna.trial import FrozenTrial, Trial, TrialState

from gmr_gym.evaluation import workers
from gmr_gym.evaluation.montecarlo import BLOCK
from gmr_gym.experiments.search_space import Choices, Space

BATCH = 8  # trials made at once, after the first
NAME, ASKED, VALUES, ERROR = "tune", "asked", "values", "error"  # what is kept in the file under which name
ERRORS = 2.0  # standard errors that a trial must be worse by to be given up


class Problem(Protocol):
    """What parameters are tried on."""

    def check(self, parameters: Mapping[str, Any]) -> None:
        """Raises for parameters that cannot be."""

    def values(self, parameters: Mapping[str, Any], first: int, stop: int) -> np.ndarray:
        """The objective of runs first, ..., stop - 1, the smaller the better."""


class Plan(NamedTuple):
    """How much is tried."""

    budget: int  # runs, of all trials together
    runs: int  # runs of a trial that is not given up
    seed: int  # of the trials; the episodes are the problem's
    jobs: int = 1


class Tried(NamedTuple):
    """A trial."""

    number: int
    state: str  # complete, pruned, fail, running
    parameters: dict[str, Any]
    values: np.ndarray  # (runs done,)
    error: str

    @property
    def value(self) -> float:
        """Mean of the objective over the runs done."""
        return float(self.values.mean()) if len(self.values) else np.nan

    @property
    def cost(self) -> int:
        """What it took of the budget; one that failed took a block, so that all comes to an end."""
        return max(len(self.values), BLOCK) if self.state == "fail" else len(self.values)


class PairedPruner(optuna.pruners.BasePruner):
    """Gives a trial up that is worse than the best, run by run, by some standard errors."""

    def prune(self, study: optuna.Study, trial: FrozenTrial) -> bool:
        """Whether to give the trial up."""
        found, best = values_of(trial), best_values(study)
        if len(found) < 2 or not len(best):
            return False
        return is_worse(found - best[: len(found)])


def is_worse(difference: np.ndarray) -> bool:
    """Whether the mean of the differences (k,) is above 0 by `ERRORS` standard errors."""
    mean, error = difference.mean(), difference.std(ddof=1) / len(difference) ** 0.5
    return bool(mean > 0 and mean >= ERRORS * error)


def values_of(trial: FrozenTrial) -> np.ndarray:
    """The objective of the runs that a trial has done."""
    return np.array(trial.user_attrs.get(VALUES, []), float)


def best_values(study: optuna.Study) -> np.ndarray:
    """The objective of all runs of the best trial that is complete; none where there is none."""
    complete = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
    return (
        values_of(min(complete, key=lambda trial: (trial.value, trial.number))) if complete else np.empty(0)
    )


def check_plan(plan: Plan) -> None:
    """ValueError for a budget that is too small for two trials."""
    if plan.budget < 2 * plan.runs:
        raise ValueError(
            f"--budget {plan.budget} is too small: two trials of {plan.runs} runs each need {2 * plan.runs}; "
            "give more, or fewer --runs"
        )


def opened(file: Path, space: Space, default: Mapping[str, Any], asked: Mapping[str, Any]) -> optuna.Study:
    """The trials in a file, or none yet: the first is the default, where it is within the space. ValueError
    where the file has those of another call."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    file.parent.mkdir(parents=True, exist_ok=True)
    storage = JournalStorage(JournalFileBackend(str(file), JournalFileOpenLock(str(file))))
    study = optuna.create_study(storage=storage, study_name=NAME, pruner=PairedPruner(), load_if_exists=True)
    there = study.user_attrs.get(ASKED)
    if there is None:
        study.set_user_attr(ASKED, asked)
    elif there != asked:
        other = [
            f"{key} {there.get(key)}, asked {asked[key]}" for key in asked if there.get(key) != asked[key]
        ]
        raise ValueError(
            f"{file} has the trials of another call ({'; '.join(other)}); choose another folder with --out, "
            "or delete it"
        )
    if not study.get_trials(deepcopy=False) and begins_with(default, space):
        study.enqueue_trial({name: default[name] for name in space})
    return study


def begins_with(default: Mapping[str, Any], space: Space) -> bool:
    """Whether the first trial is the default: where that lies within the space."""
    return all(default[name] in space[name] for name in space)


def search(
    study: optuna.Study,
    space: Space,
    problem: Problem,
    plan: Plan,
    progress: Callable[[int, int], None] | None = None,
) -> list[Tried]:
    """Try parameters until the budget is used up: all trials, in order.

    Raises
    ------
    ValueError
        If no trial came to its end, with the last one's error.
    """
    start = 0
    while True:
        before = sum(trial.cost for trial in tried(study, space)[:start])
        size = min(BATCH if start else 1, (plan.budget - before) // plan.runs)
        if size < 1:
            break
        made = (_made(study, space, number, plan.seed) for number in range(start, start + size))
        batch = [trial for trial in made if trial]
        for stop in [*range(BLOCK, plan.runs, BLOCK), plan.runs]:
            batch = _run(study, space, batch, problem, stop, plan.jobs)
            if stop < plan.runs:
                batch = [trial for trial in batch if not _given_up(study, trial, stop)]
            if progress:
                progress(min(sum(trial.cost for trial in tried(study, space)), plan.budget), plan.budget)
        for trial in batch:  # not before: those of a batch are compared with the ones before it
            study.tell(trial, float(np.mean(trial.user_attrs[VALUES])))
        start += size
    found = tried(study, space)
    if not any(trial.state == "complete" for trial in found):
        raise ValueError(f"none of {len(found)} trials came to its end; the last: {found[-1].error}")
    return found


def tried(study: optuna.Study, space: Space) -> list[Tried]:
    """All trials so far."""
    return [
        Tried(
            trial.number, trial.state.name.lower(), _parameters(trial.params, space), values_of(trial),
            trial.user_attrs.get(ERROR, ""),
        )
        for trial in study.get_trials(deepcopy=False)
    ]  # fmt: skip


def best(trials: Sequence[Tried]) -> Tried:
    """The best trial of those that are complete; of equal ones the first."""
    complete = [trial for trial in trials if trial.state == "complete"]
    return min(complete, key=lambda trial: (trial.value, trial.number))


def _made(study: optuna.Study, space: Space, number: int, seed: int) -> "Trial | None":
    """The trial of this number, made now if it is not there yet; None if it is over."""
    there = study.get_trials(deepcopy=False)
    if number < len(there) and there[number].state.is_finished():
        return None
    (own,) = np.random.SeedSequence(seed, spawn_key=(number,)).generate_state(1).tolist()
    study.sampler = optuna.samplers.TPESampler(seed=own, multivariate=True, constant_liar=True)
    begun = number < len(there) and there[number].state == TrialState.RUNNING
    trial = Trial(study, there[number]._trial_id) if begun else study.ask()
    for name, each in space.items():  # those that it has already stay
        if isinstance(each, Choices):
            trial.suggest_categorical(name, each.values)
        elif each.whole:
            trial.suggest_int(name, int(each.low), int(each.high), log=each.log)
        else:
            trial.suggest_float(name, each.low, each.high, log=each.log)
    return trial


def _parameters(params: Mapping[str, Any], space: Space) -> dict[str, Any]:
    return {name: space[name].rounded(params[name]) for name in space if name in params}


def _run(
    study: optuna.Study, space: Space, trials: Sequence[Trial], problem: Problem, stop: int, jobs: int
) -> list[Trial]:
    """Runs trials up to a number of runs, where they have not done them already; gives back those that did
    not fail."""
    failed, calls = {}, {}
    for trial in trials:
        done, parameters = len(trial.user_attrs.get(VALUES, [])), _parameters(trial.params, space)
        if done < stop:
            calls[trial.number] = _values, problem, parameters, done, stop
        if done == 0:
            failed[trial.number] = _error(problem.check, parameters)
    calls = {number: call for number, call in calls.items() if not failed.get(number)}
    known = {trial.number: trial for trial in trials}
    for number, (values, error) in workers.results(calls, jobs):
        failed[number], trial = error, known[number]
        if not error:
            trial.set_user_attr(VALUES, [*trial.user_attrs.get(VALUES, []), *values])
            trial.report(float(np.mean(trial.user_attrs[VALUES])), stop)
    for number, error in failed.items():
        if error:
            known[number].set_user_attr(ERROR, error)
            study.tell(number, state=TrialState.FAIL)
    return [trial for trial in trials if not failed.get(trial.number)]


def _given_up(study: optuna.Study, trial: Trial, stop: int) -> bool:
    """Whether the pruner gives a trial up after this number of runs; then it is over. One that was stopped
    later has been kept already."""
    worse = len(trial.user_attrs[VALUES]) == stop and trial.should_prune()
    if worse:
        study.tell(trial, state=TrialState.PRUNED)
    return worse


def _values(
    problem: Problem, parameters: Mapping[str, Any], first: int, stop: int
) -> tuple[list[float], str]:
    """The objective of runs, or why there is none: a trial that fails leaves the others alone."""
    found: list[float] = []
    error = _error(lambda: found.extend(problem.values(parameters, first, stop).tolist()))
    if not error and not np.isfinite(found).all():
        error = "the objective is not a finite number"
    return found, error


def _error(function: Callable[..., Any], *arguments: Any) -> str:
    try:
        function(*arguments)
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""
