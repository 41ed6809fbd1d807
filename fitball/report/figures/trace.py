"""The figure of walkers: a few of each ensemble after warm-up, and the marginal of each ensemble."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fitball.inference.results.results import TARGET_R_HAT, Fit
from fitball.report.figures.canvas import fit_heading, legend_below
from fitball.report.figures.quantities import ParameterAxis, drawn, no_posterior, parameter, parameter_axis
from fitball.report.figures.sheet import Panel, Sheet, Side
from fitball.report.form.palette import SERIES
from fitball.values import FloatArray

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


def figure(fit: Fit) -> Figure:
    """A row for each free parameter."""
    data = trace_data(fit)
    height = BOTTOM + TOP + len(data) * (HIGH + DOWN)
    sheet = Sheet(LEFT + WIDE + ACROSS + NARROW + RIGHT, height)
    steps = Side(float(data[0].steps[0]), float(data[0].steps[-1]), False, LEFT, WIDE)
    marginal = Side(0.0, 1.05, False, LEFT + WIDE + ACROSS, NARROW)
    colours = [SERIES[k % len(SERIES)] for k in range(len(data[0].values))]
    panels = []
    for row, item in enumerate(data):
        up = _up(item, height - TOP - (row + 1) * (HIGH + DOWN))
        panels.append((Panel(steps, up), Panel(marginal, up)))
        _draw(sheet, item, *panels[-1], colours)
        letters = item.axis.letters(10)
        sheet.text(0.2, up.start + 0.5 * HIGH, item.axis.label, letters, ha="center", va="center", rotation=90)
    sheet.frames([panel for pair in panels for panel in pair])
    sheet.ticks([pair[0] for pair in panels], "y", 4)
    sheet.ticks([panels[-1][0]], "x", 7)
    for side, words in ((steps, "step"), (marginal, "marginal")):
        sheet.text(side.start + 0.5 * side.length, BOTTOM - 0.35, words, 10, ha="center", va="center")
    # Draws that were weighed are in chains of one.
    many = drawn(fit).values.shape[2] > 1
    chain, words = ("ensemble", "walkers after warm-up") if many else ("chain", "weighed draws, chain by chain")
    legend_below(sheet.figure, {f"{chain} {k}": Line2D([], [], color=it) for k, it in enumerate(colours, 1)}, 6)
    fit_heading(sheet.figure, fit, words)
    return sheet.figure


def _up(item: TraceData, start: float) -> Side:
    """All that is seen of a parameter, with margins."""
    seen = [float(item.values.min()), float(item.values.max())]
    seen += [float(edges[k]) for edges, _heights in item.marginals for k in (0, -1)]
    return Side(*item.axis.margins(min(seen), max(seen)), item.axis.logarithmic, start, HIGH)


def _draw(sheet: Sheet, item: TraceData, left: Panel, right: Panel, colours: list[str]) -> None:
    # Ensembles in turn, so that none hides the others; without smoothed edges the file is a third as large.
    walkers = [left.path(item.steps, walker) for turn in item.values.swapaxes(0, 1) for walker in turn]
    sheet.lines(walkers, colours * item.values.shape[1], 0.5, antialiaseds=False)
    sheet.lines([right.steps(*marginal, lying=True) for marginal in item.marginals], colours, 1.2)


def missing(fit: Fit) -> str:
    """Why a fit has no such figure, "" where it has."""
    return no_posterior(fit)


def words(fit: Fit) -> str:
    """The figure in words and numbers, for who does not see it."""
    diagnostics = fit.diagnostics
    if diagnostics is None:
        return ""
    worst = max(diagnostics.r_hat, key=lambda name: diagnostics.r_hat[name])
    chains = diagnostics.ensembles
    who = f"Walkers of {chains} ensembles" if diagnostics.pareto_k is None else f"{chains} chains of weighed draws"
    many = " are not yet enough" if diagnostics.max_r_hat < TARGET_R_HAT else " do not yet agree"
    state = " agree" if diagnostics.converged else many
    return (
        f"{who} over steps {diagnostics.warm_up} to {diagnostics.steps}: they{state}; "
        f"the largest R-hat is {diagnostics.max_r_hat:.3f}, of {worst}, "
        f"the smallest effective sample size {min(diagnostics.min_ess_bulk, diagnostics.min_ess_tail):.0f}."
    )
