"""`beside.py WHEEL OTHER ...`: in the environment that runs it, wheel and others are installed in both orders
and uninstalled in both; after each step every file of what is left is as it was installed."""

import subprocess
import sys
from base64 import urlsafe_b64encode
from hashlib import new
from importlib.metadata import files
from itertools import product
from pathlib import Path

OURS = "gmr-gym"


def pip(*words):
    """Runs pip; an install leaves dependencies alone."""
    flags = ["--no-deps"] if words[0] == "install" else ["--yes"]
    subprocess.run([sys.executable, "-m", "pip", "-q", words[0], *flags, *words[1:]], check=True)


def check_whole(name):
    """Checks the digest of every file that a distribution has recorded."""
    for file in files(name):
        if file.hash:
            digest = new(file.hash.mode, Path(file.locate()).read_bytes()).digest()
            assert urlsafe_b64encode(digest).rstrip(b"=").decode() == file.hash.value, (name, file)


def runs(code):
    """Whether a new Python runs the code."""
    return subprocess.run([sys.executable, "-c", code], stderr=subprocess.DEVNULL).returncode == 0


def main(wheel, *others):
    """Every order of installing, by every order of uninstalling."""
    pip("uninstall", OURS)
    for ours_first, ours_leaves in product([True, False], repeat=2):
        for distributions in [[wheel], others] if ours_first else [others, [wheel]]:
            pip("install", *distributions)
        for name in (OURS, *others):
            check_whole(name)
        assert runs("import gmr_gym.baselines.mht, baselines; baselines is not gmr_gym.baselines or 1 / 0")
        pip("uninstall", *([OURS] if ours_leaves else others))
        for name in others if ours_leaves else [OURS]:
            check_whole(name)
        assert (runs("import gmr_gym.baselines.mht"), runs("import baselines")) == (
            not ours_leaves,
            ours_leaves,
        )
        pip("uninstall", *(others if ours_leaves else [OURS]))
        assert not runs("import gmr_gym") and not runs("import baselines")
    print(f"{OURS} and {', '.join(others)}: both import, and each leaves the other whole, in every order")


if __name__ == "__main__":
    main(*sys.argv[1:])
