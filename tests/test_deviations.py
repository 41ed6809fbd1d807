"""Cells of a number with its standard deviation: in per cent, and in the concise notation of the
GUM (JCGM 100:2008, 7.2.2), whose examples are 100.021 47(35) g and 100.021 47(0.000 35) g.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose

import fitball
from fitball.base.errors import InputError
from fitball.data.deviations import with_deviation

# A cell, its number and its standard deviation.
CELLS = [
    ("100.02147(35)", 100.02147, 0.00035),
    ("100.02147(0.00035)", 100.02147, 0.00035),
    ("5.2(3)", 5.2, 0.3),
    ("5.20(13)", 5.2, 0.13),
    ("5.2(12)", 5.2, 1.2),
    ("62(4)", 62.0, 4.0),
    ("1.23(4)e-1", 0.123, 0.004),
    ("0.52(3)E1", 5.2, 0.3),
    (".52(3)", 0.52, 0.03),
    ("5.2 ± 3 %", 5.2, 0.156),
    ("5.2±3%", 5.2, 0.156),
    ("5.2 +/- 2.5 %", 5.2, 0.13),
    ("5.2 ± 0.3", 5.2, 0.3),
]


def table_of(folder, text):
    path = folder / "balls.csv"
    path.write_text(text, encoding="utf-8")
    return fitball.load_table(path)


@pytest.mark.parametrize(("cell", "value", "sd"), CELLS)
def test_a_cell_has_a_number_and_its_standard_deviation(tmp_path, cell, value, sd):
    head = "v_y1 [km/h],v_y2 [km/h]"
    table = table_of(tmp_path, f"{head}\n300,{cell}\n320,{cell}\n")
    assert_allclose(table.values["v_y2"], value / 3.6, rtol=1e-12)
    assert_allclose(table.sd["v_y2"], sd / 3.6, rtol=1e-12)
    assert "plus-minus" in {note.code for note in table.notices}


def test_cells_with_decimal_commas(tmp_path):
    table = table_of(tmp_path, "v_y1;v_y2\n6,2(3);-5,2 ± 2 %\n7,1(0,4);-5,9 ± 1,5%\n")
    assert_allclose(table.values["v_y1"], [6.2, 7.1])
    assert_allclose(table.sd["v_y1"], [0.3, 0.4])
    # The share is that of the size.
    assert_allclose(np.abs(table.values["v_y2"]), [5.2, 5.9])
    assert_allclose(table.sd["v_y2"], [0.104, 0.0885])


@pytest.mark.parametrize(
    "cell", ["5.2 (3)", "5.2(3", "5.2(-3)", "5.2()", "(3)", "5.2(3)(4)", "5(a)"]
)
def test_other_brackets_are_no_deviations(tmp_path, cell):
    with pytest.raises(InputError) as caught:
        table_of(tmp_path, f"v_y1,v_y2\n6,{cell}\n7,5\n")
    assert [fault.code for fault in caught.value.faults] == ["not-a-number"]
    assert caught.value.faults[0].column == "v_y2"


def test_percent_of_a_number_in_percent_may_be_two_things(tmp_path):
    with pytest.raises(InputError) as caught:
        table_of(tmp_path, "v_y1,cor [%]\n6.2,75 ± 3 %\n6.3,76 ± 3 %\n")
    assert {fault.code for fault in caught.value.faults} == {"not-a-number"}
    table = table_of(tmp_path, "v_y1,cor [%]\n6.2,75(3)\n6.3,76(3)\n")
    assert_allclose(table.values["v_y2"], [6.2 * 0.75, 6.3 * 0.76])


def test_a_deviation_of_one_cell_is_missing_in_others(tmp_path):
    with pytest.raises(InputError) as caught:
        table_of(tmp_path, "v_y1,v_y2\n6.2(3),5\n7,6\n")
    assert {fault.code for fault in caught.value.faults} == {"no-sd"}


@pytest.mark.parametrize("text", ["", "5.2", "ball (3)", "5.2(3) m/s", "±", "12:30", "(5.2)"])
def test_other_texts_have_none(text):
    assert with_deviation(text) is None
