"""How many tables of a batch pass the drop test of the ITF, by which rule."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from fitball.base.numbers import counted
from fitball.base.text import listed, short
from fitball.base.values import DataFrame
from fitball.report.blocks import Mark

# Columns of a batch: whether the mean ball of a table passes, and by which rule.
VERDICT = "mean_verdict"
RULE = "mean_rule"
# The verdict where balls differ by more than those of one type may, so that none is the mean.
DIFFER = "balls differ"
# Tables that fail with their names on a first screen.
_MOST_NAMED = 5
# Letters of a table's name.
_LETTERS_OF_NAME = 24
_WORDS = {
    "passes": "{} pass",
    "fails": "{} fail",
    "undecided": "{} undecided (probability between 5 and 95 %)",
    DIFFER: "{} without a mean, since their balls differ",
}


def passing_lines(tables: DataFrame) -> Iterator[Mark]:
    """A line a surface and rule: how many tables pass, fail, and are undecided."""
    for column in map(str, tables.columns):
        name, bracket, surface = column.partition("[")
        if name != VERDICT:
            continue
        where = f" on {surface[:-1]}" if bracket else ""
        judged = tables[tables[column].notna()]
        for rule, alike in judged.groupby(f"{RULE}{bracket}{surface}", sort=False):
            verdicts = {str(table): str(row[column]) for table, row in alike.iterrows()}
            yield _line(where, str(rule), verdicts)


def _line(where: str, rule: str, verdicts: Mapping[str, str]) -> Mark:
    """The line of the tables that are judged by one rule, each with its verdict."""
    parts = list[str]()
    for verdict, words in _WORDS.items():
        names = [short(name, _LETTERS_OF_NAME) for name, has in verdicts.items() if has == verdict]
        if not names and verdict == DIFFER:
            continue
        text = words.format(len(names))
        if verdict == "fails" and 0 < len(names) <= _MOST_NAMED:
            text = f"{text} ({listed(names)})"
        parts.append(text)
    tone = "poor" if "fails" in verdicts.values() else ""
    count = counted(len(verdicts), "table")
    return Mark(f"Drop test{where}, mean of {count} as {rule}: {listed(parts)}.", tone)
