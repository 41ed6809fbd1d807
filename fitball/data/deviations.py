"""Cells of a number with its standard deviation: `5.2 ± 0.3`, `5.2 ± 6 %`, and the concise notation
of the GUM (JCGM 100:2008, 7.2.2), `5.2(3)`, whose digits in brackets are those of the last digits.
"""

from __future__ import annotations

import re
from typing import NamedTuple

# What a cell has that may be of this kind.
DEVIATION_SIGNS = "±+("
# A number with its standard deviation.
_PLUS_MINUS = re.compile(r"([^±]*?\S)\s*(?:±|\+/-|\+-)\s*([^±+\-\s].*)", re.DOTALL)
# A number with the standard deviation of its last digits, or with all of it, in brackets.
_CONCISE = re.compile(
    r"(?=[+-]?[.,]?[0-9])(?P<value>[+-]?[0-9]*(?:(?P<sign>[.,])(?P<decimals>[0-9]*))?)"
    r"\((?P<digits>[0-9]+)(?P<rest>[.,][0-9]*)?\)(?:[eE](?P<power>[+-]?[0-9]{1,3}))?"
)
# A share of the number.
_PERCENT = re.compile(r"(?P<number>.*[0-9.,])\s*%", re.DOTALL)


class Deviating(NamedTuple):
    """The texts of a number and of its standard deviation, in per cent of the number or not."""

    value: str
    deviation: str
    is_percent: bool = False


def with_deviation(text: str) -> Deviating | None:
    """What a cell says of a number and its standard deviation; None of another cell."""
    if match := _CONCISE.fullmatch(text):
        power = int(match["power"] or 0)
        behind = f"e{power}" if power else ""
        value = f"{match['value']}{behind}"
        if match["rest"]:
            return Deviating(value, f"{match['digits']}{match['rest']}{behind}")
        return Deviating(value, f"{match['digits']}e{power - len(match['decimals'] or '')}")
    pair = _PLUS_MINUS.fullmatch(text)
    if pair is None:
        return None
    percent = _PERCENT.fullmatch(pair[2])
    if percent is None:
        return Deviating(pair[1], pair[2])
    return Deviating(pair[1], percent["number"], is_percent=True)
