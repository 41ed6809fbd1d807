"""Sphinx settings; `scripts/docs` builds the pages."""

import sys
from pathlib import Path

_HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(_HERE / "_extensions"), str(_HERE.parent / "scripts")]

from fitball.version import __version__  # noqa: E402

project = "fitball"
author = "The fitball authors"
project_copyright = author
version = release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "mathml", "woven"]
exclude_patterns = ["_*", "paper"]
nitpicky = False
# Names in docstrings stand between single backticks.
default_role = "code"

myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_typehints = "none"
python_maximum_signature_line_length = 80
add_module_names = False

html_theme = "furo"
html_title = "fitball"
html_math_renderer = "mathml"
html_static_path = ["_static"]
html_css_files = ["fitball.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_theme_options = {"navigation_with_keys": True}
pygments_style = "default"
