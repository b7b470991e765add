"""The lowest versions that pyproject.toml declares: `python .ci/pins.py EXTRA ...` prints a pip constraint
for each direct dependency of the package and of the extras named."""

import sys
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = PROJECT["optional-dependencies"]


def declared(extras=()):
    """Requirements of the package and of the extras, with those that an extra takes from another."""
    lines = PROJECT["dependencies"] + [line for extra in extras for line in EXTRAS[extra]]
    for requirement in map(Requirement, lines):
        if requirement.name == PROJECT["name"]:
            yield from declared(requirement.extras)
        else:
            yield requirement


def lowest(requirement):
    """The one version that bounds the requirement from below; ValueError where it states none or several."""
    versions = [bound.version for bound in requirement.specifier if bound.operator in (">=", "==")]
    if len(versions) != 1:
        raise ValueError(f"{requirement} states {len(versions)} lowest versions; state one, by >= or ==")
    return versions[0]


if __name__ == "__main__":
    print(*sorted({f"{of.name}=={lowest(of)}" for of in declared(sys.argv[1:])}), sep="\n")
