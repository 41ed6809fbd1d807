"""Profiles of parameters, the posterior of all pairs, and the walkers of the sampler."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from contourpy import FillType, LineType, contour_generator
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.path import Path
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from fitball.inference.identifiability.derived import quantities
from fitball.inference.identifiability.profile import DROP_68, DROP_95
from fitball.inference.problem.parameters import Parameter, Prior
from fitball.inference.results.evidence import Profile
from fitball.inference.results.results import TARGET_R_HAT, Fit
from fitball.report.figures.canvas import (
    Margins,
    drawn_handles,
    filled,
    fit_heading,
    legend_below,
    log_scale,
    new_figure,
    own_style,
    verbatim,
)
from fitball.report.figures.quantities import ParameterAxis, drawn, parameter, parameter_axis
from fitball.report.figures.sheet import Panel, Sheet, Side
from fitball.report.form.numbers import handy, parameter_row, profile_interval
from fitball.report.form.palette import GUIDE, MEASURED, MODEL, PRIOR, SERIES, pale
from fitball.values import FloatArray
from fitball.wording import short

# Lowest log likelihood shown, a little below the 95 % level at -1.92.
LOWEST = -2.6
CURVE_POINTS = 201


@dataclass(frozen=True)
class ProfilePanel:
    """One parameter in a handy unit: log likelihood below its maximum at the points of the profile and along a
    `curve` (2, points) through them, the curve without the scene's contact time (empty where it is the same), the
    part of the axis shown, and the posterior's 95 % interval.
    """

    name: str
    axis: ParameterAxis
    values: FloatArray
    log_likelihood: FloatArray
    curve: FloatArray
    curve_alone: FloatArray
    span: tuple[float, float]
    posterior: tuple[float, float] | None


def profile_panels(fit: Fit) -> tuple[ProfilePanel, ...]:
    """A panel for each parameter that has a profile, in the order of the fit."""
    known = fit.identifiability.evidence.items()
    return tuple(_panel(fit, name, item.profile, item.alone) for name, item in known if item.profile is not None)


def _panel(fit: Fit, name: str, profile: Profile, alone: Profile | None) -> ProfilePanel:
    item = parameter(fit, name)
    axis = parameter_axis(item.spec)
    values, posterior, within = profile.values * axis.factor, fit.posterior, None
    ends = [float(values[0]), float(values[-1])]
    if posterior is not None:
        low, high = np.quantile(posterior.draws[:, posterior.names.index(name)], (0.025, 0.975)) * axis.factor
        within = (float(low), float(high))
        ends += within
    return ProfilePanel(
        name=name,
        axis=axis,
        values=values,
        log_likelihood=-profile.drop,
        curve=_curve(profile, item.prior.log, axis.factor),
        curve_alone=np.empty((2, 0)) if alone is None else _curve(alone, item.prior.log, axis.factor),
        span=axis.margins(min(ends), max(ends)),
        posterior=within,
    )


def _curve(profile: Profile, logarithmic: bool, factor: float) -> FloatArray:
    """A smooth curve (2, points) through a profile: linear in the root of the drop, as its intervals are."""
    along = np.log(profile.values) if logarithmic else profile.values
    dense = np.union1d(np.linspace(along[0], along[-1], CURVE_POINTS), along)
    root = np.interp(dense, along, np.sqrt(profile.drop))
    return np.stack([(np.exp(dense) if logarithmic else dense) * factor, -(root**2)])


# Where the posterior's interval stands, in log likelihood.
BAR = -2.35
DROPS = (0.0, -DROP_68, -1.0, -DROP_95)
DROP_WORDS = ("0", f"-{DROP_68:g} (68 %)", "-1", f"-{DROP_95:.2f} (95 %)")


def profiles_figure(fit: Fit) -> Figure:
    """All profiles; with a posterior its 95 % intervals below them."""
    shown = profile_panels(fit)
    figure, grid = filled(len(shown), 4, (2.3, 1.75), Margins(left=1.15, down=0.75, bottom=1.05, top=0.75))
    axes = grid.ravel()
    scene = fit.problem.contact_time is not None
    words = "profile of the measurements and the scene's contact time" if scene else "profile of the measurements"
    for axis, panel in zip(axes, shown, strict=False):
        _draw_profile(axis, panel, words)
    for row in grid:
        row[0].set_yticks(DROPS, DROP_WORDS, fontsize=8)
        for axis in row[1:]:
            axis.set_yticks([])
    figure.supylabel("log likelihood below its maximum", fontsize=10, x=0.1 / figure.get_figwidth(), ha="left")
    legend_below(figure, drawn_handles(*axes), {1: 1, 2: 2, 3: 2}.get(len(shown), 3))
    fit_heading(figure, fit, "profile likelihoods", narrow=len(shown) == 1)
    return figure


def _draw_profile(axis: Axes, panel: ProfilePanel, words: str) -> None:
    for level in (DROP_68, DROP_95):
        axis.axhline(-level, color=GUIDE, linewidth=0.8, linestyle=":")
    axis.plot(*panel.curve, "-", color=MEASURED, linewidth=1.3, label=words)
    axis.plot(panel.values, panel.log_likelihood, "o", color=MEASURED, markersize=2.5)
    if panel.curve_alone.size:
        axis.plot(*panel.curve_alone, "--", color=GUIDE, linewidth=1.3, label="without the scene's contact time")
    if panel.posterior is not None:
        ends = (BAR, BAR)
        axis.plot(panel.posterior, ends, color=MODEL, linewidth=4, solid_capstyle="butt", label="posterior, 95 %")
    if panel.axis.logarithmic:
        log_scale(axis, *panel.span)
    else:
        axis.set_xlim(*panel.span)
        axis.locator_params(axis="x", nbins=4)
    axis.set_ylim(LOWEST, 0.15)
    axis.set_title(verbatim(short(panel.name, 34)), fontsize=9, pad=3)
    axis.set_xlabel(panel.axis.label, labelpad=2)


def profiles_words(fit: Fit) -> str:
    """The figure in words and numbers."""
    parts = []
    for name, item in fit.identifiability.evidence.items():
        scale = handy(name, fit.parameters[name].unit)
        parts += [f"{name} {profile_interval(item.profile, scale)} {scale.unit}".rstrip()] if item.profile else []
    return "Profile likelihoods with their 95 % intervals: " + "; ".join(parts) + "."


CORNER_DRAWS = 12_000
# Quantile range of the posterior a corner axis spans.
CORNER_SPAN = (0.002, 0.998)
HISTOGRAM_BINS = 32
# Shares of the draws within the contours: one and two standard deviations of a normal distribution of two dimensions.
LEVELS = (0.393, 0.865)
# A Gaussian of one bin, mirrored at the edges, as a matrix: what scipy.ndimage would do takes longer to import.
_REACH = np.arange(-4, 5)
_WINDOWS = sliding_window_view(np.pad(np.eye(HISTOGRAM_BINS), ((4, 4), (0, 0)), "symmetric"), _REACH.size, axis=0)
SMOOTHING: FloatArray = _WINDOWS @ np.exp(-0.5 * _REACH**2) / np.exp(-0.5 * _REACH**2).sum()


@dataclass(frozen=True)
class CornerData:
    """The point estimate in the units of its `axes`; the `edges` (bins + 1,) of each axis, evenly spaced on it; the
    `bins` of some draws (parameters, draws), HISTOGRAM_BINS where one lies beyond; and the densities (bins,) of
    posterior and prior per length of the axis: per value, or on a logarithmic axis per natural logarithm.
    """

    axes: tuple[ParameterAxis, ...]
    point: FloatArray
    edges: tuple[FloatArray, ...]
    bins: NDArray[np.int64]
    posterior: tuple[FloatArray, ...]
    prior: tuple[FloatArray, ...]

    def middles(self, k: int) -> FloatArray:
        """The middles of the bins of an axis (bins,)."""
        return self.axes[k].middles(self.edges[k])


def corner_data(fit: Fit) -> CornerData:
    """Everything the corner plot shows."""
    axes, every, point = in_units(fit)
    rows = np.linspace(0, every.shape[0] - 1, min(CORNER_DRAWS, every.shape[0])).astype(int)
    draws = every[rows]
    ends = np.quantile(draws, CORNER_SPAN, axis=0)
    # The point estimate is part of the picture even where it lies at the edge of the draws.
    low, high = np.minimum(ends[0], point), np.maximum(ends[1], point)
    edges = tuple(
        axis.between(*axis.margins(float(low[k]), float(high[k]), 0.03), HISTOGRAM_BINS + 1)
        for k, axis in enumerate(axes)
    )
    along = tuple(zip(axes, edges, strict=True))
    bins = np.stack([_bins(axis, draws[:, k], edges[k]) for k, axis in enumerate(axes)])
    densities = tuple(_density(axis, bins[k], edges[k]) for k, axis in enumerate(axes))
    prior = tuple(_prior_density(item.prior, *on) for item, on in zip(pictured(fit)[0], along, strict=True))
    return CornerData(axes, point, edges, bins, densities, prior)


def in_units(fit: Fit) -> tuple[tuple[ParameterAxis, ...], FloatArray, FloatArray]:
    """The axis of each parameter that is `pictured`, all draws (draws, parameters) and the point estimate in their
    units.
    """
    shown, draws, point = pictured(fit)
    axes = tuple(parameter_axis(item.spec) for item in shown)
    factors = np.array([axis.factor for axis in axes])
    return axes, draws * factors, point * factors


def pictured(fit: Fit) -> tuple[list[Parameter], FloatArray, FloatArray]:
    """The free parameters, of those that differ between levels the values there instead of their scatter; their draws
    (draws, parameters) and the point estimate, in SI.
    """
    posterior, problem = drawn(fit), fit.problem
    draws, scatter = posterior.draws, {item.name for item in fit.scatter}
    best = problem.free_rows([fit.point.values])
    known = {item.parameter.name: item for item in quantities(problem)}
    shown, columns, point = list[Parameter](), list[FloatArray](), list[float]()
    for k, name in enumerate(posterior.names):
        if name not in scatter:
            shown.append(parameter(fit, name))
            columns.append(draws[:, k])
            point.append(fit.point.values[name])
        for pooling in problem.pooling:
            if name == (pooling.parameter if pooling.parameter in posterior.names else pooling.spread_name):
                levels = [known[pooling.level_name(label)] for label in pooling.labels]
                shown += [item.parameter for item in levels]
                columns += [item.rule(draws) for item in levels]
                point += [float(item.rule(best)[0]) for item in levels]
    return shown, np.stack(columns, axis=1), np.array(point)


def _bins(axis: ParameterAxis, draws: FloatArray, edges: FloatArray) -> NDArray[np.int64]:
    """The bin of each draw: the edges are evenly spaced, so that nothing is searched."""
    low, high = axis.lengths(edges[[0, -1]])
    share = (axis.lengths(draws) - low) / (high - low)
    return np.where((share >= 0.0) & (share < 1.0), (share * HISTOGRAM_BINS).astype(np.int64), HISTOGRAM_BINS)


def _density(axis: ParameterAxis, bins: NDArray[np.int64], edges: FloatArray) -> FloatArray:
    counts = np.bincount(bins, minlength=HISTOGRAM_BINS + 1)[:HISTOGRAM_BINS]
    return np.asarray(counts / (bins.size * np.diff(axis.lengths(edges))))


def _prior_density(prior: Prior, axis: ParameterAxis, edges: FloatArray) -> FloatArray:
    """Mean density of the prior itself between `edges`, (bins,)."""
    low, high = prior.quantile(np.array([0.0, 1.0])) * axis.factor
    middle = axis.middles(edges)
    inside = (middle > low) & (middle < high)
    safe = np.where(inside, middle, 0.5 * (low + high)) / axis.factor
    density = np.exp(prior.log_density(prior.coordinate(safe)))
    # From the density of ln x to that of x, and from that of x to that of the axis.
    per_value = density / safe if prior.log else density
    per_length = per_value * safe if axis.logarithmic else per_value / axis.factor
    return np.where(inside, per_length, 0.0)


def pair_density(data: CornerData, across: int, up: int) -> tuple[FloatArray, FloatArray]:
    """Smoothed density of two parameters on their axes (bins, bins), rows upwards, and its values at the contours,
    lowest first.
    """
    # One row and column more for the draws beyond, which are left out.
    side = HISTOGRAM_BINS + 1
    counts = np.bincount(data.bins[up] * side + data.bins[across], minlength=side * side).reshape(side, side)
    density = SMOOTHING @ counts[:-1, :-1] @ SMOOTHING.T
    order = np.sort(density.ravel())[::-1]
    shares = np.cumsum(order) / order.sum()
    return density, np.array([order[np.searchsorted(shares, level)] for level in LEVELS[::-1]])


# Inches: a panel, smaller where many would make a sheet too large to look at; between panels; for labels, and where
# they stand in it.
CORNER_PANEL, WIDEST, LEAST, GAP, LABEL_MARGIN, LABEL_PLACE = 1.55, 10.8, 0.75, 0.12, 0.95, 0.25
# Between the contours and within the inner one: opaque, which draws faster than what shines through.
SHADES = [pale(MODEL, 0.35), pale(MODEL, 0.7)]


def corner_figure(fit: Fit) -> Figure:
    """All pairs of free parameters."""
    data = corner_data(fit)
    count = len(data.axes)
    size = max(LEAST, min(CORNER_PANEL, WIDEST / count - GAP))
    whole = max(5.2, LABEL_MARGIN + count * (size + GAP))
    sheet = Sheet(whole, whole)
    across = [_side(data, k, LABEL_MARGIN + k * (size + GAP), size) for k in range(count)]
    up = [_side(data, k, LABEL_MARGIN + (count - 1 - k) * (size + GAP), size) for k in range(count)]
    tallest = [1.06 * max(float(data.posterior[k].max()), float(data.prior[k].max())) for k in range(count)]
    diagonal = [Panel(across[k], Side(0.0, tallest[k], False, up[k].start, size)) for k in range(count)]
    pairs = {(row, column): Panel(across[column], up[row]) for row in range(count) for column in range(row)}
    _draw_diagonal(sheet, data, diagonal)
    _draw_pairs(sheet, data, pairs)
    left, lowest = [pairs[row, 0] for row in range(1, count)], [Panel(side, up[-1]) for side in across]
    sheet.frames([*diagonal, *pairs.values()])
    sheet.ticks(lowest, "x", rotation=45)
    sheet.ticks(left, "y", rotation=45)
    letters = 10.0 if count < 12 else 8.0
    for k, axis in enumerate(data.axes):
        own = axis.letters(letters)
        sheet.text(across[k].start + 0.5 * size, LABEL_PLACE, axis.label, own, ha="center", va="center")
        if k:
            sheet.text(LABEL_PLACE, up[k].start + 0.5 * size, axis.label, own, ha="center", va="center", rotation=90)
    _corner_legend(sheet, verbatim(f"{fit.problem.model.name} on {fit.problem.table.name}"), count < 4)
    return sheet.figure


def _side(data: CornerData, k: int, start: float, size: float) -> Side:
    edges = data.edges[k]
    return Side(float(edges[0]), float(edges[-1]), data.axes[k].logarithmic, start, size)


def _draw_diagonal(sheet: Sheet, data: CornerData, panels: list[Panel]) -> None:
    outlines = [panel.steps(data.edges[k], data.posterior[k]) for k, panel in enumerate(panels)]
    sheet.areas([Path(outline) for outline in outlines], SHADES[0], 1.0)
    sheet.lines(outlines, MODEL, 1.0)
    # The prior has no ends within the panel.
    sheet.lines([panel.steps(data.edges[k], data.prior[k])[1:-1] for k, panel in enumerate(panels)], PRIOR, 1.3)
    points = [panel.path(data.point[k], np.array([0.0, panel.up.high])) for k, panel in enumerate(panels)]
    sheet.lines(points, MEASURED, 1.0, linestyles="--")


def _draw_pairs(sheet: Sheet, data: CornerData, panels: dict[tuple[int, int], Panel]) -> None:
    """Areas within the contours, and the contours; a flat density has none."""
    areas: tuple[list[Path], list[Path]] = ([], [])
    lines: list[FloatArray] = []
    for (row, column), panel in panels.items():
        density, levels = pair_density(data, column, row)
        if not levels[0] < levels[1]:
            continue
        x, y = (side.place(data.middles(k)) for side, k in ((panel.across, column), (panel.up, row)))
        # What it returns is of a type that depends on the arguments.
        found: Any = contour_generator(x, y, density, fill_type=FillType.OuterCode, line_type=LineType.Separate)
        for within, level in zip(areas, levels, strict=True):
            within += map(Path, *found.filled(float(level), 1.01 * float(density.max())))
            lines += found.lines(float(level))
    for within, shade, order in zip(areas, SHADES, (1.0, 1.1), strict=True):
        sheet.areas(within, shade, order)
    sheet.lines(lines, MODEL, 0.9)
    marks = np.array([panel.path(data.point[j], data.point[k]) for (k, j), panel in panels.items()])
    if marks.size:
        sheet.axes.plot(*marks.T, "+", color=MEASURED, markersize=7, scalex=False, scaley=False)


def _corner_legend(sheet: Sheet, title: str, small: bool) -> None:
    handles = [
        Line2D([], [], color=MODEL, label="posterior (contours: 39 and 86 % of it)"),
        Line2D([], [], color=PRIOR, label="prior"),
        Line2D([], [], color=MEASURED, linestyle="--", marker="+", label="point estimate"),
    ]
    sheet.figure.legend(
        handles=handles, loc="upper right", bbox_to_anchor=(0.995, 1.0 - 0.3 / sheet.figure.get_figheight()),
        fontsize=8 if small else 11, frameon=False, title=title, title_fontsize=9 if small else 13, alignment="right",
    )  # fmt: skip


# Correlations that the words name, the strongest first.
NAMED = 3


def corner_words(fit: Fit) -> str:
    """The figure in words and numbers."""
    shown, draws, _point = pictured(fit)
    names = [item.name for item in shown]
    matrix = np.atleast_2d(np.corrcoef(draws, rowvar=False)) if fit.correlation is not None else None
    medians = "; ".join(
        f"{row.name} {row.median} {row.interval_95} {row.unit}".rstrip()
        for row in map(parameter_row, fit.reported)
        if row.name in names
    )
    text = f"Posterior of {len(names)} parameters, median and 95 % interval: {medians}."
    if matrix is None or len(names) < 2:
        return text
    above = [(abs(matrix[i, j]), i, j) for i in range(len(names)) for j in range(i)]
    strongest = sorted(above, reverse=True)[:NAMED]
    pairs = ", ".join(f"{names[j]} with {names[i]} {matrix[i, j]:+.2f}" for _size_of, i, j in strongest)
    return f"{text} Strongest correlations: {pairs}."


# Inches: a panel, and what surrounds them.
PACKAGE_PANEL, PACKAGE_ROUND = 1.6, 1.2


@own_style()
def package_corner_figure(fit: Fit) -> Figure:
    """Draws and point estimate in the units of our own corner plot, on its axes; `corner.overplot_points` and the
    like take the figure.
    """
    # What it imports takes longer than our own plot takes to draw.
    from corner import corner

    axes, draws, point = in_units(fit)
    side = PACKAGE_PANEL * len(axes) + PACKAGE_ROUND
    made: Figure = corner(
        draws,
        labels=[axis.label for axis in axes],
        axes_scale=["log" if axis.logarithmic else "linear" for axis in axes],
        truths=point,
        max_n_ticks=3,
        labelpad=0.12,
        fig=new_figure(side, side, layout=None),
    )
    return made


TRACE_WALKERS = 3
TRACE_STEPS = 300
MARGINAL_BINS, MARGINAL_SPAN = 40, (0.001, 0.999)


@dataclass(frozen=True)
class TraceData:
    """One parameter in the unit of its axis: steps (shown,), values (ensembles, walkers, shown), and each ensemble's
    marginal as edges (bins + 1,) and heights (bins,), the highest of them 1.
    """

    axis: ParameterAxis
    steps: FloatArray
    values: FloatArray
    marginals: tuple[tuple[FloatArray, FloatArray], ...]


def trace_data(fit: Fit) -> tuple[TraceData, ...]:
    """A few walkers of each ensemble, thinned, and all draws of each as a histogram."""
    posterior = drawn(fit)
    ensembles, steps, walkers, _ = posterior.values.shape
    shown = np.unique(np.linspace(0, steps - 1, min(TRACE_STEPS, steps)).astype(int))
    some = np.unique(np.linspace(0, walkers - 1, TRACE_WALKERS).astype(int))
    at = shown.astype(np.float64)
    if fit.diagnostics is not None:
        at = fit.diagnostics.warm_up + shown * ((fit.diagnostics.steps - fit.diagnostics.warm_up) / steps)
    result = []
    for k, name in enumerate(posterior.names):
        axis = parameter_axis(parameter(fit, name).spec)
        values = posterior.values[:, shown][:, :, some, k] * axis.factor
        marginals = tuple(_marginal(axis, posterior.values[one, :, :, k].ravel()) for one in range(ensembles))
        result.append(TraceData(axis, at, values.transpose(0, 2, 1), marginals))
    return tuple(result)


def _marginal(axis: ParameterAxis, draws: FloatArray) -> tuple[FloatArray, FloatArray]:
    low, high = (float(end) for end in np.quantile(draws * axis.factor, MARGINAL_SPAN))
    edges = axis.between(low, high, MARGINAL_BINS + 1)
    counts = np.histogram(draws * axis.factor, edges)[0]
    return edges, counts / counts.max()


# Inches: panels of walkers and of marginals, their height, and the room around them.
WIDE, NARROW, HIGH, LEFT, RIGHT, TOP, BOTTOM, ACROSS, DOWN = 6.6, 1.7, 0.9, 1.1, 0.15, 0.55, 0.9, 0.15, 0.12


def trace_figure(fit: Fit) -> Figure:
    """A row for each free parameter."""
    data = trace_data(fit)
    height = BOTTOM + TOP + len(data) * (HIGH + DOWN)
    sheet = Sheet(LEFT + WIDE + ACROSS + NARROW + RIGHT, height)
    steps = Side(float(data[0].steps[0]), float(data[0].steps[-1]), False, LEFT, WIDE)
    marginal = Side(0.0, 1.05, False, LEFT + WIDE + ACROSS, NARROW)
    colours = [SERIES[k % len(SERIES)] for k in range(len(data[0].values))]
    panels = []
    for row, item in enumerate(data):
        up = _trace_up(item, height - TOP - (row + 1) * (HIGH + DOWN))
        panels.append((Panel(steps, up), Panel(marginal, up)))
        _draw_trace(sheet, item, *panels[-1], colours)
        letters = item.axis.letters(10)
        sheet.text(0.2, up.start + 0.5 * HIGH, item.axis.label, letters, ha="center", va="center", rotation=90)
    sheet.frames([panel for pair in panels for panel in pair])
    sheet.ticks([pair[0] for pair in panels], "y", 4)
    sheet.ticks([panels[-1][0]], "x", 7)
    for side, words in ((steps, "step"), (marginal, "marginal")):
        sheet.text(side.start + 0.5 * side.length, BOTTOM - 0.35, words, 10, ha="center", va="center")
    # Weighted draws are in chains of one.
    many = drawn(fit).values.shape[2] > 1
    chain, words = ("ensemble", "walkers after warm-up") if many else ("chain", "weighted draws, by chain")
    legend_below(sheet.figure, {f"{chain} {k}": Line2D([], [], color=it) for k, it in enumerate(colours, 1)}, 6)
    fit_heading(sheet.figure, fit, words)
    return sheet.figure


def _trace_up(item: TraceData, start: float) -> Side:
    """All that is seen of a parameter, with margins."""
    seen = [float(item.values.min()), float(item.values.max())]
    seen += [float(edges[k]) for edges, _heights in item.marginals for k in (0, -1)]
    return Side(*item.axis.margins(min(seen), max(seen)), item.axis.logarithmic, start, HIGH)


def _draw_trace(sheet: Sheet, item: TraceData, left: Panel, right: Panel, colours: list[str]) -> None:
    # Ensembles in turn, so that none hides the others; without smoothed edges the file is a third as large.
    walkers = [left.path(item.steps, walker) for turn in item.values.swapaxes(0, 1) for walker in turn]
    sheet.lines(walkers, colours * item.values.shape[1], 0.5, antialiaseds=False)
    sheet.lines([right.steps(*marginal, lying=True) for marginal in item.marginals], colours, 1.2)


def trace_words(fit: Fit) -> str:
    """The figure in words and numbers."""
    diagnostics = fit.diagnostics
    if diagnostics is None:
        return ""
    worst = max(diagnostics.r_hat, key=lambda name: diagnostics.r_hat[name])
    chains = diagnostics.ensembles
    what = f"Walkers of {chains} ensembles" if diagnostics.pareto_k is None else f"{chains} chains of weighted draws"
    short_of = "too few draws" if diagnostics.max_r_hat < TARGET_R_HAT else "the chains differ"
    return (
        f"{what} over steps {diagnostics.warm_up} to {diagnostics.steps}: "
        f"{'converged' if diagnostics.converged else f'not converged, {short_of}'}. "
        f"Largest R-hat {diagnostics.max_r_hat:.3f}, of {worst}; "
        f"smallest effective sample size {min(diagnostics.min_ess_bulk, diagnostics.min_ess_tail):.0f}."
    )
