"""The figure of simulations: courses of one impact or several, panel by panel, along the contact."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fitball.inference.prediction.simulate import Simulation
from fitball.models.history import History
from fitball.models.types import PHASE_SYMBOL, Phase
from fitball.report.figures.canvas import new_figure, other_scale, own_style
from fitball.report.form.palette import PHASES, SERIES

# Pale, so that lines of any colour stand out.
SHADES: Mapping[Phase, str] = dict(zip(Phase, PHASES, strict=True))
ALL_PANELS = ("y", "v_y", "v_x", "slip", "normal_force", "friction_force")
VERTICAL_PANELS = ("y", "v_y", "normal_force")
LABELS: Mapping[str, str] = {
    "y": "compression $y$ [mm]",
    "v_y": "core velocity $v_y$ [m/s]",
    "v_x": "velocity along court [m/s]",
    "slip": r"slip $v_x - R\,\omega_2$ [m/s]",
    "normal_force": "normal force $F$ [N]",
    "friction_force": "friction $F_x$ [N]",
    "omega_2": r"shell spin $\omega_2$ [rad/s]",
    "centre": "centre velocity $v_x$ [m/s]",
    "forces": "force [N]",
}
# A band on the axis of time would show little but the spread of contact times.
BAND_CAPTION = (
    "Bands: 68 and 95 % of {draws} posterior draws, each at equal shares of its own contact time. Rebounds determine "
    "the motion during contact better than the contact time (95 %: {low:.2f} to {high:.2f} ms)."
)


@own_style()
def history_figure(
    simulations: Sequence[Simulation], title: str, panels: Sequence[str] = (), notes: Sequence[str] = ()
) -> Figure:
    """Panels along the share of the contact; the upper axis shows time where all curves last equally long.

    One simulation is shaded by phase; of several, dots mark the transitions between phases.
    """
    shown = tuple(panels) or (ALL_PANELS if simulations[0].history.spans else VERTICAL_PANELS)
    columns = 1 if len(shown) == 1 else 2
    rows = -(-len(shown) // columns)
    words = [*notes, *([_band_words(simulations[0])] if simulations[0].band is not None else [])]
    wrapped = [line for text in words for line in textwrap.wrap(text, 105)]
    figure = new_figure(9.0, (4.6 if columns == 1 else 0.6 + 2.75 * rows) + 0.6 + 0.17 * len(wrapped))
    axes = np.atleast_1d(figure.subplots(rows, columns, sharex=True)).ravel()
    for axis in axes[len(shown) :]:
        axis.set_visible(False)
    alone = len(simulations) == 1
    for axis, panel in zip(axes, shown, strict=False):
        if alone:
            _shade(axis, simulations[0].history)
        for colour, simulation in zip(SERIES, simulations, strict=False):
            DRAWN[panel](axis, simulation, colour, alone)
        axis.set_ylabel(LABELS[panel])
        axis.set_xlim(0.0, 1.0)
        axis.grid()
        if panel in ("slip", "friction_force", "v_y", "forces"):
            axis.axhline(0.0, color="0.4", linewidth=0.7)
    for axis in axes[max(len(shown) - columns, 0) : len(shown)]:
        axis.set_xlabel("share of the contact time")
        axis.tick_params(labelbottom=True)
    lengths = [simulation.history.contact_time for simulation in simulations]
    # Contact times that print alike are one.
    if max(lengths) - min(lengths) <= 5e-6 * max(lengths):
        for axis in axes[:columns]:
            upper = other_scale(axis, "top", 1e3 * lengths[0], "time [ms]")
            upper.xaxis.label.set_fontsize(9)
    _legend(figure, simulations, wrapped, shown)
    figure.suptitle(title)
    return figure


def _band_words(simulation: Simulation) -> str:
    assert simulation.band is not None
    low, *_middle, high = 1e3 * simulation.band.contact_time
    return BAND_CAPTION.format(draws=simulation.band.draws, low=low, high=high)


def _shade(axis: Axes, history: History) -> None:
    for span in history.spans:
        axis.axvspan(span.start_share, span.end_share, color=SHADES[span.phase], linewidth=0, zorder=0)
    for share in history.transition_shares:
        axis.axvline(float(share), color="0.35", linestyle=":", linewidth=1.0, zorder=1)


def _line(
    axis: Axes, simulation: Simulation, name: str, colour: str, alone: bool, factor: float = 1.0, **style: object
) -> None:
    """A course with its band and, among several, dots at its transitions."""
    shares, course = simulation.shares, factor * getattr(simulation.history, name)
    if simulation.band is not None:
        low, mid_low, _median, mid_high, high = factor * simulation.band.quantiles[name]
        for lower, upper, alpha in ((low, high, 0.15), (mid_low, mid_high, 0.25)):
            axis.fill_between(shares, lower, upper, color=colour, alpha=alpha, linewidth=0)
    options: dict[str, Any] = {"color": colour, "linewidth": 1.5, "label": simulation.label, **style}
    axis.plot(shares, course, **options)
    # Slip and grip do not touch the vertical motion.
    if not alone and name not in VERTICAL_PANELS:
        at = simulation.history.transition_shares
        axis.plot(at, np.interp(at, shares, course), "o", color=colour, markersize=4, markerfacecolor="white")


def _velocities(axis: Axes, simulation: Simulation, colour: str, alone: bool) -> None:
    """The centre, and the surfaces of shell and core."""
    history = simulation.history
    if not alone:
        _line(axis, simulation, "v_x", colour, alone)
        axis.plot(simulation.shares, history.radius * history.omega_2, color=colour, linestyle="--", linewidth=1.2)
        return
    _line(axis, simulation, "v_x", SERIES[0], alone, label="$v_x$")
    _line(axis, simulation, "omega_2", SERIES[1], alone, history.radius, label=r"$R\,\omega_2$ shell", linestyle="--")
    _line(axis, simulation, "omega_1", "0.25", alone, history.radius, label=r"$R\,\omega_1$ core", linestyle="-.")
    # A jump at landing or release is a gap between mark and line.
    for share, motion in ((0.0, history.landing.before), (1.0, history.release.after)):
        for value, own, mark in ((motion.v_x, SERIES[0], "o"), (history.radius * motion.omega_2, SERIES[1], "s")):
            axis.plot(share, value, mark, color=own, markersize=5, markerfacecolor="white", clip_on=False, zorder=5)
    axis.plot([], [], "o", color="0.3", markersize=5, markerfacecolor="white", label="in flight")
    _explained(axis)


def _explained(axis: Axes) -> None:
    """A legend where it covers least."""
    axis.legend(loc="best", fontsize=8, frameon=True, framealpha=0.7)


def _friction(axis: Axes, simulation: Simulation, colour: str, alone: bool) -> None:
    """Friction inside the cone."""
    limit = simulation.history.friction * simulation.history.normal_force
    # Cones of several curves would hide what lies inside them.
    for sign in (1.0, -1.0) if alone else ():
        label = r"$\pm\mu F$" if sign > 0.0 else None
        axis.plot(simulation.shares, sign * limit, color="0.4", linestyle="--", linewidth=0.9, label=label)
    _line(axis, simulation, "friction_force", colour, alone, label="$F_x$")
    if alone:
        _explained(axis)


def _forces(axis: Axes, simulation: Simulation, colour: str, alone: bool) -> None:
    """Both forces in one panel, as the thesis draws them."""
    _line(axis, simulation, "normal_force", colour, alone, label="normal force $F$")
    other = SERIES[1] if alone else colour
    _line(axis, simulation, "friction_force", other, alone, label="friction $F_x$", linestyle="--")
    if alone:
        _explained(axis)


def _plain(name: str, factor: float = 1.0) -> Callable[[Axes, Simulation, str, bool], None]:
    def draw(axis: Axes, simulation: Simulation, colour: str, alone: bool) -> None:
        _line(axis, simulation, name, colour, alone, factor)

    return draw


DRAWN: Mapping[str, Callable[[Axes, Simulation, str, bool], None]] = {
    "y": _plain("y", 1e3),
    "v_y": _plain("v_y"),
    "v_x": _velocities,
    "slip": _plain("slip"),
    "normal_force": _plain("normal_force"),
    "friction_force": _friction,
    "omega_2": _plain("omega_2"),
    "centre": _plain("v_x"),
    "forces": _forces,
}


def _legend(figure: Figure, simulations: Sequence[Simulation], caption: Sequence[str], shown: Sequence[str]) -> None:
    """Phases of the one, or names of the several."""
    handles: list[Patch | Line2D]
    if len(simulations) == 1:
        phases = dict.fromkeys(span.phase for span in simulations[0].history.spans)
        handles = [Patch(color=SHADES[phase], label=PHASE_SYMBOL[phase]) for phase in phases]
        if simulations[0].band is not None:
            handles.append(Line2D([], [], color="0.2", linewidth=1.5, label="point estimate"))
    else:
        handles = [
            Line2D([], [], color=colour, linewidth=1.5, label=simulation.label)
            for colour, simulation in zip(SERIES, simulations, strict=False)
        ]
        if "v_x" in shown:
            handles.append(Line2D([], [], color="0.3", linestyle="--", linewidth=1.2, label=r"surface $R\,\omega_2$"))
        changing = any(len(simulation.history.spans) > 1 for simulation in simulations)
        if changing and not set(shown) <= set(VERTICAL_PANELS):
            dot: dict[str, Any] = {"marker": "o", "markerfacecolor": "white", "linestyle": "none"}
            handles.append(Line2D([], [], color="0.3", label="transition", **dot))
    if handles:
        legend = figure.legend(
            handles=handles, loc="outside lower center", ncols=min(6, len(handles)), title="\n".join(caption),
            title_fontsize=8.5,
        )  # fmt: skip
        legend.get_title().set_multialignment("left")
