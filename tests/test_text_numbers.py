"""Numbers as people read them, text that cannot steer a terminal, and errors with every fault."""

import pickle
import unicodedata

import numpy as np
import pytest

from fitball.base.errors import (
    Fault,
    FolderError,
    InputError,
    MachineError,
    ParameterError,
    enough_memory,
)
from fitball.base.numbers import Unit, in_short, percent, signed
from fitball.base.text import one_line, short, visible
from fitball.base.values import Ball, impacts

PLAIN = Unit("")
MS = Unit("ms", 1e3)


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        # The four examples of the Particle Data Group, sect. 5.3: 0.827 +- 0.119, 0.367, and limits
        # of their rule.
        (0.827, 0.119, "0.83 ± 0.12"),
        (0.827, 0.367, "0.8 ± 0.4"),
        (0.827, 0.354, "0.83 ± 0.35"),
        (0.827, 0.355, "0.8 ± 0.4"),
        (0.827, 0.949, "0.8 ± 0.9"),
        (0.827, 0.95, "0.8 ± 1.0"),
        (14674.2, 964.0, "14700 ± 1000"),
        (21345.0, 1234.0, "21300 ± 1200"),
        (0.95, 0.0999, "0.95 ± 0.10"),
        (-0.0001, 0.02, "0.000 ± 0.020"),
        (-3.25, 0.4, "-3.2 ± 0.4"),
        (1e30, 1e28, f"1{'0' * 30} ± 1{'0' * 28}"),
        (0.5, 0.0, "0.5000"),
        (0.5, np.nan, "0.5000"),
        (0.5, np.inf, "0.5000"),
        (np.nan, 0.1, ""),
    ],
)
def test_the_sd_decides_the_digits(value, sd, text):
    assert PLAIN.plus_minus(value, sd) == text
    assert MS.plus_minus(value / 1e3, sd / 1e3) == text


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (0.516, 0.608, "[0.516, 0.608]"),
        (-0.2, 0.31, "[-0.20, 0.31]"),
        (None, 0.3, "[..., 0.300]"),
        # Ends far apart have digits of their own: none is rounded to zero.
        (0.4, 300.0, "[0.40, 300]"),
        (-300.0, -0.4, "[-300, -0.40]"),
        (2.0, 2.0, "[2.00, 2.00]"),
        (0.0841, 11641.0, "[0.084, 11600]"),
        (np.nan, np.nan, ""),
        (None, None, ""),
        (16000.0, 23000.0, "[16000, 23000]"),
    ],
)
def test_an_interval_has_the_decimals_of_its_width(low, high, text):
    assert PLAIN.interval(low, high) == text


def test_numbers_without_an_sd():
    texts = [PLAIN.number(x) for x in (0.0996, 12345.0, 0.0, -0.0, 1e-15, -3.14159, np.inf, None)]
    assert texts == ["0.0996", "12345", "0", "0", "1.00e-15", "-3.14", "", ""]
    assert PLAIN.number(0.0996, 2) == "0.10"
    assert MS.number(0.0042) == "4.20"
    assert [signed(x) for x in (0.01, 0.3, -2.0)] == ["0.0", "+0.3", "-2.0"]
    assert Unit("1e-3 s/m").with_unit("3") == "3 × 1e-3 s/m"
    assert PLAIN.with_unit("3") == "3"


def test_a_share_is_all_or_none_only_where_it_is():
    whole = {percent(x) for x in np.linspace(0.0, 1.0, 2001)[1:-1]}
    assert not {"0 %", "100 %"} & whole
    assert {"1 %", "50 %", "99 %"} < whole
    ends = [percent(x) for x in (0.0, 1e-9, 1.0 - 1e-9, 1.0, 1.3, np.nan)]
    assert ends == ["0 %", "< 1 %", "> 99 %", "100 %", "130 %", ""]


# All planes with letters, and that of tags; the others have ideographs and private letters alone.
EVERYTHING = "".join(map(chr, [*range(0x20000), *range(0xE0000, 0xE0200)]))
DIRECTIONS = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}


def test_nothing_that_steers_or_hides_remains_and_nothing_that_is_read_is_lost():
    shown = visible(EVERYTHING)
    kinds = {unicodedata.category(c) for c in set(shown) - set("\n\t\u200c\u200d")}
    assert not {"Cc", "Cs", "Zl", "Zp"} & kinds
    assert not DIRECTIONS & {unicodedata.bidirectional(c) for c in shown}
    assert not {*"\ufeff\u200b\u00ad\u2060\u180e\U000e0041"} & {*shown}
    kept = "".join(c for c in EVERYTHING if c.isprintable() or c in "\n\t")
    assert visible(kept) == kept
    # Joiners are part of Persian, and of nothing that Latin letters spell.
    assert visible("cl\u200day") == "cl\\u200day"
    assert "\\u" not in visible("\u0645\u06cc\u200c\u062e")


def test_one_line_keeps_both_ends_of_what_is_long():
    line = one_line(f"read '{'a' * 100_000}\n\t\x1b'; expected a number")
    assert len(line) == 200
    assert line.isprintable()
    assert one_line(line) == line
    assert line.startswith("read 'aaa")
    assert line.endswith("\\n\\t\\x1b'; expected a number")
    assert short("a" * 30 + "b" * 30, 12) == "aaaaaa...bbb"


def test_all_faults_are_kept_and_their_message_is_bounded():
    faults = [Fault("not-a-number", f"read '{k}'", k, k + 1, f"c{k % 60}") for k in range(100_000)]
    error = InputError("t\x1b.csv", faults, ["flip v_x1"])
    assert error.faults == tuple(faults)
    assert error.code == "not-a-number"
    assert error.source == "t\\x1b.csv"
    text = str(error)
    assert len(text) < 10_000
    assert "60 faults, in 100,000 rows" in text
    assert "flip v_x1" in text
    assert "\x1b" not in text
    # Column, rows and line of a kind that repeats.
    assert (
        "rows 3, 63, 123, 183, 243, 303 and 1,661 more (first: line 4), column 'c3': read '3'"
        in text
    )


@pytest.mark.parametrize(
    "error",
    [FolderError("a\x1b", "b"), InputError("t", [Fault("a", "x", 2)], ["h"])],
)
def test_an_error_of_another_process_is_the_same(error):
    back = pickle.loads(pickle.dumps(error))
    assert type(back) is type(error)
    assert str(back) == str(error)
    assert back.code == error.code
    assert str(error).isprintable() or isinstance(error, InputError)


def test_running_out_of_memory_is_an_error_in_words():
    with pytest.raises(MachineError, match="memory") as caught, enough_memory():
        np.empty(2**50)
    assert caught.value.code == "memory"


@pytest.mark.parametrize(
    "wrong",
    [{"mass": 0.0}, {"radius": np.nan}, {"inertia_ratio": 1.01}, {"mass": "57"}, {"mass": 1e7}],
)
def test_a_ball_that_cannot_be_is_refused(wrong):
    with pytest.raises(ParameterError) as caught:
        Ball(**wrong)
    assert caught.value.code == "ball"


@pytest.mark.parametrize(
    "wrong",
    [
        (1.0, 0.0),
        (1.0, -1.0),
        (np.nan, 1.0),
        (np.ma.masked_array([1.0, 2.0], [False, True]), 1.0),
        ([1, 2], [1, 2, 3]),
        ("a", 1.0),
        ([[1.0]], 1.0),
    ],
)
def test_what_is_no_impact_is_refused(wrong):
    with pytest.raises(ParameterError) as caught:
        impacts(*wrong)
    assert caught.value.code == "impacts"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.128, "0.13"),
        (2.0, "2"),
        (75.4, "75"),
        (99.4, "99"),
        (99.6, "100"),
        (112.0, "112"),
        (-12345.6, "-12346"),
    ],
)
def test_a_number_in_short_has_no_exponent(value, text):
    assert in_short(value) == text
