"""Plans: gains against closed forms and nested Monte Carlo, sensors and settings together, a table
to fill in.
"""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from support.made_fit import made_fit, table_of

import fitball
from fitball.base.errors import ParameterError
from fitball.base.options import names_of
from fitball.data.read import load_data
from fitball.data.scene import CameraSection, Quantity, Scene
from fitball.inference.forward import Draws
from fitball.inference.problem.build import build_problem
from fitball.report import plan as page
from fitball.report.style import saved, styled
from fitball.results.result import Result

NOISE = {"v_x_sd": 0.3, "v_y_sd": 0.2, "spin_sd": 6.0}
GRID = {"speed": "15..25:3", "angle": "20..60:3", "spin": "-100..200:2"}


def linear(
    v_x1,
    v_y1,
    omega_1,
    ball,
    a="normal(0.6, 0.1)",
    e="normal(0.75, 0.1)",
    c="normal(0.5, 0.2)",
):
    """Linear in its parameters, which share no column of all."""
    return a * v_x1 + 0.1 * e * v_y1, e * v_y1, c * omega_1 + 20.0 * a * v_y1


def drawn(fit, spread, names, count=4000, logs=False, seed=3):
    """The fit with normal draws about its point: sds `spread` of values, or of logarithms, each
    correlated with the next by 0.5.
    """
    rng = np.random.default_rng(seed)
    z = rng.standard_normal((count, len(names)))
    z[:, 1:] = 0.5 * z[:, :-1] + np.sqrt(0.75) * z[:, 1:]
    point = fit.draws.point
    values = {name: np.full(count, one) for name, one in fit.draws.point.items()}
    for k, name in enumerate(names):
        values[name] = (
            point[name] * np.exp(spread[k] * z[:, k]) if logs else point[name] + spread[k] * z[:, k]
        )
    best = {name: np.array([one]) for name, one in point.items()}
    fit.__dict__["made"] = SimpleNamespace(problem=fit.problem, draws=Draws(point, values, best))
    return fit


def linear_fit(frame=None, **choices):
    fit = made_fit(frame, **{"fix": NOISE, **choices})
    problem = build_problem(
        fit.run.table,
        fit.run.scene,
        fit.run.choices,
        fitball.model_from(linear),
    )
    point = {item.spec.name: item.fixed for item in problem.parameters} | {
        "a": 0.6,
        "e": 0.75,
        "c": 0.5,
    }
    fit.__dict__["made"] = SimpleNamespace(problem=problem, draws=Draws(point, {}, {}))
    kinds = {name: "model" if name in "aec" else "noise" for name in point}
    fit.__dict__["summary"] = pd.DataFrame({"kind": kinds}).rename_axis("name")
    return drawn(fit, (0.04, 0.02, 0.1), ("a", "e", "c"))


@pytest.fixture(scope="module")
def straight():
    return linear_fit()


def slopes(row):
    """Of (v_x2, v_y2, omega_2) with (a, e, c), in units of noise."""
    v_x1 = row["v_1"] * np.cos(row["theta_1"])
    v_y1 = row["v_1"] * np.sin(row["theta_1"])
    made = np.array([[v_x1, 0.1 * v_y1, 0.0], [0.0, v_y1, 0.0], [20.0 * v_y1, 0.0, row["omega_1"]]])
    return made / np.array([[0.3], [0.2], [6.0]])


def covariance(fit):
    return np.cov(np.stack([fit.draws.values[name] for name in "aec"]))


def left(known, rows):
    """The covariance after impacts with these slopes."""
    return np.linalg.inv(np.linalg.inv(known) + sum(row.T @ row for row in rows))


def about(known, rows, towards):
    """The gain, in closed form."""
    now, then = (towards @ one @ towards.T for one in (known, left(known, rows)))
    return 0.5 * (np.linalg.slogdet(now)[1] - np.linalg.slogdet(then)[1])


@pytest.mark.parametrize(
    ("target", "towards"),
    [((), np.eye(3)), ("a,c", np.eye(3)[[0, 2]]), ("impact=v_1=20,theta_1=30 deg", None)],
)
def test_gains_of_a_linear_model_are_those_of_algebra(straight, target, towards):
    if towards is None:
        along = {"v_1": 20.0, "theta_1": np.pi / 6, "omega_1": 0.0}
        towards = slopes(along) * np.array([[0.3], [0.2], [6.0]])
        # Without spin its spin follows from the velocities.
        towards = towards[:2]
    found = fitball.plan(
        straight,
        target=target,
        sensor={},
        count=4,
        **GRID,
    )
    known = covariance(straight)
    grid = found.frames["gains"]
    for _, row in grid.iloc[::4].iterrows():
        assert row["as before"] == pytest.approx(about(known, [slopes(row)], towards), rel=1e-6)
    chosen = found.frames["plan"]
    made = [slopes(row) for _, row in chosen.iterrows()]
    for k in range(len(chosen)):
        assert chosen["total"][k] == pytest.approx(about(known, made[: k + 1], towards), rel=1e-6)
        best = max(about(known, [*made[:k], slopes(row)], towards) for _, row in grid.iterrows())
        assert chosen["total"][k] == pytest.approx(best, rel=1e-6)
    shares = np.sqrt(
        np.diag(towards @ left(known, made) @ towards.T) / np.diag(towards @ known @ towards.T)
    )
    columns = [name for name in chosen if name.startswith("sd(")][: len(shares)]
    now = found.frames["targets"]["now"].to_numpy()[: len(shares)]
    assert_allclose(chosen.loc[3, columns].to_numpy(float) / now, shares, rtol=1e-6)
    # Half of the 68 % of 4,000 draws is their sd within some per cent.
    assert_allclose(now, np.sqrt(np.diag(towards @ known @ towards.T)), rtol=0.05)
    own = straight.problem.rows.states
    states = [
        {"v_1": v, "theta_1": t, "omega_1": w}
        for v, t, w in zip(*own.polar(), own.omega_1, strict=True)
    ]
    again = [np.sqrt(4 / len(states)) * slopes(one) for one in states]
    batch = found.frames["sensors"].set_index("sensor")["batch"]
    assert batch["repeats"] == pytest.approx(about(known, again, towards), rel=1e-6)


def test_a_drop_shows_the_vertical_speed_alone(straight):
    found = fitball.plan(straight, sensor={"drop": "1 m"}, count=1, **GRID).frames["others"].iloc[0]
    fall = {"v_1": np.sqrt(2 * 9.80665), "theta_1": np.pi / 2, "omega_1": 0.0}
    assert found["sensor"] == "drop"
    assert found["v_1"] == pytest.approx(fall["v_1"])
    assert found["gain"] == pytest.approx(
        about(covariance(straight), [slopes(fall)[1:2]], np.eye(3)),
        rel=1e-6,
    )


def test_a_noise_is_learned_by_its_own_information():
    fit = made_fit()
    drawn(fit, (0.2,), ("v_x_sd",), logs=True)
    chosen = fitball.plan(
        fit,
        target="v_x_sd",
        sensor={},
        count=3,
        **GRID,
    ).frames["plan"]
    size = np.var(np.log(fit.draws.values["v_x_sd"]), ddof=1)
    assert_allclose(
        chosen["total"],
        0.5 * np.log1p(2.0 * size * np.arange(1, 4)),
        rtol=1e-6,
    )


def nested(fit, row, columns, rng, outer=2000):
    """Mutual information of parameters and a measurement, by draws within draws, and its standard
    error.
    """
    model = fit.problem.forward.model
    values = fit.draws.values
    state = fitball.impacts(
        row["v_1"] * np.cos(row["theta_1"]),
        row["v_1"] * np.sin(row["theta_1"]),
        row["omega_1"],
    )
    made = model.rebound({spec.name: values[spec.name] for spec in model.parameters}, state)
    noise = {"v_x2": "v_x_sd", "v_y2": "v_y_sd", "omega_2": "spin_sd"}
    seen = np.stack(
        [made.column(name)[:, 0] / fit.draws.point[noise[name]] for name in columns],
        axis=1,
    )
    places = rng.integers(len(seen), size=outer)
    y = seen[places] + rng.standard_normal((outer, len(columns)))
    logs = np.stack([-0.5 * ((one - seen) ** 2).sum(axis=1) for one in y])
    highest = logs.max(axis=1)
    evidence = highest + np.log(np.exp(logs - highest[:, None]).mean(axis=1))
    gains = -0.5 * ((y - seen[places]) ** 2).sum(axis=1) - evidence
    return gains.mean(), gains.std() / np.sqrt(outer)


def test_gains_agree_with_nested_monte_carlo():
    rng = np.random.default_rng(5)
    columns = ("v_x2", "v_y2", "omega_2")
    bent = drawn(
        made_fit(fix=NOISE),
        (0.03, 0.05, 0.04, 0.01),
        ("mu", "e_x", "offset", "cor_10"),
        logs=True,
    )
    grid = fitball.plan(bent, sensor={}, **GRID).frames["gains"]
    for place in (0, 7, 16):
        found, error = nested(bent, grid.iloc[place], columns, rng)
        # A mean of 4,000 draws within is too low by some thousandths.
        assert grid["as before"][place] == pytest.approx(found, abs=3.0 * error + 0.02)
    assert np.ptp(grid["as before"]) > 0.3


@pytest.mark.parametrize("together", [False, True])
def test_errors_of_states_widen_what_is_measured(together):
    frame = table_of()
    frame["v_x1_sd"], frame["omega_1_sd"] = 0.4, 9.0
    # Of an error of 0.3 m/s, correlated by 0.6, so much follows from that of the state; the rest
    # adds to the scatter.
    follows, rest = (0.6 * 0.3 / 0.4, 0.3 * 0.8) if together else (0.0, 0.0)
    if together:
        frame["v_x2_sd"], frame["corr(v_x1,v_x2)"] = 0.3, 0.6
    fit = linear_fit(frame)
    found = fitball.plan(fit, sensor={}, **GRID)
    known = covariance(fit)
    for _, row in found.frames["gains"].iterrows():
        moved = np.array([[(0.6 - follows) * 0.4 / 0.3, 0.0], [0.0, 0.0], [0.0, 0.5 * 9.0 / 6.0]])
        root = np.linalg.cholesky(
            np.eye(3) + moved @ moved.T + np.diag([(rest / 0.3) ** 2, 0.0, 0.0])
        )
        expected = about(known, [np.linalg.solve(root, slopes(row))], np.eye(3))
        # The effect of states depends on the parameters at each draw.
        assert row["as before"] == pytest.approx(expected, rel=0.01)
    assert {"v_x1_sd [m/s]", "omega_1_sd [rad/s]"} <= {*page.to_fill_in(found)}


def test_an_impact_is_measured_as_the_nearest_of_the_table():
    frame = table_of(40)
    # Errors that differ from row to row, and a column that is missing in some.
    frame["v_x2_sd"] = np.linspace(0.1, 0.8, 40)
    frame.loc[::4, "omega_2"] = np.nan
    fit = linear_fit(frame, fix={"v_y_sd": 0.2, "spin_sd": 6.0, "v_x_sd": 0.3})
    found = fitball.plan(fit, sensor={}, **GRID)
    known = covariance(fit)
    state = fit.problem.rows.states
    whole = np.flatnonzero(np.arange(40) % 4)
    for _, row in found.frames["gains"].iterrows():
        v_x1 = row["v_1"] * np.cos(row["theta_1"])
        v_y1 = row["v_1"] * np.sin(row["theta_1"])
        turn = fit.problem.forward.model.ball.radius * (state.omega_1 - row["omega_1"])
        away = np.hypot(np.hypot(state.v_x1 - v_x1, state.v_y1 - v_y1), turn)
        sd = frame["v_x2_sd"][whole[away[whole].argmin()]]
        row_slopes = slopes(row) * np.array([[0.3 / np.hypot(0.3, sd)], [1.0], [1.0]])
        assert row["as before"] == pytest.approx(about(known, [row_slopes], np.eye(3)), rel=1e-6)


def test_heavy_tails_say_less():
    fit = linear_fit(noise="student-t", fix={**NOISE, "degrees_of_freedom": 5.0})
    found = fitball.plan(fit, sensor={}, **GRID).frames["gains"]
    known = covariance(fit)
    for _, row in found.iloc[::5].iterrows():
        # Fisher information of t over that of a normal density: (nu + 1)/(nu + 3).
        assert row["as before"] == pytest.approx(
            about(known, [np.sqrt(6 / 8) * slopes(row)], np.eye(3)),
            rel=1e-6,
        )


@pytest.fixture(scope="module")
def elastic():
    fit = made_fit(model="two-mass", fix=NOISE)
    names = ("mass_ratio", "k_y", "k_theta", "mu")
    return drawn(fit, (0.02, 0.3, 0.3, 0.04), names, logs=True)


def test_the_headline_names_the_sensor_that_helps(elastic):
    found = fitball.plan(elastic, target="k_y", sensor={"contact_time": "0.05 ms"}, **GRID)
    batch = found.frames["sensors"].set_index("sensor")["batch"]
    assert batch["as before"] < 0.5 < 1.5 < batch["contact_time"]
    assert set(found.frames["plan"]["sensor"]) == {"contact_time"}
    assert "contact_time to 0.05" in found.report().splitlines()[3]
    # One that reads hardly better than before is not worth its name.
    same = fitball.plan(elastic, target="mu", sensor={"v_y2": "0.199"}, **GRID)
    assert same.frames["sensors"]["batch"][1] > same.frames["sensors"]["batch"][0]
    assert set(same.frames["plan"]["sensor"]) == {"as before"}
    assert set(same.frames["others"]["sensor"]) == {"v_y2"}
    one = {"target": "k_y", "count": 1, **GRID}
    worse = [
        fitball.plan(elastic, sensor={"contact_time": sd}, **one).frames["plan"]
        for sd in ("0.1 ms", "0.2 ms")
    ]
    assert batch["contact_time"] > worse[0]["gain"][0] > worse[1]["gain"][0]


def test_gaps_depend_on_the_height_of_the_court(elastic):
    def gain(share, height):
        scene = (
            Scene()
            if height is None
            else Scene(camera=CameraSection(court_height=Quantity(0.0, height)))
        )
        fit = drawn(made_fit(model="two-mass", fix=NOISE, scene=scene), (0.3,), ("k_y",), logs=True)
        return fitball.plan(
            fit,
            target="k_y",
            sensor={"gaps": share},
            count=1,
            **GRID,
        ).frames["plan"]["gain"][0]

    known = [gain("1", height) for height in (1e-6, 1e-3, None)]
    assert known[0] > known[1] > known[2] > 0.1
    assert gain("0.5", None) > known[2]


def test_draws_that_do_not_give_the_target_are_left_out():
    fit = drawn(made_fit(model="two-mass", fix=NOISE), (0.1,), ("mu",), logs=True)
    ratio = fit.draws.values["mass_ratio"]
    rng = np.random.default_rng(2)
    # COR cannot exceed the mass ratio.
    ratio[:] = np.where(rng.uniform(size=4000) < 0.3, 0.4, 0.87)
    asked = {
        "target": "impact=v_1=20, theta_1=30",
        "sensor": {},
        "count": 1,
        **GRID,
    }
    assert 0.1 < fitball.plan(fit, **asked).frames["plan"]["gain"][0] < 5.0
    ratio[:] = np.where(rng.uniform(size=4000) < 0.7, 0.4, 0.87)
    with pytest.raises(ParameterError) as caught:
        fitball.plan(fit, **asked)
    assert caught.value.code == "no-answer"


def test_planned_impacts_are_filmed_as_the_last_were():
    frame = table_of()
    frame["session"] = ["monday"] * 12 + ["tuesday"] * 12
    fit = made_fit(frame, fix=NOISE, scene=Scene(camera=CameraSection(tilt=Quantity(0.0, 0.02))))
    drawn(fit, (0.02, 0.02), ("tilt[monday]", "tilt[tuesday]"))
    gains = fitball.plan(
        fit,
        target="tilt[tuesday]",
        sensor={},
        count=1,
        **GRID,
    ).frames["plan"]["gain"]
    # Of the two correlated ones the last is seen.
    assert (
        gains[0]
        > fitball.plan(
            fit,
            target="tilt[monday]",
            sensor={},
            count=1,
            **GRID,
        ).frames["plan"]["gain"][0]
    )


def test_the_range_of_the_table_is_where_plans_are_unless_asked(straight):
    assert "range-of-table" in {
        note.code for note in fitball.plan(straight, sensor={}, count=1).notes
    }
    far = fitball.plan(straight, sensor={}, count=1, **{**GRID, "speed": "60"})
    assert "range-of-table" not in {note.code for note in far.notes}
    assert far.frames["plan"]["outside"].all()
    near = fitball.plan(
        straight,
        sensor={},
        count=1,
        speed="20",
        angle="40",
        spin="0",
    )
    assert not near.frames["plan"]["outside"].any()


def test_settings_and_targets_on_levels():
    fit = made_fit(table_of(36, ("clay", "hard")))
    fit.draws.values["mu[hard]"][:] = 0.5 + 2.0 * (fit.draws.values["mu[hard]"] - 0.5)
    found = fitball.plan(fit, target="mu", sensor={}, **GRID)
    assert [*found.frames["targets"].index] == ["mu[clay]", "mu[hard]"]
    assert len(found.frames["gains"]) == 36
    one = fitball.plan(
        fit,
        target="mu",
        level={"Surface": "HARD"},
        sensor={"drop": "254 cm"},
        **GRID,
    )
    assert [*one.frames["targets"].index] == ["mu[hard]"]
    assert set(one.frames["gains"]["surface"]) == {"hard"}
    assert one.frames["others"]["gain"].max() < 1e-3
    both = fitball.plan(fit, target="mu[hard]", sensor={}, **GRID)
    axes = styled(page.figures(both)["gains"]).axes
    gains = both.frames["gains"].round({"v_1": 9, "theta_1": 9})
    best = gains.groupby(["v_1", "theta_1", "omega_1"])["as before"].max()
    shown = np.concatenate([np.ravel(axis.collections[0].get_array()) for axis in axes[:2]])
    assert_allclose(np.sort(shown), np.sort(best))
    batches = [
        frames["sensors"].set_index("sensor")["batch"]["repeats"]
        for frames in (one.frames, both.frames)
    ]
    assert batches[0] > 1.2 * batches[1]
    sds = fitball.plan(
        fit,
        target="impact=v_1=20, theta_1=20",
        sensor={},
        count=1,
        **GRID,
    ).frames["targets"]["now"]
    assert sds["v_x2[hard]"] > 1.2 * sds["v_x2[clay]"]


@pytest.mark.parametrize("polar", [False, True])
def test_the_table_is_filled_in_and_read_beside_the_fitted_one(polar):
    frame = table_of(36, ("clay", "hard"))
    if polar:
        v_x1 = frame.pop("v_x1")
        v_y1 = frame.pop("v_y1")
        frame["v_1"], frame["theta_1 [deg]"] = (
            np.hypot(v_x1, v_y1),
            np.degrees(np.arctan2(v_y1, v_x1)),
        )
    found = fitball.plan(made_fit(frame), sensor={}, count=4, **GRID)
    table = page.to_fill_in(found)
    chosen = found.frames["plan"]
    empty = ["v_x2 [m/s]", "v_y2 [m/s]", "omega_2 [rad/s]"]
    assert (table[empty] == "").all(axis=None)
    v_x1 = chosen["v_1"] * np.cos(chosen["theta_1"])
    # What the ball does is of no account here, but no energy may be gained.
    table[empty] = np.column_stack(
        [0.5 * v_x1, 0.6 * chosen["v_1"] * np.sin(chosen["theta_1"]), 10.0 * v_x1]
    )
    both, _ = load_data([frame, table], None, True)
    assert len(both) == 40
    assert_allclose(both.impacts.v_x1[36:], v_x1, atol=1e-5)
    assert_allclose(both.values["omega_2"][36:], 10.0 * v_x1)
    assert both.labels["surface"][36:] == tuple(chosen["surface"])


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    made_fit(fix=NOISE).save(folder, figures=False)
    return fitball.load_fit(folder)


def test_derived_quantities_and_impacts_are_targets(stored):
    found = fitball.plan(
        stored,
        target="court_pace,mu,impact=v_1=30, theta_1=16",
        sensor={},
        count=1,
        **GRID,
    )
    assert [*found.frames["targets"].index] == ["court_pace", "mu", "v_x2", "v_y2", "omega_2"]
    assert (found.frames["targets"]["as before"] < found.frames["targets"]["now"]).all()
    assert names_of("k_theta/k_y[clay, A],mu") == ["k_theta/k_y[clay, A]", "mu"]


def test_the_map_shows_gains_and_places(straight):
    found: Result = fitball.plan(straight, sensor={}, count=2, **GRID)
    figure = styled(page.figures(found)["gains"])
    grid = found.frames["gains"]
    shown = np.concatenate([np.ravel(axis.collections[0].get_array()) for axis in figure.axes[:2]])
    assert_allclose(np.sort(shown), np.sort(grid["as before"]), rtol=1e-12)
    marks = {text.get_text(): text.xy for axis in figure.axes[:2] for text in axis.texts}
    for number, row in enumerate(found.frames["plan"].itertuples(), 1):
        place = next(xy for words, xy in marks.items() if str(number) in words.split(","))
        assert_allclose(place, [np.degrees(row.theta_1), row.v_1])
    line = fitball.plan(
        straight,
        sensor={},
        count=90,
        speed="15..25:4",
        angle="30",
        spin="0..100:2",
    )
    assert saved(styled(page.figures(line)["gains"])).startswith(b"\x89PNG")


def test_a_drop_test_is_planned_over_its_speed():
    found = fitball.plan(made_fit(table_of(12, drop=True)), count=2)
    assert (found.frames["plan"]["theta_1"] == np.pi / 2).all()
    assert found.frames["gains"]["v_1"].nunique() == 6
    assert [*page.to_fill_in(found)] == ["id", "v_y1 [m/s]", "v_y2 [m/s]", "sensor"]
    assert saved(styled(page.figures(found)["gains"])).startswith(b"\x89PNG")
