"""Tables too large for memory are refused in words before they are read; large ones that are none are read."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import openpyxl
import pandas
import pytest

from fitball.data import workbooks
from fitball.data.read import load_table
from fitball.data.workbooks import _BinarySheet, check_shape, check_workbook, most_cells
from fitball.errors import TableError

ROWS = [("v_y1", "v_y2"), (5.0, 4.0), (6.0, 5.0)]
TEMPLATE = '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"><sheetData>{}</sheetData></worksheet>'


def workbook(place: Path, *blanks: str) -> Path:
    book = openpyxl.Workbook()
    for row in ROWS:
        book.active.append(row)
    for blank in blanks:
        book.active[blank] = " "
    book.save(place)
    return place


def with_sheet(place: Path, body: str) -> Path:
    """A workbook whose sheet has this body instead."""
    workbook(place)
    with zipfile.ZipFile(place) as book:
        parts = {name: book.read(name) for name in book.namelist()}
    parts["xl/worksheets/sheet1.xml"] = TEMPLATE.format(body).encode()
    with zipfile.ZipFile(place, "w", zipfile.ZIP_DEFLATED) as book:
        for name, data in parts.items():
            book.writestr(name, data)
    return place


@pytest.mark.parametrize("blank", ["XFD50000", "XFD3000", "AZ1048576"])
def test_a_blank_cell_far_away_is_refused(tmp_path: Path, blank: str) -> None:
    with pytest.raises(TableError, match=r"rows of .* columns as far as its last cell .*: too large to be read"):
        load_table(workbook(tmp_path / "t.xlsx", blank))


def test_a_blank_cell_not_so_far_away_is_none(tmp_path: Path) -> None:
    assert len(load_table(workbook(tmp_path / "t.xlsx", "E900"))) == 2


def test_formats_far_away_are_no_cells(tmp_path: Path) -> None:
    place = tmp_path / "t.xlsx"
    workbook(place)
    book = openpyxl.load_workbook(place)
    book.active["XFD50000"].font = openpyxl.styles.Font(bold=True)
    book.save(place)
    assert len(load_table(place)) == 2


@pytest.mark.parametrize(
    "body",
    [
        '<row r="1"><c r="A1"><v>1</v></c></row><row><c foo="&gt;" r="XFD50000"><v>1</v></c></row>',
        '<row r="50000"><c><v>1</v></c></row>' + "<row>" + "<c><v>1</v></c>" * 120 + "</row>",
        "<dimension ref='A1:B2'/>" + '<row><c r="A1"><v>1</v></c><c r="ZZ1048576"><f>1</f></c></row>',
    ],
)
def test_places_are_those_of_cells_whatever_is_declared(tmp_path: Path, body: str) -> None:
    with pytest.raises(TableError, match="too large to be read"):
        load_table(with_sheet(tmp_path / "t.xlsx", body))


def test_what_unpacks_to_more_than_its_cells_take_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever size the archive declares."""
    monkeypatch.setattr(workbooks, "SLACK", 1_000_000)
    place = with_sheet(tmp_path / "t.xlsx", '<row><c t="inlineStr"><is><t>' + "x" * 3_000_000 + "</t></is></c></row>")
    data = place.read_bytes()
    assert len(data) < 100_000
    lie = data.replace((3_000_000 + len(TEMPLATE) - 2 + 58).to_bytes(4, "little"), (10).to_bytes(4, "little"))
    for given in (data, lie):
        with pytest.raises(TableError, match="unpacks to more than"):
            check_workbook("t", given, ".xlsx")


def test_sheets_count_together(tmp_path: Path) -> None:
    book = openpyxl.Workbook()
    for _ in range(4):
        book.create_sheet()["CV20000"] = " "
    book.save(tmp_path / "t.xlsx")
    with pytest.raises(TableError, match="in all sheets together"):
        load_table(tmp_path / "t.xlsx")


def ods(body: str) -> bytes:
    spaces = " ".join(f'xmlns:{name}="urn:{name}"' for name in ("office", "table", "text"))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as book:
        book.writestr(
            "content.xml", f'<office:x {spaces}><table:table table:name="t">{body}</table:table></office:x>'
        )
    return packed.getvalue()


@pytest.mark.parametrize(
    ("body", "large"),
    [
        ('<table:table-row><table:table-cell office:value-type="float" '
         'table:number-columns-repeated="20000"/>', True),
        ('<table:table-row table:number-rows-repeated="60000"><table:table-cell table:number-columns-repeated="100">'
         "<text:p>1</text:p></table:table-cell>", True),
        ('<table:table-row table:number-rows-repeated="1048571"><table:table-cell '
         'table:number-columns-repeated="16384"/>', False),
    ],
)  # fmt: skip
def test_repeated_cells_of_open_document_count(body: str, large: bool) -> None:
    data = ods(f"{body}</table:table-row>")
    if not large:
        check_workbook("t", data, ".ods")
        return
    with pytest.raises(TableError, match="too large to be read"):
        check_workbook("t", data, ".ods")


def test_cells_of_binary_workbooks() -> None:
    """Records written by hand after [MS-XLSB] 2.1.4: row 49,999, a number in column 16,383, a blank further on."""

    def record(kind: bytes, content: bytes) -> bytes:
        return kind + bytes([len(content)]) + content

    cell = (16_383).to_bytes(4, "little") + bytes(12)
    data = (
        record(b"\x81\x01", b"") + record(b"\x00", (49_999).to_bytes(4, "little") + bytes(13)) + record(b"\x05", cell)
    )
    data += record(b"\x00", (99_999).to_bytes(4, "little") + bytes(13)) + record(b"\x01", cell)
    for step in (1, 7, len(data)):
        sheet = _BinarySheet()
        for at in range(0, len(data), step):
            sheet.feed(data[at : at + step])
        sheet.feed(b"", True)
        assert sheet.boxes == [(50_000, 16_384)]


def test_parquet_says_how_large_it_is(tmp_path: Path) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    place = tmp_path / "t.parquet"
    pandas.DataFrame({"v_y1": np.full(3_000_000, 5.0), "v_y2": np.full(3_000_000, 4.0)}).to_parquet(place)
    with pytest.raises(TableError, match="3,000,000 rows of 2 columns: too large to be read"):
        load_table(place)
    texts = pyarrow.DictionaryArray.from_arrays(np.zeros(20_000, dtype=np.int32), ["x" * 20_000])
    numbers = pandas.DataFrame({"v_y1": np.full(20_000, 5.0), "v_y2": np.full(20_000, 4.0)})
    table = pyarrow.Table.from_pandas(numbers).append_column("t", texts.cast(pyarrow.string()))
    pyarrow.parquet.write_table(table, place)
    assert place.stat().st_size < 100_000
    with pytest.raises(TableError, match="unpacks to more than"):
        load_table(place)


def test_texts_are_counted_before_they_are_taken_apart(tmp_path: Path) -> None:
    place = tmp_path / "t.csv"
    for text, words in (
        ("v_y1,v_y2\n" + "\n" * 2_100_000, "2,100,001 lines"),
        ("v_y1,v_y2\n" + "5," * 20_000 + "\n6,5\n", "columns: too large"),
        ("v_y1,v_y2\n5,4 " + "x" * 65_000_000, "lines, 65 MB: too large"),
    ):
        place.write_text(text)
        with pytest.raises(TableError, match=words):
            load_table(place)


def test_limits_leave_a_million_rows_of_fifteen_columns() -> None:
    check_shape("t", 1_000_000, 15)
    check_shape("t", 100_000, 50)
    assert [most_cells(rows) for rows in (2, 100_000, 200_000, 10**9)] == [
        5_000_000,
        5_000_000,
        10_000_000,
        20_000_000,
    ]
    for rows, columns in ((100_000, 51), (2_000_001, 1), (2, 10_001)):
        with pytest.raises(TableError, match="too large to be read"):
            check_shape("t", rows, columns)


def test_faults_beyond_some_are_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fitball.data.cells.MOST_FAULTS", 10)
    (tmp_path / "t.csv").write_text("v_y1,v_y2\n" + "x,y\n" * 40)
    with pytest.raises(TableError, match="70 more faults, which are not listed") as caught:
        load_table(tmp_path / "t.csv")
    assert len(caught.value.faults) == 11
