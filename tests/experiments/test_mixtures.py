"""Mixtures in files: what is written is read again to the last bit, and what is wrong is named."""

import csv
import json

import numpy as np
import pytest

from gmr_gym.experiments.mixtures import EXAMPLES, FORMATS, crouse, posterior, read_mixture, write_mixture
from gmr_gym.experiments.options import EXAMPLES as TYPED
from gmr_gym.mixture import mixture
from gmr_gym.reduction import runnalls


def some(d, n=7):
    rng = np.random.default_rng(d)
    A = rng.normal(size=(n, d, d))
    P = A @ A.transpose(0, 2, 1) + np.eye(d)
    return mixture(rng.random(n), rng.normal(0, 9, (n, d)), (P + P.transpose(0, 2, 1)) / 2)


@pytest.mark.parametrize("ending", FORMATS)
@pytest.mark.parametrize("d", [1, 2, 5])
def test_what_is_written_is_read_to_the_last_bit(tmp_path, ending, d):
    p, file = some(d), tmp_path / f"p{ending}"
    write_mixture(file, *runnalls(p, 3))
    for kept, read in zip(runnalls(p, 3)[0], read_mixture(file), strict=True):
        np.testing.assert_array_equal(read, kept)


def test_a_file_says_where_every_component_came_from(tmp_path):
    q, origin = runnalls(some(2), 3)
    for ending in FORMATS:
        write_mixture(tmp_path / f"q{ending}", q, origin)
    assert json.loads((tmp_path / "q.json").read_text())["origin"] == origin.tolist()
    np.testing.assert_array_equal(np.load(tmp_path / "q.npz")["origin"], origin)
    with (tmp_path / "q.csv").open(newline="") as stream:
        names, *rows = csv.reader(stream)
    assert names == ["w", "m1", "m2", "P11", "P12", "P22", "from"]
    assert [row[-1].split() for row in rows] == [
        [str(i + 1) for i in np.flatnonzero(origin == j)] for j in range(3)
    ]


def test_arrays_that_numpy_saves_are_read(tmp_path):
    np.savez(tmp_path / "p.npz", **some(2)._asdict())
    np.testing.assert_array_equal(read_mixture(tmp_path / "p.npz").P, some(2).P)


def test_the_examples_are_mixtures_always_the_same():
    assert EXAMPLES.keys() == TYPED.keys()
    assert crouse().w.sum() == pytest.approx(1) and crouse().m.shape == (10, 1)
    first, again, other = posterior(), posterior(), posterior(1)
    assert 20 <= len(first.w) <= 60 and first.m.shape[1] == 4 and first.w.sum() == pytest.approx(1)
    np.testing.assert_array_equal(first.m, again.m)
    assert first.m.shape != other.m.shape or (first.m != other.m).any()


ONE, TWO = [[1.0]], [[1.0, 0.0], [0.0, 1.0]]


@pytest.mark.parametrize(
    ("w", "m", "P", "message"),
    [
        ([0.5, 0.0], [[0], [1]], [ONE] * 2, "component 2: w must be a positive, finite number, got 0"),
        ([-1, 0.5], [[0], [1]], [ONE] * 2, "component 1: w must be a positive, finite number, got -1"),
        ([float("nan")], [[0]], [ONE], "component 1: w must be a positive, finite number, got nan"),
        (["a", 0.5], [[0], [1]], [ONE] * 2, "component 1: w must be an array of real numbers"),
        ([1], [[float("inf")]], [ONE], "component 1: m must be a list of finite numbers, got [inf]"),
        ([1], [3.0], [ONE], "component 1: m must be a list of finite numbers, got 3.0"),
        ([1], [[]], [ONE], "component 1: m must be a list of finite numbers, got []"),
        ([1], [[0, 0]], [[[1, 0, 0], [0, 1, 0]]], "component 1: P must be a square matrix, got shape (2, 3)"),
        ([1], [[0, 0]], [[[1, 0], [0]]], "component 1: P must be an array of real numbers, but its rows"),
        ([1], [[0, 0]], [[[1, 0.5], [0, 1]]], "component 1: P must be symmetric, got [[1.0, 0.5],"),
        ([1], [[0, 0]], [[[1, 2], [2, 1]]], "component 1: P must be positive definite, but its least eigenv"),
        ([1], [[0]], [[[float("nan")]]], "component 1: P must be finite"),
        ([1], [[0]], [TWO], "component 1: P must have shape (1, 1) to fit m, got (2, 2)"),
        ([1, 1], [[0], [0, 0]], [ONE, TWO], "component 2: expected 1 dimensions as before, got 2"),
        ([1, 1], [[0]], [ONE], "expected w, m and P of equally many components, got [2, 1, 1]"),
        ([], [], [], "expected one component or more, got none"),
        (1.0, [[0]], [ONE], "expected w, a list with one of every component; there are ['w', 'm', 'P']"),
    ],
)  # fmt: skip
def test_what_is_no_mixture_is_named_with_file_and_component(tmp_path, w, m, P, message):
    file = tmp_path / "p.json"
    file.write_text(json.dumps({"w": w, "m": m, "P": P}))
    with pytest.raises(ValueError) as raised:
        read_mixture(file)
    assert str(raised.value).startswith(f"{file}: {message}")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("p.json", "{w: 1}", "it is no JSON: Expecting property name"),
        ("p.json", "[1, 2]", "expected w, a list with one of every component; there are []"),
        ("p.json", '{"w": [1], "m": [[1]]}', "expected P, a list with one of every component"),
        ("p.json", b"\xff\xfe", "'utf-8' codec can't decode"),
        ("p.npz", "w,m1", "File is not a zip file"),
        ("p.csv", "", "expected the header w,m1,P11, got ''"),
        ("p.csv", "w,m1,m2,P11,P12\n", "expected the header w,m1,m2,P11,P12,P22, got 'w,m1,m2,P11,P12'"),
        ("p.csv", "w,m1,P11\n", "expected one component or more, got none"),
        ("p.csv", "w,m1,P11\n1,0,1\n1,0\n", "component 2: expected 3 columns, got 2"),
        ("p.csv", "w,m1,P11\n1,0,x\n", "component 1: P11 must be a number, got 'x'"),
        ("p.csv", "w,m1,P11\n1,nan,1\n", "component 1: m must be a list of finite numbers, got [nan]"),
        ("p.csv", "w,m1,m2,P11,P12,P22\n1,0,0,1,2,1\n", "component 1: P must be positive definite"),
    ],
)
def test_a_file_of_another_kind_is_refused(tmp_path, name, text, message):
    file = tmp_path / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(ValueError) as raised:
        read_mixture(file)
    assert str(raised.value).startswith(f"{file}: {message}")


def test_nothing_is_unpickled(tmp_path):
    p = some(1)
    np.savez(tmp_path / "p.npz", w=p.w, m=np.array([None] * 7), P=p.P)
    with pytest.raises(ValueError, match=r"p\.npz: m\.npy holds objects"):
        read_mixture(tmp_path / "p.npz")


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FileNotFoundError) as raised:
        read_mixture(tmp_path / "none.csv")
    assert raised.value.filename == str(tmp_path / "none.csv")
