"""How the site is made; what it stands on, and why, is in contributing.md."""

import os
import sys
from pathlib import Path

os.environ["NUMBA_DISABLE_JIT"] = "1"  # kernels are then functions, with signatures and docstrings
sys.path[:0] = [
    str(Path(__file__).parent / "extensions"),
    str(Path(__file__).parent),
    str(Path(__file__).parents[1]),
]

from gmr_gym.version import __version__ as release  # noqa: E402

project = "gmr_gym"
author = "The gmr_gym developers"
copyright = author
version = release
extensions = [
    "myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode", "numpydoc", "sphinx_design",
    "sphinx_copybutton", "ages", "datasheets", "mathml", "pages", "reductions", "rooms",
]  # fmt: skip
exclude_patterns = ["static", "extensions", "results", "pages"]

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 4
default_role = "code"  # `prune_weight` in a docstring
add_function_parentheses = False
add_module_names = False
toc_object_entries_show_parents = "hide"
autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_mock_imports = [  # of extras
    "ConfigSpace",
    "dacbench",
    "jsbsim",
    "optuna",
    "stable_baselines3",
    "stonesoup",
    "torch",
]
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
numpydoc_show_class_members = False
viewcode_line_numbers = True

html_theme = "pydata_sphinx_theme"
html_title = "gmr_gym"
html_static_path = ["static"]
html_extra_path = ["pages"]  # whole pages, as commands leave them
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_sourcelink = False
html_theme_options = {
    "logo": {"text": "gmr_gym"},
    "show_toc_level": 2,
    "header_links_before_dropdown": 7,
    "navigation_depth": 3,
    "footer_start": ["copyright"],
    "footer_end": [],
}
