"""Components, propagated errors and balances: printed tables, conservation laws, random draws."""

import numpy as np
import pytest
from made_tables import bundled, made
from support import misread

from fitball.base.values import Ball
from fitball.data.balances import BALANCES, balances
from fitball.data.bundled import printed
from fitball.data.kinematics import slopes, velocity

FULL = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")


def test_any_two_columns_give_the_velocity():
    """In both directions along the court; from v_y and speed the direction stays open."""
    speed = np.array([3.0, 20.0, 55.0])
    angle = np.array([0.3, 1.7, 2.9])
    whole = {
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
        found = velocity({name: whole[name] for name in pair}, "2")
        for name, column in whole.items():
            np.testing.assert_allclose(found[name], column, rtol=1e-13, err_msg=f"{name} of {pair}")
    assert "v_x2" not in velocity({name: whole[name] for name in ("v_y2", "v_2")}, "2")
    assert np.isnan(velocity({"v_x2": np.array([2.0]), "v_2": np.array([1.0])}, "2")["v_y2"]).all()


def test_slopes_through_angle_and_speed_are_exact():
    x = np.array([-5.0, 0.7, 40.0])
    y = np.array([3.0, 9.0, 0.2])
    results, found = slopes(lambda known: velocity(known, "2"), {"v_x2": x, "v_y2": y})
    square = x**2 + y**2
    by = {name: found[:, k] for k, name in enumerate(results)}
    np.testing.assert_allclose(by["theta_2"], np.stack([-y / square, x / square], 1), rtol=1e-14)
    np.testing.assert_allclose(
        by["v_2"],
        np.stack([x, y], 1) / np.sqrt(square)[:, None],
        rtol=1e-14,
    )


def test_mean_friction_is_that_of_the_printed_table():
    """Jafri (2004), Table 7, to its digits; five entries are cut off after three decimals, not
    rounded.
    """
    table = printed("table_7")
    for spin in ("zero", "topspin", "backspin"):
        name = "wang_zero_spin" if spin == "zero" else f"wang_{spin}"
        found = 1000.0 * balances(bundled(name, FULL), Ball())["mu_bar"].to_numpy()
        wanted = 1000.0 * table[spin].to_numpy(dtype=float)
        assert np.all(
            (np.abs(found - wanted) <= 0.5 + 1e-9) | (np.floor(found) == np.round(wanted))
        )


def test_energy_lost_is_that_of_the_printed_table():
    """Table 2 prints energies in lb in, with an inertia of about 0.00034 lb s^2 in; v_1 of row 1 is
    wrong by 1 %.
    """
    table = printed("table_2")
    unit = 4.4482216152605 * 0.0254
    ball = Ball(inertia_ratio=0.00034 * unit / (0.0576 * 0.03302**2))
    found = balances(bundled("wang_zero_spin", FULL), ball)["energy_lost [J]"]
    wanted = (table["energy_1 [lb in]"] - table["energy_2 [lb in]"]).to_numpy() * unit
    np.testing.assert_allclose(found[1:], wanted[1:], rtol=0.02)
    np.testing.assert_allclose(found[:1], wanted[:1], rtol=0.06)


def test_balances_recover_the_impulses_that_made_a_bounce():
    ball = Ball(0.058, 0.0335, 0.55)
    rng = np.random.default_rng(3)
    cor = rng.uniform(0.5, 0.8, 20)
    e_x = rng.uniform(-0.3, 0.3, 20)
    eps = rng.uniform(-1e-3, 3e-3, 20)
    before = rng.uniform(8, 16, 20), rng.uniform(6, 12, 20), rng.uniform(-200, 100, 20)
    after = misread.bounce(
        *before,
        (ball.mass, ball.radius, ball.inertia_ratio),
        (99.0, e_x, eps, cor, 0.0),
    )
    columns = dict(zip(FULL, (*before, *after), strict=True))
    found = balances(made(columns), ball)
    np.testing.assert_allclose(found["cor"], cor, rtol=1e-13)
    np.testing.assert_allclose(found["e_x"], e_x, atol=1e-12)
    np.testing.assert_allclose(found["offset [m]"], eps, atol=1e-14)
    x, y, w = (
        np.array([columns[f"{name}{end}"] for end in "12"]) for name in ("v_x", "v_y", "omega_")
    )
    energy = 0.5 * ball.mass * (x**2 + y**2 + ball.inertia_ratio * (ball.radius * w) ** 2)
    np.testing.assert_allclose(found["energy_lost [J]"], energy[0] - energy[1], rtol=1e-12)
    np.testing.assert_allclose(found["energy_fraction"], 1 - energy[1] / energy[0], rtol=1e-12)


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
    pairs = {(names[i], names[j]): corr[i, j] for j in range(6) for i in range(j)}
    sds = np.array([SMALL[name] for name in names])
    drawn = rng.multivariate_normal([*POLAR.values()], corr * np.outer(sds, sds), 200_000)
    sample = balances(made(dict(zip(names, drawn.T, strict=True))), Ball())
    found, alone = (
        balances(made(POLAR, SMALL, pairs if given else {}), Ball()) for given in (True, False)
    )
    apart = 0
    for name, unit in BALANCES.items():
        bracket = f" [{unit}]" if unit else ""
        sd = sample[name + bracket].std()
        assert found[f"{name}_sd{bracket}"].iloc[0] == pytest.approx(sd, rel=0.01), name
        apart += abs(alone[f"{name}_sd{bracket}"].iloc[0] / sd - 1.0) > 0.1
    assert apart >= 3


def test_noise_is_that_of_columns_that_state_none():
    values = dict(zip(FULL, (12.0, 5.0, 0.0, 9.0, 4.0, 200.0), strict=True))
    found = balances(made(values, {"v_y2": 0.5}), Ball(), {"v_x2": 0.1, "v_y2": 9.0})
    assert found["mu_bar_sd"].iloc[0] == pytest.approx(
        np.hypot(0.1 / 9.0, 3.0 * 0.5 / 81.0),
        rel=1e-13,
    )
    assert found["cor_sd"].iloc[0] == pytest.approx(0.5 / 5.0, rel=1e-13)
    # Of the spin nothing is known: what contains it has no sd.
    assert np.isfinite(found["e_x"].iloc[0])
    assert np.isnan(found["e_x_sd"].iloc[0])
    assert found["energy_lost_sd [J]"].isna().all()


@pytest.mark.parametrize(
    ("columns", "known"),
    [
        ("v_x1 v_y1 omega_1 v_x2 v_y2", "cor mu_bar"),
        ("v_x1 v_y1 omega_1 v_x2 omega_2", "e_x"),
        ("v_x1 v_y1 omega_1 v_y2 v_2 omega_2", "cor energy_lost energy_fraction"),
        ("v_y1 omega_1 v_y2", "cor"),
        ("v_y1 v_y2", "cor energy_lost energy_fraction"),
        ("v_x1 v_y1 contact_time", ""),
    ],
)
def test_what_the_columns_do_not_determine_is_absent(columns, known):
    values = dict(zip(FULL, (12.0, 5.0, 0.0, 9.0, 4.0, 200.0), strict=True)) | {
        "v_2": 9.85,
        "contact_time": 5e-3,
    }
    found = balances(made({name: values[name] for name in columns.split()}), Ball())
    has = [
        name
        for name, unit in BALANCES.items()
        if found[name + f" [{unit}]" * bool(unit)].notna().all()
    ]
    assert has == known.split()


def test_a_gap_and_a_ball_without_slip_leave_the_rest():
    values = dict(zip(FULL, ([12.0, 0.0], 5.0, 0.0, 9.0, 4.0, [np.nan, 200.0]), strict=True))
    found = balances(made(values, dict.fromkeys(values, 0.1)), Ball())
    assert found["cor"].notna().all()
    assert found["cor_sd"].notna().all()
    assert (
        found["offset [m]"].isna().tolist()
        == found["offset_sd [m]"].isna().tolist()
        == [True, False]
    )
    assert found["e_x"].isna().all()
