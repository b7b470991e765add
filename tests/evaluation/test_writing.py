"""Files are whole: what is stopped half-way leaves what was there."""

import os
import sys

import numpy as np
import pytest

from gmr_gym.evaluation.recordings import write_scans
from gmr_gym.experiments.drawings import Drawing, save
from gmr_gym.experiments.output import write_json, write_rows
from gmr_gym.replay.film import write


class Stopped(Exception):
    pass


def rows():
    yield [1]
    raise Stopped


class HalfDrawing:
    def savefig(self, file, **_):
        file.write_bytes(b"half")
        raise Stopped


WRITERS = {
    "csv": lambda file: write_rows(file, ["a"], rows()),
    "json": lambda file: write_json(file, {"a": 1, "b": {1, 2}}),
    "png": lambda file: save(HalfDrawing(), file),
}


@pytest.mark.parametrize("ending", ["csv", "json", "png"])
def test_a_writer_that_is_stopped_leaves_the_file_as_it_was_and_nothing_beside_it(tmp_path, ending):
    file = tmp_path / f"f.{ending}"
    file.write_text("before")
    with pytest.raises((Stopped, TypeError)):
        WRITERS[ending](file)
    assert file.read_text() == "before" and list(tmp_path.iterdir()) == [file]
    with pytest.raises((Stopped, TypeError)):
        WRITERS[ending](tmp_path / "new" / file.name)
    new = tmp_path / "new"
    assert not new.exists() or list(new.iterdir()) == []


def test_every_ending_is_written_and_replaced(tmp_path):
    for _ in range(2):
        write_rows(tmp_path / "a.csv", ["name"], [["α"]])
        write_json(tmp_path / "a.json", {"a": 1})
        save(Drawing(figsize=(1, 1)), tmp_path / "a.png")
        write(tmp_path / "a.gif", [np.full((20, 20, 3), 200, np.uint8)], 1)
        write_scans(tmp_path / "z.csv", [1.0], [[[1.0, 2.0]]], ["x", "y"])
    assert (tmp_path / "a.csv").read_bytes() == "name\nα\n".encode()
    assert {file.name for file in tmp_path.iterdir()} == {"a.csv", "a.json", "a.png", "a.gif", "z.csv"}


@pytest.mark.skipif(sys.platform == "win32", reason="needs a link and a device")
def test_a_link_stays_one_and_what_is_no_file_is_written_to(tmp_path):
    link, kept = tmp_path / "link.json", tmp_path / "kept.json"
    link.symlink_to(kept)
    write_json(link, {"a": 1})
    assert link.is_symlink() and kept.read_text() == '{\n "a": 1\n}\n'
    write_json(os.devnull, {"a": 1})
    assert not os.path.isfile(os.devnull)


def test_a_file_that_cannot_be_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OSError, match=r"file/below\.json"):
        write_json(tmp_path / "file" / "below.json", {})
    with pytest.raises(OSError, match="Is a directory"):
        write_json(tmp_path, {})
