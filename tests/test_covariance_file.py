"""Errors that belong together: the file of covariances beside a table, the same in Python, and what a table holds of
them in SI.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import fitball
from fitball.data.read import load_table
from fitball.data.table import joined
from fitball.data.tables import load_tables
from fitball.errors import ParameterError, TableError

MPH, RPM, DEG = 0.44704, np.pi / 30.0, np.pi / 180.0
TABLE = """\
id,v_1 [mph],theta_1 [deg],omega_1 [rpm],v_x2 [m/s],v_y2 [m/s],omega_2 [rpm],v_1_sd [mph],theta_1_sd [deg]
a,38,18,0,11.2,4.1,1100,0.5,0.3
b,40,25,0,10.5,5.2,1400,0.5,0.3
c,42,30,100,10.4,6.3,1700,0.5,0.3
"""
PAIRS = {
    ("v_1", "v_1"): 0.25, ("v_1", "v_x2"): 0.03, ("v_x2", "v_x2"): 0.01, ("v_y2", "v_y2"): 0.0225,
    ("v_x2", "v_y2"): -0.006, ("omega_2", "omega_2"): 900.0, ("omega_2", "v_x2"): 0.9, ("theta_1", "v_1"): -0.05,
}  # fmt: skip
STATE = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")


def rows_of(pairs: dict[tuple[str, str], float], ids: str = "abc") -> str:
    """The rows of a file."""
    return "".join(f"{name},{one},{other},{value!r}\n" for name in ids for (one, other), value in pairs.items())


def written(folder: Path, rows: str, table: str = TABLE, head: str = "id,column,column,value") -> Path:
    """A table with a file of covariances beside it."""
    place = folder / "t.csv"
    place.write_text(table)
    (folder / "t_covariance.csv").write_text(f"{head}\n{rows}")
    return place


def fault_of(place: Path, **options: object) -> str:
    """What is said of a file of covariances that is refused."""
    with pytest.raises(TableError) as raised:
        load_table(place, **options)  # type: ignore[arg-type]
    assert "t_covariance.csv" in str(raised.value)
    return str(raised.value)


def by_hand(speed: float, angle: float) -> np.ndarray:
    """The covariance of `STATE` for `PAIRS`, by the Jacobian written out and units by hand."""
    names = ("v_1", "theta_1", "omega_1", "v_x2", "v_y2", "omega_2")
    size = dict(zip(names, (MPH, DEG, RPM, 1.0, 1.0, RPM), strict=True))
    own = np.zeros((6, 6))
    for (one, other), value in {**PAIRS, ("theta_1", "theta_1"): 0.09}.items():
        i, j = names.index(one), names.index(other)
        own[i, j] = own[j, i] = value * size[one] * size[other]
    v, theta = speed * MPH, angle * DEG
    slopes = np.eye(6)
    slopes[:2, :2] = [[np.cos(theta), -v * np.sin(theta)], [np.sin(theta), v * np.cos(theta)]]
    return slopes @ own @ slopes.T


def test_a_covariance_file_is_read_in_the_units_of_the_table(tmp_path: Path) -> None:
    """By units and propagation from speed and angle, written out here."""
    table = load_table(written(tmp_path, rows_of(PAIRS)))
    found = table.covariance
    assert found is not None and found.columns == STATE
    for k, (speed, angle) in enumerate(((38, 18), (40, 25), (42, 30))):
        assert found.values[k] == pytest.approx(by_hand(speed, angle), rel=1e-12, abs=1e-15)
    assert table.incident_covariance is not None
    assert np.array_equal(found.values[:, :3, :3], table.incident_covariance)
    assert table.incident_sd["v_y1"] ** 2 == pytest.approx(found.values[:, 1, 1])
    item = table.measurement("omega_2")
    assert item is not None and item.sd == pytest.approx(30.0 * RPM)
    assert table.remarks[0] == "covariances of 3 of 3 rows are read from t_covariance.csv"


def test_in_python_it_is_a_mapping_an_array_or_a_path(tmp_path: Path) -> None:
    place = written(tmp_path, rows_of(PAIRS))
    beside = load_table(place).covariance
    other = tmp_path / "other.csv"
    (tmp_path / "t_covariance.csv").rename(other)
    assert load_table(place).covariance is None
    names = ("v_1", "theta_1", "omega_1", "v_x2", "v_y2", "omega_2")
    array = np.zeros((3, 6, 6))
    for (one, two), value in PAIRS.items():
        array[:, names.index(one), names.index(two)] = value
    both = np.maximum(array, array.swapaxes(1, 2)) + np.minimum(array, array.swapaxes(1, 2))
    both[:, range(6), range(6)] = array[:, range(6), range(6)]
    for given in (other, str(other), dict.fromkeys("abc", PAIRS), array, both):
        found = load_table(place, covariance=given).covariance
        assert found is not None and beside is not None
        assert np.array_equal(found.values, beside.values)
    with pytest.raises(ParameterError, match=r"shape \(3, 5, 5\), expected \(3, 6, 6\).*v_1, theta_1, omega_1, v_x2"):
        load_table(place, covariance=array[:, :5, :5])
    with pytest.raises(ParameterError, match=r"read the key 'v_1v_1', expected \(column, column\)"):
        load_table(place, covariance={"a": {"v_1v_1": 1.0}})  # type: ignore[dict-item]
    with pytest.raises(TableError, match="finite"):
        load_table(place, covariance={"a": {("v_x2", "v_x2"): np.inf}})


def test_columns_may_be_numbered_and_named_as_in_the_table(tmp_path: Path) -> None:
    table = TABLE.replace("v_x2 [m/s]", "Vx out").replace("omega_2 [rpm]", "Omega 2 (rpm)")
    rows = rows_of(PAIRS).replace("v_x2", "Vx out").replace("omega_2", "Omega 2 (rpm)")
    place = written(tmp_path, rows, table, "id,column_1,column_2,value")
    one = load_table(place, columns={"v_x2": "Vx out [m/s]"}).covariance
    other = load_table(written(tmp_path, rows_of(PAIRS))).covariance
    assert one is not None and other is not None and np.array_equal(one.values, other.values)


def test_flips_and_signs_go_into_it(tmp_path: Path) -> None:
    """Spins of the other sign change the sign of their covariances; so do rebounds printed downwards."""
    straight = load_table(written(tmp_path, rows_of(PAIRS))).covariance
    turned = load_table(tmp_path / "t.csv", flip=["omega_2"]).covariance
    assert straight is not None and turned is not None
    assert turned.values[:, 5, 3] == pytest.approx(-straight.values[:, 5, 3])
    assert turned.values[:, 3, 4] == pytest.approx(straight.values[:, 3, 4])
    down = TABLE.replace(",4.1,", ",-4.1,").replace(",5.2,", ",-5.2,").replace(",6.3,", ",-6.3,")
    below = load_table(written(tmp_path, rows_of(PAIRS), down)).covariance
    assert below is not None
    assert below.values[:, 3, 4] == pytest.approx(-straight.values[:, 3, 4])
    normal = load_table(tmp_path / "t.csv", flip=["theta_1"], covariance={"a": PAIRS, "b": PAIRS, "c": PAIRS})
    assert normal.covariance is not None
    v, theta = 38 * MPH, (90 - 18) * DEG
    slopes = np.array([[np.cos(theta), -v * np.sin(theta)], [np.sin(theta), v * np.cos(theta)]])
    own = np.array([[0.25 * MPH**2, 0.05 * MPH * DEG], [0.05 * MPH * DEG, 0.09 * DEG**2]])
    assert normal.covariance.values[0, :2, :2] == pytest.approx(slopes @ own @ slopes.T)


FAULTS = {
    "not an impact": ("d,v_x2,v_x2,0.01\n", "row 1", "read 'd', which is not an impact of"),
    "no such column": ("a,contact_time,v_x2,0.01\n", "row 1", "has no such column with numbers; it has v_1, theta_1"),
    "unknown column": ("a,v_x2,speeed,0.01\n", "row 1", "read 'speeed', which is not a column of"),
    "an sd": ("a,v_x2_sd,v_x2_sd,0.01\n", "row 1", "its variance is the entry (v_x2, v_x2)"),
    "another unit": ("a,v_x2 [mph],v_x2,0.01\n", "row 1", "v_x2 is in m/s"),
    "twice": ("a,v_1,v_1,0.25\na,v_1,v_1,0.25\n", "row 2", "'a', v_1: given twice"),
    "asymmetric": (
        rows_of(PAIRS) + "b,v_y2,v_x2,0.006\n", "row 25", "read 0.006, but -0.006 with the two columns the other way"
    ),
    "no number": ("a,v_1,v_1,nan\n", "row 1", "expected a number"),
    "infinite": ("a,v_1,v_1,inf\n", "row 1", "not finite"),
    "negative": ("a,v_1,v_1,-0.25\n", "row 1", "read the variance -0.25; expected a positive number"),
    "a wrong unit": (rows_of({("v_x2", "v_x2"): 1e8}, "a"), "row 1", "check the unit"),
    "the table's sd": (rows_of({("v_1", "v_1"): 0.36}, "a"), "row 1", "the table has v_1_sd = 0.5 mph"),
    "no variance": ("a,v_1,v_x2,0.03\n", "row 1", "expected (v_x2, v_x2) here or v_x2_sd in"),
    "some rows only": (rows_of({("v_x2", "v_x2"): 0.01}, "ab"), "", "no variance of v_x2 for 'c'"),
    "too correlated": (
        rows_of({**PAIRS, ("v_x2", "v_y2"): -0.018}, "a") + rows_of(PAIRS, "bc"), "row 5",
        "'a', v_x2 and v_y2: the covariances of this impact are not positive semidefinite: the smallest eigenvalue",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_says_where_and_what(name: str, tmp_path: Path) -> None:
    rows, row, message = FAULTS[name]
    said = fault_of(written(tmp_path, rows))
    assert message in said
    assert row in said


def test_the_tables_sd_may_be_rounded(tmp_path: Path) -> None:
    """A deviation of 0.52 printed as 0.5; the variance counts."""
    table = load_table(written(tmp_path, rows_of({**PAIRS, ("v_1", "v_1"): 0.27})))
    assert table.covariance is not None
    slope = np.cos(18 * DEG) * MPH
    assert table.covariance.values[0, 0, 3] == pytest.approx(0.03 * slope)
    assert table.covariance.values[0, 0, 0] > 0.27 * slope**2 - 1e-3


def test_a_speed_needs_the_error_of_its_angle(tmp_path: Path) -> None:
    bare = "\n".join(line.rpartition(",")[0].rpartition(",")[0] for line in TABLE.splitlines()) + "\n"
    said = fault_of(written(tmp_path, rows_of({("v_1", "v_1"): 0.25}), bare))
    assert "no variance of theta_1; the incident components need the errors of both" in said
    whole = load_table(written(tmp_path, rows_of({**PAIRS, ("theta_1", "theta_1"): 0.09}), bare))
    assert whole.covariance is not None
    assert whole.covariance.values[0] == pytest.approx(by_hand(38, 18), rel=1e-12, abs=1e-15)


def test_rounding_excuses_little(tmp_path: Path) -> None:
    """Of variances of one digit the digits would excuse a correlation of 1.25."""
    pairs = {("v_x2", "v_x2"): 4, ("v_y2", "v_y2"): 4, ("v_x2", "v_y2"): 5}
    assert "positive semidefinite" in fault_of(written(tmp_path, rows_of(pairs)))


def test_three_correlations_that_exclude_each_other_are_refused(tmp_path: Path) -> None:
    """No pair is above 1 here."""
    pairs = {("v_x2", "v_x2"): 1.0, ("v_y2", "v_y2"): 1.0, ("omega_2", "omega_2"): 1.0,
             ("v_x2", "v_y2"): 0.9, ("v_x2", "omega_2"): 0.9, ("v_y2", "omega_2"): -0.9}  # fmt: skip
    # Of ((1, r, r), (r, 1, -r), (r, -r, 1)) the smallest eigenvalue is 1 - 2r.
    assert "correlations is -0.8" in fault_of(written(tmp_path, rows_of(pairs)))


def test_rounded_digits_are_no_fault_and_make_the_nearest_covariance(tmp_path: Path) -> None:
    """A correlation of 1 printed to three digits."""
    pairs = {("v_x2", "v_x2"): 0.0123, ("v_y2", "v_y2"): 0.0457, ("v_x2", "v_y2"): 0.0238}
    assert 0.0238**2 > 0.0123 * 0.0457
    table = load_table(written(tmp_path, rows_of(pairs)))
    assert table.covariance is not None
    assert any("by the rounding of printed digits" in remark for remark in table.remarks)
    block = table.covariance.values[0, 3:5, 3:5]
    assert np.linalg.eigvalsh(block)[0] > -1e-12
    assert np.diag(block) == pytest.approx([0.0123, 0.0457])
    with pytest.raises(TableError, match="positive semidefinite"):
        load_table(tmp_path / "t.csv", covariance=dict.fromkeys("abc", pairs))


@pytest.mark.parametrize(
    ("head", "message"),
    [
        ("id,column,column,value [m2/s2]", "states the unit '[m2/s2]'; expected none"),
        ("id,column,value", "a second column named 'column' (or 'column_2') is missing"),
        ("id,column,column,number", "column 'value' is missing"),
        ("id,column,column,column,value", "two columns have this meaning"),
    ],
)
def test_a_header_that_is_not_understood_says_what_is_expected(head: str, message: str, tmp_path: Path) -> None:
    rows = {3: "a,v_x2,0.01\n", 4: "a,v_x2,v_x2,0.01\n", 5: "a,v_x2,v_x2,v_x2,0.01\n"}[head.count(",") + 1]
    assert message in fault_of(written(tmp_path, rows, head=head))


def test_missing_measurements_and_rows_left_out(tmp_path: Path) -> None:
    """An entry of what was not measured is a fault; one of a row that is left out is none."""
    gap = TABLE.replace(",6.3,1700,", ",6.3,,")
    said = fault_of(written(tmp_path, rows_of(PAIRS), gap))
    assert "'c', omega_2: omega_2 was not measured in this row" in said and "row 22" in said
    rows = rows_of(PAIRS, "ab") + rows_of({pair: v for pair, v in PAIRS.items() if "omega_2" not in pair}, "c")
    table = load_table(written(tmp_path, rows, gap))
    assert table.covariance is not None and not table.covariance.values[2, 5].any()
    out = TABLE.replace("b,40,25", "b,40,").replace(",0.5,0.3\nc", ",0.5,\nc")
    left = load_table(written(tmp_path, rows_of(PAIRS), out))
    assert left.ids == ("a", "c") and left.covariance is not None
    assert left.covariance.values[1] == pytest.approx(by_hand(42, 30))


def test_rows_without_an_entry_have_their_sds(tmp_path: Path) -> None:
    lines = TABLE.replace("theta_1_sd [deg]", "theta_1_sd [deg],v_x2_sd,v_y2_sd,omega_2_sd [rpm]").splitlines()
    table = "\n".join([lines[0], *(f"{line},0.1,0.15,30" for line in lines[1:])]) + "\n"
    found = load_table(written(tmp_path, rows_of(PAIRS, "b"), table))
    assert "covariances of 1 of 3 rows are read" in found.remarks[0]
    assert found.covariance is not None
    assert np.diag(found.covariance.values[0])[3:] == pytest.approx([0.01, 0.0225, (30 * RPM) ** 2])
    assert found.covariance.values[0, 3, 4] == 0.0 != found.covariance.values[1, 3, 4]


def test_variances_alone_are_as_sds_in_the_table(tmp_path: Path) -> None:
    """Nothing belongs together then, and the table is as one with columns of sds."""
    found = load_table(written(tmp_path, rows_of({("v_x2", "v_x2"): 0.01})))
    assert found.covariance is None
    item = found.measurement("v_x2")
    assert item is not None and item.sd == pytest.approx(0.1)


def test_ids_that_come_twice_and_redundant_columns(tmp_path: Path) -> None:
    twice = TABLE.replace("\nb,", "\na,")
    assert "names several impacts" in fault_of(written(tmp_path, rows_of(PAIRS, "a"), twice))
    lines = TABLE.splitlines()
    speeds = ("11.927", "11.718", "12.159")
    table = "\n".join([lines[0] + ",v_2", *(f"{line},{v}" for line, v in zip(lines[1:], speeds, strict=True))]) + "\n"
    pairs = {**PAIRS, ("v_2", "v_2"): 0.01, ("v_2", "v_x2"): 0.002}
    found = load_table(written(tmp_path, rows_of(pairs), table)).covariance
    assert found is not None and found.columns == STATE


def test_joined_tables_stack_it(tmp_path: Path) -> None:
    place = written(tmp_path, rows_of(PAIRS))
    other = tmp_path / "u.csv"
    head = ",".join(TABLE.splitlines()[0].split(",")) + ",v_x2_sd,v_y2_sd,omega_2_sd [rpm]\n"
    other.write_text(head + "".join(f"{line},0.2,0.3,60\n" for line in TABLE.splitlines()[1:]))
    both = load_tables([place, other])
    one, two = load_table(place), load_table(other)
    assert both.covariance is not None and one.covariance is not None and two.covariance is None
    assert np.array_equal(both.covariance.values[:3], one.covariance.values)
    assert np.diag(both.covariance.values[3])[3:] == pytest.approx([0.04, 0.09, (60 * RPM) ** 2])
    assert np.array_equal(both.covariance.values[3:, :3, :3], two.incident_covariance)
    assert np.array_equal(both.incident_covariance, both.covariance.values[:, :3, :3])
    spinless = load_table(other, ignore=["omega_2"])
    stacked = joined([spinless, one]).covariance
    assert stacked is not None and stacked.columns == STATE
    assert not stacked.values[:3, 5].any()
    assert np.array_equal(stacked.values[3:], one.covariance.values)
    with pytest.raises(ParameterError, match="read one for 2 tables"):
        fitball.calibrate([place, other], covariance=tmp_path / "t_covariance.csv", point_only=True)


def test_the_digest_changes_with_it(tmp_path: Path) -> None:
    place = written(tmp_path, rows_of(PAIRS))
    one, without = load_table(place), load_table(place, covariance="none")
    written(tmp_path, rows_of({**PAIRS, ("v_x2", "v_y2"): -0.005}))
    assert len({one.digest, without.digest, load_table(place).digest}) == 3
    assert one.files == without.files
    (file,) = one.covariance_files.values()
    assert file[0] == str((tmp_path / "t_covariance.csv").resolve())
    assert not without.covariance_files


def test_ignored_columns_are_left_out_with_their_covariances(tmp_path: Path) -> None:
    place = written(tmp_path, rows_of(PAIRS))
    table = load_table(place, ignore=["omega_2"])
    assert [item.name for item in table.measurements] == ["v_x2", "v_y2"]
    assert table.ignored == ("omega_2",)
    assert table.covariance is not None and table.covariance.columns == STATE[:-1]
    assert "omega_2 is left out, on request (ignore)" in table.remarks
    whole = load_table(place).covariance
    assert whole is not None and np.array_equal(whole.values[:, :5, :5], table.covariance.values)


def test_what_cannot_be_ignored_is_an_error_with_what_can(tmp_path: Path) -> None:
    place = tmp_path / "t.csv"
    place.write_text(TABLE)
    with pytest.raises(ParameterError, match=r"has no rebound column 'contact_time' to leave out; .*v_x2"):
        load_table(place, ignore=["contact_time"])
    with pytest.raises(ParameterError, match="v_1 is of the incident ball"):
        load_table(place, ignore=["v_1"])
    with pytest.raises(TableError, match="no rebound column"):
        load_table(place, ignore=["v_x2", "v_y2", "omega_2"])
    read = load_table(place)
    with pytest.raises(ParameterError, match="has been read already"):
        fitball.calibrate(read, ignore="omega_2", point_only=True)


def test_a_scene_may_ignore_columns(tmp_path: Path) -> None:
    place = tmp_path / "t.csv"
    place.write_text(TABLE)
    (tmp_path / "t.toml").write_text('[measurement]\nignore = ["omega_2"]\n')
    assert load_table(place).ignored == ("omega_2",)
    assert not load_table(place, ignore="v_x2").has_tangential
    scene = fitball.load_scene(place)
    read = load_table(place, scene=fitball.data.scene.Scene())
    with pytest.raises(ParameterError, match="the scene ignores omega_2, but t has been read already"):
        fitball.calibrate(read, scene=scene, point_only=True)
    (tmp_path / "t.toml").write_text('[measurement]\nignore = "omega_2"\n')
    with pytest.raises(fitball.errors.SceneError, match="expected a list of texts"):
        load_table(place)
