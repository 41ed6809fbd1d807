"""Text from files and command lines made safe to print: without control characters, of limited length, without
formulas for spreadsheets.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Hashable, Iterable, Sequence

# Control characters of ISO 646 and 8859 but line feed and tab, surrogates, marks that turn the direction of text
# (Unicode Standard Annex 9), line separators, and signs without width that hide in a name. Joiners stay: Persian and
# the scripts of India are not written without them.
_UNSEEN = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\u00ad\u061c\u180e\u200b\u200e\u200f\u2028-\u202e\u2060-\u206f"
    "\ud800-\udfff\ufeff\ufff9-\ufffb\U000e0000-\U000e007f]"
)
_BREAK = re.compile("[\n\t]")
# What differs between two faults of a kind: the values that were read.
_VALUES = re.compile(r"'[^']*'|\"[^\"]*\"|[0-9][0-9.eE+-]*")
LINE = 400
# How cells begin that spreadsheets compute (OWASP, "CSV Injection"; full-width signs count in East Asian versions),
# the numbers among them, and what keeps them from it.
_FORMULA = tuple("=+-@\t\r\n\uff1d\uff0b\uff0d\uff20")
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
GUARD = "'"
EACH, LINES, NAMED = 5, 40, 12


def _escaped(found: re.Match[str]) -> str:
    """As JSON and Python write it, so that JSON stays JSON."""
    code = ord(found[0])
    if code < 0x10000:
        return f"\\u{code:04x}"
    return f"\\u{0xD800 + (code - 0x10000 >> 10):04x}\\u{0xDC00 + (code & 0x3FF):04x}"


def visible(text: str) -> str:
    """`text` with an escape, as in JSON, for every character that a terminal obeys or hides; lines stay lines."""
    return _UNSEEN.sub(_escaped, text)


def one_line(text: str, most: int = LINE) -> str:
    """`text` in one line of at most `most` characters: its beginning, and its end, where messages say what to do."""
    line = _BREAK.sub(_escaped, visible(text))
    if len(line) <= most:
        return line
    mark = f" [... {len(line)} characters in all ...] "
    first, last = (most - len(mark)) * 2 // 3, (most - len(mark)) // 3
    return f"{line[:first]}{mark}{line[-last:]}"


def some(names: Sequence[str]) -> str:
    """Names separated by commas: all of a few, or the first of many and the number of others."""
    if len(names) <= NAMED:
        return ", ".join(names)
    return f"{', '.join(names[:NAMED])} and {len(names) - NAMED:,} more"


def _computed(text: str) -> bool:
    core = text.lstrip(GUARD)
    return core[:1] in _FORMULA and _NUMBER.fullmatch(core) is None


def guarded(text: str) -> str:
    """A text as a cell of CSV: one that a spreadsheet would compute, guards aside, has one guard more."""
    return GUARD + text if _computed(text) else text


def unguarded(cells: Sequence[str]) -> tuple[str, ...]:
    """Cells of a column as they were before `guarded`. Where one that a spreadsheet would compute has no guard they
    were not written so, and stay as they are.
    """
    if any(_computed(cell) and not cell.startswith(GUARD) for cell in cells):
        return tuple(cells)
    return tuple(cell[1:] if _computed(cell) else cell for cell in cells)


def kind_of(message: str) -> str:
    """A message without the values in it: equal for two faults of a kind."""
    return _VALUES.sub("", message)


def folded(lines: Iterable[tuple[Hashable, str]]) -> list[str]:
    """Lines, each given with its kind: the first few of each kind, then how many more there are, bounded in all."""
    shown: list[str] = []
    first: dict[Hashable, str] = {}
    seen: Counter[Hashable] = Counter()
    others = 0
    for kind, line in lines:
        if kind not in first and len(shown) >= LINES:
            others += 1
            continue
        first.setdefault(kind, one_line(line, LINE // 2))
        seen[kind] += 1
        if seen[kind] <= EACH:
            shown.append(one_line(line))
    shown += [f"... and {seen[kind] - EACH} more like: {line}" for kind, line in first.items() if seen[kind] > EACH]
    return [*shown, f"... and {others} others"] if others else shown
