"""Columns packed and read back: integers exactly, real numbers within what is stated."""

import numpy as np
import pytest
from unpacked import unpacked

from gmr_gym.replay.packing import pack


@pytest.mark.parametrize(
    ("values", "dtype"),
    [
        ([0, 255], "u1"),
        ([-1, 127], "i1"),
        ([0, 256], "u2"),
        ([-1, 128], "i2"),
        ([0, 65535], "u2"),
        ([-1, 32768], "i4"),
        ([0, 65536], "u4"),
        ([7, 2**32 - 1], "u4"),
        ([-(2**31), 2**31 - 1], "i4"),
        ([True, False], "u1"),
        (np.empty(0, int), "u1"),
    ],
)
def test_integers_are_exact_and_as_short_as_they_can_be(values, dtype):
    entries, blob = pack({"count": np.asarray(values)})
    assert entries["count"]["dtype"] == dtype
    np.testing.assert_array_equal(unpacked(entries, blob)["count"], values)


@pytest.mark.parametrize("values", [[2**32], [-1, 2**31]])
def test_integers_of_more_than_32_bits_are_refused(values):
    with pytest.raises(ValueError, match=f"0/label must be integers of 32 bits, got .* to {values[-1]}"):
        pack({"0/label": np.array(values)})


@pytest.mark.parametrize("extent", [1e-3, 1.0, 3e4, 1e5, 1e9])
def test_positions_are_within_their_step(extent):
    points = extent * np.random.default_rng(1).random((500, 2)) - extent / 3
    points[7], points[400, 1] = np.nan, np.nan
    entries, blob = pack({"1/kept": points})
    entry, found = entries["1/kept"], unpacked(entries, blob)["1/kept"]
    spread = np.nanmax(points) - np.nanmin(points)
    assert entry["step"] <= max(spread / 65534, spread / (2**32 - 2)) and (entry["step"] <= 0.5)
    np.testing.assert_allclose(found, points, rtol=0, atol=(0.5 + 1e-6) * entry["step"])


@pytest.mark.parametrize(
    "points", [np.empty((0, 2)), np.full((3, 2), np.nan), np.full((2, 2), 7.25), np.array([[-1e5, np.nan]])]
)
def test_positions_that_do_not_differ_are_exact(points):
    entries, blob = pack({"z": points})
    np.testing.assert_array_equal(unpacked(entries, blob)["z"], points)


@pytest.mark.parametrize(
    ("name", "bits"), [("error", 24), ("0/mode_p", 24), ("kept_w", 9), ("0/full_P", 9), ("1/gate_shape", 9)]
)
def test_real_numbers_keep_their_significant_bits_whatever_their_scale(name, bits):
    rng = np.random.default_rng(2)
    values = rng.standard_normal(5000) * 10.0 ** rng.uniform(-30, 30, 5000)
    values[:4] = np.nan, 0.0, 1.0, -0.5
    entries, blob = pack({name: values.reshape(-1, 2)})
    found = unpacked(entries, blob)[name].ravel()
    assert entries[name]["dtype"] == "f4"
    np.testing.assert_allclose(found, values, rtol=1.01 * 2.0**-bits)
    np.testing.assert_array_equal(found[:4], values[:4])


def test_a_column_equal_to_that_of_the_first_tracker_is_stored_once():
    points = np.array([[1.0, np.nan], [2.0, 3.0]])
    columns = {"0/z": points, "1/z": points.copy(), "2/z": points + 1, "1/kept": points, "0/kept_w": points}
    entries, blob = pack(columns)
    assert [name for name in entries if "same" in entries[name]] == ["1/z"]
    found = unpacked(entries, blob)
    for name, column in columns.items():
        np.testing.assert_allclose(found[name], column, atol=1e-3)


def test_what_is_packed_begins_where_a_typed_array_may():
    columns = {
        "a": np.arange(3), "b": np.array([0.5]), "c": np.arange(5) * 1000, "d": np.array([1 << 20]),
    }  # fmt: skip
    entries, blob = pack(columns)
    found = unpacked(entries, blob)  # which checks it
    for name, column in columns.items():
        np.testing.assert_array_equal(found[name], column)
