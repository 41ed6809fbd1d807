"""Components, propagated errors and balances: printed tables, conservation laws, random draws."""

import numpy as np
import pytest
from made_tables import bundled, impact_table
from numpy.testing import assert_allclose
from support import misread

from fitball.base.values import Ball
from fitball.data.balances import BALANCES, impact_balances
from fitball.data.bundled import printed_table
from fitball.data.kinematics import results_and_slopes, velocity

FULL = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")


def heading(name, end=""):
    """Of a column of balances, with its unit in brackets where it has one."""
    unit = BALANCES[name]
    bracket = f" [{unit}]" if unit else ""
    return name + end + bracket


def test_any_two_columns_give_the_velocity():
    """In both directions along the court; from v_y and speed the direction stays open."""
    speed = np.array([3.0, 20.0, 55.0])
    angle = np.array([0.3, 1.7, 2.9])
    full = {
        "v_x2": speed * np.cos(angle),
        "v_y2": speed * np.sin(angle),
        "v_2": speed,
        "theta_2": angle,
    }
    for pair in (
        ("v_x2", "v_y2"),
        ("v_2", "theta_2"),
        ("v_x2", "theta_2"),
        ("v_y2", "theta_2"),
        ("v_x2", "v_2"),
    ):
        completed = velocity({name: full[name] for name in pair}, "2")
        for name, column in full.items():
            assert_allclose(completed[name], column, rtol=1e-13, err_msg=f"{name} of {pair}")
    without_direction = {"v_y2": full["v_y2"], "v_2": full["v_2"]}
    assert "v_x2" not in velocity(without_direction, "2")
    impossible = {"v_x2": np.array([2.0]), "v_2": np.array([1.0])}
    assert np.isnan(velocity(impossible, "2")["v_y2"]).all()


def test_slopes_through_angle_and_speed_are_exact():
    x = np.array([-5.0, 0.7, 40.0])
    y = np.array([3.0, 9.0, 0.2])
    results, rates = results_and_slopes(
        lambda columns: velocity(columns, "2"), {"v_x2": x, "v_y2": y}
    )
    by_name = {name: rates[:, k] for k, name in enumerate(results)}
    square = x**2 + y**2
    of_angle = np.column_stack([-y / square, x / square])
    assert_allclose(by_name["theta_2"], of_angle, rtol=1e-14)
    speed = np.sqrt(square)
    of_speed = np.column_stack([x / speed, y / speed])
    assert_allclose(by_name["v_2"], of_speed, rtol=1e-14)


def test_mean_friction_is_that_of_the_printed_table():
    """Jafri (2004), Table 7, to its digits; five entries are cut off after three decimals, not
    rounded.
    """
    table = printed_table("table_7")
    for spin in ("zero", "topspin", "backspin"):
        name = "wang_zero_spin" if spin == "zero" else f"wang_{spin}"
        result = impact_balances(bundled(name, FULL), Ball())
        # In units of the last printed digit.
        friction = 1000.0 * result["mu_bar"].to_numpy()
        entries = 1000.0 * table[spin].to_numpy(dtype=float)
        rounded = np.abs(friction - entries) <= 0.5 + 1e-9
        cut_off = np.floor(friction) == np.round(entries)
        assert np.all(rounded | cut_off)


def test_energy_lost_is_that_of_the_printed_table():
    """Table 2 prints energies in lb in, with an inertia of about 0.00034 lb s^2 in; v_1 of row 1 is
    wrong by 1 %.
    """
    table = printed_table("table_2")
    unit = 4.4482216152605 * 0.0254
    ball = Ball(inertia_ratio=0.00034 * unit / (0.0576 * 0.03302**2))
    lost = impact_balances(bundled("wang_zero_spin", FULL), ball)["energy_lost [J]"]
    before = table["energy_1 [lb in]"].to_numpy() * unit
    after = table["energy_2 [lb in]"].to_numpy() * unit
    entries = before - after
    assert_allclose(lost[1:], entries[1:], rtol=0.02)
    assert_allclose(lost[:1], entries[:1], rtol=0.06)


def test_balances_recover_the_impulses_that_made_a_bounce():
    ball = Ball(0.058, 0.0335, 0.55)
    rng = np.random.default_rng(3)
    cor = rng.uniform(0.5, 0.8, 20)
    e_x = rng.uniform(-0.3, 0.3, 20)
    eps = rng.uniform(-1e-3, 3e-3, 20)
    before = [
        rng.uniform(8, 16, 20),
        rng.uniform(6, 12, 20),
        rng.uniform(-200, 100, 20),
    ]
    body = (ball.mass, ball.radius, ball.inertia_ratio)
    after = misread.bounce(*before, body, (99.0, e_x, eps, cor, 0.0))
    columns = dict(zip(FULL, (*before, *after), strict=True))
    result = impact_balances(impact_table(columns), ball)
    assert_allclose(result["cor"], cor, rtol=1e-13)
    assert_allclose(result["e_x"], e_x, atol=1e-12)
    assert_allclose(result["offset [m]"], eps, atol=1e-14)

    def energy(v_x, v_y, omega):
        rotation = ball.inertia_ratio * (ball.radius * omega) ** 2
        return 0.5 * ball.mass * (v_x**2 + v_y**2 + rotation)

    energy_1 = energy(*before)
    energy_2 = energy(*after)
    assert_allclose(result["energy_lost [J]"], energy_1 - energy_2, rtol=1e-12)
    assert_allclose(result["energy_fraction"], 1 - energy_2 / energy_1, rtol=1e-12)


POLAR = {
    "v_1": 17.0,
    "theta_1": 0.31,
    "omega_1": 20.0,
    "v_2": 12.1,
    "theta_2": 0.37,
    "omega_2": 250.0,
}
SMALL = {
    "v_1": 0.02,
    "theta_1": 0.001,
    "omega_1": 0.5,
    "v_2": 0.02,
    "theta_2": 0.001,
    "omega_2": 0.8,
}


def test_sds_are_those_of_random_draws_of_the_whole_row():
    """Errors of all columns belong together: 200,000 draws know an sd to 0.2 %, without
    correlations another.
    """
    names = [*POLAR]
    rng = np.random.default_rng(5)
    corr = np.corrcoef(rng.standard_normal((6, 7)))
    pairs = {}
    for j in range(6):
        for i in range(j):
            pairs[names[i], names[j]] = corr[i, j]
    sds = np.array([SMALL[name] for name in names])
    covariance = corr * np.outer(sds, sds)
    draws = rng.multivariate_normal([*POLAR.values()], covariance, 200_000)
    sample = impact_balances(impact_table(dict(zip(names, draws.T, strict=True))), Ball())
    correlated = impact_balances(impact_table(POLAR, SMALL, pairs), Ball())
    uncorrelated = impact_balances(impact_table(POLAR, SMALL, {}), Ball())
    apart = 0
    for name in BALANCES:
        sd = sample[heading(name)].std()
        column = heading(name, "_sd")
        assert correlated[column].iloc[0] == pytest.approx(sd, rel=0.01), name
        ratio = uncorrelated[column].iloc[0] / sd
        apart += abs(ratio - 1.0) > 0.1
    assert apart >= 3


IMPACT = {
    "v_x1": 12.0,
    "v_y1": 5.0,
    "omega_1": 0.0,
    "v_x2": 9.0,
    "v_y2": 4.0,
    "omega_2": 200.0,
}


def test_noise_is_that_of_columns_that_state_none():
    table = impact_table(IMPACT, {"v_y2": 0.5})
    result = impact_balances(table, Ball(), {"v_x2": 0.1, "v_y2": 9.0})
    # mu_bar = 3/9 here: by v_x2 it changes with 1/9, by v_y2 with 3/81.
    sd_of_friction = np.hypot(0.1 / 9.0, 3.0 * 0.5 / 81.0)
    assert result["mu_bar_sd"].iloc[0] == pytest.approx(sd_of_friction, rel=1e-13)
    assert result["cor_sd"].iloc[0] == pytest.approx(0.5 / 5.0, rel=1e-13)
    # Of the spin nothing is known: what contains it has no sd.
    assert np.isfinite(result["e_x"].iloc[0])
    assert np.isnan(result["e_x_sd"].iloc[0])
    assert result["energy_lost_sd [J]"].isna().all()


@pytest.mark.parametrize(
    ("columns", "determined"),
    [
        ("v_x1 v_y1 omega_1 v_x2 v_y2", "cor mu_bar"),
        ("v_x1 v_y1 omega_1 v_x2 omega_2", "e_x"),
        ("v_x1 v_y1 omega_1 v_y2 v_2 omega_2", "cor energy_lost energy_fraction"),
        ("v_y1 omega_1 v_y2", "cor"),
        ("v_y1 v_y2", "cor energy_lost energy_fraction"),
        ("v_x1 v_y1 contact_time", ""),
    ],
)
def test_what_the_columns_do_not_determine_is_absent(columns, determined):
    values = {**IMPACT, "v_2": 9.85, "contact_time": 5e-3}
    table = impact_table({name: values[name] for name in columns.split()})
    result = impact_balances(table, Ball())
    numbers = [name for name in BALANCES if result[heading(name)].notna().all()]
    assert numbers == determined.split()


def test_a_gap_and_a_ball_without_slip_leave_the_rest():
    values = {**IMPACT, "v_x1": [12.0, 0.0], "omega_2": [np.nan, 200.0]}
    result = impact_balances(impact_table(values, dict.fromkeys(values, 0.1)), Ball())
    assert result["cor"].notna().all()
    assert result["cor_sd"].notna().all()
    assert result["offset [m]"].isna().tolist() == [True, False]
    assert result["offset_sd [m]"].isna().tolist() == [True, False]
    assert result["e_x"].isna().all()
