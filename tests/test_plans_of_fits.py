"""Plans from a real fit: both estimators, new groups, levels, uncertain incidence, costs, and what is refused."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import nested_monte_carlo
import numpy as np
import pandas as pd
import pytest
from nested_monte_carlo import Planned, nested_gain
from test_design import first_order, posterior_from

import fitball
from fitball.data.lines import Range, parse_range
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.data.table import joined
from fitball.errors import FitError, ParameterError
from fitball.inference.design.asked import as_before, build_settings, columns_read, parse_sensor, usual_sensors
from fitball.inference.design.knowledge import NEXT, Knowledge, knowledge
from fitball.inference.design.make_plan import Asked, Chosen, make_plan
from fitball.inference.design.search import information_rows, nothing_measured, over_draws, read
from fitball.inference.design.targets import Part, parse_target
from fitball.inference.likelihood.cells import shared_covariance
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.level_names import heads_of
from fitball.report.plan.document import chosen_table, plan_rows
from fitball.values import Impacts

RNG = np.random.default_rng(11)


@pytest.fixture(scope="module")
def known(grip_slip_fit):
    return knowledge(grip_slip_fit.problem, grip_slip_fit.posterior, np.random.default_rng(1))


@pytest.fixture
def briefly(monkeypatch):
    """Fewer simulations than the estimator takes."""
    monkeypatch.setattr(nested_monte_carlo, "OUTER", 300)
    monkeypatch.setattr(nested_monte_carlo, "NEAR", 50)


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


def test_both_estimators_agree_on_a_real_fit(known, briefly):
    """One of them knows no derivative of the bounce, the other no simulated measurement."""
    for text, impact in (("mu", ITF), ("court pace", ITF), ("impact=v=15 m/s, theta=50 deg", ITF), (None, ITF)):
        target, sensor = parse_target(text, known), as_before(known.problem)
        planned, draws = known.at(impact, np.zeros(1, dtype=np.int64)), known.some(60)
        solved = planned.rebound(planned.to_values(draws)).status == 0
        first = over_draws(first_order(known, planned, target, sensor, draws), solved)[0]
        checked = nested_gain(known, [Planned(planned, sensor)], target, np.random.default_rng(2))
        assert checked.left_out < 0.01
        assert checked.nats == pytest.approx(first, abs=0.06 + 3.0 * checked.se), text


def told_of_noise(known, planned, made, sensor):
    """Information about fitted noises beside scatter that they share is the curvature of a Kullback-Leibler distance,
    by differences: of the distribution of what is read from that with one noise, or two, a little larger.
    """
    names = known.problem.free_names
    free = [names.index(column.noise) for column in sensor.columns]
    rows = information_rows(planned, made, np.eye(len(names))[None])[0, 0, len(sensor.columns) :][:, free]
    sds = np.stack([column.sds(made.columns, made.rebound) for column in sensor.columns], axis=2)[0, 0]
    shared = shared_covariance(planned, made.columns, made.rebound, sensor.columns)[0, 0]

    def distance(logs):
        one, other = (shared + np.diag(sds * np.exp(by)) ** 2 for by in (np.zeros(len(free)), logs))
        ratio = np.linalg.solve(other, one)
        return 0.5 * (np.trace(ratio) - len(free) - np.linalg.slogdet(ratio)[1])

    step, unit = 1e-3, np.eye(len(free))
    for k, one in enumerate(unit):
        for other in unit[k:]:
            signed = sum(a * b * distance(step * (a * one + b * other)) for a in (1, -1) for b in (1, -1))
            curvature = signed / (4.0 * step**2)
            assert (rows.T @ rows)[k, int(np.argmax(other))] == pytest.approx(curvature, rel=1e-4, abs=1e-5)


def test_an_uncertain_incident_state_adds_its_scatter(known, briefly):
    """As balls that come with just these errors scatter, and a gain falls."""
    table = replace(
        known.problem.table,
        incident_covariance=np.tile(np.diag([0.04, 0.01, 25.0]), (len(known.problem.impacts), 1, 1)),
    )
    problem = build_problem(table, known.problem.scene, Choices(model="grip-slip"))
    uncertain = Knowledge(problem, known.coordinates)
    planned, draws = uncertain.at(ITF, np.zeros(1, dtype=np.int64)), uncertain.some(1)
    sensor = as_before(problem)
    (made,) = read(planned, draws, [sensor])
    found = shared_covariance(planned, made.columns, made.rebound, sensor.columns)[0, 0]
    # Errors of this size are those of a typical impact: its speed, direction and spin.
    assert planned.errors is not None
    # They are as large in speed and direction for every impact, whatever its speed.
    along = np.array([28.8, 8.3]) / np.hypot(28.8, 8.3)
    turned = planned.errors.incident[0][:2, :2]
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
    states = np.random.default_rng(8).multivariate_normal([28.8, 8.3, 0.0], planned.errors.incident[0], 4000)
    rebound = problem.rebound(problem.to_values(draws), Impacts(*states.T))
    columns = np.stack([column.column.predict(rebound)[0] for column in sensor.columns])
    assert np.sqrt(np.diag(found)) == pytest.approx(columns.std(axis=1), rel=0.06)
    exact = known.at(ITF, np.zeros(1, dtype=np.int64))
    rows = [information_rows(at, *read(at, draws, [sensor]), known.roots(draws)) for at in (exact, planned)]
    assert (rows[1] ** 2).sum() < (rows[0] ** 2).sum()
    told_of_noise(uncertain, planned, made, sensor)
    checked = nested_gain(
        uncertain, [Planned(planned, sensor)], parse_target("mu", uncertain), np.random.default_rng(2)
    )
    gain = first_order(uncertain, planned, parse_target("mu", uncertain), sensor, uncertain.some(60))
    assert checked.nats == pytest.approx(gain.mean(), abs=0.06 + 3.0 * checked.se)


def test_a_new_group_brings_its_own_bias(known):
    """Its measurements tell less than those of a group without one, and its bias is as uncertain as its prior."""
    problem = build_problem(known.problem.table, known.problem.scene, Choices(model="grip-slip", offsets="group"))
    rng = np.random.default_rng(9)
    posterior = posterior_from(problem, np.column_stack([column_of(known, name, rng) for name in problem.free_names]))
    grouped = knowledge(problem, posterior, np.random.default_rng(1))
    added = [name for name in grouped.problem.free_names if NEXT in name]
    assert len(added) == len(problem.observables)
    k = grouped.problem.free_names.index(added[0])
    assert grouped.coordinates[:, k].std() == pytest.approx(grouped.problem.free[k].prior.b, rel=0.05)
    gains = []
    for one in (known, grouped):
        at, some = one.at(ITF, np.zeros(1, dtype=np.int64)), one.some(20)
        gains.append(first_order(one, at, parse_target("mu", one), as_before(one.problem), some).mean())
    assert gains[1] < 0.7 * gains[0]
    plan = make_plan(
        problem,
        posterior,
        Asked("mu", parse_range("speed", "20:30:2"), parse_range("angle", "20:60:3"), impacts=2, sensors=["none"]),
    )
    states = [one.setting for one in plan.chosen]
    batch = Impacts(
        np.array([state.speed * np.cos(state.angle) for state in states]),
        np.array([state.speed * np.sin(state.angle) for state in states]),
        np.array([state.spin for state in states]),
    )
    planned = Planned(grouped.at(batch, np.zeros(2, dtype=np.int64)), as_before(grouped.problem))
    checked = nested_gain(grouped, [planned], parse_target("mu", grouped), np.random.default_rng(2))
    assert plan.gain == pytest.approx(checked.nats, abs=0.08 + 3.0 * checked.se)


def test_a_column_that_was_not_measured_has_no_bias(known):
    """A sensor beside the biased columns reads its own as the model gives it."""
    problem = build_problem(known.problem.table, known.problem.scene, Choices(model="two-mass", offsets="group"))
    medians = [float(item.prior.quantile(np.array(0.5))) for item in problem.free]
    typical = [item.spec.typical for item in problem.free]
    middle = np.array([[one if other is None else other for one, other in zip(medians, typical, strict=True)]])
    grouped = knowledge(problem, posterior_from(problem, np.repeat(middle, 50, axis=0)), np.random.default_rng(1))
    at, draws = grouped.at(ITF, np.zeros(1, dtype=np.int64)), grouped.some(3)
    (cells,) = read(at, draws, [parse_sensor(problem, "gaps=1")])
    assert np.all(cells.rebound.status == 0)
    for place, name in enumerate(grouped.problem.free_names):
        if "_offset[" in name:
            reads = np.abs(cells.spread_out(cells.slope)[..., place]).max(axis=(0, 1))
            assert np.count_nonzero(reads) == (NEXT in name), name


def column_of(known, name, rng):
    """Values of a parameter: those of the fit without offsets, and nothing for what that has not."""
    if name in known.problem.free_names:
        return known.problem.to_values(known.coordinates)[:, known.problem.free_names.index(name)]
    return 1e-3 * rng.standard_normal(len(known.coordinates))


def test_levels_are_places_to_measure_at(known):
    """A surface of which little is known is the one to measure on, under its whole name."""
    group = tuple(f"{label}, wet" for label in known.problem.table.labels["group"])
    table = replace(known.problem.table, labels={"group": group})
    problem = build_problem(table, known.problem.scene, Choices(model="grip-slip", pool={"mu": "group"}))
    labels = problem.pooling[0].labels
    rng, values = np.random.default_rng(9), []
    for name in problem.free_names:
        if name == "mu_spread":
            values.append(np.abs(rng.normal(0.1, 0.01, len(known.coordinates))))
        elif name.startswith("mu_place"):
            values.append(rng.normal(0.0, 1.0 if labels[1] in name else 0.05, len(known.coordinates)))
        else:
            values.append(column_of(known, name, rng))
    where = [parse_range(*one) for one in (("speed", "25"), ("angle", "16"), ("spin", "0"))]
    plan = make_plan(
        problem, posterior_from(problem, np.column_stack(values)), Asked("court pace", *where, 1, sensors=["none"])
    )
    assert plan.settings.surfaces == labels and len(plan.parts) == len(labels)
    assert plan.chosen[0].setting.surface == plan_rows(plan, problem)[0]["group"] == labels[1]
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


def levelled_fit(known, **choices):
    """The problem with mu by group, and draws with mu of each group well known while common value and spread are
    not.
    """
    problem = build_problem(
        known.problem.table, known.problem.scene, Choices(model="grip-slip", pool={"mu": "group"}, **choices)
    )
    rng, count = np.random.default_rng(9), len(known.coordinates)
    common, spread = rng.normal(0.5, 0.1, count), 0.03 + np.abs(rng.normal(0.0, 0.15, count))
    values = {"mu": common, "mu_spread": spread}
    for k, label in enumerate(problem.pooling[0].labels):
        values[f"mu_place[{label}]"] = (rng.normal(0.55 + 0.03 * k, 0.005 * (k + 1), count) - common) / spread
    plain = {name: known.coordinates[:, known.problem.free_names.index(name)] for name in known.problem.free_names}
    return Knowledge(problem, np.column_stack([values.get(name, plain.get(name)) for name in problem.free_names]))


@pytest.mark.parametrize("text", [None, "mu", "impact=v=30 m/s, theta=16 deg", "court pace"])
def test_a_target_has_a_part_for_each_level(known, text):
    """A parameter at a level, not the value common to all, is what a measurement there determines."""
    levelled = levelled_fit(known)
    labels = levelled.problem.pooling[0].labels
    target = parse_target(text, levelled)
    named = [part.name for part in target.parts]
    assert not {"mu", "v_x2"} & {*named} and all(any(label in name for name in named) for label in labels)
    one = parse_target(text, levelled, {"group": labels[1]})
    kept = [k for k, name in enumerate(named) if not any(label in name for label in labels) or labels[1] in name]
    assert [part.name for part in one.parts] == [named[k] for k in kept]
    draws = levelled.some(60)
    assert one.values(draws) == pytest.approx(target.values(draws)[:, kept], rel=1e-12)
    found = nothing_measured(target.gradients(draws) @ levelled.roots(draws)).sds.mean(axis=0)
    assert found == pytest.approx(np.nanstd(target.values(levelled.coordinates), axis=0), rel=0.15)
    if text == "mu":
        assert np.std(target.values(levelled.coordinates), axis=0) == pytest.approx([0.005, 0.01, 0.015], rel=0.1)


def test_a_parameter_at_one_level_is_asked_for_by_its_name_and_the_level(known):
    levelled = levelled_fit(known)
    label = levelled.problem.pooling[0].labels[1]
    words = f"'mu[{label}]' is mu at one group: name mu, and levels={{'group': {label!r}}} for that one alone"
    with pytest.raises(ParameterError, match=re.escape(words)):
        parse_target(f"mu[{label}]", levelled)


def test_a_plan_for_one_level_measures_there(known):
    levelled = levelled_fit(known)
    labels = levelled.problem.pooling[0].labels
    where = [parse_range(*one) for one in (("speed", "25"), ("angle", "16"), ("spin", "0"))]
    posterior = posterior_from(levelled.problem, levelled.problem.to_values(levelled.coordinates))
    both, one = (
        make_plan(levelled.problem, posterior, Asked("mu", *where, 1, sensors=["none"], levels=levels))
        for levels in ({}, {"group": labels[0].upper()})
    )
    assert both.settings.surfaces == labels and one.settings.surfaces == labels[:1]
    assert "group" in chosen_table(one)[0]
    assert heads_of(("Position", "court")) == ("place", "surface")
    assert heads_of(("court", "floor")) == ("court", "floor")
    assert one.chosen[0].setting.surface == labels[0]
    assert [part.name for part in one.parts] == [f"mu[{labels[0]}]"]
    with pytest.raises(ParameterError, match="a plan needs a group that was fitted"):
        make_plan(levelled.problem, posterior, Asked("mu", *where, 1, levels={"group": "new"}))


def test_costs_decide_between_sensors(grip_slip_fit):
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


def test_the_table_to_be_filled_in_can_be_fitted_with_the_first(known):
    """With stated sds, levels whose labels hold commas, two parameters over them, and columns of other sensors."""
    frame = known.problem.table.to_frame()
    frame["group"] = [f"{label}, old" for label in known.problem.table.labels["group"]]
    stated = {"v_x2": "m/s", "v_y2": "m/s", "omega_2": "rad/s", "v_x1": "m/s", "v_y1": "m/s", "omega_1": "rad/s"}
    for name, unit in stated.items():
        frame[f"{name}_sd [{unit}]"] = 0.1
    table = load_table(frame, name="first")
    problem = build_problem(table, Scene(), Choices(model="grip-slip", pool={"mu": "group", "cor_10": "group"}))
    settings = build_settings(
        problem, *(parse_range(*one) for one in (("speed", "20"), ("angle", "30"), ("spin", "0")))
    )
    labels = list(dict.fromkeys(frame["group"]))
    assert list(settings.surfaces) == labels
    chosen = [
        Chosen(settings.setting(place), sensor, 1.0, np.array([0.1]), 0.0, {})
        for place, sensor in ((1, "as before"), (0, "contact_time+camera"))
    ]
    plan = SimpleNamespace(chosen=chosen, repeats=2, parts=(Part("v_x2", "m/s"),), settings=settings)
    rows = pd.DataFrame(plan_rows(plan, problem))
    assert rows["group"].tolist() == [labels[1]] * 2 + [labels[0]] * 2
    values = {"v_x2": 8.0, "v_y2": 7.0, "omega_2": 250.0, "contact_time": 4.0, "theta_1_sd": 0.5}
    for column in rows.columns[rows.isna().all()]:
        rows[column] = values.get(column.partition(" ")[0], 0.1)
    both = joined([table, load_table(rows, name="second")])
    assert len(both) == len(table) + 4
    assert {item.name for item in both.measurements} == {"v_x2", "v_y2", "omega_2", "contact_time"}


def test_no_range_is_asked_for_that_would_be_refused():
    table = load_table({"v_x1": [15.0, 14.0], "v_y1": [5.0, 9.0], "v_x2": [10.0, 9.0], "v_y2": [4.0, 6.5]}, name="t")
    problem = build_problem(table, Scene(), Choices(model="grip-slip"))
    assert build_settings(problem, None, None, None).assumed == ("speed", "angle")
    with pytest.raises(ParameterError, match="has no spin"):
        build_settings(problem, None, None, Range(0.0, 0.0))


def test_fits_that_cannot_be_planned_from_say_why(drop_page, grip_slip_fit):
    with pytest.raises(FitError, match="a point fit has none"):
        fitball.plan(drop_page.parent)
    problem = build_problem(
        grip_slip_fit.table, grip_slip_fit.problem.scene, Choices(model="two-mass", closures={"cor": "measured"})
    )
    with pytest.raises(FitError, match="measured restitution of each impact"):
        knowledge(problem, grip_slip_fit.posterior, RNG)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("camera", "expected COLUMN=SD"), ("camera=0", "positive number"), ("camera=2m", "without a unit"),
        ("contact_time=0.2ms", "grip-slip has no contact time: it has no time axis"),
        ("gaps=1", "grip-slip has no time between the flights: it has no time axis"), ("gaps=1mm", "without a unit"),
        ("gap_path=1mm", "grip-slip has no path between the flights"),
        ("v_2=0.1", "follows from the measured velocities"),
        ("omega_2=5 m/s", "measures speed"), ("drop=254 kg", "unknown"), ("omega=3", "unknown column 'omega'"),
        ("drop=1000 m", "drop_height"), ("force=5N", "no force-time course"),
    ],
)  # fmt: skip
def test_sensors_are_refused_with_their_text(known, text, said):
    with pytest.raises(ParameterError, match=said) as raised:
        parse_sensor(known.problem, text)
    assert text in str(raised.value)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"target": 3}, "target: read 3, expected a text or a list, each a text"),
        ({"target": ["mu", 3]}, "target: read .*, expected a text or a list, each a text"),
        ({"target": []}, "target = "),
        ({"cost": {"camera": "3"}}, "cost: read {'camera': '3'}, expected a dict, each value a number"),
        ({"cost": {"camera": -3.0}}, "cost={'camera': -3}: expected a number above 0"),
        ({"speed": [5.0, 20.0, 7.0]}, "expected a text such as '5:20'"),
    ],
)  # fmt: skip
def test_what_no_plan_can_be_asked_is_refused(grip_slip_fit, asked, said):
    with pytest.raises(ParameterError, match=said):
        grip_slip_fit.plan(**{"speed": np.int64(20), "angle": "30", "spin": 0, "sensors": "camera=0.5"} | asked)


def test_sensors_that_nobody_asked_for_are_as_good_as_they_usually_are():
    table = load_table("wang_zero_spin.csv")
    asked = usual_sensors(build_problem(table, Scene(), Choices()))
    assert asked[:4] == ("contact_time=0.2ms", "force=20N", "camera=0.5", "gaps=1")
    # Models without them cannot use gaps.
    for name in ("brody", "thesis"):
        assert "gaps=1" not in usual_sensors(build_problem(table, Scene(), Choices(model=name)))
    assert usual_sensors(build_problem(table, Scene(), Choices(model="brody")))[0] == "camera=0.5"


def test_a_camera_that_sees_the_gaps_reads_three_columns_and_of_a_drop_one():
    table = load_table("wang_zero_spin.csv")
    problem = build_problem(table, Scene(), Choices())
    found = parse_sensor(problem, "gaps=0.5")
    sds = {column.name: float(column.sd) for column in found.columns if column.column.gap}
    assert sds == pytest.approx({"gap_time": 5e-5, "gap_path": 5e-4, "gap_turn": 0.02})
    assert found.words == "gaps within 0.05 ms, 0.5 mm, 1.1 deg"
    assert columns_read(problem, "contact_time+gaps") == ("contact_time", *sds)
    # One of them is finer than usual.
    finer = {column.name: column for column in parse_sensor(problem, "gaps=1,gap_turn=1deg").columns}
    assert float(finer["gap_turn"].sd) == pytest.approx(np.radians(1.0)) and float(finer["gap_time"].sd) == 1e-4
    # Gaps that were measured are measured as before.
    frame = table.to_frame().assign(**{"gap_time [ms]": 5.0})
    gappy = build_problem(load_table(frame, name="gappy"), Scene(), Choices())
    assert "gaps=1" not in usual_sensors(gappy) and "gap_time" in [c.name for c in as_before(gappy).columns]
    dropped = load_table({"v_y1": [4.0, 6.0, 8.0, 10.0], "v_y2": [3.2, 4.7, 6.1, 7.5]}, name="drop")
    drop = build_problem(dropped, Scene(), Choices(model="two-mass"))
    assert [column.name for column in parse_sensor(drop, "gaps=1").columns] == ["v_y2", "gap_time"]


@pytest.mark.parametrize(
    ("quantity", "text", "said"),
    [
        ("speed", "20:5", "increasing"), ("speed", "0:5", "above 0"), ("angle", "10:95", "up to 90 deg"),
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


def test_a_fit_plans_as_the_function_does(grip_slip_fit):
    where = {"speed": (20.0, 30.0), "angle": "16:60:3", "spin": 0.0, "impacts": 2, "sensors": "none"}
    plan, again = grip_slip_fit.plan("mu", **where), fitball.plan(grip_slip_fit, ["mu"], **where)
    assert plan.json() == again.json() and "2 impacts about mu" in repr(plan)
    assert list(plan.to_frame().index) == ["1", "2"]
    for wrong, said in (({"target": "nu"}, "no parameter of this fit"), ({"target": "v=3"}, "expected parameters"),
                        ({"impacts": 0}, "from 1 to 100"), ({"cost": {"radar": 2.0}}, "no such sensor"),
                        ({"target": "mu,mu"}, "given twice"), ({"speed": (3.0,)}, "expected a text")):  # fmt: skip
        with pytest.raises(ParameterError, match=said):
            grip_slip_fit.plan(**wrong)
