"""Names of one's own and slips in names: what a caller says, what is guessed, what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas
import pytest
from written import assert_same, read

import fitball
from fitball.cli.main import main
from fitball.data.columns import FLIPPABLE
from fitball.data.header import end_of, guess_of
from fitball.data.misreading import flipped
from fitball.data.read import load_table
from fitball.errors import ParameterError, SceneError, TableError

FOREIGN = "Vin (mph);angle_in;Vout [km/h];angle_out;speed\n38;20;42;23;1\n40;22;43;25;1\n"
COLUMNS = {"v_1": "Vin", "theta_1": "angle_in", "v_2": "Vout", "theta_2": "angle_out"}


def test_names_of_ones_own_by_option_scene_and_python(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ours = read(tmp_path, "v_1 [mph],theta_1,v_2 [km/h],theta_2,speed\n38,20,42,23,1\n40,22,43,25,1\n", "ours.csv")
    assert_same(read(tmp_path, FOREIGN, columns=COLUMNS), ours)
    place = tmp_path / "t.csv"
    option = ", ".join(f"{name}={their}" for name, their in COLUMNS.items())
    assert main(["datasets", "check", str(place), "--columns", option]) == 0
    (tmp_path / "t.toml").write_text("[columns]\n" + "".join(f'{a} = "{b}"\n' for a, b in COLUMNS.items()))
    assert_same(load_table(place), ours)
    # What a caller says goes before the scene.
    turned = load_table(place, columns={"theta_1": "angle_out", "theta_2": "angle_in"})
    np.testing.assert_array_equal(np.degrees(np.arctan2(turned.impacts.v_y1, turned.impacts.v_x1)).round(9), [23, 25])
    assert load_table(place).columns == COLUMNS
    capsys.readouterr()


def test_units_may_be_said_beside_a_table(tmp_path: Path) -> None:
    text = "Vin,angle_in,v_2\n38,20,42\n40,22,43\n"
    ours = read(tmp_path, "v_1 [mph],theta_1,v_2 [km/h]\n38,20,42\n40,22,43\n", "ours.csv")
    by_name = read(tmp_path, text, columns={"v_1": "Vin [mph]", "theta_1": "angle_in", "v_2": "v_2 [km/h]"})
    names = {"v_1": "Vin", "theta_1": "angle_in"}
    assert_same(by_name, ours)
    assert_same(read(tmp_path, text, columns=names, units={"v_1": "mph", "v_2": "km/h"}), ours)
    assert_same(read(tmp_path, text, columns=names, units={"Vin": "MPH", "v_2": "km/h"}), ours)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"columns": {"speed_in": "Vin"}}, r"'speed_in' .* did you mean v_1\?"),
        ({"columns": {"v_1": "Vin", "v_2": "vin"}}, "for two columns"),
        ({"columns": {"v_1": " "}}, "v_1 has no name"),
        ({"units": {"Vi": "mph"}}, "no column 'Vi'"),
        ({"columns": {"v_1": "Vin [mph]"}, "units": {"v_1": "mph"}}, "give it once"),
    ],
)
def test_names_that_cannot_be_used(tmp_path: Path, words: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        read(tmp_path, FOREIGN, **words)


def test_a_name_that_is_not_in_the_table_is_a_fault(tmp_path: Path) -> None:
    with pytest.raises(TableError, match="no column 'V_in' to read as v_1"):
        read(tmp_path, FOREIGN, columns={**COLUMNS, "v_1": "V_in"})
    with pytest.raises(TableError, match=r"'\[mph\]'.*'\[km/h\]'"):
        read(tmp_path, FOREIGN, columns={**COLUMNS, "v_1": "Vin [km/h]"})


def test_a_foreign_table_is_told_which_option_to_pass(tmp_path: Path) -> None:
    with pytest.raises(TableError) as caught:
        read(tmp_path, FOREIGN)
    assert f"pass columns={COLUMNS}" in str(caught.value)
    assert "'speed' may be v_1 or v_2" in str(caught.value)
    with pytest.raises(TableError, match=r"pass columns=\{'v_1': 'NAME'"):
        read(tmp_path, "a,b,c\n5,4,3\n5,4,3\n")


OWN = "speed in (km/h);angle;spin rpm before;speed after (km/h);angle after;spin rpm after"
GERMAN = "Geschwindigkeit vorher [km/h];Winkel vorher;Drall vorher [rpm];Geschwindigkeit nachher [km/h];"
BOTH_SPINS = "\n61,2;20,5;-74;38;26;2750\n60,8;33,0;100;37;44;2930\n"


@pytest.mark.parametrize("header", [OWN, GERMAN + "Winkel nachher;Drall nachher [rpm]"])
def test_the_option_that_is_proposed_names_the_spins_with_their_unit(
    header: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without them the table is read with an incident spin of zero. `angle` beside `angle after` is the other."""
    ours = read(tmp_path, "v_1 [km/h];theta_1;omega_1 [rpm];v_2 [km/h];theta_2;omega_2 [rpm]" + BOTH_SPINS, "o.csv")
    place = tmp_path / "mine.csv"
    place.write_text(header + BOTH_SPINS, encoding="utf-8")
    assert main(["datasets", "check", str(place)]) == 2
    proposed = re.search(r'pass --columns "(.*?)"', capsys.readouterr().out)
    assert proposed is not None
    assert main(["datasets", "check", str(place), "--columns", proposed[1]]) == 0
    capsys.readouterr()
    assert_same(load_table(place, columns=dict(part.split("=") for part in proposed[1].split(", "))), ours)


def test_columns_of_spin_that_are_left_out_are_named(tmp_path: Path) -> None:
    text = OWN.replace("speed in", "v_1").replace("angle;", "theta_1;").replace("speed after", "v_2")
    table = read(tmp_path, text.replace("angle after", "theta_2") + BOTH_SPINS)
    notes = " ".join(table.remarks)
    assert "no columns omega_1 and omega_2: incident spin is set to 0" in notes
    assert "spin rpm after (to read it as omega_2: columns={'omega_2': 'spin rpm after [rpm]'})" in notes


ENDS = {
    "1": "in inc incident incoming before impact pre initial i 1",
    "2": "out outgoing rebound after post final exit r f 2",
}


def names_of(end: str) -> list[str]:
    quantities = ("v", "theta", "omega", "speed", "angle", "spin", "vx", "v_y", "velocity")
    forms = ("{q}_{w}", "{w}_{q}", "{q}{t}", "{w} {q}", "{q}.{w}", "{t}{q}")
    return [f.format(q=q, w=w, t=w.title()) for q in quantities for w in ENDS[end].split() for f in forms]


@pytest.mark.parametrize("end", ENDS)
def test_a_guess_never_swaps_incidence_and_rebound(end: str) -> None:
    found = 0
    for name in names_of(end):
        guess = guess_of(name)
        assert end_of(name) in (None, end), name
        assert all(item.removesuffix("_sd").endswith(end) for item in guess), name
        found += bool(guess)
    assert found > 0.9 * len(names_of(end))


@pytest.mark.parametrize("name", ["v_72", "v_23", "v_", "V_2+", "theta_", "theta_22", "teta_2"])
def test_a_slip_in_a_name_is_a_fault_and_no_column_of_ones_own(tmp_path: Path, name: str) -> None:
    known, ours = ("v_2", "theta_2")[:: 1 if "t" in name else -1]
    message = f"column '{name}': unknown column; did you mean '{ours}'"
    with pytest.raises(TableError, match=re.escape(message)):
        read(tmp_path, f"v_1,theta_1,{known},{name}\n17,21,11,11\n17,21,11,11\n")


def test_a_slip_that_does_not_say_which_end_is_offered_both(tmp_path: Path) -> None:
    with pytest.raises(TableError, match=r"did you mean 'omega_1' or 'omega_2'\?.*columns="):
        read(tmp_path, "v_1,theta_1,v_2,omega_\n17,21,11,11\n17,21,11,11\n")


@pytest.mark.parametrize("name", ["theta_in", "speed_in", "spin_before", "theta_ni", "tetha_1", "omga_1", "v_incid"])
def test_a_suggestion_never_swaps_incidence_and_rebound(tmp_path: Path, name: str) -> None:
    with pytest.raises(TableError) as caught:
        read(tmp_path, f"{name},v_2\n5,4\n6,5\n")
    hint = str(caught.value).partition("did you mean")[2].partition("?")[0]
    hint += str(caught.value).partition("columns={")[2].partition(":")[0]
    assert not hint.rstrip("' ").endswith("2"), str(caught.value)


def test_the_way_of_a_frame_to_a_fit(tmp_path: Path) -> None:
    """A DataFrame with names of its own is calibrated as the file is, and the notes say what was assumed."""
    frame = pandas.DataFrame({"Vin": [4.0, 6.0, 8.0, 10.0], "v_y2": [3.2, 4.7, 6.1, 7.5]})
    fit = fitball.calibrate(frame, "grip-slip", columns={"v_y1": "Vin"}, point_only=True, cores=1)
    place = tmp_path / "t.csv"
    place.write_text("v_y1,v_y2\n4,3.2\n6,4.7\n8,6.1\n10,7.5\n")
    other = fitball.calibrate(place, "grip-slip", point_only=True, cores=1)
    assert fit.point.values == other.point.values
    assert any("no scene file" in note for note in fit.notes)


def test_a_scene_names_columns_by_texts(tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_text("[columns]\nv_1 = 3\n")
    with pytest.raises(SceneError, match=r"columns\.v_1 = 3: expected a text in quotes"):
        read(tmp_path, FOREIGN)


def test_new_impacts_may_be_named_as_those_of_the_fit() -> None:
    own = {"v_x1": "Vx in", "v_y1": "Vy in [m/s]", "v_x2": "Vx out", "v_y2": "Vy out"}
    measured = pandas.DataFrame(
        {
            "Vx in": [15.0, 14, 13, 12],
            "Vy in": [5.0, 7, 9, 10],
            "Vx out": [10.0, 8.2, 7.1, 6],
            "Vy out": [4.1, 5.5, 7, 7.7],
        }
    )
    fit = fitball.calibrate(measured, columns=own, model="brody", point_only=True, as_read=True)
    new = measured[["Vx in", "Vy in"]]
    found = fit.predict(new)
    named = "named as in the table of the fit: v_x1=Vx in, v_y1=Vy in [m/s]"
    assert any(named in note for note in found.attrs["notes"])
    # The names of the fit, given again, need no rebound; those of the incidence do.
    pandas.testing.assert_frame_equal(found, again := fit.predict(new, columns=own, units={"v_x2": "m/s"}))
    assert "no column 'Vx out' to compare v_x2 with" in again.attrs["notes"]
    with pytest.raises(TableError, match="there is no column 'Vx in' to read as v_x1"):
        fit.predict(new[["Vy in"]], columns=own)
    plainly = fit.predict(new.set_axis(["v_x1", "v_y1"], axis="columns"))
    pandas.testing.assert_frame_equal(found, plainly, check_names=False)
    assert not any("named as in" in note for note in plainly.attrs["notes"])


def test_the_other_way_in_which_a_column_is_counted() -> None:
    """Written out, not asked of the table of columns: speeds and times have none, angles another zero."""
    given = np.array([0.3])
    other = {"v_x1": -0.3, "v_y1": -0.3, "theta_1": np.pi / 2 - 0.3, "omega_1": -0.3}
    other |= {
        "v_x2": -0.3,
        "v_y2": -0.3,
        "theta_2": np.pi / 2 - 0.3,
        "omega_2": -0.3,
        "gap_path": -0.3,
        "gap_turn": -0.3,
    }
    assert set(FLIPPABLE) == set(other)
    for name, wanted in other.items():
        np.testing.assert_allclose(flipped(name, given), wanted)
