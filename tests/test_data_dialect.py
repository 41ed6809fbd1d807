"""Tables as people write them: each reads to the table that its plain CSV is; what may be two things is refused."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from written import assert_same, read

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import ImpactTable
from fitball.errors import TableError
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.report.saved.run_file import find_tables, read_run, record_problem, run_text

Rows = list[list[str]]
HEADER = [
    "id", "v_1 [mph]", "theta_1 [deg]", "omega_1 [rpm]", "v_2 [mph]", "theta_2 [deg]", "v_2_sd [mph]", "surface",
]  # fmt: skip
ROWS = [
    ["a", "38.10", "18.2", "-51.5", "28.0", "20.1", "0.30", "clay"],
    ["b", "40.25", "22.9", "-48.0", "29.1", "25.0", "0.25", "clay"],
    ["c", "42.00", "35.1", "120.0", "30.2", "37.4", "0.40", "Rasen, grün"],
]


def plain(rows: Rows = ROWS, header: Sequence[str] = HEADER) -> str:
    return "".join(",".join(f'"{cell}"' if "," in cell else cell for cell in row) + "\n" for row in [header, *rows])


def said(table: ImpactTable, words: str) -> bool:
    return any(words in remark for remark in table.remarks)


BRACKETS = (
    "{} [{}]",
    "{} ({})",
    "{}[{}]",
    "{} {{{}}}",
    "{} / ({})",
    "{} / {}",
    "{} in {}",
    "{}_{}",
    "{} {}",
    "{}: {}",
)
SPELLED = {"mph": ("mph", "MPH", "mi/h"), "deg": ("deg", "°", "degree", "Degrees"), "rpm": ("rpm", "RPM", "rev/min")}
NAMED = {
    "id": ("id", "ID", "Id", "No.", "Nr"),
    "v_1": ("v_1", "V1", "v 1", "V_1"),
    "theta_1": ("theta_1", "Theta1", "θ_1", "theta 1"),
    "omega_1": ("omega_1", "OMEGA_1", "ω1"),
    "v_2": ("v_2", "V2"),
    "theta_2": ("theta_2", "Theta_2", "θ2"),
    "v_2_sd": ("v_2_sd", "V2_SD"),
    "surface": ("surface", "Surface"),
}
TITLES = ("Bounce test 3, May 2026", "Operator: R. Cross; ball 4", "left court\ttwo cameras", "sep=;")


@st.composite
def dialects(draw: st.DrawFn) -> tuple[bytes, Rows]:
    """A text file in some dialect, and its rows."""
    numbers = st.floats(0.97, 1.03)
    rows = [
        [row[0], *(f"{float(cell) * draw(numbers):.{draw(st.sampled_from((0, 1, 2, 4)))}f}" for cell in row[1:6]),
         row[6], row[7]]
        for row in draw(st.lists(st.sampled_from(ROWS), min_size=2, max_size=5))
    ]  # fmt: skip
    for k, row in enumerate(rows):
        row[0] = f"impact {k}" if draw(st.booleans()) else str(k)
        row[1] = f"{float(row[1]):.2f}"
    sign = draw(st.sampled_from((",", ";", "\t", "|", "  ", " ")))
    spaces = sign.isspace() and sign != "\t"
    comma = sign != "," and draw(st.booleans())
    if spaces:
        for row in rows:
            row[0], row[7] = row[0].replace(" ", "_"), row[7].split(",")[0]
    below = draw(st.booleans())
    deviations = draw(st.booleans())
    cells: Rows = [[], []]
    for column in HEADER:
        name, _, unit = column.partition(" [")
        name = draw(st.sampled_from(NAMED[name]))
        unit = draw(st.sampled_from(SPELLED[unit.rstrip("]")])) if unit else ""
        form = draw(st.sampled_from(BRACKETS[:3] if spaces else BRACKETS))
        if spaces:
            name = name.replace(" ", "_")
        cells[0].append(form.format(name, unit) if unit and not below else name)
        cells[1].append(unit if unit or spaces is False else "-")
    body = [[cell.replace(".", ",") if comma and 0 < k < 7 else cell for k, cell in enumerate(row)] for row in rows]
    if draw(st.booleans()):
        body = [[cell.replace("-", "\u2212") for cell in row] for row in body]
    lines = [cells[0], *([cells[1]] if below else []), *body]
    if deviations:
        mark = draw(st.sampled_from((" ± ", "±", " +/- ", " +- ")))
        lines = [[*line[:4], line[4], *line[5:6], line[7]] for line in lines]
        for row, line in zip(body, lines[-len(body) :], strict=True):
            line[4] += mark + row[6]
    text = "\n".join(
        sign.join(f'"{cell}"' if sign in cell and not spaces else cell for cell in line) for line in lines
    )
    titles = draw(st.lists(st.sampled_from(TITLES), max_size=2, unique=True))
    text = "".join(f"{title}\n" for title in titles) + draw(st.sampled_from(("", "# a comment\n", "\n"))) + text
    text = text.replace("\n", draw(st.sampled_from(("\n", "\r\n")))) + draw(st.sampled_from(("", "\n", "\n\n")))
    western = draw(st.booleans()) and not {"\u2212", "θ", "ω"} & set(text)
    coding = (
        "cp1252" if western else draw(st.sampled_from(("utf-8", "utf-8-sig", "utf-16", "utf-16-be", "utf-16-le")))
    )
    return text.encode(coding), rows


@settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(dialects())
def test_a_table_in_any_dialect_is_the_same_table(tmp_path: Path, written: tuple[bytes, Rows]) -> None:
    data, rows = written
    assert_same(read(tmp_path, data), read(tmp_path, plain(rows), "plain.csv"))


def as_numbers(rows: Rows = ROWS) -> pandas.DataFrame:
    frame = pandas.DataFrame(rows, columns=HEADER)
    for column in HEADER[1:7]:
        frame[column] = frame[column].astype(float)
    return frame


OPEN_DOCUMENT = ("office", "table", "text")


def save(frame: pandas.DataFrame, place: Path) -> None:
    if place.suffix == ".xlsx":
        frame.to_excel(place, index=False)
        return
    rows = "".join(
        "<table:table-row>"
        + "".join(
            f'<table:table-cell office:value-type="float" office:value="{cell}"/>'
            if isinstance(cell, float)
            else f'<table:table-cell office:value-type="string"><text:p>{cell}</text:p></table:table-cell>'
            for cell in row
        )
        + "</table:table-row>"
        for row in [list(frame), *frame.itertuples(index=False)]
    )
    spaces = " ".join(f'xmlns:{name}="urn:oasis:names:tc:opendocument:xmlns:{name}:1.0"' for name in OPEN_DOCUMENT)
    body = f'<table:table table:name="impacts">{rows}</table:table>'
    with zipfile.ZipFile(place, "w") as book:
        book.writestr("mimetype", "application/vnd.oasis.opendocument.spreadsheet")
        book.writestr("META-INF/manifest.xml", "<manifest/>")
        book.writestr(
            "content.xml",
            f"<office:document-content {spaces}><office:body><office:spreadsheet>{body}</office:spreadsheet>"
            "</office:body></office:document-content>",
        )


@pytest.mark.parametrize("ending", ["xlsx", "ods", "parquet", "frame", "text frame", "indexed frame"])
def test_workbooks_parquet_and_frames_are_the_same_table(tmp_path: Path, ending: str) -> None:
    frame, place = as_numbers(), tmp_path / f"t.{ending}"
    if ending in ("xlsx", "ods"):
        save(frame, place)
        table = load_table(place)
    elif ending == "parquet":
        frame.to_parquet(place)
        table = load_table(place)
    else:
        given = {"frame": frame, "text frame": pandas.DataFrame(ROWS, columns=HEADER), "indexed frame": frame}[ending]
        table = load_table(given.set_index("id") if ending == "indexed frame" else given)
        assert table.files == () and table.name == "DataFrame" and len(table.digest) == 64
    assert_same(table, read(tmp_path, plain()))


def test_a_workbook_as_people_keep_it(tmp_path: Path) -> None:
    """Titles, a units row, an empty row, another sheet, a column without head at the end."""
    with pandas.ExcelWriter(tmp_path / "t.xlsx") as book:
        notes = pandas.DataFrame([["what", "who"], ["bounces", "me"]])
        notes.to_excel(book, sheet_name="notes", index=False, header=False)
        units = [name.partition(" [")[2].rstrip("]") for name in HEADER]
        names = [name.partition(" [")[0] for name in HEADER]
        body = [[*row[:1], *map(float, row[1:7]), row[7]] for row in ROWS]
        rows = [["Court 3"], [], names, units, *body[:2], [], *body[2:]]
        full = [[*row, *[None] * (len(HEADER) + 1 - len(row))] for row in rows]
        pandas.DataFrame(full).to_excel(book, sheet_name="impacts", index=False, header=False)
    table = load_table(tmp_path / "t.xlsx")
    assert_same(table, read(tmp_path, plain()))
    for words in ("sheet 'impacts' of 2", "above the header: 'Court 3'", "the row below the header"):
        assert said(table, words)


def test_of_two_sheets_with_tables_one_is_named(tmp_path: Path) -> None:
    place = tmp_path / "t.xlsx"
    with pandas.ExcelWriter(place) as book:
        for name, rows in (("clay", ROWS), ("grass #2", ROWS[:2])):
            as_numbers(rows).to_excel(book, sheet_name=name, index=False)
    with pytest.raises(TableError, match=r"2 sheets have tables .*: '.*t.xlsx#clay', '.*t.xlsx#grass #2'"):
        load_table(place)
    table = load_table(f"{place}#clay")
    assert_same(table, read(tmp_path, plain()))
    assert (table.name, table.source) == ("t-clay", f"{place}#clay")
    assert len(load_table(f"{place}#grass #2")) == 2
    with pytest.raises(TableError, match=r"there is no sheet 'sand'.*: clay, grass #2"):
        load_table(f"{place}#sand")
    problem = build_problem(table, load_scene(None), Choices(model="brody"))
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "run.toml").write_text(
        run_text(SimpleNamespace(problem=problem, seed=1, diagnostics=None), tmp_path / "kept")
    )
    record = read_run(tmp_path / "kept")
    assert find_tables(record) == (Path(f"{place}#clay").resolve(),)
    assert len(record_problem(record, find_tables(record)).table) == 3


@pytest.mark.parametrize("ending", ["xlsx", "ods"])
@pytest.mark.parametrize("kept", [0.0, 0.4, 0.9, 1.0])
def test_a_damaged_workbook_is_refused_in_words(tmp_path: Path, ending: str, kept: float) -> None:
    place = tmp_path / f"t.{ending}"
    save(as_numbers(), place)
    whole = place.read_bytes()
    place.write_bytes(whole[: int(kept * len(whole))] if kept < 1.0 else whole[:-300] + b"x" * 300)
    with pytest.raises(TableError, match=r"not a workbook|the file is empty"):
        load_table(place)


def test_a_header_behind_a_comment_mark_as_numpy_writes_it(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "t.txt", [[10.0, 6.0, 7.0, 4.0], [11.0, 7.0, 8.0, 5.0]], header="v_x1 v_y1 v_x2 v_y2")
    table = load_table(tmp_path / "t.txt")
    np.testing.assert_array_equal(table.impacts.v_y1, [6.0, 7.0])
    assert said(table, "header was read from the comment in line 1")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("v_y1;v_y2\n1,234;0\n1,500;1,004\n", "which may be 1.234 or 1234"),
        ("v_y1;v_y2\n5,1;4.2\n6,1;4,3\n", "expected one decimal sign"),
        ("v_y1;v_y2\n1.005,1;4,2\n6,1;4,3\n", "of thousands"),
        ("v_y1;v_y2\n5,1,2;4,2\n6,1;4,3\n", "expected a number"),
        ('v_y1,v_y2\n"5,125","4,250"\n6,4.3\n', "expected one decimal sign|which may be"),
        ("v_y1,v_y2\n5,1,4,2\n6,1,4,3\n", "write decimal points"),
        ("v_y1,v_y2\n5 ± ,4\n6,4\n", "expected a number"),
        ("v_y1,v_y2\n5 ± -1,4\n6,4\n", "expected a number"),
        ("v_y1,v_y2\n± 1,4\n6,4\n", "expected a number"),
        ("v_y1,v_y2\n5 ± 0,4\n6 ± 1,4\n", "a positive standard deviation"),
        ("v_y1,v_y2\n5 ± 1 ± 2,4\n6 ± 1,4\n", "expected a"),
        ("v_y1,v_y1_sd,v_y2\n5 ± 1,1,4\n6 ± 1,1,4\n", "a column v_y1_sd too"),
        ("v_y1,v_y2\n5 ± 1,4\n6,4\n", "no standard deviation for v_y1"),
        ("v_y1,v_y2\nm/s,furlongs\n5,4\n6,5\n", "unit '[furlongs]', which is unknown"),
        ("v_y1 [m/s],v_y2\nkm/h,m/s\n5,4\n6,5\n", "expected one unit"),
        ("5,4\nv_y1,v_y2\n6,5\n7,6\n", "2 numbers above the header"),
        ("v_y1 [1/s],v_y2\n6,5\n7,6\n", "measures|is ambiguous"),
        ("drop_height [cm],rebound_height [cm]\n254,-1\n254,140\n", "a positive height"),
        ("drop_height,rebound_height\n254,140\n254,140\n", "1 mm to 50 m"),
        ("drop_height [cm],v_y1,rebound_height [cm]\n254,5,140\n254,5,140\n", "7.058 m/s"),
        ("id,v_y1,v_y2\n1,5,4\nMittelwert,5,4\n", "'Mittelwert', as a row below a table that sums it up"),
        (",v_y1,v_y2\n1,5,4\n2,6,5\nStd. dev.,0.7,0.6\n", "'Std. dev.', as a row below a table"),
        ("v_y1,V_Y1,v_y2\n5,5,4\n5,5,4\n", "both 'v_y1'"),
    ],
)
def test_what_is_nonsense_or_may_be_two_things_is_refused(tmp_path: Path, text: str, words: str) -> None:
    words = words.replace("[", r"\[").replace("]", r"\]")
    with pytest.raises(TableError, match=words):
        read(tmp_path, text)


def test_what_was_assumed_is_told(tmp_path: Path) -> None:
    text = "Test 3\nNo.;V_1 [mph];theta_1;v_2 [mph];theta_2\n1;38,1;18;28,0 ± 0,3;20\n1;39,2;19;28,5 ± 0,3;21\n"
    table = read(tmp_path, text.encode("utf-16"))
    for words in (
        "read as UTF-16",
        "by semicolons",
        "above the header: 'Test 3'",
        "decimal commas",
        "other spellings: 'No.' as id, 'V_1' as v_1",
        "± in v_2",
        "made unique: '1 (2)'",
    ):
        assert said(table, words), words
    assert table.ids == ("1", "1 (2)")


def test_repeated_and_empty_ids_are_made_unique(tmp_path: Path) -> None:
    table = read(tmp_path, "id,v_y1,v_y2\na,5,4\na,5,4\n,5,4\na (2),5,4\na,5,4\n")
    assert table.ids == ("a", "a (3)", "row 3", "a (2)", "a (4)")
    assert [notice.row for notice in table.notices] == [2, 3, 5]


def test_empty_rows_and_a_repeated_header_are_passed_over(tmp_path: Path) -> None:
    table = read(tmp_path, "v_y1,v_y2\n5,4\n,\n6,5,,\nv_y1,v_y2\n7,6\n")
    np.testing.assert_array_equal(table.impacts.v_y1, [5.0, 6.0, 7.0])
    assert said(table, "1 empty row") and said(table, "in line 5")


def test_a_letter_of_windows_is_read_and_told(tmp_path: Path) -> None:
    table = read(tmp_path, "surface,v_1,theta_1 [°],v_2\nrasé,8,30,4\nrasé,8,31,5\n".encode("cp1252"))
    assert table.labels["surface"] == ("rasé", "rasé") and table.units["theta_1"] == "deg"
    assert said(table, "read as Windows-1252, first '°' in line 1")


def test_drop_heights_are_the_speeds_of_free_fall(tmp_path: Path) -> None:
    """Against motion computed step by step, and sds against random draws."""
    table = read(tmp_path, "drop_height [in],rebound_height [cm],rebound_height_sd [mm]\n100,140,5\n100 ± 0.5,138,5\n"
                 .replace("100,140", "100 ± 0.5,140"))  # fmt: skip
    speed, height, step = 0.0, 2.54, 1e-5
    while height > 0.0:
        height -= speed * step + 0.5 * 9.80665 * step**2
        speed += 9.80665 * step
    np.testing.assert_allclose(table.impacts.v_y1, speed, rtol=1e-4)
    measured = table.measurement("v_y2")
    assert measured is not None and measured.sd is not None and table.impacts.cor is not None
    np.testing.assert_allclose(table.impacts.cor, np.sqrt([1.40 / 2.54, 1.38 / 2.54]), rtol=1e-14)
    rng = np.random.default_rng(3)
    drawn = np.sqrt(2 * 9.80665 * (1.40 + 0.005 * rng.standard_normal(400_000)))
    assert measured.sd[0] == pytest.approx(drawn.std(), rel=0.01)
    assert table.incident_sd["v_y1"][0] == pytest.approx(0.5 * 0.0127 / 2.54 * speed, rel=1e-3)
    assert said(table, "g = 9.80665 m/s^2, without air drag") and set(table.units) == {
        "v_y1", "v_y2", "v_y1_sd", "v_y2_sd",
    }  # fmt: skip


def test_a_measured_speed_counts_before_a_height(tmp_path: Path) -> None:
    table = read(tmp_path, "drop_height,v_y1,v_y2\n2.54,6.9,5\n2.54,6.91,5\n")
    np.testing.assert_array_equal(table.impacts.v_y1, [6.9, 6.91])
    assert said(table, "drop_height is not used")
    # A rebound speed may be counted downwards.
    down = read(tmp_path, "v_y1,rebound_height,v_y2\n6.9,1.27,-5\n6.91,1.27,-5\n")
    np.testing.assert_array_equal(down.measurements[0].values, [5.0, 5.0])


def test_few_rows_the_other_way_along_the_court_are_told(tmp_path: Path) -> None:
    rows = "".join(f"17,{angle},11,30\n" for angle in (20, 21, 145, 22, 23, 24, 25))
    table = read(tmp_path, f"v_1,theta_1,v_2,theta_2\n{rows}")
    (notice,) = table.notices
    assert (notice.row, notice.columns) == (3, ("theta_1",)) and "145 deg" in notice.message
    assert "155 deg" in str(read(tmp_path, "v_1,theta_1,v_2\n17,155,11\n17,21,11\n17,22,11\n").notices[0])
    both = "".join(f"{v},6,{0.7 * v},4\n" for v in (-5, 5, -6, 6))
    assert read(tmp_path, f"v_x1,v_y1,v_x2,v_y2\n{both}").notices == ()


def test_balls_that_fly_against_x_are_told_where_offsets_show(tmp_path: Path) -> None:
    """From both sides, all from the other side, and straight down, where the sign is noise."""
    head, against = "v_x1,v_y1,omega_1,v_x2,v_y2,omega_2\n", "balls move towards negative v_x"
    turn = "".join(f"{v},6,0,{0.7 * v},4,{10 * v}\n" for v in (-5, 5, -6, 6))
    (notice,) = read(tmp_path, head + turn).notices
    assert notice.message.startswith(f"2 of 4 {against}") and notice.columns == ("v_x1",)
    assert said(read(tmp_path, "v_1,theta_1,omega_1,v_y2\n" + "9,140,0,4\n9,150,0,3\n"), f"2 of 2 {against}")
    down = "".join(f"{v},6,0,0,4,0\n" for v in (-0.05, 0.04, -0.02, 0.03))
    assert read(tmp_path, head + down).notices == ()


def test_a_column_negative_in_every_row_is_one_line_with_what_to_do(tmp_path: Path) -> None:
    rows = "12,-5,9,4\n" * 5000
    with pytest.raises(TableError) as caught:
        read(tmp_path, f"v_x1,v_y1,v_x2,v_y2\n{rows}")
    lines = [line for line in str(caught.value).splitlines() if "column 'v_y1'" in line]
    assert len(lines) == 1
    assert "5,000 rows (first: row 1, line 2)" in lines[0] and "pass flip='v_y1'" in lines[0]


def test_a_row_is_a_summary_where_its_numbers_are_one(tmp_path: Path) -> None:
    """People are called Max, runs N; `max` below a table is another matter."""
    rng = np.random.default_rng(5)
    numbers = np.column_stack([rng.uniform(4.0, 9.0, 6), rng.uniform(2.0, 4.0, 6)]).round(2)
    names = ["Ann", "Max", "N", "Sum", "SD", "min"]
    head = "id,v_y1,v_y2\n"
    rows = "".join(f"{name},{one:.2f},{two:.2f}\n" for name, (one, two) in zip(names, numbers, strict=True))
    assert read(tmp_path, head + rows).ids == tuple(names)
    plain_rows = "".join(f"{k},{one:.2f},{two:.2f}\n" for k, (one, two) in enumerate(numbers))
    for word, line in {
        "Max": numbers.max(axis=0), "N": np.full(2, 6.0), "Sum:": numbers.sum(axis=0),
        "SD": numbers.std(axis=0, ddof=1).round(1), "min.": numbers.min(axis=0),
    }.items():  # fmt: skip
        with pytest.raises(TableError, match=f"row 7.*begins with '{word}', as a row below a table that sums it up"):
            read(tmp_path, f"{head}{plain_rows}{word},{line[0]:.6g},{line[1]:.6g}\n")


@pytest.mark.parametrize("form", ["whole", "no index", "named index", "text index", "R"])
def test_data_frames_as_they_are_printed(tmp_path: Path, form: str) -> None:
    numbers = np.random.default_rng(1).uniform(3.0, 6.0, (6, 4)).round(3)
    frame = pandas.DataFrame(numbers, columns=["v_x1", "v_y1", "v_x2", "v_y2"])
    frame.loc[2, "v_x2"] = np.nan
    frame["v_y2"] /= 2.0
    frame["v_y1"] += 100.0
    ids = [str(k) for k in range(6)]
    if form == "text index":
        ids = list("abcdef")
        frame.index = pandas.Index(ids, name="id")
    if form == "named index":
        frame.index.name = "ID"
    text = frame.to_string(index=form != "no index")
    if form in ("R", "no index"):
        ids = [str(k) for k in range(1, 7)]
    if form == "R":
        body = [" ".join([f'"{k + 1}"', *map(str, row)]) for k, row in enumerate(frame.to_numpy())]
        text = "\n".join([" ".join(f'"{name}"' for name in frame), *body])
    table = read(tmp_path, text.replace("nan", "NA"))
    assert table.ids == tuple(ids)
    np.testing.assert_allclose(table.impacts.v_y1, frame["v_y1"])
    measured = table.measurement("v_x2")
    assert measured is not None
    np.testing.assert_allclose(measured.values, frame["v_x2"])


def test_a_frame_printed_in_parts_or_without_a_place_for_its_first_column_is_refused(tmp_path: Path) -> None:
    frame = pandas.DataFrame(np.random.default_rng(1).uniform(3.0, 6.0, (40, 2)), columns=["v_y1", "v_y2"])
    with pytest.raises(TableError, match=r"read '\.\.', the mark of a data frame"):
        read(tmp_path, frame.to_string(max_rows=6))
    # The first cells do not count rows: they may be numbers that were measured, and a name may be missing.
    with pytest.raises(TableError, match="read 3 cells, expected 2"):
        read(tmp_path, "v_y1 v_y2\n38 5 4\n41 6 5\n42 7 6\n")


def test_what_excel_shows_for_missing_values_and_for_errors(tmp_path: Path) -> None:
    """At the beginning of a line too, where a `#` else begins a comment."""
    table = read(tmp_path, "omega_2,v_y1,v_y2,v_x1\n#N/A,5,4,0\n3,6,5,0\n# a comment\n#NV,7,6,0\n")
    spin = table.measurement("omega_2")
    assert spin is not None and len(table) == 3
    np.testing.assert_array_equal(spin.values, [np.nan, 3.0, np.nan])
    for cell in ("#DIV/0!", "#VALUE!", "#WERT!"):
        with pytest.raises(TableError, match=f"row 1 .*read '{cell}', a formula error.*leave the cell empty"):
            read(tmp_path, f"omega_2,v_y1,v_y2,v_x1\n{cell},5,4,0\n3,6,5,0\n")
    with pytest.raises(TableError, match=r"read '\?'; expected a number .*: leave the cell empty"):
        read(tmp_path, "v_y1,v_y2\n5,4\n6,?\n")


def test_kilonewtons_are_no_knots(tmp_path: Path) -> None:
    for unit in ("KN", "Kn"):
        with pytest.raises(TableError, match=rf"read unit '\[{unit}\]'.* write kn"):
            read(tmp_path, f"v_y1 [{unit}],v_y2\n5,4\n6,5\n")
    knots = read(tmp_path, "v_y1 [kn],v_y2\n9,4\n18,5\n")
    np.testing.assert_allclose(knots.impacts.v_y1, np.array([9, 18]) * 1852 / 3600)


def test_an_sd_of_a_height_that_does_not_count_is_named(tmp_path: Path) -> None:
    table = read(tmp_path, "v_y1,drop_height,drop_height_sd,v_y2\n7.05,2.54,0.01,5.2\n7.06,2.54,0.01,5.3\n")
    assert said(table, "drop_height_sd is not used: v_y1 was measured")
    with pytest.raises(TableError, match="standard deviation of 'drop_height', but there is no column"):
        read(tmp_path, "v_y1,drop_height_sd,v_y2\n7.05,0.01,5.2\n7.06,0.01,5.3\n")
