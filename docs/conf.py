"""How Sphinx makes the manual: `sphinx-build docs out/docs`. It executes no notebook and needs no network."""

import logging
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "extension")]

import ident  # noqa: E402

for name in ("ident", "jax"):  # a library of the theme prints all logs from INFO on
    logging.getLogger(name).setLevel(logging.WARNING)

project = "ident"
author = "the authors of ident"
project_copyright = "see LICENSE"
version = release = ident.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "docstrings",
    "options",
    "methods",
    "notebook",
    "values",
]
myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
default_role = "code"  # single backticks in docstrings
smartquotes = False
highlight_language = "none"
exclude_patterns = ["_build"]

OWN = "subject, shown, drawn, listed, called, made_from, numbers, summarised"  # what results say to `Result`
autodoc_default_options = {"members": True, "exclude-members": f"form, suffix, name, {OWN}"}
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_preserve_defaults = True
autoclass_content = "class"
add_module_names = False
python_use_unqualified_type_names = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
nitpick_ignore_regex = [
    ("py:.*", r"(?!ident\.[A-Za-z]\w*$).*"),  # all but the front door: the reference has no page for it
]

html_theme = "furo"
html_title = "ident"
html_static_path = ["static"]
html_css_files = ["manual.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False
