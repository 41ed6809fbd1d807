"""Mistakes of tables (`data/mistakes.toml`): each is refused with its code, row, line and column,
all at once.
"""

import tomllib
from pathlib import Path

import pytest
from made_tables import written

import fitball
from fitball.base.errors import FolderError, InputError, ParameterError
from fitball.data.check import check

MISTAKES = tomllib.loads(
    (Path(__file__).parent / "data" / "mistakes.toml").read_text(encoding="utf-8")
)
# A row that is good.
GOOD = {
    "v_x1": "12",
    "v_y1": "5",
    "omega_1": "0",
    "v_x2": "9.5",
    "v_y2": "4",
    "omega_2": "200",
    "contact_time": "0.005",
    "v_y2_sd": "0.1",
    "omega_1_sd": "3",
}


def placed(faults):
    def line(fault):
        return " ".join("-" if field is None else str(field) for field in fault)

    return sorted(map(line, faults))


def faults_of(source, **reading):
    """Of `load_table`, which `check` lists too."""
    with pytest.raises(InputError) as caught:
        fitball.load_table(source, **reading)
    listed = check(source, None, False, **reading)
    assert listed.failed
    assert listed.frames["faults"]["code"].tolist() == [fault.code for fault in caught.value.faults]
    return placed(
        (fault.code, fault.row, fault.line, fault.column) for fault in caught.value.faults
    )


@pytest.mark.parametrize(
    ("header", "row", "faults"),
    [(header, row, faults) for header, row, *faults in MISTAKES["header"]],
)
def test_headers(tmp_path, header, row, faults):
    assert faults_of(written(tmp_path, f"# comment\n{header}\n{row}\n{row}\n")) == sorted(faults)


@pytest.mark.parametrize(("column", "cell", "code"), MISTAKES["cell"])
def test_cells(tmp_path, column, cell, code):
    good = ",".join(GOOD.values())
    bad = ",".join((GOOD | {column: cell}).values())
    text = (
        f"{','.join(GOOD)}\n\n# this and a blank line shift lines\n{good}\n{good}\n{bad}\n{good}\n"
    )
    code, _, where = code.partition(" ")
    assert faults_of(written(tmp_path, text)) == [f"{code} 3 6 {where or column}"]


@pytest.mark.parametrize("case", MISTAKES["file"])
def test_files(tmp_path, case):
    reading = {name: option for name, option in case.items() if name not in ("text", "faults")}
    assert faults_of(written(tmp_path, case["text"]), **reading) == sorted(case["faults"])


@pytest.mark.parametrize("row", ["5,oops", "5,9", "-5,4", "5", "5,1e308"])
def test_a_thousand_bad_rows_are_told_in_bounds(tmp_path, row):
    with pytest.raises(InputError) as caught:
        fitball.load_table(written(tmp_path, "v_y1,v_y2\n5,4\n" + f"{row}\n" * 1000))
    assert len(caught.value.faults) == 1000
    assert len(str(caught.value)) < 3000


def test_what_is_no_table(tmp_path):
    (tmp_path / "loop.csv").symlink_to("loop.csv")
    for source in (
        tmp_path,
        tmp_path / "loop.csv",
        tmp_path / "absent.csv",
        "a" * 5000,
        "wang_topsin",
    ):
        with pytest.raises(FolderError) as caught:
            fitball.load_table(source)
        assert caught.value.code == "not-found"
    for other in (3.0, [1.0, 2.0], None):
        with pytest.raises(ParameterError) as refused:
            fitball.load_table(other)
        assert refused.value.code == "not-a-table"


@pytest.mark.parametrize(
    ("reading", "code"),
    [
        ({"flip": "omega_3"}, "unknown-column"),
        ({"flip": ["v_x1", "contact_time"]}, "unknown-column"),
        ({"ignore": "v_3"}, "unknown-column"),
        ({"ignore": ["omega_2_sd"]}, "unknown-column"),
        ({"columns": {"speed_in": "Vin"}}, "columns"),
        ({"columns": {"v_1": "Vin", "v_2": "vin"}}, "columns"),
    ],
)
def test_options_that_name_nothing(tmp_path, reading, code):
    row = ",".join(GOOD.values())
    with pytest.raises(ParameterError) as caught:
        fitball.load_table(written(tmp_path, f"{','.join(GOOD)}\n{row}\n{row}\n"), **reading)
    assert caught.value.code == code


def test_one_fault_of_many_rows_is_one_fault(tmp_path, monkeypatch):
    """Said once, with the rows; each is still in the frame of faults."""
    rows = "".join(f"{5 + 0.1 * k:.1f},{9 + 0.1 * k:.1f}\n" for k in range(36))
    table = written(tmp_path, f"v_y1,v_y2\n{rows}")
    with pytest.raises(InputError) as caught:
        fitball.load_table(table)
    assert [fault.row for fault in caught.value.faults] == [*range(1, 37)]
    assert "rows 1 to 36 (first: line 2)" in str(caught.value)
    assert str(caught.value).count("v_y2 exceeds v_y1") == 1
    # The page has the path of the table.
    monkeypatch.chdir(tmp_path)
    checked = fitball.check(Path(table).name)
    page = checked.report()
    assert "1 fault, in 36 rows" in page
    assert page.count("v_y2 exceeds") == 1
    assert len(page) < 2000
    assert len(checked.frames["faults"]) == 36


def test_faults_of_two_columns_are_two(tmp_path):
    table = written(tmp_path, "v_1,theta_1,v_y2\n5,30,2\n-5,300,2\n5,30,2\n-6,400,2\n")
    with pytest.raises(InputError) as caught:
        fitball.load_table(table)
    assert "2 faults, in 2 rows" in str(caught.value)
    page = fitball.check(table).report()
    assert "2 faults, in 2 rows" in page
    assert page.count("2 and 4") == 2
