"""The command that writes episodes: what it says, and how it refuses."""

import sys

import pytest

from gmr_gym.cli import main

pytest.importorskip("minari")
pytest.importorskip("h5py")
TURNING = "gmr_gym/TurningTarget-v0"


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """The command in a folder of its own: (exit code, what it printed, its errors)."""
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["gmr-gym", "episodes", *words])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return call


def test_episodes_are_written_and_it_is_said_how_they_are_read(call, monkeypatch):
    import minari

    few = ("--set", "horizon=3", "--set", "clutter_rate=5", "--episodes", "2", "--out", "data/turning-v0")
    code, said, _ = call(TURNING, "--tracker", "pda", "--tracker", "nearest-neighbour", *few)
    assert code == 0 and "4 episodes written to data/turning-v0\n" in said
    assert "MINARI_DATASETS_PATH=data and minari.load_dataset('turning-v0')" in said
    monkeypatch.setenv("MINARI_DATASETS_PATH", "data")
    assert len(minari.load_dataset("turning-v0")) == 4


@pytest.mark.parametrize(
    ("words", "error"),
    [
        ((TURNING, "--tracker", "pda", "--out", "turning"), "--out must end in a name of letters"),
        ((TURNING, "--tracker", "pda", "--tracker", "pda", "--out", "a-v0"), "--tracker pda is given twice"),
        ((TURNING, "--tracker", "pdaa", "--out", "a-v0"), "unknown tracker 'pdaa'; did you mean 'pda'?"),
        (("TurningTarget", "--tracker", "pda", "--out", "a-v0"), "did you mean 'gmr_gym/TurningTarget-v0'?"),
        ((TURNING, "--tracker", "pda", "--set", "clutter=5", "--out", "a-v0"), "unknown argument 'clutter'"),
    ],
)  # fmt: skip
def test_what_cannot_be_written_is_refused_in_a_line_and_leaves_nothing(words, error, call, tmp_path):
    code, _, said = call(*words)
    assert code == 2 and error in said and "Traceback" not in said
    assert [*tmp_path.iterdir()] == []
