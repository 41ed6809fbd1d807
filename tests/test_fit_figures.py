"""Figures of a fit: what is drawn is what the frames say, and no table is too odd to be drawn."""

import warnings

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgba
from numpy.testing import assert_allclose, assert_array_equal
from support.drawn import dots
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.models.types import regime_name
from fitball.report.figures import FIGURES, drawable, parameters, predictions, shared
from fitball.report.quantities import quantity_symbol
from fitball.report.style import MODEL_COLOUR, MOVED_COLOUR, PRIOR_COLOUR, draw_styled, image_bytes

LONG = "a very long label of a surface that nobody would call short"
HOSTILE = "\U0001f3be<b>$\\frac{\n\u202e^"
BOTH = {"curves", "predictive", "residuals", "profiles", "forest"}
SLIDING = {"regimes", "regime_map"}
CASES = {
    "few": (
        {"frame": table_of(3), "sampled": False},
        (BOTH - {"forest"}) | SLIDING,
    ),
    "drop": (
        {"frame": table_of(12, drop=True)},
        BOTH | {"corner", "trace"},
    ),
    "many": (
        {
            "frame": table_of(60, ("clay", "grass", "hard", "carpet", "wood")),
            "model": "two-mass",
            "answer": "describes except",
        },
        BOTH | SLIDING | {"corner", "trace"},
    ),
    "texts": (
        {
            "frame": table_of(
                24,
                (f"{LONG} 1", HOSTILE),
                [f"{LONG}{HOSTILE} {k}" for k in range(24)],
            ),
            "name": HOSTILE,
        },
        BOTH | SLIDING | {"corner", "trace"},
    ),
}


@pytest.fixture(scope="module")
def fit():
    return fit_by_hand()


@pytest.fixture(scope="module")
def pooled():
    return fit_by_hand(table_of(36, ("clay", "hard", "wood")))


def figure(name, fit):
    return draw_styled(FIGURES[name].draw, fit)


def display_factor(fit, name):
    """What turns values in SI units into those that are shown."""
    return fit.quantity(name).spec.display_unit.factor


@pytest.mark.parametrize("case", CASES)
def test_every_figure_is_drawn_of_every_table(case):
    options, names = CASES[case]
    fit = fit_by_hand(**options)
    assert {*drawable(fit)} == names
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in names:
            drawn = figure(name, fit)
            assert image_bytes(drawn).startswith(b"\x89PNG"), name
            # 16 parameters and 60 impacts are too many for one picture.
            assert name != "corner" or len(drawn.axes) <= parameters.MOST_CORNERED**2


def test_dots_of_curves_are_residuals_added_to_their_line(pooled):
    axes = figure("curves", pooled).axes
    frame = pooled.predictions
    lines = pooled.curves
    for axis, column in zip(axes, dict.fromkeys(frame["column"]), strict=True):
        for k, look in shared.series_styles(lines).items():
            impacts = rows_of(frame, column=column, series=k)
            line = rows_of(lines, column=column, series=k)
            angle = np.degrees(impacts["theta_1"])
            on_line = np.interp(angle, np.degrees(line["along"]), line["median"])
            residual = impacts["observed"] - impacts["median"]
            expected = np.column_stack([angle, on_line + residual])
            assert_allclose(dots(axis, look.marker), expected, rtol=1e-12)


def rows_of(frame, column, series):
    """Rows of one column and one series."""
    of_column = frame[frame["column"] == column]
    return of_column[of_column["series"] == series]


def test_dots_and_bars_of_predictions_are_those_of_the_frame(fit):
    axes = figure("predictive", fit).axes
    columns = fit.predictions.groupby("column", sort=False)
    for axis, (_, rows) in zip(axes, columns, strict=True):
        drawn = np.concatenate([dots(axis, marker) for marker in "os"])
        expected = rows[["median", "observed"]].to_numpy()
        assert_array_equal(np.sort(drawn, axis=0), np.sort(expected, axis=0))
        segments = axis.collections[0].get_segments()
        bars = np.array([segment[:, 1] for segment in segments])
        assert_array_equal(bars, rows[["new_q025", "new_q975"]])
        inside = rows["observed"].between(rows["new_q025"], rows["new_q975"])
        words = axis.texts[0].get_text()
        assert words.startswith(f"{inside.sum()} of 24")


def trends(fit):
    """How many trends the figure of residuals shows."""
    drawn = figure("residuals", fit)
    return sum(line.get_color() == MOVED_COLOUR for axis in drawn.axes for line in axis.lines)


def with_bent_residuals(answer):
    """A fit of which the residuals of v_x2 follow the angle of impact."""
    fit = fit_by_hand(answer=answer)
    frame = fit.predictions
    angle = frame["theta_1"]
    bent = 3.0 * (angle - angle.mean()) + 0.1 * np.cos(frame["row"] * 5)
    frame["z"] = np.where(frame["column"] == "v_x2", bent, 0.0)
    return fit


def test_trends_are_drawn_only_where_a_residual_test_fails():
    assert trends(with_bent_residuals("describes")) == 0
    fit = with_bent_residuals("describes except")
    assert trends(fit) >= 1
    # One of twelve panels of noise in a hundred.
    frame = fit.predictions
    frame["z"] = np.random.default_rng(0).standard_normal(len(frame))
    assert trends(fit) == 0


def test_a_trend_agrees_with_the_f_test():
    from scipy.stats import f

    rng = np.random.default_rng(4)
    agreed = 0
    for k in range(200):
        x = rng.standard_normal(12)
        z = rng.standard_normal(12)
        z += 1.5 * x * (k % 2)
        parabola = np.polyval(np.polyfit(x, z, 2), x)
        remaining = np.sum((z - parabola) ** 2)
        total = np.sum((z - z.mean()) ** 2)
        ratio = ((total - remaining) / 2) / (remaining / 9)
        significant = f.sf(ratio, 2, 9) < 0.01
        assert (predictions._trend(x, z) is not None) == significant
        agreed += significant
    assert 20 < agreed < 180
    assert predictions._trend(np.ones(9), rng.standard_normal(9)) is None


def test_many_rows_are_drawn_as_bins(fit):
    long = fit_by_hand()
    rng = np.random.default_rng(5)
    frame = pd.concat([fit.predictions] * 1400, ignore_index=True)
    frame["theta_1"] += 0.05 * rng.standard_normal(len(frame))
    frame["z"] = rng.standard_normal(len(frame))
    frame["observed"] = frame["median"] + frame["noise"] * frame["z"]
    long.__dict__["predictions"] = frame
    assert len(frame) > 100_000
    for name in ("curves", "predictive", "residuals"):
        for axis in figure(name, long).axes:
            for line in axis.lines:
                assert len(line.get_xydata()) <= max(61, shared.BINS), name
    axis = figure("residuals", long).axes[0]
    of_column = frame[frame["column"] == "v_x2"]
    sorted_rows = of_column.sort_values("theta_1", kind="stable")
    size_of_bin = -(-len(sorted_rows) // shared.BINS)
    medians = sorted_rows[["theta_1", "z"]].iloc[:size_of_bin].median()
    middle = [np.degrees(medians["theta_1"]), medians["z"]]
    assert_allclose(dots(axis, "o")[0], middle, rtol=1e-12)


@pytest.fixture(scope="module")
def stiff():
    """A fit of which the stiffness has a prior far narrower than its draws."""
    fixed = {"k_theta": 20.0}
    prior = {"k_y": "lognormal(2e4, 0.3)"}
    fit = fit_by_hand(model="two-mass", fix=fixed, prior=prior)
    z = np.random.default_rng(6).standard_normal(400)
    fit.draws.values["k_y"][:] = 2e4 * np.exp(z)
    return fit


def test_a_corner_has_intervals_for_ticks_and_priors_that_integrate(stiff):
    drawn = figure("corner", stiff)
    names = parameters.corner_names(stiff)
    assert "k_theta" not in names
    assert "k_y" in names
    # Panels are on and below the diagonal.
    grid = np.full((len(names), len(names)), None)
    grid[np.tril_indices(len(names))] = drawn.axes
    for k, name in enumerate(names):
        if name == "k_y":
            # An axis of logarithms.
            continue
        interval = stiff.summary.loc[name, ["q025", "q975"]].to_numpy(float)
        expected = interval * display_factor(stiff, name)
        assert_allclose(grid[-1, k].get_xticks(), expected, rtol=1e-12)
    # All of the narrow prior lies within the axis, whose unit and logarithm change the density.
    k = names.index("k_y")
    curve = next(line for line in grid[k, k].lines if line.get_color() == PRIOR_COLOUR)
    x, y = curve.get_xydata().T
    dense = np.linspace(x[0], x[-1], 20_001)
    area = np.trapezoid(np.interp(dense, x, y), dense)
    assert area == pytest.approx(1.0, abs=0.01)
    by_name = {parameter.spec.name: parameter for parameter in stiff.problem.parameters}
    prior = by_name["k_y"].prior
    for at, height in zip(x[20:40:5], y[20:40:5], strict=True):
        # The axis shows log10 of kN/m, the prior's coordinate is ln of N/m.
        low = np.log(10.0 ** (at - 1e-4) * 1e3)
        high = np.log(10.0 ** (at + 1e-4) * 1e3)
        middle = np.array([0.5 * (low + high)])
        density = np.exp(prior.log_density(middle))[0]
        assert height == pytest.approx(density * (high - low) / 2e-4, rel=1e-6)


def test_a_forest_marks_what_moves_by_more_than_two_sds(fit):
    axes = {axis.get_title(loc="left"): axis for axis in figure("forest", fit).axes}
    axis = axes[quantity_symbol(fit, "mu")]
    summary = fit.summary.loc["mu"]
    moved = fit.variants.query("quantity == 'mu' and choice == 'offset=grip'").iloc[0]
    colours = {}
    for line in axis.lines:
        median, *others = line.get_xdata()
        if not others:
            colours[median] = to_rgba(line.get_color())
    assert colours[summary["median"]] == to_rgba(MODEL_COLOUR)
    assert colours[moved["median"]] == to_rgba(MOVED_COLOUR)
    to_data = axis.transData.inverted()
    shade = axis.patches[0].get_extents().transformed(to_data)
    interval = summary[["q025", "q975"]].astype(float)
    assert_allclose(shade.intervalx, interval, rtol=1e-12)
    # The variant that fits worse is not there, the constant has no median.
    assert sum(map(np.isfinite, colours)) == 2


def test_profiles_mark_their_intervals(fit):
    axes = figure("profiles", fit).axes
    for axis, (name, profile) in zip(axes, fit.profiles.items(), strict=False):
        factor = display_factor(fit, name)
        curve, bar, posterior = axis.lines
        expected = np.column_stack([factor * profile.values, -profile.drop])
        assert_allclose(curve.get_xydata(), expected)
        low, high = profile.interval_95
        if low is None:
            low = profile.values[0]
        assert_allclose(bar.get_xdata(), [factor * low, factor * high])
        interval = fit.summary.loc[name, ["q025", "q975"]].astype(float)
        assert_allclose(posterior.get_xdata(), factor * interval)


def test_bars_of_regimes_are_shares_of_draws():
    fit = fit_by_hand()
    fit.draws.values["mu"][:] = np.random.default_rng(7).uniform(0.2, 0.8, 400)
    axis = figure("regimes", fit).axes[0]
    ends = np.zeros(24)
    for bar in axis.patches:
        row = round(bar.get_y() + 0.4)
        # Each begins where the one before ends.
        assert bar.get_x() == pytest.approx(ends[row])
        ends[row] += bar.get_width()
    assert_allclose(ends, 1.0)
    names = [text.get_text().split("  ")[0] for text in axis.get_yticklabels()]
    model = fit.problem.forward.model
    draws = {spec.name: fit.draws.values[spec.name][:200] for spec in model.parameters}
    codes = model.rebound(draws, fit.problem.rows.states).regime
    all_widths = []
    for bars in axis.containers:
        regime = bars.get_label()
        for bar, name in zip(bars, names, strict=True):
            of_impact = [regime_name(code) for code in codes[:, int(name) - 1]]
            share = of_impact.count(regime) / len(of_impact)
            assert bar.get_width() == pytest.approx(share)
            all_widths.append(bar.get_width())
    assert sum(0.1 < width < 0.9 for width in all_widths) > 5


def test_the_regime_map_is_what_the_model_says(fit):
    drawn = figure("regime_map", fit)
    axis = drawn.axes[0]
    image = axis.images[0]
    legend = drawn.legends[0]
    names = [text.get_text() for text in legend.get_texts()]
    names_of_colours = names[: len(legend.get_patches())]
    west, east, south, north = image.get_extent()
    assert axis.get_xlim() == (west, east)
    assert axis.get_ylim() == (south, north)
    array = image.get_array()
    rows, columns = array.shape
    angles = np.radians(np.linspace(west, east, columns))
    spins = np.linspace(south, north, rows)
    speeds, _ = fit.problem.rows.states.polar()
    speed = np.median(speeds)
    model = fit.problem.forward.model
    values = {spec.name: fit.draws.point[spec.name] for spec in model.parameters}
    seen = set()
    for row in range(0, rows, 9):
        for column in range(0, columns, 7):
            v_x = speed * np.cos(angles[column])
            v_y = speed * np.sin(angles[column])
            rebound = model.rebound(values, fitball.impacts(v_x, v_y, spins[row]))
            regime = regime_name(rebound.regime[0])
            assert names_of_colours[int(array[row, column])] == regime
            seen.add(regime)
    assert len(seen) > 1


def test_a_legend_of_curves_names_the_speed_where_speeds_differ(pooled):
    lines = pooled.curves
    first = lines["series"].min()
    for speed_of_first, named in ((20.0, False), (10.0, True)):
        speed = np.where(lines["series"] == first, speed_of_first, 20.0)
        styles = shared.series_styles(lines.assign(speed=speed))
        assert len(styles) > 1
        for look in styles.values():
            assert ("m/s" in look.name) == named


def test_a_value_of_which_a_few_draws_are_not_positive_has_no_logarithmic_axis():
    fit = fit_by_hand()
    draws = fit.draws.values["mu"]
    rng = np.random.default_rng(1)
    draws[:] = np.exp(rng.normal(0.0, 2.0, len(draws)))
    draws[:3] = -1e-3, 0.0, -2e-3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drawn = figure("corner", fit)
    low, high = drawn.axes[0].get_xlim()
    assert low < 0.0 < high
