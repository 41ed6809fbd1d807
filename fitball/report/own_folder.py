"""Commands that name the folder of the result that proposes them: filled in once it is known."""

import re

# What stands for the folder of a fit, and before the name of a file in the folder of a result.
FIT = "FIT"
FOLDER = "FOLDER"
_OF_FIT = re.compile(rf"\b{FIT}(?=\s+--target)")
_OF_FILE = re.compile(rf"\b{FOLDER}/(?=(?:impacts|positions)\.csv)")


def filled(text: str, folder: str) -> str:
    """A text with the folder, as a shell reads it, in its commands."""
    # Not as a template of re.sub, in which the backslashes of a path mean something else.
    text = _OF_FIT.sub(lambda _: folder, text)
    return _OF_FILE.sub(lambda _: f"{folder}/", text)


def beside(page: str) -> str:
    """A page with commands that are run in its own folder."""
    return _OF_FILE.sub("", _OF_FIT.sub(".", page))
