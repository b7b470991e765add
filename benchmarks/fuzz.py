"""Hostile input to every public door of the package, each call watched:
`python benchmarks/fuzz.py [--calls N] [--seed S] [--target NAME] [--case K] [--jobs J] [--out FILE]`
prints what came of it by target, and leaves with 1 if anything did that should not."""

import argparse
import json
import sys
from pathlib import Path
from time import monotonic

import numpy as np
from fuzzing.cases import FINE, OUTCOMES, Target, drawn, judged
from fuzzing.reductions import own_target
from fuzzing.registry import every_target
from fuzzing.runner import CHUNK, Chunk, Found, run
from threadpoolctl import threadpool_limits


def main() -> int:
    options = _options()
    targets = [own_target(name) for name in options.reduction] or every_target()
    if options.list:
        print(*(f"{target.name}  {target.share:g}" for target in targets), sep="\n")
        return 0
    if options.target:
        targets = [target for target in targets if target.name.startswith(tuple(options.target))]
    if not targets:
        raise SystemExit(f"no target is called so: {', '.join(options.target)}; --list names them")
    if options.case is not None:
        return _one(min(targets, key=lambda target: len(target.name)), options)
    started = monotonic()
    chunks = shared_out(targets, options.calls, np.random.default_rng(options.seed))
    with threadpool_limits(1):
        counts, findings, given_up = run(
            targets, chunks, options.seed, options.seconds, options.jobs, options.memory,
            Progress(sum(chunk.stop - chunk.first for chunk in chunks)),
        )  # fmt: skip
    taken = monotonic() - started
    print(table(targets, counts))
    print(f"\n{counts.sum()} calls in {taken:.0f} s, seed {options.seed}")
    for name in given_up:
        print(f"{name}: given up after too many hangs or crashes")
    findings = smallest(findings)
    for found in findings:
        print(f"\n{line(found, options.seed)}\n  {found.outcome}: {found.message}")
    if options.out:
        options.out.write_text(json.dumps(record(targets, counts, findings, options, taken), indent=1) + "\n")
    return int(bool(findings))


def shared_out(targets: list[Target], calls: int, rng: np.random.Generator) -> list[Chunk]:
    """Cases of every target by its share, none where that is too small, in chunks that are mixed."""
    whole = sum(target.share for target in targets)
    chunks = []
    for i, target in enumerate(targets):
        cases = round(calls * target.share / whole)
        chunks += [Chunk(i, at, min(at + CHUNK, cases)) for at in range(0, cases, CHUNK)]
    return [chunks[i] for i in rng.permutation(len(chunks))]


def smallest(findings: list[Found]) -> list[Found]:
    """Of each kind the one with the smallest input."""
    best: dict[tuple, Found] = {}
    for found in findings:
        kind = found.target, found.legal, found.outcome
        best[kind] = min(best.get(kind, found), found, key=lambda found: found.size)
    return list(best.values())


def table(targets: list[Target], counts: np.ndarray) -> str:
    """What came of the cases, a row each target, a column each outcome there was."""
    seen = [i for i, name in enumerate(OUTCOMES) if name in FINE or counts[:, :, i].any()]
    rows = [["target", "legal", "illegal", *(OUTCOMES[i] for i in seen)]]
    for target, (illegal, legal) in zip(targets, counts, strict=True):
        each = [str((illegal + legal)[i] or "") for i in seen]
        rows.append([target.name, str(legal.sum()), str(illegal.sum()), *each])
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(w) if not i else cell.rjust(w)
            for i, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def line(found: Found, seed: int) -> str:
    """The command that runs the case alone."""
    own = found.target.removeprefix("reduction/")
    what = f"--reduction {own}" if ":" in own else f"--target {found.target}"
    return f"python benchmarks/fuzz.py --seed {seed} {what} --case {found.case}"


def record(targets, counts, findings, options, taken) -> dict:
    """All of it, for a file."""
    return {
        "seed": options.seed,
        "calls": int(counts.sum()),
        "seconds": taken,
        "targets": {
            target.name: {
                kind: {name: int(n) for name, n in zip(OUTCOMES, row, strict=True) if n}
                for kind, row in zip(("illegal", "legal"), each, strict=True)
            }
            for target, each in zip(targets, counts, strict=True)
        },
        "findings": [{**found._asdict(), "reproduce": line(found, options.seed)} for found in findings],
    }


class Progress:
    """How far it is, now and then, and what is found of every kind first, on the error stream."""

    def __init__(self, whole: int):
        self.whole, self.started, self.last = whole, monotonic(), 0.0
        self.every, self.end = (1.0, "\r") if sys.stderr.isatty() else (30.0, "\n")
        self.kinds: set[tuple] = set()
        self.read = 0  # findings looked at

    def __call__(self, done: int, findings: list[Found]) -> None:
        for found in findings[self.read :]:
            kind = found.target, found.legal, found.outcome
            if kind not in self.kinds:
                print(f"{found.outcome}: {found.target} {found.case}: {found.message[:100]}", file=sys.stderr)
            self.kinds.add(kind)
        self.read, now = len(findings), monotonic()
        if now - self.last >= self.every:
            self.last = now
            rate = done / max(now - self.started, 1e-9)
            said = f"{done}/{self.whole} calls, {rate:.0f}/s, {len(self.kinds)} kinds of findings"
            print(said, end=self.end, file=sys.stderr, flush=True)


def _one(target: Target, options: argparse.Namespace) -> int:
    """One case: its input, then what comes of it, here or in a process that is watched."""
    np.set_printoptions(precision=17, threshold=10_000, suppress=False)
    arguments, spoilt = drawn(target, options.seed, options.case)
    print(f"{target.name}, {'legal' if spoilt is None else spoilt.what}:", *arguments, sep="\n", flush=True)
    if options.here:
        outcome = judged(target, options.seed, options.case)
        print(f"\n{outcome.outcome}: {outcome.message}")
        return int(outcome.outcome not in FINE)
    chunk = Chunk(0, options.case, options.case + 1)
    counts, findings, _ = run([target], [chunk], options.seed, options.seconds, 1, options.memory)
    for found in findings:
        print(f"\n{found.outcome}: {found.message}")
    if not findings:
        print("\n" + OUTCOMES[int(counts.sum(axis=(0, 1)).argmax())])
    return int(bool(findings))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Hostile input to every public door, each call watched.")
    parser.add_argument("--calls", type=int, default=1_000_000, help="in all, shared among the targets")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--target", metavar="NAME", action="append", help="only targets whose names begin so, or with others"
    )
    parser.add_argument("--case", type=int, metavar="K", help="only case K of the target, and show its input")
    parser.add_argument("--here", action="store_true", help="run that case in this process, for a debugger")
    parser.add_argument(
        "--reduction", metavar="MODULE:FUNCTION", action="append", default=[],
        help="only this reduction of your own, and others",
    )  # fmt: skip
    parser.add_argument("--seconds", type=float, default=10.0, help="that a call may take")
    parser.add_argument("--jobs", type=int, default=1, help="processes that work")
    parser.add_argument("--memory", type=float, default=8.0, help="GB of address space of each, 0 for any")
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write all of it to this file, as JSON")
    parser.add_argument("--list", action="store_true", help="name the targets and their shares, and run none")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
