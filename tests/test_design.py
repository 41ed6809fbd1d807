"""What a planned impact would tell: closed forms, identities of mutual information, and two estimators."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import fitball
from fitball.data.range_text import Range, parse_range
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.errors import FitError, ParameterError
from fitball.inference.design import nested
from fitball.inference.design.force_plate import plate_rows, with_plate
from fitball.inference.design.gain import nothing_measured, over_draws
from fitball.inference.design.information import covariances, differentiated, information_rows
from fitball.inference.design.knowledge import NEXT, Knowledge, knowledge
from fitball.inference.design.make_plan import Asked, make_plan
from fitball.inference.design.nested import Planned, nested_gain
from fitball.inference.design.sensor import PlannedColumn, Sensor, as_before
from fitball.inference.design.sensor_text import parse_sensor
from fitball.inference.design.target import of_parameters, parse_target
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.noise import StudentNoise
from fitball.inference.results.results import Posterior
from fitball.values import Impacts

ROOT = Path(__file__).resolve().parent.parent
RNG = np.random.default_rng(11)


@pytest.fixture
def brief(monkeypatch):
    """Finalists are looked at only briefly."""
    monkeypatch.setattr(nested, "OUTER", 300)
    monkeypatch.setattr(nested, "NEAR", 50)


def entropy_gain(prior, target, rows):
    """ln det of a normal target before and after, over two, by the covariance itself: nothing of `gain`."""
    after = np.linalg.inv(np.linalg.inv(prior) + rows.T @ rows)
    dets = [np.linalg.slogdet(target @ covariance @ target.T)[1] for covariance in (prior, after)]
    return 0.5 * (dets[0] - dets[1])


@pytest.mark.parametrize("parts", [1, 2, 5])
def test_gain_is_that_of_normal_posteriors(parts):
    """Rows in directions in which the posterior has variance one, as the design has them."""
    rows, towards = RNG.normal(size=(3, 4, 6, 5)), RNG.normal(size=(3, parts, 5))
    left = nothing_measured(towards)
    found = left.gains(rows)
    for d in range(3):
        for k in range(4):
            assert found[d, k] == pytest.approx(entropy_gain(np.eye(5), towards[d], rows[d, k]), rel=1e-9)
            after = left.after(rows[:, k]).sds[d]
            covariance = np.linalg.inv(np.eye(5) + rows[d, k].T @ rows[d, k])
            assert after == pytest.approx(np.sqrt(np.diag(towards[d] @ covariance @ towards[d].T)), rel=1e-9)


def test_gains_add_up_whatever_the_order_and_fall_for_the_whole():
    """The chain rule; and what is told of all parameters is told less and less (submodular)."""
    a, b = RNG.normal(size=(2, 2, 3, 4))
    for towards in (RNG.normal(size=(2, 1, 4)), np.broadcast_to(np.eye(4), (2, 4, 4))):
        left = nothing_measured(towards)
        first, second = (left.gains(one[:, None])[:, 0] for one in (a, b))
        then = left.after(a).gains(b[:, None])[:, 0]
        both = left.gains(np.concatenate([a, b], axis=1)[:, None])[:, 0]
        assert first + then == pytest.approx(both, rel=1e-9)
        assert second + left.after(b).gains(a[:, None])[:, 0] == pytest.approx(both, rel=1e-9)
        if towards.shape[1] == 4:
            assert np.all(then < second)


def test_parts_that_follow_from_others_add_nothing():
    towards = RNG.normal(size=(1, 2, 4))
    dependent = np.concatenate([towards, towards.sum(axis=1, keepdims=True), 0.0 * towards[:, :1]], axis=1)
    rows = RNG.normal(size=(1, 1, 3, 4))
    assert nothing_measured(dependent).gains(rows) == pytest.approx(nothing_measured(towards).gains(rows), rel=1e-6)


def test_a_mean_is_over_the_draws_that_can_be_evaluated():
    gains, known = np.array([[1.0, 2.0], [3.0, 9.0]]), np.array([[True, False], [True, False]])
    assert over_draws(gains, known)[0] == 2.0 and np.isnan(over_draws(gains, known)[1])


# --- a drop test with a known noise: v_y2 = v_y1 (cor_10 + cor_slope (v_y1 - 10)), which is linear

SIGMA = 0.1
COVARIANCE = np.array([[4e-4, 2e-5], [2e-5, 9e-6]])


def drop_table(noise=SIGMA, **more):
    frame = {"v_y1": [4.0, 6.0, 8.0, 10.0], "v_y2": [3.2, 4.7, 6.1, 7.5]}
    return {**frame, **({"v_y2_sd": [noise] * 4} if noise else {}), **more}


@pytest.fixture(scope="module")
def linear():
    """What is known of a linear model after a normal posterior."""
    problem = build_problem(load_table(drop_table(), name="drop"), Scene(), Choices(model="brody"))
    assert problem.free_names == ("cor_10", "cor_slope")
    draws = np.random.default_rng(3).multivariate_normal([0.75, -0.012], COVARIANCE, 4000)
    return Knowledge(problem, draws)


def dropped(known, *speeds):
    speed = np.array(speeds)
    return known.at(Impacts(0.0 * speed, speed, 0.0 * speed), np.zeros(speed.size, dtype=np.int64))


@pytest.mark.parametrize(
    ("names", "speeds"), [(("cor_slope",), (15.0,)), (("cor_10",), (4.0, 15.0)), (None, (3.0, 12.0))]
)
def test_both_estimators_find_the_closed_form(linear, names, speeds):
    target = of_parameters(linear.problem, names or linear.problem.free_names)
    design = np.array([[speed, speed * (speed - 10.0)] for speed in speeds]) / SIGMA
    exact = entropy_gain(
        np.cov(linear.coordinates, rowvar=False), target.gradients(linear.coordinates[:1])[0], design
    )
    planned, sensor = dropped(linear, *speeds), as_before(linear.problem)
    draws = linear.some(3)
    rows = information_rows(differentiated(planned, draws), sensor, linear.root)
    together = rows.reshape(len(draws), 1, -1, rows.shape[-1])
    first = nothing_measured(target.gradients(draws) @ linear.root).gains(together)
    assert first == pytest.approx(exact, rel=1e-6)
    checked = nested_gain(linear, [Planned(planned, sensor)], target, np.random.default_rng(5))
    assert exact > 0.3 and checked.se < 0.06 and checked.settled
    assert checked.nats == pytest.approx(exact, abs=4.0 * checked.se)


def test_draws_are_moved_onto_the_target(linear, monkeypatch):
    """With half of all draws around each target nothing but their being moved onto it makes this exact."""
    monkeypatch.setattr(nested, "OUTER", 400)
    monkeypatch.setattr(nested, "NEAR", 2000)
    target, planned = of_parameters(linear.problem, ("cor_slope",)), dropped(linear, 4.0, 15.0, 16.0)
    design = np.array([[speed, speed * (speed - 10.0)] for speed in (4.0, 15.0, 16.0)]) / SIGMA
    exact = entropy_gain(np.cov(linear.coordinates, rowvar=False), np.array([[0.0, 1.0]]), design)
    checked = nested_gain(linear, [Planned(planned, as_before(linear.problem))], target, np.random.default_rng(5))
    assert exact > 0.6 and checked.nats == pytest.approx(exact, abs=3.0 * checked.se)


def test_what_cannot_tell_is_worth_nothing(linear):
    """A drop at the speed at which the line is anchored says nothing of its slope; the noise is far too large."""
    free = Knowledge(
        linear.problem, np.random.default_rng(4).multivariate_normal([0.75, -0.012], np.diag([4e-4, 9e-6]), 4000)
    )
    target, planned = of_parameters(free.problem, ("cor_slope",)), dropped(free, 10.0)
    for sensor in (as_before(free.problem), Sensor("blind", "", (PlannedColumn("v_y2", None, 1e4),))):
        rows = information_rows(differentiated(planned, free.some(3)), sensor, free.root)
        gain = nothing_measured(target.gradients(free.some(3)) @ free.root).gains(rows)
        checked = nested_gain(free, [Planned(planned, sensor)], target, np.random.default_rng(5))
        assert np.all(gain < 2e-3) and abs(checked.nats) < 4.0 * checked.se + 2e-3


def test_repeats_are_impacts_made_again(linear, brief):
    once = make_plan(linear.problem, posterior_of(linear), Asked(speed=Range(8.0, 8.0), impacts=3, sensors=["none"]))
    again = make_plan(
        linear.problem, posterior_of(linear), Asked(speed=Range(8.0, 8.0), impacts=1, repeats=3, sensors=["none"])
    )
    assert again.gain == pytest.approx(once.gain, rel=1e-9)
    assert again.chosen[0].sds == pytest.approx(once.chosen[-1].sds, rel=1e-9)


def posterior_of(known):
    draws = known.problem.to_values(known.coordinates)
    return Posterior(known.problem.free_names, draws[None, :, None, :], np.zeros((1, len(draws), 1)), draws)


def test_the_batch_is_that_of_the_optimum_for_a_line(linear, brief):
    """About a slope alone the speeds at both ends are best, the faster first: Elfving's design for a line."""
    asked = Asked(target="cor_slope", speed=Range(4.0, 16.0, 7), impacts=4, sensors=["none"])
    plan = make_plan(linear.problem, posterior_of(linear), asked)
    assert {one.setting.speed for one in plan.chosen} <= {16.0, 8.0, 6.0, 4.0} and plan.chosen[
        0
    ].setting.speed == 16.0
    assert plan.gain > plan.again > 0.0
    assert plan.gain == pytest.approx(plan.batch.nats, abs=4.0 * plan.batch.se + 0.02)


def test_heavy_tails_and_uncertain_noise_are_worth_less(linear):
    planned, sensor, draws = dropped(linear, 12.0), as_before(linear.problem), linear.some(2)
    rows = information_rows(differentiated(planned, draws), sensor, linear.root)

    class Five(StudentNoise):
        def _freedom(self, sizes):
            return np.full(2, 5.0)

    heavy = information_rows(differentiated(replace(planned, noise=Five()), draws), sensor, linear.root)
    assert (heavy**2).sum() == pytest.approx(0.75 * (rows**2).sum(), rel=1e-9)


def test_student_scale_information_is_that_of_its_density():
    """By the variance of the slope of the log density with respect to the logarithm of the scale."""
    kind, sizes = StudentNoise(), {"degrees_of_freedom": np.array(6.0)}
    grid = np.linspace(-400.0, 400.0, 2_000_001)[None]
    density = np.exp(kind.log_density(grid, {"degrees_of_freedom": np.array([6.0])}))
    step = 1e-5
    slope = (
        kind.log_density(grid * np.exp(-step), {"degrees_of_freedom": np.array([6.0])})
        - kind.log_density(grid * np.exp(step), {"degrees_of_freedom": np.array([6.0])})
    ) / (2.0 * step) - 1.0
    found = np.trapezoid(density * slope**2, grid)[0]
    assert float(kind.scale_information(sizes)) == pytest.approx(found, rel=1e-3)


def test_a_fitted_noise_is_learned_too(linear):
    """n normal measurements tell ln sigma as 2n does: half of ln(1 + 2 n var) nats."""
    problem = build_problem(load_table(drop_table(0.0), name="drop"), Scene(), Choices(model="brody"))
    name = problem.free_names[-1]
    assert name.endswith("_sd")
    rng = np.random.default_rng(6)
    draws = np.column_stack(
        [rng.multivariate_normal([0.75, -0.012], 1e-12 * COVARIANCE, 4000), rng.normal(np.log(0.1), 0.3, 4000)]
    )
    known = Knowledge(problem, draws)
    target, planned = of_parameters(problem, (name,)), dropped(known, 6.0, 6.0, 6.0)
    made = differentiated(planned, known.some(2))
    rows = information_rows(made, as_before(problem), known.root)
    gain = nothing_measured(target.gradients(known.some(2)) @ known.root).gains(
        rows.reshape(2, 1, -1, rows.shape[-1])
    )
    exact = 0.5 * np.log(1.0 + 6.0 * draws[:, 2].var(ddof=1))
    assert gain == pytest.approx(exact, rel=1e-4)
    checked = nested_gain(known, [Planned(planned, as_before(problem))], target, np.random.default_rng(7))
    assert checked.nats == pytest.approx(exact, abs=0.1)


# --- a force plate


@pytest.fixture(scope="module")
def sprung():
    """What is known of a drop of the two-mass ball whose stiffness nobody measured."""
    scene = Scene(priors={"k_y": "lognormal(2.6e4, 1.0)"})
    problem = build_problem(load_table(drop_table(), name="drop"), scene, Choices(model="two-mass"))
    rng = np.random.default_rng(12)
    spread = {"k_y": (np.log(2.6e4), 0.3), "cor_10": (0.73, 2e-3), "cor_slope": (0.0, 5e-4)}
    draws = np.column_stack([rng.normal(*spread[name], 4000) for name in problem.free_names])
    return Knowledge(problem, draws)


def expected_sd(known, sd, misfit, name="k_y"):
    """Of the logarithm of a parameter after five records, those of the bundled drops."""
    plated = with_plate(known, sd, np.random.default_rng(1))
    draws = plated.some(20)
    draws[:, -1] = np.log(misfit)
    at = dropped(plated, 4.0, 6.0, 8.0, 10.0, 12.0)
    rows = plate_rows(at, draws, np.ones((20, 5), dtype=bool), plated.root)
    left = nothing_measured(of_parameters(plated.problem, (name,)).gradients(draws) @ plated.root)
    for k in range(5):
        left = left.after(rows[:, k])
    return float(np.median(left.sds))


def test_a_force_plate_tells_stiffness_as_records_did(sprung):
    """Noise and misfit as in the fit of the bundled records, whose k_y was known within 0.51 % (fits/readme)."""
    numbers = json.loads((ROOT / "fits" / "readme" / "numbers.json").read_text(encoding="utf-8"))["stiffness"]["drop"]
    assert expected_sd(sprung, 4.2, 0.02) == pytest.approx(numbers["sd"] / numbers["median"], rel=0.35)
    # The same fit knew its misfit within 13 %.
    assert expected_sd(sprung, 4.2, 0.02, "force_misfit") == pytest.approx(0.13, rel=0.35)
    assert expected_sd(sprung, 1e7, 0.02) == pytest.approx(0.3, rel=0.03)
    assert expected_sd(sprung, 4.2, 0.2) > 3.0 * expected_sd(sprung, 4.2, 0.02)


def test_a_plan_with_a_plate_says_what_it_cannot_check(sprung, brief):
    asked = Asked("k_y", Range(4.0, 12.0, 3), impacts=2, sensors=["force=4N"], cost={"force": 1.0})
    plan = make_plan(sprung.problem, posterior_of(sprung), asked)
    assert plan.chosen[0].sensor == "force" and not plan.batch.settled and np.isnan(plan.worths[1].nested.nats)
    assert plan.chosen[-1].sds[0] < 0.05 < plan.worths[0].sds[0]
    assert plan.worths[1].batch == pytest.approx(plan.gain, rel=1e-6)


# --- motion along the court


@pytest.fixture(scope="module")
def known(grip_slip_fit):
    return knowledge(grip_slip_fit.problem, grip_slip_fit.posterior, np.random.default_rng(1))


ITF = Impacts(np.array([28.8]), np.array([8.3]), np.array([0.0]))


@pytest.mark.parametrize(
    "text", ["court pace", "impact=v=30 m/s, theta=16 deg", "impact=v=15 m/s, theta=50 deg", "mu,e_x"]
)
def test_gradients_of_targets_are_those_of_their_values(known, text):
    target, at = parse_target(text, known), known.some(3)
    exact = target.gradients(at)
    for k, width in enumerate(known.problem.prior.width):
        step = 1e-6 * width * np.eye(at.shape[1])[k]
        by_difference = (target.values(at + step) - target.values(at - step)) / (2e-6 * width)
        assert exact[..., k] == pytest.approx(by_difference, rel=2e-4, abs=1e-5)


def test_both_estimators_agree_on_a_real_fit(known, brief):
    """One of them knows no derivative of the bounce, the other no simulated measurement."""
    for text, impact in (("mu", ITF), ("court pace", ITF), ("impact=v=15 m/s, theta=50 deg", ITF), (None, ITF)):
        target, sensor = parse_target(text, known), as_before(known.problem)
        planned, draws = known.at(impact, np.zeros(1, dtype=np.int64)), known.some(60)
        made = differentiated(planned, draws)
        left = nothing_measured(target.gradients(draws) @ known.root)
        first = over_draws(left.gains(information_rows(made, sensor, known.root)), made.solved)[0]
        checked = nested_gain(known, [Planned(planned, sensor)], target, np.random.default_rng(2))
        assert checked.left_out < 0.01
        assert checked.nats == pytest.approx(first, abs=0.06 + 3.0 * checked.se), text


def test_an_uncertain_incident_state_adds_its_scatter(known, brief):
    """As balls that come with just these errors scatter, and a gain falls."""
    table = replace(
        known.problem.table,
        incident_covariance=np.tile(np.diag([0.04, 0.01, 25.0]), (len(known.problem.impacts), 1, 1)),
    )
    problem = build_problem(table, known.problem.scene, Choices(model="grip-slip"))
    uncertain = Knowledge(problem, known.coordinates)
    planned, draws = uncertain.at(ITF, np.zeros(1, dtype=np.int64)), uncertain.some(1)
    sensor, made = as_before(problem), differentiated(planned, draws)
    none = np.zeros((1, 1, len(sensor.columns)))
    found = covariances(made, sensor, none, made.solved)[0, 0]
    # Errors of this size are those of a typical impact: its speed, direction and spin.
    assert planned.incident is not None
    # They are as large in speed and direction for every impact, whatever its speed.
    along = np.array([28.8, 8.3]) / np.hypot(28.8, 8.3)
    turned = planned.incident.covariance[0][:2, :2]
    known_sds = []
    for v_x, v_y in zip(problem.impacts.v_x1, problem.impacts.v_y1, strict=True):
        ahead = np.array([v_x, v_y]) / np.hypot(v_x, v_y)
        across = np.array([-ahead[1], ahead[0]])
        noise = np.diag([0.04, 0.01])
        known_sds.append([np.sqrt(ahead @ noise @ ahead), np.sqrt(across @ noise @ across) / np.hypot(v_x, v_y)])
    typical = np.median(known_sds, axis=0)
    assert along @ turned @ along == pytest.approx(typical[0] ** 2)
    aside = np.array([-along[1], along[0]])
    assert aside @ turned @ aside == pytest.approx((typical[1] * np.hypot(28.8, 8.3)) ** 2)
    states = np.random.default_rng(8).multivariate_normal([28.8, 8.3, 0.0], planned.incident.covariance[0], 4000)
    rebound = problem.rebound(problem.to_values(draws), Impacts(*states.T))
    columns = np.stack([column.column.predict(rebound)[0] for column in sensor.columns])
    assert np.sqrt(np.diag(found)) == pytest.approx(columns.std(axis=1), rel=0.06)
    exact = known.at(ITF, np.zeros(1, dtype=np.int64))
    rows = [information_rows(differentiated(at, draws), sensor, known.root) for at in (exact, planned)]
    assert (rows[1] ** 2).sum() < (rows[0] ** 2).sum()
    checked = nested_gain(
        uncertain, [Planned(planned, sensor)], parse_target("mu", uncertain), np.random.default_rng(2)
    )
    gain = nothing_measured(parse_target("mu", uncertain).gradients(uncertain.some(60)) @ uncertain.root).gains(
        information_rows(differentiated(planned, uncertain.some(60)), sensor, uncertain.root)
    )
    assert checked.nats == pytest.approx(gain.mean(), abs=0.06 + 3.0 * checked.se)


def test_a_new_group_brings_its_own_bias(known, brief):
    """Its measurements tell less than those of a group without one, and its bias is as uncertain as its prior."""
    problem = build_problem(known.problem.table, known.problem.scene, Choices(model="grip-slip", offsets="group"))
    rng = np.random.default_rng(9)
    draws = np.column_stack([column_of(known, name, rng) for name in problem.free_names])
    posterior = Posterior(problem.free_names, draws[None, :, None, :], np.zeros((1, len(draws), 1)), draws)
    grouped = knowledge(problem, posterior, np.random.default_rng(1))
    added = [name for name in grouped.problem.free_names if NEXT in name]
    assert len(added) == len(problem.observables)
    k = grouped.problem.free_names.index(added[0])
    assert grouped.coordinates[:, k].std() == pytest.approx(grouped.problem.free[k].prior.b, rel=0.05)
    gains = []
    for one in (known, grouped):
        at, some = one.at(ITF, np.zeros(1, dtype=np.int64)), one.some(20)
        left = nothing_measured(parse_target("mu", one).gradients(some) @ one.root)
        gains.append(left.gains(information_rows(differentiated(at, some), as_before(one.problem), one.root)).mean())
    assert gains[1] < 0.7 * gains[0]
    plan = make_plan(
        problem,
        posterior,
        Asked("mu", parse_range("speed", "20:30:2"), parse_range("angle", "20:60:3"), impacts=2, sensors=["none"]),
    )
    assert plan.gain == pytest.approx(plan.batch.nats, abs=0.08 + 3.0 * plan.batch.se)


def column_of(known, name, rng):
    """Values of a parameter: those of the fit without offsets, and nothing for what that has not."""
    if name in known.problem.free_names:
        return known.problem.to_values(known.coordinates)[:, known.problem.free_names.index(name)]
    return 1e-3 * rng.standard_normal(len(known.coordinates))


def test_levels_are_places_to_measure_at(known, brief):
    """A surface of which little is known is the one to measure on."""
    problem = build_problem(
        known.problem.table, known.problem.scene, Choices(model="grip-slip", pool={"mu": "group"})
    )
    labels = problem.pooling[0].labels
    rng, values = np.random.default_rng(9), []
    for name in problem.free_names:
        if name == "mu_spread":
            values.append(np.abs(rng.normal(0.1, 0.01, len(known.coordinates))))
        elif name.startswith("mu_place"):
            values.append(rng.normal(0.0, 1.0 if labels[1] in name else 0.05, len(known.coordinates)))
        else:
            values.append(column_of(known, name, rng))
    draws = np.column_stack(values)
    posterior = Posterior(problem.free_names, draws[None, :, None, :], np.zeros((1, len(draws), 1)), draws)
    asked = Asked(
        "court pace",
        parse_range("speed", "25"),
        parse_range("angle", "16"),
        parse_range("spin", "0"),
        1,
        sensors=["none"],
    )
    plan = make_plan(problem, posterior, asked)
    assert plan.settings.surfaces == labels and len(plan.parts) == len(labels)
    assert plan.chosen[0].setting.surface == labels[1]
    assert np.argmin(plan.chosen[0].sds / plan.sds) == 1


def test_a_level_is_as_uncertain_as_its_draws_whatever_the_spread(known):
    """To first order, of levels that are well known while common value and spread are not."""
    problem = build_problem(
        known.problem.table, known.problem.scene, Choices(model="grip-slip", pool={"mu": "group"})
    )
    rng, count = np.random.default_rng(9), len(known.coordinates)
    common, spread = rng.normal(0.5, 0.1, count), 0.03 + np.abs(rng.normal(0.0, 0.15, count))
    values = {"mu": common, "mu_spread": spread}
    for label in problem.pooling[0].labels:
        values[f"mu_place[{label}]"] = (rng.normal(0.55, 0.01, count) - common) / spread
    plain = {name: known.coordinates[:, known.problem.free_names.index(name)] for name in known.problem.free_names}
    levelled = Knowledge(problem, np.column_stack([values.get(name, plain.get(name)) for name in problem.free_names]))
    target, draws = parse_target("court pace", levelled), levelled.some(80)
    found = nothing_measured(target.gradients(draws) @ levelled.roots(draws)).sds.mean(axis=0)
    assert found == pytest.approx(np.nanstd(target.values(levelled.coordinates), axis=0), rel=0.1)


def test_costs_decide_between_sensors(grip_slip_fit, brief):
    where = {
        "speed": parse_range("speed", "20:30:2"),
        "angle": parse_range("angle", "16:60:3"),
        "spin": parse_range("spin", "0"),
    }
    cheap, dear = (
        make_plan(
            grip_slip_fit.problem,
            grip_slip_fit.posterior,
            Asked("mu", **where, impacts=1, sensors=["camera=0.5"], cost={"camera": cost}),
        )
        for cost in (1.0, 50.0)
    )
    assert cheap.chosen[0].sensor == "camera" and dear.chosen[0].sensor == "as before"
    assert cheap.chosen[0].gain > dear.chosen[0].gain
    assert cheap.worths[1].sds[0] < cheap.worths[0].sds[0] < cheap.sds[0]


def test_fits_that_cannot_be_planned_from_say_why(drop_page, grip_slip_fit):
    with pytest.raises(FitError, match="point fit has no posterior"):
        fitball.plan(drop_page.parent)
    problem = build_problem(
        grip_slip_fit.table, grip_slip_fit.problem.scene, Choices(model="two-mass", closures={"cor": "measured"})
    )
    with pytest.raises(FitError, match="measured restitution of each impact as an input"):
        knowledge(problem, grip_slip_fit.posterior, RNG)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("camera", "expected COLUMN=SD"), ("camera=0", "positive number"), ("camera=2m", "without a unit"),
        ("contact_time=0.2ms", "grip-slip has no contact time"), ("v_2=0.1", "follows from the velocities"),
        ("omega_2=5 m/s", "measures speed"), ("drop=254 kg", "unknown"), ("omega=3", "unknown column 'omega'"),
        ("drop=1000 m", "drop_height"), ("force=5N", "no force-time course"),
    ],
)  # fmt: skip
def test_sensors_are_refused_with_their_text(known, text, said):
    with pytest.raises(ParameterError, match=said) as raised:
        parse_sensor(known.problem, text)
    assert text in str(raised.value)


@pytest.mark.parametrize(
    ("quantity", "text", "said"),
    [
        ("speed", "20:5", "rises"), ("speed", "0:5", "above 0"), ("angle", "10:95", "up to 90 deg"),
        ("spin", "fast", "expected LOW:HIGH"), ("spin", "1:2 m/s", "measures speed"),
        ("speed", "5:20:1", "two steps"), ("speed", "1:1e9", "1000 m/s"),
    ],
)  # fmt: skip
def test_ranges_are_refused_with_their_text(quantity, text, said):
    with pytest.raises(ParameterError, match=said) as raised:
        parse_range(quantity, text)
    assert text in str(raised.value)


def test_ranges_have_units():
    assert parse_range("spin", "-300:300 rpm") == Range(-10.0 * np.pi, 10.0 * np.pi)
    assert parse_range("speed", "36:72:3 km/h") == Range(10.0, 20.0, 3)
    assert parse_range("angle", "90").high == pytest.approx(np.pi / 2.0)


def test_a_fit_plans_as_the_function_does(grip_slip_fit, brief):
    where = {"speed": (20.0, 30.0), "angle": "16:60:3", "spin": 0.0, "impacts": 2, "sensors": "none"}
    plan, again = grip_slip_fit.plan("mu", **where), fitball.plan(grip_slip_fit, ["mu"], **where)
    assert plan.json() == again.json() and "2 impacts about mu" in repr(plan)
    assert list(plan.to_frame().index) == ["1", "2"]
    for wrong, said in (({"target": "nu"}, "no parameter of this fit"), ({"target": "v=3"}, "expected parameters"),
                        ({"impacts": 0}, "from 1 to 100"), ({"cost": {"radar": 2.0}}, "no such sensor"),
                        ({"target": "mu,mu"}, "given twice"), ({"speed": (3.0,)}, "expected a text")):  # fmt: skip
        with pytest.raises(ParameterError, match=said):
            grip_slip_fit.plan(**wrong)
