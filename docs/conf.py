"""How Sphinx builds the site: plain Markdown, and a reference that is written from the code before each build."""

from __future__ import annotations

import sys
from importlib.metadata import version as installed
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
from docs.written_from_code import write_reference  # noqa: E402  found only now

project = "microrelief"
author = "the founders of microrelief"
version = release = installed("microrelief")
language = "en"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build", "notebooks"]

myst_enable_extensions = ["colon_fence", "dollarmath"]
myst_heading_anchors = 3  # links to a section of a page work as they do where the repository is browsed

autodoc_default_options = {"members": True, "imported-members": True, "member-order": "groupwise"}
autodoc_typehints = "none"  # numpydoc sections say types, shapes and units
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True

html_theme = "pydata_sphinx_theme"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_title = "microrelief"
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_align": "left",
    "show_prev_next": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": [],
    "footer_end": [],
    "show_version_warning_banner": False,
}
html_sidebars: dict[str, list[str]] = {"index": []}


def setup(app: Sphinx) -> None:
    """Write the reference pages before Sphinx looks for pages."""
    write_reference(HERE / "reference")
