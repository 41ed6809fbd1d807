"""Figures of what was measured and predicted: curves, predictive, residuals, regimes,
regime_map.
"""

import math
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from fitball.base.columns import COLUMNS
from fitball.base.display_units import DEG, M_PER_S, PLAIN, RAD_PER_S
from fitball.base.numbers import percent
from fitball.base.selection import evenly_spread
from fitball.base.values import DataFrame, Figure, FloatArray, Impacts, IntArray
from fitball.inference.fitted import Fitted
from fitball.models.types import Status, regime_name
from fitball.report.figures.shared import (
    MOST_DOTS,
    bin_medians,
    draw_dots,
    hide_unused,
    opacity,
    series_legend,
    series_styles,
    split_by_series,
)
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
)


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


def draw_curves(fit: Fitted) -> Figure:
    """A panel a measured column: the model over incidence at the speeds and spins of the table, and
    every impact, moved there along the model: its residual added to the line of its series.
    """
    lines = fit.curves
    measured = fit.predictions
    columns = list(dict.fromkeys(lines["column"]))
    styles = series_styles(lines)
    wide = 2 if len(columns) > 3 else 1
    rows = math.ceil(len(columns) / wide)
    figure, axes = new_figure(rows, wide, high=0.75 + 1.6 * rows, sharex=True)
    drop = bool(lines["spin"].isna().all())
    place, along = ("v_y1", M_PER_S) if drop else ("theta_1", DEG)
    for axis, column in zip(axes.ravel(), columns, strict=False):
        unit = column_unit(column)
        of_column = measured[measured["column"] == column]
        axis.set_title(f"{COLUMNS[column].title}  {axis_label(COLUMNS[column].symbol, unit)}")
        for k, look in styles.items():
            line = lines[(lines["series"] == k) & (lines["column"] == column)]
            _draw_curve(axis, line, look.line, along.factor, unit.factor)
            impacts = of_column[of_column["series"] == k]
            at = impacts[place].to_numpy(np.float64)
            observed = impacts["observed"].to_numpy(np.float64)
            shown = (
                np.interp(at, line["along"], median_or_point(line))
                + observed
                - median_or_point(impacts)
            )
            noise = unit.factor * impacts["noise"].to_numpy()
            draw_dots(axis, along.factor * at, unit.factor * shown, look, noise)
        few_ticks(axis.yaxis)
    across = r"vertical speed $v_{y1}$ [m/s]"
    if not drop:
        # In narrow panels the rest of the label is on a line of its own.
        between = ", " if wide == 1 else ",\n"
        words = filter(None, (r"angle of incidence $\theta_1$ [deg]", _shared_state(lines)))
        across = between.join(words)
    hide_unused(axes, len(columns), across)
    handles = [
        Line2D(
            [],
            [],
            color=look.line,
            linewidth=1.6,
            marker=look.marker,
            markerfacecolor=look.dots,
            markeredgecolor="white",
            markersize=6.5,
            label=look.name,
        )
        for look in styles.values()
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


def _draw_curve(axis: Any, line: DataFrame, colour: str, across: float, up: float) -> None:
    """Draw the median line of a series with its bands, dashed beyond the data; `across` and `up`
    are factors of the units of the axes.
    """
    place = across * line["along"].to_numpy()
    inside = line["within"].to_numpy(np.bool_)
    median = up * median_or_point(line)
    for low, high, shade in (("q025", "q975", 0.16), ("q16", "q84", 0.26)):
        ends = (up * line[low], up * line[high])
        axis.fill_between(place, *ends, color=colour, alpha=shade, linewidth=0)
    axis.plot(place, median, color=colour, linewidth=1.0, linestyle=(0, (2, 2)))
    axis.plot(place, np.where(inside, median, np.nan), color=colour, linewidth=1.6)


def draw_predictive(fit: Fitted) -> Figure:
    """Measured over predicted, a panel a column, with 95 % of what a new measurement would show."""
    frame = fit.predictions.dropna(subset=["observed"])
    styles = series_styles(fit.curves)
    columns = list(dict.fromkeys(frame["column"]))
    wide = min(3, len(columns))
    rows = math.ceil(len(columns) / wide)
    figure, axes = new_figure(rows, wide, high=0.6 + 2.1 * rows)
    has_intervals = bool(frame["new_q975"].notna().any())
    for axis, column in zip(axes.ravel(), columns, strict=False):
        rows_shown = frame[frame["column"] == column]
        count = len(rows_shown)
        unit = column_unit(column)
        predicted = unit.factor * median_or_point(rows_shown)
        observed = unit.factor * rows_shown["observed"].to_numpy()
        ends = unit.factor * rows_shown[["new_q025", "new_q975"]].to_numpy(np.float64)
        finite = np.isfinite(predicted) & np.isfinite(ends).all(axis=1)
        inside = int(((observed >= ends[:, 0]) & (observed <= ends[:, 1])).sum())
        _draw_ends(axis, predicted[finite], ends[finite])
        centre = observed.mean()
        axis.axline((centre, centre), slope=1.0, color=MODEL_COLOUR, linewidth=1.2)
        shown = split_by_series(rows_shown, styles)
        for look, chosen in shown:
            draw_dots(axis, predicted[chosen], observed[chosen], look)
        axis.set_title(axis_label(COLUMNS[column].symbol, unit))
        if has_intervals:
            share = percent(inside / count) if count > MOST_DOTS else f"{inside} of {count}"
            text = f"{share} inside"
            axis.text(0.97, 0.04, text, transform=axis.transAxes, ha="right", color=GUIDE_COLOUR)
        few_ticks(axis.xaxis, 3)
        few_ticks(axis.yaxis)
    hide_unused(axes, len(columns), "predicted")
    for axis in axes[:, 0]:
        axis.set_ylabel("measured")
    handles = []
    if has_intervals:
        handles.append(Patch(color=MODEL_COLOUR, alpha=0.25, label="95 % of new measurements"))
    series_legend(figure, shown, handles)
    return figure


def _draw_ends(axis: Any, place: FloatArray, ends: FloatArray) -> None:
    """Draw intervals (rows, 2) as bars, of more than DOTS impacts as the band of their medians."""
    count = len(place)
    if count > MOST_DOTS:
        middles, (_, low, _) = bin_medians(place, ends[:, 0])
        _, (_, high, _) = bin_medians(place, ends[:, 1])
        axis.fill_between(middles, low, high, color=MODEL_COLOUR, alpha=0.25, linewidth=0)
        return
    width = 4.0 if count < 60 else 2.0
    shade = 0.25 * opacity(count) ** 0.5
    axis.vlines(place, *ends.T, color=MODEL_COLOUR, linewidth=width, alpha=shade)


# Quantities over which residuals are drawn, with label and unit.
_OVER = {
    "theta_1": ("angle", DEG),
    "v_1": ("speed", M_PER_S),
    "omega_1": ("spin", RAD_PER_S),
    "row": ("row of the table", PLAIN),
}
# Share of its size that a quantity must vary to be one of them.
_VARIES = 0.05
# Where a residual test fails, trends are drawn that chance shows in this share of panels.
_CHANCE = 0.01


def draw_residuals(fit: Fitted) -> Figure:
    """Residuals in sds of the noise, a row a column, over the incident state and the order of
    rows.
    """
    frame = fit.predictions.dropna(subset=["z"])
    styles = series_styles(fit.curves)
    columns = list(dict.fromkeys(frame["column"]))
    over = [name for name in _OVER if np.ptp(frame[name]) > _VARIES * frame[name].abs().max()]
    over = over or ["row"]
    with_trends = any(test.found for test in fit.adequacy.tests)
    handles = []
    figure, axes = new_figure(
        len(columns),
        len(over),
        high=0.8 + 1.15 * len(columns),
        sharey=True,
        sharex="col",
    )
    for panels, column in zip(axes, columns, strict=True):
        of_column = frame[frame["column"] == column]
        z = of_column["z"].to_numpy(np.float64)
        shown = split_by_series(of_column, styles)
        for axis, name in zip(panels, over, strict=True):
            _, unit = _OVER[name]
            place = unit.factor * of_column[name].to_numpy(np.float64)
            if name == "row":
                # People count rows from one.
                place = place + 1.0
            axis.axhspan(-2.0, 2.0, color=FAINT, alpha=0.5, linewidth=0)
            axis.axhline(0.0, color="white", linewidth=1.2)
            for look, chosen in shown:
                draw_dots(axis, place[chosen], z[chosen], look)
            trend = _trend(place, z) if with_trends else None
            if trend is not None:
                axis.plot(*trend, color=MOVED_COLOUR, linewidth=1.8, zorder=4)
                handles = [Line2D([], [], color=MOVED_COLOUR, label="trend")]
            axis.grid(visible=False)
        panels[0].set_ylabel(COLUMNS[column].symbol, fontsize=11)
    for axis, name in zip(axes[-1], over, strict=True):
        axis.set_xlabel(axis_label(*_OVER[name]))
        few_ticks(axis.xaxis, 3, whole=name == "row")
    most = 3.2 if len(frame) > MOST_DOTS else max(3.2, 1.1 * float(frame["z"].abs().max()))
    axes[0, 0].set_ylim(-most, most)
    axes[0, 0].yaxis.set_major_locator(MaxNLocator(5, symmetric=True, integer=True))
    series_legend(figure, shown, handles)
    return figure


def _trend(place: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Places and values of a parabola through residuals `z` (rows,), None if chance makes as good a
    one in more than _CHANCE of panels: the F test of two coefficients, of which the probability is
    (residual/total)^(freedom/2) with sums of squares.
    """
    freedom = len(z) - 3
    if freedom < 1 or len(np.unique(place)) < 3:
        return None
    trend = np.polynomial.Polynomial.fit(place, z, 2)
    residual = float(((z - trend(place)) ** 2).sum())
    total = float(((z - z.mean()) ** 2).sum())
    if residual >= total * _CHANCE ** (2.0 / freedom):
        return None
    along = np.linspace(place.min(), place.max(), 40)
    return along, trend(along)


# Sequences of slip and grip that most tables show, in the order of their colours.
_USUAL = (
    "slide",
    "slide, grip, slide back",
    "slide, grip, slide",
    "grip",
    "slide, grip",
    "grip, slide back",
)
# Colours of sequences: those of _USUAL, or of others in their place.
_COLOURS = ("#77aadd", "#ee8866", "#44bb99", "#ffaabb", "#eedd88", "#bbcc33")
# Name of all sequences for which there is no colour.
_OTHERS = "others"
# Name of what has no sequence, because the model has no answer.
_NONE = "no answer"
# Bars of impacts that a figure has room for.
_BARS = 40
# Draws that give the probability of a sequence, to a few per cent.
_DRAWS = 200
# Probability below which a sequence has no colour.
_RARE = 0.02
# Share of the map below which a sequence has no colour.
_RARE_ON_MAP = 0.002


def _coloured(shares: dict[str, float], rare: float) -> dict[str, str]:
    """A colour for each sequence whose share is not below `rare`, the largest first; usual ones
    have theirs in every figure.
    """
    names = [name for name, share in shares.items() if share >= rare and name != _NONE]
    names.sort(key=lambda name: -shares[name])
    usual = dict(zip(_USUAL, _COLOURS, strict=True))
    spare = [colour for name, colour in usual.items() if name not in names]
    colours = {}
    for name in names[: len(_COLOURS)]:
        colours[name] = usual[name] if name in usual else spare.pop(0)
    if {*shares} - {*colours, _NONE}:
        colours[_OTHERS] = FAINT
    if _NONE in shares:
        colours[_NONE] = "white"
    return colours


def _words(codes: IntArray, solved: Any) -> np.ndarray[Any, np.dtype[Any]]:
    """Packed regimes as sequences in words, of the same shape; those not `solved` are _NONE."""
    distinct, inverse = np.unique(np.where(solved, codes, -1), return_inverse=True)
    names = [_NONE if code < 0 else regime_name(int(code)) for code in distinct]
    return np.asarray(np.array(names, dtype=object)[inverse].reshape(codes.shape))


def draw_regimes(fit: Fitted) -> Figure:
    """A bar an impact: the probability of each sequence of slip and grip."""
    frame = fit.predictions.drop_duplicates("row").sort_values(["series", "theta_1"])
    shown = frame.iloc[evenly_spread(len(frame), _BARS)]
    count = len(shown)
    draws = fit.draws.best
    across = "sequence of the best fit"
    if fit.posterior is not None:
        draws = fit.draws.values
        across = "probability of the sequence"
    first_draws = {name: values[:_DRAWS] for name, values in draws.items()}
    rebound = fit.problem.rebounds(first_draws, _states(shown), shown["row"].to_numpy(np.int64))
    words = _words(rebound.regime, rebound.status == Status.OK)
    shares = {name: (words == name).mean(axis=0) for name in np.unique(words)}
    colours = _coloured({name: float(share.max()) for name, share in shares.items()}, _RARE)
    figure, axes = new_figure(1, 1, high=1.0 + 0.16 * max(count, 6))
    axis = axes[0, 0]
    begin = np.zeros(count)
    places = np.arange(count)
    rest = np.ones(count) - sum(share for name, share in shares.items() if name in colours)
    for name, colour in colours.items():
        size = rest if name == _OTHERS else shares[name]
        edge = GUIDE_COLOUR if name == _NONE else colour
        axis.barh(
            places,
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
    axis.set_yticks(places, ids, fontsize=8.5)
    axis.set_ylim(count - 0.4, -0.6)
    axis.set_xlim(0.0, 1.0)
    axis.grid(visible=False)
    axis.set_xlabel(across)
    legend_above(figure, axis.get_legend_handles_labels()[0])
    return figure


def _states(frame: DataFrame) -> Impacts:
    """Impacts (rows,) of a frame with a row an impact."""
    return Impacts(*(frame[name].to_numpy(np.float64) for name in ("v_x1", "v_y1", "omega_1")))


# Angles and spins of the map: a point is smaller than a dot.
_GRID = (120, 90)
# How far the map extends beyond the impacts on each side, over their range.
_MARGIN = 0.25
# Relative difference from the median speed below which an impact belongs to the map.
_NEAR = 0.1


def draw_regime_map(fit: Fitted) -> Figure:
    """Areas of slip and grip over angle and spin at the median speed and the best fit, contours of
    the rebound angle, and the impacts; of levels the combination that most impacts have.
    """
    rows = fit.problem.rows
    forward = fit.problem.forward
    keys, which, counts = np.unique(rows.index, axis=0, return_inverse=True, return_counts=True)
    usual = counts.argmax()
    impacts = rows.states.take(np.flatnonzero(which.ravel() == usual))
    speed, angle = impacts.polar()
    median_speed = float(np.median(speed))
    low, high = _range(angle, np.radians(5.0))
    angles = np.linspace(max(low, np.radians(2.0)), min(high, np.radians(178.0)), _GRID[0])
    spins = np.linspace(*_range(impacts.omega_1, 50.0), _GRID[1])
    across, up = np.meshgrid(angles, spins)
    v_x1 = median_speed * np.cos(across).ravel()
    v_y1 = median_speed * np.sin(across).ravel()
    grid = Impacts(v_x1, v_y1, up.ravel())
    rebound = forward.rebound(fit.draws.best, grid, np.repeat(keys[[usual]], len(grid), axis=0))
    figure, axes = new_figure(1, 1, high=4.6)
    axis = axes[0, 0]
    extent = (*np.degrees(angles[[0, -1]]), *spins[[0, -1]])
    words = _words(rebound.regime[0], rebound.status[0] == Status.OK)
    handles = _draw_areas(axis, words.reshape(across.shape), extent)
    theta_2 = np.degrees(rebound.column("theta_2")[0].reshape(across.shape))
    _draw_contours(axis, np.degrees(angles), spins, theta_2)
    near = np.abs(speed - median_speed) < _NEAR * median_speed
    omega_1 = impacts.omega_1
    handles += _dots(axis, angle[near], omega_1[near], "black", "impacts near this speed")
    handles += _dots(axis, angle[~near], omega_1[~near], "none", "other speeds")
    axis.set_xlim(*extent[:2])
    axis.set_ylim(*extent[2:])
    axis.set_xlabel(rf"angle $\theta_1$ [deg], at {median_speed:.3g} m/s")
    axis.set_ylabel(r"spin $\omega_1$ [rad/s]")
    axis.grid(visible=False)
    labels = [level.labels[place] for level, place in zip(forward.levels, keys[usual], strict=True)]
    title = ", ".join(["best fit", *map(figure_text, dict.fromkeys(labels))])
    axis.set_title(title + r"; lines: $\theta_2$ [deg]")
    legend_above(figure, handles)
    return figure


def _dots(axis: Any, angle: FloatArray, spin: FloatArray, face: str, name: str) -> list[Any]:
    """Draw a dot an impact; the handles of the legend, none without impacts."""
    if not angle.size:
        return []
    drawn: list[Any] = axis.plot(
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
    return drawn


def _draw_areas(axis: Any, words: np.ndarray[Any, Any], extent: tuple[float, ...]) -> list[Any]:
    """Draw the sequences in `words` (spins, angles) as areas of an `extent`, left, right, lower and
    upper end; the handles of the legend.
    """
    shares = {name: float(np.mean(words == name)) for name in np.unique(words)}
    colours = _coloured(shares, _RARE_ON_MAP)
    names = list(colours)
    numbers = np.empty(words.shape)
    for name in shares:
        numbers[words == name] = names.index(name if name in colours else _OTHERS)
    axis.imshow(
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


def _draw_contours(axis: Any, angles: FloatArray, spins: FloatArray, theta_2: FloatArray) -> None:
    """Draw lines of equal rebound angle (spins, angles) [deg], where it is not the same
    everywhere.
    """
    solved = np.ma.masked_invalid(theta_2)
    if not np.ma.count(solved) or np.ptp(solved.compressed()) == 0.0:
        return
    lines = axis.contour(angles, spins, solved, levels=8, colors=INK, linewidths=0.8)
    for number in axis.clabel(lines, fontsize=8, fmt="%g", zorder=4):
        # Over the dots, and readable there.
        number.set_path_effects([withStroke(linewidth=2.5, foreground="white")])


def _range(values: FloatArray, least: float) -> tuple[float, float]:
    """Ends of an axis a little wider than the values, and than a range of at least `least`."""
    wide = max(float(np.ptp(values)), least)
    return float(values.min()) - _MARGIN * wide, float(values.max()) + _MARGIN * wide
