"""Proposals are tried: each option in a refusal reads the table, and as it was meant."""

import re

import numpy as np
import pytest
from support import misread

import fitball
from fitball.base.errors import InputError
from fitball.data.load import load_data

OPTION = re.compile(r'--(columns|flip) (?:"([^"]*)"|([\w,]+))')


def refusal(source, **reading):
    """The error with which a table is refused."""
    with pytest.raises(InputError) as caught:
        load_data(source, None, False, **reading)
    return caught.value


def options_in(text):
    """The options that a text proposes, as arguments."""
    options = {name: quoted or bare for name, quoted, bare in OPTION.findall(text)}
    if "columns" in options:
        pairs = re.split(r",(?=[^,=]+=)", options["columns"])
        options["columns"] = dict(pair.split("=") for pair in pairs)
    return options


def proposed(error):
    """The options that a refusal proposes: of faults, else of the first hint."""
    options = options_in(" ".join(fault.message for fault in error.faults))
    return options or options_in(error.hints[0])


# Names of a user, by ours.
THEIRS = {
    "v_x1": "along-before",
    "v_y1": "down-before",
    "omega_1": "spin, before",
    "v_x2": "along-after",
    "v_y2": "up-after",
    "omega_2": "spin, after",
    "v_1": "s.in",
    "v_2": "s.out",
    "theta_1": "a.in",
    "theta_2": "a.out",
}
KINDS = (
    "both spins",
    "rebound spin",
    "rpm",
    "deg/s",
    "from the normal",
    "both spins, in rpm",
    "ends",
    "v_x of the rebound",
)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("theirs", [{}, THEIRS])
def test_what_a_hint_says_reads_the_table_as_it_was_meant(kind, theirs):
    right, _ = misread.table("wide", 3)
    spoilt = misread.MISREADINGS[kind](right)
    named = {ours: their for ours, their in theirs.items() if ours in spoilt}
    written = {}
    for ours, values in spoilt.items():
        degrees = ours.startswith("theta")
        written[named.get(ours, ours)] = np.degrees(values) if degrees else values
    error = refusal(written, columns=named)
    options = {"columns": named, **proposed(error)}
    table, _ = load_data(written, None, False, **options)
    good = misread.polar(right) if "v_1" in spoilt else right
    assert misread.means(table.values, good)


HEIGHTS = {"drop_height": [0.65, 0.55, 0.45, 0.35], "rebound_height": [0.33, 0.285, 0.25, 0.195]}
# A table, and what a refusal of it proposes for `--columns`.
PROPOSED = {
    "h0,h1\n65,33.0\n55,28.5\n45,25.0\n35,19.5\n": {
        "drop_height": "h0 [cm]",
        "rebound_height": "h1 [cm]",
    },
    "h0 (mm);h1 (mm)\n650;330\n550;285\n450;250\n350;195\n": {
        "drop_height": "h0 (mm)",
        "rebound_height": "h1 (mm)",
    },
    # A count beside heights is no rebound.
    "drop (cm),bounce,second height (cm)\n100,1,56\n120,2,66\n140,3,79\n": {},
    # An incident speed alone makes no table.
    "speed in (m/s),spin out (rpm)\n12,800\n13,900\n": {},
    # The rebound is far above the drop: whatever was meant, it is not this.
    "drop (cm),rebound (cm)\n100,300\n120,340\n140,390\n": {},
    # One slip among eight rows is the same in every reading.
    "drop (cm),rebound (cm)\n100,56\n120,66\n140,7.9\n100,56\n120,66\n140,79\n100,x\n9,5\n": {
        "drop_height": "drop (cm)",
        "rebound_height": "rebound (cm)",
    },
    "Shot,Landing Speed (mph),Landing Angle,Bounce Speed (mph),Bounce Angle\n"
    "1,37.1,51.7,12.5,21.9\n2,40.6,39.5,20.5,14.8\n3,32.6,35.9,17.0,16.6\n": {
        "v_1": "Landing Speed (mph)",
        "theta_1": "Landing Angle",
        "v_2": "Bounce Speed (mph)",
        "theta_2": "Bounce Angle",
    },
    # The fifth guess alone cannot be meant.
    "Shot,Landing Speed (mph),Landing Angle,Bounce Speed (mph),Bounce Angle,Bounce Spin (rpm)\n"
    "1,37.1,51.7,12.5,21.9,9e9\n2,40.6,39.5,20.5,14.8,9e9\n3,32.6,35.9,17.0,16.6,9e9\n": {
        "v_1": "Landing Speed (mph)",
        "theta_1": "Landing Angle",
        "v_2": "Bounce Speed (mph)",
        "theta_2": "Bounce Angle",
    },
}


@pytest.mark.parametrize("text", PROPOSED)
def test_what_is_proposed_is_read_and_nothing_else_is_proposed(text, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(text)
    error = refusal(path)
    options = options_in(" ".join(fault.message for fault in error.faults))
    assert options.get("columns", {}) == PROPOSED[text]


HEIGHTS_IN_CM = "100,57\n150,84\n254,139\n"
# Tables without units, and the columns that a refusal proposes with theirs.
WITHOUT_UNITS = {
    f"drop_height,rebound_height\n{HEIGHTS_IN_CM}": ("drop_height [cm]", "rebound_height [cm]"),
    f"h0,h1\n{HEIGHTS_IN_CM}": ("h0 [cm]", "h1 [cm]"),
    "bounce,bounce_interval\n1,652\n2,505\n3,390\n4,300\n": ("bounce_interval [ms]",),
    "drop_height [m],flight_time_2\n1.0,652\n1.5,805\n2.54,1035\n": ("flight_time_2 [ms]",),
    # No unit makes these plausible.
    "drop_height,rebound_height\n1e9,57\n1e9,84\n1e9,139\n": (),
    # A unit that is stated is not doubted.
    "drop_height [m],rebound_height [m]\n100,57\n150,84\n254,139\n": (),
}


@pytest.mark.parametrize("text", WITHOUT_UNITS)
def test_units_are_proposed_where_none_is_stated_and_numbers_are_beyond_limits(text, tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(text)
    error = refusal(path)
    options = options_in(str(error))
    assert tuple(options.get("columns", {}).values()) == WITHOUT_UNITS[text]
    if options:
        table = fitball.load_table(path, **options)
        assert np.all(table.values["v_y1"] < 8.0)


def test_heights_counted_from_zero_are_those_of_the_file(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text(next(iter(PROPOSED)))
    heights = fitball.load_table(path, **proposed(refusal(path)))
    expected = fitball.load_table(HEIGHTS)
    for name in ("v_y1", "v_y2"):
        assert heights.values[name] == pytest.approx(expected.values[name], rel=1e-12)


def test_drops_that_are_exchanged_are_told_in_their_own_columns():
    swapped = dict(zip(HEIGHTS, reversed(HEIGHTS.values()), strict=True))
    error = refusal({f"{name} [m]": values * 3 for name, values in swapped.items()})
    assert error.code == "misread"
    assert options_in(error.hints[0])["columns"] == {
        "drop_height": "rebound_height",
        "rebound_height": "drop_height",
    }


def test_stated_errors_follow_the_columns_that_are_exchanged():
    right, _ = misread.table("wide", 3)
    spoilt = misread.MISREADINGS["ends"](right)
    for name in misread.SPEEDS:
        spoilt[f"{name}_sd"] = np.full(30, 0.1 if name.endswith("1") else 0.2)
    columns = proposed(refusal(spoilt))["columns"]
    table = fitball.load_table(spoilt, columns=columns)
    assert {table.sd[name][0] for name in ("v_x2", "v_y2")} == {0.1}


def test_a_flip_that_was_stated_is_not_proposed_again():
    right, _ = misread.table("wide", 3)
    error = refusal(right, flip="omega_1,omega_2")
    assert error.code == "misread"
    assert "flip" not in options_in(error.hints[0])
    error = refusal(misread.MISREADINGS["rebound spin"](right), flip="omega_1,omega_2")
    assert {*options_in(error.hints[0])["flip"].split(",")} == {"omega_2"}


def test_a_unit_in_the_header_is_corrected_there():
    """An option that contradicts the header is refused, and not proposed."""
    right, _ = misread.table("wide", 3)
    spoilt = misread.MISREADINGS["rpm"](right)
    headed = {f"{k} [rad/s]" if k in misread.SPINS else k: v for k, v in spoilt.items()}
    error = refusal(headed)
    assert not options_in(error.hints[0])
    assert all(f"'{name} [rpm]'" in error.hints[0] for name in misread.SPINS)


@pytest.mark.parametrize(
    ("head", "columns"),
    [
        ("v_y1,v_y22", {"v_y2": "v_y22"}),
        ("vv_y1,v_y22", {"v_y1": "vv_y1", "v_y2": "v_y22"}),
        # Read so it would rebound faster than it came.
        ("v_y22,v_y1", {}),
    ],
)
def test_a_slip_of_a_name_is_an_option_where_the_table_can_be_read_so(tmp_path, head, columns):
    path = tmp_path / "t.csv"
    path.write_text(f"{head}\n7,5.2\n8,5.9\n9,6.6\n")
    error = refusal(path)
    assert error.code == "misspelt-column"
    messages = [fault.message for fault in error.faults if fault.code == error.code]
    assert all(options_in(message).get("columns", {}) == columns for message in messages)
    if columns:
        assert len(fitball.load_table(path, columns=columns)) == 3


def test_all_columns_that_contradict_are_left_out_together():
    """None of them alone would do, as of units that two programs wrote."""
    right, _ = misread.table("wide", 3)
    both = right | {name: v * 1.5 for name, v in misread.polar(right).items() if "v_" in name}
    error = refusal(both)
    assert {fault.code for fault in error.faults} == {"contradiction"}
    ignored = {re.search(r"--ignore ([\w,]+)", fault.message)[1] for fault in error.faults}
    assert ignored == {"v_1,v_2"}
    assert len(fitball.load_table(both, ignore=ignored.pop())) == 30
    # A rebound that is too fast is not mended by leaving speeds out.
    error = refusal(both | {"v_y2": right["v_y1"] * 3.0, "v_y1": right["v_y2"]})
    assert "--ignore" not in " ".join(fault.message for fault in error.faults)
