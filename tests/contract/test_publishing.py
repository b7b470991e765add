"""What is published: the files of sdist and wheel, and what states the version or the dependencies again."""

import os
import re
import shutil
import tarfile
import tomllib
import zipfile
from pathlib import Path
from pkgutil import iter_modules

import pytest
from packaging.requirements import Requirement

import gmr_gym
from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, REDUCTION_GROUP
from gmr_gym.version import __version__

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DOCS = ROOT / "docs"
CONDA = {"matplotlib": "matplotlib-base"}  # where conda has another name


def files_of(folder):
    """Paths of all files below the folder, relative to its parent, through links; caches left out."""
    return {
        Path(place, name).relative_to(folder.parent).as_posix()
        for place, _, names in os.walk(folder, followlinks=True)
        for name in names
        if Path(place).name != "__pycache__"
    }


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """The sdist of a copy of the project, unpacked, and the wheel built from that."""
    pytest.importorskip("setuptools", minversion="77")
    builder = pytest.importorskip("build").ProjectBuilder
    quiet = pytest.importorskip("pyproject_hooks").quiet_subprocess_runner
    copy, out = tmp_path_factory.mktemp("copy"), tmp_path_factory.mktemp("dist")
    for name in ("gmr_gym", "baselines"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, copy / name, symlinks=True, ignore=ignored)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, copy)
    with tarfile.open(builder(copy, runner=quiet).build("sdist", out)) as archive:
        archive.extractall(out, filter="data")
    sdist = out / f"gmr_gym-{__version__}"
    return sdist, builder(sdist, runner=quiet).build("wheel", out)


def test_the_sdist_has_the_package_without_links_and_its_licence(built):
    sdist, _ = built
    assert files_of(sdist / "gmr_gym") == files_of(ROOT / "gmr_gym")
    assert {path.name for path in sdist.iterdir()} >= {"LICENSE", "PKG-INFO", "README.md", "pyproject.toml"}
    assert [path for path in sdist.rglob("*") if path.is_symlink()] == []


def test_the_wheel_has_every_file_and_nothing_else_at_the_top_level(built):
    _, wheel = built
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.partition("/")[0] for name in names} == {"gmr_gym", f"gmr_gym-{__version__}.dist-info"}
    assert {name for name in names if name.startswith("gmr_gym/")} == files_of(ROOT / "gmr_gym")
    assert "gmr_gym/baselines/mht.py" in names


@pytest.mark.parametrize(
    ("file", "pattern"),
    [
        ("CITATION.cff", r"^version: (.+)$"),
        ("recipe/recipe.yaml", r'^  version: "(.+)"$'),
        ("CHANGELOG.md", r"\A# Changelog\n\n## (.+)$"),
    ],
)
def test_the_version_is_stated_alike(file, pattern):
    assert re.findall(pattern, (ROOT / file).read_text(encoding="utf-8"), re.M) == [__version__]


def test_the_recipe_takes_what_the_package_takes():
    yaml = pytest.importorskip("yaml")
    recipe = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text(encoding="utf-8"))
    declared = {
        (CONDA.get(r.name, r.name), str(r.specifier)) for r in map(Requirement, PROJECT["dependencies"])
    }
    python, *taken = [tuple(line.split(" ", 1)) for line in recipe["requirements"]["run"]]
    assert python == ("python", ">=${{ python_min }}")
    assert sorted(taken) == sorted(declared)
    assert f">={recipe['context']['python_min']}" == PROJECT["requires-python"]
    scripts = [f"{name} = {value}" for name, value in PROJECT["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == scripts
    assert all((ROOT / file).is_file() for file in recipe["about"]["license_file"])
    assert recipe["about"]["license"] == PROJECT["license"]


def test_what_is_public_is_every_face_and_every_group_of_entry_points():
    page = (DOCS / "stability.md").read_text(encoding="utf-8")
    rooms = [room for room in iter_modules(gmr_gym.__path__) if room.ispkg and has_names(room.name)]
    faces = re.search(r"of the faces (.+?);", page)[1]
    assert re.findall(r"`gmr_gym\.(\w+)`", faces) == sorted(room.name for room in rooms)
    groups = re.search(r"entry-point groups (.+?);", page)[1]
    assert re.findall(r"`([\w.]+)`", groups) == [GROUP, MULTI_TARGET_GROUP, REDUCTION_GROUP]


def has_names(room):
    """Whether a room has names on its face; `stonesoup` may not be there to import."""
    return "__all__" in (ROOT / "gmr_gym" / room / "__init__.py").read_text(encoding="utf-8")


def test_the_entry_for_gymnasium_asks_for_the_version_that_the_package_does():
    (lowest,) = [str(r.specifier) for r in map(Requirement, PROJECT["dependencies"]) if r.name == "gymnasium"]
    page = (DOCS / "publishing.md").read_text(encoding="utf-8")
    assert f"Gymnasium-v{lowest.removeprefix('>=')}-blue" in page
    assert f"Gymnasium {lowest.replace('>=', '>= ')} |" in page
