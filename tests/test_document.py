"""A document: the same words and tables on a terminal, as a page, as Markdown."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest
from markupsafe import Markup
from test_report_html import faults

from fitball.inference.results.results import Verdict
from fitball.report.form import document as module
from fitball.report.form.document import (
    FIRST_LINES,
    MOST_LINES,
    Cell,
    Document,
    Picture,
    Section,
    Table,
    Words,
    as_markdown,
    as_page,
    judged,
    markdown_table,
    on_terminal,
    term,
)
from fitball.wording import Screen

# The header of a PNG file up to its width, 300 pixels.
PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + (300).to_bytes(4, "big")
ROWS = [
    {
        "name": "mu",
        "": Cell("", Markup("<i>m</i>")),
        "value": "0.55 +- 0.02",
        "verdict": judged(Verdict.GIVEN, "given", "a < b"),
    },
    {"name": "k", "value": "-", "verdict": "<none>"},
]
DOCUMENT = Document("A & B", [Words(["Good: 1 +- 2 `run`."], "lead", rank="first")], [
    Section("one", "First", [
        Table.from_rows("Values", ROWS, ["verdict"], aside=[""], rank="first"),
        Table.from_rows("Kept back", [{"a": "1"}], only="page", rank="folded"),
        Picture("curve", "A curve.", "It rises."),
    ]),
    Section("empty", "Nothing", [Words([]), Table("none", [["head"]])]),
    Section("two", "Second", [
        Words([term("mu", "one & two"), "plain"], "list"), Words(["there"], only="terminal"),
        Words(["here"], only="page"),
    ], "short"),
])  # fmt: skip


def test_a_terminal_has_plain_lines():
    assert on_terminal(DOCUMENT).split("\n\n") == [
        "A & B\n=====",
        "Good: 1 +- 2 `run`.",
        "First",
        "name         value  verdict\nmu    0.55 +- 0.02  given\nk                -  <none>",
        "Second\n- mu: one & two\n- plain",
        "there",
    ]
    assert on_terminal(DOCUMENT, Screen(full=False)).endswith("<none>")


COLOUR = re.compile(r"\x1b\[[0-9]+m")


def test_colours_change_no_letter_and_a_stranger_has_none():
    hostile = Document("A \x1b[31mtitle", [Words(["red \x1b[31mtext"]), *DOCUMENT.sections[0].parts], [])
    plain, coloured = (on_terminal(hostile, Screen(colour=colour)) for colour in (False, True))
    assert COLOUR.sub("", coloured) == plain and "\x1b" not in plain
    assert "\x1b[33mgiven\x1b[0m" in coloured and "\x1b[31m" not in coloured


@pytest.mark.parametrize("width", [40, 80, 100])
def test_lines_keep_to_the_width_and_break_nowhere_inside_a_number(width):
    rows = [["name", *(f"column {k}" for k in range(9))], ["mu", *(f"{k}.25 +- 0.03" for k in range(9))]]
    text = "The friction coefficient is 0.556 [0.516, 0.608] (95 %), the speed 24.1 +- 0.3 m/s. " * 9
    shown = on_terminal(Document("T", [Words([text]), Table("Values", rows)], []), Screen(width))
    assert max(map(len, shown.splitlines())) <= width
    words, _blank, table = shown.partition("\n\nname")
    for whole in ("[0.516, 0.608]", "95 %", "+- 0.3 m/s"):
        assert words.count(whole) == 9
    assert all(table.count(cell) == 1 for cell in rows[1][1:])
    assert [line for line in shown.splitlines() if line.startswith("mu")][-1].endswith("8.25 +- 0.03")


def test_the_first_screen_has_brief_tables_and_says_how_much_is_left():
    rows = [["id", "value", "prior"], *([f"i{k}", "1", "2"] for k in range(60))]
    table = Table("Long", rows, rest="`long.csv`", brief=("value",), rank="first")
    short, full = (on_terminal(Document("", [table], []), Screen(full=full)) for full in (False, True))
    assert short.splitlines()[0].split() == ["id", "value"] and full.splitlines()[0].split() == rows[0]
    assert short.splitlines()[-1] == f"... and {60 - FIRST_LINES} more: long.csv"
    assert full.splitlines()[-1] == f"... and {60 - MOST_LINES} more: long.csv"


def test_a_page_is_typeset_escaped_and_whole():
    page = as_page(DOCUMENT, {"curve": PNG})
    assert faults(page) == []
    for said in (
        "<title>A &amp; B - fitball</title>", "Good: 1\u00a0\u00b1\u00a02 <code>run</code>.", "<td><i>m</i></td>",
        '<td class="text"><span class="v-given" title="a &lt; b">given</span></td>',
        '<td class="text">&lt;none&gt;</td>', "<details><summary>Kept back</summary>", "<b>mu</b>: one &amp; two",
        '<section id="two" class="short">', ">here<", 'alt="It rises."',
    ):  # fmt: skip
        assert said in page, said
    folded = as_page(
        replace(DOCUMENT, sections=[replace(it, rank="folded") for it in DOCUMENT.sections]), {"curve": PNG}
    )
    assert faults(folded) == [] and "<details><summary><h2>First</h2></summary>" in folded
    assert "there" not in page and "Nothing" not in page and "Contents" not in page


def test_markdown_has_the_tables_of_the_page():
    text = as_markdown(DOCUMENT)
    assert text.startswith("# A & B\n\nGood") and "## Second\n\n- mu: one & two\n- plain\n\nhere\n" in text
    assert markdown_table([["a"], ["x|y\n z"]]) == "| a |\n|---|\n| x\\|y z |"
    assert "| name | | value | verdict |\n|---|---|---|---|\n| mu | | 0.55 +- 0.02 | given |" in text


@pytest.mark.parametrize(("count", "left"), [(0, 3), (100, 98)])
def test_many_rows_are_cut_and_said_to_be(monkeypatch, count, left):
    monkeypatch.setattr(module, "MOST_ROWS", 2)
    monkeypatch.setattr(module, "MOST_LINES", 2)
    rows = [["n"], *([str(k)] for k in range(5))]
    document = Document("", [Table("Numbers", rows, count=count, rest="`all.csv`, which has them")], [])
    assert on_terminal(document) == f"n\n0\n1\n... and {left} more: all.csv, which has them"
    page = as_page(document, {})
    assert f"{left} more: <code>all.csv</code>, which has them." in page and "<td>2" not in page


def test_blocks_of_a_long_table_share_the_lines_of_a_first_screen():
    rows = [["name", "one", "two"], *([f"a long name {k}", "1" * 20, "2" * 20] for k in range(60))]
    document = Document("", [Table("Many", rows, rest="long.csv", rank="first")], [])
    beside, below = (on_terminal(document, Screen(width, full=False)).splitlines() for width in (100, 40))
    assert len(beside) == FIRST_LINES + 2 and beside[-1] == f"... and {60 - FIRST_LINES} more: long.csv"
    # Two blocks, each with a head, and a blank line between.
    assert len(below) == FIRST_LINES + 4 and below[-1] == f"... and {60 - FIRST_LINES // 2} more: long.csv"


def test_a_narrow_screen_has_no_room_for_what_is_spare():
    rows = [["name", "words", ""], ["mu", "w" * 30, "1" * 20]]
    for spare, heads in (("words", ["name"]), ("", ["name", "words"])):
        table = Table("Values", rows, ["words"], spare=spare)
        text = on_terminal(Document("", [table], []), Screen(40))
        assert text.splitlines()[0].split() == heads and ("w" * 30 in text) == (not spare) and "1" * 20 in text
