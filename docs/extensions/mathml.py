"""Formulas as MathML, which browsers set themselves: no script, no font and no network, and a formula that is
no LaTeX is a warning of the build."""

from docutils import nodes
from math_core import LatexError, LatexToMathML
from sphinx.util import logging

LATEX = LatexToMathML()
LOGGER = logging.getLogger(__name__)


def written(node, display: bool) -> str:
    """The formula of a node as MathML; lines that are aligned, or broken, are one block."""
    latex = node.astext().strip()
    if display and r"\begin" not in latex and (r"\\" in latex or "&" in latex):
        latex = rf"\begin{{aligned}}{latex}\end{{aligned}}"
    try:
        return LATEX.convert_with_local_state(latex, displaystyle=display)
    except LatexError as error:
        LOGGER.warning("no formula: %s: %s", latex, error, location=node)
        return ""


def inline(writer, node):
    """Puts a formula into a line."""
    writer.body.append(written(node, display=False))
    raise nodes.SkipNode


def block(writer, node):
    """Puts a formula on a line of its own."""
    writer.body.append(f'<div class="math">{written(node, display=True)}</div>\n')
    raise nodes.SkipNode


def setup(app):
    """Offers the renderer to Sphinx."""
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
