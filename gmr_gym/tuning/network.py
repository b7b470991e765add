"""A small network from features to thresholds: a file of plain arrays, and its forward pass.

The file is read without trust: nothing is unpickled, and no framework is needed.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation import archive
from gmr_gym.kernels import kernel, leaf_kernel

FORMAT = "gmr_gym thresholds 1"
ACTIVATIONS = ("tanh", "relu")
MOST_LAYERS, MOST_UNITS = 8, 4096  # a file with more was not written here
MOST_SIGNAL = 1e300  # largest sum of a unit; a larger one might overflow


class Network(NamedTuple):
    """Layers with an activation between them, over features normalised to mean 0 and standard deviation 1."""

    features: tuple[str, ...]  # names of the inputs
    parameters: tuple[str, ...]  # names of the outputs, see `thresholds.from_action`
    mean: np.ndarray  # (k,)
    deviation: np.ndarray  # (k,), standard deviation, positive
    reach: float  # normalised features are clipped to +- this
    activation: str  # one of ACTIVATIONS
    squashed: bool  # whether the output is tanh of the last layer; else it is clipped to +- 1
    weights: tuple[np.ndarray, ...]  # (out, in) each
    biases: tuple[np.ndarray, ...]  # (out,) each

    def __call__(self, features: np.ndarray) -> np.ndarray:
        """The actions (..., j) in [-1, 1] for features (..., k)."""
        rows = np.array(features, float, ndmin=2)
        return forward(rows, *self.packed()).reshape(*np.shape(features)[:-1], -1)

    def packed(self) -> tuple[np.ndarray, np.ndarray]:
        """The arguments of `forward`.

        Returns
        -------
        layout : ndarray of int
            Whether units are tanh, whether the output is tanh, then the sizes of the layers.
        numbers : ndarray of float
            All numbers, in the order in which they are used.
        """
        layout = [self.activation == "tanh", self.squashed, len(self.mean), *map(len, self.biases)]
        parts = [np.array([self.reach]), self.mean, self.deviation]
        for W, b in zip(self.weights, self.biases, strict=True):
            parts += [b, W.T.ravel()]
        return np.array(layout, int), np.concatenate(parts).astype(float)


def save(file: Path | str, network: Network) -> None:
    """Write a network as an .npz of plain arrays.

    Parameters
    ----------
    file : Path or str
    network : Network
    """
    layers: dict[str, Any] = {}
    for i, (W, b) in enumerate(zip(network.weights, network.biases, strict=True)):
        layers |= {f"weights_{i}": W, f"biases_{i}": b}
    archive.save(Path(file), {
        "format": FORMAT, "features": network.features, "parameters": network.parameters,
        "mean": network.mean, "deviation": network.deviation, "reach": network.reach,
        "activation": network.activation, "squashed": network.squashed, **layers,
    })  # fmt: skip


def load(file: Path | str, features: Sequence[str], parameters: Sequence[str]) -> Network:
    """Read a network from a file.

    Parameters
    ----------
    file : Path or str
    features : sequence of str
        The features that it must take.
    parameters : sequence of str
        The parameters that it may set.

    Returns
    -------
    Network

    Raises
    ------
    ValueError
        Naming the file and what is wrong: missing, truncated, foreign or of another version; other features
        or unknown parameters; shapes that do not fit; numbers of another type, not finite, or so large that a
        sum of them might overflow.
    """
    file = Path(file)
    try:
        arrays = archive.load(file)
    except ValueError as error:
        raise ValueError(f"{file} is not a readable policy: {error}") from None
    arrays.pop(archive.DIGEST, None)  # a policy from another program may have none
    try:
        return _checked(arrays, tuple(features), tuple(parameters))
    except ValueError as error:
        raise ValueError(f"{file}: {error}") from None


@kernel
def forward(features, layout, numbers):
    """Actions (n, j) for features (n, k), of a network given by `Network.packed`."""
    sizes = layout[2:]
    out, room = np.empty((len(features), sizes[-1])), np.empty((2, sizes.max()))
    for row in range(len(features)):
        _forward_into(out[row], features[row], layout, numbers, room)
    return out


@leaf_kernel
def _forward_into(out, features, layout, numbers, room):
    """Writes the actions (j,) for features (k,); room (2, units of the widest layer) is workspace."""
    curved, squashed, sizes = layout[0] > 0, layout[1] > 0, layout[2:]
    depth, k, x, y = len(sizes) - 1, sizes[0], room[0], room[1]
    mean, deviation = numbers[1 : 1 + k], numbers[1 + k : 1 + 2 * k]
    for c in range(k):
        x[c] = min(max((features[c] - mean[c]) / deviation[c], -numbers[0]), numbers[0])
    at = 1 + 2 * k
    for layer in range(depth):
        width, units = sizes[layer], sizes[layer + 1]
        for r in range(units):
            y[r] = numbers[at + r]
        for c in range(width):
            # all units at once: the loop over them is vectorised, a sum of one unit is not
            column, value = numbers[at + (c + 1) * units :], x[c]
            for r in range(units):
                y[r] += column[r] * value
        for r in range(units):
            if layer == depth - 1:
                out[r] = np.tanh(y[r]) if squashed else min(max(y[r], -1.0), 1.0)
            else:
                y[r] = np.tanh(y[r]) if curved else max(y[r], 0.0)
        at += units * (width + 1)
        x, y = y, x


def _checked(
    arrays: dict[str, np.ndarray], features: tuple[str, ...], parameters: tuple[str, ...]
) -> Network:
    version = str(arrays.get("format", "none"))
    if version != FORMAT:
        raise ValueError(f"format must be {FORMAT!r}, got {version[:80]!r}")
    depth = sum(name.startswith("weights_") for name in arrays)
    layers = [f"{kind}_{i}" for i in range(depth) for kind in ("weights", "biases")]
    wanted = {
        "format",
        "features",
        "parameters",
        "mean",
        "deviation",
        "reach",
        "activation",
        "squashed",
        *layers,
    }
    if set(arrays) != wanted or not 1 <= depth <= MOST_LAYERS:
        raise ValueError(f"arrays must be {sorted(wanted)}, got {sorted(arrays)}")
    names = _names(arrays["features"])
    if names != features:
        raise ValueError(f"features must be {features}, got {names}")
    sets = _names(arrays["parameters"])
    if not sets or len(set(sets)) < len(sets) or not set(sets) <= set(parameters):
        raise ValueError(f"parameters must be different ones of {parameters}, got {sets}")
    activation, squashed = str(arrays["activation"]), arrays["squashed"]
    if activation not in ACTIVATIONS:
        raise ValueError(f"activation must be one of {', '.join(ACTIVATIONS)}, got {activation[:80]!r}")
    if squashed.shape != () or squashed.dtype.kind != "b":
        raise ValueError(f"squashed must be true or false, got {squashed.dtype} of shape {squashed.shape}")
    width = len(features)
    shapes = {"mean": (width,), "deviation": (width,), "reach": ()}
    for i in range(depth):
        units = len(sets) if i == depth - 1 else arrays[f"biases_{i}"].size
        if units > MOST_UNITS:
            raise ValueError(f"biases_{i} must be at most {MOST_UNITS}, got {units}")
        shapes |= {f"weights_{i}": (units, width), f"biases_{i}": (units,)}
        width = units
    for name, shape in shapes.items():
        array = arrays[name]
        if array.shape != shape:
            raise ValueError(f"{name} must have shape {shape}, got {array.shape}")
        if array.dtype.kind != "f":
            raise ValueError(f"{name} must be of floats, got {array.dtype}")
        if not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite")
    if not (arrays["deviation"] > 0).all() or not arrays["reach"] > 0:
        raise ValueError("deviation and reach must be positive")
    numbers = {name: np.asarray(arrays[name], float) for name in shapes}
    _check_sums(numbers, depth, activation)
    return Network(
        names, sets, numbers["mean"], numbers["deviation"], float(numbers["reach"]), activation,
        bool(squashed),
        tuple(numbers[f"weights_{i}"] for i in range(depth)),
        tuple(numbers[f"biases_{i}"] for i in range(depth)),
    )  # fmt: skip


def _check_sums(numbers: dict[str, np.ndarray], depth: int, activation: str) -> None:
    """Raises ValueError naming the weights of a layer in which some features could make a sum overflow."""
    signal = np.full(len(numbers["mean"]), numbers["reach"])
    for i in range(depth):
        with np.errstate(over="ignore"):
            signal = np.abs(numbers[f"biases_{i}"]) + np.abs(numbers[f"weights_{i}"]) @ signal
        if not (signal <= MOST_SIGNAL).all():
            raise ValueError(
                f"weights_{i} with biases_{i} must sum to at most {MOST_SIGNAL:g} for any input, "
                f"but unit {signal.argmax()} could come to {signal.max():g}"
            )
        signal = np.ones(len(signal)) if activation == "tanh" else signal


def _names(array: np.ndarray) -> tuple[str, ...]:
    return tuple(array.tolist()) if array.dtype.kind == "U" and array.ndim == 1 else ()
