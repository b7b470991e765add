"""Archives of arrays as targets, policies and blocks of runs: what was saved, and the same spoilt."""

import io
import itertools
from typing import NamedTuple

import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import Rng, decades
from fuzzing.stored import folder, stored, with_bytes_wrong
from gmr_gym.evaluation import blocks
from gmr_gym.tuning import network
from gmr_gym.tuning.features import FEATURES
from gmr_gym.tuning.thresholds import Thresholds

DIGEST = "0" * 32


def archive_targets() -> list[Target]:
    """Every reader of arrays."""
    policies = Target("file/network", _draw_network, _read_network, _check_network, _spoil_network, share=0.2)
    runs = Target("file/blocks", _draw_block, _read_block, _check_block, _spoil_block, share=0.2)
    return [policies, with_bytes_wrong(policies, _sane_network), runs, with_bytes_wrong(runs, _sane_block)]


# ---- policies ----


def _draw_network(rng: Rng) -> tuple:
    names = tuple(rng.permutation(Thresholds._fields).tolist()[: rng.integers(1, 5)])
    sizes = [len(FEATURES), *rng.integers(1, 9, rng.integers(0, 3)).tolist(), len(names)]
    layers = [
        (rng.standard_normal((out, width)) * decades(rng, -8, 8), rng.standard_normal(out))
        for width, out in itertools.pairwise(sizes)
    ]
    made = network.Network(
        FEATURES, names, rng.standard_normal(len(FEATURES)), decades(rng, -3, 3, len(FEATURES)),
        float(decades(rng, -1, 3)), str(rng.choice(network.ACTIVATIONS)), bool(rng.integers(2)),
        tuple(W for W, _ in layers), tuple(b for _, b in layers),
    )  # fmt: skip
    network.save(folder() / "policy.npz", made)
    return (folder() / "policy.npz").read_bytes(), made


def _read_network(content: bytes, made):
    read = network.load(stored(content, "read.npz"), FEATURES, Thresholds._fields)
    if made is None:
        _check_network((content, read), read)  # what is taken must at least work
        return None
    return read


def _spoil_network(rng: Rng, arguments: tuple) -> Spoilt:
    content, made = arguments
    fields = {"format": network.FORMAT, **made._asdict()}
    del fields["weights"], fields["biases"]
    for i, (W, b) in enumerate(zip(made.weights, made.biases, strict=True)):
        fields |= {f"weights_{i}": W, f"biases_{i}": b}
    name = list(fields)[rng.integers(len(fields))]
    value = np.asarray(fields[name])
    kind = rng.integers(4)
    if kind == 0:
        del fields[name]
    elif kind == 1:
        fields[name] = np.full(value.shape, np.nan)
    elif kind == 2:
        fields[name] = value[None]
    else:
        fields[name] = np.array([b"object", None], object)
    stream = io.BytesIO()
    np.savez(stream, **fields)
    content = stream.getvalue() if rng.random() < 0.7 else content[: rng.integers(len(content))]
    return Spoilt(
        (content, None),
        ("read.npz",),
        f"a policy with {name} {('gone', 'nan', 'deeper', 'objects')[kind]}, or cut",
    )


def _check_network(arguments: tuple, result) -> None:
    _, made = arguments
    if result is not made:
        checks.same("value", "what was saved", tuple(made), tuple(result))
    acted = result(np.zeros((3, len(FEATURES))))
    checks.finite("actions", acted)
    if (np.abs(acted) > 1).any():
        raise Finding("value", f"actions {acted.tolist()}")


def _sane_network(arguments: tuple, result) -> None:
    _check_network((arguments[0], result), result)


# ---- blocks of runs ----


class Kept(NamedTuple):
    """A block of a kind of its own."""

    truth: np.ndarray
    x: np.ndarray
    P: np.ndarray
    off_target: np.ndarray
    seconds: np.ndarray


def _draw_block(rng: Rng) -> tuple:
    runs, scans, d = int(rng.integers(1, 4)), int(rng.integers(1, 5)), int(rng.integers(1, 4))
    x = rng.standard_normal((2, runs, scans, d))
    P = np.broadcast_to(np.eye(d), (runs, scans, d, d)).copy()
    block = Kept(x[0], x[1], P, rng.random((runs, scans)) < 0.5, rng.random((runs, scans)))
    file = blocks.named(folder() / "written", DIGEST, 0, runs)
    blocks.save(file, block)
    return file.read_bytes(), block, runs


def _read_block(content: bytes, block, runs: int):
    read = blocks.load(stored(content, f"{DIGEST}-0-{runs}.npz"), Kept)
    return read


def _spoil_block(rng: Rng, arguments: tuple) -> Spoilt:
    content, block, runs = arguments
    kind = rng.integers(3)
    if kind == 0:
        return Spoilt((content, block, runs + 1), (DIGEST,), "a block of other runs")
    if kind == 1:
        return Spoilt((content[: rng.integers(len(content))], block, runs), (DIGEST,), "a block cut off")
    field = ("truth", "x", "P", "seconds")[rng.integers(4)]
    broken = block._replace(**{field: getattr(block, field)[..., None]})
    file = blocks.named(folder() / "written", DIGEST, 0, runs)
    blocks.save(file, broken)
    return Spoilt((file.read_bytes(), block, runs), (DIGEST,), f"a block whose {field} has another shape")


def _check_block(arguments: tuple, result) -> None:
    _, block, _ = arguments
    checks.same("value", "what was saved", tuple(block), tuple(result))


def _sane_block(arguments: tuple, result) -> None:
    _, block, _ = arguments
    changed = [
        name for name, a, b in zip(Kept._fields, block, result, strict=True) if not np.array_equal(a, b)
    ]
    if changed:
        raise Finding("value", f"other {', '.join(changed)} than were saved")
