"""Bad tables: each ends in a TableError that names row, line, column, what was read and what to do."""

import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas
import pyarrow.parquet
import pytest
from written import faults_of, only

from fitball.data.lines import parse_grid, parse_impact
from fitball.data.numbers import beyond_limit
from fitball.data.read import load_table
from fitball.errors import FitballError, ParameterError, TableError

GOOD = "v_x1 [m/s],v_y1 [m/s],omega_1 [rad/s],v_x2 [m/s],v_y2 [m/s],omega_2 [rad/s]\n"
ROW = "15.62,4.81,-5.34,11.09,4.22,239.1\n"


SLIPS = [
    ("v_y1 [m/s]", "w_y1 [m/s]"), ("v_y1 [m/s]", "v_y1b [m/s]"), ("omega_2 [rad/s]", "omga_2 [rad/s]"),
    ("omega_1 [rad/s]", "omego1"), ("v_x2 [m/s]", "v_x2c"),
]  # fmt: skip
# A header, a row of it, the column that is blamed (None: none) and words of the fault.
HEADERS = [
    *((GOOD.replace(ours, slip), ROW, slip.split()[0], f"did you mean '{ours.split()[0]}'") for ours, slip in SLIPS),
    ("v_x1,v_x2,v_y2", "8,5,3", None, "column v_y1 is missing"),
    ("v_1,v_x2,v_y2", "8,5,3", None, "column theta_1 is missing"),
    ("theta_1,v_2,v_y2", "8,5,3", None, "column v_1 is missing"),
    ("speed,v_2,v_y2", "8,5,3", None, "no incident velocity; expected v_x1 and v_y1"),
    ("v_y1,v_1,v_y2", "8,5,3", None, "v_y1 and v_1 do not make an incident velocity"),
    ("v_x1,v_y1,speed", "8,5,3", None, "no rebound column; expected at least one of v_x2, v_y2"),
    ("v_y1,v_y2,v_x2", "8,5,3", "v_x2", "expected a column v_x1"),
    # Its numbers are spared.
    (GOOD.replace("v_x1 [m/s]", "v_x1 [ell/h]"), "99999,1,0,1,1,0", "v_x1", "'[ell/h]', which is unknown"),
    (GOOD.replace("omega_2 [rad/s]", "omega_2 [km/h]"), ROW, "omega_2", "measures speed; expected a unit of spin"),
    ("v_y1 [m/s,v_y2", "5,4", "v_y1 [m/s", "brackets do not match"),
    ("v_y1,v_y2,v_y2", "5,4,4", "v_y2", "both 'v_y2'"),
    ("v_y1,v_y2 [m/s],v_y2 [km/h]", "5,4,4", "v_y2", "both 'v_y2'"),
    ("v_y1,v_y2,mass_sd", "5,4,4", "mass_sd", "'mass' cannot have a standard deviation"),
    ("v_y1,v_y2,omega_2_sd", "5,4,4", "omega_2_sd", "there is no column 'omega_2'"),
    ("v_1,v_1_sd,theta_1,v_y2", "10,0.1,30,4", "v_1_sd", "column 'theta_1_sd' is missing"),
]  # fmt: skip


@pytest.mark.parametrize(("header", "row", "column", "expected"), HEADERS)
def test_a_bad_header_is_one_fault_at_its_line(
    tmp_path: Path, header: str, row: str, column: str | None, expected: str
) -> None:
    fault = only(tmp_path, f"# comment\n{header.strip()}\n{row.strip()}\n{row.strip()}\n")
    assert (fault.row, fault.line, fault.column) == (None, 2, column)
    assert expected in fault.message


# What stands in a cell of a row that is good but for it.
NAMES = {
    "v_x1": "12", "v_y1": "5", "omega_1": "0", "v_x2": "9.5", "v_y2": "4", "omega_2": "200", "contact_time": "0.005",
    "v_y2_sd": "0.1", "omega_1_sd": "3",
}  # fmt: skip
CELLS = [
    *(("v_x2", cell, words) for cell, words in (
        ("fast", "read 'fast'; expected a number"), ("11.73 m/s", "units belong in the header"),
        ("1_000", "read '1_000'; expected a number"), ("0x1F", "read '0x1F'; expected a number"),
        ("none measured", "expected a number"), ("inf", "not finite"), ("-Infinity", "not finite"),
        ("1e999", "not finite"), ("1 234", "of thousands"), ("\u0661\u0662", "expected a number"),
        ('"11,73"', "write '11.73'"),
        ('"1,234"', "which may be 1.234 or 1234"), ('"1,234.5"', "of thousands"),
    )),
    ("v_y1", "-5", "a positive speed towards the court"), ("v_y1", "0", "a positive speed towards the court"),
    ("v_y2", "0", "a positive speed away from the court"), ("v_y2", "-4", "expected one sign"),
    ("v_y2", "5.51", "coefficient of restitution above 1: 1.102"), ("v_x2", "16", "more energy"),
    ("omega_2", "415", "more energy"), ("omega_2", "2283", "more energy"),
    ("contact_time", "0", "a positive time"),
    ("v_y2_sd", "0", "a positive standard deviation"), ("v_y2_sd", "-1", "a positive standard deviation"),
]  # fmt: skip
# What no ball has: refused before anything is computed with it.
LIMITS = [
    ("v_y1", "1001", "0.001 to 1000 m/s"), ("v_y1", "5e-324", "0.001 to 1000 m/s"),
    ("v_x1", "-1001", "at most 1000 m/s"), ("v_x2", "1e308", "at most 1000 m/s"),
    ("omega_1", "1.1e5", "at most 1e5 rad/s"), ("omega_2", "-1.1e5", "at most 1e5 rad/s"),
    ("contact_time", "5", "0.1 to 100 ms"), ("contact_time", "5e-6", "0.1 to 100 ms"),
    ("v_y2_sd", "1e200", "1e-9 to 1000 m/s"),
    ("v_y2_sd", "1e-200", "1e-9 to 1000 m/s"), ("omega_1_sd", "1e300", "1e-9 to 1e5 rad/s"),
]  # fmt: skip


@pytest.mark.parametrize(("column", "cell", "expected"), CELLS + LIMITS)
def test_a_bad_cell_is_one_fault_in_its_place(tmp_path: Path, column: str, cell: str, expected: str) -> None:
    row, bad = ",".join(NAMES.values()), ",".join((NAMES | {column: cell}).values())
    fault = only(tmp_path, f"{','.join(NAMES)}\n\n# this and a blank line shift lines\n{row}\n{row}\n{bad}\n{row}\n")
    assert (fault.row, fault.line, fault.column) == (3, 6, column)
    assert expected in fault.message
    if (column, cell, expected) in LIMITS:
        read = re.match(r"read (\S+) .*: check the unit", fault.message)
        assert read is not None and float(read[1]) == pytest.approx(float(cell)) and len(fault.message) < 120


def test_line_numbers_survive_quoted_line_breaks(tmp_path: Path) -> None:
    text = 'note,v_y1,v_y2\n"one\n# two\n\nthree",5,4\nx,5,oops\n'
    fault = only(tmp_path, text)
    assert (fault.row, fault.line) == (2, 6)


@pytest.mark.parametrize(
    ("header", "row", "column", "expected"),
    [
        ("v_1,theta_1,v_2,theta_2", "17,17,16,40", "v_2", "coefficient of restitution"),
        ("v_1,theta_1,v_2", "17,17,18.5", "v_2", "more energy"),
        ("v_1,theta_1,v_2", "-17,17,12", "v_1", "a positive speed"),
        ("v_1,theta_1,v_2", "17,17,0", "v_2", "a positive speed"),
        ("v_1,theta_1 [rad],v_2", "17,17.13,12", "theta_1", "between 0 and 180 deg: check the unit"),
        ("v_x1,v_y1,v_x2,v_2", "12,5,9.0,8.0", "v_x2", "at most the rebound speed"),
        ("v_x1,v_y1,v_x2,theta_2", "12,5,-9,30", "v_x2", "a positive v_x2 where theta_2 is below 90"),
        ("v_y1,v_y2", "5,6.5", "v_y2", "coefficient of restitution above 1: 1.3"),
    ],
)
def test_impossible_in_other_columns(tmp_path: Path, header: str, row: str, column: str, expected: str) -> None:
    faults = faults_of(tmp_path, f"{header}\n{row}\n{row}\n")
    assert [(fault.row, fault.column) for fault in faults] == [(1, column), (2, column)]
    assert expected in faults[0].message


@pytest.mark.parametrize(
    ("header", "row", "column"),
    [
        ("v_x1,v_y1,v_1 [km/h],v_y2", "12,5,13,4", "v_1"),
        ("v_x1,v_y1,v_x2,v_y2,theta_2", "12,5,9,4,50", "theta_2"),
        ("v_x1,v_y1,v_x2,v_2,theta_2", "12,5,4,9,24", "v_x2"),
    ],
)
def test_gross_disagreement_of_redundant_columns(tmp_path: Path, header: str, row: str, column: str) -> None:
    faults = faults_of(tmp_path, f"{header}\n{row}\n{row}\n")
    assert [fault.column for fault in faults] == [column, column]
    assert "check the units" in faults[0].message and " give " in faults[0].message


def test_incident_angle_of_mixed_sign_points_at_the_odd_row(tmp_path: Path) -> None:
    fault = only(tmp_path, "v_1,theta_1,v_y2\n10,-30,4\n10,40,4\n10,-50,4\n")
    assert (fault.row, fault.column) == (2, "theta_1")


def test_one_row_only(tmp_path: Path) -> None:
    fault = only(tmp_path, GOOD + ROW)
    assert fault.row == 1 and "one row only; expected at least 2 impacts" in fault.message


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (b"", "the file is empty"),
        (b" \n\n", "the file is empty"),
        (b"# only words\n", "only blank and comment lines"),
        (GOOD.encode(), "no rows"),
    ],
)
def test_nothing_in_it(tmp_path: Path, data: bytes, expected: str) -> None:
    assert expected in only(tmp_path, data).message


def test_wrong_encoding_names_byte_and_line(tmp_path: Path) -> None:
    """A control code of Latin-1; a letter of Latin-1 in a file that has letters in UTF-8."""
    head = "surface,v_y1,v_y2\nplain,5,4\n"
    for tail in ("ras\x81,5,4\n".encode("latin-1"), b"ras\xe9,5,4\n" + "rasé,5,4\n".encode()):
        fault = only(tmp_path, head.encode() + tail)
        assert fault.line == 3
        assert "at offset 31" in fault.message and "UTF-8" in fault.message


def test_decimal_commas_between_commas_are_refused(tmp_path: Path) -> None:
    faults = faults_of(tmp_path, GOOD + ROW.replace(".", ",") * 3)
    assert [fault.row for fault in faults] == [1, 2, 3]
    assert "expected 6 as in the header" in faults[0].message


def test_ragged_rows(tmp_path: Path) -> None:
    faults = faults_of(tmp_path, f"{GOOD}{ROW}1,2\n{ROW.strip()},7\n,,,,,\n{ROW}")
    assert [(fault.row, fault.line) for fault in faults] == [(2, 3), (3, 4)]
    assert "read 2 cells, expected 6" in faults[0].message
    assert "write decimal points" in faults[1].message


def test_open_quote(tmp_path: Path) -> None:
    fault = only(tmp_path, f'{GOOD}{ROW}"15,4.81\n')
    assert fault.line == 3 and "double quotes" in fault.message


def test_all_faults_of_a_file_at_once(tmp_path: Path) -> None:
    text = (
        "v_x1b,v_y1 [m/h],omega_1,v_x2,v_y2,omega_2,v_2_sd\n"
        "15,5,0,fast,4,200,1\n"
        "15,5,0,10,?,200,1\n"
        "15,5,0,10\n"
        "15,5,0,10,4,inf,-1\n"
    )
    faults = faults_of(tmp_path, text)
    assert [(fault.row, fault.line, fault.column) for fault in faults] == [
        (None, 1, "v_x1b"),
        (None, 1, "v_y1"),
        (None, 1, "v_2_sd"),
        (1, 2, "v_x2"),
        (2, 3, "v_y2"),
        (3, 4, None),
        (4, 5, "omega_2"),
        (4, 5, "v_2_sd"),
    ]


def test_what_cannot_be_opened(tmp_path: Path) -> None:
    (tmp_path / "t.xls").write_bytes(b"PK")
    with pytest.raises(TableError, match="not a workbook"):
        load_table(tmp_path / "t.xls")
    with pytest.raises(TableError, match="no such file"):
        load_table(tmp_path / "absent.csv")


def test_parquet_reads_like_csv(tmp_path: Path) -> None:
    frame = pandas.DataFrame({"v_y1 [km/h]": [36.0, 54.0], "v_y2": [7, 8], "surface": ["a", "b"]})
    frame.to_parquet(tmp_path / "t.parquet")
    table = load_table(tmp_path / "t.parquet")
    assert table.impacts.v_y1.tolist() == [10.0, 15.0]
    assert table.labels["surface"] == ("a", "b")
    frame.loc[1, "v_y1 [km/h]"] = float("nan")
    frame.to_parquet(tmp_path / "t.pq", compression="zstd", index=False)
    with pytest.raises(TableError) as caught:
        load_table(tmp_path / "t.pq")
    (fault,) = caught.value.faults
    assert fault.message.startswith("1 of 2 rows are left; expected 2: row 2: ")


@pytest.mark.parametrize("kept", [0.01, 0.3, 0.9, 1.0])
def test_a_damaged_parquet_file_is_refused_in_words(tmp_path: Path, kept: float) -> None:
    """Files cut short, and one whose footer does not say how long it is."""
    place = tmp_path / "t.parquet"
    pandas.DataFrame({"v_y1": np.linspace(5.0, 6.0, 50), "v_y2": 4.0}).to_parquet(place)
    whole = place.read_bytes()
    place.write_bytes(whole[: int(kept * len(whole))] if kept < 1.0 else whole[:-8] + b"\xff" * 4 + whole[-4:])
    with pytest.raises(FitballError, match="not a Parquet file"):
        load_table(place)


@pytest.mark.parametrize("notes", [b"{}", b'{"index_columns": [{"kind": "range"}]}', b'{"columns": 1}', b"no JSON"])
def test_parquet_with_damaged_notes_of_pandas_is_refused_in_words(tmp_path: Path, notes: bytes) -> None:
    """What pandas keeps of its columns in the file, as a flipped byte leaves it."""
    table = pyarrow.table({"v_y1": [5.0, 6.0], "v_y2": [4.0, 4.7]}).replace_schema_metadata({"pandas": notes})
    pyarrow.parquet.write_table(table, tmp_path / "t.parquet")
    with pytest.raises(FitballError, match="not a Parquet file"):
        load_table(tmp_path / "t.parquet")


def test_parquet_without_pyarrow_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pandas.DataFrame({"v_y1": [5.0, 6.0], "v_y2": [4.0, 4.7]}).to_parquet(tmp_path / "t.parquet")
    # pandas asks anew each time; None in this place is how Python notes that a module is not there.
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(FitballError, match="needs the package 'pyarrow'"):
        load_table(tmp_path / "t.parquet")


@pytest.mark.parametrize("row", ["5,oops", "5,9", "-5,4", "5", "5,1e308"])
def test_a_thousand_bad_rows_are_told_in_bounds(tmp_path: Path, row: str) -> None:
    path = tmp_path / "t.csv"
    path.write_text("v_y1,v_y2\n5,4\n" + f"{row}\n" * 1000)
    with pytest.raises(TableError) as caught:
        load_table(path)
    assert len(caught.value.faults) >= 1000
    assert "1,000 rows (first: row 2, line 3)" in str(caught.value)
    assert str(caught.value).count("(first: ") == 1 and len(str(caught.value)) < 3000


def test_a_folder_or_a_loop_is_no_table_and_a_long_name_is_no_crash(tmp_path: Path) -> None:
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    for source, word in (
        (tmp_path, "is a folder"),
        (tmp_path / "loop.csv", "no such file"),
        ("a" * 5000, "no such file"),
    ):
        with pytest.raises(TableError, match=word):
            load_table(source)


def test_a_name_that_is_no_text_is_refused_before_result_files_name_it(tmp_path: Path) -> None:
    for place in (os.fsdecode(b"a\xff.csv"), os.fsdecode(b"b\xfe") + "/t.csv"):
        path = tmp_path / place
        try:
            path.parent.mkdir(exist_ok=True)
            path.write_text(GOOD + 2 * ROW, encoding="utf-8")
        except (OSError, UnicodeError):
            pytest.skip("this file system has no such names")
        with pytest.raises(TableError, match=r"not UTF-8"):
            load_table(path)


@pytest.mark.parametrize(
    ("header", "value", "expected"),
    [
        ("v_1 [mph],theta_1 [deg]", "1e308,20", "not finite in SI units"),
        ("v_1,theta_1", "17,1e-9", "at least 0.006 deg"),
        ("v_1,theta_1", "0e400,20", "expected a number"),
        ("v_1,theta_1", "1e-99999999999999999999,20", "expected a number"),
        ("v_1,theta_1", "9" * 330 + ",20", "which is not finite"),
    ],
)
def test_numbers_that_arithmetic_does_not_hold(tmp_path: Path, header: str, value: str, expected: str) -> None:
    fault = only(tmp_path, f"{header},v_2,theta_2\n38,20,12,24\n{value},12,24\n")
    assert fault.row == 2
    assert expected in fault.message


def test_the_flattest_incidence_is_a_ten_thousandth_of_a_radian() -> None:
    flat = np.array([0.99e-4, 1.01e-4, 0.0, np.pi])
    # Zero is told by the check of ranges.
    assert beyond_limit("theta_1", flat).tolist() == [True, False, False, False]
    assert not beyond_limit("theta_2", flat).any()


def test_limits_themselves_are_allowed(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(
        "v_x1,v_y1,omega_1,v_y2,contact_time [ms]\n1000,0.001,1e5,0.001,0.1\n-1000,1000,-1e5,1,100\n"
    )
    assert len(load_table(tmp_path / "t.csv")) == 2


def test_a_label_is_a_name(tmp_path: Path) -> None:
    fault = only(tmp_path, f"surface,v_y1,v_y2\nclay,5,4\n{'a' * 100_000},5,4\n")
    assert (fault.row, fault.column) == (2, "surface")
    assert "read a text of 100000 characters; expected at most 200" in fault.message


IMPACTS = ("v=1e308 mph, theta=18", "v=17, theta=18, spin=2e5", "v=17±1e300, theta=18", "v=17, theta=1e-9")
GRIDS = ("v_y=10..1e308 mph:3", "v_y=1e-9", "v_y=5, spin=-2e5..0:3")


@pytest.mark.parametrize(
    ("parse", "text"), [*((parse_impact, text) for text in IMPACTS), *((parse_grid, text) for text in GRIDS)]
)
def test_options_have_the_limits_of_tables(parse: Callable[[str], object], text: str) -> None:
    with pytest.raises(ParameterError, match=r"expected .* check the unit"):
        parse(text)


@pytest.mark.parametrize("count", ["99999999", "9" * 400])
def test_a_grid_of_too_many_points_is_refused_before_it_is_made(count: str) -> None:
    with pytest.raises(ParameterError, match="expected 1,000,000"):
        parse_grid(f"v_y=5..10:{count}")
