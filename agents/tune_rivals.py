"""Tune the fronts that a learned policy has to beat: `python agents/tune_rivals.py`.

Every family is searched on TRAIN at several prices of work at once, for what a candidate did is known at any
price: a new candidate is the best so far at one of them, changed a little. Those that did best at a price
meet new episodes on VALID, and the best of them there is the point of the family's front. What is stopped
goes on by the same command, and by one with more candidates; numbers of candidates outlive changes of code,
for a front is played anew when it is compared: who wants them anew deletes the folder `tried`."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, NamedTuple

import joblib
import numpy as np
import typer
from batches import Batch, Outcome
from competitors import Rival, write_fronts
from judge import seeds_of
from rivals import ALL, BEST, Family, alone, beyond, constants
from tracked import Tracked, scans_of

from gmr_gym.tuning.instances import instances

PRICES = np.geomspace(1e-5, 10**-1.5, 8)  # of a unit of work, two to a decade
FIRST, AT_RANDOM = 5, 0.1  # so many candidates, and that share of the others, are drawn anywhere
STEP = 0.15  # of a range, by which a number is changed
FINALISTS = 3  # of a price, on VALID
ANY = "the best family at each price"  # on VALID


class Tried(NamedTuple):
    """A candidate, and its means over the episodes of TRAIN or VALID."""

    numbers: tuple[float, ...]
    reward: float  # at the price 0
    work: float  # summed over an episode
    lost: float

    def value(self, price: float) -> float:
        """Reward of an episode at a price."""
        return self.reward - price * self.work


@dataclass(frozen=True)
class Episodes:
    """Episodes of a table, on which policies and trackers are tried."""

    table: str
    runs: int
    tracked_runs: int  # of trackers, which are slower
    seed: int

    @cached_property
    def batch(self) -> Batch:
        """Those of policies."""
        return Batch(self.table, self.runs, self.seed)

    def outcome(self, family: Family, numbers: np.ndarray) -> Outcome:
        """What a candidate did."""
        policy = family.policy(numbers)
        if isinstance(policy, Tracked):
            return tracked(policy, self.batch.scenarios, self.tracked_runs, self.seed)
        return self.batch.played(policy, family.env["reducer"], family.env["parameters"])


def tracked(policy: Tracked, scenarios: list, runs: int, seed: int) -> Outcome:
    """What a tracker did in the first episodes of every instance."""
    rows = []
    for place, scenario in enumerate(scenarios):
        for scans, lost in scans_of(policy, scenario, seeds_of(seed, place, runs), 0.0):
            reward, _, work, _, _ = np.array(scans).T
            rows.append((reward.sum(), work.sum(), lost))
    return Outcome(*np.array(rows, float).T)


def tried(family: Family, numbers: np.ndarray, episodes: Episodes) -> Tried:
    """A candidate after its episodes."""
    found = episodes.outcome(family, numbers)
    return Tried(tuple(numbers.tolist()), *(float(part.mean()) for part in found))


def kept(file: Path, count: int, next_one: Callable[[list[Tried]], Tried]) -> list[Tried]:
    """So many candidates, one a line of a file; those that it holds are not tried again."""
    found = [Tried(tuple(row[0]), *row[1:]) for row in map(json.loads, _whole_lines(file))]
    with file.open("a", encoding="utf-8") as stream:
        while len(found) < count:
            found.append(next_one(found))
            stream.write(json.dumps(found[-1]) + "\n")
            stream.flush()
    return found[:count]


def proposed(family: Family, found: list[Tried], seed: int) -> np.ndarray:
    """The numbers of the next candidate: the first are the starts and random ones, most of the others one of
    the best so far, with some of its numbers changed."""
    rng = np.random.default_rng((seed, len(found)))
    low, high = np.array(list(family.ranges.values())).T
    if len(found) < len(family.starts):
        return np.clip(family.starts[len(found)], low, high)
    if len(found) < FIRST or rng.random() < AT_RANDOM:
        return rng.uniform(low, high)
    price = rng.choice(PRICES)
    best = max(found, key=lambda candidate: candidate.value(price))
    changed = rng.random(len(low)) < max(0.5, 1 / len(low))
    changed[rng.integers(len(low))] = True
    return np.clip(best.numbers + changed * STEP * (high - low) * rng.normal(size=len(low)), low, high)


def finalists(found: list[Tried], starts: int) -> list[np.ndarray]:
    """The numbers of those that did best at some price, and of the starts."""
    best = {candidate.numbers for candidate in found[:starts]} | {
        candidate.numbers
        for price in PRICES
        for candidate in sorted(found, key=lambda one: one.value(price), reverse=True)[:FINALISTS]
    }
    return [np.array(numbers) for numbers in sorted(best)]


def front_of(
    family: Family, train: Episodes, valid: Episodes, candidates: int, folder: Path
) -> list[tuple[float, Tried]]:
    """The best of a family on VALID at each price."""
    folder.mkdir(parents=True, exist_ok=True)
    stem = stem_of(family, train, valid)

    def next_one(found: list[Tried]) -> Tried:
        return tried(family, proposed(family, found, train.seed), train)

    found = kept(folder / f"{stem}.train", candidates, next_one)
    last = finalists(found, len(family.starts))
    scored = kept(folder / f"{stem}.valid", len(last), lambda done: tried(family, last[len(done)], valid))
    return [(price, max(scored, key=lambda one: one.value(price))) for price in PRICES.tolist()]


def stem_of(family: Family, train: Episodes, valid: Episodes) -> str:
    """Name of the files of a search, which those of another question do not have."""
    asked = (
        family.name, dict(family.ranges), list(family.starts), dict(family.env),
        *((e.runs, e.tracked_runs, e.seed, instances(e.table)) for e in (train, valid)),
    )  # fmt: skip
    return f"{family.name.replace(' ', '-').replace(',', '')}-{joblib.hash(asked)[:12]}"


def _whole_lines(file: Path) -> list[str]:
    """Lines of a file; the last is cut off there where it is not whole."""
    if not file.exists():
        return []
    text = file.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    if whole != text:
        file.write_text(whole, encoding="utf-8")
    return whole.splitlines()


def main(
    candidates: Annotated[int, typer.Option(help="of a family of policies", min=1)] = 60,
    tracked_candidates: Annotated[int, typer.Option(help="of a family of trackers", min=1)] = 20,
    runs: Annotated[int, typer.Option(help="episodes of every instance of TRAIN", min=1)] = 2,
    valid_runs: Annotated[int, typer.Option(help="episodes of every instance of VALID", min=1)] = 20,
    seed: Annotated[int, typer.Option(min=0)] = 0,
    train: Annotated[str, typer.Option(help="table of instances")] = "wide-train",
    valid: Annotated[str, typer.Option(help="table of instances on which to choose")] = "wide-valid",
    out: Annotated[Path, typer.Option(help="a stopped search goes on there")] = Path("results/agents/rivals"),
) -> None:
    """Searches family by family, and writes the front of each to static.json."""
    learning, held_out = (
        Episodes(train, runs, 1, seed),
        Episodes(valid, valid_runs, max(1, valid_runs // 2), seed),
    )
    fronts: dict[str, list[Rival]] = {}
    best: dict[float, tuple[float, Rival]] = {}  # of all families

    def tuned(family: Family) -> list[np.ndarray]:
        """The different points of a family's front, which is written."""
        count = candidates if family.env else tracked_candidates
        points = front_of(family, learning, held_out, count, out / "tried")
        fronts[family.name] = [
            Rival(price, family.policy(np.array(one.numbers)), dict(family.env)) for price, one in points
        ]
        for (price, one), rival in zip(points, fronts[family.name], strict=True):
            best[price] = max(
                best.get(price, (-np.inf, rival)), (one.value(price), rival), key=lambda b: b[0]
            )
        write_fronts(out / "static.json", fronts | {ANY: [rival for _, rival in best.values()]})
        lost = ", ".join(f"{100 * one.lost:.1f} at {price:.1e}" for price, one in points)
        print(f"{family.name}: lost on {valid} in %, by price, {lost}", flush=True)
        return [np.array(numbers) for numbers in sorted({one.numbers for _, one in points})]

    for reducer in BEST:
        for family in beyond(reducer, tuned(constants(reducer, *ALL)), train):
            tuned(family)
    for family in alone():
        tuned(family)


if __name__ == "__main__":
    typer.run(main)
