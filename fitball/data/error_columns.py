"""Columns of errors by the names that people give them: `v_y2_err`, `u(v_y2)`, `error [%]`.

A name is taken apart into that of a column and words that say what kind of error it is. What is one
standard deviation, or a share of the value, is read as `NAME_sd`; other forms are refused by name.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import TypeAlias

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.errors import ParameterError
from fitball.base.text import listed
from fitball.base.units import factor_of, symbol_of
from fitball.data.cells import TableCells

# Our name of a column of numbers by its name without blanks and signs, None where it is none.
Known: TypeAlias = Callable[[str], str | None]

# Words of names of errors by what they mean; those of one letter, or that mean a difference too,
# count only before a name, and if the numbers are small.
_LEXICON = {
    "error": "err error errors fehler messfehler unsicherheit messunsicherheit unc uncert "
    "uncertainty uncertainties incertitude incertidumbre incertezza incerteza onzekerheid erreur "
    "errore erro fout sd std stdev stddev stdabw standarddeviation standardabweichung ecarttype "
    "desvest desviacionestandar deviazionestandard stderr stderror standarderror se sem "
    "standardfehler erreurtype sigma pm standarduncertainty deviation sdev",
    "maybe": "d δ delta s u",
    "percent": "% percent pct prozent pourcent porcentaje procent perc",
    "relative": "rel relative relativ relativer relativerfehler cv rsd",
    "side": "lo low lower hi high upper minus plus neg pos down up unten oben",
    "end": "q025 q975 q16 q84 p16 p84 p025 p975 cilow cihigh cilo cihi cilower ciupper",
    "variance": "var variance varianz",
    "expanded": "u95 expanded ci ci95 95ci 95 2sigma 2sd 3sigma k2 confidence accuracy tolerance",
    "filler": "of in the de der des du di del da von abs absolute absolut standard 1 k1 measured "
    "measurement combined estimated est stat",
}
_WORDS = {word: kind for kind, words in _LEXICON.items() for word in words.split()}
# Words of one side that are errors without saying so, if both sides are there.
_ENDS = frozenset(["lo", "low", "lower", "hi", "high", "upper"])
# What stands in brackets.
_BRACKET = re.compile(r"\[([^\[\]]*)\]")
# Longest name that is taken apart: the work grows with its square.
_MOST_CHARACTERS = 60
# Words besides the name of the column.
_MOST_WORDS = 5
# What `d`, `s` or `u` before a name means is an error where it is this share of the value at most.
_MOST_SHARE = 0.5
# Stands for the column of errors with a number, as of `err_2`: which one it is stays open.
_NUMBERED = "?"
# Percent in which no error is stated: a column of them has other numbers.
_MOST_PERCENT = 100.0
# Columns of errors that a note names.
_NAMED = 8


@dataclass(frozen=True)
class _ErrorName:
    """Our name of a column, empty where the name says none, and the kinds of words about it."""

    base: str
    kinds: frozenset[str]
    words: frozenset[str]


@dataclass
class ErrorColumns:
    """What columns of errors are, by index: our `names`, and `units` where they are not those that
    the header states. `refused` has what is wrong with the errors of a column by its name,
    `NAME_sd`; `unread` are indices of columns that speak of errors, of no column that is there.
    """

    names: dict[int, str] = field(default_factory=dict)
    units: dict[int, str] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    unread: list[int] = field(default_factory=list)


def error_columns(
    cells: TableCells,
    parts: Sequence[tuple[str, str | None]],
    ours: Sequence[str | None],
    known: Known,
) -> ErrorColumns:
    """The columns of errors among those that are none of `ours`. `parts` are name and unit of each
    column, `known` says our name of another's. What is read is noted (`errors-read`).
    """
    errors = ErrorColumns()
    sides: dict[str, list[tuple[int, bool]]] = {}
    for index, (name, unit) in enumerate(parts):
        error = _error_name(name, known) if ours[index] is None else None
        if error is None:
            continue
        base = error.base or _left_of(index, ours)
        column = f"{base}_sd"
        form = _form(error, unit)
        if base not in ours or column in ours or column in errors.names.values():
            form = "unread" if form else ""
        if form in ("side", "end"):
            sides.setdefault(column, []).append((index, form == "side"))
        elif form in _REFUSED:
            errors.refused[column] = f"'{cells.names[index]}' {_REFUSED[form]}"
        elif form in ("sd", "share") and _are_errors(
            cells, index, (base, ours.index(base)), error, unit
        ):
            errors.names[index] = column
            if form == "share" and unit is None:
                errors.units[index] = "%"
        elif form and cells.begins_with_numbers(index):
            errors.unread.append(index)
    for column, ends in sides.items():
        if len(ends) > 1 or any(certain for _, certain in ends):
            named = listed(f"'{cells.names[index]}'" for index, _ in ends)
            errors.refused[column] = f"{named} {_REFUSED['side']}"
    if errors.names:
        named = listed(
            (f"'{cells.names[k]}' as {column}" for k, column in errors.names.items()), most=_NAMED
        )
        cells.note("errors-read", f"read as standard deviations: {named}")
    return errors


# What is wrong with errors that are no standard deviation, and what to do.
_REFUSED = {
    "side": "state errors of one side; expected one standard deviation: write {column}, such as "
    "half of both together",
    "variance": "states a variance; expected a standard deviation: write its square root as "
    "{column}",
    "expanded": "states an expanded error; expected one standard deviation: write {column}, half "
    "of an error for 95 %",
    "relative": "states a relative error without a unit; expected [%] or [1] behind the name",
}


def refusal_of_error(column: str, words: str) -> str:
    """The words of `ErrorColumns.refused` with the column that is to be written, or ignored."""
    remedy = words.replace("{column}", column)
    return f"{remedy}, or leave it out (--ignore {column})"


def _left_of(index: int, ours: Sequence[str | None]) -> str:
    """Our name of the quantity left of a column, empty where none is."""
    name = ours[index - 1] if index else None
    return name if name is not None and name in COLUMNS else ""


def _form(error: _ErrorName, unit: str | None) -> str:
    """What a column of errors states: `sd`, a `share` of the value, a `side` of it or the `end` of
    an interval, or another key of `_REFUSED`; empty if it states none.
    """
    kinds = error.kinds
    says_error = not kinds.isdisjoint({"error", "maybe", "relative", "expanded"})
    is_relative = "relative" in kinds and unit not in ("1", "-", "")
    form = "sd" if says_error else ""
    if "variance" in kinds:
        form = "variance"
    elif kinds & {"side", "end"}:
        form = "end" if "end" in kinds or error.words & _ENDS else ""
        if says_error:
            form = "side"
        form = form if error.base else ""
    elif "expanded" in kinds:
        form = "expanded"
    elif says_error and ("percent" in kinds or unit == "%"):
        form = "share"
    elif "relative" in kinds:
        form = "relative" if is_relative else "share"
    return form


def _are_errors(
    cells: TableCells,
    index: int,
    base: tuple[str, int],
    error: _ErrorName,
    unit: str | None,
) -> bool:
    """Whether the numbers of a column may be errors of those of `base`, our name of another and its
    index: none is negative, and where the name leaves a doubt they are positive, of its unit, and
    small.
    """
    errors = cells.plain_numbers(index)
    measured = errors[np.isfinite(errors)]
    if not measured.size or (measured < 0.0).any():
        return False
    is_share = unit == "%" or "percent" in error.kinds
    if is_share and (measured > _MOST_PERCENT).any():
        return False
    if error.base and "error" in error.kinds:
        return True
    column, index_of_base = base
    if (measured <= 0.0).any() or not (is_share or _measures(unit, COLUMNS[column].unit)):
        return False
    values = np.abs(cells.plain_numbers(index_of_base))
    both = np.isfinite(errors) & np.isfinite(values)
    if is_share or not both.any():
        return True
    return bool(np.median(errors[both]) <= _MOST_SHARE * np.median(values[both]))


def _measures(unit: str | None, si: str) -> bool:
    """Whether a unit, or none, is one of the quantity with this unit in SI."""
    try:
        factor_of(unit, si)
    except ParameterError:
        return False
    return True


def says_error(text: str) -> bool:
    """Whether a text, such as one in brackets, says that the numbers are errors."""
    return _WORDS.get(plain_name(text)) == "error"


def _error_name(name: str, known: Known) -> _ErrorName | None:
    """The name of an error taken apart; None where it is no such name."""
    text = plain_name(name)
    if not text or len(text) > _MOST_CHARACTERS:
        return None
    is_expanded = re.match(r"\s*U\s*[(_]", name) is not None and not name.isupper()
    # The second of two columns of one name is NAME.1 in pandas; other numbers say which one.
    first_of_name = plain_name(re.sub(r"\.\d{1,3}$", "", name))
    without_number = re.sub(r"(?<=\D)\d+$", "", text)
    for candidate in dict.fromkeys((first_of_name, text, without_number)):
        taken_apart = _taken_apart(candidate, known)
        if taken_apart is None:
            continue
        base, words = taken_apart
        kinds = {_WORDS[word] for word in words} - {"filler"}
        if is_expanded and words == ("u",):
            kinds = {"expanded"}
        if not base and (candidate != first_of_name or "1" in words):
            base = _NUMBERED
        if kinds and (base in COLUMNS or kinds & {"error", "relative"}):
            return _ErrorName(base, frozenset(kinds), frozenset(words))
    return None


def _taken_apart(text: str, known: Known) -> tuple[str, tuple[str, ...]] | None:
    """Our name of the column in a text, empty where there is none, and the words before and behind
    it; None where something is left over.
    """

    @cache
    def parts(rest: str, depth: int) -> tuple[str, tuple[str, ...]] | None:
        base = known(rest)
        if base is not None or not rest:
            return base or "", ()
        if depth == _MOST_WORDS:
            return None
        for word in _BY_LENGTH:
            is_sign = _WORDS[word] == "maybe"
            if rest.startswith(word):
                inner = parts(rest[len(word) :], depth + 1)
                if inner is not None and not (is_sign and not inner[0]):
                    return inner[0], (word, *inner[1])
            if rest.endswith(word) and not is_sign:
                inner = parts(rest[: -len(word)], depth + 1)
                if inner is not None:
                    return inner[0], (*inner[1], word)
        return None

    return parts(text, 0)


_BY_LENGTH = sorted(_WORDS, key=len, reverse=True)


def plain_name(name: str) -> str:
    """A name without case, accents, blanks and brackets; signs of errors in words."""
    text = _BRACKET.sub(lambda bracket: "" if symbol_of(bracket[1]) else bracket[0], name)
    text = re.sub(r"\+\s*/?\s*[-\u2212\u2013]|±", " pm ", text.casefold())
    text = re.sub(r"^\s*\+|\+\s*\)?\s*$", " plus ", text)
    text = re.sub(r"^\s*[-\u2212\u2013]\s*(?=\w)", " minus ", text)
    text = re.sub(r"(?<=\w)\s*[-\u2212\u2013]\s*$", " minus", text)
    text = text.replace("\N{GREEK SMALL LETTER SIGMA}", "sigma").replace("∆", "δ")
    text = text.replace("θ", "theta").replace("ϑ", "theta").replace("ω", "omega")
    folded = unicodedata.normalize("NFKD", text.translate(str.maketrans("₁₂ₓᵧ", "12xy")))
    return re.sub(r"[^\w%]|_", "", "".join(c for c in folded if not unicodedata.combining(c)))
