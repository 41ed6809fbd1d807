"""Symbols of parameters as a page shows them, from the mathtext that figures use."""

from __future__ import annotations

import re
import unicodedata

from markupsafe import Markup, escape

from fitball.report.form.document import Cell

# A command, a brace, a mark of height, or one character.
_TOKEN = re.compile(r"\\[A-Za-z]+|[{}^_]|.")
_TAGS = {"_": "sub", "^": "sup"}
# Commands that are not the name of a Greek letter; of the two epsilons figures use the curly one.
_LETTERS = {"\\mathrm": "", "\\varepsilon": "\u03b5", "\\nu": "\u03bd"}


def symbol_cell(mathtext: str) -> Cell:
    """A symbol for a page; for who has no such letters nothing."""
    return Cell("", symbol_html(mathtext))


def symbol_html(mathtext: str) -> Markup:
    """Letters, Greek letters, indices and powers of `mathtext` as HTML; the empty text stays empty.

    Raises ValueError for a command it does not know.
    """
    tokens = _TOKEN.findall(mathtext.replace("$", "").replace(" ", ""))
    made = _group(tokens)
    if tokens:
        raise ValueError(f"{mathtext}: a brace too many")
    return made


def _group(tokens: list[str]) -> Markup:
    """Everything up to the brace that closes, which is taken too."""
    made = Markup("")
    while tokens and tokens[0] != "}":
        made += _one(tokens)
    if tokens and tokens[0] == "}":
        tokens.pop(0)
    return made


def _one(tokens: list[str]) -> Markup:
    """The next letter, group or index."""
    token = tokens.pop(0)
    if token in _TAGS:
        return Markup("<{0}>{1}</{0}>").format(Markup(_TAGS[token]), _one(tokens))
    if token == "{":
        return _group(tokens)
    if token == "'":
        return Markup("\u2032")
    return escape(_letter(token) if token.startswith("\\") else token)


def _letter(command: str) -> str:
    """The character that a command stands for."""
    if command in _LETTERS:
        return _LETTERS[command]
    try:
        return unicodedata.lookup(f"GREEK SMALL LETTER {command[1:].upper()}")
    except KeyError:
        raise ValueError(f"{command}: no such letter") from None
