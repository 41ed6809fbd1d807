"""Rows that sum up a table: means, deviations, counts, by the word that they begin with.

Words that may be a name too (`SE`, `Max`, `n`) count in the last rows, where their numbers are such
as the word says, and beside a row that sums up for certain. Of any other word that stands alone in
a column of numbers the numbers of its row decide, in the last rows and the first.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from typing import Annotated

import numpy as np

from fitball.base.errors import Fault
from fitball.base.values import BoolArray, FloatArray
from fitball.data.cells import ABSENT, TableCells
from fitball.data.deviations import with_deviation
from fitball.data.records import NUMBER

# Words that begin no impact; case, accents, signs and blanks make no difference.
_CERTAIN = """
    mean|means|average|averages|avg|median|standard deviation|std dev|std deviation|std
    |stdev|stdev s|stdev p
    |standard error|std error|std err|stderr|sem|standard error of the mean|mean sd|mean std
    |variance|coefficient of variation|coeff of variation|coeff var|rsd|relative sd|rel sd
    |relative standard deviation|rms|quartile|percentile
    |mittelwert|mittelwerte|mittel|durchschnitt|standardabweichung|standard abweichung|stabw|stabwn
    |stdabw|standardfehler|stdfehler|varianz|variationskoeffizient|rel stabw
    |moyenne|moyennes|mediane|ecart type|ecart types|ecarttype|erreur type|erreur standard
    |coefficient de variation
    |media|promedio|mediana|desviacion estandar|desviacion tipica|desv est|desv estandar|desv tip
    |desvest|error estandar|error tipico|varianza|coeficiente de variacion
    |deviazione standard|dev st|dev std|scarto tipo|scarto quadratico medio|errore standard
    |coefficiente di variazione
    |desvio padrao|desvpad|erro padrao|variancia
    |gemiddelde|gemiddeld|standaarddeviatie|standaardafwijking|stdafw|standaardfout|mediaan
    |variantie|variatiecoefficient
    |medelvarde|medel|standardavvikelse|gennemsnit|middelværdi|standardafvigelse|gjennomsnitt
    |standardavvik
    |srednia|odchylenie standardowe|odch std|prumer|smerodatna odchylka
    |keskiarvo|keskihajonta|ortalama|standart sapma
    |среднее|среднее значение|стандартное отклонение|ст откл|медиана
    |平均|平均值|标准差|标准偏差|標準偏差|標準差|中位数|평균|표준편차
"""
# Short words for a spread, a count, an end, a sum and a mean.
_SPREADS = (
    "sd|se|cv|s|sigma|\N{GREEK SMALL LETTER SIGMA}|ci|var|uncertainty|error|fehler|erreur|"
    "incertitude|unsicherheit|±|ki|95ci|95ki|ci95|ki95|confidence interval|konfidenzintervall|"
    "intervalle de confiance"
)
_COUNTS = "n|count|number|anzahl|effectif|nombre|cuenta|numero|aantal|antal|#"
_LEAST = "min|minimum"
_MOST = "max|maximum"
_SUMS = "sum|total|summe|gesamt|somme|suma|somma|totale|range|spannweite|etendue|rango"
_MEANS = "m|mw|mv|moy|med|x̄|x̅|ø|μ|all|alle|tous|todos"
# A remark in brackets, or what is behind a sign, as in `Mean (n = 6)` and `Mean ± SD`.
_REMARK = re.compile(r"[\[({].*|[=:].*|(?<=\w)\s*±.*")
# Rows by which numbers of a row may be judged.
_LEAST_ROWS = 3
# A spread is less than this share of the least number of its column,
_SPREAD_SHARE = 0.6
# and a mean, as it is printed, this much of the range of its column from the computed one.
_ROUNDED = 0.05
# An error that no word names is less than this share of the usual number of its column.
_ERROR_SHARE = 0.1
# Largest chance that a number of an impact is a mean of its column, by the last digit.
_LARGEST_CHANCE = 0.02
# Means of rounded numbers, rounded themselves, are off by less than so many halves of a last digit.
_LARGEST_OFF = 2.0
# Share of the columns of numbers that must be as the word says.
_LEAST_SHARE = 0.5
# What a row may be whose word is none of these.
_OF_ANY_WORD = ("error", "computed")
# Rows at the end that are looked at.
_LAST_ROWS = 12


def _plain(text: str) -> str:
    """A word without case, accents, signs and blanks; a sign alone stays."""
    folded = unicodedata.normalize("NFKD", text.casefold())
    letters = re.sub(r"[\W_]+", "", folded)
    return letters or folded.strip()


def _words(alternatives: str) -> frozenset[str]:
    """The words of a list between bars."""
    return frozenset(_plain(word) for word in alternatives.split("|"))


_CERTAIN_WORDS = _words(_CERTAIN)
_MAYBE = {
    "spread": _words(_SPREADS),
    "count": _words(_COUNTS),
    "least": _words(_LEAST),
    "most": _words(_MOST),
    "sum": _words(_SUMS),
    "mean": _words(_MEANS),
}


def sums_up(first: str) -> bool:
    """Whether a row that begins with this cell sums up a table for certain."""
    return _plain(_REMARK.sub("", first)) in _CERTAIN_WORDS


def summary_fault(first: str, number: int, line: int) -> Fault:
    """The fault of a row that sums up a table."""
    words = f"begins with '{first}', as a row that sums up a table; expected impacts: delete it"
    return Fault("summary-row", words, number, line)


def take_out(cells: TableCells) -> None:
    """Take out the rows at both ends of `cells` that probably sum up the table; each is a fault."""
    _take_out_last(cells)
    _take_out_odd(cells)


def _take_out_last(cells: TableCells) -> None:
    """Take out the last rows that begin with a word for it; each is a fault."""
    count = len(cells.rows)
    start = count
    while start and count - start < _LAST_ROWS and _kind(_first_filled(cells, start - 1)):
        start -= 1
    if start == count:
        return
    certain = {fault.row for fault in cells.faults if fault.code == "summary-row"}
    table = [cells.text(k) for k in range(len(cells.names))]
    for first in range(start, count):
        number = int(cells.rows[first])
        beside = not certain.isdisjoint({number - 1, number + 1})
        # Rows below one that sums up do so too.
        if beside or _is_such(_kind(_first_filled(cells, first)), table, first):
            _take_out(cells, first)
            return


def _take_out_odd(cells: TableCells) -> None:
    """Take out the last rows, and the first one, that have a text in a column of numbers and such
    numbers as rows that sum up the others; each is a fault.
    """
    count = len(cells.rows)
    run = count
    while run > max(_LEAST_ROWS, count - _LAST_ROWS) and _odd_text(cells, run - 1):
        run -= 1
    first = 1 if run > _LEAST_ROWS and _odd_text(cells, 0) and _sums_up_others(cells, 0, run) else 0
    odd = (index for index in range(run, count) if _sums_up_others(cells, index, run))
    start = next(odd, count)
    for index in (*range(first), *range(start, count)):
        words = f"read '{_odd_text(cells, index)}' and numbers as of a row that sums up a table"
        line = 0 if cells.lines is None else int(cells.lines[index])
        words = f"{words}; expected impacts: delete it"
        cells.add(Fault("summary-row", words, int(cells.rows[index]), line))
    _keep(cells, slice(first, start))


def _sums_up_others(cells: TableCells, index: int, end: int) -> bool:
    """Whether the numbers of a row are such as of one that sums up the others before `end`."""
    table = list[list[str]]()
    for k in range(len(cells.names)):
        texts = cells.text(k)
        others = texts[1:end] if index == 0 else texts[:end]
        table.append([*others, texts[index]])
    last = len(table[0]) - 1
    return any(_is_such(kind, table, last) for kind in _OF_ANY_WORD)


def _odd_text(cells: TableCells, index: int) -> str:
    """The first text of a row in a column of which only the last rows have others; empty where
    there is none.
    """
    for column in cells.columns:
        text = str(column[index])
        if column.dtype.kind != "T" or not _is_text(text):
            continue
        others = column[1:] if index == 0 else column[:index]
        last = max(len(others) - _LAST_ROWS, _LEAST_ROWS)
        while len(others) > last and index and _is_text(str(others[-1])):
            others = others[:-1]
        if not any(map(_is_text, others.tolist())):
            return text
    return ""


def _is_text(cell: str) -> bool:
    """Whether a cell is neither empty, nor a number, with a standard deviation or without."""
    is_absent = cell.strip().casefold() in ABSENT
    return not (is_absent or NUMBER.fullmatch(cell.replace(",", ".")) or with_deviation(cell))


def _take_out(cells: TableCells, first: int) -> None:
    """Take out the rows from this index on; each is a fault."""
    for index in range(first, len(cells.rows)):
        line = 0 if cells.lines is None else int(cells.lines[index])
        cells.add(summary_fault(_first_filled(cells, index), int(cells.rows[index]), line))
    _keep(cells, slice(first))


def _keep(cells: TableCells, rows: slice) -> None:
    """Keep these rows only."""
    cells.rows = cells.rows[rows]
    cells.columns = [column[rows] for column in cells.columns]
    if cells.lines is not None:
        cells.lines = cells.lines[rows]


def _first_filled(cells: TableCells, index: int) -> str:
    """The first cell of a row that is not empty."""
    texts = (str(column[index]) for column in cells.columns)
    return next(filter(None, texts), "")


def _kind(first: str) -> str:
    """What a row that begins with this cell may be: a kind of `_MAYBE`, or ""."""
    word = _plain(_REMARK.sub("", first))
    return next((kind for kind, words in _MAYBE.items() if word in words), "")


def _is_such(kind: str, table: Sequence[Sequence[str]], index: int) -> bool:
    """Whether the numbers of the row of this `index` are a spread, count, end, sum or mean (`kind`)
    of the rows above it.
    """
    if index < _LEAST_ROWS:
        return False
    numbers = [_floats(column[: index + 1]) for column in table]
    shown = [column for column in numbers if np.isfinite(column[[0, -1]]).all()]
    if not shown:
        return False
    above, row = np.array(shown)[:, :-1], np.array([column[-1] for column in shown])
    if kind in _OF_ANY_WORD:
        return _as_any_word(kind, above, row)
    return float(_as_kind(kind, above, row).mean()) > _LEAST_SHARE


def _as_kind(
    kind: str, above: Annotated[FloatArray, "columns rows"], row: Annotated[FloatArray, "columns"]
) -> Annotated[BoolArray, "columns"]:
    """Whether each number of a row is such as its kind says of the rows above it."""
    size = np.nanmax(above, axis=1) - np.nanmin(above, axis=1)
    answers = {
        "spread": np.abs(row) < _SPREAD_SHARE * np.nanmin(np.abs(above), axis=1),
        "count": (row == row[0]) & (row == np.round(row)),
        "least": row == np.nanmin(above, axis=1),
        "most": row == np.nanmax(above, axis=1),
        "sum": np.abs(row) > np.nanmax(np.abs(above), axis=1),
        "mean": np.abs(row - np.nanmean(above, axis=1)) < _ROUNDED * size,
    }
    return np.asarray(answers[kind])


def _as_any_word(
    kind: str, above: Annotated[FloatArray, "columns rows"], row: Annotated[FloatArray, "columns"]
) -> bool:
    """Whether the numbers of a row are errors of those above it, or computed from them: their means
    or standard deviations, as these are rounded, which hardly happens by chance.
    """
    if kind == "error":
        usual = np.nanmedian(np.abs(above), axis=1)
        return bool(np.all(np.abs(row) < _ERROR_SHARE * usual))
    size = np.nanmax(above, axis=1) - np.nanmin(above, axis=1)
    varies = size > 0.0
    rounding = np.array([0.5 * 10.0 ** -_decimals(number) for number in row.tolist()])
    chances = 2.0 * _LARGEST_OFF * rounding[varies] / size[varies]
    if not chances.size or chances.max() > _LARGEST_CHANCE:
        return False
    mean = np.nanmean(above, axis=1)
    spreads = [np.nanstd(above, axis=1), np.nanstd(above, axis=1, ddof=1)]
    off = np.abs(np.array([mean, *spreads]) - row)[:, varies]
    return bool((off <= _LARGEST_OFF * rounding[varies]).all(axis=1).any())


def _decimals(number: float) -> int:
    """The decimals of a number as it is printed in the fewest digits."""
    return len(f"{number:.10f}".rstrip("0").partition(".")[2])


def _floats(cells: Sequence[str]) -> FloatArray:
    """Numbers (rows,) of cells, NaN where one is none; decimal commas count."""
    texts = [cell.replace(",", ".") for cell in cells]
    return np.array([float(text) if NUMBER.fullmatch(text) else np.nan for text in texts])
