"""The documentation site: `make docs` builds it into docs/_build/html."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from jupyter_client.manager import KernelManager

import bowstring

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

project = "Bowstring"
author = "The Bowstring authors"
copyright = "the Bowstring authors"
release = version = bowstring.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinxcontrib.bibtex",
    "numpydoc",
    "reference",
    "sphinx-mathjax-offline",  # equations show without a network
]
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath", "html_image", "substitution"]
myst_heading_anchors = 4
nb_execution_mode = "cache"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True
# each kernel of the examples warns of a connection without encryption
KernelManager.transport_encryption.default_value = "auto"
bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "plain"

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings give the types
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
# every public name is documented: summary, parameters with types and descriptions, what is returned
numpydoc_validation_checks = {
    "GL06",
    "GL07",
    "PR02",
    "PR03",
    "PR04",
    "PR07",
    "PR10",
    "RT03",
    "SS01",
}

# names resolve without a network; with one, `make docs-links` checks addresses
intersphinx_mapping: dict[str, tuple[str, str]] = {}
nitpicky = False
math_numfig = True
math_eqref_format = "Eq. {number}"
numfig = True
numfig_secnum_depth = 1  # equations and figures of a theory page are 2.1, 2.2, ...

smartquotes = False  # examples are copied

html_theme = "pydata_sphinx_theme"
html_title = "Bowstring"
html_theme_options = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "icon_links": [],
    "header_links_before_dropdown": 6,
    "pygments_light_style": "default",
    "pygments_dark_style": "monokai",
}
html_show_sourcelink = False
html_copy_source = False
exclude_patterns = ["_build", "**/.ipynb_checkpoints"]

# the playground is a page of the site where `make playground` has built it
_PLAYGROUND = Path(bowstring.__file__).parent / "cli" / "playground.html"
if _PLAYGROUND.is_file():
    html_extra_path = [str(_PLAYGROUND)]


def setup(app: Any) -> None:
    """Let pages say {only} playground where it is built."""
    if _PLAYGROUND.is_file():
        app.tags.add("playground")
