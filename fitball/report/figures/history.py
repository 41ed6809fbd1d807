"""The figure of one impact through time."""

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fitball.base.display_units import MM, MS
from fitball.base.findings import Findings
from fitball.base.values import DataFrame, Figure
from fitball.report.frame_rows import frame_rows
from fitball.report.style import (
    GUIDE_COLOUR,
    INK,
    MODEL_COLOUR,
    PRIOR_COLOUR,
    few_ticks,
    legend_above,
    new_figure,
)

# Colours of the phases of the contact point, pale, so that lines stand out.
_PHASE_COLOURS = {
    "slide": "#e3eefb",
    "slide back": "#fbeee0",
    "grip": "#e2f3e8",
    "hold": "#f3e6f5",
    "free": "#eeeeee",
}
# Colour of the surface speed of the core.
_CORE_COLOUR = "#008060"
# Slip [m/s] that the axis shows at least: of a ball that grips throughout rounding would fill it.
_LEAST_SLIP = 0.1


def draw_history(result: Findings) -> Figure:
    """Draw compression and forces over the time of the contact, shaded by phase; with motion along
    the court also velocities and slip. A band is that of all draws, each at the same share of its
    own contact.
    """
    frame = result.frames["history"]
    phases = result.frames["phases"]
    radius = float(result.frames["impact"]["radius"].iloc[0])
    sliding = len(phases) > 0
    rows = 2 if sliding else 1
    figure, panels = new_figure(rows, 2, high=2.5 + 2.1 * (rows - 1), wide=7.5, sharex=True)
    compression, force, *along = panels.ravel()
    _draw_course(compression, frame, "y", MODEL_COLOUR, MM.factor)
    compression.set_title("compression $y$ [mm]")
    _draw_course(force, frame, "normal_force", MODEL_COLOUR)
    force.set_title("force of the court [N]")
    if sliding:
        speed, slip = along
        for sign in (-1.0, 1.0):
            force.plot(
                MS.factor * frame["time"],
                sign * frame["friction_limit"],
                color=GUIDE_COLOUR,
                linewidth=0.8,
                linestyle="--",
            )
        _draw_course(force, frame, "friction_force", PRIOR_COLOUR)
        _draw_course(speed, frame, "v_x", MODEL_COLOUR)
        for name, colour in (("omega_shell", PRIOR_COLOUR), ("omega_core", _CORE_COLOUR)):
            _draw_course(speed, frame, name, colour, radius)
        speed.set_title("velocity along the court [m/s]")
        _draw_flights(speed, frame, result, radius)
        _draw_course(slip, frame, "slip", MODEL_COLOUR)
        slip.set_title(r"slip $v_x - R\,\omega$ [m/s]")
        low, high = slip.get_ylim()
        slip.set_ylim(min(low, -_LEAST_SLIP), max(high, _LEAST_SLIP))
    for axes in panels.ravel():
        for row in frame_rows(phases):
            axes.axvspan(
                MS.factor * row.number("start"),
                MS.factor * row.number("end"),
                color=_PHASE_COLOURS[row.text("phase")],
                linewidth=0,
                zorder=0,
            )
        axes.set_xlim(0.0, MS.factor * frame["time"].iloc[-1])
        axes.grid(visible=False)
        few_ticks(axes.yaxis)
    force.axhline(0.0, color=GUIDE_COLOUR, linewidth=0.6)
    for axes in panels[-1]:
        axes.set_xlabel("time after landing [ms]")
    legend_above(figure, _handles(frame, phases))
    return figure


def _draw_course(axes: Axes, frame: DataFrame, name: str, colour: str, factor: float = 1.0) -> None:
    """Draw the column `name` of a history, times a factor, over time with its bands, if it has
    any.
    """
    time = MS.factor * frame["time"]
    for low, high, shade in (("q025", "q975", 0.15), ("q16", "q84", 0.25)):
        if f"{name}_{low}" in frame:
            ends = (factor * frame[f"{name}_{low}"], factor * frame[f"{name}_{high}"])
            axes.fill_between(time, *ends, color=colour, alpha=shade, linewidth=0)
    axes.plot(time, factor * frame[name], color=colour, linewidth=1.5)


def _draw_flights(axes: Axes, frame: DataFrame, result: Findings, radius: float) -> None:
    """Draw velocity and surface speed in flight, where they jump at landing and release."""
    values = result.frames["outcome"].set_index("quantity")["value"]
    before = frame_rows(result.frames["impact"])[0]
    ends = (
        (0.0, before.number("v_x1"), before.number("omega_1")),
        (frame["time"].iloc[-1], values["v_x2"], values["omega_2"]),
    )
    for time, speed, spin in ends:
        for value, colour in ((speed, MODEL_COLOUR), (radius * spin, PRIOR_COLOUR)):
            axes.plot(
                MS.factor * time,
                value,
                "o",
                color=colour,
                markerfacecolor="white",
                markersize=5,
                clip_on=False,
                zorder=5,
            )


def _handles(frame: DataFrame, phases: DataFrame) -> list[Artist]:
    """Handles of the legend, one for each kind of line, dot or area that is drawn."""
    sliding = len(phases) > 0
    text = "normal force, velocity" if sliding else "model"
    handles: list[Artist] = [Line2D([], [], color=MODEL_COLOUR, label=text)]
    if sliding:
        handles += [
            Line2D([], [], color=PRIOR_COLOUR, label="friction, surface of shell"),
            Line2D([], [], color=_CORE_COLOUR, label="surface of core"),
            Line2D([], [], color=GUIDE_COLOUR, linestyle="--", label=r"$\pm\mu F$"),
            Line2D(
                [],
                [],
                color=INK,
                marker="o",
                markerfacecolor="white",
                linestyle="",
                label="in flight",
            ),
        ]
    for name in dict.fromkeys(phases["phase"]):
        handles.append(Patch(color=_PHASE_COLOURS[name], label=name))
    if "y_q025" in frame and np.isfinite(frame["y_q025"]).any():
        handles.append(Patch(color=GUIDE_COLOUR, alpha=0.35, label="68 and 95 %"))
    return handles
