"""Force records: where they are looked for, how they are read, and every fault with its place."""

from __future__ import annotations

import numpy as np
import pandas
import pytest
from synthetic_drop import write_case

from fitball.cli.main import main
from fitball.data.force import find_force, load_force
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.errors import SceneError, TableError

TABLE = "id,v_y1,v_y2\na,5,3.7\nb,8,6.0\n"
TIMES = np.arange(0.0, 8.0, 0.2)


def pulse(peak=200.0, begin=1.0, length=5.0):
    return np.where((begin < TIMES) & (begin + length > TIMES), peak * np.sin(np.pi * (TIMES - begin) / length), 0.0)


def lines(name, times=TIMES, forces=None):
    forces = pulse() if forces is None else forces
    return [f"{name},{t:.3f},{f:.4f}" for t, f in zip(times, forces, strict=True)]


def written(folder, rows, header="id,t [ms],F [N]"):
    (folder / "table.csv").write_text(TABLE)
    place = folder / "forces.csv"
    place.write_text("\n".join([header, *rows]) + "\n")
    return place, load_table(folder / "table.csv")


def test_units_order_and_digest(tmp_path):
    place, table = written(tmp_path, [*lines("b"), *lines("a", forces=2.0 * pulse())], "id,t [ms],F [lbf]")
    found = load_force(place, table)
    assert [item.id for item in found.records] == ["a", "b"]
    assert [item.row for item in found.records] == [0, 1]
    one = found.records[0]
    assert one.step == pytest.approx(2e-4, rel=1e-12, abs=0) and one.times[-1] == pytest.approx(7.8e-3)
    assert one.force.max() == pytest.approx(2.0 * pulse().max() * 4.4482216152605, rel=1e-6)
    assert len(found.digest) == 64
    place.write_text(place.read_text() + "\n")
    assert load_force(place, table).digest != found.digest


def test_parquet_says_the_same(tmp_path):
    place, table = written(tmp_path, lines("a"))
    frame = pandas.DataFrame({"id": "a", "t [ms]": TIMES, "F": pulse()})
    frame.to_parquet(tmp_path / "forces.parquet")
    one, other = load_force(place, table).records[0], load_force(tmp_path / "forces.parquet", table).records[0]
    np.testing.assert_allclose(one.force, other.force, atol=1e-4)
    assert one.step == pytest.approx(other.step)


SWAPPED = [*lines("a")[:9], *reversed(lines("a")[9:11]), *lines("a")[11:]]
FAULTS = {
    "unknown id": (lines("c"), "row 1 (line 2), column 'id': read 'c', which is not an impact"),
    "a second record": (
        [*lines("a"), *lines("b"), *lines("a")],
        "row 81 (line 82), column 'id': a second record of 'a'",
    ),
    "not increasing": (SWAPPED, "row 11 (line 12), column 't': read 1.800 ms after 2.000 ms"),
    "gap": (lines("a")[:10] + lines("a")[13:], "column 't': read 2.600 ms after 1.800 ms"),
    "not a number": ([*lines("a")[:4], "a,0.8,nan", *lines("a")[5:]], "row 5 (line 6), column 'F': read 'nan'"),
    "few samples": (lines("a")[:6], "column 't': the record of 'a' has 6 samples; expected at least 12"),
    "few in contact": (lines("a", 5.0 * TIMES, pulse(1.0, 1.0, 1.6)), "samples above 5 % of its peak"),
    "negative": (lines("a", forces=-pulse()), "expected positive F in compression"),
    "cut off": (lines("a")[8:], "begins at 37 % of its peak"),
    "no release": (lines("a")[:25], "ends at 69 % of its peak"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_every_fault_has_its_place(tmp_path, case):
    rows, words = FAULTS[case]
    place, table = written(tmp_path, rows)
    with pytest.raises(TableError) as caught:
        load_force(place, table)
    assert words in str(caught.value)
    assert str(place) in str(caught.value)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("id,t [ms],force [N]", "did you mean 'F'?"),
        ("id,t [ms],F [kg]", "read unit '[kg]', which is unknown"),
        ("id,t [N],F [N]", "which measures force; expected a unit of time"),
        ("name,t [ms],F [N]", "column 'id' is missing"),
        ("id,t,F [N]", "lasts 4.6e+03 ms; expected 0.2 to 50 ms: check the unit of t"),
    ],
)
def test_headers_and_units(tmp_path, header, words):
    place, table = written(tmp_path, lines("a"), header)
    with pytest.raises(TableError) as caught:
        load_force(place, table)
    assert words in str(caught.value)


def test_time_may_begin_anywhere(tmp_path):
    place, table = written(tmp_path, lines("a", TIMES - 3.0, pulse()))
    (record,) = load_force(place, table).records
    assert record.begin == pytest.approx(-3e-3) and record.step == pytest.approx(2e-4, rel=1e-9)


@pytest.mark.parametrize("forces", [0.0 * TIMES, -0.2 * pulse(), np.where(TIMES < 0.5, 10.0, -0.1 * pulse())])
def test_a_force_that_is_not_compression_is_refused(tmp_path, forces):
    place, table = written(tmp_path, lines("a", forces=forces))
    with pytest.raises(TableError, match="mostly negative; expected positive F in compression"):
        load_force(place, table)


@pytest.mark.parametrize("count", [11, 12])
def test_a_dozen_samples_during_the_contact_are_enough(tmp_path, count):
    forces = np.zeros(TIMES.size)
    forces[8 : 8 + count] = 100.0
    place, table = written(tmp_path, lines("a", forces=forces))
    if count == 12:
        assert load_force(place, table).records[0].pulse == (8, 19)
        return
    with pytest.raises(TableError, match="has 11 samples above 5 % of its peak; expected at least 12"):
        load_force(place, table)


@pytest.mark.parametrize(("level", "end"), [(0.195, 0), (0.205, 0), (0.195, -1), (0.205, -1)])
def test_a_fifth_of_the_peak_is_where_a_record_counts_as_cut_off(tmp_path, level, end):
    forces = pulse()
    forces[end] = level * forces.max()
    place, table = written(tmp_path, lines("a", forces=forces))
    if level < 0.2:
        assert len(load_force(place, table).records) == 1
        return
    with pytest.raises(TableError, match="of its peak"):
        load_force(place, table)


def test_where_records_are_looked_for(tmp_path):
    place, table = written(tmp_path, lines("a"))
    source = str(tmp_path / "table.csv")
    assert find_force([source], table, load_scene(source)) == (None, ())
    beside = tmp_path / "table_force.csv"
    beside.write_text(place.read_text().replace("\na,", "\nb,"))
    found, said = find_force([source], table, load_scene(source))
    assert found is not None and found.records[0].id == "b"
    assert said == ("force records beside the table are used: table_force.csv",)
    (tmp_path / "table.toml").write_text('[force]\nfile = "forces.csv"\nsd = 2.5\nstart_sd = 1e-4\n')
    scene = load_scene(source)
    assert (scene.force_sd, scene.force_start_sd) == (2.5, 1e-4)
    found, said = find_force([source], table, scene)
    assert found is not None and found.records[0].id == "a" and said == ()
    found, _ = find_force([source], table, scene, str(beside))
    assert found is not None and found.records[0].id == "b"
    (tmp_path / "table.toml").write_text('[force]\nfile = "nowhere.csv"\n')
    with pytest.raises(SceneError, match="no such file"):
        find_force([source], table, load_scene(source))
    beside.unlink()
    (tmp_path / "table.toml").write_text("[force]\nsd = 2.0\n")
    with pytest.raises(SceneError, match="none are given"):
        find_force([source], table, load_scene(source))


def test_check_and_calibrate_refuse_in_words(tmp_path, capsys):
    table = write_case(tmp_path, 1)
    assert main(["datasets", "check", str(table)]) == 0
    assert "5 force records" in capsys.readouterr().out
    place = tmp_path / "drops_force.csv"
    place.write_text(place.read_text().replace("drop 2,", "drop 9,"))
    assert main(["datasets", "check", str(table)]) == 2
    assert "read 'drop 9', which is not an impact" in capsys.readouterr().out
    assert main(["calibrate", str(table), "--out", str(tmp_path / "out")]) == 2
    assert "column 'id'" in capsys.readouterr().err
    assert (
        main(["calibrate", str(table), "--force-records", str(tmp_path / "none.csv"), "--out", str(tmp_path / "out")])
        == 2
    )
    assert "cannot be opened" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
