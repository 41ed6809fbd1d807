"""Formulas as MathML, which browsers draw themselves: no script and no font from a network."""

from __future__ import annotations

import re
import unicodedata

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

# Browsers know letters of other alphabets by their characters alone, not by `mathvariant`.
LETTER = re.compile(r'<mi mathvariant="(script|sans-serif|bold|double-struck)">([A-Za-z])</mi>')
ALPHABET = {
    "script": "SCRIPT",
    "sans-serif": "SANS-SERIF",
    "bold": "BOLD",
    "double-struck": "DOUBLE-STRUCK",
}
# A function's name stands apart from a letter or number after it, not from a bracket.
FUNCTION = re.compile(
    r"(<mi>(?:ln|log|exp|sin|cos|tan|cot|sinh|cosh|arccos)</mi>)(?=<m(?:i|n|sub|sup|subsup|over|frac|row)\b)"
)
# Fonts without mathematics draw a raised prime small and far above its letter.
PRIME = re.compile(r"<msup>((?:(?!<msup>).)*?)<mi>&#x02032;</mi></msup>")


def _letter(found: re.Match[str]) -> str:
    case = "CAPITAL" if found[2].isupper() else "SMALL"
    name = f"{ALPHABET[found[1]]} {case} {found[2].upper()}"
    try:
        return f"<mi>{unicodedata.lookup(f'MATHEMATICAL {name}')}</mi>"
    except KeyError:
        # A dozen letters are older than their alphabet.
        return f"<mi>{unicodedata.lookup(name)}</mi>"


def mathml(formula: str, display: str = "inline") -> str:
    """A formula of LaTeX as MathML."""
    written = LETTER.sub(_letter, convert(formula, display=display))
    written = PRIME.sub(r'<mrow>\1<mo lspace="0" rspace="0">&#x02032;</mo></mrow>', written)
    return FUNCTION.sub(r'\1<mspace width="0.17em"/>', written)


def _inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def _block(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="formula">{mathml(node.astext(), "block")}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer; `html_math_renderer = "mathml"` takes it."""
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
