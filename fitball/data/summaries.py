"""Rows that sum up a table: means, deviations, counts, by the word that they begin with.

Words that may be a name too (`SE`, `Max`, `n`) count in the last rows, where their numbers are such
as the word says, and beside a row that sums up for certain.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from typing import Annotated

import numpy as np

from fitball.base.errors import Fault
from fitball.base.values import BoolArray, FloatArray
from fitball.data.cells import TableCells
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
# A remark in brackets, or a number behind a sign, as in `Mean (n = 6)`.
_REMARK = re.compile(r"[\[({].*|[=:].*")
# Rows by which numbers of a row may be judged.
_LEAST_ROWS = 3
# A spread is less than this share of the least number of its column,
_SPREAD_SHARE = 0.6
# and a mean, as it is printed, this much of the range of its column from the computed one.
_ROUNDED = 0.05
# Share of the columns of numbers that must be as the word says.
_LEAST_SHARE = 0.5
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


def take_out_last(cells: TableCells) -> None:
    """Take out the last rows of `cells` that probably sum up the table; each is a fault."""
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


def _take_out(cells: TableCells, first: int) -> None:
    """Take out the rows from this index on; each is a fault."""
    for index in range(first, len(cells.rows)):
        line = 0 if cells.lines is None else int(cells.lines[index])
        cells.add(summary_fault(_first_filled(cells, index), int(cells.rows[index]), line))
    cells.rows = cells.rows[:first]
    cells.columns = [column[:first] for column in cells.columns]
    if cells.lines is not None:
        cells.lines = cells.lines[:first]


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
    is_such = _as_kind(kind, np.array(shown)[:, :-1], np.array([column[-1] for column in shown]))
    return float(is_such.mean()) > _LEAST_SHARE


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


def _floats(cells: Sequence[str]) -> FloatArray:
    """Numbers (rows,) of cells, NaN where one is none; decimal commas count."""
    texts = [cell.replace(",", ".") for cell in cells]
    return np.array([float(text) if NUMBER.fullmatch(text) else np.nan for text in texts])
