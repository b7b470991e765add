"""Which module may import which: a new arrow is a decision, not an accident."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NUMERICS = [
    "validation", "mixture", "kalman", "association", "merge_cost", "merging", "reduction", "ise",
    "ise_pairs", "distances", "models",
    "modes", "clustering", "agglomeration", "dissimilarity", "greedy_isd", "reducers",
    "curves", "philox", "scans", "seeds", "simulate", "play", "metrics", "montecarlo", "summary", "tracker",
    "scenarios", "crowd", "crowd_runs", "crowd_summary", "multitarget", "phd", "cardinality",
    "clutter_learning", "multi_bernoulli", "finite_mixture", "gibbs", "hypotheses", "instances",
    "thresholds", "threshold_features", "threshold_hindsight", "threshold_policies", "threshold_scans",
    "threads", "network", "batch", "blocks", "clusters", "source", "workers",
]  # fmt: skip
LIBRARY, BASELINES = sorted((ROOT / "gmr_gym").rglob("*.py")), sorted((ROOT / "baselines").glob("*.py"))


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


def test_imports_are_seen():
    assert arrows([ROOT / "gmr_gym" / "montecarlo.py"], "gmr_gym.simulate", "joblib", "threadpoolctl")
    assert arrows(LIBRARY, "gymnasium") and arrows(BASELINES, "gmr_gym.tracker")


def test_the_library_never_imports_trackers_or_agents():
    assert arrows(LIBRARY, "baselines", "agents") == []


@pytest.mark.parametrize("name", NUMERICS)
def test_numerics_never_import_an_environment_or_a_plot(name):
    files = [f for f in LIBRARY if name in f.relative_to(ROOT / "gmr_gym").with_suffix("").parts[:1]]
    assert files
    assert arrows(files, "gymnasium", "matplotlib", "gmr_gym.envs") == []


def test_baselines_import_neither_one_another_nor_gymnasium():
    assert arrows(BASELINES, "baselines", "agents", "gymnasium", "gmr_gym.envs", "gmr_gym.policy") == []


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
