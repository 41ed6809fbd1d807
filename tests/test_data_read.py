"""Good tables: what is read, in which units, what counts and what is only compared."""

import dataclasses
import pickle
from hashlib import sha256
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from written import read

from fitball.data.read import load_table
from fitball.data.units import UNITS, Dimension, symbols


def test_units_convert_once(tmp_path: Path) -> None:
    table = read(
        tmp_path,
        "v_1 [km/h],theta_1 [deg],omega_1 [rpm],v_2 [mph],theta_2 [rad],omega_2 [rev/s],contact_time [ms]\n"
        "72,30,60,30,0.6,10,5\n54,45,-120,25,0.8,20,4.5\n",
    )
    np.testing.assert_allclose(table.impacts.v_x1, [20 * 3**0.5 / 2, 15 / 2**0.5], rtol=1e-15)
    np.testing.assert_allclose(table.impacts.v_y1, [10, 15 / 2**0.5], rtol=1e-15)
    np.testing.assert_allclose(table.impacts.omega_1, [2 * pi, -4 * pi], rtol=1e-15)
    got = {item.name: item.values for item in table.measurements}
    assert set(got) == {"omega_2", "v_2", "theta_2", "contact_time"}
    np.testing.assert_allclose(got["v_2"], [30 * 0.44704, 25 * 0.44704], rtol=1e-15)
    np.testing.assert_allclose(got["omega_2"], [20 * pi, 40 * pi], rtol=1e-15)
    np.testing.assert_array_equal(got["theta_2"], [0.6, 0.8])
    np.testing.assert_array_equal(got["contact_time"], [0.005, 0.0045])
    assert table.units["v_1"] == "km/h" and table.units["contact_time"] == "ms"
    assert table.incident_columns == ("v_x1", "v_y1", "omega_1")
    assert table.has_tangential and table.has_spin


@given(
    st.sampled_from(symbols(Dimension.SPEED)),
    st.sampled_from(symbols(Dimension.SPIN)),
    st.lists(st.tuples(st.floats(0.1, 30), st.floats(5, 30), st.floats(-300, 300)), min_size=2, max_size=5),
)
def test_the_unit_of_the_file_does_not_matter(
    tmp_path_factory: pytest.TempPathFactory, speed: str, spin: str, rows: list[tuple[float, float, float]]
) -> None:
    lines = [f"v_x1 [{speed}],v_y1 [{speed}],omega_1 [{spin}],v_y2 [{speed}]"]
    v, w = UNITS[speed].from_si, UNITS[spin].from_si
    lines += [f"{v(x)!r},{v(y)!r},{w(omega)!r},{v(0.7 * y)!r}" for x, y, omega in rows]
    path = tmp_path_factory.mktemp("units") / "t.csv"
    path.write_text("\n".join(lines))
    table = load_table(path)
    expected = np.array(rows).T
    np.testing.assert_allclose(table.impacts.v_x1, expected[0], rtol=1e-15)
    np.testing.assert_allclose(table.impacts.v_y1, expected[1], rtol=1e-15)
    # a spin of 1e-310 loses digits in another unit, hence the absolute part
    np.testing.assert_allclose(table.impacts.omega_1, expected[2], rtol=1e-15, atol=1e-300)
    np.testing.assert_allclose(table.measurements[0].values, 0.7 * expected[1], rtol=1e-15)


def test_angles_without_unit_are_degrees(tmp_path: Path) -> None:
    table = read(tmp_path, "v_x1,v_y1,v_2,theta_2\n10,5,8,30\n10,6,8,35\n")
    angle = table.measurement("theta_2")
    assert angle is not None
    np.testing.assert_allclose(angle.values, [radians(30), radians(35)], rtol=1e-15)
    assert table.units["theta_2"] == "deg"


def test_standard_deviations(tmp_path: Path) -> None:
    table = read(
        tmp_path,
        "v_x1,v_x1_sd [cm/s],v_y1,v_2,v_2_sd,theta_2,theta_2_sd,omega_1,omega_1_sd [rpm]\n"
        "10,20,5,8,0.1,30,2,0,30\n10,30,6,8,0.2,35,3,0,60\n",
    )
    sds = {item.name: item.sd for item in table.measurements if item.sd is not None}
    np.testing.assert_array_equal(sds["v_2"], [0.1, 0.2])
    np.testing.assert_allclose(sds["theta_2"], [radians(2), radians(3)], rtol=1e-15)
    np.testing.assert_array_equal(table.incident_sd["v_x1"], [0.2, 0.3])
    np.testing.assert_allclose(table.incident_sd["omega_1"], [pi, 2 * pi], rtol=1e-15)
    assert set(table.incident_sd) == {"v_x1", "omega_1"}
    assert any("v_x1_sd was read in cm/s" in str(notice) for notice in table.notices)
    # An sd of a rebound column that others say already takes no part, as one of an incident column takes none.
    (notice,) = read(tmp_path, "v_x1,v_y1,v_x2,v_y2,v_2,v_2_sd\n9,5,3,4,5,0.1\n9,5,6,4,7.21,0.1\n").notices
    assert notice.message == "v_2_sd is not used: v_x2 and v_y2 are"


def test_incident_sd_of_speed_and_angle_against_random_draws(tmp_path: Path) -> None:
    table = read(tmp_path, "v_1,v_1_sd,theta_1,theta_1_sd,v_y2\n17,0.2,25,0.8,5\n18,0.3,60,0.5,10\n")
    rng = np.random.default_rng(7)
    draws = 400_000
    speed = np.array([17, 18]) + np.array([0.2, 0.3]) * rng.standard_normal((draws, 2))
    angle = np.radians(np.array([25, 60]) + np.array([0.8, 0.5]) * rng.standard_normal((draws, 2)))
    # 1 % is nine standard errors of an sd from 400,000 draws.
    np.testing.assert_allclose(table.incident_sd["v_x1"], (speed * np.cos(angle)).std(axis=0), rtol=0.01)
    np.testing.assert_allclose(table.incident_sd["v_y1"], (speed * np.sin(angle)).std(axis=0), rtol=0.01)


@pytest.mark.parametrize("name", ["v_y2", "theta_2"])
def test_a_rebound_counted_downward_is_turned_once(tmp_path: Path, name: str) -> None:
    values = {"v_x2": ("7", "8"), "v_2": ("8", "9"), "v_y2": ("-4", "-5"), "theta_2": ("-30", "-35")}
    other = "v_x2" if name == "v_y2" else "v_2"
    rows = "".join(f"10,6,{values[other][i]},{values[name][i]}\n" for i in (0, 1))
    table = read(tmp_path, f"v_x1,v_y1,{other},{name}\n{rows}")
    measured = table.measurement(name)
    assert measured is not None and (measured.values > 0).all()
    assert [notice.columns for notice in table.notices] == [(name,)]
    assert "negative in every row" in table.notices[0].message


def test_a_negative_incident_angle_is_turned_once(tmp_path: Path) -> None:
    table = read(tmp_path, "v_1,theta_1,v_y2\n10,-30,4\n10,-40,5\n")
    np.testing.assert_allclose(table.impacts.v_y1, 10 * np.sin(np.radians([30, 40])), rtol=1e-15)
    assert table.notices[0].columns == ("theta_1",)


@pytest.mark.parametrize(
    ("columns", "counted", "redundant"),
    [
        ("v_x2 v_y2 v_2 theta_2", "v_x2 v_y2", "v_2 theta_2"),
        ("v_x2 v_y2 v_2", "v_x2 v_y2", "v_2"),
        ("v_x2 v_2 theta_2", "v_2 theta_2", "v_x2"),
        ("v_y2 v_2 theta_2", "v_2 theta_2", "v_y2"),
        ("v_2 theta_2", "v_2 theta_2", ""),
        ("v_x2 theta_2", "v_x2 theta_2", ""),
        ("v_y2 v_2", "v_y2 v_2", ""),
        ("v_y2 omega_2", "v_y2 omega_2", ""),
        ("v_2", "v_2", ""),
        ("contact_time", "contact_time", ""),
    ],
)
def test_each_quantity_counts_once(tmp_path: Path, columns: str, counted: str, redundant: str) -> None:
    cells = {"v_x2": "6", "v_y2": "4.5", "v_2": "7.5", "theta_2": "36.87", "omega_2": "100", "contact_time": "0.005"}
    names = columns.split()
    row = ",".join(cells[name] for name in names)
    table = read(tmp_path, f"v_x1,v_y1,omega_1,{','.join(names)}\n10,6,0,{row}\n10,6,0,{row}\n")
    assert {item.name for item in table.measurements} == set(counted.split())
    assert {item.name for item in table.redundant} == set(redundant.split())
    assert table.notices == ()


def test_exactly_the_rows_of_wang_that_contradict_themselves_are_flagged() -> None:
    expected = {
        (1, ("v_2", "v_x2", "v_y2")): ("11.73 m/s", "11.87 m/s"),
        (2, ("theta_1", "v_x1", "v_y1")): ("22.85 deg", "23.25 deg"),
        (2, ("theta_2", "v_x2", "v_y2")): ("32.39 deg", "33.09 deg"),
    }
    for name in ("wang_zero_spin", "wang_all"):
        notices = load_table(name).notices
        assert {(notice.row, notice.columns) for notice in notices} == set(expected)
        for notice in notices:
            for value in expected[notice.row, notice.columns]:  # type: ignore[index]
                assert value in notice.message
    assert load_table("wang_topspin").notices == ()
    assert load_table("wang_backspin").notices == ()


def test_redundant_values_are_kept_as_printed() -> None:
    table = load_table("wang_zero_spin")
    by_name = {item.name: item.values for item in table.redundant}
    assert by_name["v_2"][0] == 11.73
    assert by_name["theta_2"][1] == pytest.approx(radians(32.39), rel=1e-15)


def test_coarse_digits_excuse_a_difference(tmp_path: Path) -> None:
    fine = read(tmp_path, "v_x1,v_y1,v_x2,v_y2,v_2\n12,7,8.49,5.49,10.30\n12,7,8.00,5.00,9.43\n")
    assert [notice.row for notice in fine.notices] == [1]
    coarse = read(tmp_path, "v_x1,v_y1,v_x2,v_y2,v_2\n12,7,8,5,10\n12,7,8,5,9\n")
    assert coarse.notices == ()


def test_dropped_zeros_do_not_make_a_column_coarse(tmp_path: Path) -> None:
    table = read(tmp_path, "v_x1,v_y1,v_x2,v_y2,v_2\n12,7,8,6,10.20\n12,7,8.25,5.25,9.78\n")
    assert [notice.row for notice in table.notices] == [1]


def test_a_drop_test(tmp_path: Path) -> None:
    table = read(tmp_path, "v_y1,v_y2\n4,3\n7,5\n")
    assert table.incident_columns == ("v_y1",)
    assert not table.has_tangential and not table.has_spin
    np.testing.assert_array_equal(table.impacts.v_x1, [0, 0])
    np.testing.assert_array_equal(table.impacts.cor, [0.75, 5 / 7])


def test_rebound_spin_without_incident_spin_says_what_is_assumed(tmp_path: Path) -> None:
    table = read(tmp_path, "v_x1,v_y1,omega_2\n10,5,100\n10,6,120\n")
    assert "omega_1" in str(table.notices[0])
    assert table.impacts.cor is None


def test_a_ball_may_bounce_back(tmp_path: Path) -> None:
    table = read(
        tmp_path, "v_x1,v_y1,omega_1,v_x2,v_y2,v_2,theta_2\n3,10,-500,-3,4,5,126.87\n3,10,-500,-3,4,5,126.87\n"
    )
    assert table.notices == ()


def test_strong_topspin_may_speed_a_ball_up(tmp_path: Path) -> None:
    table = read(tmp_path, "v_x1,v_y1,omega_1,v_x2,v_y2,omega_2\n10,2,600,12,1.5,400\n10,2,600,12,1.5,400\n")
    assert len(table) == 2


@pytest.mark.parametrize(
    "row",
    [
        # 72 m^2/s^2 lost in flight; the spin gained is worth 51 to a solid ball, 94 to a thin shell
        "12,5,0,9,4,346",
        # 42 m^2/s^2 gained in flight; the spin lost is worth 55 to a thin shell, 30 to a solid ball
        "10,2,600,12,1.5,538",
    ],
)
def test_the_moment_of_inertia_favours_the_table(tmp_path: Path, row: str) -> None:
    assert len(read(tmp_path, f"v_x1,v_y1,omega_1,v_x2,v_y2,omega_2\n{row}\n{row}\n")) == 2


def test_extra_columns_are_kept_and_named(tmp_path: Path) -> None:
    table = read(tmp_path, ",id,v_y1,v_y2,temperature [C],surface\n0,a,4,3,20,clay\n1,b,5,4,21,grass\n")
    assert table.labels["temperature"] == ("20", "21")
    assert table.labels["surface"] == ("clay", "grass")
    assert table.ids == ("a", "b")
    # A number beside a name is a column of its own.
    assert read(tmp_path, "no,id,v_y1,v_y2\n7,a,4,3\n8,b,5,4\n").ids == ("a", "b")
    (notice,) = table.notices
    assert "temperature" in notice.message and "column 1" in notice.message


def test_an_own_column_may_resemble_one_that_is_there(tmp_path: Path) -> None:
    table = read(tmp_path, "v_1,theta_1,theta_3,v_2,theta_2\n5,53.13,9,3,50\n5,53.13,9,3,50\n")
    assert table.labels["theta_3"] == ("9", "9")


def test_byte_order_mark_quotes_comments_blank_lines_and_old_line_ends(tmp_path: Path) -> None:
    plain = "v_y1,v_y2\n4,3\n7,5\n"
    forms = {
        "bom": b"\xef\xbb\xbf" + plain.encode(),
        "crlf": plain.replace("\n", "\r\n").encode(),
        "cr": plain.replace("\n", "\r").encode(),
        "comments": b"# measured on clay\n\nv_y1,v_y2\n# first\n4,3\n\n7,5",
        "quotes": b'"v_y1", "v_y2"\n"4", "3"\n 7 ,"5"\n',
        "note": b'v_y1,v_y2,note\n4,3,"two\n# lines"\n7,5,x\n',
    }
    for form, data in forms.items():
        table = read(tmp_path, data)
        np.testing.assert_array_equal(table.impacts.v_y1, [4, 7], err_msg=form)
        assert table.digest == sha256(data).hexdigest()


def test_tables_are_frozen_and_travel_between_processes() -> None:
    table = load_table("wang_all")
    with pytest.raises(dataclasses.FrozenInstanceError):
        table.name = "other"  # type: ignore[misc]
    arrays = [table.impacts.v_x1, table.impacts.v_y1, table.impacts.omega_1, table.impacts.cor]
    arrays += [item.values for item in (*table.measurements, *table.redundant)]
    for array in arrays:
        assert array is not None
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(TypeError):
        table.labels["group"] = ()  # type: ignore[index]
    again = pickle.loads(pickle.dumps(table))
    assert again.digest == table.digest and again.labels["group"] == table.labels["group"]


def test_labels_and_names_are_those_of_the_rows_that_are_left(tmp_path: Path) -> None:
    table = read(tmp_path, "id,surface,note,v_y1,v_y2\na,clay,x,,3\nb,hard,y,5,4\nc,grass,z,6,-\nd,clay,u,7,6\n")
    assert (table.ids, table.rows) == (("b", "d"), (2, 4))
    assert dict(table.labels) == {"surface": ("hard", "clay"), "note": ("y", "u")}
    np.testing.assert_array_equal(table.impacts.v_y1, [5, 7])
