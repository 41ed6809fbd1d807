"""Zeros and codes for what was not measured, and columns of numbers that are not read."""

import numpy as np
import pytest
from made_tables import written
from numpy.testing import assert_allclose

import fitball
from fitball.base.errors import InputError

RADIUS = 0.033
# Moment of inertia over M R^2.
INERTIA_RATIO = 0.55


def impacts(rows=12, seed=4, spin=(-200.0, 200.0)):
    """Impacts (rows,) that slide, whose spins obey the angular momentum about the contact."""
    rng = np.random.default_rng(seed)
    v_x1 = rng.uniform(20.0, 30.0, rows)
    v_y1 = rng.uniform(4.0, 6.5, rows)
    omega_1 = rng.uniform(*spin, rows)
    v_x2 = v_x1 - 0.4 * 1.75 * v_y1
    omega_2 = omega_1 + (v_x1 - v_x2) / (INERTIA_RATIO * RADIUS) + 5.0 * rng.standard_normal(rows)
    rebound = {"v_x2": v_x2, "v_y2": 0.75 * v_y1, "omega_2": omega_2}
    return {"v_x1": v_x1, "v_y1": v_y1, "omega_1": omega_1, **rebound}


def zeroed(table, name, rows):
    column = table[name].copy()
    column[rows] = 0.0
    return table | {name: column}


def notes_of(source, code):
    """Texts of notes of a table, or of faults where it is refused for others."""
    try:
        table = fitball.load_table(source)
    except InputError as error:
        return [fault.message for fault in error.faults if fault.code == code]
    return [note.text for note in table.notices if note.code == code]


# ---- zeros


@pytest.mark.parametrize("name", ["omega_1", "omega_2"])
@pytest.mark.parametrize("rows", [[0, 1], [2, 5, 9], [*range(8)]])
def test_zeros_for_spins_that_were_not_measured_are_named(name, rows):
    (text,) = notes_of(zeroed(impacts(spin=(120.0, 220.0)), name, rows), "zeros")
    assert text.startswith(f"{name} is 0 in rows ")
    for row in rows[:6]:
        assert f"{row + 1}" in text


def test_zeros_among_few_spins_that_an_offset_changes_are_named(tmp_path):
    """Six impacts whose other spins are by 34 to 113 rad/s less than the balance without an offset
    of the normal force; the two zeros by 330 to 390.
    """
    text = """v_1 [km/h],theta_1 [deg],omega_1 [rad/s],v_x2 [m/s],v_y2 [m/s],omega_2 [rad/s]
61.2,20.5,0,10,4.9,{0}
60.8,33,10.5,7.5,7.2,{1}
62,45,-5.2,6.5,8.7,224.1
61.5,60,2.1,4.2,10.3,131.9
59.1,25.2,12.3,9.1,5.6,301
60.2,50.9,-3.3,5.6,9.2,190.4
"""
    (note,) = notes_of(written(tmp_path, text.format(0, 0)), "zeros")
    assert "omega_2 is 0 in rows 1 and 2" in note
    assert notes_of(written(tmp_path, text.format(288, 306.8)), "zeros") == []


def test_a_column_of_zeros_is_named():
    (text,) = notes_of(zeroed(impacts(), "omega_2", slice(None)), "zeros")
    assert "every row" in text
    assert "--ignore omega_2" in text


def test_spins_that_a_tracker_lost_before_and_after():
    table = impacts(spin=(150.0, 250.0))
    for name in ("omega_1", "omega_2"):
        table = zeroed(table, name, [3, 7])
    assert len(notes_of(table, "zeros")) == 2


def test_zeros_of_other_rebounds_are_named():
    table = impacts()
    without_spins = {name: table[name] for name in ("v_x1", "v_y1", "v_x2", "v_y2")}
    assert len(notes_of(zeroed(without_spins, "v_x2", [1, 4]), "zeros")) == 1
    without_v_x2 = {name: table[name] for name in ("v_x1", "v_y1", "v_y2", "omega_2")}
    far = zeroed(without_v_x2 | {"omega_2": 300.0 + table["omega_2"]}, "omega_2", [1, 4])
    assert len(notes_of(far, "zeros")) == 1


def zero_spin_among_others():
    """Spins that a machine sets to 0 in a third of the impacts."""
    table = impacts()
    shift = table["omega_1"].copy()
    shift[4:8] = 0.0
    gain = table["omega_2"] - table["omega_1"]
    return table | {"omega_1": shift, "omega_2": shift + gain}


def rolling():
    """Impacts whose rebound spins are near 0, twice exactly."""
    table = impacts()
    gain = table["omega_2"] - table["omega_1"]
    after = np.round(np.linspace(-3.0, 3.0, gain.size))
    after[[5, 6]] = 0.0
    return table | {"omega_1": after - gain, "omega_2": after}


def drops():
    zeros = np.zeros(6)
    speed = np.linspace(5.0, 8.0, 6)
    rebound = {"v_x2": zeros, "v_y2": 0.75 * speed, "omega_2": zeros}
    return {"v_x1": zeros, "v_y1": speed, "omega_1": zeros, **rebound}


def zero_spin():
    table = impacts()
    after = table["omega_2"] - table["omega_1"]
    return table | {"omega_1": np.zeros(after.size), "omega_2": after}


@pytest.mark.parametrize(
    "table",
    [
        impacts(),
        zero_spin_among_others(),
        rolling(),
        drops(),
        zero_spin(),
        zeroed(impacts(), "omega_2", [3]),
        "wang_all",
        "wang_zero_spin",
    ],
)
def test_zeros_that_may_be_measured_are_no_note(table):
    assert notes_of(table, "zeros") == []


# ---- codes


@pytest.mark.parametrize("code", ["-999", "9999", "-99", "-9999.0", "999", "-99999"])
def test_a_code_for_what_was_not_measured_is_named_at_its_place(tmp_path, code):
    rows = ["17,20,10,4.9,18", "16,33,7.5,7.2,19", f"17,45,6.5,8.7,{code}", "16,25,9.1,5.6,12"]
    text = "\n".join(["v_1,theta_1,v_x2,v_y2,omega_2 [rev/s]", *rows])
    with pytest.raises(InputError) as caught:
        fitball.load_table(written(tmp_path, text))
    (fault,) = caught.value.faults
    assert (fault.code, fault.row, fault.column) == ("placeholder", 3, "omega_2")
    assert f"{float(code):g}" in fault.message


def test_a_negative_code_that_repeats_is_named_beside_large_numbers():
    table = impacts(6, spin=(0.0, 50.0))
    table["omega_2"][[1, 4]] = -999.0
    largest = np.abs(np.delete(table["omega_2"], [1, 4])).max()
    assert 250.0 < largest < 499.0
    with pytest.raises(InputError) as caught:
        fitball.load_table(table)
    codes = [(fault.code, fault.row, fault.column) for fault in caught.value.faults]
    assert codes == [("placeholder", row, "omega_2") for row in (2, 5)]


def test_a_number_like_a_code_among_such_numbers_is_one():
    speeds = np.array([99.0, 99.0, 60.0, 80.0])
    table = fitball.load_table({"v_y1 [km/h]": speeds, "v_y2 [km/h]": 0.6 * speeds})
    assert_allclose(table.values["v_y1"], speeds / 3.6)


# ---- columns that are not used


def test_columns_of_numbers_that_are_not_known_are_one_note():
    table = impacts(20)
    rng = np.random.default_rng(1)
    others = {
        "temperature [C]": rng.normal(20.0, 1.0, 20),
        "humidity": [*rng.normal(50.0, 5.0, 19), np.nan],
        "pressure": [f"{number:.3f}".replace(".", ",") for number in rng.normal(1.0, 0.1, 20)],
    }
    (text,) = notes_of(table | others, "not-used")
    for name in others:
        assert f"'{name}'" in text


@pytest.mark.parametrize(
    ("name", "cells"),
    [
        ("trial", [*range(1, 21)]),
        ("frame", [*range(100, 120)]),
        ("id", [*np.linspace(1.0, 9.0, 20)]),
        ("ball", [*np.linspace(1.0, 9.0, 20)]),
        ("court", [*np.linspace(1.0, 9.0, 20)]),
        ("day", [1, 2, 3, 4, 5] * 4),
        ("who", [f"{k}a" for k in range(20)]),
        ("remark", [""] * 19 + ["3"]),
        ("operator", ["ann", "bob"] * 10),
    ],
)
def test_labels_and_counts_are_no_columns_that_are_not_used(name, cells):
    assert fitball.load_table(impacts(20) | {name: cells}).notices == ()


def test_a_column_that_is_proposed_is_named_once():
    table = impacts(20)
    table["Spin out"] = table.pop("omega_2")
    loaded = fitball.load_table(table)
    assert [note.code for note in loaded.notices] == ["not-read"]
