"""No text takes time that grows faster than its length: names, units, cells and options of 10^5 characters.

Exponential and quadratic searches do not end within the bound (some seconds of work; 10^10 steps and more for them).
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from fitball.data.cells import Findings, Rows, _bare, is_number
from fitball.data.header import _WORDS, _cut, end_of, guess_of, read_header, split_cell
from fitball.data.lines import parse_grid, parse_impact, parse_range, parse_window
from fitball.data.numbers import NumberColumn, explained, plain_numbers, read_column, split_deviations
from fitball.data.scene_keys import PRIOR
from fitball.data.text import DELIMITERS
from fitball.data.units import unit_of
from fitball.errors import FitballError

LENGTH, BOUND = 100_000, 240.0
# Pieces that patterns repeat, and ends that none expects.
PIECES = (
    "horiz", "1", "of", "v_", " ", "a ", "/", "v /", "[", "(", "1+-", "1,", "1,11111", "1e", ",111", "-1", "s^", "θ",
    "aB", "1 ", "\t", "1..", ":1", "±", "m s ", "_", "1.",
)  # fmt: skip
ENDS = ("!", "\n\nx")


def look_at(text: str) -> None:
    """All that is done with a text of a user's, whatever it answers."""
    guess_of(text), end_of(text), split_cell(text), unit_of(text), is_number(text), _bare(text), explained(text)
    found = Findings(Rows((1,), (1,)), 1)
    header = read_header((text, "v_x1"), found)
    plain_numbers({"v_x1": (text,)})
    split_deviations((text,))
    assert isinstance(read_column("v_x1", header.units["v_x1"], (text,), found), NumberColumn)
    for delimiter in DELIMITERS[4:]:
        list(delimiter.records([text], False))
    re.fullmatch(PRIOR, f"normal({text}")
    for parse in (parse_impact, parse_grid, parse_window, lambda said: parse_range("speed", said)):
        for said in (text, f"v=1{text}"):
            try:
                parse(said)
            except FitballError:
                continue


@pytest.mark.slow
def test_no_text_takes_more_than_linear_time() -> None:
    here = Path(__file__)
    command = [sys.executable, here.name]
    done = subprocess.run(command, timeout=BOUND, capture_output=True, text=True, check=False, cwd=here.parent)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("name", ["horiz" * 26 + "!", "1" * 1000, "v" * LENGTH])
def test_names_that_are_long_are_nobodys(name: str) -> None:
    assert guess_of(name) == ()
    assert read_header((name,), Findings(Rows((), ()), 1)).extras == (name,)


def test_a_name_is_cut_as_trying_all_ways_does_it() -> None:
    """Oracle: longest word first, backtracking."""

    def cut(text: str) -> list[str] | None:
        if not text:
            return []
        for size in range(len(text), 0, -1):
            rest = cut(text[size:]) if text[:size] in _WORDS else None
            if rest is not None:
                return [text[:size], *rest]
        return None

    rng = np.random.default_rng(0)
    words = sorted(_WORDS)
    for _ in range(300):
        text = "".join(rng.choice(words, rng.integers(1, 4))) + "x!"[rng.integers(0, 3) :][:1]
        text = text[rng.integers(0, 2) :]
        assert _cut(text) == (cut(text) or [])


if __name__ == "__main__":
    for place, repeated in enumerate(PIECES):
        look_at(repeated * (LENGTH // len(repeated)) + ENDS[place % 2])
