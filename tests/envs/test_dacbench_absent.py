"""Where DACBench cannot be imported, the adapter says what to install."""

import sys
from runpy import run_module

import pytest


class Without:
    """Finds no DACBench, since a module of this name is missing."""

    def __init__(self, missing):
        self.missing = missing

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("ConfigSpace", "dacbench"):
            raise ModuleNotFoundError(f"No module named {self.missing!r}", name=self.missing)


@pytest.mark.parametrize(
    ("missing", "said"),
    [
        ("dacbench", r"needs the extra `dacbench`: pip install 'gmr-gym\[dacbench\]'"),
        ("torchvision", "imports torchvision where torch is installed: pip install torchvision"),
    ],
)
def test_what_is_missing_is_said(missing, said, monkeypatch):
    for name in [name for name in sys.modules if name.partition(".")[0] in ("ConfigSpace", "dacbench")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Without(missing), *sys.meta_path])
    with pytest.raises(ImportError, match=said):
        run_module("gmr_gym.envs.dacbench")
