"""Good tables: what is read, in which units, what counts, what is left out, how it is named."""

import hashlib

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.impact_rows import HEAD, ROWS, codes, written

import fitball
from fitball.base.errors import InputError, ParameterError
from fitball.data.bundled import printed_table
from fitball.data.check import check
from fitball.data.load import load_data
from fitball.data.read import reading_of

MPH = 1609.344 / 3600


def test_units_convert_once(tmp_path):
    """By the definitions of the units; angles are in degrees and all else in SI unless something
    else is said.
    """
    table = fitball.load_table(
        written(
            tmp_path,
            "v_1 [km/h],theta_1,omega_1 [rpm],v_2 [mph],theta_2 [rad],omega_2 "
            "[rev/s],contact_time/ms,gap_turn",
            "72,30,60,30,0.6,10,5,500",
            "54,45,-120,25,0.8,20,4.5,-90",
        )
    )
    wanted = {
        "omega_1": [2 * np.pi, -4 * np.pi],
        "v_1": [20, 15],
        "theta_1": [np.pi / 6, np.pi / 4],
        "v_2": [30 * MPH, 25 * MPH],
        "theta_2": [0.6, 0.8],
        "omega_2": [20 * np.pi, 40 * np.pi],
        "contact_time": [0.005, 0.0045],
        "gap_turn": [500 * np.pi / 180, -np.pi / 2],
    }
    assert list(table.values) == list(wanted)
    for name, numbers in wanted.items():
        assert_allclose(table.values[name], numbers, rtol=1e-15, err_msg=name)
    assert_allclose(table.impacts.v_x1, [20 * 3**0.5 / 2, 15 / 2**0.5], rtol=1e-14)
    assert table.has_tangential
    assert table.has_spin
    assert table.notices == ()


def test_standard_deviations_have_their_units(tmp_path):
    table = fitball.load_table(
        written(
            tmp_path,
            "v_x1,v_x1_sd [cm/s],v_y1,v_2,v_2_sd,theta_2,theta_2_sd,omega_1,omega_1_sd "
            "[rpm],gap_time [ms]",
            "10,20,5,8,0.1,30,2,0,30,4 ± 0.1",
            "10,30,6,8,0.2,35,3,0,60,5 ± 0.2",
        )
    )
    wanted = {
        "v_x1": [0.2, 0.3],
        "omega_1": [np.pi, 2 * np.pi],
        "v_2": [0.1, 0.2],
        "theta_2": np.radians([2, 3]),
        "gap_time": [1e-4, 2e-4],
    }
    assert list(table.sd) == list(wanted)
    for name, numbers in wanted.items():
        assert_allclose(table.sd[name], numbers, rtol=1e-15, err_msg=name)


def test_correlations_in_a_file_beside_the_table_are_asked_for(tmp_path):
    path = written(tmp_path, HEAD, *ROWS)
    (tmp_path / "t_covariance.csv").touch()
    with pytest.raises(InputError) as caught:
        fitball.load_table(path)
    assert caught.value.code == "covariance-file"
    assert len(fitball.load_table(path, ignore="corr").impacts) == 4


@pytest.mark.parametrize(
    ("columns", "counted"),
    [
        ("v_x2 v_y2 v_2 theta_2", "v_x2 v_y2"),
        ("v_x2 v_2 theta_2", "v_2 theta_2"),
        ("v_2 theta_2", "v_2 theta_2"),
        ("v_x2 theta_2", "v_x2 theta_2"),
        ("v_y2 v_2", "v_y2 v_2"),
        ("v_y2 omega_2", "v_y2 omega_2"),
        ("v_2", "v_2"),
        ("contact_time", "contact_time"),
        ("v_y2 theta_2", "v_y2 theta_2"),
    ],
)
def test_each_quantity_counts_once(tmp_path, columns, counted):
    cells = {
        "v_x2": "6",
        "v_y2": "4.5",
        "v_2": "7.5",
        "theta_2": "36.87",
        "omega_2": "100",
        "contact_time": "0.005",
    }
    row = "10,6,0," + ",".join(cells[name] for name in columns.split())
    table = fitball.load_table(
        written(tmp_path, f"v_x1,v_y1,omega_1,{columns.replace(' ', ',')}", row, row)
    )
    assert {*table.values} == {"v_x1", "v_y1", "omega_1", *counted.split()}
    assert not {"disagreement", "sd-not-used"} & {*codes(table)}


def test_exactly_the_columns_of_wang_that_contradict_themselves_are_noted():
    for name, count in {
        "wang_zero_spin": 3,
        "wang_all": 3,
        "wang_topspin": 0,
        "wang_backspin": 0,
    }.items():
        assert codes(fitball.load_table(name)) == count * ["disagreement"]


def test_measured_restitution_is_that_of_tables_2_4_and_6():
    for spin, number in (("zero_spin", 2), ("topspin", 4), ("backspin", 6)):
        table = fitball.load_table(f"wang_{spin}")
        wanted = printed_table(f"table_{number}")["cor"]
        assert_allclose(
            table.values["v_y2"] / table.impacts.v_y1,
            wanted,
            rtol=0.0,
            atol=1e-5,
        )


def test_drop_heights_are_speeds_of_a_fall_through_air():
    """Against motion step by step, and sds against random draws."""
    heights = {"rebound_height [cm]": [140, 138], "rebound_height_sd [mm]": [5, 5]}
    table = fitball.load_table({"drop_height [in]": ["100 ± 0.5"] * 2, **heights})
    speed = 0.0
    height = 2.54
    step = 1e-5
    # rho C_d pi R^2/(2 m), of a tennis ball in dry air at sea level.
    per_speed_squared = 1.2 * 0.55 * np.pi * 0.03302**2 / (2 * 0.0576)
    while height > 0.0:
        acceleration = 9.80665 - per_speed_squared * speed**2
        height -= speed * step + 0.5 * acceleration * step**2
        speed += acceleration * step
    assert list(table.values) == ["v_y1", "v_y2"]
    assert not table.has_tangential
    assert_allclose(table.impacts.v_y1, speed, rtol=1e-4)
    terminal = 9.80665 / per_speed_squared
    heights = 1.40 + 0.005 * np.random.default_rng(3).standard_normal(400_000)
    rising = np.sqrt(terminal * np.expm1(2 * 9.80665 * heights / terminal))
    assert_allclose(table.values["v_y2"][0], rising.mean(), rtol=1e-4)
    assert table.sd["v_y2"][0] == pytest.approx(rising.std(), rel=0.01)
    assert table.sd["v_y1"][0] == pytest.approx(acceleration * 0.0127 / speed, rel=1e-3)
    assert [note.code for note in table.notices].count("heights") == 2


def test_the_air_of_heights_is_that_of_the_scene():
    """A drop test in the mountains with a drag of its own; without air v^2 = 2 g h."""
    heights = {"drop_height": [2.0, 2.0], "rebound_height": [1.0, 1.1]}
    thin = fitball.Scene(flight={"drag": 0.02}, air={"density": 0.3})
    table = fitball.load_table(heights, scene=thin)
    assert_allclose(table.impacts.v_y1, np.sqrt(2 * 9.80665 * 2.0), rtol=1e-3)
    thick = fitball.Scene(flight={"drag": 0.6}, air={"pressure": 84_000.0, "temperature": 5.0})
    table = fitball.load_table(heights, scene=thick)
    braking = 0.6 * 84_000.0 / (287.05 * 278.15) * np.pi * 0.03302**2 / 0.0576
    squares = 2 * 9.80665 / braking * (1.0 - np.exp(-2.0 * braking))
    assert_allclose(table.impacts.v_y1, np.sqrt(squares), rtol=1e-12)
    assert table.read[0]["drag"] == "0.6"


@pytest.mark.parametrize("cell", ["", "nan", "NaN", "NA", "n/a", "-", "null", " ", "#N/A"])
def test_a_rebound_cell_without_a_number_is_a_gap(tmp_path, cell):
    table = fitball.load_table(
        written(tmp_path, HEAD, *ROWS[:2], f"13.1,7.7,3,8.2,6.1,{cell}", ROWS[3])
    )
    assert_array_equal(table.values["omega_2"], [239, 250, np.nan, 255])
    assert table.labels["id"] == ("1", "2", "3", "4")


def test_rows_without_incident_state_or_rebound_are_left_out(tmp_path):
    good = [f"b,hard,{ROWS[0]}", f"d,clay,{ROWS[1]}"]
    gaps = ["a,clay,14,,0,9,5,250", "c,hard,12,8,NA,8,7,250"]
    table = fitball.load_table(
        written(tmp_path, f"id,surface,{HEAD}", *gaps, *good, "e,hard,12,8,0,,-,")
    )
    assert table.labels == {"id": ("b", "d"), "surface": ("hard", "clay")}
    assert codes(table) == ["rows-left-out"]
    assert_array_equal(table.impacts.v_y1, [4.8, 6.1])
    assert len(fitball.load_table(written(tmp_path, HEAD, "12,8,0,,-,"), rebound=False)) == 1


def test_an_empty_column_is_as_if_it_were_not_there(tmp_path):
    head = HEAD + ",contact_time,contact_time_sd,v_x2_sd"
    table = fitball.load_table(
        written(tmp_path, head, *(row + ",,0.1," for row in ROWS)),
        ignore="contact_time_sd",
    )
    assert list(table.values) == HEAD.split(",")
    assert table.sd == {}
    assert {"empty-column"} < {*codes(table)}


def test_gaps_beside_standard_deviations_and_energy(tmp_path):
    lines = ["5,4,0.1,0.005", "6,,,0.005", "7,,0.2,0.005", "8,6,0.3,"]
    table = fitball.load_table(written(tmp_path, "v_y1,v_y2,v_y2_sd,contact_time", *lines))
    assert_array_equal(table.sd["v_y2"], [0.1, np.nan, np.nan, 0.3])
    assert np.isnan(
        fitball.load_table(written(tmp_path, HEAD, *ROWS, "5,5,0,,,200")).values["v_x2"][4]
    )
    with pytest.raises(InputError) as caught:
        fitball.load_table(written(tmp_path, HEAD, *ROWS, "5,5,0,90,,200"))
    assert [(fault.code, fault.row) for fault in caught.value.faults] == [("energy", 5)]


def test_ids_are_made_unique_and_labels_have_one_spelling(tmp_path):
    table = fitball.load_table(written(tmp_path, "id,v_y1,v_y2", "a,5,4", "a,5,4", ",5,4", "b,5,4"))
    assert table.labels["id"] == ("a (1)", "a (2)", "(3)", "b")
    assert codes(table) == ["ids"]
    table = fitball.load_table(written(tmp_path, "id,v_y1,v_y2", "a,5,4", "a,5,4", "a (2),5,4"))
    assert table.labels["id"] == ("1", "2", "3")
    courts = ["clay", "Clay", "clay", "CLAY", "hard", "Hardd"]
    rows = [f"{court},{5 + k},{4 + k},{k}" for k, court in enumerate(courts)]
    table = fitball.load_table(written(tmp_path, "court,v_y1,v_y2,mood", *rows))
    assert table.labels["court"] == ("clay",) * 4 + ("hard", "Hardd")
    assert codes(table) == ["spellings"]
    assert table.labels["mood"] == tuple("012345")
    own = "v_1,theta_1,theta_3,v_2,theta_2,omega_2"
    table = fitball.load_table(written(tmp_path, own, *["5,53.13,9,3,50,9"] * 2), ignore="theta_2")
    assert table.labels["theta_3"] == ("9", "9")
    assert {*codes(table)} > {
        "no-incident-spin",
        "ignored",
    }


def test_names_of_ones_own_by_option_and_scene(tmp_path):
    rows = ("38;20;42;23;1", "40;22;43;25;1")
    names = {"v_1": "Vin", "theta_1": "angle_in", "v_2": "Vout"}
    path = written(tmp_path, "Vin (mph);angle_in;Vout [km/h];angle out;speed", *rows)
    ours = fitball.load_table(
        written(tmp_path, "v_1 [mph];theta_1;v_2 [km/h];theta_2;speed", *rows, name="o.csv")
    )
    (tmp_path / "t.toml").write_text(
        '[columns]\nv_1 = "Vin"\ntheta_1 = "angle_in"\nv_2 = "Vout"\n',
        encoding="utf-8",
    )
    by_scene = fitball.load_table(path, columns={"theta_2": "  angle\n out "})
    assert by_scene.values.keys() == ours.values.keys()
    assert by_scene.labels == ours.labels
    assert all(np.array_equal(by_scene.values[name], ours.values[name]) for name in ours.values)
    # What a caller says goes before the scene.
    turned = fitball.load_table(path, columns={"theta_1": "angle out", "theta_2": "angle_in"})
    assert_allclose(turned.values["theta_1"], np.radians([23, 25]))
    # New impacts are read as those of the fit, in its units where they have none, and need no
    # rebound.
    units = {
        "v_1": "mph",
        "theta_1": "deg",
        "v_2": "km/h",
        "theta_2": "deg",
    }
    named = names | {"theta_2": "angle out"}
    assert reading_of(by_scene)["columns"] == {
        name: f"{their} [{units[name]}]" for name, their in named.items()
    }
    for table, head in (
        (by_scene, "Vin (mph),angle_in"),
        (by_scene, "Vin,angle_in"),
        (ours, "v_1,theta_1"),
    ):
        new = fitball.load_table(
            written(tmp_path, head, "38,20", name="n.csv"),
            **reading_of(table),
            rebound=False,
        )
        assert_array_equal(new.values["v_1"], ours.values["v_1"][:1])
    other = {"v_x1 [m/s]": [10.0], "v_y1 [km/h]": [36.0]}
    assert fitball.load_table(other, **reading_of(ours), rebound=False).values["v_y1"] == 10.0


def test_how_a_table_was_read_is_kept(tmp_path):
    path = written(tmp_path, HEAD.replace("omega_2", "spin [rpm]"), *ROWS)
    table = fitball.load_table(
        path,
        columns={"omega_2": "spin", "v_y1": "u"},
        flip="v_x1,v_x2",
        ignore="v_y2",
    )
    (read,) = table.read
    assert read["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert read["source"] == str(path)
    assert read["columns"] == "omega_2=spin,v_y1=u"
    assert read["flip"] == "v_x1,v_x2"
    assert read["ignore"] == "v_y2"
    assert "omega_2=rpm" in read["units"].split(",")
    assert "v_y2" not in read["units"]
    assert "not-read" in codes(table)


def test_several_tables_are_one_with_the_scene_of_the_first(tmp_path):
    (tmp_path / "a").mkdir()
    first = written(tmp_path, HEAD, *ROWS[:2])
    second = written(tmp_path / "a", HEAD, *ROWS[2:])
    (tmp_path / "t.toml").write_text("[ball]\nmass = 0.057\n", encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_data([first, second], None, False)
    assert caught.value.code == "scenes-differ"
    (tmp_path / "a" / "t.toml").write_text("[ball]\nmass = 0.057\n", encoding="utf-8")
    (tmp_path / "t#2.toml").write_text("[ball]\nmass = 0.058\n", encoding="utf-8")
    _, scene = load_data(written(tmp_path, HEAD, *ROWS, name="t#2.csv"), None, False)
    assert scene.ball_value().mass == 0.058
    table, scene = load_data([first, second], None, False)
    assert table.labels["table"] == (
        "t (1)",
        "t (1)",
        "t (2)",
        "t (2)",
    )
    assert scene.ball_value().mass == 0.057
    _, scene = load_data([first, second], tmp_path / "a" / "t.toml", False)
    assert scene.ball_value().mass == 0.057
    with pytest.raises(InputError) as twice:
        load_data([first, first], None, False)
    assert twice.value.code == "same-table-twice"
    read = fitball.load_table(first)
    assert load_data(read, None, False)[0] is not None
    with pytest.raises(ParameterError) as already:
        load_data(read, None, False, flip="v_x1")
    assert already.value.code == "read-already"


def test_no_file_is_beside_a_table_in_memory(tmp_path, monkeypatch):
    """Though one has the name of its table."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "table.toml").write_text("[ball]\nmass = 0.057\n", encoding="utf-8")
    drops = {"v_y1": [5, 6], "v_y2": [4, 5]}
    assert load_data(fitball.load_table(drops), None, False)[1] == load_data(drops, None, False)[1]


def test_a_check_shows_the_table_as_read_or_lists_the_bundled_ones(tmp_path):
    shown = check("wang_all", None, False)
    assert not shown.failed
    assert shown.frames["faults"].empty
    assert shown.frames["doubts"].empty
    assert shown.frames["table"].shape[0] == 21
    assert [note.code for note in shown.notes] == 3 * ["disagreement"]
    offered = check(None, None, False)
    assert {"wang_all", "synthetic_gaps"} <= {*offered.frames["bundled"]["table"]}
    text = fitball.check().report()
    for key in ("mu=literature:clay", *offered.frames["priors"]["key"]):
        assert key in text
    # Of a long table what is printed and what not are all of it.
    drops = {"v_y1": np.linspace(4, 6, 500), "v_y2": np.linspace(3, 4.5, 500)}
    long = fitball.check(drops, as_read=True)
    assert "... and 460 more" in long.report()
    faults = check(written(tmp_path, "v_x1,v_y1", "5,?"), None, False).frames["faults"]
    assert faults["row"].tolist() == [None, 1]
    assert faults["line"].tolist() == [1, 2]
