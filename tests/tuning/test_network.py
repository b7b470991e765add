"""Policies as files of plain arrays: read as they were written, refused when they are anything else."""

import pickle
from io import BytesIO
from itertools import pairwise

import numpy as np
import pytest

from gmr_gym.evaluation import archive
from gmr_gym.tuning.network import FORMAT, Network, load, save

FEATURES, PARAMETERS = ("size", "entropy", "spread"), ("alpha", "prune", "components")


def network(seed=0, units=(5, 4), parameters=("prune", "alpha"), activation="tanh", squashed=False):
    rng = np.random.default_rng(seed)
    sizes = [len(FEATURES), *units, len(parameters)]
    return Network(
        FEATURES, parameters, rng.standard_normal(3), rng.uniform(0.5, 2, 3), 2.0, activation, squashed,
        tuple(rng.standard_normal((b, a)) for a, b in pairwise(sizes)),
        tuple(rng.standard_normal(b) for b in sizes[1:]),
    )  # fmt: skip


def arrays_of(file):
    """As a program writes them that knows of no digest."""
    return {name: array for name, array in archive.load(file).items() if name != archive.DIGEST}


def plain(network, features):
    """The forward pass unit by unit."""
    x = [
        min(max((f - m) / s, -network.reach), network.reach)
        for f, m, s in zip(features, network.mean, network.deviation, strict=True)
    ]
    for i, (W, b) in enumerate(zip(network.weights, network.biases, strict=True)):
        x = [sum(w * v for w, v in zip(row, x, strict=True)) + c for row, c in zip(W, b, strict=True)]
        if i < len(network.weights) - 1:
            x = [np.tanh(v) if network.activation == "tanh" else max(v, 0.0) for v in x]
    return np.array([np.tanh(v) if network.squashed else min(max(v, -1.0), 1.0) for v in x])


@pytest.mark.parametrize("units", [(), (6,), (5, 4), (3, 3, 3)])
@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("squashed", [False, True])
def test_what_was_written_is_read_and_acts_as_unit_by_unit(tmp_path, units, activation, squashed):
    saved = network(1, units, activation=activation, squashed=squashed)
    save(tmp_path / "p.npz", saved)
    read = load(tmp_path / "p.npz", FEATURES, PARAMETERS)
    assert read.features == FEATURES and read.parameters == ("prune", "alpha")
    for features in np.random.default_rng(0).normal(0, 5, (20, 3)):
        np.testing.assert_array_equal(read(features), saved(features))
        np.testing.assert_allclose(read(features), plain(saved, features), rtol=1e-12, atol=1e-14)


def test_single_precision_is_read_as_double(tmp_path):
    one = network()
    save(tmp_path / "p.npz", one._replace(weights=tuple(W.astype(np.float32) for W in one.weights)))
    assert {W.dtype for W in load(tmp_path / "p.npz", FEATURES, PARAMETERS).weights} == {np.dtype(float)}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"format": "gmr_gym thresholds 0"},
            "must be 'gmr_gym thresholds 1', got 'gmr_gym thresholds 0'",
        ),
        ({"format": None}, "format must be"),
        ({"features": np.array(["size", "spread", "entropy"])}, "features must be"),
        ({"features": np.zeros(3)}, "features must be"),
        ({"parameters": np.array(["prune", "beta"])}, "parameters must be different ones of"),
        ({"parameters": np.array(["prune", "prune"])}, "parameters must be different ones of"),
        ({"mean": np.zeros(4)}, r"mean must have shape \(3,\), got \(4,\)"),
        ({"deviation": np.array([1.0, 0.0, 1.0])}, "deviation and reach must be positive"),
        ({"activation": "sine"}, "activation must be one of tanh, relu, got 'sine'"),
        ({"squashed": 2.0}, "squashed must be true or false"),
        ({"reach": -1.0}, "deviation and reach must be positive"),
        ({"weights_0": np.zeros((5, 2))}, r"weights_0 must have shape \(5, 3\)"),
        ({"weights_1": np.full((4, 5), np.nan)}, "weights_1 must be finite"),
        ({"weights_1": np.zeros((4, 5), int)}, "weights_1 must be of floats, got int64"),
        ({"biases_2": np.zeros(3)}, r"biases_2 must have shape \(2,\)"),
        ({"biases_1": None}, "arrays must be"),
        ({"weights_7": np.zeros((2, 2))}, "arrays must be"),
        ({"extra": np.zeros(1)}, "arrays must be"),
        ({"biases_0": np.zeros(5000)}, "biases_0 must be at most 4096"),
        (
            {"weights_0": np.full((5, 3), 1e308)},
            "weights_0 with biases_0 must sum to at most",
        ),
        (
            {"weights_2": np.full((2, 4), -1e308)},
            r"at most 1e\+300 for .* unit 0 could come to inf",
        ),
        ({"biases_1": np.array([0, 0, 1e301, 0])}, r"weights_1 .* but unit 2 could come to 1e\+301"),
    ],
)
def test_what_is_no_policy_is_refused_by_name(tmp_path, change, message):
    file = tmp_path / "p.npz"
    save(file, network())
    arrays = {name: array for name, array in (arrays_of(file) | change).items() if array is not None}
    np.savez(file, **arrays)
    with pytest.raises(ValueError, match=message) as error:
        load(file, FEATURES, PARAMETERS)
    assert str(file) in str(error.value)


def test_sums_of_sums_without_bounds_are_refused_and_those_of_tanh_are_not(tmp_path):
    file = tmp_path / "p.npz"
    large = {"weights_0": np.full((5, 3), 1e200), "weights_1": np.full((4, 5), 1e200)}
    for activation in ("relu", "tanh"):
        save(file, network(activation=activation))
        np.savez(file, **(arrays_of(file) | large))
        if activation == "relu":
            with pytest.raises(ValueError, match="weights_1 with biases_1 must sum to at most"):
                load(file, FEATURES, PARAMETERS)
        else:
            acts = load(file, FEATURES, PARAMETERS)
            assert np.isfinite(acts(1e308 * np.array([[1.0, -1, 1], [0, 1, -1]]))).all()


def test_a_file_that_is_missing_truncated_foreign_or_pickled_is_refused(tmp_path):
    file = tmp_path / "p.npz"
    with pytest.raises(ValueError, match="not a readable policy"):
        load(file, FEATURES, PARAMETERS)
    save(file, network())
    whole = file.read_bytes()
    damaged = bytearray(whole)
    damaged[len(whole) // 3 : len(whole) // 3 + 60] = bytes(60)
    alone = BytesIO()
    np.save(alone, np.zeros(3))
    for content in (
        whole[: len(whole) // 2], bytes(damaged), alone.getvalue(), b"", b"weights", pickle.dumps([1]),
    ):  # fmt: skip
        file.write_bytes(content)
        with pytest.raises(ValueError, match="not a readable policy"):
            load(file, FEATURES, PARAMETERS)
    np.savez_compressed(file, format=FORMAT, weights_0=np.zeros(10**7))
    with pytest.raises(ValueError, match="not a readable policy: it unpacks to 8"):
        load(file, FEATURES, PARAMETERS)
    np.savez(file, format=FORMAT, features=np.array([print], object))
    with pytest.raises(ValueError, match="not a readable policy"):
        load(file, FEATURES, PARAMETERS)
