"""Plans: gains against closed forms and nested Monte Carlo, sensors and settings together, a table
to fill in.
"""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.special import logsumexp
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.base.errors import ParameterError
from fitball.base.findings import Findings
from fitball.base.numbers import Unit
from fitball.base.options import names_of
from fitball.data.load import load_data
from fitball.data.scene import CameraSection, Scene, ValueWithSd
from fitball.inference.forward import Draws
from fitball.inference.problem.build import build_problem
from fitball.report import plan as page
from fitball.report.figures.gains import draw_gains
from fitball.report.style import draw_styled, image_bytes
from fitball.results.result import Result
from fitball.uses.machine import round_steps

NOISE = {"v_x_sd": 0.3, "v_y_sd": 0.2, "spin_sd": 6.0}
# Of v_x2, v_y2, omega_2, as a column.
SIZES = np.array([[0.3], [0.2], [6.0]])
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


def drawn(fit, spread, names, logs=False):
    """The fit with 4,000 normal draws about its point: sds `spread` of values, or of logarithms,
    each correlated with the next by 0.5.
    """
    count = 4000
    rng = np.random.default_rng(3)
    z = rng.standard_normal((count, len(names)))
    z[:, 1:] = 0.5 * z[:, :-1] + np.sqrt(0.75) * z[:, 1:]
    point = fit.draws.point
    values = {name: np.full(count, value) for name, value in point.items()}
    for k, name in enumerate(names):
        step = spread[k] * z[:, k]
        if logs:
            values[name] *= np.exp(step)
        else:
            values[name] += step
    best = {name: np.array([value]) for name, value in point.items()}
    draws = Draws(point, values, best)
    fit.__dict__["built"] = SimpleNamespace(problem=fit.problem, draws=draws)
    return fit


def linear_fit(frame=None, **choices):
    """A fit of the linear model, whose gains are known in closed form."""
    fit = fit_by_hand(frame, **{"fix": NOISE, **choices})
    problem = build_problem(
        fit.run.table,
        fit.run.scene,
        fit.run.choices,
        fitball.model_from(linear),
    )
    point = {parameter.spec.name: parameter.fixed for parameter in problem.parameters}
    point |= {"a": 0.6, "e": 0.75, "c": 0.5}
    kinds = {name: "model" if name in "aec" else "noise" for name in point}
    fit.__dict__["built"] = SimpleNamespace(problem=problem, draws=Draws(point, {}, {}))
    fit.__dict__["summary"] = pd.DataFrame({"kind": kinds}).rename_axis("name")
    return drawn(fit, (0.04, 0.02, 0.1), ("a", "e", "c"))


def frames_of(fit, **choices):
    """Frames of a plan over the grid."""
    return fitball.plan(fit, **{**GRID, **choices}).frames


def first_gain(fit, **choices):
    """Gain of the first impact of a plan."""
    return frames_of(fit, count=1, **choices)["plan"]["gain"][0]


@pytest.fixture(scope="module")
def straight():
    return linear_fit()


def slopes(row):
    """Of (v_x2, v_y2, omega_2) with (a, e, c), in units of noise."""
    v_x1 = row["v_1"] * np.cos(row["theta_1"])
    v_y1 = row["v_1"] * np.sin(row["theta_1"])
    slopes = np.array(
        [
            [v_x1, 0.1 * v_y1, 0.0],
            [0.0, v_y1, 0.0],
            [20.0 * v_y1, 0.0, row["omega_1"]],
        ]
    )
    return slopes / SIZES


def covariance(fit):
    """Of the draws of (a, e, c)."""
    return np.cov(np.stack([fit.draws.values[name] for name in "aec"]))


def covariance_after(prior, rows):
    """The covariance after impacts with these slopes."""
    information = sum(row.T @ row for row in rows)
    return np.linalg.inv(np.linalg.inv(prior) + information)


def gain_of(prior, rows, towards=None):
    """The gain about all parameters, or about linear functions of them, in closed form."""
    if towards is None:
        towards = np.eye(3)
    _, before = np.linalg.slogdet(towards @ prior @ towards.T)
    _, after = np.linalg.slogdet(towards @ covariance_after(prior, rows) @ towards.T)
    return 0.5 * (before - after)


def sds_of(covariance, towards):
    return np.sqrt(np.diag(towards @ covariance @ towards.T))


@pytest.mark.parametrize(
    ("target", "towards"),
    [((), np.eye(3)), ("a,c", np.eye(3)[[0, 2]]), ("impact=v_1=20,theta_1=30 deg", None)],
)
def test_gains_of_a_linear_model_are_those_of_algebra(straight, target, towards):
    if towards is None:
        along = {"v_1": 20.0, "theta_1": np.pi / 6, "omega_1": 0.0}
        # Without spin its spin follows from the velocities.
        towards = (slopes(along) * SIZES)[:2]
    frames = frames_of(straight, target=target, sensor={}, count=4)
    prior = covariance(straight)
    grid = frames["gains"]
    for _, row in grid.iloc[::4].iterrows():
        wanted = gain_of(prior, [slopes(row)], towards)
        assert row["as before"] == pytest.approx(wanted, rel=1e-6)
    chosen = frames["plan"]
    planned = [slopes(row) for _, row in chosen.iterrows()]
    candidates = [slopes(row) for _, row in grid.iterrows()]
    for k in range(len(chosen)):
        wanted = gain_of(prior, planned[: k + 1], towards)
        assert chosen["total"][k] == pytest.approx(wanted, rel=1e-6)
        best = max(gain_of(prior, [*planned[:k], other], towards) for other in candidates)
        assert chosen["total"][k] == pytest.approx(best, rel=1e-6)
    sds_before = sds_of(prior, towards)
    sds_after = sds_of(covariance_after(prior, planned), towards)
    count = len(towards)
    columns = [name for name in chosen if name.startswith("sd(")][:count]
    now = frames["targets"]["now"].to_numpy()[:count]
    shares = chosen.loc[3, columns].to_numpy(float) / now
    assert_allclose(shares, sds_after / sds_before, rtol=1e-6)
    # Half of the 68 % of 4,000 draws is their sd within some per cent.
    assert_allclose(now, sds_before, rtol=0.05)
    # Four impacts of the table again, spread over all.
    measured = straight.problem.rows.states
    v_1, theta_1 = measured.polar()
    again = []
    for k in range(len(measured)):
        impact = {"v_1": v_1[k], "theta_1": theta_1[k], "omega_1": measured.omega_1[k]}
        again.append(np.sqrt(4 / len(measured)) * slopes(impact))
    batch = frames["sensors"].set_index("sensor")["batch"]
    assert batch["repeats"] == pytest.approx(gain_of(prior, again, towards), rel=1e-6)


def test_a_drop_shows_the_vertical_speed_alone(straight):
    frames = frames_of(straight, sensor={"drop": "1 m"}, count=1)
    result = frames["others"].iloc[0]
    # Through air with a drag coefficient of 0.55.
    braking = 0.55 * 1.2 * np.pi * 0.03302**2 / 0.0576
    speed = np.sqrt(2 * 9.80665 / braking * (1.0 - np.exp(-braking)))
    fall = {"v_1": speed, "theta_1": np.pi / 2, "omega_1": 0.0}
    assert result["sensor"] == "drop"
    assert result["v_1"] == pytest.approx(fall["v_1"])
    of_v_y2 = slopes(fall)[1:2]
    wanted = gain_of(covariance(straight), [of_v_y2])
    assert result["gain"] == pytest.approx(wanted, rel=1e-6)


def test_a_noise_is_learned_by_its_own_information():
    """A measurement has the information 2 about the logarithm of its sd."""
    fit = fit_by_hand()
    drawn(fit, (0.2,), ("v_x_sd",), logs=True)
    chosen = frames_of(fit, target="v_x_sd", sensor={}, count=3)["plan"]
    variance = np.var(np.log(fit.draws.values["v_x_sd"]), ddof=1)
    count = np.arange(1, 4)
    wanted = 0.5 * np.log1p(2.0 * variance * count)
    assert_allclose(chosen["total"], wanted, rtol=1e-6)


def nested(fit, row, columns, rng, outer=2000):
    """Mutual information of parameters and a measurement, by draws within draws, and its standard
    error.
    """
    model = fit.problem.forward.model
    values = {spec.name: fit.draws.values[spec.name] for spec in model.parameters}
    state = fitball.impacts(
        row["v_1"] * np.cos(row["theta_1"]),
        row["v_1"] * np.sin(row["theta_1"]),
        row["omega_1"],
    )
    rebound = model.rebound(values, state)
    noise = {"v_x2": "v_x_sd", "v_y2": "v_y_sd", "omega_2": "spin_sd"}
    in_sds = []
    for name in columns:
        sd = fit.draws.point[noise[name]]
        in_sds.append(rebound.column(name)[:, 0] / sd)
    means = np.stack(in_sds, axis=1)
    truth = means[rng.integers(len(means), size=outer)]
    y = truth + rng.standard_normal(truth.shape)

    def log_density(y, means):
        return -0.5 * np.sum((y - means) ** 2, axis=1)

    of_all_draws = np.stack([log_density(measured, means) for measured in y])
    evidence = logsumexp(of_all_draws, axis=1) - np.log(len(means))
    gains = log_density(y, truth) - evidence
    return gains.mean(), gains.std() / np.sqrt(outer)


def test_gains_agree_with_nested_monte_carlo():
    rng = np.random.default_rng(5)
    columns = ("v_x2", "v_y2", "omega_2")
    names = ("mu", "e_x", "offset", "cor_10")
    bent = drawn(fit_by_hand(fix=NOISE), (0.03, 0.05, 0.04, 0.01), names, logs=True)
    grid = frames_of(bent, sensor={})["gains"]
    for setting in (0, 7, 16):
        wanted, error = nested(bent, grid.iloc[setting], columns, rng)
        # A mean of 4,000 draws within is too low by some thousandths.
        assert grid["as before"][setting] == pytest.approx(wanted, abs=3.0 * error + 0.02)
    assert np.ptp(grid["as before"]) > 0.3


@pytest.mark.parametrize("together", [False, True])
def test_errors_of_states_widen_what_is_measured(together):
    frame = table_of()
    frame["v_x1_sd"] = 0.4
    frame["omega_1_sd"] = 9.0
    follows = 0.0
    rest = 0.0
    if together:
        frame["v_x2_sd"] = 0.3
        frame["corr(v_x1,v_x2)"] = 0.6
        # Of an error of 0.3 m/s, correlated by 0.6, so much follows from that of the state; the
        # rest adds to the scatter.
        follows = 0.6 * 0.3 / 0.4
        rest = 0.3 * 0.8
    fit = linear_fit(frame)
    result = fitball.plan(fit, sensor={}, **GRID)
    prior = covariance(fit)
    # Variances in units of the noise, of v_x2 and of omega_2.
    of_v_x2 = ((0.6 - follows) * 0.4 / 0.3) ** 2 + (rest / 0.3) ** 2
    of_omega_2 = (0.5 * 9.0 / 6.0) ** 2
    widening = np.sqrt([[1.0 + of_v_x2], [1.0], [1.0 + of_omega_2]])
    for _, row in result.frames["gains"].iterrows():
        wanted = gain_of(prior, [slopes(row) / widening])
        # The effect of states depends on the parameters at each draw.
        assert row["as before"] == pytest.approx(wanted, rel=0.01)
    columns = {*page.to_fill_in(result)}
    assert "v_x1_sd [m/s]" in columns
    assert "omega_1_sd [rad/s]" in columns


def test_an_impact_is_measured_as_the_nearest_of_the_table():
    frame = table_of(40)
    # Errors that differ from row to row, and a column that is missing in some.
    frame["v_x2_sd"] = np.linspace(0.1, 0.8, 40)
    frame.loc[::4, "omega_2"] = np.nan
    fit = linear_fit(frame)
    prior = covariance(fit)
    state = fit.problem.rows.states
    radius = fit.problem.forward.model.ball.radius
    complete = np.flatnonzero(np.arange(40) % 4)
    for _, row in frames_of(fit, sensor={})["gains"].iterrows():
        v_x = state.v_x1 - row["v_1"] * np.cos(row["theta_1"])
        v_y = state.v_y1 - row["v_1"] * np.sin(row["theta_1"])
        turn = radius * (state.omega_1 - row["omega_1"])
        distance = np.sqrt(v_x**2 + v_y**2 + turn**2)
        nearest = complete[distance[complete].argmin()]
        sd = frame["v_x2_sd"][nearest]
        widening = np.array([[np.hypot(0.3, sd) / 0.3], [1.0], [1.0]])
        wanted = gain_of(prior, [slopes(row) / widening])
        assert row["as before"] == pytest.approx(wanted, rel=1e-6)


def test_heavy_tails_say_less():
    fit = linear_fit(noise="student-t", fix={**NOISE, "degrees_of_freedom": 5.0})
    gains = frames_of(fit, sensor={})["gains"]
    prior = covariance(fit)
    for _, row in gains.iloc[::5].iterrows():
        # Fisher information of t over that of a normal density: (nu + 1)/(nu + 3).
        wanted = gain_of(prior, [np.sqrt(6 / 8) * slopes(row)])
        assert row["as before"] == pytest.approx(wanted, rel=1e-6)


@pytest.fixture(scope="module")
def elastic():
    fit = fit_by_hand(model="two-mass", fix=NOISE)
    names = ("mass_ratio", "k_y", "k_theta", "mu")
    return drawn(fit, (0.02, 0.3, 0.3, 0.04), names, logs=True)


def test_the_headline_names_the_sensor_that_helps(elastic):
    result = fitball.plan(elastic, target="k_y", sensor={"contact_time": "0.05 ms"}, **GRID)
    batch = result.frames["sensors"].set_index("sensor")["batch"]
    assert batch["as before"] < 0.5
    assert batch["contact_time"] > 1.5
    assert set(result.frames["plan"]["sensor"]) == {"contact_time"}
    assert "contact_time to 0.05" in result.report().splitlines()[3]
    # One that reads hardly better than before is not worth its name.
    same = frames_of(elastic, target="mu", sensor={"v_y2": "0.199"})
    as_before, better = same["sensors"]["batch"][:2]
    assert better > as_before
    assert set(same["plan"]["sensor"]) == {"as before"}
    assert set(same["others"]["sensor"]) == {"v_y2"}
    fair = first_gain(elastic, target="k_y", sensor={"contact_time": "0.1 ms"})
    poor = first_gain(elastic, target="k_y", sensor={"contact_time": "0.2 ms"})
    assert batch["contact_time"] > fair > poor


def test_gaps_depend_on_the_height_of_the_court(elastic):
    def gain(share, height=None):
        scene = Scene()
        if height is not None:
            camera = CameraSection(court_height=ValueWithSd(0.0, height))
            scene = Scene(camera=camera)
        fit = fit_by_hand(model="two-mass", fix=NOISE, scene=scene)
        drawn(fit, (0.3,), ("k_y",), logs=True)
        return first_gain(fit, target="k_y", sensor={"gaps": share})

    exact = gain("1", 1e-6)
    to_a_millimetre = gain("1", 1e-3)
    unstated = gain("1")
    assert exact > to_a_millimetre > unstated > 0.1
    assert gain("0.5") > unstated


def test_draws_that_do_not_give_the_target_are_left_out():
    fit = drawn(fit_by_hand(model="two-mass", fix=NOISE), (0.1,), ("mu",), logs=True)
    ratio = fit.draws.values["mass_ratio"]
    rng = np.random.default_rng(2)
    # COR cannot exceed the mass ratio.
    target = "impact=v_1=20, theta_1=30"
    ratio[:] = np.where(rng.uniform(size=4000) < 0.3, 0.4, 0.87)
    assert 0.1 < first_gain(fit, target=target, sensor={}) < 5.0
    ratio[:] = np.where(rng.uniform(size=4000) < 0.7, 0.4, 0.87)
    with pytest.raises(ParameterError) as caught:
        first_gain(fit, target=target, sensor={})
    assert caught.value.code == "no-answer"


def test_planned_impacts_are_filmed_as_the_last_were():
    frame = table_of()
    frame["session"] = ["monday"] * 12 + ["tuesday"] * 12
    camera = CameraSection(tilt=ValueWithSd(0.0, 0.02))
    fit = fit_by_hand(frame, fix=NOISE, scene=Scene(camera=camera))
    drawn(fit, (0.02, 0.02), ("tilt[monday]", "tilt[tuesday]"))
    of_first = first_gain(fit, target="tilt[monday]", sensor={})
    of_last = first_gain(fit, target="tilt[tuesday]", sensor={})
    # Of the two correlated ones the last is seen.
    assert of_last > of_first


def test_the_range_of_the_table_is_where_plans_are_unless_asked(straight):
    unasked = fitball.plan(straight, sensor={}, count=1)
    assert "range-of-table" in {note.code for note in unasked.notes}
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


def in_mph():
    """The made table with speeds in mph and spins in rpm, and a plan of it."""
    frame = table_of()
    headed = {"v_x1": "v_x1 [mph]", "v_y1": "v_y1 [mph]", "omega_1": "omega_1 [rpm]"}
    for name, factor in (("v_x1", 0.44704), ("v_y1", 0.44704), ("omega_1", np.pi / 30.0)):
        frame[name] = frame[name] / factor
    return fitball.plan(fit_by_hand(frame.rename(columns=headed)), sensor={}, count=3)


def test_proposals_are_round_numbers_in_the_units_of_the_table(straight):
    plan = in_mph().frames["plan"]
    speeds = plan["v_1"].to_numpy() / 0.44704
    spins = plan["omega_1"].to_numpy() * 30.0 / np.pi
    angles = np.degrees(plan["theta_1"].to_numpy())
    # Of 33 to 56 mph in six steps, -1,900 to 1,900 rpm in five, 15 to 69 degrees in fifteen.
    for values, step in ((speeds, 2.0), (spins, 200.0), (angles, 1.0)):
        assert_allclose(values / step, np.round(values / step), atol=1e-6)
    text = in_mph().report()
    assert "mph at" in text
    assert "m/s at" not in text
    within = fitball.plan(straight, sensor={}, count=3).frames["gains"]
    measured = straight.problem.rows.states.polar()[0]
    assert within["v_1"].min() >= measured.min() - 1e-9
    assert within["v_1"].max() <= measured.max() + 1e-9
    table = page.to_fill_in(in_mph())
    assert "v_x1 [mph]" in table
    assert "omega_1 [rpm]" in table


@pytest.mark.parametrize(
    ("low", "high", "count", "wanted"),
    [
        (14.93, 25.02, 6, [15, 17, 19, 21, 23, 25]),
        (0.1, 0.9, 5, [0.1, 0.3, 0.5, 0.7, 0.9]),
        (-212.0, 199.0, 5, [-200, -100, 0, 100, 150]),
        (3.0, 3.0, 4, [3.0]),
    ],
)
def test_steps_are_round_and_within_the_range(low, high, count, wanted):
    values = round_steps(low, high, count, Unit("m/s"))
    assert low - 1e-12 <= values.min()
    assert values.max() <= high + 1e-12
    if wanted[-1] != 150:
        assert_allclose(values, wanted, atol=1e-9)
    else:
        assert_allclose(values % 50.0, 0.0, atol=1e-9)


def test_what_is_extrapolated_within_the_ranges_is_explained(straight):
    far = fitball.plan(straight, sensor={}, count=1, **{**GRID, "speed": "60"})
    notes = {note.code: note.text for note in far.notes}
    assert "beyond" in notes["extrapolated"]
    near = fitball.plan(straight, sensor={}, count=1, speed="20", angle="40", spin="0")
    assert "extrapolated" not in {note.code for note in near.notes}


def test_drops_from_heights_are_planned_as_heights():
    frame = pd.DataFrame(
        {
            "drop_height [cm]": np.repeat([97.0, 151.0, 252.0], 4),
            "rebound_height [cm]": 55.0 * np.repeat([0.98, 1.48, 2.4], 4) + np.arange(12) % 4,
        }
    )
    result = fitball.plan(fit_by_hand(frame), sensor={}, count=2)
    heights = 100.0 * result.frames["plan"]["drop_height"].to_numpy()
    assert_allclose(heights / 10.0, np.round(heights / 10.0), atol=1e-6)
    assert "cm" in result.report().split("Measure next")[1][:60]
    head = [*page.to_fill_in(result)]
    assert head == ["id", "drop_height [cm]", "rebound_height [cm]", "sensor"]


def shown_gains(plan):
    """Gains that the two maps show, sorted."""
    axes = draw_styled(page.figures(plan)["gains"]).axes
    maps = [axis.collections[0].get_array() for axis in axes[:2]]
    return np.sort(np.concatenate([np.ravel(gains) for gains in maps]))


def test_marks_of_neighbouring_settings_do_not_overlap():
    speed, angle = (grid.ravel() for grid in np.meshgrid([10.0, 15.0, 20.0], [0.3, 0.33, 0.7]))
    gains = pd.DataFrame({"omega_1": 0.0, "v_1": speed, "theta_1": angle, "table": speed})
    chosen = pd.DataFrame({"omega_1": 0.0, "v_1": 20.0, "theta_1": [0.3, 0.33, 0.7] * 3})
    chosen["sensor"] = "table"
    chosen["id"] = [f"plan {k}" for k in range(1, 10)]
    figure = draw_styled(draw_gains, Findings({"gains": gains, "plan": chosen}))
    figure.draw_without_rendering()
    axes = figure.axes[0]
    marks = [text for text in axes.texts if text.get_text()]
    assert sorted(mark.get_text() for mark in marks) == ["1, 4, 7", "2, 5, 8", "3, 6, 9"]
    boxes = [mark.get_window_extent() for mark in marks]
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:k])
        assert axes.bbox.x0 <= box.x0
        assert box.x1 <= axes.bbox.x1
        assert axes.bbox.y0 <= box.y0
        assert box.y1 <= axes.bbox.y1


def test_settings_and_targets_on_levels():
    fit = fit_by_hand(table_of(36, ("clay", "hard")))
    on_hard = fit.draws.values["mu[hard]"]
    on_hard[:] = 0.5 + 2.0 * (on_hard - 0.5)
    frames = frames_of(fit, target="mu", sensor={})
    assert [*frames["targets"].index] == ["mu[clay]", "mu[hard]"]
    assert len(frames["gains"]) == 36
    hard = frames_of(
        fit,
        target="mu",
        level={"Surface": "HARD"},
        sensor={"drop": "254 cm"},
    )
    assert [*hard["targets"].index] == ["mu[hard]"]
    assert set(hard["gains"]["surface"]) == {"hard"}
    assert hard["others"]["gain"].max() < 1e-3
    both = fitball.plan(fit, target="mu[hard]", sensor={}, **GRID)
    gains = both.frames["gains"].round({"v_1": 9, "theta_1": 9})
    best = gains.groupby(["v_1", "theta_1", "omega_1"])["as before"].max()
    assert_allclose(shown_gains(both), np.sort(best))
    repeats_on_hard = hard["sensors"].set_index("sensor")["batch"]["repeats"]
    repeats = both.frames["sensors"].set_index("sensor")["batch"]["repeats"]
    assert repeats_on_hard > 1.2 * repeats
    frames = frames_of(fit, target="impact=v_1=20, theta_1=20", sensor={}, count=1)
    sds = frames["targets"]["now"]
    assert sds["v_x2[hard]"] > 1.2 * sds["v_x2[clay]"]


@pytest.mark.parametrize("polar", [False, True])
def test_the_table_is_filled_in_and_read_beside_the_fitted_one(polar):
    frame = table_of(36, ("clay", "hard"))
    if polar:
        v_x1 = frame.pop("v_x1")
        v_y1 = frame.pop("v_y1")
        frame["v_1"] = np.hypot(v_x1, v_y1)
        frame["theta_1 [deg]"] = np.degrees(np.arctan2(v_y1, v_x1))
    result = fitball.plan(fit_by_hand(frame), sensor={}, count=4, **GRID)
    table = page.to_fill_in(result)
    chosen = result.frames["plan"]
    empty = ["v_x2 [m/s]", "v_y2 [m/s]", "omega_2 [rad/s]"]
    assert (table[empty] == "").all(axis=None)
    v_x1 = chosen["v_1"] * np.cos(chosen["theta_1"])
    v_y1 = chosen["v_1"] * np.sin(chosen["theta_1"])
    # What the ball does is of no account here, but no energy may be gained.
    table["v_x2 [m/s]"] = 0.5 * v_x1
    table["v_y2 [m/s]"] = 0.6 * v_y1
    table["omega_2 [rad/s]"] = 10.0 * v_x1
    both, _ = load_data([frame, table], None, True)
    assert len(both) == 40
    assert_allclose(both.impacts.v_x1[36:], v_x1, atol=1e-5)
    assert_allclose(both.values["omega_2"][36:], 10.0 * v_x1)
    assert both.labels["surface"][36:] == tuple(chosen["surface"])


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fit")
    fit_by_hand(fix=NOISE).save(folder, figures=False)
    return fitball.load_fit(folder)


def test_derived_quantities_and_impacts_are_targets(stored):
    target = "court_pace,mu,impact=v_1=30, theta_1=16"
    targets = frames_of(stored, target=target, sensor={}, count=1)["targets"]
    assert [*targets.index] == ["court_pace", "mu", "v_x2", "v_y2", "omega_2"]
    assert (targets["as before"] < targets["now"]).all()
    assert names_of("k_theta/k_y[clay, A],mu") == ["k_theta/k_y[clay, A]", "mu"]


def test_the_map_shows_gains_and_places(straight):
    result: Result = fitball.plan(straight, sensor={}, count=2, **GRID)
    grid = result.frames["gains"]
    assert_allclose(shown_gains(result), np.sort(grid["as before"]), rtol=1e-12)
    figure = draw_styled(page.figures(result)["gains"])
    places = {}
    for axis in figure.axes[:2]:
        for mark in axis.texts:
            for number in mark.get_text().split(","):
                places[number] = mark.xy
    for number, row in enumerate(result.frames["plan"].itertuples(), 1):
        assert_allclose(places[str(number)], [np.degrees(row.theta_1), row.v_1])
    line = fitball.plan(
        straight,
        sensor={},
        count=90,
        speed="15..25:4",
        angle="30",
        spin="0..100:2",
    )
    assert image_bytes(draw_styled(page.figures(line)["gains"])).startswith(b"\x89PNG")


def test_a_drop_test_is_planned_over_its_speed():
    result = fitball.plan(fit_by_hand(table_of(12, drop=True)), count=2)
    assert (result.frames["plan"]["theta_1"] == np.pi / 2).all()
    assert result.frames["gains"]["v_1"].nunique() == 6
    assert [*page.to_fill_in(result)] == ["id", "v_y1 [m/s]", "v_y2 [m/s]", "sensor"]
    assert image_bytes(draw_styled(page.figures(result)["gains"])).startswith(b"\x89PNG")
