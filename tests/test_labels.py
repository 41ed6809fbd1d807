"""Label columns: what they name, how their labels are spelled, and what is fitted to each level by default."""

from __future__ import annotations

from difflib import SequenceMatcher
from pathlib import Path

import pytest

import fitball
from fitball.api.calibrating import pose
from fitball.data import labels
from fitball.data.labels import Role, grouping, labelled, role_of
from fitball.data.read import load_table
from fitball.errors import TableError
from fitball.inference.problem.problem import Choices

HEAD = "v_x1,v_y1,omega_1,v_x2,v_y2,omega_2"


def rows(count: int) -> list[str]:
    """Plausible impacts, each another."""
    return [
        f"{12 + 0.3 * k:.2f},{6 + 0.2 * k:.2f},0,{8 + 0.2 * k:.2f},{4.6 + 0.13 * k:.2f},{250 + k}"
        for k in range(count)
    ]


def table_with(folder: Path, **named: str) -> Path:
    """A table with these label columns, a letter or a word for each row, separated by blanks."""
    cells = {name: text.split() for name, text in named.items()}
    lines = rows(len(next(iter(cells.values()))))
    body = [",".join([line, *(cells[name][k] for name in cells)]) for k, line in enumerate(lines)]
    path = folder / "table.csv"
    path.write_text("\n".join([",".join([HEAD, *cells]), *body]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("name", "role"),
    [("surface", Role.SURFACE), ("Court", Role.SURFACE), ("Ball type", Role.BALL), ("Position", Role.PLACE),
     ("location", Role.PLACE), ("Session", Role.SESSION), ("group", None), ("Remarks", None)],
)  # fmt: skip
def test_names_say_what_labels_name(name, role):
    assert role_of(name) is role


def test_spellings_of_a_label_are_one_and_near_ones_stay_apart(tmp_path):
    table = load_table(table_with(tmp_path, court="clay Clay clay CLAY hard Hardd hard hard hard hard"))
    assert set(table.labels["court"]) == {"clay", "hard", "Hardd"}
    notes = " ".join(str(notice) for notice in table.notices)
    assert "'Clay' (1)" in notes and "'CLAY' (1)" in notes
    assert "'Hardd' (row 6)" in notes and "'hard'" in notes
    accents = load_table(table_with(tmp_path, surface="bêton béton béton beton hard hard hard"))
    assert set(accents.labels["surface"]) == {"béton", "hard"}
    # Numbers in a label name what differs.
    numbered = load_table(table_with(tmp_path, court="court1 court1 court1 court2 court2 court2"))
    assert "is like" not in " ".join(map(str, numbered.notices))


def test_sessions_are_labels_of_their_own(tmp_path):
    """They have one spelling each, and nothing is fitted to them by default."""
    path = table_with(tmp_path, Session="May May may May June June June June June June June June")
    table = load_table(path)
    assert table.labels["session"] == ("May",) * 4 + ("June",) * 8
    assert any("column session: 2 sessions: May (4 rows), June (8)" in remark for remark in table.remarks)
    assert not pose(path, Choices(model="grip-slip")).pooling


def test_levels_divide_where_two_have_three_rows_and_all_rows_have_one(tmp_path):
    found = {item.column: item for item in labelled(load_table(table_with(
        tmp_path, surface="a a a b b b b", ball="x x y y z z w", place="1 1 1 2 2 2 2",
    )).labels)}  # fmt: skip
    assert found["surface"].divides and dict(found["surface"].counts) == {"a": 3, "b": 4}
    assert not found["ball"].divides
    assert [item.column for item in grouping(load_table(tmp_path / "table.csv"))] == ["surface", "place"]


def test_what_belongs_to_surfaces_balls_and_places_is_fitted_to_each(tmp_path):
    def pooled(path, model="grip-slip", **choices):
        problem = pose(path, Choices(model=model, **choices))
        return {item.parameter: item.column for item in problem.pooling}

    surfaces = table_with(tmp_path, Court="a a a a a b b b b b")
    assert pooled(surfaces) == {"mu": "Court", "cor_10": "Court"}
    assert pooled(surfaces, pool={"all": "none"}) == {}
    assert pooled(surfaces, pool={"mu": "none"}) == {"cor_10": "Court"}
    assert pooled(surfaces, fix={"cor_10": 0.75}) == {"mu": "Court"}
    assert pooled(surfaces, offsets="Court") == {}
    assert pooled(table_with(tmp_path, ball="a a a a a b b b b b")) == {"cor_10": "ball", "offset": "ball"}
    assert pooled(table_with(tmp_path, ball="a a a a a b b b b b"), "two-mass") == {
        "cor_10": "ball",
        "eps_10": "ball",
    }
    assert pooled(table_with(tmp_path, place="a a a a a b b b b b")) == {"mu": "place"}
    both = table_with(tmp_path, surface="a a a a a b b b b b", ball="x y x y x y x y x y")
    assert pooled(both) == {"mu": "surface", "cor_10": "surface", "offset": "ball"}
    # What names nothing is scored and fitted to all.
    two = "x x x x x y y y y y"
    assert pooled(table_with(tmp_path, group=two, operator=two)) == {}
    assert {item.column for item in grouping(load_table(tmp_path / "table.csv"))} == {"group", "operator"}
    # Bundled tables have one surface each.
    assert pooled("wang_all.csv") == {}
    # Four rows of each are too few for a fit to each, and are scored.
    few = table_with(tmp_path, Court="a a a a b b b b")
    assert pooled(few) == {} and len(grouping(load_table(few))) == 1
    assert any("fewer than two have 5 rows" in note for note in pose(few, Choices(model="grip-slip")).notes)


def test_the_notes_say_what_is_fitted_to_each(tmp_path):
    problem = pose(
        table_with(tmp_path, surface="clay clay clay clay clay hard hard hard hard hard"), Choices(model="grip-slip")
    )
    notes = [str(note) for note in (*problem.table.remarks, *problem.notes)]
    assert any("clay (5 rows), hard (5)" in note for note in notes)
    assert any("mu, cor_10 fitted to each" in note for note in notes)
    missing = load_table(table_with(tmp_path, surface='clay clay clay hard hard hard ""'))
    assert any("1 row without a surface (row 7)" in str(notice) for notice in missing.notices)
    assert grouping(missing) == ()


def test_one_round_of_check_names_the_faults_below_unnamed_columns(tmp_path):
    path = tmp_path / "sheet.csv"
    lines = ["Speed in [m/s],Angle in [deg],Speed out [m/s],Angle out [deg]"]
    lines += ["20,30,14,33", "21,31,1o,34", "22,32,15,35"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    with pytest.raises(TableError) as found:
        load_table(path)
    places = [(fault.row, fault.column) for fault in found.value.faults]
    assert (2, "Speed out") in places and any(row is None for row, _ in places)
    columns = {"v_1": "Speed in", "theta_1": "Angle in", "v_2": "Speed out", "theta_2": "Angle out"}
    path.write_text("\n".join(lines).replace("1o", "15") + "\n", encoding="utf-8")
    assert len(fitball.load_table(path, columns=columns)) == 3


def test_a_drop_test_is_offered_its_heights(tmp_path):
    path = tmp_path / "drops.csv"
    path.write_text("Sample,Drop (cm),Rebound (cm)\n1,254,139\n1,254,140\n2,254,141\n", encoding="utf-8")
    with pytest.raises(TableError, match="'drop_height': 'Drop', 'rebound_height': 'Rebound'"):
        load_table(path)


def test_a_long_table_whose_rows_all_have_a_name_is_read_in_linear_time(monkeypatch, tmp_path):
    """Labels are compared in pairs only where they are few: counted, not timed."""
    compared = []

    class Counting(SequenceMatcher):
        def __init__(self, *given):
            compared.append(given)
            super().__init__(*given)

    monkeypatch.setattr(labels, "SequenceMatcher", Counting)
    names = " ".join(f"ball_{k}" for k in range(300))
    table = load_table(table_with(tmp_path, ball=names, remark=names))
    assert compared == [] and grouping(table) == ()
    load_table(table_with(tmp_path, ball="hard hard hard hardd hardd hardd"))
    assert len(compared) == 1
