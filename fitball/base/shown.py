"""Frames as people see them where a value stands alone: a title and a table, in text or HTML."""

from __future__ import annotations

from html import escape

import numpy as np

from fitball.base.text import visible
from fitball.base.values import DataFrame

# Digits of a number: what is shown is for reading, and the object has them all.
_DIGITS = 4


def as_text(title: str, frame: DataFrame) -> str:
    """A title, and below it a frame with a row a name, numbers rounded."""
    return f"{title}\n{_rounded(frame).to_string()}"


def as_html(title: str, frame: DataFrame) -> str:
    """The same for a notebook; texts of users are escaped."""
    return f"<p>{escape(visible(title))}</p>{_rounded(frame).to_html(border=0)}"


def _rounded(frame: DataFrame) -> DataFrame:
    """The cells of a frame as texts; empty for NaN and None."""
    return frame.rename(index=visible).map(_cell)


def _cell(value: object) -> str:
    """A number with _DIGITS digits, or a text."""
    if value is None:
        return ""
    if isinstance(value, float | np.floating):
        return f"{value:.{_DIGITS}g}" if np.isfinite(value) else ""
    return visible(str(value))
