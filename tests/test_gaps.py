"""Cells of a table in which nothing was measured."""

from __future__ import annotations

from pathlib import Path

import misread
import numpy as np
import pandas
import pytest

from fitball.data.misreading import doubt_of
from fitball.data.read import load_table
from fitball.data.table import ImpactTable
from fitball.errors import TableError

HEADER = "v_x1,v_y1,omega_1,v_x2,v_y2,omega_2"
ROWS = ["15.6,4.8,-5,11.1,4.2,239", "14.0,6.1,0,9.5,5.0,250", "13.1,7.7,3,8.2,6.1,260", "12.2,8.9,1,8.0,7.0,255"]


def read(tmp_path: Path, *lines: str, **options: bool) -> ImpactTable:
    place = tmp_path / "t.csv"
    place.write_text("\n".join(lines) + "\n")
    return load_table(place, **options)


def told(table: ImpactTable) -> str:
    return "\n".join(map(str, table.notices))


@pytest.mark.parametrize("cell", ["", "nan", "NaN", "NA", "n/a", "-", "null", " "])
def test_a_rebound_cell_without_a_number_is_a_gap(tmp_path: Path, cell: str) -> None:
    table = read(tmp_path, HEADER, *ROWS[:2], f"13.1,7.7,3,8.2,6.1,{cell}", ROWS[3])
    spin = table.measurement("omega_2")
    assert spin is not None and not spin.complete
    assert spin.measured.tolist() == [True, True, False, True]
    assert np.isnan(spin.values[2]) and spin.values[3] == 255.0
    assert table.ids == ("1", "2", "3", "4")
    assert "omega_2 is missing in 1 of 4 rows, first in row 3" in told(table)


def test_parquet_has_gaps_too(tmp_path: Path) -> None:
    frame = pandas.DataFrame(
        {"v_y1": [5.0, 6.0, 7.0], "v_y2": [4.0, np.nan, 5.5], "contact_time": [5e-3, 5e-3, None]}
    )
    frame.to_parquet(tmp_path / "t.parquet")
    table = load_table(tmp_path / "t.parquet")
    assert [item.measured.tolist() for item in table.measurements] == [[True, False, True], [True, True, False]]


def test_an_empty_column_is_as_if_it_were_not_there(tmp_path: Path) -> None:
    without = read(tmp_path, HEADER, *ROWS[:3])
    table = read(tmp_path, HEADER + ",contact_time,contact_time_sd,v_x2_sd", *(row + ",,0.1," for row in ROWS[:3]))
    assert [item.name for item in table.measurements] == [item.name for item in without.measurements]
    assert all(item.sd is None for item in table.measurements)
    assert "column contact_time" in told(table) and "column v_x2_sd" in told(table)
    assert "omega_1" in told(read(tmp_path, HEADER, *(row.replace("5,", ",", 0) for row in
                                                                       ["15.6,4.8,,11.1,4.2,239"] * 2)))  # fmt: skip


def test_rows_without_incident_state_or_rebound_are_left_out(tmp_path: Path) -> None:
    table = read(tmp_path, HEADER, ROWS[0], "14,,0,9,5,250", ROWS[2], "12,8,NA,8,7,250", "12,8,0,,-,", ROWS[3])
    assert table.ids == ("1", "3", "6")
    assert len(table) == 3 and all(item.complete for item in table.measurements)
    assert "row 2: ignored, since v_y1 of the incident ball" in told(table)
    assert "row 4: ignored, since omega_1 of the incident ball" in told(table)
    assert "row 5: ignored, since the rebound was not measured" in told(table)
    with pytest.raises(TableError, match="1 of 3 rows are left; expected 2: row 1: ignored"):
        read(tmp_path, HEADER, "14,,0,9,5,250", ROWS[0], "1,5,0,,,")
    # To predict an impact its rebound need not be known.
    assert len(read(tmp_path, HEADER, "12,8,0,,-,", "12,8,0,1,,", rebound=False)) == 2


def test_gaps_beside_standard_deviations(tmp_path: Path) -> None:
    table = read(tmp_path, "v_y1,v_y2,v_y2_sd,contact_time", "5,4,0.1,0.005", "6,,,0.005", "7,,0.2,0.005", "8,6,0.3,")
    rebound = table.measurement("v_y2")
    assert rebound is not None and rebound.sd is not None
    assert np.isnan(rebound.sd).tolist() == [False, True, True, False]
    with pytest.raises(TableError, match=r"row 2 \(line 3\), column 'v_y2_sd': no standard deviation for v_y2"):
        read(tmp_path, "v_y1,v_y2,v_y2_sd", "5,4,0.1", "6,5,")


def test_missing_components_follow_from_speed_and_angle(tmp_path: Path) -> None:
    header = "v_x1,v_y1,v_x2,v_y2,v_2,theta_2"
    table = read(tmp_path, header, "15,5,9,4,,", "15,5,,,10,30", "15,5,,4.1,10,", "15,5,9,4,,24")
    along, up = (table.measurement(name) for name in ("v_x2", "v_y2"))
    assert along is not None and up is not None
    assert along.values == pytest.approx([9, 10 * np.cos(np.pi / 6), np.nan, 9], nan_ok=True)
    assert up.values == pytest.approx([4, 5, 4.1, 4])
    assert "row 2: v_x2 is missing and computed from v_2 and theta_2" in told(table)
    stated = read(tmp_path, f"{header},v_x2_sd", "15,5,9,4,,,0.1", "15,5,,,10,30,", "15,5,9,4,,24,0.1")
    along, up = (stated.measurement(name) for name in ("v_x2", "v_y2"))
    assert along is not None and np.isnan(along.values[1]) and up is not None and up.values[1] == pytest.approx(5.0)


def test_a_gap_is_no_energy(tmp_path: Path) -> None:
    """A rebound of which only the spin is known may be in the table; one that gains energy may not."""
    table = read(tmp_path, HEADER, *ROWS[:3], "5,5,0,,,200")
    assert np.isnan(table.measurements[0].values[3])
    with pytest.raises(TableError, match="more energy"):
        read(tmp_path, HEADER, *ROWS[:3], "5,5,0,90,,200")


def test_a_misread_table_with_gaps_is_doubted():
    """Whether some rows are complete or none is; a table that was read well is not."""
    for never in (False, True):
        found = alarms = 0
        for seed in range(4):
            columns, ball = misread.table("wide", seed)
            gaps = np.random.default_rng(seed).random(30) < 0.4
            wrong = misread.MISREADINGS["rpm"][0](columns)
            doubts = []
            for made in (columns, wrong):
                gappy = {name: values.copy() for name, values in made.items()}
                gappy["omega_2"][gaps] = np.nan
                if never:
                    gappy["v_y2"][~gaps] = np.nan
                units = {name: "rad/s" if name.startswith("omega") else "m/s" for name in gappy}
                doubts.append(doubt_of(gappy, units, ball))
            alarms += doubts[0] is not None
            found += doubts[1] is not None
        assert alarms == 0 and found >= 3, (never, alarms, found)
