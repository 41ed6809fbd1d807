"""Expected gain of one more impact over angle and speed, a panel a spin; over what varies where one thing does."""

from __future__ import annotations

import math
import warnings

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from fitball.inference.design.asked import AS_BEFORE
from fitball.inference.design.make_plan import Plan
from fitball.report.figures.canvas import Margins, filled, heading, new_figure, own_style, verbatim
from fitball.report.form.palette import FAINT, MEASURED, MODEL, TREND, series_style
from fitball.report.plan.document import spin_text
from fitball.values import FloatArray

CELL = (2.5, 2.6)
MOST_COLUMNS = 5
MARKS = (
    "numbers: chosen impacts in their order; dots: impacts of the fitted data, at the nearest spin; "
    "grey: most draws cannot be evaluated"
)
# White paper to the colour of what the model says, and darker still.
SHADES = LinearSegmentedColormap.from_list("gain", ["#ffffff", "#bcd9ec", MODEL, "#00304d"])


@own_style()
def plan_figure(plan: Plan, title: str) -> Figure:
    """The map of gains with the chosen impacts numbered; of several surfaces the best one at each place."""
    found = plan.settings
    with warnings.catch_warnings():
        # A setting that is left out on every surface stays empty.
        warnings.simplefilter("ignore", RuntimeWarning)
        gains = np.nanmax(plan.gains, axis=0)
    if found.speeds.size == 1 or found.angles.size == 1:
        return _lines(plan, gains, title)
    count, columns = found.spins.size, min(found.spins.size, MOST_COLUMNS)
    margins = Margins(left=0.7, right=1.0, top=0.85, bottom=0.85, down=0.45)
    figure, axes = filled(count, MOST_COLUMNS, CELL, margins)
    norm = Normalize(0.0, float(np.nanmax(gains)))
    for k, axis in enumerate(axes.ravel()[:count]):
        _panel(axis, plan, gains[:, :, k], k, norm)
        if k % columns == 0:
            axis.set_ylabel("speed [m/s]")
        else:
            axis.set_yticklabels([])
        if k + columns >= count:
            axis.set_xlabel("angle [deg]")
        else:
            axis.set_xticklabels([])
    width, height = figure.get_size_inches()
    place = (1.0 - 0.8 / width, 0.85 / height, 0.16 / width, 1.0 - 1.7 / height)
    bar = figure.colorbar(ScalarMappable(norm, SHADES), cax=figure.add_axes(place))
    bar.set_label("gain of one impact [nats]", fontsize=9)
    figure.text(0.5, 0.12 / height, MARKS, ha="center", fontsize=8.5)
    heading(figure, title)
    return figure


def _edges(values: FloatArray) -> FloatArray:
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


def _panel(axis: Axes, plan: Plan, gains: FloatArray, place: int, norm: Normalize) -> None:
    found = plan.settings
    angles, spin = np.degrees(found.angles), float(found.spins[place])
    axis.set_facecolor(FAINT)
    axis.pcolormesh(_edges(angles), _edges(found.speeds), np.ma.masked_invalid(gains), cmap=SHADES, norm=norm)
    known = plan.measured
    near = np.argmin(np.abs(known.omega_1[:, None] - found.spins[None, :]), axis=1) == place
    axis.plot(
        np.degrees(known.angle)[near], known.speed[near], "o",
        color=MEASURED, markersize=3.0, alpha=0.7,
    )  # fmt: skip
    numbers: dict[tuple[float, float], list[str]] = {}
    for number, one in enumerate(plan.chosen, 1):
        if math.isclose(one.setting.spin, spin, abs_tol=1e-9) and _on_grid(plan, one.setting.angle, one.sensor):
            numbers.setdefault((math.degrees(one.setting.angle), one.setting.speed), []).append(str(number))
    for (angle, speed), texts in numbers.items():
        axis.plot([angle], [speed], "o", color=TREND, markersize=9.0, markeredgecolor="white", clip_on=False)
        axis.annotate(
            ",".join(texts), (angle, speed), xytext=(0, -13), textcoords="offset points", ha="center", va="center",
            fontsize=9, color=TREND, fontweight="bold",
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
        )  # fmt: skip
    axis.set_xlim(*_edges(angles)[[0, -1]])
    axis.set_ylim(*_edges(found.speeds)[[0, -1]])
    axis.set_title(spin_text(spin), fontsize=9.5)


def _on_grid(plan: Plan, angle: float, sensor: str) -> bool:
    return sensor == AS_BEFORE or bool(np.any(np.isclose(plan.settings.angles, angle)))


def _lines(plan: Plan, gains: FloatArray, title: str) -> Figure:
    """A line a spin over angle, or over speed where there is one angle only."""
    found = plan.settings
    over_speed = found.angles.size == 1
    along = found.speeds if over_speed else np.degrees(found.angles)
    figure = new_figure(7.5, 4.2)
    axis = figure.subplots()
    for place, spin in enumerate(found.spins):
        colour, marker = series_style(place) if found.spins.size > 1 else (MODEL, "o")
        line = gains[:, 0, place] if over_speed else gains[0, :, place]
        axis.plot(along, line, color=colour, marker=marker, markersize=4.0, label=spin_text(float(spin)))
    for number, one in enumerate(plan.chosen, 1):
        where = one.setting.speed if over_speed else math.degrees(one.setting.angle)
        axis.axvline(where, color=TREND, linewidth=0.8)
        axis.annotate(
            str(number), (where, 1.0), xycoords=("data", "axes fraction"), xytext=(4, -10 * number),
            textcoords="offset points", fontsize=9, color=TREND,
        )  # fmt: skip
    axis.set_xlabel("speed [m/s]" if over_speed else f"angle [deg], at {found.speeds[0]:.4g} m/s")
    axis.set_ylabel("gain of one impact [nats]")
    axis.set_ylim(bottom=0.0)
    axis.grid()
    if found.spins.size > 1:
        axis.legend()
    figure.suptitle(verbatim(title))
    return figure
