"""Rows that sum up the others: below a table, a mean, a maximum or a count of what stands above."""

from __future__ import annotations

import re
import statistics
from collections.abc import Callable, Mapping, Sequence
from math import isfinite, nan

# How rows begin that sum up a table, in English, German and French, and what their numbers are.
_STATISTICS: Mapping[str, Callable[[Sequence[float]], float]] = {
    r"mean|average|avg|mittel(?:wert)?|durchschnitt|moyenne": statistics.fmean,
    r"median": statistics.median,
    r"std\.? ?dev\.?|stdev|std|sd|standardabweichung|[ée]cart[ -]type": statistics.stdev,
    r"sum|total|summe": sum,
    r"min|minimum": min,
    r"max|maximum": max,
    r"count|n": len,
}
# Words that name people, balls and runs too: such a row is one of the table unless its numbers are the statistic.
_NAMES = re.compile(r"(?:min|max|n|sum|sd|std)[.:]?", re.IGNORECASE)

Numbers = Sequence[tuple[float, float]]


def summaries(rows: Sequence[Sequence[str]]) -> dict[int, str]:
    """Places of the rows that sum up the others, and the word by which each begins.

    Where that word may be a name, most numbers of the row are the statistic of their columns to the printed digits.
    """
    begun = {place: word for place, cells in enumerate(rows) if _statistic(word := next(filter(None, cells), ""))}
    if not any(map(_NAMES.fullmatch, begun.values())):
        return begun
    others = [cells for place, cells in enumerate(rows) if place not in begun]
    columns = [
        [number for cells in others if k < len(cells) and (number := _number(cells[k])) is not None]
        for k in range(max((len(rows[place]) for place in begun), default=0))
    ]
    values = {word.casefold(): [_value(word, column) for column in columns] for word in set(begun.values())}
    return {
        place: word
        for place, word in begun.items()
        if not _NAMES.fullmatch(word) or _agrees(rows[place], values[word.casefold()])
    }


def _statistic(word: str) -> Callable[[Sequence[float]], float] | None:
    if len(word) > len("standardabweichung:"):
        return None
    return next((how for words, how in _STATISTICS.items() if re.fullmatch(f"(?:{words})[.:]?", word, re.I)), None)


def _value(word: str, column: Numbers) -> tuple[float, float]:
    """The statistic of a column, and by how much rounding moves it at most."""
    statistic = _statistic(word)
    if statistic is None or len(column) < 2:
        return nan, 0.0
    numbers = [number for number, _half in column]
    terms = len(numbers) if statistic is sum else 1
    return statistic(numbers), terms * max(half for _number, half in column)


def _agrees(cells: Sequence[str], values: Numbers) -> bool:
    found = [(number, value) for cell, value in zip(cells, values, strict=False) if (number := _number(cell))]
    agree = sum(abs(number[0] - value[0]) <= number[1] + value[1] for number, value in found)
    return 2 * agree > len(found)


def _number(cell: str) -> tuple[float, float] | None:
    """A number with a decimal point or comma, and half a unit of its last digit; None for other text."""
    mantissa, _e, power = cell.replace(",", ".").replace("\u2212", "-").lower().partition("e")
    try:
        number = float(f"{mantissa}e{power or 0}")
        half = 0.5 * float(f"1e{int(power or 0) - len(mantissa.partition('.')[2])}")
    except ValueError:
        return None
    return (number, half) if isfinite(number) else None
