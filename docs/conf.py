"""How Sphinx makes a site of the Markdown pages: `sphinx-build -W --keep-going -b html -c docs . site`.

The source is the whole repository, so that links between pages lead where they lead on a git host. Tutorials, guides
and theory are run first; `-D run_pages=0` leaves that out.
"""

from __future__ import annotations

import sys
from pathlib import Path

from geoerr import __version__

sys.path[:0] = [str(Path(__file__).with_name("extensions")), str(Path(__file__).parent)]

project = "geoerr"
author = "the authors of geoerr"
release = version = __version__
language = "en"
highlight_language = "text"

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "commands",
    "docstrings",
    "mathml",
    "navigation",
    "run_pages",
]
root_doc = "docs/README"
# Named one by one: a clone also holds a virtual environment, builds, and results of examples.
include_patterns = [
    "*.md",
    "benches/*.md",
    "docs/**",
    "examples/*.md",
    "python/geoerr/effects/README.md",
    "validation/**",
]
source_suffix = {".md": "markdown"}

myst_enable_extensions = ["dollarmath"]
# As git hosts read them: ```math is an equation, and headings have anchors.
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
# Beside the first page, whose links become the whole tree.
pages_that_list_others = ["benches/README", "docs/reference/formats", "docs/reference/python", "validation/README"]

autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
python_maximum_signature_line_length = 100
python_use_unqualified_type_names = True
# Single backticks are a name where one is known, and code everywhere else.
default_role = "py:obj"
toc_object_entries_show_parents = "hide"
napoleon_google_docstring = False
# Types stand in the signature.
napoleon_attr_annotations = False
# Parameters as they are written, two in one line where they are alike; their shapes are no names to be linked.
napoleon_use_param = False
napoleon_use_rtype = False

html_theme = "furo"
html_math_renderer = "mathml"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_title = f"geoerr {release}"
html_copy_source = False
html_show_sourcelink = False
templates_path = ["templates"]
html_additional_pages = {"index": "redirect.html"}
