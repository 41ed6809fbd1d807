"""Cells that were mistyped: faults name the column of the file, and what was typed."""

import numpy as np
import pytest

import fitball
from fitball.base.errors import InputError

DROPS = np.full(12, 254.0)
REBOUNDS = np.array(
    [144.9, 144.5, 144.7, 146.4, 144.2, 143.9, 148.1, 148.0, 144.5, 143.6, 141.6, 140.8]
)


def drops(**changed):
    """A drop test in cm, with one cell changed in each column that is named."""
    columns = {"drop_height": DROPS.copy(), "rebound_height": REBOUNDS.copy()}
    for name, (row, value) in changed.items():
        columns[name][row] = value
    return {f"{name} [cm]": values for name, values in columns.items()}


def faults_of(table, **reading):
    with pytest.raises(InputError) as refusal:
        fitball.load_table(table, **reading)
    return refusal.value.faults


def slips_of(table):
    return [note.text for note in table.notices if note.code == "slip"]


def test_a_slip_in_a_drop_height_is_told_of_the_drop_height():
    (fault,) = faults_of(drops(drop_height=(2, 2.54)))
    assert (fault.code, fault.row, fault.column) == ("restitution", 3, "drop_height")
    assert "2.54 cm" in fault.message
    assert "a hundredth of" in fault.message
    assert "v_y2" not in fault.message


def test_a_slip_in_a_rebound_height_is_told_of_the_rebound_height():
    (fault,) = faults_of(drops(rebound_height=(4, 1442.0)))
    assert (fault.code, fault.row, fault.column) == ("restitution", 5, "rebound_height")
    assert "ten times" in fault.message


def test_without_a_slip_the_heights_are_told_as_they_stand():
    (fault,) = faults_of(drops(rebound_height=(4, 400.0)))
    assert (fault.row, fault.column) == (5, "rebound_height")
    assert "drop_height = 254 cm and rebound_height = 400 cm" in fault.message
    assert "rebound_height exceeds drop_height" in fault.message


def test_faults_name_columns_as_the_file_does():
    """Not by the names that --columns gives them."""
    columns = {
        "Fall (cm)": [254, 2.54, 254, 254, 254, 254],
        "Hoch (cm)": [140, 141, 139, 140, 142, 140],
    }
    names = {"drop_height": "Fall", "rebound_height": "Hoch"}
    (fault,) = faults_of(columns, columns=names)
    assert (fault.row, fault.column) == (2, "Fall")
    (fault,) = faults_of({**columns, "Fall (cm)": [254, 254, -3, 254, 254, 254]}, columns=names)
    assert (fault.code, fault.row, fault.column) == ("out-of-limits", 3, "Fall")


@pytest.mark.parametrize(
    ("columns", "expected"),
    [
        (drops(rebound_height=(7, 14.80)), "row 8, rebound_height: read 14.8 cm, a tenth of"),
        (drops(drop_height=(0, 2540.0)), "row 1, drop_height: read 2540 cm, ten times"),
        (
            {"v_y1": [7.0, 7.1, 6.9, 0.7, 7.0, 7.0], "v_y2": [5.0, 5.1, 4.9, 0.50, 5.0, 5.0]},
            "row 4, v_y1: read 0.7 m/s, a tenth of",
        ),
    ],
)
def test_slips_in_rows_that_are_possible_are_noted(columns, expected):
    (text,) = slips_of(fitball.load_table(columns))
    assert expected in text


@pytest.mark.parametrize(
    "columns",
    [
        drops(),
        # Several heights, spins and angles that differ by design, and a column that crosses zero.
        {
            "drop_height": [0.1, 0.1, 0.1, 1, 1, 1, 1, 1, 1],
            "rebound_height": [0.06, 0.06, 0.06, *6 * [0.55]],
        },
        {"drop_height": [0.5, 1, 1.5, 2, 2.5, 3], "rebound_height": [0.3, 0.6, 0.9, 1.2, 1.4, 1.7]},
        {"v_1": [9, 8, 9, 9, 8, 9], "theta_1": [20, 21, 20, 22, 21, 89], "v_2": [7, 6, 7, 6, 7, 6]},
    ],
)
def test_heights_that_differ_by_design_are_no_slips(columns):
    assert not slips_of(fitball.load_table(columns))


def test_a_surface_that_moves_is_named_where_most_balls_leave_faster():
    """A racket's impacts in the frame of the court; one fast rebound names no racket."""
    moving = {"v_y1": [23.3, 13.0, 21.6, 18.5], "v_y2": [28.9, 27.4, 19.8, 35.9]}
    assert "surface_speed" in faults_of(moving)[0].message
    single = {"v_y1": [7.0, 7.0, 7.0, 7.0, 7.0], "v_y2": [5.0, 5.0, 5.0, 12.0, 5.0]}
    assert "surface_speed" not in faults_of(single)[0].message
