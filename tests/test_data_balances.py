"""Model-free balances: against the printed table, against conservation laws, against random draws."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from fitball.data.balances import Balances, scene_balances
from fitball.data.kinematics import Uncertain, velocity
from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.values import Ball, Impacts

# Jafri (2004), Table 7: time-averaged coefficient of friction, as printed.
TABLE_7 = {
    "zero_spin": ("0.502", "0.543", "0.388", "0.303", "0.231", "0.203", "0.141"),
    "topspin": ("0.515", "0.453", "0.284", "0.188", "0.184", "0.114", "0.04"),
    "backspin": ("0.625", "0.516", "0.489", "0.413", "0.373", "0.249", "0.186"),
}
# Entries that the author cut off after three decimals (0.54370, 0.18874, 0.04082, 0.51686, 0.18664)
# where rounding gives the next digit; the other sixteen are rounded.
CUT_OFF = {("zero_spin", 1), ("topspin", 3), ("topspin", 6), ("backspin", 1), ("backspin", 6)}


@pytest.mark.parametrize("spin", TABLE_7)
def test_mean_friction_is_that_of_the_printed_table(spin: str) -> None:
    table = load_table(f"wang_{spin}")
    mu_bar = scene_balances(table, Scene()).mu_bar.values
    for index, printed in enumerate(TABLE_7[spin]):
        thousandths = 1000.0 * mu_bar[index]
        given = round(1000 * float(printed))
        assert round(thousandths) == given + ((spin, index) in CUT_OFF)
        assert int(thousandths) == given or (spin, index) not in CUT_OFF


def test_energy_lost_is_near_the_printed_one() -> None:
    """Table 2 prints kinetic energies in lb in, with an inertia of about 0.00034 lb s^2 in, from v_1 and v_2.

    The speeds differ from the components by up to 0.1 %, in the first row by 1.1 % (its misprint).
    """
    table = load_table("wang_zero_spin")
    pound_inch = 4.4482216152605 * 0.0254
    inertia = 0.00034 * pound_inch
    lost = scene_balances(table, Scene(ball=Ball(0.0576, 0.03302, inertia))).energy_lost.values
    before = np.array([68.181, 73.62, 78.813, 81.436, 79.821, 80.182, 77.475])
    after = np.array([44.823, 45.125, 44.642, 42.721, 40.874, 37.501, 34.921])
    np.testing.assert_allclose(lost, (before - after) * pound_inch, rtol=0.06)
    np.testing.assert_allclose(lost[1:], (before - after)[1:] * pound_inch, rtol=0.02)


def made(tmp_path: Path, header: str, rows: list[tuple[float, ...]], scene: Scene | None = None) -> Balances:
    path = tmp_path / "t.csv"
    path.write_text("\n".join([header, *(",".join(repr(float(x)) for x in row) for row in rows)]))
    return scene_balances(load_table(path), scene or Scene())


FULL = "v_x1,v_y1,omega_1,v_x2,v_y2,omega_2"


def rigid_bounce(
    v_x1: float, v_y1: float, omega_1: float, cor: float, e_x: float, eps: float, ball: Ball
) -> tuple[float, ...]:
    """A rebound made from impulses: the tangential one gives `e_x`, the normal one acts at lever `eps`."""
    normal = ball.mass * (1 + cor) * v_y1
    slip = v_x1 - ball.radius * omega_1
    # J reduces slip by J (1/M + R^2/I), the lever turns the ball by -eps N / I.
    tangential = ((1 + e_x) * slip + ball.radius * eps * normal / ball.inertia) / (
        1 / ball.mass + ball.radius**2 / ball.inertia
    )
    return (
        v_x1,
        v_y1,
        omega_1,
        v_x1 - tangential / ball.mass,
        cor * v_y1,
        omega_1 + (ball.radius * tangential - eps * normal) / ball.inertia,
    )


def test_balances_recover_the_impulses_that_made_a_bounce(tmp_path: Path) -> None:
    ball = Ball(0.058, 0.0335, 3.6e-5)
    rng = np.random.default_rng(3)
    rows, truth = [], []
    for _ in range(20):
        cor, e_x, eps = rng.uniform(0.5, 0.8), rng.uniform(-0.3, 0.3), rng.uniform(-1e-3, 3e-3)
        rows.append(rigid_bounce(rng.uniform(8, 16), rng.uniform(6, 12), rng.uniform(-200, 100), cor, e_x, eps, ball))
        truth.append((cor, e_x, eps))
    got = made(tmp_path, FULL, rows, Scene(ball=ball))
    cor, e_x, eps = np.array(truth).T
    np.testing.assert_allclose(got.cor.values, cor, rtol=1e-13)
    np.testing.assert_allclose(got.e_x.values, e_x, atol=1e-12)
    np.testing.assert_allclose(got.offset.values, eps, atol=1e-14)
    v_x1, v_y1, w1, v_x2, v_y2, w2 = np.array(rows).T
    np.testing.assert_allclose(got.mu_bar.values, (v_x1 - v_x2) / (v_y1 + v_y2), rtol=1e-13)
    energy = [
        0.5 * ball.mass * (x**2 + y**2) + 0.5 * ball.inertia * w**2
        for x, y, w in ((v_x1, v_y1, w1), (v_x2, v_y2, w2))
    ]
    np.testing.assert_allclose(got.energy_lost.values, energy[0] - energy[1], rtol=1e-12)
    np.testing.assert_allclose(got.energy_fraction.values, 1 - energy[1] / energy[0], rtol=1e-12)


def test_uncertainty_against_random_draws() -> None:
    """Small sds, so that the first order is all there is; 200,000 draws know an sd to 0.16 %."""
    table = load_table("wang_all")
    ball, draws = Ball(), 200_000
    rng = np.random.default_rng(11)
    got = scene_balances(table, Scene(velocity_sd=0.01, spin_sd=0.4))
    m = {item.name: item.values for item in table.measurements}
    x2, y2 = (m[name] + 0.01 * rng.standard_normal((draws, 21)) for name in ("v_x2", "v_y2"))
    w2 = m["omega_2"] + 0.4 * rng.standard_normal((draws, 21))
    x1, y1, w1 = table.impacts.v_x1, table.impacts.v_y1, table.impacts.omega_1
    lost = 0.5 * ball.mass * (x1**2 + y1**2 - x2**2 - y2**2) + 0.5 * ball.inertia * (w1**2 - w2**2)
    sampled = {
        "mu_bar": (x1 - x2) / (y1 + y2),
        "e_x": -(x2 - ball.radius * w2) / (x1 - ball.radius * w1),
        "offset": (ball.mass * ball.radius * (x1 - x2) - ball.inertia * (w2 - w1)) / (ball.mass * (y1 + y2)),
        "cor": y2 / y1,
        "energy_lost": lost,
        "energy_fraction": lost / (0.5 * ball.mass * (x1**2 + y1**2) + 0.5 * ball.inertia * w1**2),
    }
    assert set(sampled) == {item.name for item in got.all}
    for item in got.all:
        np.testing.assert_allclose(item.sd, sampled[item.name].std(axis=0), rtol=0.01, err_msg=item.name)


def test_an_incident_sd_counts_where_it_is_stated(tmp_path: Path) -> None:
    plain = made(tmp_path, FULL, [(12, 5, 0, 9, 4, 200)] * 2)
    stated = made(tmp_path, f"{FULL},v_y1_sd", [(12, 5, 0, 9, 4, 200, 0.3)] * 2)
    np.testing.assert_allclose(plain.cor.sd, 0.25 / 5, rtol=1e-13)
    np.testing.assert_allclose(stated.cor.sd, np.hypot(0.25 / 5, 4 * 0.3 / 25), rtol=1e-13)


def test_where_each_sd_comes_from(tmp_path: Path) -> None:
    scene = Scene(velocity_sd=0.1)
    got = made(tmp_path, f"{FULL},v_y2_sd", [(12, 5, 0, 9, 4, 200, 0.5)] * 2, scene)
    # v_x2 from the scene, v_y2 from the table.
    np.testing.assert_allclose(got.mu_bar.sd, np.hypot(0.1 / 9.0, 3.0 * 0.5 / 81.0), rtol=1e-13)
    # The spin has its nominal noise.
    radius = scene.ball.radius
    np.testing.assert_allclose(got.e_x.sd, np.hypot(0.1, radius * scene.nominal_spin_sd) / 12.0, rtol=1e-13)
    np.testing.assert_allclose(got.cor.sd, 0.1, rtol=1e-13)


def test_polar_columns_give_the_same_balances(tmp_path: Path) -> None:
    angle, speed = np.degrees(np.arctan2(4, 9)), np.hypot(9, 4)
    by_parts = made(tmp_path, FULL, [(12, 5, 0, 9, 4, 200)] * 2)
    polar = made(tmp_path, "v_x1,v_y1,omega_1,v_2,theta_2,omega_2", [(12, 5, 0, speed, angle, 200)] * 2)
    for one, other in zip(by_parts.all, polar.all, strict=True):
        np.testing.assert_allclose(one.values, other.values, rtol=1e-12, err_msg=one.name)
        # isotropic noise is the same noise in either pair of coordinates
        np.testing.assert_allclose(one.sd, other.sd, rtol=1e-12, err_msg=one.name)


@pytest.mark.parametrize("pair", ["v_x2,theta_2", "v_y2,theta_2", "v_x2,v_2"])
def test_mixed_columns_give_the_same_values(tmp_path: Path, pair: str) -> None:
    cells = {"v_x2": 9.0, "v_y2": 4.0, "v_2": float(np.hypot(9, 4)), "theta_2": float(np.degrees(np.arctan2(4, 9)))}
    by_parts = made(tmp_path, FULL, [(12, 5, 0, 9, 4, 200)] * 2)
    row = (12, 5, 0, *(cells[name] for name in pair.split(",")), 200)
    mixed = made(tmp_path, f"v_x1,v_y1,omega_1,{pair},omega_2", [row] * 2)
    for one, other in zip(by_parts.all, mixed.all, strict=True):
        np.testing.assert_allclose(one.values, other.values, rtol=1e-12, err_msg=one.name)
        assert np.isfinite(other.sd).all()


def test_little_incident_slip_makes_e_x_uncertain_and_none_makes_it_absent(tmp_path: Path) -> None:
    radius = 0.03302
    rows = [(5.0 + u, 10.0, 5.0 / radius, 4.0, 7.0, 120.0) for u in (1.0, 0.1, 0.001)]
    got = made(tmp_path, FULL, [*rows, (0.0, 10.0, 0.0, 0.1, 7.0, 1.0)])
    expected = np.hypot(0.25, radius * 10.0) / np.array([1.0, 0.1, 0.001])
    np.testing.assert_allclose(got.e_x.sd[:3], expected, rtol=1e-6)
    assert np.isnan(got.e_x.values[3]) and np.isnan(got.e_x.sd[3])
    assert got.e_x.reasons[:3] == ("", "", "") and "arrives without slip" in got.e_x.reasons[3]
    rows = list(got.rows())
    row = rows[3]
    assert row["e_x"] == row["e_x_sd"] == "" and "arrives without slip" in row["remark"]
    assert row["cor"] == "0.7" and next(got.rows())["remark"] == ""


def test_a_drop_test_knows_restitution_and_energy_only(tmp_path: Path) -> None:
    got = made(tmp_path, "v_y1,v_y2", [(4, 3), (8, 5)])
    np.testing.assert_allclose(got.cor.values, [0.75, 0.625])
    np.testing.assert_allclose(got.energy_lost.values, 0.5 * 0.0576 * np.array([7.0, 39.0]))
    np.testing.assert_allclose(got.energy_fraction.values, 1 - np.array([0.75, 0.625]) ** 2)
    np.testing.assert_allclose(got.energy_fraction.sd, 2 * got.cor.values * got.cor.sd)
    assert [item.name for item in got.all if item.known] == ["cor", "energy_lost", "energy_fraction"]


@pytest.mark.parametrize(
    ("columns", "known"),
    [
        ("v_x1,v_y1,omega_1,v_x2,v_y2", "mu_bar cor"),
        ("v_x1,v_y1,omega_1,v_x2,omega_2", "e_x"),
        ("v_x1,v_y1,omega_1,v_y2,omega_2", "cor"),
        ("v_x1,v_y1,omega_1,v_2,omega_2", "energy_lost energy_fraction"),
        ("v_x1,v_y1,omega_1,v_y2,v_2,omega_2", "cor energy_lost energy_fraction"),
        ("v_y1,omega_1,v_y2", "cor"),
        ("v_x1,v_y1,omega_1,omega_2", ""),
        ("v_x1,v_y1,contact_time", ""),
        ("v_x1,v_y1,theta_2", ""),
    ],
)
def test_what_was_not_measured_is_absent_with_a_reason(tmp_path: Path, columns: str, known: str) -> None:
    cells = {"v_x1": 12, "v_y1": 5, "omega_1": 0, "v_x2": 9, "v_y2": 4, "v_2": 9.85, "omega_2": 200}
    cells |= {"contact_time": 0.005, "theta_2": 24}
    got = made(tmp_path, columns, [tuple(cells[name] for name in columns.split(","))] * 2)
    assert [item.name for item in got.all if item.known] == known.split()
    for item in got.all:
        assert np.isfinite(item.values).all() == item.known
        assert all(item.reasons) != item.known


def test_steep_angles_beside_one_component_do_not_break(tmp_path: Path) -> None:
    got = made(tmp_path, "v_x1,v_y1,omega_1,v_x2,theta_2,omega_2", [(1, 10, 0, 0.0, 90, 20), (2, 10, 0, 1.0, 80, 20)])
    assert got.cor.reasons[1] == ""
    assert got.cor.reasons[0] != "" or got.cor.sd[0] > 1e6


def test_bundled_scene_and_frozen_arrays() -> None:
    got = scene_balances(load_table("wang_all"), load_scene("wang_all"))
    assert len(list(got.rows())) == 21
    assert list(next(got.rows()))[:4] == ["id", "mu_bar", "mu_bar_sd", "e_x"]
    assert "offset [m]" in next(got.rows()) and "energy_lost_sd [J]" in next(got.rows())
    assert (got.energy_fraction.values > 0).all() and (got.energy_fraction.values < 1).all()
    for item in got.all:
        with pytest.raises(ValueError, match="read-only"):
            item.values[0] = 0.0
    with pytest.raises(dataclasses.FrozenInstanceError):
        got.ids = ()  # type: ignore[misc]


def test_an_input_used_twice_is_one_input() -> None:
    x = Uncertain.measured("x", np.array([3.0]), np.array([0.1]))
    y = Uncertain.measured("y", np.array([4.0]), np.array([0.2]))
    np.testing.assert_allclose((x - x).sd, 0.0)
    np.testing.assert_allclose((x / x).sd, 0.0, atol=1e-16)
    np.testing.assert_allclose((x * x).sd, 0.6)
    np.testing.assert_allclose((x + y).sd, np.hypot(0.1, 0.2))
    np.testing.assert_allclose((x * x + y * y).sqrt().sd, np.hypot(3 * 0.1, 4 * 0.2) / 5)


def test_speed_and_angle_and_components_say_the_same_with_the_same_deviations() -> None:
    """There and back, over all four quarters but the court itself: numbers, and sds where both are propagated."""
    speed, angle = np.array([3.0, 20.0, 55.0]), np.array([0.3, 1.7, 2.9])
    known = {
        "v_2": Uncertain.measured("v_2", speed, np.full(3, 0.2)),
        "theta_2": Uncertain.measured("theta_2", angle, np.full(3, 0.01)),
    }
    there = velocity(known, "2").columns("2")
    impacts = Impacts.polar(speed, angle, np.zeros(3))
    np.testing.assert_allclose(there["v_x2"].value, impacts.v_x1, rtol=1e-15)
    np.testing.assert_allclose((impacts.speed, impacts.angle), (speed, angle), rtol=1e-14)
    back = velocity({name: there[name] for name in ("v_x2", "v_y2")}, "2").columns("2")
    for name, item in known.items():
        np.testing.assert_allclose(back[name].value, item.value, rtol=1e-14)
        np.testing.assert_allclose(back[name].sd, item.sd, rtol=1e-12)
    # At worst roundings add up, in size.
    wanted = 0.2 * np.abs(np.cos(angle)) + 0.01 * np.abs(speed * np.sin(angle))
    np.testing.assert_allclose(there["v_x2"].reach, wanted, rtol=1e-14)
