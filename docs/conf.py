"""How Sphinx makes a site of these pages: `python -m sphinx -W --keep-going -n docs build/site`.

Nothing of the site comes from the network: formulas are MathML, fonts are the system's.  The pages in which a model moves are
written into the site by `tensegrity_core.view`; `-t plain` leaves them out, where links and words alone are checked.
"""

from __future__ import annotations

import re
from pathlib import Path

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging

import tensegrity_core as tc

project = "Tensegrity dynamics as FMUs"
author = "the tensegrity-fmu contributors"
version = release = tc.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx_copybutton"]
exclude_patterns: list[str] = []
root_doc = "index"
default_role = "literal"

myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
myst_links_external_new_tab = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
#: Types of other packages, whose pages a site without network does not know.
nitpick_ignore_regex = [
    ("py:.*", r"(np|numpy|pd|pandas|xr|xarray|pathlib|collections|dataclasses)\..*"),
    ("py:.*", r"(Path|Any|Mapping)"),
]

html_theme = "furo"
html_title = project
html_static_path = ["site"]
html_favicon = "site/icon.svg"
html_css_files = ["site.css"]
html_math_renderer = "mathml"
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
copybutton_exclude = ".linenos, .gp, .go"

linkcheck_timeout = 20
linkcheck_retries = 2

log = logging.getLogger(__name__)


#: Accents of MathML as letters that combine with the one before: most browsers have no font that sets the former.
COMBINING = {"\u00a8": "\u0308", "\u02c6": "\u0302", "\u02d9": "\u0307"}
ACCENTED = re.compile(r'<mover accent="true">\s*<mi>(\w)</mi>\s*<mo stretchy="false">(.)</mo>\s*</mover>')


def mathml(text: str, as_block: bool = False) -> str:
    """A formula of LaTeX's as MathML."""
    written = latex2mathml.tex2mathml(text, as_block)
    return ACCENTED.sub(lambda found: f'<mi class="accented">{found[1]}{COMBINING[found[2]]}</mi>', written)


def visit_formula(self, node: nodes.math) -> None:
    """A formula in a line, as MathML."""
    self.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def visit_equation(self, node: nodes.math_block) -> None:
    r"""A formula of its own; the number that \tag{11} gives it stands at the right."""
    text, number = node.astext(), ""
    if tag := re.search(r"\\tag\{([^}]*)\}", text):
        text, number = text.replace(tag[0], ""), f'<span class="equation-number">({tag[1]})</span>'
    self.body.append(f'<div class="equation">{mathml(text, as_block=True)}{number}</div>\n')
    raise nodes.SkipNode


def as_written(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstrings are plain text: a bar is one of |x|, a star one of a product."""
    lines[:] = [re.sub(r"([|*])", r"\\\1", line) for line in lines]


def write_live_pages(app: Sphinx) -> None:
    """The pages in which a model moves, into the site's folder live/."""
    if app.builder.format != "html" or app.tags.has("plain"):
        return
    folder = Path(app.outdir) / "live"
    folder.mkdir(parents=True, exist_ok=True)
    log.info("writing the pages in which a model moves ... ")
    for name in ("three_bar_nsh", "six_bar_nsh"):
        tc.view(name, folder / f"{name}.html")
    pull = {f"{node}.force.z": ([0.0, 2.8, 2.8, 5.0], [0.0, 64.0, 0.0, 0.0]) for node in ("n10", "n11", "n12")}
    light = tc.load("six_bar_nsh", {"materials.cable.damping": 50.0})  # so that the release is seen to swing
    tc.view(tc.simulate(light, pull, duration=5.0, step=0.02, tolerance=1e-6), folder / "six_bar_pulled.html")


def setup(app: Sphinx) -> dict[str, bool]:
    """What Sphinx calls."""
    app.add_html_math_renderer("mathml", (visit_formula, None), (visit_equation, None))
    app.connect("autodoc-process-docstring", as_written)
    app.connect("builder-inited", write_live_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
