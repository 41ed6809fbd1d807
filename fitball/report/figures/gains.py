"""The figure of a plan: gains of one impact over what a machine can be set to."""

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
from fitball.report.style import (
    FAINT,
    MARKERS,
    MODEL,
    MOVED,
    SERIES,
    few_ticks,
    legend_above,
    new_figure,
)

# White paper to the colour of what the model says, and darker still.
_SHADES = LinearSegmentedColormap.from_list("gain", ["#ffffff", "#bcd9ec", MODEL, "#00304d"])
# Panels of a row, and impacts that are named at one setting.
_ACROSS = 3
_NAMED = 6


def gains(result: Findings) -> Figure:
    """Over angle and speed, a panel a spin, by the sensor of the plan; over what varies where one
    of them does not. Of several surfaces the best. Numbers are the chosen impacts in their order.
    """
    # Speeds and angles went through components.
    state = {"v_1": 9, "theta_1": 9}
    frame, plan = (result.frames[name].round(state) for name in ("gains", "plan"))
    sensor = str(plan["sensor"].iloc[0])
    # A drop has one impact: what the others are worth as before.
    shown = sensor if sensor in frame else str(frame.columns[-1])
    best = (
        frame.groupby(["omega_1", "v_1", "theta_1"], sort=True)[shown]
        .max()
        .reset_index(name="gain")
    )
    wide = best["theta_1"].nunique()
    high = best["v_1"].nunique()
    return _lines(best, plan) if wide == 1 or high == 1 else _maps(best, plan, sensor)


def _maps(best: DataFrame, plan: DataFrame, sensor: str) -> Figure:
    spins = best["omega_1"].unique()
    across = min(_ACROSS, len(spins))
    rows = -(-len(spins) // across)
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
        mine = best[best["omega_1"] == spin].pivot_table(
            index="v_1",
            columns="theta_1",
            values="gain",
            dropna=False,
        )
        angles = np.degrees(mine.columns.to_numpy(np.float64))
        speeds = mine.index.to_numpy(np.float64)
        axis.set_facecolor(FAINT)
        axis.pcolormesh(
            _edges(angles),
            _edges(speeds),
            np.ma.masked_invalid(mine),
            cmap=_SHADES,
            norm=norm,
        )
        _draw_numbers(axis, plan[plan["omega_1"] == spin])
        axis.set_title(f"{fixed(spin, 0)} rad/s")
        axis.grid(visible=False)
        axis.set_xlim(*_edges(angles)[[0, -1]])
        axis.set_ylim(*_edges(speeds)[[0, -1]])
        few_ticks(axis.xaxis, 3)
    for axis in axes.ravel()[len(spins) :]:
        axis.set_visible(False)
    for axis in axes.ravel()[max(len(spins) - across, 0) : len(spins)]:
        axis.set_xlabel("angle [deg]")
        axis.xaxis.set_tick_params(labelbottom=True)
    for axis in axes[:, 0]:
        axis.set_ylabel("speed [m/s]")
    bar = figure.colorbar(ScalarMappable(norm, _SHADES), ax=axes, shrink=0.85, pad=0.02)
    bar.set_label(f"gain [nats], {sensor}")
    return figure


def _edges(values: FloatArray) -> FloatArray:
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


def _draw_numbers(axis: Any, chosen: DataFrame) -> None:
    """Places in the order of choice; those of one setting together."""
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
            bbox={"boxstyle": "round,pad=0.25", "facecolor": MOVED, "linewidth": 0.0},
            annotation_clip=False,
            zorder=5,
        )


def _places(rows: DataFrame) -> str:
    """Places of the impacts in the order of choice, at most as many as a panel has room for."""
    return listed((str(number).split()[-1] for number in rows["id"]), last=",", most=_NAMED)


def _lines(best: DataFrame, plan: DataFrame) -> Figure:
    """A line a spin, over speed where there is one angle."""
    over = "v_1" if best["theta_1"].nunique() == 1 else "theta_1"
    factor = 1.0 if over == "v_1" else DEG.factor
    figure, axes = new_figure(high=3.4)
    axis = axes[0, 0]
    spins = best["omega_1"].unique()
    handles = list[Any]()
    for k, spin in enumerate(spins):
        colour = MODEL if len(spins) == 1 else SERIES[k % len(SERIES)]
        mine = best[best["omega_1"] == spin]
        axis.plot(
            factor * mine[over],
            mine["gain"],
            color=colour,
            marker=MARKERS[k % len(MARKERS)],
            markersize=4,
        )
        handles.append(
            Line2D(
                [],
                [],
                color=colour,
                marker=MARKERS[k % len(MARKERS)],
                label=f"{fixed(spin, 0)} rad/s",
            )
        )
    for _, rows in plan.groupby(over):
        place = float(rows[over].iloc[0])
        words = _places(rows)
        axis.axvline(factor * place, color=MOVED, linewidth=0.8)
        axis.annotate(
            words,
            (factor * place, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, -9),
            fontsize=9,
            textcoords="offset points",
            color=MOVED,
            fontweight="bold",
        )
    axis.set_ylim(0.0, None)
    axis.set_xlabel("speed [m/s]" if over == "v_1" else "angle [deg]")
    axis.set_ylabel("gain of one impact [nats]")
    if len(spins) > 1:
        legend_above(figure, handles)
    return figure
