"""Three components of a velocity: reduced to the plane of incidence, or refused with how to."""

import numpy as np
import pytest
from made_tables import written
from numpy.testing import assert_allclose

import fitball
from fitball.base.errors import InputError

ROWS = 14


def planar(seed=1):
    """Impacts (rows,) that slide: friction 0.6, vertical restitution 0.75, spin of a tennis ball of
    33 mm and inertia ratio 0.55 without any offset.
    """
    rng = np.random.default_rng(seed)
    v_x1 = rng.uniform(20.0, 32.0, ROWS)
    v_y1 = rng.uniform(4.0, 9.0, ROWS)
    omega_1 = rng.uniform(-100.0, 100.0, ROWS)
    v_x2 = v_x1 - 0.6 * 1.75 * v_y1
    omega_2 = omega_1 + (v_x1 - v_x2) / (0.55 * 0.033)
    rebound = {"v_x2": v_x2, "v_y2": 0.75 * v_y1, "omega_2": omega_2}
    return {"v_x1": v_x1, "v_y1": v_y1, "omega_1": omega_1, **rebound}


def in_space(table, azimuth, up="z", across=0.0):
    """Columns of the same impacts in right-handed axes with `up` upwards, in directions of these
    azimuths (rows,) [rad] from x; `across` is a sideways rebound speed [m/s]. The vector of topspin
    is up x track.
    """
    cos = np.cos(azimuth)
    sin = np.sin(azimuth)
    # The second horizontal axis is up x (x axis).
    second, sign = ("y", 1.0) if up == "z" else ("z", -1.0)
    spatial = {}
    for end, side in (("1", 0.0), ("2", across)):
        along = table[f"v_x{end}"]
        spatial[f"v_x{end}"] = along * cos - side * sin
        spatial[f"v_{second}{end}"] = sign * (along * sin + side * cos)
        spatial[f"v_{up}{end}"] = table[f"v_y{end}"] * (-1.0 if end == "1" else 1.0)
        spin = table[f"omega_{end}"]
        spatial[f"omega_x{end}"] = -spin * sin
        spatial[f"omega_{second}{end}"] = sign * spin * cos
        spatial[f"omega_{up}{end}"] = np.full(ROWS, 30.0)
    return spatial


def without_spins(table):
    return {name: column for name, column in table.items() if "omega" not in name}


def assert_planar(table, wanted, names=("v_x1", "v_y1", "v_x2", "v_y2")):
    for name in names:
        assert_allclose(table.values[name], wanted[name], rtol=1e-12, err_msg=name)


def codes_of(table):
    return [note.code for note in table.notices]


def refusal_of(source, **reading):
    with pytest.raises(InputError) as caught:
        fitball.load_table(source, **reading)
    return caught.value


AZIMUTHS = {
    "to one side": np.linspace(0.1, 0.4, ROWS),
    "to both sides": np.linspace(-0.4, 0.4, ROWS),
    "backwards": np.linspace(2.6, 3.6, ROWS),
    "anywhere": np.linspace(0.0, 6.0, ROWS),
}


@pytest.mark.parametrize("up", ["z", "y"])
@pytest.mark.parametrize("azimuth", AZIMUTHS)
@pytest.mark.parametrize("spins", [True, False])
def test_three_components_are_reduced_to_the_plane_of_incidence(up, azimuth, spins):
    wanted = planar()
    spatial = in_space(wanted, AZIMUTHS[azimuth], up, across=0.3)
    table = fitball.load_table(spatial if spins else without_spins(spatial))
    assert_planar(table, wanted)
    assert "plane-of-incidence" in codes_of(table)
    assert {*table.labels} == {"id"}
    assert ("omega_2" in table.values) == spins
    if spins:
        assert_planar(table, wanted, ("omega_1", "omega_2"))


def test_an_axis_that_points_down(tmp_path):
    wanted = planar()
    spatial = in_space(wanted, AZIMUTHS["to both sides"])
    # Turned by half a turn about x, the axes are right-handed still.
    for name in spatial:
        if "y" in name or "z" in name:
            spatial[name] = -spatial[name]
    table = fitball.load_table(spatial)
    assert_planar(table, wanted, [*wanted])


def test_friction_of_a_table_in_space_is_that_of_its_plane():
    """All slide: mu = (v_x1 - v_x2)/(v_y1 + v_y2) = 0.6."""
    spatial = without_spins(in_space(planar(), AZIMUTHS["to one side"]))
    values = fitball.load_table(spatial).values
    mu = (values["v_x1"] - values["v_x2"]) / (values["v_y1"] + values["v_y2"])
    assert_allclose(mu, 0.6, rtol=1e-12)


def test_units_and_errors_come_along(tmp_path):
    wanted = planar()
    spatial = without_spins(in_space(wanted, AZIMUTHS["to one side"]))
    table = {}
    for name, column in spatial.items():
        table[f"{name} [km/h]"] = 3.6 * column
        sd = {"v_x": 0.36, "v_y": 0.36, "v_z": 0.72}[name[:3]]
        table[f"{name}_sd"] = np.full(ROWS, sd)
    read = fitball.load_table(table)
    assert_planar(read, wanted)
    for name, sd in (("v_x1", 0.1), ("v_x2", 0.1), ("v_y1", 0.2), ("v_y2", 0.2)):
        assert_allclose(read.sd[name], sd, rtol=1e-12)


def test_a_topspin_beside_three_components_is_topspin():
    wanted = planar()
    spatial = without_spins(in_space(wanted, AZIMUTHS["to one side"]))
    spatial |= {name: wanted[name] for name in ("omega_1", "omega_2")}
    table = fitball.load_table(spatial)
    assert_planar(table, wanted, [*wanted])
    (note,) = table.notices
    assert "topspin" in note.text


@pytest.mark.parametrize("shift", [0.0, 0.3])
def test_a_coordinate_that_hardly_moves_is_no_third_one(shift):
    wanted = without_spins(planar())
    rng = np.random.default_rng(2)
    third = {f"v_z{end}": shift + 0.05 * rng.standard_normal(ROWS) for end in "12"}
    table = fitball.load_table(wanted | third)
    assert_planar(table, wanted)
    assert codes_of(table) == ["plane-of-incidence"]


def test_what_is_not_determined_is_refused():
    wanted = planar()
    spatial = without_spins(in_space(wanted, AZIMUTHS["to one side"]))
    positive = {name: np.abs(column) for name, column in spatial.items()}
    turned = positive | {"v_y2": -positive["v_y2"], "v_z2": -positive["v_z2"]}
    lacking = {name: column for name, column in spatial.items() if name != "v_y2"}
    correlated = spatial | {"v_x2_sd": [0.1] * ROWS, "v_z2_sd": [0.1] * ROWS}
    correlated["corr(v_x2,v_y2)"] = [0.1] * ROWS
    some_spins = spatial | {"omega_y1": wanted["omega_1"]}
    for columns in (positive, turned, lacking, correlated, some_spins):
        assert refusal_of(columns).code == "three-coordinates"
    # The remedy.
    assert len(fitball.load_table(positive, ignore="v_z1,v_z2,v_y2")) == ROWS


def test_names_of_ones_own_are_proposed_with_the_third_and_then_reduced():
    wanted = planar()
    spatial = without_spins(in_space(wanted, AZIMUTHS["to both sides"]))
    names = {name: f"V{name[2]} {'in' if name[3] == '1' else 'out'}" for name in spatial}
    own = {names[name]: column for name, column in spatial.items()}
    message = " ".join(str(refusal_of(own)).split())
    assert "v_y1=Vy in" in message
    assert "v_z1=Vz in" in message
    table = fitball.load_table(own, columns=names)
    assert_planar(table, wanted)


@pytest.mark.parametrize("azimuth", ["to one side", "to both sides"])
@pytest.mark.parametrize("word", ["lateral", "lat", "side"])
def test_a_sideways_component_leaves_the_vertical_as_it_is(azimuth, word):
    wanted = planar()
    spatial = without_spins(in_space(wanted, AZIMUTHS[azimuth], "y"))
    for end in "12":
        spatial[f"v_y{end}"] = np.abs(spatial[f"v_y{end}"])
        spatial[f"v_{word}{end}"] = spatial.pop(f"v_z{end}")
    assert_planar(fitball.load_table(spatial), wanted)


@pytest.mark.parametrize("ends", [{"1": "_in", "2": "_out"}, {"1": "1", "2": "2"}])
def test_u_v_and_w_are_proposed_as_components(ends):
    wanted = planar()
    spatial = without_spins(in_space(wanted, AZIMUTHS["to both sides"]))
    letters = dict(zip("xyz", "uvw", strict=True))
    names = {name: f"{letters[name[2]]}{ends[name[3]]}" for name in spatial}
    own = {names[name]: column for name, column in spatial.items()}
    message = " ".join(str(refusal_of(own)).split())
    assert ",".join(f"{ours}={their}" for ours, their in names.items()) in message
    with_units = {f"{their} [m/s]": column for their, column in own.items()}
    codes = {fault.code for fault in refusal_of(with_units).faults}
    assert codes <= {"no-incident", "no-rebound"}
    assert_planar(fitball.load_table(own, columns=names), wanted)


def test_a_component_beside_speed_and_angle_is_not_proposed():
    wanted = planar()
    polar = {}
    for end in "12":
        polar[f"v_{end}"] = np.hypot(wanted[f"v_x{end}"], wanted[f"v_y{end}"])
        angle = np.arctan2(wanted[f"v_y{end}"], wanted[f"v_x{end}"])
        polar[f"theta_{end}"] = np.degrees(angle)
    table = fitball.load_table(polar | {"v_z1": wanted["v_x1"] / 7.0})
    assert codes_of(table) == ["not-used"]


def test_x_and_z_alone_are_a_plane():
    wanted = without_spins(planar())
    named_z = {name.replace("y", "z"): column for name, column in wanted.items()}
    message = str(refusal_of(named_z))
    assert "v_y1=v_z1" in message
    columns = {"v_y1": "v_z1", "v_y2": "v_z2"}
    assert_planar(fitball.load_table(named_z, columns=columns), wanted)


def test_a_table_of_text_in_three_dimensions(tmp_path):
    """Two impacts of a right-handed frame with z upwards, by hand: 3, 4, 5."""
    head = "v_x1 [m/s],v_y1 [m/s],v_z1 [m/s],v_x2 [m/s],v_y2 [m/s],v_z2 [m/s]"
    path = written(tmp_path, f"{head}\n3,4,-5,1.5,2,4\n-3,4,-5,-0.6,0.8,3\n")
    table = fitball.load_table(path)
    assert_allclose(table.values["v_x1"], [5.0, 5.0])
    assert_allclose(table.values["v_x2"], [2.5, 1.0])
    assert_allclose(table.values["v_y1"], [5.0, 5.0])
    assert_allclose(table.values["v_y2"], [4.0, 3.0])
