"""Proposals are made only where they help: each is first tried by the reader's own checks.

An `Attempt` reads the table again, changed as the proposal says, and answers whether it can be read
so; slips in a few rows, which any reading has, do not count.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

from fitball.base.columns import COLUMNS, FLIGHTS, HEIGHTS
from fitball.base.errors import Fault
from fitball.base.text import as_pairs, column_head, listed
from fitball.data.header import Header, Naming
from fitball.data.misreading import Doubt
from fitball.data.signs import flip_option

# Units that are tried, the usual one first, where columns that are proposed state none.
_UNITS = {
    "m": ("cm", "mm", "in"),
    "m/s": ("km/h", "mph", "cm/s"),
    "rad/s": ("rpm",),
    "s": ("ms",),
}
# Forms in which a velocity may stand in a file.
_FORMS = {"v_y1": (HEIGHTS[0], FLIGHTS[0]), "v_y2": (HEIGHTS[1], FLIGHTS[1])}


@dataclass(frozen=True)
class Change:
    """How a table is to be read otherwise: the file's names by ours, as `--columns` takes them,
    besides those of the scene; all columns to flip; cells of the header by those they replace;
    columns to ignore besides those that are ignored.
    """

    columns: Mapping[str, str]
    flip: Sequence[str]
    header: Mapping[str, str] = field(default_factory=dict)
    ignore: Sequence[str] = ()


Attempt: TypeAlias = Callable[[Change], bool]


@dataclass(frozen=True)
class FileNames:
    """How a table was read: `cells` of its header by our names, the user's `naming`, and columns
    that were flipped.
    """

    cells: Mapping[str, str]
    naming: Naming
    flip: Sequence[str]

    def name(self, ours: str) -> str:
        """The file's name of a column, without the unit."""
        return self.naming.split(self.cells[ours])[0]

    def stated_unit(self, ours: str) -> str:
        """The unit in the header; empty where that has none."""
        return self.naming.split(self.cells[ours])[1] or ""

    def head(self, ours: str) -> str:
        """What `--columns` takes to read this column, with the unit that the user stated."""
        unit = "" if self.stated_unit(ours) else self.naming.units.get(ours, "")
        return column_head(self.name(ours), unit) if unit else self.name(ours)


def with_tried_guesses(header: Header, names: FileNames, attempt: Attempt) -> Header:
    """The header with those of its guesses with which the table can be read: all, with a unit where
    the file states none, or all but one, or one; none where nothing helps.
    """
    for guesses in _choices(header.guesses, names.naming):
        if attempt(Change({**header.named, **guesses}, names.flip)):
            return replace(header, guesses=guesses)
    return replace(header, guesses={})


def _choices(guesses: Mapping[str, str], naming: Naming) -> Iterator[dict[str, str]]:
    """The guesses, then with units where they have none, then fewer of them."""
    yield dict(guesses)
    for si, symbols in _UNITS.items():
        bare = {
            ours: their
            for ours, their in guesses.items()
            if COLUMNS[ours.removesuffix("_sd")].unit == si and not naming.split(their)[1]
        }
        for symbol in symbols if bare else ():
            with_unit = {ours: column_head(their, symbol) for ours, their in bare.items()}
            yield {**guesses, **with_unit}
    if len(guesses) > 2:
        for left_out in guesses:
            yield {ours: their for ours, their in guesses.items() if ours != left_out}
    if len(guesses) > 1:
        for ours, their in guesses.items():
            yield {ours: their}


def with_tried_slips(
    faults: Iterable[Fault], header: Header, names: FileNames, attempt: Attempt
) -> list[Fault]:
    """The faults, those of misspelt columns with the option that reads these, where one does."""
    options = _options_of_slips(header, names, attempt)
    with_options = list[Fault]()
    for fault in faults:
        is_slip = fault.code == "misspelt-column"
        option = options.get(fault.column or "", "") if is_slip else ""
        if option:
            meant = f'unknown column; did you mean --columns "{option}"?'
            words = f"{meant} Else give it a name that is less like ours"
            with_options.append(replace(fault, message=words))
        else:
            with_options.append(fault)
    return with_options


def _options_of_slips(header: Header, names: FileNames, attempt: Attempt) -> dict[str, str]:
    """By misspelt name what `--columns` takes to read it as meant, for all of them at once, else
    for those with which alone the table can be read.
    """
    columns = names.naming.columns
    of_all = {near[0]: their for their, near in header.slips.items()}
    if of_all and attempt(Change({**columns, **of_all}, names.flip)):
        return dict.fromkeys(header.slips, as_pairs({**columns, **of_all}))
    options = dict[str, str]()
    for their, near in header.slips.items():
        for ours in near:
            changed = {**columns, ours: their}
            if their not in options and attempt(Change(changed, names.flip)):
                options[their] = as_pairs(changed)
    return options


def columns_to_leave_out(faults: Iterable[Fault], names: FileNames, attempt: Attempt) -> str:
    """What `--ignore` takes so that no column contradicts others, as the `faults` say; empty where
    none does, or the table cannot be read so.
    """
    contradictory = dict.fromkeys(
        fault.column for fault in faults if fault.code == "contradiction" and fault.column
    )
    change = Change(names.naming.columns, names.flip, ignore=[*contradictory])
    return ",".join(contradictory) if contradictory and attempt(change) else ""


def tried_units(faults: Iterable[Fault], names: FileNames, attempt: Attempt) -> list[str]:
    """A sentence on the unit with which columns that state none are within their limits, where the
    table can be read so, with what to do; none where no such column is beyond them.
    """
    outside = {fault.column for fault in faults if fault.code == "out-of-limits"}
    for si, symbols in _UNITS.items():
        bare = [ours for ours in names.cells if _has_no_unit(ours, si, names)]
        for symbol in () if outside.isdisjoint(bare) else symbols:
            heads = {ours: column_head(names.name(ours), symbol) for ours in bare}
            columns = {**names.naming.columns, **heads}
            if attempt(Change(columns, names.flip)):
                words = f"with {listed(bare)} in {symbol} instead of {si} all is within limits"
                return [f'{words}: if so, pass --columns "{as_pairs(columns)}"']
    return []


def _has_no_unit(ours: str, si: str, names: FileNames) -> bool:
    """Whether a column of such a quantity states no unit."""
    column = COLUMNS.get(ours.removesuffix("_sd"))
    is_stated = names.stated_unit(ours) or ours in names.naming.units
    return column is not None and column.unit == si and not is_stated


def tried_readings(doubts: Iterable[Doubt], names: FileNames, attempt: Attempt) -> list[str]:
    """Sentences on the other readings with which the table can be read, each with what to do."""
    sentences = list[str]()
    for doubt in doubts:
        if not _can_be_named(doubt, names):
            continue
        columns = _renamed(doubt, names)
        header = {
            names.cells[ours]: column_head(names.name(ours), symbol)
            for ours, symbol in doubt.units.items()
            if names.stated_unit(ours)
        }
        flip = {*names.flip} ^ {*doubt.flip}
        change = Change({**names.naming.columns, **columns}, sorted(flip), header)
        if attempt(change):
            todo = _todo(doubt, change, bool(columns), names)
            sentences.append(f"{_in_names_of_file(doubt.said, names)}: if so, {listed(todo)}")
    return sentences


def _can_be_named(doubt: Doubt, names: FileNames) -> bool:
    """Whether the file has all columns that a reading changes, in these or in other forms."""
    swapped = [_form(ours, names) for pair in doubt.swaps for ours in pair]
    return all(ours in names.cells for ours in (*doubt.flip, *doubt.units, *swapped))


def _form(ours: str, names: FileNames) -> str:
    """The column of the file that a column of ours was made of."""
    forms = (ours, *_FORMS.get(ours, ()))
    return next((form for form in forms if form in names.cells), ours)


def _renamed(doubt: Doubt, names: FileNames) -> dict[str, str]:
    """What `--columns` takes for the columns that a reading exchanges, or gives a unit that the
    header does not state.
    """
    columns = {
        ours: column_head(names.name(ours), symbol)
        for ours, symbol in doubt.units.items()
        if not names.stated_unit(ours)
    }
    for pair in doubt.swaps:
        first, second = (_form(ours, names) for ours in pair)
        for suffix in ("", "_sd"):
            for ours, other in ((first, second), (second, first)):
                if f"{other}{suffix}" in names.cells:
                    columns[f"{ours}{suffix}"] = names.head(f"{other}{suffix}")
    return columns


def _todo(doubt: Doubt, change: Change, renames: bool, names: FileNames) -> list[str]:
    """What to do for a reading: options that can be pasted, where there are such."""
    todo = list[str]()
    if doubt.flip:
        todo.append(flip_option(names.flip, doubt.flip))
    if renames:
        todo.append(f'pass --columns "{as_pairs(change.columns)}"')
    todo += [f"write '{new}' for '{old}' in the header" for old, new in change.header.items()]
    if doubt.remedy:
        todo.append(doubt.remedy)
    return todo


def _in_names_of_file(text: str, names: FileNames) -> str:
    """A text with the file's names behind ours, where they differ."""

    def with_name(match: re.Match[str]) -> str:
        ours = match[0]
        form = _form(ours, names)
        their = names.name(form) if form in names.cells else ours
        return ours if their == ours else f"{ours} ('{their}')"

    return re.sub(rf"\b(?:{'|'.join(COLUMNS)})\b", with_name, text)
