"""Where Minari is not installed, the command that installs it is given."""

import sys
from pathlib import Path

import pytest

from gmr_gym.offline import load
from gmr_gym.offline.dataset import check_out


@pytest.mark.parametrize("work", [check_out, load])
def test_without_minari_the_command_that_installs_it_is_given(work, monkeypatch):
    monkeypatch.setitem(sys.modules, "minari", None)
    with pytest.raises(ImportError, match=r"needs the extra `minari`: pip install 'gmr-gym\[minari\]'"):
        work(Path("turning-pda-v0"))
