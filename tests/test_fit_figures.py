"""Figures of a fit: what is drawn is what the frames say, and no table is too odd to be drawn."""

import warnings

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgba
from support.drawn import dots
from support.made_fit import made_fit, table_of

import fitball
from fitball.models.types import regime_name
from fitball.report.figures import FIGURES, drawable, parameters, predictions, shared
from fitball.report.quantities import symbol
from fitball.report.style import MODEL, MOVED, PRIOR, saved, styled

LONG = "a very long label of a surface that nobody would call short"
HOSTILE = "\U0001f3be<b>$\\frac{\n\u202e^"
BOTH = {"curves", "predictive", "residuals", "profiles", "forest"}
SLIDING = {"regimes", "regime_map"}
CASES = {
    "few": ({"frame": table_of(3), "sampled": False}, (BOTH - {"forest"}) | SLIDING),
    "drop": ({"frame": table_of(12, drop=True)}, BOTH | {"corner", "trace"}),
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
    return made_fit()


@pytest.fixture(scope="module")
def pooled():
    return made_fit(table_of(36, ("clay", "hard", "wood")))


def figure(name, fit):
    return styled(FIGURES[name], fit)


@pytest.mark.parametrize("case", CASES)
def test_every_figure_is_drawn_of_every_table(case):
    options, names = CASES[case]
    one = made_fit(**options)
    assert {*drawable(one)} == names
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for name in names:
            drawn = figure(name, one)
            assert saved(drawn).startswith(b"\x89PNG"), name
            # 16 parameters and 60 impacts are too many for one picture.
            assert name != "corner" or len(drawn.axes) <= parameters.CORNER**2


def test_dots_of_curves_are_residuals_added_to_their_line(pooled):
    axes = figure("curves", pooled).axes
    frame = pooled.predictions
    lines = pooled.curves
    for axis, column in zip(axes, dict.fromkeys(frame["column"]), strict=True):
        for k, look in shared.looks(lines).items():
            own = frame[(frame["column"] == column) & (frame["series"] == k)]
            line = lines[(lines["column"] == column) & (lines["series"] == k)]
            at = np.degrees(own["theta_1"])
            expected = (
                np.interp(at, np.degrees(line["along"]), line["median"])
                + own["observed"]
                - own["median"]
            )
            np.testing.assert_allclose(
                dots(axis, look.marker),
                np.column_stack([at, expected]),
                rtol=1e-12,
            )


def test_dots_and_bars_of_predictions_are_those_of_the_frame(fit):
    axes = figure("predictive", fit).axes
    for axis, (_, mine) in zip(axes, fit.predictions.groupby("column", sort=False), strict=True):
        drawn = np.concatenate([dots(axis, marker) for marker in "os"])
        np.testing.assert_array_equal(
            np.sort(drawn, axis=0),
            np.sort(mine[["median", "observed"]].to_numpy(), axis=0),
        )
        bars = np.array([segment[:, 1] for segment in axis.collections[0].get_segments()])
        np.testing.assert_array_equal(bars, mine[["new_q025", "new_q975"]])
        inside = (
            (mine["observed"] >= mine["new_q025"]) & (mine["observed"] <= mine["new_q975"])
        ).sum()
        assert axis.texts[0].get_text().startswith(f"{inside} of 24")


def trends(made):
    found = figure("residuals", made)
    return sum(line.get_color() == MOVED for axis in found.axes for line in axis.lines)


def test_trends_are_drawn_only_where_a_test_found_something():
    bent = {answer: made_fit(answer=answer) for answer in ("describes", "describes except")}
    for one in bent.values():
        frame = one.predictions
        place = one.predictions["theta_1"]
        frame["z"] = np.where(
            frame["column"] == "v_x2",
            3.0 * (place - place.mean()) + 0.1 * np.cos(frame["row"] * 5),
            0.0,
        )
    assert trends(bent["describes"]) == 0
    assert trends(bent["describes except"]) >= 1
    # One of twelve panels of noise in a hundred.
    frame["z"] = np.random.default_rng(0).standard_normal(len(frame))
    assert trends(bent["describes except"]) == 0


def test_a_trend_agrees_with_the_f_test():
    from scipy.stats import f

    rng = np.random.default_rng(4)
    agreed = 0
    for k in range(200):
        x = rng.standard_normal(12)
        z = rng.standard_normal(12)
        z += 1.5 * x * (k % 2)
        left = ((z - np.polyval(np.polyfit(x, z, 2), x)) ** 2).sum()
        whole = ((z - z.mean()) ** 2).sum()
        found = f.sf((whole - left) / 2 / (left / 9), 2, 9) < 0.01
        assert (predictions._trend(x, z) is not None) == found
        agreed += found
    assert 20 < agreed < 180
    assert predictions._trend(np.ones(9), rng.standard_normal(9)) is None


def test_many_rows_are_drawn_as_bins(fit):
    one = made_fit()
    rng = np.random.default_rng(5)
    frame = pd.concat([fit.predictions] * 1400, ignore_index=True)
    frame["theta_1"] += 0.05 * rng.standard_normal(len(frame))
    frame["z"] = rng.standard_normal(len(frame))
    frame["observed"] = frame["median"] + frame["noise"] * frame["z"]
    one.__dict__["predictions"] = frame
    assert len(frame) > 100_000
    for name in ("curves", "predictive", "residuals"):
        counts = [len(line.get_xydata()) for axis in figure(name, one).axes for line in axis.lines]
        assert max(counts) <= max(61, shared.BINS), name
    axis = figure("residuals", one).axes[0]
    mine = frame[frame["column"] == "v_x2"].sort_values("theta_1", kind="stable")
    first = mine.iloc[: -(-len(mine) // shared.BINS)]
    middle = [np.degrees(first["theta_1"].median()), first["z"].median()]
    np.testing.assert_allclose(dots(axis, "o")[0], middle, rtol=1e-12)


def test_a_corner_has_intervals_for_ticks_and_priors_that_integrate():
    one = made_fit(model="two-mass", fix={"k_theta": 20.0}, prior={"k_y": "lognormal(2e4, 0.3)"})
    one.draws.values["k_y"][:] = 2e4 * np.exp(np.random.default_rng(6).standard_normal(400))
    drawn = figure("corner", one)
    names = parameters.cornered(one)
    assert "k_theta" not in names
    assert "k_y" in names
    # Panels are on and below the diagonal.
    grid = np.full((len(names), len(names)), None)
    grid[np.tril_indices(len(names))] = drawn.axes
    for k, name in enumerate(names):
        if name == "k_y":
            # An axis of logarithms.
            continue
        unit = one.quantity(name).spec.display_unit
        ends = one.summary.loc[name, ["q025", "q975"]].to_numpy(float) * unit.factor
        np.testing.assert_allclose(grid[-1, k].get_xticks(), ends, rtol=1e-12)
    # All of the narrow prior lies within the axis, whose unit and logarithm change the density.
    curve = next(
        line
        for line in grid[names.index("k_y")][names.index("k_y")].lines
        if line.get_color() == PRIOR
    )
    x, y = curve.get_xydata().T
    dense = np.linspace(x[0], x[-1], 20_001)
    assert np.trapezoid(np.interp(dense, x, y), dense) == pytest.approx(1.0, abs=0.01)
    prior = next(item.prior for item in one.problem.parameters if item.spec.name == "k_y")
    for place, height in zip(x[20:40:5], y[20:40:5], strict=True):
        low, high = (np.log(10.0 ** (place + step) * 1e3) for step in (-1e-4, 1e-4))
        share = np.exp(prior.log_density(np.array([0.5 * (low + high)])))[0] * (high - low) / 2e-4
        assert height == pytest.approx(share, rel=1e-6)


def test_a_forest_marks_what_moves_by_more_than_two_sds(fit):
    axis = next(
        a for a in figure("forest", fit).axes if a.get_title(loc="left") == symbol(fit, "mu")
    )
    own = fit.summary.loc["mu"]
    moved = fit.variants.query("quantity == 'mu' and choice == 'offset=grip'").iloc[0]
    marks = {line.get_xdata()[0]: line for line in axis.lines if len(line.get_xdata()) == 1}
    assert to_rgba(marks[own["median"]].get_color()) == to_rgba(MODEL)
    assert to_rgba(marks[moved["median"]].get_color()) == to_rgba(MOVED)
    shade = axis.patches[0].get_extents().transformed(axis.transData.inverted()).intervalx
    np.testing.assert_allclose(shade, own[["q025", "q975"]].astype(float), rtol=1e-12)
    # The variant that fits worse is not there, the constant has no median.
    assert sum(np.isfinite(place) for place in marks) == 2


def test_profiles_mark_their_intervals(fit):
    axes = figure("profiles", fit).axes
    for axis, (name, profile) in zip(axes, fit.profiles.items(), strict=False):
        unit = fit.quantity(name).spec.display_unit
        factor = unit.factor
        curve, bar, posterior = axis.lines
        np.testing.assert_allclose(
            curve.get_xydata(),
            np.column_stack([factor * profile.values, -profile.drop]),
        )
        low, high = profile.interval_95
        expected = [profile.values[0] if low is None else low, high]
        np.testing.assert_allclose(bar.get_xdata(), factor * np.array(expected))
        np.testing.assert_allclose(
            posterior.get_xdata(),
            factor * fit.summary.loc[name, ["q025", "q975"]].astype(float),
        )


def test_bars_of_regimes_are_shares_of_draws():
    fit = made_fit()
    fit.draws.values["mu"][:] = np.random.default_rng(7).uniform(0.2, 0.8, 400)
    axis = figure("regimes", fit).axes[0]
    ends = np.zeros(24)
    for bar in axis.patches:
        place = round(bar.get_y() + 0.4)
        # Each begins where the one before ends.
        assert bar.get_x() == pytest.approx(ends[place])
        ends[place] += bar.get_width()
    np.testing.assert_allclose(ends, 1.0)
    names = [text.get_text().split("  ")[0] for text in axis.get_yticklabels()]
    sizes = {
        container.get_label(): [bar.get_width() for bar in container]
        for container in axis.containers
    }
    states = fit.problem.rows.states
    draws = {
        spec.name: fit.draws.values[spec.name][:200]
        for spec in fit.problem.forward.model.parameters
    }
    told = fit.problem.forward.model.rebound(draws, states).regime
    for place, name in enumerate(names):
        for regime, widths in sizes.items():
            share = np.mean([regime_name(code) == regime for code in told[:, int(name) - 1]])
            assert widths[place] == pytest.approx(share)
    assert sum(0.1 < width < 0.9 for widths in sizes.values() for width in widths) > 5


def test_the_regime_map_is_what_the_model_says(fit):
    drawn = figure("regime_map", fit)
    axis = drawn.axes[0]
    image = axis.images[0]
    patches = drawn.legends[0].get_patches()
    names = [text.get_text() for text in drawn.legends[0].get_texts()][: len(patches)]
    west, east, south, north = image.get_extent()
    assert axis.get_xlim() == (west, east)
    assert axis.get_ylim() == (south, north)
    array = image.get_array()
    speed = np.median(fit.problem.rows.states.polar()[0])
    values = {
        spec.name: fit.draws.point[spec.name] for spec in fit.problem.forward.model.parameters
    }
    seen = set()
    for row in range(0, array.shape[0], 9):
        for column in range(0, array.shape[1], 7):
            angle = np.radians(west + (east - west) * column / (array.shape[1] - 1))
            spin = south + (north - south) * row / (array.shape[0] - 1)
            state = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), spin)
            regime = regime_name(fit.problem.forward.model.rebound(values, state).regime[0])
            assert names[int(array[row, column])] == regime
            seen.add(regime)
    assert len(seen) > 1


def test_a_legend_of_curves_names_the_speed_where_speeds_differ(pooled):
    lines = pooled.curves
    first = lines["series"].min()
    for other, named in ((20.0, False), (10.0, True)):
        known = shared.looks(lines.assign(speed=np.where(lines["series"] == first, other, 20.0)))
        assert len(known) > 1
        assert all(("m/s" in look.name) == named for look in known.values())


def test_a_value_of_which_a_few_draws_are_not_positive_has_no_logarithmic_axis():
    one = made_fit()
    draws = one.draws.values["mu"]
    rng = np.random.default_rng(1)
    draws[:] = np.exp(rng.normal(0.0, 2.0, len(draws)))
    draws[:3] = -1e-3, 0.0, -2e-3
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drawn = figure("corner", one)
    assert drawn.axes[0].get_xlim()[0] < 0.0 < drawn.axes[0].get_xlim()[1]
