"""The figure of a plan: gains of one impact over what a machine can be set to."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox

from fitball.base.display_units import DEG
from fitball.base.findings import Findings
from fitball.base.numbers import fixed
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
# Size of the letters of marks [pt], and the width of a letter over it.
_LETTERS = 8.0
_WIDTH_OF_LETTER = 0.6
# Where a mark may stand from its setting, in its widths and heights, the nearest first.
_OFFSETS = tuple(
    (x, y) for y in (0.0, -1.3, 1.3, -2.6, 2.6, -3.9, 3.9) for x in (0.0, 0.7, -0.7, 1.2, -1.2)
)
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
    # Where there is room depends on the layout.
    figure.draw_without_rendering()
    for axes, spin in zip(panels.ravel(), spins, strict=False):
        _draw_numbers(axes, plan[plan["omega_1"] == spin])
    return figure


def _edges(values: FloatArray) -> FloatArray:
    """Edges of the cells about rising values, of which there are two at least: one more than
    values.
    """
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


def _draw_numbers(axes: Axes, chosen: DataFrame) -> None:
    """Draw the numbers of chosen impacts at their settings, those of one setting together; with a
    line to it beside it, where others stand already, or the panel ends.
    """
    taken = list[Bbox]()
    for _, rows in chosen.groupby(["v_1", "theta_1"]):
        words = _numbers_of(rows)
        speed, angle = rows[["v_1", "theta_1"]].to_numpy(np.float64)[0]
        at = (float(np.degrees(angle)), float(speed))
        offset, box = _room_beside(axes, at, words, taken)
        taken.append(box)
        axes.plot(*at, "o", color=MOVED_COLOUR, markersize=3.0, zorder=4)
        axes.annotate(
            "",
            at,
            xytext=offset,
            textcoords="offset points",
            arrowprops={"arrowstyle": "-", "color": MOVED_COLOUR},
            annotation_clip=False,
            zorder=4,
        )
        axes.annotate(
            words,
            at,
            xytext=offset,
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=_LETTERS,
            fontweight="bold",
            color="white",
            bbox={"boxstyle": "round,pad=0.25", "facecolor": MOVED_COLOUR, "linewidth": 0.0},
            annotation_clip=False,
            zorder=5,
        )


def _room_beside(
    axes: Axes,
    at: tuple[float, float],
    words: str,
    taken: Sequence[Bbox],
) -> tuple[tuple[float, float], Bbox]:
    """The first offset [pt] from a place `at` at which a mark with these words, within the panel,
    overlaps none of those `taken` [pt], with its box; the nearest one where there is none.
    """
    per_pixel = 72.0 / axes.figure.dpi
    centre = per_pixel * axes.transData.transform(at)
    panel = axes.bbox
    inner = Bbox(per_pixel * np.array([[panel.x0, panel.y0], [panel.x1, panel.y1]]))
    size = np.array([_WIDTH_OF_LETTER * len(words) + 0.5, 1.7]) * _LETTERS
    boxes = []
    for shares in _OFFSETS:
        # Within the panel; one that is wider than that is in the middle.
        middle = np.clip(
            centre + size * np.array(shares), inner.min + 0.5 * size, inner.max - 0.5 * size
        )
        boxes.append(Bbox([middle - 0.5 * size, middle + 0.5 * size]))
    free = (box for box in boxes if not any(box.overlaps(other) for other in taken))
    box = next(free, boxes[0])
    x, y = 0.5 * (np.asarray(box.min) + np.asarray(box.max)) - centre
    return (float(x), float(y)), box


def _numbers_of(rows: DataFrame) -> str:
    """Numbers of the impacts in the order of choice, at most as many as a panel has room for."""
    numbers = [str(number).split()[-1] for number in rows["id"]]
    left_out = len(numbers) - _MOST_NUMBERS
    more = [f"{left_out} more"] if left_out > 0 else []
    return ", ".join([*numbers[:_MOST_NUMBERS], *more])


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
