"""Names of surfaces, balls and places in the source of a port, made from the labels of a table: valid and unique in
every language, whatever accents, blanks, digits and keywords the labels have.
"""

from __future__ import annotations

import keyword
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import chain, count

TAKEN_CSHARP = """
abstract as base bool break byte case catch char checked class const continue decimal default delegate do double
else enum event explicit extern false finally fixed float for foreach goto if implicit in int interface internal
is lock long namespace new null object operator out override params private protected public readonly ref return
sbyte sealed short sizeof stackalloc static string struct switch this throw true try typeof uint ulong unchecked
unsafe ushort using virtual void volatile while var
"""
TAKEN_JAVASCRIPT = """
arguments await break case catch class const continue debugger default delete do else enum eval export extends
finally for function if implements import in instanceof interface let new null package private protected public
return static super switch this throw try typeof undefined var void while with yield
"""
_TAKEN_C = """
auto bool break case char complex const continue default do double else enum extern false float for goto if imaginary
inline int int64_t long register restrict return short signed sizeof static struct switch true typedef union unsigned
void volatile while linux unix
"""
# What the templates call something, and what C# has outside of a class.
_TAKEN_TEMPLATES = """
v_x1 v_y1 omega_1 cor row row_of rows codes rigid function twist drive stack scratch s found bad known place number
math model levels phases reasons golden regimes counts rebound result solve reason phase range solved selftest
self_test regimename regime_name new_scratch newscratch rowof list string console complex system object
argumentexception name names time words status
"""
TAKEN = frozenset(
    word.lower()
    for text in (TAKEN_CSHARP, TAKEN_JAVASCRIPT, _TAKEN_C, _TAKEN_TEMPLATES, " ".join(keyword.kwlist))
    for word in text.split()
)
# Characters of a name at most: C99 needs to distinguish 63 of an enumerator, which begins with a prefix and a column.
LONGEST = 24
# Constants of every header.
TAKEN_CONSTANTS = ("MAKE", "PORT_H", "SELF_TEST")


@dataclass(frozen=True)
class Argument:
    """A column whose label a port takes as an argument called `name`; `labels` are as in the table.

    `names` are those of the labels where a text is taken, `constants` in C (behind the prefix), `members` in C#, in
    an enumeration called `kind`.
    """

    name: str
    column: str
    labels: tuple[str, ...]
    names: tuple[str, ...]
    constants: tuple[str, ...]
    kind: str
    members: tuple[str, ...]


def plain_name(text: str) -> str:
    """Small letters of ASCII, digits and single underscores of a text, at most LONGEST; empty where it has none:
    `Gras\u00e9 (wet)` is `grase_wet`.
    """
    apart = unicodedata.normalize("NFKD", text).casefold()
    plain = re.sub("[^a-z0-9]+", "_", "".join(c for c in apart if not unicodedata.combining(c)))
    return plain.strip("_")[:LONGEST].rstrip("_")


def camel_case(text: str) -> str:
    """`red_clay_` as `RedClay`."""
    return "".join(word[0].upper() + word[1:] for word in text.split("_") if word)


def arguments_of(
    columns: Mapping[str, tuple[str, ...]], taken: Iterable[str], constants: Iterable[str]
) -> tuple[Argument, ...]:
    """The arguments for `columns` (labels by column). `taken` are functions and types of the port, `constants` its
    constants.
    """
    reserved = TAKEN | {name.lower() for name in taken}
    names: set[str] = set(reserved)
    used, kinds = {*TAKEN_CONSTANTS, *constants}, {camel_case(name).lower() for name in reserved}
    made = []
    for place, (column, labels) in enumerate(columns.items(), 1):
        own = _beginning(plain_name(column) or f"column_{place}", "column_")
        # A class is called after a bounce.
        free = own if own not in reserved and not own.endswith("bounce") else f"{own}_label"
        name = _unique(free, names)
        plain = _all_unique((plain_name(label) or f"{name}_{k}" for k, label in enumerate(labels, 1)), set())
        kind = _unique(camel_case(name), kinds, str.lower)
        upper = _all_unique((f"{name}_{label}".upper() for label in plain), used)
        members = _all_unique((_beginning(camel_case(label), kind) for label in plain), set())
        made.append(Argument(name, column, labels, plain, upper, kind, members))
    return tuple(made)


def _beginning(name: str, before: str) -> str:
    """A name that begins with a letter."""
    return name if name[0].isalpha() else f"{before}{name}"


def _all_unique(names: Iterable[str], used: set[str]) -> tuple[str, ...]:
    return tuple(_unique(name, used) for name in names)


def _unique(name: str, used: set[str], fold: Callable[[str], str] = str) -> str:
    """The name, with a number behind it if one like it is used already, which is noted."""
    numbered = chain([name], (f"{name}_{k}" for k in count(2)))
    found = next(one for one in numbered if fold(one) not in used)
    used.add(fold(found))
    return found
