"""Figures of what was measured and predicted: curves, predictive, residuals, regimes,
regime_map.
"""

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
    DOTS,
    binned,
    hide,
    looks,
    opacity,
    scattered,
    series_legend,
    split,
)
from fitball.report.quantities import column_unit, middle, plain, records
from fitball.report.style import (
    FAINT,
    GUIDE,
    MODEL,
    MOVED,
    few_ticks,
    label,
    legend_above,
    new_figure,
)


def curves_caption(fit: Fitted) -> str:
    """What `curves` draws: bands of draws; dots or bins; whether they are moved, where a line has a
    speed and a spin.
    """
    bands = "" if fit.posterior is None else ", with 68 and 95 % bands"
    many = len(fit.run.table) > DOTS
    dots = "medians of bins, with their middle 68 %" if many else "every impact ± sd"
    moved = ""
    if fit.run.table.has_tangential:
        moved = ", moved along the model to the speed and spin of its line"
    return f"Lines: the model, dashed beyond the data{bands}. Dots: {dots}{moved}."


def curves(fit: Fitted) -> Figure:
    """A panel a measured column: the model over incidence at the speeds and spins of the table, and
    every impact, moved there along the model: its residual added to the line of its series.
    """
    lines = fit.curves
    measured = fit.predictions
    columns = list(dict.fromkeys(lines["column"]))
    styles = looks(lines)
    wide = 1 + (len(columns) > 3)
    rows = -(-len(columns) // wide)
    figure, axes = new_figure(rows, wide, high=0.75 + 1.6 * rows, sharex=True)
    drop = bool(lines["spin"].isna().all())
    place, along = ("v_y1", M_PER_S) if drop else ("theta_1", DEG)
    for axis, column in zip(axes.ravel(), columns, strict=False):
        unit = column_unit(column)
        mine = measured[measured["column"] == column]
        axis.set_title(f"{COLUMNS[column].title}  {label(COLUMNS[column].symbol, unit)}")
        for k, look in styles.items():
            line = lines[(lines["series"] == k) & (lines["column"] == column)]
            _draw_curve(axis, line, look.line, along.factor, unit.factor)
            own = mine[mine["series"] == k]
            at = own[place].to_numpy(np.float64)
            shown = (
                np.interp(at, line["along"], middle(line))
                + own["observed"].to_numpy(np.float64)
                - middle(own)
            )
            scattered(
                axis,
                along.factor * at,
                unit.factor * shown,
                look,
                unit.factor * own["noise"].to_numpy(),
            )
        few_ticks(axis.yaxis)
    shared = ((lines["speed"].dropna().unique(), "m/s"), (lines["spin"].dropna().unique(), "rad/s"))
    where = " and ".join(f"{found[0]:.3g} {unit}" for found, unit in shared if len(found) == 1)
    at_words = f",{' ' if axes.shape[1] == 1 else chr(10)}at {where}" if where else ""
    across = (
        r"vertical speed $v_{y1}$ [m/s]"
        if drop
        else rf"angle of incidence $\theta_1$ [deg]{at_words}"
    )
    hide(axes, len(columns), across)
    legend_above(
        figure,
        [
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
        ],
    )
    return figure


def _draw_curve(axis: Any, line: DataFrame, colour: str, across: float, up: float) -> None:
    place = across * line["along"].to_numpy()
    inside = line["within"].to_numpy(np.bool_)
    for low, high, shade in (("q025", "q975", 0.16), ("q16", "q84", 0.26)):
        axis.fill_between(
            place,
            up * line[low],
            up * line[high],
            color=colour,
            alpha=shade,
            linewidth=0,
        )
    axis.plot(place, up * middle(line), color=colour, linewidth=1.0, linestyle=(0, (2, 2)))
    axis.plot(place, np.where(inside, up * middle(line), np.nan), color=colour, linewidth=1.6)


def predictive(fit: Fitted) -> Figure:
    """Measured over predicted, with 95 % of what a new measurement would show."""
    frame = fit.predictions.dropna(subset=["observed"])
    styles = looks(fit.curves)
    columns = list(dict.fromkeys(frame["column"]))
    wide = min(3, len(columns))
    rows = -(-len(columns) // wide)
    figure, axes = new_figure(rows, wide, high=0.6 + 2.1 * rows)
    drawn = bool(frame["new_q975"].notna().any())
    for axis, column in zip(axes.ravel(), columns, strict=False):
        mine = frame[frame["column"] == column]
        unit = column_unit(column)
        predicted = unit.factor * middle(mine)
        seen = unit.factor * mine["observed"].to_numpy()
        ends = unit.factor * mine[["new_q025", "new_q975"]].to_numpy(np.float64)
        known = np.isfinite(predicted) & np.isfinite(ends).all(axis=1)
        inside = int(((seen >= ends[:, 0]) & (seen <= ends[:, 1])).sum())
        _draw_ends(axis, predicted[known], ends[known])
        axis.axline((seen.mean(),) * 2, slope=1.0, color=MODEL, linewidth=1.2)
        shown = split(mine, styles)
        for look, own in shown:
            scattered(axis, predicted[own], seen[own], look)
        axis.set_title(label(COLUMNS[column].symbol, unit))
        if drawn:
            many = len(mine) > DOTS
            share = percent(inside / len(mine)) if many else f"{inside} of {len(mine)}"
            axis.text(
                0.97, 0.04, f"{share} inside", transform=axis.transAxes, ha="right", color=GUIDE
            )
        few_ticks(axis.xaxis, 3)
        few_ticks(axis.yaxis)
    hide(axes, len(columns), "predicted")
    for axis in axes[:, 0]:
        axis.set_ylabel("measured")
    series_legend(
        figure,
        shown,
        [Patch(color=MODEL, alpha=0.25, label="95 % of new measurements")] * drawn,
    )
    return figure


def _draw_ends(axis: Any, place: FloatArray, ends: FloatArray) -> None:
    """Intervals as bars, of many impacts as the band of their medians."""
    if len(place) > DOTS:
        middles, (_, low, _) = binned(place, ends[:, 0])
        axis.fill_between(
            middles,
            low,
            binned(place, ends[:, 1])[1][1],
            color=MODEL,
            alpha=0.25,
            linewidth=0,
        )
    else:
        wide = 4.0 if len(place) < 60 else 2.0
        axis.vlines(
            place,
            *ends.T,
            color=MODEL,
            linewidth=wide,
            alpha=0.25 * opacity(len(place)) ** 0.5,
        )


# What residuals are drawn over, and how much of its size a quantity must vary to be one of them.
_OVER = {
    "theta_1": ("angle", DEG),
    "v_1": ("speed", M_PER_S),
    "omega_1": ("spin", RAD_PER_S),
    "row": ("row of the table", PLAIN),
}
_VARIES = 0.05
# Where a residual test found something, trends are drawn that chance shows in one of so many
# panels.
_CHANCE = 0.01


def residuals(fit: Fitted) -> Figure:
    """Residuals in sds of the noise, a row a column, over the incident state and the order of
    rows.
    """
    frame = fit.predictions.dropna(subset=["z"])
    styles = looks(fit.curves)
    columns = list(dict.fromkeys(frame["column"]))
    over = [name for name in _OVER if np.ptp(frame[name]) > _VARIES * frame[name].abs().max()] or [
        "row"
    ]
    tested = any(test.found for test in fit.adequacy.tests)
    found = False
    figure, axes = new_figure(
        len(columns),
        len(over),
        high=0.8 + 1.15 * len(columns),
        sharey=True,
        sharex="col",
    )
    for panels, column in zip(axes, columns, strict=True):
        mine = frame[frame["column"] == column]
        z = mine["z"].to_numpy(np.float64)
        shown = split(mine, styles)
        for axis, name in zip(panels, over, strict=True):
            place = _OVER[name][1].factor * mine[name].to_numpy(np.float64) + (name == "row")
            axis.axhspan(-2.0, 2.0, color=FAINT, alpha=0.5, linewidth=0)
            axis.axhline(0.0, color="white", linewidth=1.2)
            for look, own in shown:
                scattered(axis, place[own], z[own], look)
            if tested and (trend := _trend(place, z)) is not None:
                axis.plot(*trend, color=MOVED, linewidth=1.8, zorder=4)
                found = True
            axis.grid(visible=False)
        panels[0].set_ylabel(COLUMNS[column].symbol, fontsize=11)
    for axis, name in zip(axes[-1], over, strict=True):
        axis.set_xlabel(label(*_OVER[name]))
        few_ticks(axis.xaxis, 3, whole=name == "row")
    most = 3.2 if len(frame) > DOTS else max(3.2, 1.1 * float(frame["z"].abs().max()))
    axes[0, 0].set_ylim(-most, most)
    axes[0, 0].yaxis.set_major_locator(MaxNLocator(5, symmetric=True, integer=True))
    series_legend(figure, shown, [Line2D([], [], color=MOVED, label="trend")] * found)
    return figure


def _trend(place: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """A parabola through residuals, if chance seldom leaves as little: the F test of two
    coefficients, of which the probability is (left/whole)^(freedom/2).
    """
    freedom = len(z) - 3
    if freedom < 1 or len(np.unique(place)) < 3:
        return None
    trend = np.polynomial.Polynomial.fit(place, z, 2)
    left = float(((z - trend(place)) ** 2).sum())
    whole = float(((z - z.mean()) ** 2).sum())
    if left >= whole * _CHANCE ** (2.0 / freedom):
        return None
    along = np.linspace(place.min(), place.max(), 40)
    return along, trend(along)


# Sequences of slip and grip that most tables show, in the order of their colours; what shares one
# is faint.
_USUAL = (
    "slide",
    "slide, grip, slide back",
    "slide, grip, slide",
    "grip",
    "slide, grip",
    "grip, slide back",
)
_COLOURS = ("#77aadd", "#ee8866", "#44bb99", "#ffaabb", "#eedd88", "#bbcc33")
_OTHERS = "others"
_NONE = "no answer"
# Bars of impacts; draws that give their shares; shares that are shown.
_BARS = 40
_DRAWS = 200
_RARE = 0.02


def _coloured(shares: dict[str, float], rare: float) -> dict[str, str]:
    """A colour for each sequence that is not rare, the largest first; usual ones have theirs in
    every figure.
    """
    names = sorted(
        (name for name, share in shares.items() if share >= rare and name != _NONE),
        key=lambda n: -shares[n],
    )
    spare = [
        colour for k, colour in enumerate(_COLOURS) if k >= len(_USUAL) or _USUAL[k] not in names
    ]
    found = {}
    for name in names[: len(_COLOURS)]:
        found[name] = _COLOURS[_USUAL.index(name)] if name in _USUAL else spare.pop(0)
    return (
        found
        | ({_OTHERS: FAINT} if {*shares} - {*found, _NONE} else {})
        | ({_NONE: "white"} if _NONE in shares else {})
    )


def _words(codes: IntArray, solved: Any) -> np.ndarray[Any, np.dtype[Any]]:
    """Sequences in words, of the shape of the codes."""
    known, inverse = np.unique(np.where(solved, codes, -1), return_inverse=True)
    names = np.array(
        [_NONE if code < 0 else regime_name(int(code)) for code in known],
        dtype=object,
    )
    return np.asarray(names[inverse].reshape(codes.shape))


def regimes(fit: Fitted) -> Figure:
    """A bar an impact: how probable which sequence of slip and grip is."""
    frame = fit.predictions.drop_duplicates("row").sort_values(["series", "theta_1"])
    shown = frame.iloc[evenly_spread(len(frame), _BARS)]
    draws = fit.draws.values if fit.posterior is not None else fit.draws.best
    like = shown["row"].to_numpy(np.int64)
    seen = fit.problem.seen(
        {name: one[:_DRAWS] for name, one in draws.items()},
        _states(shown),
        like,
    )
    words = _words(seen.regime, seen.status == Status.OK)
    shares = {name: (words == name).mean(axis=0) for name in np.unique(words)}
    colours = _coloured({name: float(share.max()) for name, share in shares.items()}, _RARE)
    figure, axes = new_figure(1, 1, high=1.0 + 0.16 * max(len(shown), 6))
    axis = axes[0, 0]
    left = np.zeros(len(shown))
    places = np.arange(len(shown))
    rest = np.ones(len(shown)) - sum(share for name, share in shares.items() if name in colours)
    for name, colour in colours.items():
        size = rest if name == _OTHERS else shares[name]
        edge = GUIDE if name == _NONE else colour
        axis.barh(
            places,
            size,
            left=left,
            color=colour,
            edgecolor=edge,
            linewidth=0.4,
            height=0.8,
            label=name,
        )
        left = left + size
    ids = [f"{plain(str(row['id']))}  {np.degrees(row['theta_1']):.0f}°" for row in records(shown)]
    axis.set_yticks(places, ids, fontsize=8.5)
    axis.set_ylim(len(shown) - 0.4, -0.6)
    axis.set_xlim(0.0, 1.0)
    axis.grid(visible=False)
    axis.set_xlabel(
        "probability of the sequence" if fit.posterior is not None else "sequence of the best fit"
    )
    legend_above(figure, axis.get_legend_handles_labels()[0])
    return figure


def _states(frame: DataFrame) -> Impacts:
    return Impacts(*(frame[name].to_numpy(np.float64) for name in ("v_x1", "v_y1", "omega_1")))


# Angles and spins of the map; how far it reaches beyond the impacts, over their range; impacts
# whose speed differs by a smaller share belong to it.
_GRID = (120, 90)
_MARGIN = 0.25
_NEAR = 0.1


def regime_map(fit: Fitted) -> Figure:
    """Areas of slip and grip over angle and spin at the median speed and the best fit, contours of
    the rebound angle, and the impacts; of levels the combination that most impacts have.
    """
    rows = fit.problem.rows
    forward = fit.problem.forward
    keys, which, counts = np.unique(rows.index, axis=0, return_inverse=True, return_counts=True)
    mine = rows.states.take(np.flatnonzero(which.ravel() == counts.argmax()))
    speed, angle = mine.polar()
    middle_speed = float(np.median(speed))
    low, high = _range(angle, np.radians(5.0))
    angles = np.linspace(max(low, np.radians(2.0)), min(high, np.radians(178.0)), _GRID[0])
    spins = np.linspace(*_range(mine.omega_1, 50.0), _GRID[1])
    across, up = np.meshgrid(angles, spins)
    grid = Impacts(
        middle_speed * np.cos(across).ravel(),
        middle_speed * np.sin(across).ravel(),
        up.ravel(),
    )
    made = forward.rebound(
        fit.draws.best,
        grid,
        np.repeat(keys[[counts.argmax()]], len(grid), axis=0),
    )
    words = _words(made.regime[0], made.status[0] == Status.OK)
    colours = _coloured({name: float(np.mean(words == name)) for name in np.unique(words)}, 0.002)
    numbers = np.array(
        [[*colours].index(name if name in colours else _OTHERS) for name in words]
    ).reshape(across.shape)
    figure, axes = new_figure(1, 1, high=4.6)
    axis = axes[0, 0]
    ends = np.degrees(angles[[0, -1]])
    axis.imshow(
        numbers,
        cmap=ListedColormap([*colours.values()]),
        vmin=-0.5,
        vmax=len(colours) - 0.5,
        origin="lower",
        aspect="auto",
        extent=(*ends, *spins[[0, -1]]),
        interpolation="nearest",
        alpha=0.75,
    )
    _contours(axis, angles, spins, np.degrees(made.column("theta_2")[0].reshape(across.shape)))
    handles: list[Any] = [
        Patch(color=colour, alpha=0.75, label=name) for name, colour in colours.items()
    ]
    near = np.abs(speed - middle_speed) < _NEAR * middle_speed
    handles += _dots(axis, angle[near], mine.omega_1[near], "black", "impacts near this speed")
    handles += _dots(axis, angle[~near], mine.omega_1[~near], "none", "other speeds")
    axis.set_xlim(*ends)
    axis.set_ylim(*spins[[0, -1]])
    axis.set_xlabel(rf"angle $\theta_1$ [deg], at {middle_speed:.3g} m/s")
    axis.set_ylabel(r"spin $\omega_1$ [rad/s]")
    axis.grid(visible=False)
    levels = zip(forward.levels, keys[counts.argmax()], strict=True)
    labels = dict.fromkeys(level.labels[place] for level, place in levels)
    title = ", ".join(["best fit", *map(plain, labels)])
    axis.set_title(title + r"; lines: $\theta_2$ [deg]")
    legend_above(figure, handles)
    return figure


def _contours(axis: Any, angles: FloatArray, spins: FloatArray, rebound: FloatArray) -> None:
    """Lines of the rebound angle [deg], (spins, angles), over angles [rad] and spins."""
    rebound = np.ma.masked_invalid(rebound)
    if np.ma.count(rebound) and np.ptp(rebound.compressed()) > 0.0:
        lines = axis.contour(
            np.degrees(angles),
            spins,
            rebound,
            levels=8,
            colors="#22272e",
            linewidths=0.8,
        )
        for number in axis.clabel(lines, fontsize=8, fmt="%g", zorder=4):
            # Over the dots, and readable there.
            number.set_path_effects([withStroke(linewidth=2.5, foreground="white")])


def _dots(axis: Any, angle: FloatArray, spin: FloatArray, face: str, name: str) -> list[Any]:
    """A dot an impact; what the legend shows of them, nothing without impacts."""
    if not angle.size:
        return []
    shade = opacity(angle.size)
    drawn: list[Any] = axis.plot(
        np.degrees(angle),
        spin,
        "o",
        markersize=4.5,
        alpha=shade,
        markerfacecolor=face,
        markeredgecolor="black",
        markeredgewidth=0.6,
        label=name,
    )
    return drawn


def _range(values: FloatArray, least: float) -> tuple[float, float]:
    """Ends of an axis a little wider than the values."""
    wide = max(float(np.ptp(values)), least)
    return float(values.min()) - _MARGIN * wide, float(values.max()) + _MARGIN * wide
