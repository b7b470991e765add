"""Which module may import which, and which versions of what: a new arrow is a decision, not an accident."""

import ast
import subprocess
import sys
from pathlib import Path
from runpy import run_path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from gmr_gym.evaluation.source import NOT_HASHED, is_hashed

ROOT = Path(__file__).parents[2]
# a room may import only what stands before it; rooms side by side do not know each other
ORDER = (
    ("version", "deprecated", "first_calls", "literals", "data"), ("kernels", "catalogue"),
    ("checks", "points"),
    ("linalg",), ("mixture",),
    ("reduction", "models"),
    ("filters", "simulation"), ("scenarios", "evaluation"), ("recorded",), ("stonesoup", "tuning"), ("envs",),
    ("learning", "offline", "replay"),
    ("__init__",), ("experiments",), ("cli",),
)  # fmt: skip
LEVEL = {room: level for level, rooms in enumerate(ORDER) for room in rooms}
NUMERICS = [room for room in LEVEL if LEVEL[room] < LEVEL["envs"]]
PINS = run_path(str(ROOT / ".ci" / "pins.py"))
LIBRARY = sorted((ROOT / "gmr_gym").rglob("*.py"))
BASELINES = sorted((ROOT / "gmr_gym" / "baselines").glob("*.py"))  # a link, which rglob does not follow


def imported(file):
    """Full dotted names that the file imports, inside functions too."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            package = ".".join(file.relative_to(ROOT).parts[: -node.level]) if node.level else ""
            module = ".".join(filter(None, (package, node.module)))
            yield from (f"{module}.{alias.name}" for alias in node.names)


def arrows(files, *forbidden):
    return [
        f"{file.relative_to(ROOT)} -> {name}"
        for file in files
        for name in imported(file)
        if any(name == root or name.startswith(f"{root}.") for root in forbidden)
    ]


def room_of(parts):
    """The room that a dotted name or a path below the package is of."""
    return parts[0] if parts and parts[0] in LEVEL else "__init__"


def test_every_import_from_room_to_room_goes_to_one_that_stands_before():
    found = set()
    for file in LIBRARY:
        own = room_of(file.relative_to(ROOT / "gmr_gym").with_suffix("").parts)
        others = {room_of(name.split(".")[1:]) for name in imported(file) if name.split(".")[0] == "gmr_gym"}
        found |= {(own, other) for other in others - {own}}
    assert [pair for pair in sorted(found) if LEVEL[pair[1]] >= LEVEL[pair[0]]] == []
    assert len(found) > 40


def test_every_room_has_its_place_and_its_face_defines_nothing():
    there = {room_of(file.relative_to(ROOT / "gmr_gym").with_suffix("").parts) for file in LIBRARY}
    assert there == set(LEVEL)
    for face in (ROOT / "gmr_gym").glob("*/__init__.py"):
        kinds = {type(node).__name__ for node in ast.parse(face.read_text(encoding="utf-8")).body}
        assert kinds <= {"Expr", "ImportFrom", "Assign"}, face


def test_imports_are_seen():
    assert arrows(
        [ROOT / "gmr_gym" / "evaluation" / "montecarlo.py"], "gmr_gym.simulation", "joblib", "threadpoolctl"
    )
    assert arrows(LIBRARY, "gymnasium") and arrows(BASELINES, "gmr_gym.filters.tracker")


def test_the_library_never_imports_trackers_or_agents():
    assert arrows(LIBRARY, "gmr_gym.baselines", "agents") == []


@pytest.mark.parametrize("name", NUMERICS)
def test_numerics_never_import_an_environment_or_a_plot(name):
    files = [f for f in LIBRARY if name in f.relative_to(ROOT / "gmr_gym").with_suffix("").parts[:1]]
    assert files
    assert arrows(files, "gymnasium", "matplotlib", "gmr_gym.envs") == []


def test_baselines_import_neither_one_another_nor_gymnasium():
    assert arrows(BASELINES, "gmr_gym.baselines", "agents", "gymnasium", "gmr_gym.envs") == []


def test_importing_the_package_registers_environments_and_imports_no_numba():
    code = (
        "import sys, gmr_gym, gymnasium\n"
        "assert not {'numba', 'scipy'} & set(sys.modules)\n"
        "assert 'gmr_gym/TurningTarget-v0' in gymnasium.registry\n"
        "for name in gmr_gym.__all__: getattr(gmr_gym, name)\n"
        "assert gmr_gym.Model is gmr_gym.models.Model and callable(gmr_gym.model)\n"
        "assert not hasattr(gmr_gym, 'Models')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_tracker_is_hashed_by_itself_whether_its_folder_is_linked_or_installed():
    assert not is_hashed(Path("baselines", "pda.py")) and is_hashed(Path("filters", "mht.py"))


def test_what_takes_no_part_in_runs_is_there():
    assert all((ROOT / "gmr_gym" / entry).exists() for entry in NOT_HASHED)


def test_how_kernels_are_compiled_stands_in_one_place():
    assert arrows([*LIBRARY, *BASELINES], "numba.njit", "numba.jit") == ["gmr_gym/kernels.py -> numba.njit"]


def test_every_dependency_states_its_lowest_version():
    for requirement in PINS["declared"](PINS["EXTRAS"]):
        assert PINS["lowest"](requirement) in requirement.specifier


@pytest.mark.parametrize("line", ["numpy", "numpy<3", "numpy>=1,>=2"])
def test_a_dependency_with_no_lowest_version_or_several_is_told(line):
    with pytest.raises(ValueError, match=f"{line}.* states [02] lowest versions; state one, by >= or =="):
        PINS["lowest"](Requirement(line))


def test_the_constraints_are_of_all_that_the_tests_need_and_within_every_declared_bound():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = (Requirement(line) for line in lines if not line.startswith("#"))
    pinned = {canonicalize_name(pin.name): PINS["lowest"](pin) for pin in pins}
    assert {canonicalize_name(needed.name) for needed in PINS["declared"](["test", "dev"])} <= pinned.keys()
    for requirement in PINS["declared"](PINS["EXTRAS"]):
        name = canonicalize_name(requirement.name)
        assert name not in pinned or pinned[name] in requirement.specifier, f"{name} {pinned[name]}"


def test_no_function_takes_more_than_eight_arguments_by_position():
    for file in [*LIBRARY, *BASELINES, *(ROOT / "agents").glob("*.py")]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef):
                assert len(node.args.posonlyargs + node.args.args) <= 8, f"{file}: {node.name}"
