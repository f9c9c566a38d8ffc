"""The documentation, built by ``make docs``: warnings are errors, and neither the build nor a page uses the network."""

from __future__ import annotations

import sys
from pathlib import Path

import pinholify

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))

project = "pinholify"
author = "the pinholify authors"
copyright = "the pinholify authors; Apache-2.0"
release = version = pinholify.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.doctest",
    "sphinx_gallery.gen_gallery",
    "extensions.api_tables",
    "extensions.command_line",
    "extensions.mathml",
    "extensions.names",
    "extensions.pictures",
    "extensions.self_contained",
]
exclude_patterns = ["examples", "extensions"]
highlight_language = "none"
myst_enable_extensions = ["attrs_inline", "dollarmath"]
myst_heading_anchors = 3

nitpicky = True
nitpick_ignore_regex = [
    (r"py:.*", r"(?!pinholify\.).*"),  # types of other packages, whose inventories are not fetched; our short names
    (r"py:class", r"pinholify\.(refinement|reproduction)\..*"),  # types that only appear in signatures
]

autodoc_default_options = {"members": True, "member-order": "bysource"}
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: f"pinholify.arrays.{name}" for name in ("Bools", "Floats", "Ints")}

doctest_global_setup = "import numpy as np"

sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"plot_",
    "within_subsection_order": "FileNameSortKey",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
    "min_reported_time": float("inf"),
}

html_theme = "furo"
html_title = "pinholify"
html_static_path = ["static"]
html_css_files = ["site.css"]
smartquotes_action = "qe"  # no dashes: --json stays as it is typed
html_math_renderer = "mathml"
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
