"""Sphinx's configuration of the documentation site; `make docs` builds it."""

import shutil
import sys
from importlib.metadata import version as _version
from importlib.util import find_spec
from pathlib import Path

from plotly.offline import get_plotlyjs
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))

project = "rodgen"
author = "The rodgen developers"
copyright = author
version = release = _version("rodgen")

extensions = [
    "docstrings",
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_copybutton",
    "sphinx_design",
]
source_suffix = {".md": "myst-nb", ".ipynb": "myst-nb", ".rst": "restructuredtext"}
exclude_patterns = ["files"]
default_role = "autolink"
nitpick_ignore_regex = [("py:class", ".*")]  # the types in docstrings are prose: "ndarray, shape (n, 3)"

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 4
myst_dmath_double_inline = True  # a displayed formula within a paragraph, as notebooks have it
nb_execution_mode = "off"  # notebooks.py executes them
nb_render_markdown_format = "myst"
nb_code_prompt_show = "Show the code"
nb_code_prompt_hide = "Hide the code"
nb_merge_streams = True

autodoc_typehints = "none"  # the docstrings have them
autodoc_member_order = "bysource"
autosummary_generate = False
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
copybutton_exclude = ".linenos, .gp, .go"

html_theme = "furo"
html_title = "rodgen"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_js_files = ["figures.js", "formulas.js"]
html_show_sourcelink = False
html_copy_source = False
html_show_sphinx = False
html_theme_options = {"top_of_page_buttons": []}

# MathJax from a package, only what these pages need: TeX in, HTML and its fonts out.
mathjax_path = "mathjax/tex-chtml.js"
mathjax3_config = {
    "options": {"enableMenu": False},
    "loader": {"load": ["[tex]/ams"]},
}


def _copy_scripts(app: Sphinx, error: Exception | None) -> None:
    if error or app.builder.format != "html":
        return
    static = Path(app.outdir, "_static")
    found = find_spec("sphinx-mathjax-offline")
    mathjax = Path(found.submodule_search_locations[0]) / "static/mathjax"
    for part in ("tex-chtml.js", "input/tex/extensions", "output/chtml/fonts"):
        target = static / "mathjax" / part
        target.parent.mkdir(parents=True, exist_ok=True)
        if (mathjax / part).is_dir():
            shutil.copytree(mathjax / part, target, dirs_exist_ok=True)
        else:
            shutil.copyfile(mathjax / part, target)
    (static / "plotly.min.js").write_text(get_plotlyjs(), encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Add what the configuration cannot say."""
    app.connect("build-finished", _copy_scripts)
