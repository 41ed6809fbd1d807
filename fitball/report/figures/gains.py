"""The figure of a plan: gains of one impact over what a machine can be set to."""

import math
from typing import Any

import numpy as np
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
_SHADES = LinearSegmentedColormap.from_list("gain", ["#ffffff", "#bcd9ec", MODEL_COLOUR, "#00304d"])
# Panels of a row.
_ACROSS = 3
# Impacts that are named at one setting; a panel has no room for more.
_NAMED = 6


def draw_gains(result: Findings) -> Figure:
    """Over angle and speed, a panel a spin, by the sensor of the plan; over what varies where one
    of them does not. Of several surfaces the best. Numbers are the chosen impacts in their order.
    """
    # Speeds and angles went through components.
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
        return _lines(best, plan)
    return _maps(best, plan, sensor)


def _maps(best: DataFrame, plan: DataFrame, sensor: str) -> Figure:
    """A map of gains over angle and speed a spin, with the numbers of the chosen impacts."""
    spins = best["omega_1"].unique()
    across = min(_ACROSS, len(spins))
    rows = math.ceil(len(spins) / across)
    figure, axes = new_figure(
        rows,
        across,
        high=0.9 + 2.1 * rows,
        wide=max(4.0, 0.9 + 1.8 * across),
        sharex=True,
        sharey=True,
    )
    norm = Normalize(float(best["gain"].min()), float(best["gain"].max()))
    for axis, spin in zip(axes.ravel(), spins, strict=False):
        of_spin = best[best["omega_1"] == spin]
        table = of_spin.pivot_table("gain", index="v_1", columns="theta_1", dropna=False)
        angles = _edges(np.degrees(table.columns.to_numpy(np.float64)))
        speeds = _edges(table.index.to_numpy(np.float64))
        axis.set_facecolor(FAINT)
        axis.pcolormesh(angles, speeds, np.ma.masked_invalid(table), cmap=_SHADES, norm=norm)
        _draw_numbers(axis, plan[plan["omega_1"] == spin])
        axis.set_title(f"{fixed(spin, 0)} rad/s")
        axis.grid(visible=False)
        axis.set_xlim(*angles[[0, -1]])
        axis.set_ylim(*speeds[[0, -1]])
        few_ticks(axis.xaxis, 3)
    hide_unused(axes, len(spins), "angle [deg]")
    for axis in axes[:, 0]:
        axis.set_ylabel("speed [m/s]")
    bar = figure.colorbar(ScalarMappable(norm, _SHADES), ax=axes, shrink=0.85, pad=0.02)
    bar.set_label(f"gain [nats], {sensor}")
    return figure


def _edges(values: FloatArray) -> FloatArray:
    """Edges (values + 1,) of cells about rising values, two at least."""
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


def _draw_numbers(axis: Any, chosen: DataFrame) -> None:
    """Draw places in the order of choice; those of one setting together."""
    for _, rows in chosen.groupby(["v_1", "theta_1"]):
        words = _places(rows)
        speed, angle = rows[["v_1", "theta_1"]].to_numpy(np.float64)[0]
        axis.annotate(
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


def _places(rows: DataFrame) -> str:
    """Places of the impacts in the order of choice, at most as many as a panel has room for."""
    return listed((str(number).split()[-1] for number in rows["id"]), last=",", most=_NAMED)


def _lines(best: DataFrame, plan: DataFrame) -> Figure:
    """Lines of gains, one a spin, over speed where there is one angle, else over angle."""
    over = "v_1" if best["theta_1"].nunique() == 1 else "theta_1"
    factor = 1.0 if over == "v_1" else DEG.factor
    figure, axes = new_figure(high=3.4)
    axis = axes[0, 0]
    spins = best["omega_1"].unique()
    handles = list[Any]()
    for k, spin in enumerate(spins):
        colour = MODEL_COLOUR if len(spins) == 1 else SERIES_COLOURS[k % len(SERIES_COLOURS)]
        marker = SERIES_MARKERS[k % len(SERIES_MARKERS)]
        of_spin = best[best["omega_1"] == spin]
        place = factor * of_spin[over]
        axis.plot(place, of_spin["gain"], color=colour, marker=marker, markersize=4)
        text = f"{fixed(spin, 0)} rad/s"
        handles.append(Line2D([], [], color=colour, marker=marker, label=text))
    for _, rows in plan.groupby(over):
        chosen = factor * float(rows[over].iloc[0])
        words = _places(rows)
        axis.axvline(chosen, color=MOVED_COLOUR, linewidth=0.8)
        axis.annotate(
            words,
            (chosen, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, -9),
            fontsize=9,
            textcoords="offset points",
            color=MOVED_COLOUR,
            fontweight="bold",
        )
    axis.set_ylim(0.0, None)
    axis.set_xlabel("speed [m/s]" if over == "v_1" else "angle [deg]")
    axis.set_ylabel("gain of one impact [nats]")
    if len(spins) > 1:
        legend_above(figure, handles)
    return figure
