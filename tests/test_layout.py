"""Layouts of measuring programs: separators, lines above the header, rows that sum up."""

import numpy as np
import pytest
from made_tables import written
from numpy.testing import assert_allclose

import fitball
from fitball.base.errors import InputError
from fitball.data.header import Naming
from fitball.data.scene import Scene
from fitball.data.sources import read_cells
from fitball.tracks.read import read_tracks

# Five impacts: v_1 [m/s], theta_1 [deg], v_x2, v_y2 [m/s], omega_2 [rad/s].
IMPACTS = np.array(
    [
        [17.0, 20.5, 10.0, 4.9, 288.0],
        [16.9, 33.0, 7.5, 7.2, 306.8],
        [17.2, 45.0, 6.5, 8.7, 224.1],
        [17.1, 60.0, 4.2, 10.3, 131.9],
        [16.4, 25.2, 9.1, 5.6, 301.0],
    ]
)
NAMES = ["v_1", "theta_1", "v_x2", "v_y2", "omega_2"]


def lines_of(rows, separator):
    """Rows of numbers or texts, as lines."""
    return [separator.join(map(str, row)) for row in rows]


def assert_impacts(table, rows=IMPACTS):
    """The table has these impacts."""
    factors = [1.0, np.pi / 180.0, 1.0, 1.0, 1.0]
    for name, column, factor in zip(NAMES, rows.T, factors, strict=True):
        assert_allclose(table.values[name], column * factor, rtol=1e-14, err_msg=name)


def codes_of(table):
    return [note.code for note in table.notices]


def faults_of(path, **reading):
    with pytest.raises(InputError) as caught:
        fitball.load_table(path, **reading)
    return [(fault.code, fault.row, fault.line) for fault in caught.value.faults]


# ---- separators


@pytest.mark.parametrize(
    ("names", "separator"),
    [
        (["Latest: Time (s)", "Latest: X (m)", "Latest: Y (m)"], ","),
        (["Run 1: Time (s)", "Run 1: X (m)", "Run 1: Y (m)"], "\t"),
        (["Time (s) Run #1", "X (m) Run #1", "Y (m) Run #1"], ","),
        (["Time (s) Run #2", "X (m) Run #2", "Y (m) Run #2"], ";"),
        (["Frame", "ball X", "ball Y"], "\t"),
        (["clock (s)", "ball height (m)", "ball x (m)"], "|"),
        (["ball speed in (m/s)", "ball speed out (m/s)", "remark"], ","),
        (["Data set 1:Time(s)", "Data set 1:X(m)", "Data set 1:Y(m)"], ","),
        (["time of frame [s]", "ball x [m]", "ball y [m]"], "   "),
    ],
)
def test_the_separator_gives_all_rows_the_cells_of_the_header(tmp_path, names, separator):
    rows = [["0.0", "0.20", "0.62"], ["0.004", "0.26", "0.60"], ["0.008", "0.32", "0.58"]]
    path = written(tmp_path, "\n".join(lines_of([names, *rows], separator)))
    cells = read_cells(path, Naming({}).worth)
    assert cells.names == names
    assert [cells.text(k) for k in range(3)] == [[*column] for column in zip(*rows, strict=True)]


def test_rows_of_another_length_do_not_change_the_separator(tmp_path):
    head = "ball speed in (m/s),ball speed out (m/s)"
    path = written(tmp_path, f"{head}\n5,4\n6,5\n7\n8,6\n")
    cells = read_cells(path, Naming({}).worth)
    assert cells.names == head.split(",")
    assert [(fault.code, fault.row) for fault in cells.faults] == [("row-length", 3)]


def test_the_name_of_a_data_set_is_no_part_of_a_quantity(tmp_path):
    forms = ["Latest: {} ({})", "Run 12: {} ({})", "{} ({}) Run #3", "{} ({}), Series 2"]
    forms += ["Run 1 {} ({})", "Data Set 1:{}({})"]
    units = ["m/s", "deg", "m/s", "m/s", "rad/s"]
    for form in forms:
        names = [form.format(*pair) for pair in zip(NAMES, units, strict=True)]
        text = "\n".join(lines_of([names, *IMPACTS], "\t"))
        table = fitball.load_table(written(tmp_path, text))
        assert_impacts(table)
        assert codes_of(table) == ["no-incident-spin"]


def test_two_runs_side_by_side_are_one_quantity_twice(tmp_path):
    path = written(tmp_path, "Run 1: v_y1,Run 2: v_y1,v_y2\n5,6,4\n6,7,5\n")
    assert faults_of(path)[0][0] == "column-twice"


@pytest.mark.parametrize("form", ["Latest: {} ({})", "{} ({}) Run #1"])
def test_positions_of_logger_pro_and_capstone(tmp_path, form):
    names = [form.format(*pair) for pair in (("Time", "s"), ("X", "cm"), ("Y", "cm"))]
    rows = [[0.01 * k, 10.0 * k, 50.0 - k] for k in range(6)]
    path = written(tmp_path, "\n".join(lines_of([names, *rows], ",")))
    (track,), _ = read_tracks([path], Scene(), {})
    assert_allclose(track.x, 0.1 * np.arange(6.0))
    assert_allclose(track.time, 0.01 * np.arange(6.0))


# ---- R, Matlab, LabVIEW, DOS


@pytest.mark.parametrize("separator", [" ", "\t", ";", ","])
@pytest.mark.parametrize("named", [True, False])
def test_names_of_rows_that_r_writes_without_a_head(tmp_path, separator, named):
    rows = [[f'"ball {k}"' if named else f'"{3 * k}"', *row] for k, row in enumerate(IMPACTS)]
    text = "\n".join(lines_of([[f'"{name}"' for name in NAMES], *rows], separator))
    table = fitball.load_table(written(tmp_path, text))
    assert_impacts(table)
    assert "row-names" in codes_of(table)
    assert table.labels["id"][2] == ("ball 2" if named else "6")


@pytest.mark.parametrize(
    "text",
    [
        # Commas that may be decimal signs, numbers that are no names, names that repeat.
        "v_y1,v_y2\n5,1,4\n6,2,5\n7,1,6\n",
        "v_y1,v_y2\n7,1,6\n6,2,5\n5,1,4\n",
        "v_y1 v_y2\n5.5 4.4 1\n6.5 5.5 1\n",
        "v_y1 v_y2\na 5.5 4.4\na 6.5 5.5\n",
        "v_y1 v_y2\n1 5.5 4.4\n2 6.5 5.5\n4 7.5\n",
    ],
)
def test_what_may_be_no_names_of_rows_is_refused(tmp_path, text):
    assert faults_of(written(tmp_path, text))[0] == ("row-length", 1, 2)


def test_cells_that_are_empty_behind_the_last_column_are_no_names_of_rows(tmp_path):
    table = fitball.load_table(written(tmp_path, "v_y1,v_y2\n5,4,\n6,5,\n"))
    assert_allclose(table.values["v_y1"], [5.0, 6.0])
    assert table.notices == ()


@pytest.mark.parametrize("line", ["   1.0e+03 *", "1.0e+03  *", "1.0D+03 *", "x 10^3", "×10³"])
@pytest.mark.parametrize("below", [True, False])
def test_a_factor_beside_the_header_multiplies_all_numbers(tmp_path, line, below):
    shown = [[f"{number / 1000.0:.7f}" for number in row] for row in IMPACTS]
    head = "  ".join(NAMES)
    above = [head, "", line, ""] if below else ["A =", "", line, "", head]
    table = fitball.load_table(written(tmp_path, "\n".join([*above, *lines_of(shown, "   ")])))
    assert_impacts(table)
    assert "factor" in codes_of(table)


@pytest.mark.parametrize(
    "title", ["Test 1000", "10 balls", "1.0e+03", "July 10", "x", "2 *", "Box 100"]
)
def test_a_title_is_no_factor(tmp_path, title):
    table = fitball.load_table(written(tmp_path, f"{title}\nv_y1,v_y2\n5,4\n6,5\n"))
    assert_allclose(table.values["v_y1"], [5.0, 6.0])
    assert codes_of(table) == ["above-header"]


@pytest.mark.parametrize(
    "title",
    ["Values x 10^3", "numbers × 10³", "speeds (*1e-2)", "1000 ×", "all ×100", "in thousandths"],
)
def test_a_factor_in_a_title_may_be_in_the_numbers_or_not(tmp_path, title):
    path = written(tmp_path, f"Court 3\n{title}\nv_y1,v_y2\n5,4\n6,5\n")
    assert faults_of(path) == [("factor", None, 2)]


LABVIEW = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Multi_Headings\tNo
X_Columns\tOne
Time_Pref\tRelative
Date\t2026/03/01
***End_of_Header***\t
\t
Channels\t2\t\t
Samples\t4\t4\t
X_Dimension\tTime\tTime\t
X0\t0.0\t0.0\t
Delta_X\t0.01\t0.01\t
***End_of_Header***\t\t\t
"""


def test_the_header_of_labview_is_behind_its_last_mark(tmp_path):
    rows = [[f"{0.01 * k:.6f}", f"{0.1 * k}", f"{0.5 - 0.01 * k}"] for k in range(6)]
    text = "\n".join(lines_of([["X_Value", "x [m]", "y [m]", "Comment"], *rows], "\t"))
    path = written(tmp_path, LABVIEW + text, "t.lvm")
    (track,), notes = read_tracks([path], Scene(), {})
    assert_allclose(track.time, 0.01 * np.arange(6.0))
    assert_allclose(track.x, 0.1 * np.arange(6.0))
    assert notes[0].code == "above-header"
    # Lines are those of the file.
    impacts = "v_y1\tv_y2\tComment\n5\t4\n6\tfast\n"
    assert faults_of(written(tmp_path, LABVIEW + impacts)) == [("not-a-number", 2, 18)]


def test_segments_of_labview_are_asked_for_one_by_one(tmp_path):
    segment = LABVIEW[LABVIEW.index("Channels") :] + "X_Value\tv_y1\tv_y2\n0\t5\t4\n1\t6\t5\n"
    head = LABVIEW[: LABVIEW.index("Channels")]
    assert len(fitball.load_table(written(tmp_path, head + segment))) == 2
    faults = faults_of(written(tmp_path, head + segment + segment))
    assert [code for code, _, _ in faults] == ["several-tables"]


@pytest.mark.parametrize("end", ["\x1a", "\n\x1a", "\r\n\x1a\x1a\x1a", "\n\x1a\r\n"])
@pytest.mark.parametrize("coding", ["utf-8", "utf-16", "utf-16-be", "utf-16-le", "cp1252"])
def test_what_ends_a_file_of_dos_is_no_row(tmp_path, end, coding):
    text = f"v_y1,v_y2\n5,4\n6,5{end}"
    table = fitball.load_table(written(tmp_path, text.encode(coding)))
    assert_allclose(table.values["v_y2"], [4.0, 5.0])
    assert table.notices == ()


def test_a_block_of_dos_is_filled_with_anything(tmp_path):
    table = fitball.load_table(written(tmp_path, "v_y1,v_y2\n5,4\n6,5\n\x1a\0\0\0\x1a\0"))
    assert_allclose(table.values["v_y2"], [4.0, 5.0])


def test_a_mark_of_dos_among_rows_is_a_fault(tmp_path):
    path = written(tmp_path, "v_y1,v_y2\n5,4\n\x1a\n6,5\n")
    assert faults_of(path) == [("row-length", 2, 3)]


@pytest.mark.parametrize(
    "text",
    [
        "v_y1     v_y2\n_____    _____\n\n5.5      4.4\n6.5      5.5\n",
        "| v_y1 | v_y2 |\n|------|:----:|\n| 5.5 | 4.4 |\n| 6.5 | 5.5 |\n",
        " v_y1 | v_y2 \n------+------\n  5.5 |  4.4 \n  6.5 |  5.5\n",
        "v_y1,v_y2\n===,===\n5.5,4.4\n6.5,5.5\n",
        "Columns 1 through 2\nv_y1 v_y2\n5.5 4.4\n6.5 5.5\n",
    ],
)
def test_rules_below_a_header_are_no_rows(tmp_path, text):
    table = fitball.load_table(written(tmp_path, text))
    assert_allclose(table.values["v_y1"], [5.5, 6.5])
    assert_allclose(table.values["v_y2"], [4.4, 5.5])


# ---- rows that sum up a table

CERTAIN = [
    *("Écart-type", "Ecart type", "Standardabweichung", "St.-Abw.", "Stabw.", "STABW.N"),
    *("desviación estándar", "Desv. est.", "Desviación típica", "Deviazione standard", "Dev.St."),
    *("desvio padrão", "Standaarddeviatie", "Standardavvikelse", "Odchylenie standardowe"),
    *("StDev", "Std. Dev.", "St. Dev.", "STDEV.S", "Standard error", "SEM", "rel. SD"),
    *(
        "Mean ± SD",
        "Mittelwert ± Stabw.",
        "Mean (n = 6)",
        "MEAN:",
        "Mittelwerte",
        "Moyenne",
        "Promedio",
        "Media",
        "média",
    ),
    *("Gemiddelde", "Medelvärde", "Średnia", "Průměr", "keskiarvo", "среднее", "平均", "标准差"),
    *("Médiane", "Variance", "Variationskoeffizient", "Durchschnitt:", "Standardfehler"),
]


@pytest.mark.parametrize("word", CERTAIN)
def test_rows_that_sum_up_a_table_in_many_languages(tmp_path, word):
    rows = [["a", 5.1, 4.2], ["b", 6.3, 5.1], [word, 5.7, 4.65], ["c", 6.6, 5.2]]
    text = "\n".join(lines_of([["id", "v_y1", "v_y2"], *rows], ";"))
    assert faults_of(written(tmp_path, text)) == [("summary-row", 3, 4)]


@pytest.mark.parametrize(
    ("words", "last"),
    [
        (["SD"], [[0.6, 0.5]]),
        (["SE"], [[0.3, 0.2]]),
        (["CV %"], [[0.1, 0.1]]),
        (["s"], [[0.6, 0.5]]),
        (["n"], [[4, 4]]),
        (["N ="], [[4, 4]]),
        (["min", "Max."], [[5.1, 4.2], [6.6, 5.3]]),
        (["Summe"], [[24.2, 19.8]]),
        (["Standardfehler", "95%-KI"], [[0.3, 0.2], [0.6, 0.4]]),
        (["Mean", "SD", "n"], [[6.05, 4.95], [0.6, 0.5], [4, 4]]),
        (["Ø", "s", "CV [%]"], [[6.05, 4.95], [0.6, 0.5], [10, 10]]),
    ],
)
def test_short_words_count_at_the_end_where_numbers_are_such(tmp_path, words, last):
    rows = [["a", 5.1, 4.2], ["b", 6.3, 5.1], ["c", 6.2, 5.2], ["d", 6.6, 5.3]]
    rows += [[word, *numbers] for word, numbers in zip(words, last, strict=True)]
    text = "\n".join(lines_of([["id", "v_y1", "v_y2"], *rows], ","))
    wanted = [("summary-row", 5 + k, 6 + k) for k in range(len(words))]
    assert faults_of(written(tmp_path, text)) == wanted


ROWS = [[5.1, 4.2], [6.3, 5.1], [6.2, 5.2], [6.6, 5.3]]
# Their means and standard deviations.
SUMMARY = {"mean": [6.05, 4.95], "sd": [0.65574, 0.51], "error": [0.1, 0.2]}


@pytest.mark.parametrize("kind", [*SUMMARY])
@pytest.mark.parametrize("word", ["погрешность", "incertezza", "误差", "±1 sd", "middel"])
def test_rows_that_sum_up_are_seen_by_their_numbers_whatever_the_word(tmp_path, word, kind):
    rows = [[k + 1, *numbers] for k, numbers in enumerate(ROWS)]
    text = "\n".join(lines_of([["id", "v_y1", "v_y2"], *rows, [word, *SUMMARY[kind]]], ","))
    assert faults_of(written(tmp_path, text)) == [("summary-row", 5, 6)]


def test_words_behind_rows_that_sum_up(tmp_path):
    rows = [[k + 1, *numbers, ""] for k, numbers in enumerate(ROWS)]
    rows += [["", *numbers, word] for word, numbers in SUMMARY.items()]
    text = "\n".join(lines_of([["id", "v_y1", "v_y2", "remark"], *rows], ","))
    wanted = [("summary-row", 5 + k, 6 + k) for k in range(len(SUMMARY))]
    assert faults_of(written(tmp_path, text)) == wanted


def test_errors_in_the_row_below_the_header(tmp_path):
    rows = [[k + 1, *numbers] for k, numbers in enumerate(ROWS)]
    text = "\n".join(lines_of([["id", "v_y1", "v_y2"], ["u", 0.1, 0.1], *rows], ","))
    assert faults_of(written(tmp_path, text)) == [("summary-row", 1, 2)]


@pytest.mark.parametrize("place", ["first", "last"])
def test_a_row_with_another_kind_of_id_is_an_impact(tmp_path, place):
    rng = np.random.default_rng(6)
    path = tmp_path / "table.csv"
    for _ in range(40):
        incident = rng.uniform(4.0, 9.0, 8)
        ids = [*map(str, range(1, 8))]
        ids.insert(0 if place == "first" else 7, "7b")
        rows = [
            [name, f"{v:.2f}", f"{0.75 * v:.2f}"] for name, v in zip(ids, incident, strict=True)
        ]
        path.write_text("\n".join(lines_of([["id", "v_y1", "v_y2"], *rows], ",")))
        assert len(fitball.load_table(path)) == 8


@pytest.mark.parametrize(
    "ids",
    [
        [chr(97 + k) for k in range(14)],
        [chr(65 + k) for k in range(13)],
        ["NE", "NW", "SW", "SE"],
        ["Ann", "Bob", "Tom", "Max"],
        ["r1", "r2", "r3", "s"],
    ],
)
def test_an_id_that_may_be_such_a_word_is_an_id(tmp_path, ids):
    rng = np.random.default_rng(1)
    incident = rng.uniform(5.0, 9.0, len(ids))
    rows = [
        [name, f"{speed:.2f}", f"{0.75 * speed:.2f}"]
        for name, speed in zip(ids, incident, strict=True)
    ]
    text = "\n".join(lines_of([["id", "v_y1", "v_y2"], *rows], ","))
    table = fitball.load_table(written(tmp_path, text))
    assert table.labels["id"] == tuple(ids)
    assert table.notices == ()


# ---- other formats


@pytest.mark.parametrize(
    ("name", "data", "package"),
    [
        ("a.tdms", b"TDSm\x0e\0\0\0", "npTDMS"),
        ("a.mat", b"MATLAB 5.0 MAT-file, Platform: GLNXA64", "scipy"),
        ("a.wav", b"RIFF\x24\0\0\0WAVE", "scipy"),
        ("a.c3d", b"\x02P\0\0", "ezc3d"),
        ("a.TIFF", b"II*\0", "tifffile"),
        ("a.h5", b"\x89HDF\r\n\x1a\n", "h5py"),
        ("a.npz", b"PK\x03\x04", "numpy"),
        ("a.dat", b"\x89HDF\r\n\x1a\n", "h5py"),
        ("a.csv", b"PK\x03\x04", ".xlsx"),
        ("a.csv", b"PAR1\0\0", ".parquet"),
        ("a.json", b"{}", "pandas"),
        ("a.csv.gz", b"\x1f\x8b\x08", "CSV"),
    ],
)
def test_files_of_other_programs_are_named_with_what_reads_them(tmp_path, name, data, package):
    path = written(tmp_path, data, name)
    for read in (fitball.load_table, lambda source: read_tracks([source], Scene(), {})):
        with pytest.raises(InputError) as caught:
            read(path)
        assert caught.value.code == "other-format"
        assert package in str(caught.value)
