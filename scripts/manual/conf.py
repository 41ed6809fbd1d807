"""Settings of Sphinx for the manual, which `scripts/manual/build.py` lays out.

Nothing that a page needs comes from another host: the theme has no fonts of its own, and equations
are MathML, which browsers draw without a script.
"""

import inspect
import re
from typing import Any

import latex2mathml.converter
from docutils import nodes
from pygments.lexers import TextLexer
from sphinx.application import Sphinx

import fitball

project = "fitball"
author = "The fitball authors"
copyright = author
version = release = fitball.__version__

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "index"
nitpicky = False
highlight_language = "none"

myst_enable_extensions = ["dollarmath"]
# Depth of headings that links may lead to.
myst_heading_anchors = 4
myst_dmath_double_inline = True

# Names in single backticks are code.
default_role = "code"
autodoc_typehints = "signature"
autodoc_member_order = "bysource"
napoleon_use_rtype = False
python_maximum_signature_line_length = 80
python_use_unqualified_type_names = True

html_theme = "furo"
html_title = f"fitball {version}"
html_static_path = ["_static"]
html_css_files = ["manual.css"]
html_show_sphinx = False
html_copy_source = False
html_show_copyright = False
html_theme_options = {"navigation_with_keys": True}

# The placeholder of an argument, as the command line shows it: `data (DATA ...): tables`.
_PLACEHOLDER = re.compile(r"^(\s+\w+) \([^:]*\):")
# A star that is neither in backticks nor in an example, where Sphinx would read emphasis.
_STAR = re.compile(r"\*(?=[^`]*(?:`[^`]*`[^`]*)*$)")
# A function such as ln before its argument without brackets, which want a thin space between.
_FUNCTION = re.compile(r"(<mi>(?:ln|sin|cos|tan|cot|exp)</mi>)(?=<m(?:i|n|sub|sup|frac)>)")


def plain_docstring(
    app: Sphinx,
    what: str,
    name: str,
    obj: object,
    options: object,
    lines: list[str],
) -> None:
    """Change a docstring for readers of Python in place: no placeholders of the command line, whose
    examples become a block.
    """
    in_commands = False
    written = []
    for line in lines:
        if line.strip() == "Command line:":
            in_commands = True
            written += [".. rubric:: Command line", "", ".. code-block:: sh", ""]
        elif in_commands or line.lstrip().startswith((">>>", "...")):
            written.append(line)
        else:
            words = _PLACEHOLDER.sub(r"\1:", line) if inspect.isfunction(obj) else line
            written.append(_STAR.sub(r"\*", words))
    lines[:] = written


def mathml(translator: Any, latex: str, display: str) -> None:
    """Append an equation to a page."""
    equation = latex2mathml.converter.convert(latex, display=display)
    translator.body.append(_FUNCTION.sub(r'\1<mspace width="0.17em"/>', equation))


def inline_mathml(translator: Any, node: nodes.math) -> None:
    """Write an equation within a sentence.

    Raises:
        nodes.SkipNode: always; the node is written.
    """
    mathml(translator, node.astext(), "inline")
    raise nodes.SkipNode


def display_mathml(translator: Any, node: nodes.math_block) -> None:
    """Write an equation that stands by itself.

    Raises:
        nodes.SkipNode: always; the node is written.
    """
    translator.body.append('<div class="equation">')
    mathml(translator, node.astext(), "block")
    translator.body.append("</div>")
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Tell Sphinx of equations, languages of blocks and docstrings."""
    # Napoleon comes after it.
    app.connect("autodoc-process-docstring", plain_docstring, priority=400)
    app.add_html_math_renderer(
        "mathml",
        inline_renderers=(inline_mathml, None),
        block_renderers=(display_mathml, None),
    )
    app.add_lexer("csv", TextLexer)


html_math_renderer = "mathml"
