"""The forest plot of a comparison: each quantity under each model, beside the mixture by stacking weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.assumptions import Quantity
from fitball.models.registry import parameter_spec
from fitball.report.compare.figure import broken
from fitball.report.figures.canvas import log_scale, new_figure, verbatim
from fitball.report.figures.measured import axis_label
from fitball.report.figures.parameter_axis import ParameterAxis, parameter_axis
from fitball.report.figures.style import own_style
from fitball.report.form.display_units import handy
from fitball.report.form.palette import FAINT, MODEL

STACKED = "stacked mixture"
PANELS, TICKS = 4, 4


def shown(quantities: Mapping[str, Quantity]) -> list[str]:
    """The quantities that have a panel: all but the noise."""
    return [name for name in quantities if name not in NOISE_SPECS]


@own_style()
def forest_figure(quantities: Mapping[str, Quantity], models: Sequence[str], title: str) -> Figure:
    """A panel a quantity; models from best (top) to worst, pale where the table surely scores them below the best."""
    names = shown(quantities)
    across = min(PANELS, len(names))
    down = -(-len(names) // across)
    figure = new_figure(2.2 + 2.5 * across, 1.2 + down * (0.7 + 0.27 * (len(models) + 1)))
    panels = figure.subplots(down, across, sharey=True, squeeze=False)
    labels = [*(broken(name) for name in models), STACKED]
    for panel, name in zip(panels.flat, names, strict=False):
        _draw(panel, name, quantities[name], models)
        panel.set_yticks(range(len(labels)), labels, fontsize=7)
        panel.set_ylim(len(models) + 0.6, -0.6)
    for panel in list(panels.flat)[len(names) :]:
        panel.set_axis_off()
    figure.suptitle(verbatim(title))
    return figure


def _draw(panel: Axes, name: str, quantity: Quantity, models: Sequence[str]) -> None:
    """Median, 68 % (to first order) and 95 % interval under each model that has the quantity, and in the mixture."""
    factor, count = handy(name, quantity.unit).factor, len(models)
    if quantity.span is not None:
        panel.axvspan(quantity.span.low * factor, quantity.span.high * factor, color="0.92", linewidth=0)
    ends: list[float] = []
    for row, model in enumerate([*models, STACKED]):
        item = quantity.stacked if row == count else quantity.by_model.get(model)
        if item is None:
            continue
        colour = MODEL if row == count or model in quantity.as_good else FAINT
        median, sd, low, high = (value * factor for value in (item.median, item.sd, item.q025, item.q975))
        panel.plot([low, high], [row, row], color=colour, linewidth=1.0)
        panel.plot([max(low, median - sd), min(high, median + sd)], [row, row], color=colour, linewidth=3.0)
        panel.plot(median, row, "D" if row == count else "o", color=colour, markersize=4.5)
        ends += [low, high]
    panel.axhline(count - 0.5, color="0.5", linewidth=0.8)
    panel.grid(alpha=0.3, axis="x")
    panel.tick_params(axis="x", labelsize=8)
    spec = parameter_spec(name)
    if spec is None:
        # The pace of one of several surfaces keeps its name.
        shown = ParameterAxis(axis_label(verbatim(name), handy(name, quantity.unit).unit), 1.0, False)
    else:
        shown = parameter_axis(spec)
    if shown.logarithmic:
        log_scale(panel, *shown.margins(min(ends), max(ends)))
    else:
        panel.xaxis.set_major_locator(MaxNLocator(TICKS))
    panel.set_xlabel(shown.label, fontsize=9)
