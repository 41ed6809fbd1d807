"""Tables as people write them: each reads as its plain CSV does; what may be two things is refused
at its place.
"""

import random
from itertools import product

import numpy as np
import pandas
import pytest
from made_tables import written
from numpy.testing import assert_allclose, assert_array_equal
from support import workbooks

from fitball.base.errors import FitballError, InputError, ParameterError
from fitball.data.cells import numbers
from fitball.data.header import Naming, read_header
from fitball.data.lexicon import end_of, guess_of
from fitball.data.proposals import note_unread, with_proposals
from fitball.data.read import load_table
from fitball.data.sources import read_cells

HEADER = [
    "id",
    "v_1 [mph]",
    "theta_1 [deg]",
    "omega_1 [rpm]",
    "v_2 [mph]",
    "theta_2 [deg]",
    "v_2_sd [mph]",
    "surface",
]
ROWS = [
    ["a", "38.10", "18.2", "-51.5", "28.0", "20.1", "0.30", "clay"],
    ["b", "40.25", "22.9", "-48.0", "29.1", "25.0", "0.25", "clay"],
    ["c", "42.00", "35.1", "120.0", "30.2", "37.4", "0.40", "Rasen, grün"],
]
# One of a unit in SI, by definition.
SI = {"mph": 1609.344 / 3600, "deg": np.pi / 180, "rpm": np.pi / 30}
FORMS = [
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
]
SPELLED = {
    "mph": ["mph", "MPH", "mi/h"],
    "deg": ["deg", "°", "Degrees"],
    "rpm": ["rpm", "RPM", "rev/min"],
    "": [""],
}
NAMED = {
    "id": ["id", "ID", "No.", "Nr"],
    "v_1": ["v_1", "V1", "v 1"],
    "theta_1": ["theta_1", "Theta1", "θ_1", "theta 1"],
    "omega_1": ["omega_1", "OMEGA_1", "ω1"],
    "theta_2": ["theta_2", "Theta_2", "θ2"],
    "v_2_sd": ["v_2_sd", "V2_SD"],
}
TITLES = [
    "Bounce test 3, May 2026",
    "Operator: R. Cross; ball 4",
    "left court\ttwo cameras",
    "sep=;",
]


def read(source, columns=None, **optional):
    """Numbers in SI and labels by our names, and what was noted; all faults are raised."""
    naming = Naming(columns or {})
    cells = read_cells(source, naming.worth)
    header = with_proposals(cells, read_header(cells, naming, **optional), naming)
    note_unread(cells, header)
    values = numbers(cells, header.numbers)
    cells.refuse()
    table = {}
    for name, column in values.items():
        factor_of_column = header.factors.get(name.removesuffix("_sd"))
        factor = header.factors.get(name, factor_of_column)
        table[name] = column * factor
    for name, k in header.labels.items():
        table[name] = cells.text(k)
    return table, [note.code for note in cells.notes]


def table_of(source, columns=None, **optional):
    """Numbers in SI and labels by our names."""
    table, _ = read(source, columns, **optional)
    return table


def faults_of(source, columns=None):
    """Code, row, line and column of each fault of a table that is refused."""
    with pytest.raises(InputError) as caught:
        read(source, columns)
    return [(fault.code, fault.row, fault.line, fault.column) for fault in caught.value.faults]


def name_and_unit(heading):
    """The two parts of one of our headings."""
    name, _, unit = heading.rstrip("]").partition(" [")
    return name, unit


def meant(rows):
    """The table that rows are, computed here."""
    table = {}
    for heading, *cells in zip(HEADER, *rows, strict=True):
        name, unit = name_and_unit(heading)
        if unit:
            table[name] = np.array([float(cell) for cell in cells]) * SI[unit]
        else:
            table[name] = cells
    return table


def assert_same(table, expected):
    assert table.keys() == expected.keys()
    for name, column in expected.items():
        if isinstance(column, list):
            assert table[name] == column
        else:
            assert_allclose(table[name], column, rtol=1e-14, err_msg=name)


def of_spaces(separator):
    return not separator.strip(" ")


def random_rows(rng):
    """Two to five impacts like those of ROWS, with numbers of various digits."""
    rows = [[*row] for row in rng.choices(ROWS, k=rng.randint(2, 5))]
    for k, row in enumerate(rows):
        row[0] = rng.choice([f"impact {k}", str(k)])
        for column in range(1, 6):
            number = float(row[column]) * rng.uniform(0.97, 1.03)
            digits = rng.choice([0, 1, 2, 4])
            row[column] = f"{number:.{digits}f}"
        row[1] = f"{float(row[1]):.2f}"
    return rows


def random_heading(rng, heading, spaces, below):
    """A heading of ours, and its unit, as somebody may write them.

    The unit stands in the heading unless units are a row `below`. Between `spaces` neither has one.
    """
    name, unit = name_and_unit(heading)
    name = rng.choice(NAMED.get(name, [name]))
    unit = rng.choice(SPELLED[unit])
    if spaces:
        name = name.replace(" ", "_")
    if unit and not below:
        forms = FORMS[:3] if spaces else FORMS
        name = rng.choice(forms).format(name, unit)
    if spaces and not unit:
        unit = "-"
    return name, unit


def dialect(seed):
    """A text file in some dialect, and its rows."""
    rng = random.Random(seed)

    def maybe():
        return rng.random() < 0.5

    rows = random_rows(rng)
    separator = rng.choice([",", ";", "\t", "|", "  ", " "])
    spaces = of_spaces(separator)
    decimal_commas = separator != "," and maybe()
    below = maybe()
    deviations = maybe()
    if spaces:
        for row in rows:
            row[0] = row[0].replace(" ", "_")
            row[7] = row[7].split(",")[0]
    head = []
    units = []
    for heading in HEADER:
        name, unit = random_heading(rng, heading, spaces, below)
        head.append(name)
        units.append(unit)
    body = [[*row] for row in rows]
    if decimal_commas:
        for row in body:
            row[1:7] = [cell.replace(".", ",") for cell in row[1:7]]
    if maybe():
        body = [[cell.replace("-", "\u2212") for cell in row] for row in body]
    if deviations:
        mark = rng.choice([" ± ", "±", " +/- ", " +- "])
        for row in body:
            deviation = row.pop(6)
            row[4] += mark + deviation
        del head[6]
        del units[6]
    lines = [head]
    if below:
        lines.append(units)
    lines += body
    return encoded(rng, lines, separator), rows


def encoded(rng, lines, separator):
    """The bytes of a file of these cells, with titles above or not, in some coding."""

    def quoted(cell):
        if separator in cell and not of_spaces(separator):
            return f'"{cell}"'
        return cell

    titles = rng.sample(TITLES, rng.randint(0, 2))
    above = "".join(f"{title}\n" for title in titles)
    above += rng.choice(["", "# a note\n", "\n"])
    text = above + "\n".join(separator.join(map(quoted, line)) for line in lines)
    text = text.replace("\n", rng.choice(["\n", "\r\n"]))
    text += rng.choice(["", "\n", "\n\n"])
    coding = rng.choice(["utf-8", "utf-8-sig", "utf-16", "utf-16-be", "utf-16-le", "cp1252"])
    # Letters that Windows-1252 has not.
    if coding == "cp1252" and {"\u2212", "θ", "ω"} & {*text}:
        coding = "utf-8"
    return text.encode(coding)


def test_three_hundred_dialects_are_the_same_tables(tmp_path):
    for seed in range(300):
        data, rows = dialect(seed)
        try:
            assert_same(table_of(written(tmp_path, data)), meant(rows))
        except (FitballError, AssertionError) as error:
            pytest.fail(f"{error}\nseed {seed}: {data!r}")


def save_ods(frame, path):
    """A workbook of LibreOffice."""
    rows = []
    for line in [list(frame), *frame.itertuples(index=False)]:
        cells = map(workbooks.cell, line)
        rows.append(workbooks.row("".join(cells)))
    path.write_bytes(workbooks.ods("".join(rows)))


@pytest.fixture
def frame():
    table = pandas.DataFrame(ROWS, columns=HEADER)
    return table.astype(dict.fromkeys(HEADER[1:7], float))


def test_workbooks_parquet_and_frames_are_the_same_table(tmp_path, frame):
    frame.to_excel(tmp_path / "t.xlsx", index=False)
    frame.to_parquet(tmp_path / "t.parquet")
    save_ods(frame, tmp_path / "t.ods")
    texts = pandas.DataFrame(ROWS, columns=HEADER)
    mapping = {name: frame[name].tolist() for name in HEADER}
    for source in (
        tmp_path / "t.xlsx",
        tmp_path / "t.parquet",
        tmp_path / "t.ods",
        frame,
        texts,
        frame.set_index("id"),
        mapping,
    ):
        assert_same(table_of(source), meant(ROWS))
    assert faults_of(texts.replace("42.00", "?")) == [("not-a-number", 3, None, "v_1")]


def test_numbers_of_frames_stay_numbers_and_gaps_gaps():
    frame = pandas.DataFrame(
        {
            "id": [1, 2],
            "v_1": [0.1, None],
            "v_2": [3, 4],
            "omega_2": pandas.array([5, None], "Int64"),
        }
    )
    cells = read_cells(frame, Naming({}).worth)
    assert [column.dtype.kind for column in cells.columns] == ["f", "f", "f", "f"]
    assert cells.text(0) == ["1", "2"]
    assert cells.text(1) == ["0.1", ""]
    omega_2 = numbers(cells, {"omega_2": 3})["omega_2"]
    assert_array_equal(omega_2, [5.0, np.nan])
    # The digest is of what is in it, however it was given.
    same = read_cells(dict(frame), Naming({}).worth)
    other = read_cells(frame.assign(v_1=[0.1, 0.2]), Naming({}).worth)
    assert cells.sha256 == same.sha256
    assert cells.sha256 != other.sha256
    infinite = {"v_1": [1.0, np.inf], "v_2": [1.0, 2.0]}
    assert faults_of(infinite) == [("not-finite", 2, None, "v_1")]
    for columns in (
        {"v_1": [1.0], "v_2": [1.0, 2.0]},
        {"v_1": ["\ud800"]},
        {"\ud800": [1.0]},
    ):
        assert faults_of(columns) == [("not-a-table", None, None, None)]
    for cell in ("\ud800", np.ones(2), frame):
        assert faults_of({"v_1": [1.0, cell]}) == [("not-a-number", 2, None, "v_1")]


def test_a_workbook_as_people_keep_it(tmp_path, frame):
    """Titles, a row of units, an empty row, another sheet, a column without head at the end."""
    path = tmp_path / "t.xlsx"
    with pandas.ExcelWriter(path) as book:
        notes = pandas.DataFrame([["what", "who"], ["bounces", "me"]])
        notes.to_excel(book, sheet_name="notes", index=False, header=False)
        names, units = zip(*map(name_and_unit, HEADER), strict=True)
        first, second, third = frame.to_numpy().tolist()
        rows = [["Court 3"], [], [*names], [*units], first, second, [], third]
        padded = [[*row, *[None] * (len(HEADER) - len(row)), " "] for row in rows]
        impacts = pandas.DataFrame(padded)
        impacts.to_excel(book, sheet_name="impacts", index=False, header=False)
    table, notes = read(path)
    assert_same(table, meant(ROWS))
    assert notes == ["sheet", "above-header", "units-row"]
    table, notes = read(f"{path}#impacts")
    assert_same(table, meant(ROWS))
    assert notes == ["above-header", "units-row"]
    assert faults_of(f"{path}#sand") == [("no-sheet", None, None, None)]
    with pandas.ExcelWriter(path) as book:
        frame.to_excel(book, sheet_name="clay", index=False)
        frame[:2].to_excel(book, sheet_name="grass #2", index=False)
    assert faults_of(path) == [("several-sheets", None, None, None)]
    assert_same(table_of(f"{path}#grass #2"), meant(ROWS[:2]))


def test_all_sheets_of_a_workbook_are_named(tmp_path, frame):
    path = tmp_path / "t.xlsx"
    with pandas.ExcelWriter(path) as book:
        for name in ("notes", "my balls"):
            pandas.DataFrame([["what", "who"]]).to_excel(book, sheet_name=name, index=False)
        frame.to_excel(book, sheet_name="clay", index=False)
    [note] = [note for note in read_cells(path, Naming({}).worth).notes if note.code == "sheet"]
    assert all(f"'{name}'" in note.text for name in ("notes", "my balls", "clay"))


def test_damaged_files_are_refused(tmp_path, frame):
    frame.to_excel(tmp_path / "t.xlsx", index=False)
    save_ods(frame, tmp_path / "t.ods")
    frame.to_parquet(tmp_path / "t.parquet")
    for ending, code in (
        ("xlsx", "not-a-workbook"),
        ("ods", "not-a-workbook"),
        ("parquet", "not-parquet"),
    ):
        data = (tmp_path / f"t.{ending}").read_bytes()
        half = len(data) // 2
        for damaged in (
            data[:10],
            data[:half],
            data[:-300] + b"x" * 300,
        ):
            path = written(tmp_path, damaged, f"cut.{ending}")
            assert faults_of(path) == [(code, None, None, None)]
    path = written(tmp_path, b"PK", "t.xls")
    assert faults_of(path) == [("not-a-workbook", None, None, None)]
    for missing in (
        tmp_path / "absent.csv",
        tmp_path,
        "a" * 5000,
        "a\0b",
        "\udcff.csv",
    ):
        assert faults_of(missing) == [("not-found", None, None, None)]


# A text, and the place of its only fault.
WRONG = [
    ("", ("empty", None, None, None)),
    ("# words\n\n#more\n", ("empty", None, None, None)),
    (
        "v_y1;v_y2\n1,234;0\n1,500;2\n",
        ("ambiguous-number", 1, 2, "v_y1"),
        ("ambiguous-number", 2, 3, "v_y1"),
    ),
    ("v_y1;v_y2\n5,1;4.2\n6;4.3\n", ("ambiguous-number", 1, 2, "v_y1")),
    ("v_y1;v_y2\n1.005,1;4,2\n6,1;4,3\n", ("ambiguous-number", 1, 2, "v_y1")),
    ("v_y1;v_y2\n1 234;4\n6;4\n", ("ambiguous-number", 1, 2, "v_y1")),
    ("v_y1;v_y2\n5,1,2;4,2\n6,1;4,3\n", ("not-a-number", 1, 2, "v_y1")),
    ('v_y1,v_y2\n"5,125",4.5\n6,4.3\n', ("ambiguous-number", 1, 2, "v_y1")),
    ("v_y1,v_y2\n6,4\n\n5\n", ("row-length", 2, 4, None)),
    ("v_y1,v_y2\n5 ± ,4\n6,4\n", ("not-a-number", 1, 2, "v_y1")),
    ("v_y1,v_y2\n5 ± -1,4\n6,4\n", ("not-a-number", 1, 2, "v_y1")),
    ("v_y1,v_y2\n± 1,4\n6,4\n", ("not-a-number", 1, 2, "v_y1")),
    ("v_y1,v_y2\n5 ± 1 ± 2,4\n6 ± 1,4\n", ("not-a-number", 1, 2, "v_y1_sd")),
    ("v_y1,v_y2\nm/s,furlongs\n5,4\n6,5\n", ("unknown-unit", None, 1, "v_y2")),
    ("v_y1 [1/s],v_y2\n6,5\n7,6\n", ("ambiguous-unit", None, 1, "v_y1")),
    ("# a\nv_y1 [rpm],v_y2\n6,5\n7,6\n", ("other-quantity", None, 2, "v_y1")),
    ("5,4\nv_y1,v_y2\n6,5\n7,6\n", ("above-header", None, 1, None)),
    (
        "id,v_y1,v_y2\n1,5,4\nMittelwert,5,4\nSD,1,1\n",
        ("summary-row", 2, 3, None),
        ("summary-row", 3, 4, None),
    ),
    (",v_y1,v_y2\n1,5,4\n2,6,5\nStd. dev.,0.7,0.6\n", ("summary-row", 3, 4, None)),
    ('"corr(v_y1,foo)",v_y1,v_y2\n0,5,4\n', ("unknown-correlation", None, 1, "corr(v_y1,foo)")),
    (b"surface,v_y1,v_y2\nplain,5,4\nras\x81,5,4\n", ("encoding", None, 3, None)),
    # A letter of Windows-1252 beside the same one in UTF-8, of which both bytes are signs there;
    # half a letter.
    (
        b"surface,v_y1,v_y2\nplain,5,4\nra\xf1,5,4\n" + "rañ,5,4\n".encode(),
        ("encoding", None, 3, None),
    ),
    ("v_y1,v_y2\n5,4\n".encode("utf-16")[:-1], ("encoding", None, 2, None)),
    ("v_y1 [m/s],v_y2\nkm/h,m/s\n5,4\n", ("brackets", None, 1, "v_y1 [m/s] [km/h]")),
    (b"v_y1,v_y2\n5,4\n5,\0\n", ("encoding", None, 3, None)),
    *(
        (f"v_y1,v_y2\n6,5\n{cell},5\n", ("not-a-number", 2, 3, "v_y1"))
        for cell in ("1e-9999", "#WERT!")
    ),
    ("v_y1,v_y2\n6,5\n" + "9" * 330 + ",5\n", ("not-finite", 2, 3, "v_y1")),
]


@pytest.mark.parametrize(("text", "faults"), [(text, list(faults)) for text, *faults in WRONG])
def test_what_is_nonsense_or_may_be_two_things_is_refused_at_its_place(tmp_path, text, faults):
    assert faults_of(written(tmp_path, text)) == faults


def test_ten_thousand_faults_are_kept(tmp_path):
    many = faults_of(written(tmp_path, "v_y1,v_y2\n" + "x,y\n" * 6000))
    assert len(many) == 10_001
    assert many[-1][0] == "more-faults"


def test_what_was_assumed_is_noted(tmp_path):
    head = "No.;V_1 [mph];theta_1;v_2 [mph];spin in\n"
    text = f"Test 3\n{head}1;38,1;18;28,0 ± 0,3;20\n\n;;\n{head}2;\u221239,2;;n/a;\n"
    table, notes = read(written(tmp_path, text.encode("utf-16")))
    assert {*notes} == {
        "above-header",
        "header-again",
        "not-read",
        "plus-minus",
        "decimal-commas",
    }
    assert_allclose(table["v_1"], np.array([38.1, -39.2]) * SI["mph"])
    assert_allclose(table["v_2_sd"], [0.3 * SI["mph"], np.nan])
    assert table["id"] == ["1", "2"]
    assert table["spin in"] == ["20", ""]
    of_windows = "v_1,surface\n1,ras\u00e9\n".encode("cp1252")
    _, notes = read(written(tmp_path, of_windows))
    assert notes == ["encoding"]


def test_a_header_behind_a_comment_mark_as_numpy_writes_it(tmp_path):
    path = tmp_path / "t.txt"
    rows = [
        [10.0, 6.0, 7.0, 4.0],
        [11.0, 7.0, 8.0, 5.0],
    ]
    np.savetxt(path, rows, header="v_x1 v_y1 v_x2 v_y2")
    assert_array_equal(table_of(path)["v_y1"], [6.0, 7.0])


def test_what_excel_shows_for_missing_values_begins_no_comment(tmp_path):
    text = 'omega_2,v_y1\n#N/A,5\n3,6\n# a, "comment\n#NV,7\n-,8\nNaN,9\n'
    table = table_of(written(tmp_path, text))
    assert_array_equal(table["omega_2"], [np.nan, 3, np.nan, np.nan, np.nan])


def test_correlations_and_deviations_of_columns(tmp_path):
    """A deviation without a unit has that of its column; correlations have one order and no
    unit.
    """
    text = 'v_1 [mph],v_1_sd,theta_1,v_2,"corr(V_2, v_1)"\n40,1,30,9,-0.5\n'
    table = table_of(written(tmp_path, text))
    assert table["corr(v_1,v_2)"] == [-0.5]
    assert_allclose(table["v_1_sd"], [SI["mph"]])
    assert_allclose(table["theta_1"], [np.pi / 6])


def test_names_and_units_of_ones_own(tmp_path):
    plain = written(tmp_path, "Vin,angle_in,v_2,Belag\n38,20,42,clay\n", "plain.csv")
    columns = {
        "v_1": "vin [mph]",
        "theta_1": "angle_in [rad]",
        "v_2": "v_2 [km/h]",
        "surface": "Belag",
    }
    table = table_of(plain, columns)
    assert_allclose(table["v_1"], [38 * SI["mph"]])
    assert_allclose(table["theta_1"], [20])
    assert_allclose(table["v_2"], [42 / 3.6])
    assert table["surface"] == ["clay"]
    # They make a header of a line, and of its separator one.
    below_words = written(tmp_path, "a, b; c\nfoo;bar\n5;4\n")
    table = table_of(below_words, {"v_y1": "foo", "v_y2": "bar"})
    assert table == {"v_y1": [5.0], "v_y2": [4.0]}
    assert "v_1" not in table_of(plain, {"v_1": "V_in"}, optional=["v_1"])
    for wrong in ({"v_1": " "}, {"v_1": "[mph]"}):
        with pytest.raises(ParameterError) as caught:
            Naming(wrong)
        assert caught.value.code == "columns"


OWN = "speed in (km/h);angle;spin rpm before;speed after (km/h);angle after;spin rpm after"
GERMAN = (
    "Geschwindigkeit vor [km/h];Winkel vor;Drall vor [rpm];Geschwindigkeit nach "
    "[km/h];Winkel nach;Drall nach [rpm]"
)
COMPOUND = (
    "Einfallsgeschwindigkeit [km/h];Einfallswinkel;Drehzahl vorher [rpm];"
    "Rückprallgeschwindigkeit [km/h];Rückprallwinkel;Drehzahl nachher [rpm]"
)
OURS = "v_1 [km/h];theta_1;omega_1 [rpm];v_2 [km/h];theta_2;omega_2 [rpm]"


@pytest.mark.parametrize("header", [OWN, GERMAN, COMPOUND])
def test_the_names_that_are_proposed_read_the_table(tmp_path, header):
    """Without the spins it would be read with an incident spin of zero. `angle` beside `angle
    after` is the other.
    """
    body = "\n61,2;20,5;-74;38;26;2750\n60,8;33,0;100;37;44;2930\n"
    path = written(tmp_path, header + body)
    naming = Naming({})
    cells = read_cells(path, naming.worth)
    header_read = with_proposals(cells, read_header(cells, naming), naming)
    guesses = header_read.guesses
    note_unread(cells, header_read)
    codes = [note.code for note in cells.notes]
    assert codes.count("not-read") == 6
    ours = written(tmp_path, OURS + body, "ours.csv")
    assert_same(table_of(path, guesses), table_of(ours))


ENDS = {
    "1": "in inc incident incoming before impact pre initial i 1",
    "2": "out outgoing rebound after post final exit r f 2",
}


@pytest.mark.parametrize("end", ENDS)
def test_a_guess_never_swaps_incidence_and_rebound(end):
    quantities = ("v", "theta", "omega", "speed", "angle", "spin", "vx", "v_y", "velocity")
    forms = ("{q}_{w}", "{w}_{q}", "{q}{t}", "{w} {q}", "{q}.{w}", "{t}{q}")
    words = ENDS[end].split()
    guessed = 0
    names = 0
    for quantity, word, form in product(quantities, words, forms):
        name = form.format(q=quantity, w=word, t=word.title())
        guess = guess_of(name)
        for column in guess:
            assert column.endswith(end)
        assert end_of(name) in (None, end)
        names += 1
        guessed += bool(guess)
    assert guessed > 0.9 * names


@pytest.mark.parametrize("name", ["v_72", "v_23", "V_2+", "theta_22", "teta_2", "omga_1", "omega_"])
def test_a_slip_in_a_name_is_a_fault_and_no_column_of_ones_own(name):
    assert faults_of({"v_1": [1.0], name: [1.0]}) == [("misspelt-column", None, None, name)]


def test_a_name_beside_all_that_it_resembles_is_ones_own():
    names = ["theta_1", "theta_1_sd", "theta_2", "theta_2_sd", "theta_3"]
    table = table_of({name: [1.0] for name in names})
    assert table["theta_3"] == ["1"]
    # Of the other end nothing is a slip.
    table = table_of({"omega_1": [1.0], "omega_1_sd": [1.0], "omga_1": [1.0]})
    assert table["omga_1"] == ["1"]
    table = table_of({"id": ["a"], "No.": [1], "v_1_km_h": [36.0]})
    assert table == {"id": ["a"], "No.": ["1"], "v_1": [10.0]}


def test_a_row_of_names_is_no_row_of_units(tmp_path):
    """Though `s` and `m` are, and a row of units may repeat what the header says."""
    path = written(tmp_path, "id,surface,location,v_1\ns,clay,north,\nm,clay,north,5\n")
    table, notes = read(path)
    assert table["id"] == ["s", "m"]
    assert "units-row" not in notes
    units_twice = written(tmp_path, "v_1 [km/h],theta_1\nkm/h,rad\n36,1\n")
    assert table_of(units_twice) == {"v_1": [10.0], "theta_1": [1.0]}


def test_a_quote_behind_a_separator_and_a_blank_is_a_quote(tmp_path):
    path = tmp_path / "balls.csv"
    path.write_text(
        'v_1, "theta_1", v_y2, "who, when"\n17, "20", 4.4, "a, b"\n18, 22, "5.1", "c"\n'
    )
    table = load_table(path)
    assert table.values["theta_1"] == pytest.approx(np.radians([20.0, 22.0]))
    assert table.labels["who, when"] == ("a, b", "c")
