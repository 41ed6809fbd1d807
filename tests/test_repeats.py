"""Repeats side by side in a table have rows of their own."""

import numpy as np
import pytest

import fitball
from fitball.base.errors import InputError
from fitball.data.header import Naming
from fitball.data.repeats import in_rows
from fitball.data.sources import read_cells

INCIDENT = {"v_y1": [5.0, 6.0]}
REPEATS = ([4.0, 4.5], [4.1, 4.6], [4.05, 4.55])
ROWS = [4.0, 4.1, 4.05, 4.5, 4.6, 4.55]


def repeated(*heads):
    return {**INCIDENT, **dict(zip(heads, REPEATS, strict=True))}


def notes_of(table):
    return [note.code for note in table.notices]


@pytest.mark.parametrize(
    "heads",
    [
        ("v_y2 a", "v_y2 b", "v_y2 c"),
        ("v_y2a", "v_y2b", "v_y2c"),
        ("v_y2_1", "v_y2_2", "v_y2_3"),
        ("v_y2 (1)", "v_y2 (2)", "v_y2 (3)"),
        ("V_Y2 trial 1", "V_Y2 trial 2", "V_Y2 trial 3"),
        ("v_y2 [m/s] Run #4", "v_y2 [m/s] Run #7", "v_y2 [m/s] Run #9"),
        ("v_y2 rep1 (m/s)", "v_y2 rep2 (m/s)", "v_y2 rep3 (m/s)"),
        ("v_y2", "v_y2.1", "v_y2.2"),
    ],
)
def test_a_mark_behind_a_name_is_that_of_a_repeat(heads):
    table = fitball.load_table(repeated(*heads))
    assert table.values["v_y1"] == pytest.approx([5.0] * 3 + [6.0] * 3)
    assert table.values["v_y2"] == pytest.approx(ROWS)
    assert [*table.labels] == ["id"]
    assert len({*table.labels["id"]}) == 6
    assert "repeats" in notes_of(table)


@pytest.mark.parametrize("their", ["Trial *", "trial*", "Trial * [m/s]"])
def test_a_star_stands_for_the_mark(their):
    table = fitball.load_table(
        repeated("Trial 1", "Trial 2", "Trial 3"),
        columns={"v_y2": their},
    )
    assert table.values["v_y2"] == pytest.approx(ROWS)


def test_units_ids_sds_and_labels_stay_with_their_repeats():
    columns = {
        "No.": [7, 8],
        "ball": ["x", "y"],
        "v_y1 a [km/h]": [18.0, 21.6],
        "v_y2 a [km/h]": ["14.4 ± 0.4", "16.2 ± 0.4"],
        "v_y1 b [km/h]": [18.36, 21.96],
        "v_y2 b [km/h]": ["14.76 ± 0.8", ""],
    }
    table = fitball.load_table(columns)
    assert table.labels["id"] == ("7 a", "7 b", "8 a")
    assert table.labels["ball"] == ("x", "x", "y")
    assert table.values["v_y1"] == pytest.approx([5.0, 5.1, 6.0])
    assert table.values["v_y2"] == pytest.approx([4.0, 4.1, 4.5])
    assert table.sd["v_y2"] == pytest.approx(np.array([0.4, 0.8, 0.4]) / 3.6)


def test_faults_are_at_the_row_of_the_file(tmp_path):
    file = tmp_path / "repeats.csv"
    file.write_text("v_y1,v_y2 a,v_y2 b\n5,4,4.1\n6,4.5,oops\n")
    with pytest.raises(InputError) as refusal:
        fitball.load_table(file)
    [fault] = refusal.value.faults
    assert (fault.code, fault.row, fault.line) == ("not-a-number", 2, 3)


def test_the_mean_of_repeats_is_none_of_them():
    mean = np.mean(REPEATS, axis=0).round(2)
    table = fitball.load_table({**repeated("v_y2 a", "v_y2 b", "v_y2 c"), "v_y2": mean})
    assert table.values["v_y2"] == pytest.approx(ROWS)
    average = fitball.load_table(
        {**repeated("Trial 1", "Trial 2", "Trial 3"), "Average": mean},
        columns={"v_y2": "Trial *"},
    )
    assert average.values["v_y2"] == pytest.approx(ROWS)


def test_successive_bounces_side_by_side():
    columns = {"h0": [1.0, 1.5], "h1": [0.56, 0.8], "h2": [0.31, 0.45], "h3": [0.17, 0.25]}
    table = fitball.load_table(columns, columns={"peak_height": "h*"})
    drops = [1.0, 0.56, 0.31, 1.5, 0.8, 0.45]
    rises = [0.56, 0.31, 0.17, 0.8, 0.45, 0.25]
    expected = fitball.load_table({"drop_height": drops, "rebound_height": rises})
    assert table.values["v_y1"] == pytest.approx(expected.values["v_y1"])
    assert table.values["v_y2"] == pytest.approx(expected.values["v_y2"])


# A table as people write it, and what is proposed.
PROPOSED = {
    "Drop height (cm),Trial 1,Trial 2,Trial 3,Average\n50,28,29,28,28.3\n100,56,57,55,56\n": {
        "rebound_height": "Trial * [cm]"
    },
    "Drop height (cm),Bounce height 1 (cm),Bounce height 2 (cm)\n50,28,29\n100,56,57\n": {
        "rebound_height": "Bounce height * (cm)"
    },
    "Drop Height (cm),Bounce 1 (cm),Bounce 2 (cm)\n50,28,16\n100,56,31\n": {
        "peak_height": "Bounce * (cm)"
    },
    "Drop Height (cm),Bounce 1 (cm),Bounce 2 (cm)\n50,28,29\n100,56,57\n": {
        "rebound_height": "Bounce * (cm)"
    },
    "h0,h1,h2,h3\n1,.56,.31,.17\n1.5,.8,.45,.25\n": {"peak_height": "h*"},
    "T1 (s),T2 (s),T3 (s)\n.55,.42,.32\n.5,.38,.29\n": {"bounce_interval": "T* (s)"},
    "t1 (s),t2 (s),t3 (s)\n0.1,.65,1.07\n.2,.70,1.08\n": {"bounce_time": "t* (s)"},
    # The header of phyphox's "(In)elastic collision", whose height 0 is made up; without energies.
    '"Bounce 0 (s)","Height 0 (m)","Bounce 1 (s)","Height 1 (m)","Bounce 2 (s)","Height 2 (m)",'
    '"Bounce 3 (s)","Height 3 (m)"\n'
    "1.0312E0,6.49E-1,1.5833E0,3.74E-1,1.9987E0,2.12E-1,2.3168E0,1.24E-1\n": {
        "bounce_time": "Bounce * (s)"
    },
    "Impact speed (m/s),Rebound speed 1 (m/s),Rebound speed 2 (m/s)\n5,4,4.1\n6,4.6,4.7\n": {
        "v_y1": "Impact speed (m/s)",
        "v_y2": "Rebound speed * (m/s)",
    },
    "v_y1,e1,e2,e3\n5,.8,.81,.79\n6,.78,.77,.79\n": {"cor": "e*"},
}


@pytest.mark.parametrize("text", PROPOSED)
def test_what_is_proposed_can_be_read(text, tmp_path):
    file = tmp_path / "repeats.csv"
    file.write_text(text)
    with pytest.raises(InputError) as refusal:
        fitball.load_table(file)
    option = refusal.value.faults[0].message.split('--columns "')[1].split('"')[0]
    assert option == ",".join(f"{ours}={theirs}" for ours, theirs in PROPOSED[text].items())
    table = fitball.load_table(file, columns=PROPOSED[text])
    assert "not-read" not in notes_of(table)
    assert [*table.values] == ["v_y1", "v_y2"]
    assert len(table) >= 2


@pytest.mark.parametrize(
    ("first", "second"),
    [("v_1 x", "v_1 y"), ("v_2 3", "v_2 4"), ("Temp 1", "Temp 2"), ("omega_2 c", "omega_2 d")],
)
def test_what_is_no_repeat_is_left_alone(first, second):
    columns = {"v_y1": ["5", "6"], "v_y2": ["4", "4.5"], first: ["1", "2"], second: ["1", "2"]}
    cells = read_cells(columns, Naming({}).worth)
    assert in_rows(cells, Naming({})) is cells


def test_a_single_mark_is_a_slip():
    with pytest.raises(InputError) as refusal:
        fitball.load_table({"v_y1": [5.0, 6.0], "v_y2 a": [4.0, 4.5]})
    assert refusal.value.faults[0].code == "misspelt-column"


@pytest.mark.parametrize("name", ["T", "Maß "])
def test_faults_of_repeats_name_the_columns_as_the_file_does(name):
    rows = {"H": [2.0, 5.5], f"{name}0": [1.06, 2.17], f"{name}1": [0.95, 1.53]}
    columns = {"drop_height": "H", "bounce_interval": f"{name}*"}
    with pytest.raises(InputError) as refused:
        fitball.load_table(rows, columns=columns)
    (fault,) = refused.value.faults
    assert fault.row == 2
    assert fault.column in (f"{name}*", f"{name}*".casefold())
    assert fault.column == "T*" or name != "T"
