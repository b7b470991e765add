"""Files of arrays: what is read is what was written, or nothing is."""

import struct
import tracemalloc
from io import BytesIO
from zipfile import ZIP_STORED, ZipFile

import numpy as np
import pytest

from gmr_gym.evaluation import archive

ARRAYS = {
    "a": np.arange(6.0).reshape(2, 3), "b": np.array([True, False]), "c": np.array(["one", "two"]),
    "none": np.zeros((0, 4)), "alone": np.float64(3.5), "across": np.asfortranarray(np.eye(3)[:2]),
}  # fmt: skip


@pytest.fixture
def file(tmp_path):
    archive.save(tmp_path / "arrays.npz", ARRAYS)
    return tmp_path / "arrays.npz"


def test_what_is_read_is_what_was_written_and_numpy_reads_it_too(file):
    read = archive.load(file)
    with np.load(file) as stored:
        for name, array in ARRAYS.items():
            for found in (read[name], stored[name]):
                assert found.dtype == array.dtype and found.shape == array.shape
                np.testing.assert_array_equal(found, array)
    assert set(read) == {*ARRAYS, archive.DIGEST}


def test_the_digest_is_of_names_types_shapes_and_bytes_and_of_nothing_else(file):
    a, b = ARRAYS["a"], ARRAYS["b"]
    own = archive.digest({"a": a, "b": b}).tobytes()
    assert own == archive.digest({"b": b, "a": np.asfortranarray(a)}).tobytes()
    others = ({"a": a}, {"c": a, "b": b}, {"a": a.T, "b": b}, {"a": a.reshape(3, 2), "b": b},
              {"a": a.view(int), "b": b}, {"a": -a, "b": b}, {"a": a + 0.0, "b": ~b})  # fmt: skip
    found = [archive.digest(other).tobytes() for other in others]
    assert len({own, *found}) == 1 + len(others)


def test_no_byte_may_be_another(file):
    """Bits that nobody reads apart, such as a date: then every array is what it was."""
    whole, wanted = file.read_bytes(), archive.load(file)
    for place in np.random.default_rng(0).choice(len(whole), 100, replace=False):
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(place) % 8
        file.write_bytes(damaged)
        try:
            read = archive.load(file)
        except ValueError:
            continue
        if archive.DIGEST in read:
            assert all(read[name].tobytes() == wanted[name].tobytes() for name in wanted)


def test_what_is_cut_anywhere_is_refused(file):
    whole = file.read_bytes()
    for length in range(0, len(whole), 50):
        file.write_bytes(whole[:length])
        with pytest.raises(ValueError):
            archive.load(file)


def written(file, header, content):
    """A file with one member, whose header of NumPy's format says that."""
    stream = BytesIO()
    np.lib.format.write_array_header_1_0(stream, header)
    with ZipFile(file, "w", ZIP_STORED) as packed:
        packed.writestr("a.npy", stream.getvalue() + content)


@pytest.mark.parametrize(
    ("descr", "shape", "message"),
    [
        ("<f8", (2**40,), "a.npy does not have the 8796093022208 bytes that its header states"),
        ("<f8", (3,), "a.npy does not have the 24 bytes that its header states"),
        ("<f8", (-1, -2), None),
        ("|O", (2,), "a.npy holds objects"),
        ("|V1000000000", (2,), "does not have the 2000000000 bytes"),
    ],
)
def test_a_header_that_says_what_is_not_there_is_refused(file, descr, shape, message):
    written(file, {"descr": descr, "fortran_order": False, "shape": shape}, bytes(16))
    with pytest.raises(ValueError, match=message):
        archive.load(file)


def test_nothing_is_inflated(file):
    np.savez_compressed(file, a=np.zeros(10**6))
    with pytest.raises(ValueError, match="it unpacks to 8000128 bytes, and is"):
        archive.load(file)
    np.savez_compressed(file, a=np.random.default_rng(0).random(100))  # as long as it was
    with pytest.raises(ValueError, match=r"a\.npy is compressed"):
        archive.load(file)


def test_what_would_take_much_memory_is_refused_without_taking_any(tmp_path):
    """64 MB in 64 kB, under their true length and under one of a few bytes."""
    np.savez_compressed(tmp_path / "true.npz", a=np.zeros(2**23))
    whole = bytearray((tmp_path / "true.npz").read_bytes())
    at = whole.rindex(b"PK\x01\x02") + 24  # in the directory: the length
    whole[at : at + 4] = struct.pack("<I", 100)
    (tmp_path / "false.npz").write_bytes(whole)
    tracemalloc.start()
    for name, message in (("true.npz", "it unpacks to 67108992 bytes"), ("false.npz", "is compressed")):
        with pytest.raises(ValueError, match=message):
            archive.load(tmp_path / name)
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.stop()
