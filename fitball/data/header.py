"""A header cell -> our name, unit and role; `--columns`; one guess for an unknown name.

A column is known as it is spelled (`V1 (mph)`, `θ_1 / °`, `v_2_sd`, `corr(v_x1,gap_time)`) or by
the user's names (`--columns "v_1=Vin [mph]"`). A guess is offered, never taken, and never says
incidence for rebound.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from math import nan
from typing import TYPE_CHECKING, NamedTuple

from fitball.base.columns import COLUMNS, OTHER_FORMS
from fitball.base.errors import ParameterError, suggestion
from fitball.base.text import as_pairs, listed
from fitball.base.units import assumed_symbol, factor_of, symbol_of, symbol_within
from fitball.data.error_columns import ErrorColumns, error_columns, plain_name, says_error
from fitball.data.lexicon import (
    MOST_CHARACTERS,
    bare_name,
    end_of,
    guess_of,
    is_unit,
    without_data_set,
    without_unit,
    words_in,
)
from fitball.data.spatial import SPATIAL, spatial_name, with_spatial

if TYPE_CHECKING:
    from fitball.data.cells import TableCells

# Columns of text.
LABELS = ("id", "surface", "ball", "location", "session", "table")
# Columns of numbers, with those of their sds.
NUMBERS = tuple(name + suffix for name in COLUMNS for suffix in ("", "_sd"))
# Those of which a name that is much alike is a slip: `court` is none of `cor`.
_SLIPPING = tuple(name for name in NUMBERS if name.removesuffix("_sd") not in OTHER_FORMS)
# What a name that is probably meant counts for where a header is looked for.
_WORTH_OF_GUESS = 0.5
# How alike two names are if one is a slip of the other: one wrong, missing or exchanged character
# in a name as short as `v_y1`.
_LEAST_LIKENESS = 0.75
# Columns of a table that a message names.
_NAMED_COLUMNS = 20

# `v_1 [m/s]`.
_SQUARE = re.compile(r"(?P<name>[^\[\]]*?)\s*/?\s*\[(?P<unit>[^\[\]]*)\]")
# `v_1 (m/s)`.
_ROUND = re.compile(r"(?P<name>.*?)\s*/?\s*[({](?P<unit>[^(){}]*)[)}]")
# Behind the name: `v_1 / m/s` (ISO 80000), `v_1 in m/s`, `v_1, m/s`, `v_1_mph`.
_GAP = re.compile(r"\s*/\s*|\s+in\s+|\s*[,:;]\s*|[_\s]")
# A component of a velocity in three dimensions: `u_in`.
_UVW = re.compile(r"(?P<letter>[uvw])(?P<rest>(?![a-z]).*)")
# `corr(v_x1,gap_time)`.
_CORR = re.compile(r"\s*corr\(\s*(\w+)\s*,\s*(\w+)\s*\)\s*", re.IGNORECASE)


# Our names by what is left of them without underscores.
_BY_BARE = {bare_name(name): name for name in (*NUMBERS, *LABELS)}
_BY_BARE |= dict.fromkeys(("no", "nr", "#", "number", "impactid", "impactno", "rownames"), "id")


def our_name(name: str) -> str | None:
    """Our name of what differs from it in case, blanks and underscores only; correlations in the
    order of COLUMNS.
    """
    if len(name) > MOST_CHARACTERS:
        return None
    pair = _CORR.fullmatch(name)
    if pair is None:
        return _BY_BARE.get(bare_name(name))
    both = {our_name(their) for their in pair.groups()}
    ends = [column for column in COLUMNS if column in both]
    return f"corr({','.join(ends)})" if len(ends) == 2 else None


class Naming:
    """What the user calls columns, by our name, with the unit or without: `{"v_1": "Vin [mph]"}`.
    Raises ParameterError (`columns`) for a name that is none of ours, and for one of theirs that is
    to be two of ours.
    """

    def __init__(self, columns: Mapping[str, str]) -> None:
        # On one line: a proposal may have been copied from a terminal that folds it.
        self.columns = {ours: " ".join(text.split()) for ours, text in columns.items()}
        self.theirs = dict[str, str]()
        self.units = dict[str, str]()
        for ours, text in self.columns.items():
            if ours not in NUMBERS and ours not in LABELS and ours not in SPATIAL:
                guess = listed(guess_of(ours), "or")
                hint = f"did you mean {guess}?" if guess else suggestion(ours, (*COLUMNS, *LABELS))
                words = f"columns: '{ours}' is no column of fitball ({ours}={text}): {hint}"
                raise ParameterError(words, "columns")
            square = _SQUARE.fullmatch(text)
            their = (square["name"] if square else text).casefold()
            words = f"columns: the name in '{ours}={text}'"
            if not their:
                words = f"{words} is empty; expected NAME or NAME [UNIT]"
                raise ParameterError(words, "columns")
            if their in self.theirs.values():
                raise ParameterError(f"{words} is given for two columns", "columns")
            self.theirs[ours] = their
            if square:
                self.units[ours] = square["unit"]

    def by_user(self, *names: str) -> str | None:
        """Our name of a column that the user calls by one of these."""
        wanted = {" ".join(name.split()).casefold() for name in names}
        return next((ours for ours, their in self.theirs.items() if their in wanted), None)

    def worth(self, cell: str) -> float:
        """What a cell is worth as one of a header: 1 for a name of a column, 0.5 for a text that
        probably means one, 0 for any other.
        """
        if not cell or len(cell) > MOST_CHARACTERS or cell[0] in "0123456789+-.,−":
            return 0.0
        name, _ = self.split(cell)
        if self.by_user(cell, name) or our_name(name):
            return 1.0
        return _WORTH_OF_GUESS if len(guess_of(name)) == 1 else 0.0

    def split(self, cell: str) -> tuple[str, str | None]:
        """Name and unit (None where there is none) of a header cell, without the name of a data set
        before a name of a quantity.
        """
        name, unit = self._parted(cell)
        without = without_data_set(cell)
        if without == cell or self._is_name(name):
            return name, unit
        inner, unit_of_inner = self._parted(without)
        if self.by_user(inner) or our_name(inner) in NUMBERS:
            return inner, unit_of_inner
        return name, unit

    def _parted(self, cell: str) -> tuple[str, str | None]:
        """Name and unit (None where there is none) of a header cell. Square brackets always hold a
        unit; round ones do behind a name of a column, or if a unit is in them; without brackets a
        unit must be one.
        """
        text = cell.strip()
        if len(text) > MOST_CHARACTERS or our_name(text):
            return text, None
        square = _SQUARE.fullmatch(text)
        bracket = _ROUND.fullmatch(text)
        if any(match and says_error(match["unit"]) for match in (square, bracket)):
            return text, None
        if square:
            return square["name"], square["unit"]
        if bracket and (self._is_name(bracket["name"]) or symbol_of(bracket["unit"])):
            return bracket["name"], bracket["unit"]
        for gap in _GAP.finditer(text):
            front = text[: gap.start()]
            unit = text[gap.end() :]
            if gap[0].strip(" _") or self._is_name(front):
                for spelling in (unit, unit.replace("_", "/", 1)):
                    if symbol_of(spelling):
                        return front, spelling
        if self.by_user(text):
            # `Bounce (cm) (tennis ball)`: a unit anywhere, once it is clear that this is a name.
            return text, without_unit(text)[1] or None
        return text, None

    def _is_name(self, text: str) -> bool:
        """Whether this is a name of ours or of the user's."""
        return bool(self.by_user(text) or our_name(text))


@dataclass(frozen=True)
class Header:
    """Places among `Cells.columns` by our names: `numbers` of COLUMNS, NAME_sd and corr(a,b), with
    `factors` to SI (NaN where the unit is a fault) and the symbols of their `units`, stated or
    assumed; `labels` of all others, by their own names where we know none. `guesses` are unknown
    columns by the name that each may mean, as `--columns` takes them, `named` those that the user
    has named in that form. `slips` are unknown columns with the names of ours that they may be
    slips of. `shares` are sds that are shares of their column. `refused_errors` has by NAME_sd what
    is wrong with errors.
    """

    numbers: Mapping[str, int]
    factors: Mapping[str, float]
    units: Mapping[str, str]
    labels: Mapping[str, int]
    guesses: Mapping[str, str]
    shares: Collection[str] = ()
    refused_errors: Mapping[str, str] = field(default_factory=dict)
    unread_errors: Collection[int] = ()
    slips: Mapping[str, Sequence[str]] = field(default_factory=dict)
    named: Mapping[str, str] = field(default_factory=dict)

    @property
    def option(self) -> str:
        """What `--columns` takes to read what is guessed besides what the user has named; empty
        where nothing is guessed.
        """
        columns = {**self.named, **self.guesses} if self.guesses else {}
        return as_pairs(columns)


class _Title(NamedTuple):
    """A header cell, its name and unit as written, and our name, None where it is none of ours."""

    cell: str
    name: str
    unit: str | None
    ours: str | None


def read_header(cells: TableCells, naming: Naming, optional: Collection[str] = ()) -> Header:
    """What each column is, by its header and the user's names. With `optional` ones (ours), which
    need not be there, they are those of another table: so are names that are as we have them, and
    units are of columns without one. Notes and faults go to `cells`: `unknown-unit`,
    `ambiguous-unit`, `other-quantity`, `two-units`, `brackets`, `column-twice`, `misspelt-column`,
    `no-column`.
    """
    titles = _titles(cells, naming)
    errors = _errors_of(cells, titles, naming)
    for index, name_sd in errors.names.items():
        unit = errors.units.get(index, titles[index].unit)
        titles[index] = titles[index]._replace(ours=name_sd, unit=unit)
    ours = [title.ours for title in titles]
    numbers = dict[str, int]()
    labels = dict[str, int]()
    units = dict[str, str | None]()
    slips = dict[str, Sequence[str]]()
    for index, title in enumerate(titles):
        column = title.ours
        if column is None:
            slips[title.name] = _check_unknown(cells, title.cell, title.name, ours)
            labels.setdefault(title.name, index)
        elif column in numbers or column in labels:
            words = f"'{title.cell}' and another column are both '{column}'; keep one of them"
            cells.fault("column-twice", words, column)
        elif column in LABELS:
            labels[column] = index
        else:
            stated = naming.units.get(column)
            numbers[column] = index
            units[column] = title.unit or stated
            if not optional:
                _check_units(cells, column, title.unit, stated)
        if column in naming.theirs and bare_name(title.name) != bare_name(column):
            cells.theirs[column] = title.name
    _check_user_names(cells, naming, titles, optional)
    guesses = _guesses(titles)
    factors, symbols = _factors(cells, numbers, units)
    shares = [column for column in numbers if _is_share(column, units)]
    return Header(
        numbers,
        factors,
        symbols,
        labels,
        guesses,
        shares,
        errors.refused,
        errors.unread,
        {their: near for their, near in slips.items() if near},
    )


def _errors_of(cells: TableCells, titles: Sequence[_Title], naming: Naming) -> ErrorColumns:
    """The columns of errors whose names we do not have as they are."""
    by_user = {plain_name(their): ours for ours, their in naming.theirs.items()}
    # The user may have named a column with its unit, which the name of its errors does not repeat.
    for title in titles:
        if title.ours in naming.theirs:
            by_user[plain_name(title.name)] = title.ours

    def known(text: str) -> str | None:
        ours = by_user.get(text) or our_name(text)
        return ours if ours in COLUMNS else None

    parts = [(title.name, title.unit) for title in titles]
    return error_columns(cells, parts, [title.ours for title in titles], known)


def _is_share(column: str, units: Mapping[str, str | None]) -> bool:
    """Whether a column of sds has them as shares of the value: in percent, or in no unit at all."""
    base = column.removesuffix("_sd")
    if base == column or base not in COLUMNS:
        return False
    unit = (units.get(column) or "").strip()
    is_ratio = COLUMNS[base].unit == ""
    return (unit == "%" and units.get(base) != "%") or (unit in ("1", "-") and not is_ratio)


def _titles(cells: TableCells, naming: Naming) -> list[_Title]:
    """The cells of a header, taken apart."""
    titles = list[_Title]()
    for cell in cells.names:
        name, unit = naming.split(cell)
        ours = naming.by_user(cell, name)
        if ours is None:
            ours = our_name(name)
            if ours in OTHER_FORMS and not cells.has_numbers(len(titles)):
                ours = None
        titles.append(_Title(cell, name, unit, ours))
    if sum(title.ours == "id" for title in titles) > 1:
        # `No.` beside `id` is a column of the user's own.
        for index, title in enumerate(titles):
            if title.ours == "id" and bare_name(title.name) != "id":
                titles[index] = title._replace(ours=None)
    as_components = _uvw_guesses([title.cell for title in titles])
    for index, title in enumerate(titles):
        # Beside `u1` and `w1` a column `v1` is a component, and no speed.
        if title.cell in as_components and title.ours == our_name(title.name) is not None:
            titles[index] = title._replace(ours=None)
    names = [bare_name(title.name) for title in titles]
    meant = list[str]()
    for title, name in zip(titles, names, strict=True):
        if title.ours is None and spatial_name(name) is None:
            meant += guess_of(title.name)
    ours_or_third = with_spatial(names, [title.ours for title in titles], meant)
    return [title._replace(ours=our) for title, our in zip(titles, ours_or_third, strict=True)]


def _check_units(cells: TableCells, column: str, unit: str | None, stated: str | None) -> None:
    """Add a fault where the header and the user state different units of a column."""
    if unit and stated and symbol_of(stated) != symbol_of(unit):
        words = (
            f"the unit is '[{unit}]' in the header and '[{stated}]' in columns; expected one unit"
        )
        cells.fault("two-units", words, column)


def _check_user_names(
    cells: TableCells,
    naming: Naming,
    titles: Sequence[_Title],
    optional: Collection[str],
) -> None:
    """Add a fault of each column that the user names and that is not there; a note where one of our
    name is there instead.
    """
    ours = {title.ours for title in titles}
    headers = set[str]()
    for title in titles:
        headers |= {" ".join(text.split()).casefold() for text in (title.cell, title.name)}
    for column, their in naming.theirs.items():
        wanted = naming.columns[column]
        if column in ours:
            if not optional and their not in headers:
                words = (
                    f"no column is called '{wanted}': {column} is read from the one of that name"
                )
                cells.note("not-read", words)
        elif column not in optional and not (optional and their == column):
            words = f"there is no column '{wanted}' to read as {column}"
            columns = listed(cells.names, most=_NAMED_COLUMNS)
            cells.fault("no-column", f"{words}; columns of the table: {columns}", column)


def _factors(
    cells: TableCells,
    numbers: Mapping[str, int],
    units: Mapping[str, str | None],
) -> tuple[dict[str, float], dict[str, str]]:
    """Factors to SI and symbols of units by column. Faults of units go to the cells."""
    factors = dict.fromkeys(numbers, 1.0)
    symbols = dict[str, str]()
    for column in numbers:
        if column.startswith("corr("):
            continue
        # A standard deviation without a unit has that of its column.
        base = column.removesuffix("_sd")
        unit = units[column] or units.get(base)
        si = COLUMNS[base].unit if base in COLUMNS else SPATIAL[base]
        if _is_share(column, units):
            factors[column] = factor_of(unit, "")
            continue
        symbols[column] = symbol_within(unit or "", si) or assumed_symbol(si)
        try:
            factors[column] = factor_of(unit, si)
        except ParameterError as error:
            cells.fault(error.code, str(error), column)
            factors[column] = nan
    return factors, symbols


def _check_unknown(
    cells: TableCells, cell: str, name: str, taken: Collection[str | None]
) -> Sequence[str]:
    """Add a fault where an unknown name is a slip of one of ours that is not there, which are
    returned, or its brackets do not match.
    """
    if "[" in cell and our_name(cell.split("[")[0]) and not our_name(name):
        words = "the brackets do not match; expected a name and a unit, such as 'v_x1 [m/s]'"
        cells.fault("brackets", words, cell)
    if _CORR.fullmatch(cell):
        words = f"expected corr(a,b) of two columns: {', '.join(COLUMNS)}"
        cells.fault("unknown-correlation", words, cell)
    if len(guess_of(name)) == 1:
        return ()
    end = end_of(name)
    free = [ours for ours in _SLIPPING if ours not in taken and end in (None, end_of(ours))]
    near = get_close_matches(name[:MOST_CHARACTERS].lower(), free, n=2, cutoff=_LEAST_LIKENESS)
    if near:
        words = f"unknown column, called nearly as {listed(near, 'or')}"
        cells.fault("misspelt-column", f"{words}: rename it", name)
    return near


def _guesses(titles: Sequence[_Title]) -> dict[str, str]:
    """Unknown columns by the name that each may mean: one column for one name that is not there.
    What leaves the end open means the one that no other column is.
    """
    taken = {title.ours for title in titles}
    unknown = _meanings_of_unknown(titles, taken)
    taken_or_meant = {*taken, *(guess[0] for guess in unknown.values() if len(guess) == 1)}
    cells_of: dict[str, list[str]] = {}
    for cell, guess in unknown.items():
        others = taken if len(guess) == 1 else taken_or_meant
        free = [ours for ours in guess if ours not in others]
        if len(free) == 1:
            cells_of.setdefault(free[0], []).append(_with_unit(cell))
    guesses = {column: texts[0] for column, texts in cells_of.items() if len(texts) == 1}
    guesses |= _counted_from_zero(titles)
    # Errors of a column that is not there mean nothing.
    known = {*taken, *guesses}
    return {column: their for column, their in guesses.items() if _base_of(column) in known}


def _meanings_of_unknown(
    titles: Sequence[_Title], taken: Collection[str | None]
) -> dict[str, tuple[str, ...]]:
    """What unknown columns may mean, by their cell, where `taken` are those that are known."""
    unknown = {title.cell: guess_of(title.name) for title in titles if title.ours is None}
    unknown |= _third_guesses(titles, unknown)
    unknown |= _uvw_guesses(unknown)
    for end in "12":
        if f"v_{end}" in taken and f"theta_{end}" in taken:
            # These say the components; another one contradicts them, or is sideways.
            for cell, guess in unknown.items():
                if guess in [(f"v_{axis}{end}",) for axis in "xyz"]:
                    unknown[cell] = ()
    return unknown


def _base_of(column: str) -> str:
    """The column that sds are of, or the column itself."""
    return column.removesuffix("_sd")


def _third_guesses(
    titles: Sequence[_Title], unknown: Mapping[str, tuple[str, ...]]
) -> dict[str, tuple[str, ...]]:
    """What unknown columns may mean that say z, by their cell, where another is or says y: not the
    vertical component, but the third.
    """
    says_z = set()
    for title in titles:
        if title.ours is None and "z" in words_in(title.name):
            says_z.add(title.cell)
    others = {title.ours for title in titles}
    for cell, guess in unknown.items():
        if cell not in says_z and len(guess) == 1:
            others |= {*guess}
    thirds = dict[str, tuple[str, ...]]()
    for cell in says_z:
        guess = unknown[cell]
        if len(guess) == 1 and guess[0] in others:
            thirds[cell] = (guess[0].replace("v_y", "v_z"),)
    return thirds


def _counted_from_zero(titles: Sequence[_Title]) -> dict[str, str]:
    """What columns mean whose names end in 0 and 1, and not in 2, such as `h0` and `h1`: before and
    after the impact.
    """
    by_name = {bare_name(title.name): title for title in titles}
    guesses = dict[str, str]()
    for name, before in by_name.items():
        base = name.removesuffix("0")
        ends = guess_of(base)
        after = by_name.get(f"{base}1")
        if base == name or len(ends) != 2 or after is None or f"{base}2" in by_name:
            continue
        guesses |= {ends[0]: _with_unit(before.cell), ends[1]: _with_unit(after.cell)}
    return guesses


def _uvw_guesses(cells: Collection[str]) -> dict[str, tuple[str, ...]]:
    """What unknown columns may mean by their cell where they are u, v and w of one end."""
    by_rest: dict[str, dict[str, str]] = {}
    for cell in cells:
        if match := _UVW.fullmatch(cell.casefold()):
            by_rest.setdefault(match["rest"], {})[match["letter"]] = cell
    guesses = dict[str, tuple[str, ...]]()
    for rest, cell_by_letter in by_rest.items():
        end = end_of(f"v{rest}")
        if end and len(cell_by_letter) == len("uvw"):
            for letter, axis in zip("uvw", "xyz", strict=True):
                guesses[cell_by_letter[letter]] = (f"v_{axis}{end}",)
    return guesses


def _with_unit(cell: str) -> str:
    """A cell with the unit in brackets that stands among its words."""
    if "[" in cell or "(" in cell:
        return cell
    unit = next(filter(is_unit, cell.split()), None)
    return f"{cell} [{unit}]" if unit else cell
