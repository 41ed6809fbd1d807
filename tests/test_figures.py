"""What figures show, against numbers from elsewhere: intervals, curves, residuals, axes, colours, symbols."""

from __future__ import annotations

import re
from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.stats import norm, t

import fitball
from fitball.data.read import load_table
from fitball.data.scene import Scene
from fitball.errors import ParameterError
from fitball.inference.prediction.posterior_predictive import NEAR, curves
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.noise import KINDS
from fitball.inference.problem.pooling import build_group_bias
from fitball.inference.problem.problem import Choices
from fitball.models.registry import model
from fitball.observables import OBSERVABLES
from fitball.report.figures.evidence import LEVELS, corner_data, pair_density
from fitball.report.figures.measured import agreements, incident_quantities, interval_band, residual_data, trend
from fitball.report.figures.predictions import curve_columns
from fitball.report.figures.quantities import measured_outputs
from fitball.report.figures.registry import draw
from fitball.report.fit.document import page
from fitball.report.fit.rows import thesis_rows

DROP = "v_y1,v_y2\n4,3.21\n6,4.68\n8,6.13\n10,7.48\n"
TRUTH = {
    "mu": 0.55,
    "e_x": 0.1,
    "offset": 2e-3,
    "cor_10": 0.76,
    "cor_slope": -0.013,
    "velocity_sd": 0.2,
    "v_x_sd": 0.2,
    "v_y_sd": 0.2,
    "spin_sd": 8.0,
}


@pytest.fixture
def grip_slip_fit(grip_slip_fit):
    """The frozen values of the shared fit, which figures are made from."""
    return grip_slip_fit


def table_of(tmp_path, rows, name="mixed"):
    """A table of rows (v_1, theta_1 [deg], omega_1) with the rebounds of grip-slip, and noise of a fixed seed."""
    speed, angle, spin = np.array(rows, dtype=float).T
    impacts = fitball.impacts(speed * np.cos(np.radians(angle)), speed * np.sin(np.radians(angle)), spin)
    chosen = model("grip-slip")
    made = chosen.rebound({name: TRUTH[name] for name in ("mu", "e_x", "offset", "cor_10", "cor_slope")}, impacts)
    rng = np.random.default_rng(7)
    columns = [impacts.v_x1, impacts.v_y1, spin]
    columns += [
        getattr(made, key) + rng.normal(0.0, sd, speed.size)
        for key, sd in (("v_x2", 0.2), ("v_y2", 0.2), ("omega_2", 8.0))
    ]
    place = tmp_path / f"{name}.csv"
    np.savetxt(
        place, np.stack(columns, axis=1), delimiter=",", header="v_x1,v_y1,omega_1,v_x2,v_y2,omega_2", comments=""
    )
    return place


def problem_of(place):
    """The problem of a table under grip-slip, without any fit."""
    return build_problem(load_table(place), Scene(), Choices(model="grip-slip"))


# --- measured against predicted


def test_intervals_tell_noise_from_parameters(grip_slip_fit):
    found = {item.name: item for item in agreements(grip_slip_fit)}
    assert set(found) == {item.name for item in grip_slip_fit.problem.observables}
    for item in grip_slip_fit.predictive.observables:
        shown = found[item.name]
        np.testing.assert_allclose(shown.measured, item.observed)
        np.testing.assert_allclose(shown.predicted, item.median)
        np.testing.assert_allclose(shown.model, [item.mean_q025, item.mean_q975])
        np.testing.assert_allclose(shown.measurement, [item.data_q025, item.data_q975])
        # Noise widens every interval.
        assert np.all(np.diff(shown.measurement, axis=0) > np.diff(shown.model, axis=0))
        inside = int(np.sum((item.observed > item.data_q025) & (item.observed < item.data_q975)))
        assert shown.words == f"{inside} of 21 within 95 %"
        assert 17 <= inside <= 21
    texts = [text.get_text() for axis in draw("predictive", grip_slip_fit).axes for text in axis.texts]
    assert sorted(texts) == sorted(item.words for item in found.values())


def test_a_point_fit_has_intervals_of_noise_alone(point_fit):
    for shown, item in zip(agreements(point_fit), point_fit.problem.observables, strict=True):
        predicted = item.predict(point_fit.point.rebound)[0]
        sd = point_fit.point.values[item.noise]
        np.testing.assert_allclose(shown.predicted, predicted)
        np.testing.assert_allclose(shown.measurement, predicted + sd * norm.ppf([[0.025], [0.975]]))
        assert shown.model is None


def test_the_reach_of_heavy_tails_is_their_own():
    for freedom in (2.5, 8.0):
        reach = KINDS["student-t"].reach(0.95, {"degrees_of_freedom": freedom})
        assert reach == pytest.approx(t.ppf(0.975, freedom), rel=0.04)
    assert KINDS["normal"].reach(0.95, {}) == pytest.approx(1.959964, rel=1e-6)


def test_a_band_of_many_intervals_keeps_their_width(grip_slip_fit):
    item = agreements(grip_slip_fit)[0]
    many = np.linspace(0.0, 10.0, 4000)
    wide = replace(
        item,
        rows=np.arange(4000),
        measured=many,
        predicted=many,
        model=None,
        measurement=np.stack([many - 0.5, many + 1.0]),
    )
    places, ends = interval_band(wide, wide.measurement)
    assert np.all(np.diff(places) > 0.0)
    np.testing.assert_allclose(ends - places, [[-0.5] * places.size, [1.0] * places.size])
    assert wide.words == "4,000 of 4,000 within 95 %"


# --- curves


def test_curves_are_at_the_speeds_and_spins_of_most_impacts(tmp_path):
    rng = np.random.default_rng(3)
    crowds = [(12.0, -300.0, 20), (25.0, 0.0, 14), (25.0, 400.0, 9)]
    rows = [
        (rng.normal(speed, 0.02 * speed), rng.uniform(15.0, 70.0), rng.normal(spin, 5.0))
        for speed, spin, count in crowds for _ in range(count)
    ]  # fmt: skip
    rows += [(rng.uniform(5.0, 35.0), rng.uniform(15.0, 70.0), rng.uniform(-600.0, 600.0)) for _ in range(5)]
    problem = problem_of(table_of(tmp_path, rows))
    values = np.array([[TRUTH[name] for name in problem.free_names]])
    found = curves(problem, values)
    speed, spin = np.array(rows)[:, 0], np.array(rows)[:, 2]
    assert [item.spin for item in found] == pytest.approx([-300.0, 0.0, 400.0], abs=12.0)
    assert [item.speed for item in found] == pytest.approx([12.0, 25.0, 25.0], rel=0.03)
    for item, (_speed, _spin, count) in zip(found, crowds, strict=True):
        assert count <= item.rows.size <= count + 2
        assert np.all(np.abs(speed[item.rows] - item.speed) <= NEAR * item.speed)
        assert np.all(0.03302 * np.abs(spin[item.rows] - item.spin) <= NEAR * item.speed)
        # Every point of the curve has that speed and that spin: nothing is interpolated between impacts.
        np.testing.assert_allclose(np.hypot(item.impacts.v_x1, item.impacts.v_y1), item.speed)
        np.testing.assert_array_equal(item.impacts.omega_1, item.spin)
        np.testing.assert_allclose(np.arctan2(item.impacts.v_y1, item.impacts.v_x1), item.along)
        own = model("grip-slip").rebound(
            {name: TRUTH[name] for name in model("grip-slip").specs if name in TRUTH}, item.impacts
        )
        np.testing.assert_allclose(item.outputs["v_x2"][2], own.v_x2)
        np.testing.assert_allclose(item.outputs["v_2"][0], np.hypot(own.v_x2, own.v_y2))


def test_few_and_equal_impacts_have_a_curve_too(tmp_path):
    for name, rows in {"two": [(10.0, 30.0, 0.0), (30.0, 60.0, 200.0)], "one": [(20.0, 45.0, 50.0)] * 6}.items():
        problem = problem_of(table_of(tmp_path, rows, name))
        found = curves(problem, np.array([[TRUTH[name] for name in problem.free_names]]))
        assert len(found) == 1 and found[0].rows.size >= 1
        assert np.degrees(np.ptp(found[0].along)) >= 10.0 - 1e-9
        assert np.all(np.isfinite(found[0].outputs["omega_2"]))


def test_columns_say_where_they_are_and_show_what_was_measured(grip_slip_fit):
    columns = curve_columns(grip_slip_fit)
    assert len(columns) == 3
    impacts = grip_slip_fit.problem.impacts
    for column in columns:
        speed, spin = (float(word) for word in re.fullmatch(r"([\d.]+) m/s, ([+-]?\d+) rad/s", column.title).groups())
        assert np.all(np.abs(impacts.omega_1[column.rows] - spin) < 50.0)
        assert np.all(np.abs(np.hypot(impacts.v_x1, impacts.v_y1)[column.rows] / speed - 1.0) <= NEAR)
        assert list(column.bands) == ["v_x2", "v_y2", "v_2", "theta_2", "omega_2"]
        angle = np.degrees(np.arctan2(impacts.v_y1, impacts.v_x1))[column.rows]
        assert column.within == pytest.approx((angle.min(), angle.max()))
        for band in column.bands.values():
            assert np.all(np.diff(band, axis=0) >= 0.0)
    # Wang's three spins, seven impacts each.
    groups = [set(np.array(grip_slip_fit.problem.groups)[column.rows]) for column in columns]
    assert groups == [{"backspin"}, {"zero"}, {"topspin"}]


def test_speed_and_angle_follow_from_components_with_their_noise(grip_slip_fit):
    shown = measured_outputs(grip_slip_fit)
    v_x, v_y, sd_x, sd_y = shown["v_x2"].values, shown["v_y2"].values, shown["v_x2"].sd, shown["v_y2"].sd
    np.testing.assert_allclose(np.radians(shown["theta_2"].values), np.arctan2(v_y, v_x))
    np.testing.assert_allclose(shown["v_2"].values, np.hypot(v_x, v_y))
    # By shaking the components.
    shaken = np.random.default_rng(1).normal(size=(2, 20_000, 1))
    fast, tilt = (
        np.hypot(v_x + sd_x * shaken[0], v_y + sd_y * shaken[1]),
        np.arctan2(v_y + sd_y * shaken[1], v_x + sd_x * shaken[0]),
    )
    np.testing.assert_allclose(shown["v_2"].sd, fast.std(axis=0), rtol=0.05)
    np.testing.assert_allclose(np.radians(shown["theta_2"].sd), tilt.std(axis=0), rtol=0.05)


def test_what_was_not_measured_is_not_drawn(grip_slip_fit):
    """A column with gaps, as NaN and as a list of rows."""
    observed = grip_slip_fit.problem.observables[0].observed.copy()
    observed[[2, 5]] = np.nan
    kept = np.flatnonzero(np.isfinite(observed))
    whole = grip_slip_fit.problem.observables
    for first in (replace(whole[0], observed=observed), replace(whole[0], observed=observed[kept], rows=kept)):
        gappy = replace(grip_slip_fit, problem=replace(grip_slip_fit.problem, observables=(first, *whole[1:])))
        assert agreements(gappy)[0].rows.tolist() == kept.tolist()
        np.testing.assert_allclose(
            agreements(gappy)[0].predicted, grip_slip_fit.predictive.observables[0].median[kept]
        )
        assert agreements(gappy)[0].inside.size == 19
        assert residual_data(gappy)[0].rows.tolist() == kept.tolist()
        assert measured_outputs(gappy)["theta_2"].rows.tolist() == kept.tolist()
        for kind in ("predictive", "curves", "residuals"):
            draw(kind, gappy)


# --- residuals


def test_residuals_are_those_of_the_measurements_against_everything(grip_slip_fit):
    for item, prediction in zip(residual_data(grip_slip_fit), grip_slip_fit.predictive.observables, strict=True):
        np.testing.assert_allclose(item.values * prediction.sd + prediction.median, prediction.observed)
    assert list(incident_quantities(grip_slip_fit)) == ["v_x1", "v_y1", "v_1", "theta_1", "omega_1"]
    figure = draw("residuals", grip_slip_fit)
    labels = [axis.get_xlabel() for axis in figure.axes if axis.get_xlabel()]
    assert [label.split(" [")[0] for label in labels] == [
        "$v_{x1}$", "$v_{y1}$", r"speed $v_1$", r"angle $\theta_1$", r"spin $\omega_1$", "group", "normal quantile",
    ]  # fmt: skip


def test_residuals_are_what_a_fitted_bias_leaves(grip_slip_fit):
    """A bias of two noises in each column of one group is a parameter, and no residual."""
    table, problem = grip_slip_fit.problem.table, grip_slip_fit.problem
    biased = replace(problem, group_bias=build_group_bias(table, "group"))
    sizes = {item.name: 2.0 * item.sd[0] for item in grip_slip_fit.predictive.observables}
    offsets = tuple(
        replace(grip_slip_fit.estimates[0], name=f"{name}_offset[{group}]", median=size * (group == "zero"))
        for name, size in sizes.items()
        for group in sorted(set(table.labels["group"]))
    )
    fit = replace(
        grip_slip_fit, problem=biased, parameters={item.name: item for item in (*grip_slip_fit.estimates, *offsets)}
    )
    mine = np.array(table.labels["group"]) == "zero"
    for item, other in zip(residual_data(grip_slip_fit), residual_data(fit), strict=True):
        np.testing.assert_allclose(item.values - other.values, 2.0 * mine, rtol=0.05)


def test_only_what_differs_has_a_panel(tmp_path):
    problem = problem_of(table_of(tmp_path, [(20.0, angle, 0.0) for angle in (15.0, 30.0, 45.0)]))

    class Shown:
        pass

    shown = Shown()
    shown.problem = problem
    assert list(incident_quantities(shown)) == ["v_x1", "v_y1", "theta_1"]


def test_means_over_bins_find_what_a_cloud_hides():
    rng = np.random.default_rng(5)
    along = rng.uniform(0.0, 10.0, 8000)
    found = trend(along, 0.2 * np.sin(along) + rng.normal(size=8000), 12)
    assert found.along.size == 12
    expected = 0.2 * np.sin(found.along)
    assert np.mean(np.abs(found.mean - expected) < found.half) > 0.7
    np.testing.assert_allclose(found.half, 1.96 / np.sqrt(8000 / 12), rtol=0.15)
    # Equal values of the quantity stay in one bin.
    two = trend(np.repeat([1.0, 2.0], 50), np.repeat([0.0, 1.0], 50) + rng.normal(0.0, 0.01, 100), 12)
    np.testing.assert_allclose(two.along, [1.0, 2.0])


# --- parameters


def test_corner_shows_the_prior_as_it_is(grip_slip_fit):
    data = corner_data(grip_slip_fit)
    names = grip_slip_fit.posterior.names
    k = names.index("mu")
    middle = 0.5 * (data.edges[k][1:] + data.edges[k][:-1])
    np.testing.assert_allclose(data.prior[k], norm.pdf(middle, 0.55, 0.05), rtol=1e-6)
    k = names.index("offset")
    assert data.axes[k].label.endswith("[mm]")
    middle = 0.5 * (data.edges[k][1:] + data.edges[k][:-1])
    np.testing.assert_allclose(data.prior[k], norm.pdf(middle, 0.0, 5.0), rtol=0.02)
    for k in range(len(names)):
        assert data.edges[k][0] < data.point[k] < data.edges[k][-1]
        assert np.sum(data.posterior[k] * np.diff(data.edges[k])) == pytest.approx(1.0, abs=0.01)


def test_densities_on_a_logarithmic_axis_are_per_logarithm(grip_slip_fit):
    k = grip_slip_fit.posterior.names.index("spin_sd")
    plain = corner_data(grip_slip_fit)
    problem = grip_slip_fit.problem
    noise = next(item for item in problem.parameters if item.name == "spin_sd")
    logarithmic = replace(noise, spec=replace(noise.spec, logarithmic=True))
    parameters = tuple(logarithmic if item.name == "spin_sd" else item for item in problem.parameters)
    data = corner_data(replace(grip_slip_fit, problem=replace(problem, parameters=parameters)))
    assert not plain.axes[k].logarithmic and data.axes[k].logarithmic
    np.testing.assert_allclose(np.diff(np.log(data.edges[k])), np.log(data.edges[k][1] / data.edges[k][0]))
    middle = np.sqrt(data.edges[k][1:] * data.edges[k][:-1])
    np.testing.assert_allclose(data.prior[k], norm.pdf(np.log(middle), np.log(10.0), 0.7), rtol=1e-6)
    assert np.sum(data.posterior[k] * np.diff(np.log(data.edges[k]))) == pytest.approx(1.0, abs=0.01)


def test_contours_hold_their_share_of_the_draws(grip_slip_fit):
    data = corner_data(grip_slip_fit)
    density, levels = pair_density(data, 0, 1)
    for level, share in zip(levels, LEVELS[::-1], strict=True):
        assert density[density >= level].sum() / density.sum() == pytest.approx(share, abs=0.03)


def test_the_package_corner_draws_the_same_in_panels_of_its_own(grip_slip_fit):
    fit = grip_slip_fit
    ours, theirs = corner_data(grip_slip_fit), fit.plot.corner(package="corner")
    count = len(ours.axes)
    panels = np.array(theirs.axes).reshape(count, count)
    assert [axis.get_xlabel() for axis in panels[-1]] == [axis.label for axis in ours.axes]
    for k, panel in enumerate(np.diag(panels)):
        assert panel.get_xscale() == ("log" if ours.axes[k].logarithmic else "linear")
        # Its line of truth is our point estimate, among the draws.
        assert panel.lines[0].get_xdata()[0] == pytest.approx(ours.point[k])
        assert panel.get_xlim()[0] < ours.point[k] < panel.get_xlim()[1]
    assert plt.get_fignums() == []
    with pytest.raises(ParameterError, match="expected 'fitball' or 'corner'"):
        fit.plot.corner(package="korner")


def test_a_legend_names_other_impacts_where_some_stand_back(point_fit):
    told = [text.get_text() for text in draw("curves", point_fit).legends[0].get_texts()]
    rows = [column.rows.size for column in curve_columns(point_fit)]
    assert ("other impacts" in told) is any(size < len(point_fit.problem.table) for size in rows)


def test_a_drop_test_has_no_spin_and_one_curve(tmp_path):
    (tmp_path / "drop.csv").write_text(DROP, encoding="utf-8")
    fit = fitball.calibrate(tmp_path / "drop.csv", model="brody", point_only=True, cores=1)
    assert "topspin" not in " ".join(text.get_text() for text in draw("sketch", fit).axes[0].texts)
    (column,) = curve_columns(fit)
    assert list(column.bands) == ["v_y2"] and column.title == ""
    assert (column.along[0], column.along[-1]) == (4.0, 10.0)
    cor = fit.point.values["cor_10"] + fit.point.values["cor_slope"] * (column.along - 10.0)
    np.testing.assert_allclose(column.bands["v_y2"][0], cor * column.along)
    assert list(incident_quantities(fit)) == ["v_y1"]
    # Thesis units stand only beside the thesis's data.
    assert thesis_rows(fit) == []
    assert "In the units of the thesis" not in page(fit, {})


def test_a_table_of_speeds_alone_has_its_panel(tmp_path):
    table = tmp_path / "speeds.csv"
    table.write_text(
        "v_1 [mph],theta_1,v_2 [mph]\n38.1,18.2,28.0\n40.2,22.9,29.1\n42.0,35.1,30.2\n", encoding="utf-8"
    )
    fit = fitball.calibrate(table, model="grip-slip", point_only=True, cores=1)
    assert list(measured_outputs(fit)) == ["v_2"]
    shown = draw("curves", fit)
    assert [axis.get_ylabel() for axis in shown.axes if axis.get_ylabel()] == [f"{OBSERVABLES['v_2'].symbol} [m/s]"]
