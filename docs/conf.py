"""Sphinx configuration of the documentation site; ``make docs`` builds it into build/docs."""

import sys
from pathlib import Path

import cylconn_ros

sys.path.insert(0, str(Path(__file__).parent))  # directives.py

project = "cylconn_ros"
author = "the contributors of cylconn_ros"
copyright = author
version = release = cylconn_ros.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "directives"]
exclude_patterns = ["_build"]
highlight_language = "none"  # equations stand in plain blocks; other blocks name their language

myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_preserve_defaults = True
napoleon_use_ivar = True

html_theme = "furo"
html_title = f"cylconn_ros {release}"
html_show_copyright = False
html_show_sphinx = False
html_static_path = ["static"]
html_css_files = ["site.css"]
