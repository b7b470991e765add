"""Tune what a trained agent has to beat: `python agents/tune_static.py`.

The best constant thresholds, the best constants by what is known of the world, the best open-loop schedule
and the best of a family of hand rules, each searched for on TRAIN with as many environment steps as one agent
is trained with, and chosen on VALID among the few that did best. As with an agent, steps on VALID are not
counted."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import joblib
import numpy as np
import optuna
import typer
from competitors import write
from judge import ENV_ID, V0, Policy, code, played
from optuna.distributions import FloatDistribution
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import TrialState

from gmr_gym.literals import key_values
from gmr_gym.tuning.features import model_features
from gmr_gym.tuning.instances import instances, world
from gmr_gym.tuning.policies import ByTable, Constant, Rule, Schedule
from gmr_gym.tuning.thresholds import DORTENZIO, to_action

LOW = -0.5  # of an action: alpha 8e-4, gamma 1e-5; what lies below costs more than a lost target
PIECES, EVERY = 4, 15  # scans: the start, from the true state, differs most, and some episodes have 44
GAIN = 0.5  # of a rule's features, which span about 2
RULES = (("clutter", "detection"), ("kept", "over_1e-4"), ("spread", "entropy"), ("merge_cost", "size"))
CLUTTER, DETECTION = 3, 2  # cells of a table
ROUNDS = 4  # of a candidate, each an episode of every instance; the worse half stops earlier
FINALISTS = 10  # of a search, on VALID
STEPS = 983_040  # of environments, of one agent of v0


@dataclass(frozen=True)
class Search:
    """One family of policies: numbers in ranges, and the policy they stand for."""

    name: str
    ranges: Mapping[str, tuple[float, float]]
    policy: Callable[[np.ndarray], Policy]
    start: np.ndarray  # the first to be tried
    only: Sequence[str] = ()  # instances of TRAIN, all unless given


@dataclass(frozen=True)
class Tuner:
    """Searches in one environment, kept in a folder: what was stopped goes on as if it had not been."""

    folder: Path
    env: Mapping[str, Any]
    train: str
    valid: str
    valid_runs: int
    seed: int
    jobs: int

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """The thresholds that an action sets."""
        return gym.make(ENV_ID, **self.env).unwrapped.parameters

    @cached_property
    def storage(self) -> JournalStorage:
        """Where the searches are kept."""
        self.folder.mkdir(parents=True, exist_ok=True)
        return JournalStorage(JournalFileBackend(str(self.folder / "studies.log")))

    def finalists(self, search: Search, steps: int) -> list[np.ndarray]:
        """The numbers of the candidates that did best on TRAIN, after so many environment steps."""
        told = (self.env, instances(self.train), self.seed, search.ranges, search.start, search.only, code())
        study = optuna.create_study(
            study_name=f"{search.name} {joblib.hash(told)}", storage=self.storage, load_if_exists=True,
            direction="maximize", pruner=optuna.pruners.MedianPruner(),
        )  # fmt: skip
        for stale in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
            study.tell(stale.number, state=TrialState.FAIL)  # stopped half-way
        while True:
            tried = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE, TrialState.PRUNED))
            spent = sum(trial.user_attrs["steps"] for trial in tried)
            if spent >= steps:
                break
            if not tried:
                study.enqueue_trial(dict(zip(search.ranges, search.start.tolist(), strict=True)))
            # by how many were tried alone, so that a search that is taken up goes the same way
            study.sampler = _sampler(self.seed + len(tried))
            said = self._try(study, search)
            print(f"{search.name}: {spent + said[0]} of {steps} steps, reward {said[1]:.2f}", flush=True)
        whole = study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))
        best = sorted(whole, key=lambda trial: trial.value, reverse=True)[:FINALISTS]
        return [_numbers(trial, search) for trial in best]

    def best(self, policies: Sequence[Policy], only: Sequence[str] = ()) -> int:
        """The place of the policy with the most reward on VALID, or on some of its instances."""
        found = played(
            dict(enumerate(policies)), self.valid, self.valid_runs, self.seed,
            env=self.env, jobs=self.jobs, only=only, folder=self.folder / "valid",
        )  # fmt: skip
        return int(np.argmax([episodes.reward.mean() for episodes in found.values()]))

    def _try(self, study: optuna.Study, search: Search) -> tuple[int, float]:
        """The steps that the next candidate took, and its reward of an episode."""
        trial = study.ask({name: FloatDistribution(*ends) for name, ends in search.ranges.items()})
        rewards, steps, state = [], 0, TrialState.COMPLETE
        for i in range(ROUNDS):
            episodes = played(
                {"candidate": search.policy(_numbers(trial, search))}, self.train, 1, self.seed + i,
                env=self.env, jobs=self.jobs, only=search.only,
            )["candidate"]  # fmt: skip
            rewards.append(float(episodes.reward.mean()))
            steps += int(episodes.scans.sum())
            trial.report(float(np.mean(rewards)), i)
            if i < ROUNDS - 1 and trial.should_prune():
                state = TrialState.PRUNED
                break
        trial.set_user_attr("steps", steps)
        value = float(np.mean(rewards))
        study.tell(trial, value if state is TrialState.COMPLETE else None, state)
        return steps, value


def constant_search(start: np.ndarray, name: str = "constant", only: Sequence[str] = ()) -> Search:
    """Thresholds that stay."""
    ranges = {f"action_{i}": (LOW, 1.0) for i in range(len(start))}
    return Search(name, ranges, Constant, np.maximum(start, LOW), only)


def schedule_search(constant: np.ndarray) -> Search:
    """Thresholds by the clock; it begins with the constant (j,)."""
    ranges = {f"action_{piece}_{i}": (LOW, 1.0) for piece in range(PIECES) for i in range(len(constant))}
    start = np.tile(constant, PIECES)
    return Search("schedule", ranges, lambda x: Schedule(x.reshape(PIECES, -1), EVERY), start)


def rule_search(names: Sequence[str], constant: np.ndarray) -> Search:
    """Thresholds by a few features; it begins with the constant (j,)."""
    j = len(constant)
    ranges = {f"bias_{i}": (LOW - GAIN, 1.0 + GAIN) for i in range(j)}
    ranges |= {f"gain_{i}_{name}": (-GAIN, GAIN) for i in range(j) for name in names}
    start = np.concatenate((constant, np.zeros(j * len(names))))
    name = f"rule {' '.join(names)}"
    return Search(name, ranges, lambda x: Rule(names, x[j:].reshape(j, -1), x[:j]), start)


def table_of_constants(tuner: Tuner, steps: int, overall: np.ndarray) -> ByTable:
    """The best constant of every cell that holds an instance of TRAIN. The cells are cut where TRAIN is, and
    share the steps. The constant that is best overall is a candidate in all of them."""
    names, values = _known(tuner.train)
    held_out, held_out_values = _known(tuner.valid)
    c, d = (
        np.quantile(values[:, i], (np.arange(cells) + 0.5) / cells)
        for i, cells in enumerate((CLUTTER, DETECTION))
    )
    cells = np.unique([[x, y] for x in c for y in d], axis=0)
    cells = cells[np.unique(_nearest(values, cells))]
    inside, outside = _nearest(values, cells), _nearest(held_out_values, cells)
    actions = []
    for i in range(len(cells)):
        search = constant_search(overall, f"cell {i}", [str(name) for name in names[inside == i]])
        found = [*tuner.finalists(search, steps // len(cells)), overall]
        valid = [str(name) for name in held_out[outside == i]]
        # a cell that VALID does not reach keeps what TRAIN says
        actions.append(found[tuner.best([Constant(a) for a in found], valid) if valid else 0])
    return ByTable(("clutter", "detection"), cells, np.array(actions))


def tuned(tuner: Tuner, steps: int) -> dict[str, Policy]:
    """The best of each family, of which every one takes so many steps on TRAIN. What a search begins with is
    a candidate on VALID too, so that no family ends below the best constant there."""
    paper = to_action(DORTENZIO, tuner.parameters)
    constants = [*tuner.finalists(constant_search(paper), steps), paper]
    constant = constants[tuner.best([Constant(a) for a in constants])]
    schedule = schedule_search(constant)
    schedules = [schedule.policy(x) for x in [*tuner.finalists(schedule, steps), schedule.start]]
    rules: list[Policy] = []
    for search in (rule_search(names, constant) for names in RULES):
        rules += [search.policy(x) for x in [*tuner.finalists(search, steps // len(RULES)), search.start]]
    return {
        "best constant": Constant(constant),
        "table": table_of_constants(tuner, steps, constant),
        "best schedule": schedules[tuner.best(schedules)],
        "best rule": rules[tuner.best(rules)],
    }


def _sampler(seed: int) -> optuna.samplers.TPESampler:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", optuna.exceptions.ExperimentalWarning)
        return optuna.samplers.TPESampler(seed=seed, multivariate=True)


def _numbers(trial: Any, search: Search) -> np.ndarray:
    return np.array([trial.params[name] for name in search.ranges])


def _known(table: str) -> tuple[np.ndarray, np.ndarray]:
    """Names (n,) of the instances of a table, and their features "clutter" and "detection" (n, 2)."""
    rows = instances(table)
    return np.array(list(rows)), np.array([model_features(world(row).model)[:2] for row in rows.values()])


def _nearest(values: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """For each of values (n, i) the place of the nearest of cells (m, i)."""
    return ((values[:, None] - cells) ** 2).sum(axis=-1).argmin(axis=1)


def main(
    steps: Annotated[int, typer.Option(help="of environments, a family", min=1)] = STEPS,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    set_: Annotated[list[str], typer.Option("--set", help="key=value for the environment")] = [],  # noqa: B006
    valid: Annotated[str, typer.Option(help="table of instances on which to choose")] = "valid",
    valid_runs: Annotated[int, typer.Option(help="episodes of each of them", min=1)] = 40,
    jobs: Annotated[int, typer.Option(help="workers, -1 for all cores")] = -1,
    out: Annotated[Path, typer.Option(help="a stopped search goes on there")] = Path("results/agents/static"),
) -> None:
    """Searches family by family, and writes the best of each to static.json."""
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    env = V0 | key_values(set_)
    train = env.pop("instances", "train")
    print(
        f"every search ends with the candidate that reaches its share of {steps} steps a family", flush=True
    )
    found = tuned(Tuner(out, env, train, valid, valid_runs, seed, jobs), steps)
    write(out / "static.json", env, found)
    for name, policy in found.items():
        print(f"{name}: {policy}")


if __name__ == "__main__":
    typer.run(main)
