"""Rows that repeat to the last digit: copies are named and refused, what chance explains is not."""

from __future__ import annotations

from pathlib import Path

import misread
import numpy as np
import pandas
import pytest

import fitball
from fitball.api import check
from fitball.data.bundled import bundled_names
from fitball.data.laws import repeats_of
from fitball.data.scene import Scene
from fitball.data.tables import trusted_table
from fitball.errors import ReadingError, TableError


def frame(design: str = "wide", seed: int = 3, digits: int = 3) -> pandas.DataFrame:
    return pandas.DataFrame({name: values.round(digits) for name, values in misread.table(design, seed)[0].items()})


def said(rows: pandas.DataFrame) -> tuple[str | None, str | None]:
    return repeats_of(fitball.load_table(rows), fitball.Ball())


@pytest.mark.parametrize("form", [dict, misread.polar])
@pytest.mark.parametrize("copied", [[0], [0, 1, 2] * 4])
def test_copies_are_named_with_their_rows(form, copied) -> None:
    rows = pandas.DataFrame({name: np.round(values, 3) for name, values in form(misread.table("wide", 3)[0]).items()})
    if "theta_1" in rows:
        rows[["theta_1", "theta_2"]] = np.degrees(rows[["theta_1", "theta_2"]])
    rows = rows.round(2)
    assert said(rows) == (None, None)
    again = pandas.concat([rows, rows.iloc[copied]], ignore_index=True)
    copies, near = said(again)
    assert copies is not None and near is None
    assert f"{len(copied)} of {len(again)} rows repeat others" in copies and "Rows 1, 31" in copies


def test_ids_do_not_count_and_labels_do() -> None:
    rows = pandas.concat([frame()] * 2, ignore_index=True)
    assert said(rows.assign(id=range(60)))[0] is not None
    assert said(rows.assign(surface=["clay"] * 30 + ["hard"] * 30)) == (None, None)
    assert said(rows.assign(temperature=range(60)))[0] is not None


def test_copies_are_refused_unless_they_are_taken_as_read(tmp_path: Path) -> None:
    place = tmp_path / "t.csv"
    pandas.concat([frame()] * 2).to_csv(place, index=False)
    found = check(place)
    assert not found.ok and "rows are copies of others" in str(found) and "as_read=True" in str(found)
    with pytest.raises(ReadingError, match="30 of 60 rows repeat others"):
        trusted_table([place], Scene())
    table, notes = trusted_table([place], Scene(), as_read=True)
    assert len(table) == 60 and any("(as_read)" in note for note in notes)


def test_copies_between_tables_are_refused_whatever_their_labels(tmp_path: Path) -> None:
    rows = frame()
    own, again = tmp_path / "own.csv", tmp_path / "again.csv"
    rows.to_csv(own, index=False)
    part = pandas.concat([rows.iloc[:8], frame(seed=4)]).assign(surface="clay")
    part.to_csv(again, index=False)
    with pytest.raises(ReadingError, match=r"8 of 68 rows repeat others .* Rows own:1, again:1; own:2, again:2; "):
        trusted_table([own, again], Scene())
    table, notes = trusted_table([own, again], Scene(), as_read=True)
    assert len(table) == 68 and any("all tables are used" in note for note in notes)
    with pandas.ExcelWriter(tmp_path / "book.xlsx") as writer:
        for seed, sheet in enumerate(("clay", "hard")):
            frame(seed=seed).to_excel(writer, sheet_name=sheet, index=False)
    assert len(trusted_table([f"{tmp_path / 'book.xlsx'}#{sheet}" for sheet in ("clay", "hard")], Scene())[0]) == 60


def test_a_drop_test_in_two_files_repeats_by_chance_and_its_copy_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    places = [tmp_path / f"{name}.csv" for name in ("new", "used", "copy")]
    for place, mean in zip(places, (140.0, 140.4), strict=False):
        heights = np.round(mean + 0.8 * rng.standard_normal(18), 1)
        pandas.DataFrame({"drop_height [cm]": 254.0, "rebound_height [cm]": heights}).to_csv(place, index=False)
    places[2].write_bytes(places[0].read_bytes())
    assert len(trusted_table(places[:2], Scene())[0]) == 36
    with pytest.raises(ReadingError, match="copy has the content of new: leave out one of them"):
        trusted_table(places, Scene())


def test_a_drop_test_read_to_a_centimetre_repeats_without_fault() -> None:
    """Heights scatter by some units, by one, and by less than one; few rows and many."""
    rng = np.random.default_rng(0)
    for scatter in (3.0, 1.0, 0.3, 0.05):
        for count in (6, 30, 300):
            heights = np.rint(139.5 + scatter * rng.normal(size=count))
            rows = pandas.DataFrame({"drop_height [cm]": np.full(count, 254.0), "rebound_height [cm]": heights})
            assert said(rows) == (None, None), (scatter, count)


def test_coarse_and_long_tables_repeat_by_chance() -> None:
    """A ball machine with few settings, printed coarsely: repeats are many, and no copies. Independent draws, so that
    any alarm is false.
    """
    rng = np.random.default_rng(1)
    for count, digits in ((40, 0), (400, 0), (8000, 0), (8000, 1)):
        setting = rng.integers(0, 8, count)
        v_x, v_y = 12.0 + setting, 6.0 + setting % 3
        rows = pandas.DataFrame(
            {
                "v_x1": v_x, "v_y1": v_y, "v_x2": (0.6 * v_x + 0.3 * rng.normal(size=count)).round(digits),
                "v_y2": (0.75 * v_y + 0.3 * rng.normal(size=count)).round(digits),
            }
        )  # fmt: skip
        assert rows.duplicated().any()
        assert said(rows) == (None, None), (count, digits)


@pytest.mark.parametrize("name", bundled_names())
def test_bundled_tables_have_no_copies(name: str) -> None:
    assert repeats_of(fitball.load_table(name), fitball.Ball()) == (None, None)


def test_good_tables_have_no_copies() -> None:
    for design in ("wide", "all grip", "one angle", "without spin", "backspin", "steep", "dropped", "slow"):
        for digits in (1, 3):
            assert said(frame(design, 0, digits)) == (None, None), (design, digits)


def test_rows_that_are_nearly_the_same_are_a_note() -> None:
    rows = frame()
    again = pandas.concat([rows, (rows.iloc[:5] + 0.001).round(3)], ignore_index=True)
    copies, near = said(again)
    assert copies is None and near is not None and "the same impacts" in near
    assert check(again).ok


@pytest.mark.filterwarnings("error")
def test_digits_that_no_double_has_are_no_step(tmp_path: Path) -> None:
    """A cell of 400 digits: its last one is below the smallest number there is."""
    long = f"0.75{'1' * 400}"
    rows = [f"{2.0 + 0.1 * k:.1f},{long if k == 3 else f'{1.2 + 0.06 * k:.2f}'}" for k in range(8)]
    place = tmp_path / "drops.csv"
    place.write_text("\n".join(("drop_height,rebound_height", *rows)) + "\n", encoding="utf-8")
    assert repeats_of(fitball.load_table(place), fitball.Ball()) == (None, None)


def test_tables_that_cannot_be_joined_are_named_as_such() -> None:
    """Not as copies, for which they have no column in common."""
    court = pandas.DataFrame({"v_1": [20.0, 21], "theta_1": [20.0, 30], "v_x2": [12.0, 11]})
    with pytest.raises(TableError, match="DataFrame"):
        trusted_table([frame()[["v_y1", "v_y2"]], court], Scene())
