"""Files that would take all memory, or for ever, are refused with words inside 1 GB; those that
only look so are not.

All run in one process, of which the peak is measured; it is ended where a search grows faster than
its text (10^10 steps and more, which no machine does in the time that is given).
"""

import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pandas
import pyarrow.parquet
import pytest
from numpy.testing import assert_array_equal
from support.workbooks import cell, ods, packed, row, xlsx

from fitball.base.errors import InputError
from fitball.data.cells import numbers
from fitball.data.sources import read_cells

PROGRAM = """
import json, sys
from pathlib import Path
from fitball.data.cells import numbers
from fitball.data.sources import read_cells
from fitball.data.header import Naming, read_header
from fitball.base.errors import InputError

def read(source):
    naming = Naming({})
    try:
        cells = read_cells(source, naming.worth)
        numbers(cells, read_header(cells, naming).numbers)
        cells.refuse()
        return ["read", len(cells.rows)]
    except InputError as error:
        return [error.code, error.faults[0].line]

outcomes = {Path(path).name: read(path) for path in sys.argv[1:]}
pieces = ["horiz", "1", "of", "v_", " ", "a ", "/", "v /", "[", "(", "1+-", "1,", "1,11111", "1e"]
pieces += [",111", "-1", "s^", "θ", "aB", "1 ", "\\t", "1..", "±", "m s ", "_", "1.", "corr("]
for piece in pieces:
    text = piece * (100_000 // len(piece)) + "!"
    read({"v_1": [text + "\\n\\nx"]})
    read({"v_1": [text], text: ["1"]})
    Path("nasty.txt").write_text(f"v_1 v_2\\n{text} 1\\n{text[:99]} 1\\n", encoding="utf-8")
    read("nasty.txt")
peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM"))
print(json.dumps([outcomes, int(peak.split()[1]) / 1e6]))
"""
HEAD = b"v_y1,v_y2\n"
GOOD = "".join(
    f'<row r="{k}"><c r="A{k}" t="inlineStr"><is><t>{cell}</t></is></c></row>'
    for k, cell in ((1, "v_y1"), (2, 5))
)
FIRST = row(cell("v_y1"))
LONE = "<table:table-cell{}/>"
COLUMNS = ' table:number-columns-repeated="16384"'
ROWS = ' table:number-rows-repeated="1048571"'
# First and last row, first and last column.
REACH = np.array([0, 10**6, 0, 16_000], "<u4").tobytes()
LARGE = ["too-large", None]


def lying(data):
    """The same archive, declaring that a file of a million bytes and more has ten."""
    with zipfile.ZipFile(io.BytesIO(data)) as book:
        size = max(member.file_size for member in book.infolist())
    return data.replace(size.to_bytes(4, "little"), (10).to_bytes(4, "little"))


def parquet(table):
    file = io.BytesIO()
    pyarrow.parquet.write_table(table, file)
    return file.getvalue()


def repeated_text():
    """A text of 20,000 characters, once in the file and in each of 20,000 rows."""
    texts = pyarrow.DictionaryArray.from_arrays(np.zeros(20_000, np.int32), ["x" * 20_000])
    return pyarrow.table({"v_y1": np.full(20_000, 5.0), "t": texts.cast(pyarrow.string())})


# By name: the bytes, and what is said of them, with the line where there is one.
CASES = {
    "lines.csv": (lambda: HEAD + b"\n" * 2_100_000, ["too-large", 2_000_001]),
    "line.csv": (lambda: HEAD + b"5,4 " + b"x" * 50_000_000 + "😀".encode(), ["too-large", 2]),
    "cells.csv": (lambda: HEAD + b"5,4\n" + b"5," * 300_000 + b"\n", ["row-length", 3]),
    "header.csv": (lambda: HEAD[:-1] + b",a" * 10_000 + b"\n5,4\n", LARGE),
    "quotes.csv": (lambda: HEAD + b'"' * 999_000 + b"\n" + b'"\n' * 10_000_000, ["quotes", 2]),
    "record.csv": (lambda: HEAD + b'"a\nb",' * 10_000_000, ["quotes", 2]),
    "open.csv": (lambda: HEAD + b'5,4\n"' + b"6,5\n" * 10_000_000, ["quotes", 3]),
    "zeros.csv": (lambda: b"\0" * 30_000_000, ["encoding", 1]),
    "blanks.csv": (lambda: HEAD + b" " * 900_000 + b"\n5,4\n6,5\n", ["read", 2]),
    "far.xlsx": (
        lambda: xlsx(GOOD + '<row r="9"><c r="XFD1048576" t="str"><v> </v></c></row>'),
        LARGE,
    ),
    "second.xlsx": (
        lambda: xlsx(GOOD + '<row><c foo="&gt;" r="AZ1048576"><f>1</f></c></row>'),
        LARGE,
    ),
    "formats.xlsx": (
        lambda: xlsx(GOOD + '<row r="9"><c r="XFD1048576" s="1"/></row>'),
        ["read", 1],
    ),
    "near.xlsx": (lambda: xlsx(GOOD + '<row r="900"><c r="A900"><v>1</v></c></row>'), ["read", 2]),
    "bomb.xlsx": (
        lambda: xlsx(f'<row><c t="inlineStr"><is><t>{"x" * 70_000_000}</t></is></c></row>'),
        LARGE,
    ),
    "liar.xlsx": (
        lambda: lying(xlsx(f'<row><c t="str"><v>{"x" * 70_000_000}</v></c></row>')),
        LARGE,
    ),
    "reach.xlsb": (lambda: packed({"xl/worksheets/sheet1.bin": b"\x94\x01\x10" + REACH}), LARGE),
    "columns.ods": (lambda: ods(FIRST + row(cell("v_y1", COLUMNS))), LARGE),
    "rows.ods": (lambda: ods(FIRST + row(cell("v_y1"), ROWS)), LARGE),
    "empty.ods": (lambda: ods(FIRST + row(LONE.format(COLUMNS), ROWS)), ["read", 0]),
    "rows.parquet": (lambda: parquet(pyarrow.table({"v_y1": np.full(2_000_001, 5.0)})), LARGE),
    "text.parquet": (lambda: parquet(repeated_text()), LARGE),
}


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the peak is read from Linux")
def test_what_would_take_all_memory_is_refused_inside_one_gigabyte(tmp_path):
    for name, (content, _) in CASES.items():
        (tmp_path / name).write_bytes(content())
    with (tmp_path / "size.csv").open("wb") as file:
        file.truncate(250_000_001)
    command = [sys.executable, "-c", PROGRAM, *map(str, sorted(tmp_path.iterdir()))]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    outcomes, peak = json.loads(done.stdout)
    expected = {name: outcome for name, (_, outcome) in CASES.items()}
    assert outcomes == expected | {"size.csv": LARGE}
    assert peak < 1.0


def test_cells_are_counted_as_they_are_read(tmp_path, monkeypatch):
    """With limits a thousandth of what they are."""
    text = tmp_path / "t.csv"
    book = tmp_path / "t.xlsx"
    text.write_bytes(HEAD + b"5,4\n" * 20_000)
    book.write_bytes(xlsx(GOOD + "<row><c><v>1</v></c></row>" * 10_000))
    for path, name in (
        (text, "records.MOST_CELLS"),
        (text, "texts.MOST_ROWS"),
        (text, "records.MOST_BYTES"),
        (book, "workbooks._MOST_TAGS"),
        (book, "workbooks._MOST_UNPACKED"),
    ):
        with monkeypatch.context() as patch:
            assert len(read_cells(path, is_speed).rows) >= 10_000
            patch.setattr(f"fitball.data.{name}", 10_000)
            with pytest.raises(InputError) as caught:
                read_cells(path, is_speed)
        assert caught.value.code == "too-large"


def is_speed(name):
    """What a name is worth as one of a column."""
    return float(name in ("v_x1", "v_y1"))


def test_rows_beyond_a_chunk_are_read_in_order_and_exactly(tmp_path, monkeypatch):
    monkeypatch.setattr("fitball.data.layout._CELLS_AT_ONCE", 2000)
    values = np.random.default_rng(1).normal(10.0, 3.0, (2400, 2))
    frame = pandas.DataFrame(values, columns=["v_x1", "v_y1"])
    frame.to_csv(tmp_path / "t.csv", index=False)
    cells = read_cells(tmp_path / "t.csv", is_speed)
    columns = numbers(cells, {"v_x1": 0, "v_y1": 1})
    assert_array_equal(columns["v_x1"], values[:, 0])
    assert_array_equal(columns["v_y1"], values[:, 1])
    assert_array_equal(cells.lines, np.arange(2400) + 2)
