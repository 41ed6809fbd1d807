"""Figures of what was measured and predicted: curves, predictive, residuals, regimes,
regime_map.
"""

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from fitball.base.columns import COLUMNS
from fitball.base.display_units import DEG, M_PER_S, PLAIN, RAD_PER_S
from fitball.base.numbers import percent
from fitball.base.selection import evenly_spread
from fitball.base.values import BoolArray, DataFrame, Figure, FloatArray, Impacts, IntArray
from fitball.inference.curves import curves_frame, equal_series
from fitball.inference.fitted import Fitted
from fitball.models.types import Status, regime_name
from fitball.report.figures.chosen import ALL, Chosen, chosen_of
from fitball.report.figures.shared import (
    MOST_DOTS,
    bin_medians,
    draw_dots,
    hide_unused,
    opacity,
    series_legend,
    series_styles,
    split_by_series,
    to_one_side,
)
from fitball.report.flights import symbol_as
from fitball.report.frame_rows import frame_rows
from fitball.report.quantities import column_unit, figure_text, median_or_point
from fitball.report.style import (
    FAINT,
    GUIDE_COLOUR,
    INK,
    MODEL_COLOUR,
    MOVED_COLOUR,
    axis_label,
    few_ticks,
    legend_above,
    new_figure,
    panels_across,
    points,
)

# Texts, in an array of the shape of what they name.
_Texts: TypeAlias = NDArray[np.object_]
# Columns from which on panels are in two columns: below each other they would leave the page.
_MOST_BELOW = 3
# Impacts from which on bars of intervals are thin: those of more would touch.
_MOST_THICK = 60


def curves_caption(fit: Fitted) -> str:
    """The caption of the curves: their bands, dots or bins, and whether dots are moved to the speed
    and spin of a line.
    """
    bands = "" if fit.posterior is None else ", with 68 and 95 % bands"
    many = len(fit.run.table) > MOST_DOTS
    dots = "medians of bins, with their middle 68 %" if many else "every impact ± sd"
    moved = ""
    if fit.run.table.has_tangential:
        moved = ", moved along the model to the speed and spin of its line"
    return f"Lines: the model, dashed beyond the data{bands}. Dots: {dots}{moved}."


def draw_curves(fit: Fitted, chosen: Chosen = ALL) -> Figure:
    """Draw the model over incidence at the speeds and spins of the table, a panel a measured
    column, and every impact, moved there along the model: its residual added to the line of its
    series. Chosen groups have a line each, all at the same speed and spin.

    Raises:
        ParameterError: there is no such column (`unknown-quantity`) or group (`unknown-label`).
    """
    lines = fit.curves
    measured = to_one_side(fit.predictions)
    if chosen.groups:
        grouped = equal_series(fit.problem, chosen.groups)
        lines = curves_frame(fit.problem, fit.draws, grouped)
        _, which = grouped
        measured = measured.assign(series=which[measured["row"].to_numpy(np.int64)])
    columns = chosen_of(dict.fromkeys(lines["column"]), chosen.columns)
    styles = series_styles(lines)
    across = 2 if len(columns) > _MOST_BELOW else 1
    down = math.ceil(len(columns) / across)
    figure, panels = new_figure(down, across, high=0.75 + 1.6 * down, sharex=True)
    drop = bool(lines["spin"].isna().all())
    incidence, along = ("v_y1", M_PER_S) if drop else ("theta_1", DEG)
    for axes, column in zip(panels.ravel(), columns, strict=False):
        unit = column_unit(column)
        of_column = measured[measured["column"] == column]
        axes.set_title(f"{COLUMNS[column].title}  {axis_label(symbol_as(fit, column), unit)}")
        for k, style in styles.items():
            line = lines[(lines["series"] == k) & (lines["column"] == column)]
            _draw_curve(axes, line, style.line, along.factor, unit.factor)
            impacts = of_column[of_column["series"] == k]
            at = impacts[incidence].to_numpy(np.float64)
            observed = impacts["observed"].to_numpy(np.float64)
            residual = observed - median_or_point(impacts)
            shown = np.interp(at, line["along"], median_or_point(line)) + residual
            noise = unit.factor * impacts["noise"].to_numpy()
            draw_dots(axes, along.factor * at, unit.factor * shown, style, noise)
        few_ticks(axes.yaxis)
    x_label = r"vertical speed $v_{y1}$ [m/s]"
    if not drop:
        # In narrow panels the rest of the label is on a line of its own.
        between = ", " if across == 1 else ",\n"
        words = filter(None, (r"angle of incidence $\theta_1$ [deg]", _shared_state(lines)))
        x_label = between.join(words)
    hide_unused(panels, len(columns), x_label)
    handles = [
        Line2D(
            [],
            [],
            color=style.line,
            linewidth=1.6,
            marker=style.marker,
            markerfacecolor=style.dots,
            markeredgecolor="white",
            markersize=6.5,
            label=style.name,
        )
        for style in styles.values()
    ]
    legend_above(figure, handles)
    return figure


def _shared_state(lines: DataFrame) -> str:
    """The speed and the spin that all lines have, `at 20 m/s and 0 rad/s`; empty if there is
    neither.
    """
    words = []
    for name, unit in (("speed", M_PER_S), ("spin", RAD_PER_S)):
        values = lines[name].dropna().unique()
        if len(values) == 1:
            words.append(f"{values[0]:.3g} {unit.name}")
    return f"at {' and '.join(words)}" if words else ""


def _draw_curve(axes: Axes, line: DataFrame, colour: str, x_factor: float, y_factor: float) -> None:
    """Draw the median line of a series with its bands, dashed beyond the data. The factors are
    those of the units of the axes.
    """
    x = x_factor * line["along"].to_numpy()
    inside = line["within"].to_numpy(np.bool_)
    median = y_factor * median_or_point(line)
    for low, high, shade in (("q025", "q975", 0.16), ("q16", "q84", 0.26)):
        ends = (y_factor * line[low], y_factor * line[high])
        axes.fill_between(x, *ends, color=colour, alpha=shade, linewidth=0)
    axes.plot(x, median, color=colour, linewidth=1.0, linestyle=(0, (2, 2)))
    axes.plot(x, np.where(inside, median, np.nan), color=colour, linewidth=1.6)


def draw_predictive(fit: Fitted, chosen: Chosen = ALL) -> Figure:
    """Draw measured over predicted, a panel a column, with 95 % of what a new measurement would
    show.
    """
    frame = fit.predictions.dropna(subset=["observed"])
    styles = series_styles(fit.curves)
    columns = chosen_of(dict.fromkeys(frame["column"]), chosen.columns)
    across = min(panels_across(3), len(columns))
    down = math.ceil(len(columns) / across)
    figure, panels = new_figure(down, across, high=0.6 + 2.1 * down)
    has_intervals = bool(frame["new_q975"].notna().any())
    for axes, column in zip(panels.ravel(), columns, strict=False):
        of_column = frame[frame["column"] == column]
        count = len(of_column)
        unit = column_unit(column)
        predicted = unit.factor * median_or_point(of_column)
        observed = unit.factor * of_column["observed"].to_numpy()
        ends = unit.factor * of_column[["new_q025", "new_q975"]].to_numpy(np.float64)
        finite = np.isfinite(predicted) & np.isfinite(ends).all(axis=1)
        inside = int(((observed >= ends[:, 0]) & (observed <= ends[:, 1])).sum())
        _draw_ends(axes, predicted[finite], ends[finite])
        centre = observed.mean()
        axes.axline((centre, centre), slope=1.0, color=MODEL_COLOUR, linewidth=1.2)
        # The legend below has the series of the last panel.
        shown = split_by_series(of_column, styles)
        for style, rows in shown:
            draw_dots(axes, predicted[rows], observed[rows], style)
        axes.set_title(axis_label(symbol_as(fit, column), unit))
        if has_intervals:
            share = percent(inside / count) if count > MOST_DOTS else f"{inside} of {count}"
            text = f"{share} inside"
            axes.text(0.97, 0.04, text, transform=axes.transAxes, ha="right", color=GUIDE_COLOUR)
        few_ticks(axes.xaxis, 3)
        few_ticks(axes.yaxis)
    hide_unused(panels, len(columns), "predicted")
    for axes in panels[:, 0]:
        axes.set_ylabel("measured")
    handles = []
    if has_intervals:
        handles.append(Patch(color=MODEL_COLOUR, alpha=0.25, label="95 % of new measurements"))
    series_legend(figure, [style for style, _ in shown], handles)
    return figure


def _draw_ends(axes: Axes, x: FloatArray, ends: FloatArray) -> None:
    """Draw intervals `ends` (rows, 2) at `x` (rows,) as bars; of more than MOST_DOTS impacts as a
    band, between medians of their ends in bins.
    """
    count = len(x)
    if count > MOST_DOTS:
        middles, (_, low, _) = bin_medians(x, ends[:, 0])
        _, (_, high, _) = bin_medians(x, ends[:, 1])
        axes.fill_between(middles, low, high, color=MODEL_COLOUR, alpha=0.25, linewidth=0)
        return
    width = 4.0 if count < _MOST_THICK else 2.0
    shade = 0.25 * opacity(count) ** 0.5
    axes.vlines(x, *ends.T, color=MODEL_COLOUR, linewidth=width, alpha=shade)


# Quantities over which residuals are drawn, with label and unit.
_OVER = {
    "theta_1": ("angle", DEG),
    "v_1": ("speed", M_PER_S),
    "omega_1": ("spin", RAD_PER_S),
    "row": ("row", PLAIN),
}
# Residuals are drawn over a quantity that varies by more than this share of its size.
_VARIES = 0.05
# Where a residual test fails, trends are drawn that chance shows in this share of panels.
_CHANCE_OF_TREND = 0.01

# Points of the line of a trend.
_TREND_POINTS = 40
# Sds of the noise that the axis of residuals shows at least, and of many impacts just so.
_LEAST_SDS = 3.2


def draw_residuals(fit: Fitted, chosen: Chosen = ALL) -> Figure:
    """Draw residuals in sds of the noise, a row a column, over the incident state and the order of
    rows.
    """
    frame = to_one_side(fit.predictions.dropna(subset=["z"]))
    styles = series_styles(fit.curves)
    columns = chosen_of(dict.fromkeys(frame["column"]), chosen.columns)
    over = [name for name in _OVER if np.ptp(frame[name]) > _VARIES * frame[name].abs().max()]
    over = over or ["row"]
    with_trends = any(test.found for test in fit.adequacy.tests)
    handles = []
    figure, panels = new_figure(
        len(columns),
        len(over),
        high=0.8 + 1.15 * len(columns),
        sharey=True,
        sharex="col",
    )
    for row_panels, column in zip(panels, columns, strict=True):
        of_column = frame[frame["column"] == column]
        z = of_column["z"].to_numpy(np.float64)
        # The legend below has the series of the last row.
        shown = split_by_series(of_column, styles)
        for axes, name in zip(row_panels, over, strict=True):
            _, unit = _OVER[name]
            x = unit.factor * of_column[name].to_numpy(np.float64)
            if name == "row":
                # People count rows from one.
                x = x + 1.0
            axes.axhspan(-2.0, 2.0, color=FAINT, alpha=0.5, linewidth=0)
            axes.axhline(0.0, color="white", linewidth=1.2)
            for style, rows in shown:
                draw_dots(axes, x[rows], z[rows], style)
            trend = _trend(x, z) if with_trends else None
            if trend is not None:
                axes.plot(*trend, color=MOVED_COLOUR, linewidth=1.8, zorder=4)
                handles = [Line2D([], [], color=MOVED_COLOUR, label="trend")]
            axes.grid(visible=False)
        row_panels[0].set_ylabel(symbol_as(fit, column), fontsize=points(11))
    for axes, name in zip(panels[-1], over, strict=True):
        axes.set_xlabel(axis_label(*_OVER[name]))
        few_ticks(axes.xaxis, 3, integers=name == "row")
    most = _LEAST_SDS
    if len(frame) <= MOST_DOTS:
        most = max(_LEAST_SDS, 1.1 * float(frame["z"].abs().max()))
    panels[0, 0].set_ylim(-most, most)
    panels[0, 0].yaxis.set_major_locator(MaxNLocator(5, symmetric=True, integer=True))
    series_legend(figure, [style for style, _ in shown], handles)
    return figure


def _trend(x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """A line along the parabola through residuals `z` at `x` (rows,), by its points. None if chance
    makes as good a parabola in more than _CHANCE_OF_TREND of panels: by the F test of two
    coefficients, whose probability is (residual/total)^(freedom/2) with sums of squares.
    """
    freedom = len(z) - 3
    if freedom < 1 or len(np.unique(x)) < 3:
        return None
    trend = np.polynomial.Polynomial.fit(x, z, 2)
    residual = float(((z - trend(x)) ** 2).sum())
    total = float(((z - z.mean()) ** 2).sum())
    if residual >= total * _CHANCE_OF_TREND ** (2.0 / freedom):
        return None
    along = np.linspace(x.min(), x.max(), _TREND_POINTS)
    return along, trend(along)


# Sequences of slip and grip that most tables show, in the order of their colours.
_USUAL_SEQUENCES = (
    "slide",
    "slide, grip, slide back",
    "slide, grip, slide",
    "grip",
    "slide, grip",
    "grip, slide back",
)
# Colours of sequences: each of _USUAL_SEQUENCES has its own, which others take over where it is
# not drawn.
_COLOURS = ("#77aadd", "#ee8866", "#44bb99", "#ffaabb", "#eedd88", "#bbcc33")
# Name of all sequences for which there is no colour.
_OTHERS = "others"
# Name of what has no sequence, because the model has no answer.
_UNSOLVED = "no answer"
# Bars of impacts that a figure has room for.
_MOST_BARS = 40
# Draws that give the probability of a sequence, to a few per cent.
_MOST_DRAWS = 200
# Probability below which a sequence has no colour.
_RARE_IN_DRAWS = 0.02
# Share of the map below which a sequence has no colour.
_RARE_ON_MAP = 0.002


def _coloured(shares: dict[str, float], rare: float) -> dict[str, str]:
    """A colour for each sequence whose share is not below `rare`, the largest first. A usual
    sequence has the same colour in every figure.
    """
    names = [name for name, share in shares.items() if share >= rare and name != _UNSOLVED]
    names.sort(key=lambda name: -shares[name])
    usual = dict(zip(_USUAL_SEQUENCES, _COLOURS, strict=True))
    spare = [colour for name, colour in usual.items() if name not in names]
    colours = dict[str, str]()
    for name in names[: len(_COLOURS)]:
        colours[name] = usual[name] if name in usual else spare.pop(0)
    if {*shares} - {*colours, _UNSOLVED}:
        colours[_OTHERS] = FAINT
    if _UNSOLVED in shares:
        colours[_UNSOLVED] = "white"
    return colours


def _sequences(codes: IntArray, solved: BoolArray) -> _Texts:
    """Packed regimes as sequences in words, of the same shape; those not `solved` are _UNSOLVED."""
    distinct, inverse = np.unique(np.where(solved, codes, -1), return_inverse=True)
    names = [_UNSOLVED if code < 0 else regime_name(int(code)) for code in distinct]
    return np.asarray(np.array(names, dtype=object)[inverse].reshape(codes.shape))


def draw_regimes(fit: Fitted, _chosen: Chosen = ALL) -> Figure:
    """Draw a bar an impact: the probability of each sequence of slip and grip."""
    frame = fit.predictions.drop_duplicates("row").sort_values(["series", "theta_1"])
    shown = frame.iloc[evenly_spread(len(frame), _MOST_BARS)]
    count = len(shown)
    draws = fit.draws.best
    x_label = "sequence of the best fit"
    if fit.posterior is not None:
        draws = fit.draws.values
        x_label = "probability of the sequence"
    first_draws = {name: values[:_MOST_DRAWS] for name, values in draws.items()}
    rebound = fit.problem.rebounds(first_draws, _states(shown), shown["row"].to_numpy(np.int64))
    words = _sequences(rebound.regime, rebound.status == Status.OK)
    shares = {name: (words == name).mean(axis=0) for name in np.unique(words)}
    colours = _coloured(
        {name: float(share.max()) for name, share in shares.items()}, _RARE_IN_DRAWS
    )
    figure, panels = new_figure(1, 1, high=1.0 + 0.16 * max(count, 6))
    axes = panels[0, 0]
    begin = np.zeros(count)
    heights = np.arange(count)
    others = np.ones(count) - sum(share for name, share in shares.items() if name in colours)
    for name, colour in colours.items():
        size = others if name == _OTHERS else shares[name]
        edge = GUIDE_COLOUR if name == _UNSOLVED else colour
        axes.barh(
            heights,
            size,
            left=begin,
            color=colour,
            edgecolor=edge,
            linewidth=0.4,
            height=0.8,
            label=name,
        )
        begin = begin + size
    ids = []
    for row in frame_rows(shown):
        angle = np.degrees(row.number("theta_1"))
        ids.append(f"{figure_text(row.text('id'))}  {angle:.0f}°")
    axes.set_yticks(heights, ids, fontsize=points(8.5))
    axes.set_ylim(count - 0.4, -0.6)
    axes.set_xlim(0.0, 1.0)
    axes.grid(visible=False)
    axes.set_xlabel(x_label)
    legend_above(figure, axes.get_legend_handles_labels()[0])
    return figure


def _states(frame: DataFrame) -> Impacts:
    """Incident states of a frame with a row an impact."""
    return Impacts(*(frame[name].to_numpy(np.float64) for name in ("v_x1", "v_y1", "omega_1")))


# Points of the map along angle and spin: the area of a point is smaller than a dot.
_MAP_ANGLES = 120
_MAP_SPINS = 90
# How far the map extends beyond the impacts on each side, over their range.
_MARGIN = 0.25
# Relative difference from the median speed below which an impact belongs to the map.
_NEAR_SPEED = 0.1

# The map spans at least this range of angles [rad] and of spins [rad/s].
_LEAST_ANGLES = np.radians(5.0)
_LEAST_SPINS = 50.0
# Its angles [rad] leave out those near 0 and 180 degrees, at which no ball comes down.
_LOWEST_ANGLE = np.radians(2.0)
_HIGHEST_ANGLE = np.radians(178.0)


def draw_regime_map(fit: Fitted, _chosen: Chosen = ALL) -> Figure:
    """Draw areas of slip and grip over angle and spin at the median speed and the best fit,
    contours of the rebound angle, and the impacts. Of levels the combination counts that most
    impacts have.
    """
    rows = fit.problem.rows
    forward = fit.problem.forward
    keys, which, counts = np.unique(rows.index, axis=0, return_inverse=True, return_counts=True)
    usual = counts.argmax()
    impacts = rows.states.take(np.flatnonzero(which.ravel() == usual)).forwards
    speed, angle = impacts.polar()
    median_speed = float(np.median(speed))
    low, high = _wider_range(angle, _LEAST_ANGLES)
    angles = np.linspace(max(low, _LOWEST_ANGLE), min(high, _HIGHEST_ANGLE), _MAP_ANGLES)
    spins = np.linspace(*_wider_range(impacts.omega_1, _LEAST_SPINS), _MAP_SPINS)
    angle_grid, spin_grid = np.meshgrid(angles, spins)
    v_x1 = median_speed * np.cos(angle_grid).ravel()
    v_y1 = median_speed * np.sin(angle_grid).ravel()
    grid = Impacts(v_x1, v_y1, spin_grid.ravel())
    rebound = forward.rebound(fit.draws.best, grid, np.repeat(keys[[usual]], len(grid), axis=0))
    figure, panels = new_figure(1, 1, high=4.6)
    axes = panels[0, 0]
    west, east = np.degrees(angles[[0, -1]])
    south, north = spins[[0, -1]]
    extent = (west, east, south, north)
    words = _sequences(rebound.regime[0], rebound.status[0] == Status.OK)
    handles = _draw_areas(axes, words.reshape(angle_grid.shape), extent)
    theta_2 = np.degrees(rebound.column("theta_2")[0].reshape(angle_grid.shape))
    _draw_contours(axes, np.degrees(angles), spins, theta_2)
    near = np.abs(speed - median_speed) < _NEAR_SPEED * median_speed
    omega_1 = impacts.omega_1
    handles += _draw_impacts(axes, angle[near], omega_1[near], "black", "impacts near this speed")
    handles += _draw_impacts(axes, angle[~near], omega_1[~near], "none", "other speeds")
    axes.set_xlim(west, east)
    axes.set_ylim(south, north)
    axes.set_xlabel(rf"angle $\theta_1$ [deg], at {median_speed:.3g} m/s")
    axes.set_ylabel(r"spin $\omega_1$ [rad/s]")
    axes.grid(visible=False)
    labels = [level.labels[k] for level, k in zip(forward.levels, keys[usual], strict=True)]
    title = ", ".join(["best fit", *map(figure_text, dict.fromkeys(labels))])
    axes.set_title(title + r"; lines: $\theta_2$ [deg]")
    legend_above(figure, handles)
    return figure


def _draw_impacts(
    axes: Axes, angle: FloatArray, spin: FloatArray, face: str, name: str
) -> Sequence[Artist]:
    """Draw a dot an impact. Returned are the handles of the legend, none without impacts."""
    if not angle.size:
        return []
    return axes.plot(
        np.degrees(angle),
        spin,
        "o",
        markersize=4.5,
        alpha=opacity(angle.size),
        markerfacecolor=face,
        markeredgecolor="black",
        markeredgewidth=0.6,
        label=name,
    )


def _draw_areas(
    axes: Axes, words: _Texts, extent: tuple[float, float, float, float]
) -> list[Artist]:
    """Draw the sequences in `words` (spins, angles) as areas. The ends of the `extent` are left,
    right, lower and upper. Returned are the handles of the legend.
    """
    shares = {name: float(np.mean(words == name)) for name in np.unique(words)}
    colours = _coloured(shares, _RARE_ON_MAP)
    names = list(colours)
    numbers = np.empty(words.shape)
    for name in shares:
        numbers[words == name] = names.index(name if name in colours else _OTHERS)
    axes.imshow(
        numbers,
        cmap=ListedColormap([*colours.values()]),
        vmin=-0.5,
        vmax=len(colours) - 0.5,
        origin="lower",
        aspect="auto",
        extent=extent,
        interpolation="nearest",
        alpha=0.75,
    )
    return [Patch(color=colours[name], alpha=0.75, label=name) for name in names]


def _draw_contours(axes: Axes, angles: FloatArray, spins: FloatArray, theta_2: FloatArray) -> None:
    """Draw lines of equal rebound angle `theta_2` (spins, angles), unless it is the same
    everywhere. All angles are in degrees.
    """
    solved = np.ma.masked_invalid(theta_2)
    if not np.ma.count(solved) or np.ptp(solved.compressed()) == 0.0:
        return
    lines = axes.contour(angles, spins, solved, levels=8, colors=INK, linewidths=0.8)
    for number in axes.clabel(lines, fontsize=points(8), fmt="%g", zorder=4):
        # Over the dots, and readable there.
        number.set_path_effects([withStroke(linewidth=2.5, foreground="white")])


def _wider_range(values: FloatArray, least: float) -> tuple[float, float]:
    """Ends of an axis that is wider on each side than the values, by a share of their range, which
    counts as `least` if it is smaller.
    """
    wide = max(float(np.ptp(values)), least)
    return float(values.min()) - _MARGIN * wide, float(values.max()) + _MARGIN * wide
