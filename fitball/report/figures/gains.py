"""The figure of a plan: gains of one impact over what a machine can be set to."""

import math

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.lines import Line2D

from fitball.base.display_units import DEG
from fitball.base.findings import Findings
from fitball.base.numbers import fixed
from fitball.base.text import listed
from fitball.base.values import DataFrame, Figure, FloatArray
from fitball.report.figures.shared import hide_unused
from fitball.report.style import (
    FAINT,
    MODEL_COLOUR,
    MOVED_COLOUR,
    SERIES_COLOURS,
    SERIES_MARKERS,
    few_ticks,
    legend_above,
    new_figure,
)

# White paper to the colour of what the model says, and darker still.
_GAIN_COLOURS = LinearSegmentedColormap.from_list(
    "gain", ["#ffffff", "#bcd9ec", MODEL_COLOUR, "#00304d"]
)
# Panels of a row: a page has room for no more.
_MOST_ACROSS = 3
# Impacts that are named at one setting; a panel has no room for more.
_MOST_NUMBERS = 6


def draw_gains(result: Findings) -> Figure:
    """Draw the expected gain of one impact over angle and speed, a panel a spin, by the sensor of
    the plan. Where one of the two does not vary, lines are over the other. Of several surfaces the
    best counts. Numbers are the chosen impacts in their order.
    """
    # Settings were turned into components of the velocity and back: equal ones differ by rounding.
    decimals = {"v_1": 9, "theta_1": 9}
    frame = result.frames["gains"].round(decimals)
    plan = result.frames["plan"].round(decimals)
    sensor = str(plan["sensor"].iloc[0])
    # The best sensor may be a drop, which has one impact and no gains over settings: then those of
    # the last sensor are drawn.
    shown = sensor if sensor in frame else str(frame.columns[-1])
    by_setting = frame.groupby(["omega_1", "v_1", "theta_1"], sort=True)[shown]
    best = by_setting.max().reset_index(name="gain")
    if best["theta_1"].nunique() == 1 or best["v_1"].nunique() == 1:
        return _draw_lines(best, plan)
    return _draw_maps(best, plan, sensor)


def _draw_maps(best: DataFrame, plan: DataFrame, sensor: str) -> Figure:
    """Draw a map of gains over angle and speed for each spin, with the numbers of the chosen
    impacts.
    """
    spins = best["omega_1"].unique()
    across = min(_MOST_ACROSS, len(spins))
    rows = math.ceil(len(spins) / across)
    figure, panels = new_figure(
        rows,
        across,
        high=0.9 + 2.1 * rows,
        wide=max(4.0, 0.9 + 1.8 * across),
        sharex=True,
        sharey=True,
    )
    norm = Normalize(float(best["gain"].min()), float(best["gain"].max()))
    for axes, spin in zip(panels.ravel(), spins, strict=False):
        of_spin = best[best["omega_1"] == spin]
        gains = of_spin.pivot_table("gain", index="v_1", columns="theta_1", dropna=False)
        angles = _edges(np.degrees(gains.columns.to_numpy(np.float64)))
        speeds = _edges(gains.index.to_numpy(np.float64))
        axes.set_facecolor(FAINT)
        axes.pcolormesh(angles, speeds, np.ma.masked_invalid(gains), cmap=_GAIN_COLOURS, norm=norm)
        _draw_numbers(axes, plan[plan["omega_1"] == spin])
        axes.set_title(f"{fixed(spin, 0)} rad/s")
        axes.grid(visible=False)
        axes.set_xlim(*angles[[0, -1]])
        axes.set_ylim(*speeds[[0, -1]])
        few_ticks(axes.xaxis, 3)
    hide_unused(panels, len(spins), "angle [deg]")
    for axes in panels[:, 0]:
        axes.set_ylabel("speed [m/s]")
    bar = figure.colorbar(ScalarMappable(norm, _GAIN_COLOURS), ax=panels, shrink=0.85, pad=0.02)
    bar.set_label(f"gain [nats], {sensor}")
    return figure


def _edges(values: FloatArray) -> FloatArray:
    """Edges of the cells about rising values, of which there are two at least: one more than
    values.
    """
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


def _draw_numbers(axes: Axes, chosen: DataFrame) -> None:
    """Draw the numbers of chosen impacts at their settings, those of one setting together."""
    for _, rows in chosen.groupby(["v_1", "theta_1"]):
        words = _numbers_of(rows)
        speed, angle = rows[["v_1", "theta_1"]].to_numpy(np.float64)[0]
        axes.annotate(
            words,
            (np.degrees(angle), speed),
            ha="center",
            va="center",
            fontsize=9,
            fontweight="bold",
            color="white",
            bbox={"boxstyle": "round,pad=0.25", "facecolor": MOVED_COLOUR, "linewidth": 0.0},
            annotation_clip=False,
            zorder=5,
        )


def _numbers_of(rows: DataFrame) -> str:
    """Numbers of the impacts in the order of choice, at most as many as a panel has room for."""
    return listed((str(number).split()[-1] for number in rows["id"]), last=",", most=_MOST_NUMBERS)


def _draw_lines(best: DataFrame, plan: DataFrame) -> Figure:
    """Draw a line of gains for each spin, over speed where there is one angle, else over angle."""
    over = "v_1" if best["theta_1"].nunique() == 1 else "theta_1"
    factor = 1.0 if over == "v_1" else DEG.factor
    figure, panels = new_figure(high=3.4)
    axes = panels[0, 0]
    spins = best["omega_1"].unique()
    handles = list[Artist]()
    for k, spin in enumerate(spins):
        colour = MODEL_COLOUR if len(spins) == 1 else SERIES_COLOURS[k % len(SERIES_COLOURS)]
        marker = SERIES_MARKERS[k % len(SERIES_MARKERS)]
        of_spin = best[best["omega_1"] == spin]
        setting = factor * of_spin[over]
        axes.plot(setting, of_spin["gain"], color=colour, marker=marker, markersize=4)
        text = f"{fixed(spin, 0)} rad/s"
        handles.append(Line2D([], [], color=colour, marker=marker, label=text))
    for _, rows in plan.groupby(over):
        chosen = factor * float(rows[over].iloc[0])
        words = _numbers_of(rows)
        axes.axvline(chosen, color=MOVED_COLOUR, linewidth=0.8)
        axes.annotate(
            words,
            (chosen, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, -9),
            fontsize=9,
            textcoords="offset points",
            color=MOVED_COLOUR,
            fontweight="bold",
        )
    axes.set_ylim(0.0, None)
    axes.set_xlabel("speed [m/s]" if over == "v_1" else "angle [deg]")
    axes.set_ylabel("gain of one impact [nats]")
    if len(spins) > 1:
        legend_above(figure, handles)
    return figure
