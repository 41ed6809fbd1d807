"""The map of regimes: areas of slip and grip over angle and spin, contours of the rebound, the impacts of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from fitball.inference.prediction.simulate import NONE, RegimeMap
from fitball.models.types import STATUS_REASON, Status, regime_name
from fitball.observables import OBSERVABLES
from fitball.report.figures.canvas import new_figure, other_scale, own_style, verbatim
from fitball.report.figures.predictions import OTHERS, regime_colours
from fitball.report.form.numbers import output_scale
from fitball.report.form.palette import REGIMES
from fitball.values import FloatArray, Impacts

# Areas below this share of the map share a colour, as do those for which there is none left.
LEAST_AREA = 0.002
# How far from its edge, in shares of the map's width, the middle of an area must be for its name to fit in.
ROOM = 0.07
# How much white lightens an area, so that lines on it show.
PALE = 0.55
NO_SOLUTION = "no solution"
# Impacts whose speed differs by less than this share belong to the map; others are faint.
NEAR = 0.1
RPM = 30.0 / np.pi
LEVELS = 9


@dataclass(frozen=True)
class Areas:
    """The map with a number for each colour: `numbers` (spins, angles) into `names`, `colours` and `shares`."""

    numbers: NDArray[np.int64]
    names: tuple[str, ...]
    colours: tuple[tuple[float, float, float], ...]
    shares: tuple[float, ...]


def _numbered(codes: NDArray[np.int64], names: Sequence[str]) -> NDArray[np.int64]:
    """For each packed sequence the place of its name, or of the others."""
    known, inverse = np.unique(codes, return_inverse=True)
    words = [NO_SOLUTION if code == NONE else regime_name(code) for code in known.tolist()]
    places = [names.index(name if name in names else OTHERS) for name in words]
    return np.array(places, dtype=np.int64)[inverse].reshape(codes.shape)


def areas(found: RegimeMap) -> Areas:
    """Sequences by area, the largest first; the rare ones as one, what has no solution last."""
    shares = {name or NO_SOLUTION: share for name, share in found.areas.items()}
    unsolved = shares.pop(NO_SOLUTION, 0.0)
    named = [name for name, share in shares.items() if share >= LEAST_AREA][: len(REGIMES)]
    rest = sum(share for name, share in shares.items() if name not in named)
    names = [*named, *([OTHERS] if rest > 0.0 else [])]
    colours = [_pale(colour) for colour in regime_colours(names)]
    sizes = [*(shares[name] for name in named), *([rest] if rest > 0.0 else [])]
    if unsolved > 0.0:
        names, colours, sizes = [*names, NO_SOLUTION], [*colours, (1.0, 1.0, 1.0)], [*sizes, unsolved]
    return Areas(_numbered(found.regime, names), tuple(names), tuple(colours), tuple(sizes))


def _pale(colour: str) -> tuple[float, float, float]:
    red, green, blue = (PALE + (1.0 - PALE) * part for part in to_rgb(colour))
    return red, green, blue


@own_style()
def map_figure(
    found: RegimeMap, title: str, contours: str = "theta_2", impacts: Impacts | None = None, source: str = ""
) -> Figure:
    """Areas with contours of the output `contours`.

    `impacts` are shown as marks, those of another speed faint; `source` says whose they are.
    """
    marked = areas(found)
    figure = new_figure(6.6, 6.3)
    axis = figure.subplots()
    _draw_areas(axis, found, marked)
    labels = _draw_contours(axis, found, contours)
    names = _draw_names(axis, found, marked)
    handles: list[Patch | Line2D] = [
        Patch(facecolor=colour, edgecolor="0.4", linewidth=0.6, label=f"{name} ({100.0 * share:.0f} %)")
        for name, colour, share in zip(marked.names, marked.colours, marked.shares, strict=True)
    ]
    scale = output_scale(contours)
    label = f"contours: {OBSERVABLES[contours].title} {OBSERVABLES[contours].symbol} [{scale.unit}]"
    handles.append(Line2D([], [], color="0.15", linewidth=0.9, label=label))
    if impacts is not None:
        handles += _draw_impacts(axis, found, impacts, source)
    low, high = np.degrees(found.window.angle)
    axis.set_xlim(low, high)
    axis.set_ylim(*found.window.spin)
    axis.axhline(0.0, color="0.35", linewidth=0.7, linestyle=":")
    axis.set_xlabel("incidence, angle to the court [deg]")
    axis.set_ylabel("spin [rad/s]: back (below 0), top (above)")
    other_scale(axis, "right", RPM, "spin [rpm]")
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=8.5)
    figure.suptitle(verbatim(f"{title}: regimes of contact at {found.window.speed:.4g} m/s"))
    _uncover(figure, names, labels)
    return figure


def _uncover(figure: Figure, names: Sequence[Text], labels: Sequence[Text]) -> None:
    """Remove labels of contours below names; their places are known once the figure is laid out."""
    figure.draw_without_rendering()
    boxes = [name.get_window_extent().padded(2.0) for name in names]
    for label in labels:
        label.set_visible(not any(box.overlaps(label.get_window_extent()) for box in boxes))


def _extent(found: RegimeMap) -> tuple[float, float, float, float]:
    low, high = np.degrees(found.window.angle)
    return float(low), float(high), *found.window.spin


def _draw_areas(axis: Axes, found: RegimeMap, marked: Areas) -> None:
    axis.imshow(
        marked.numbers, cmap=ListedColormap(marked.colours), vmin=-0.5, vmax=len(marked.names) - 0.5,
        origin="lower", aspect="auto", extent=_extent(found), interpolation="nearest",
    )  # fmt: skip
    _draw_edges(axis, np.degrees(found.angles), found.spins, found.regime)
    axis.set_title("slip and grip, first to last")


def _draw_edges(axis: Axes, angles: FloatArray, spins: FloatArray, codes: NDArray[np.int64]) -> None:
    """A line around each sequence."""
    for code in np.unique(codes):
        inside = codes == code
        if not np.all(inside):
            axis.contour(angles, spins, inside.astype(float), levels=[0.5], colors="0.3", linewidths=0.6)


def _draw_contours(axis: Axes, found: RegimeMap, name: str) -> Sequence[Text]:
    """Contours; gives their labels."""
    values = np.ma.masked_invalid(found.outputs[name] * output_scale(name).factor)
    if values.mask.all() or np.ptp(values.compressed()) == 0.0:
        return ()
    levels = MaxNLocator(LEVELS).tick_values(values.min(), values.max())
    lines = axis.contour(np.degrees(found.angles), found.spins, values, levels=levels, colors="0.15", linewidths=0.9)
    return list(axis.clabel(lines, fontsize=7.5, fmt="%g"))


def _draw_names(axis: Axes, found: RegimeMap, marked: Areas) -> list[Text]:
    """Names where there is room for them, in the middle of the widest part of an area."""
    names = []
    for number, name in enumerate(marked.names):
        inside = np.pad(marked.numbers == number, 1)
        # Rows count double: a name is wider than its lines are high.
        distance = distance_transform_edt(inside, sampling=(2.0, 1.0))[1:-1, 1:-1]
        if distance.max() < ROOM * found.angles.size:
            continue
        row, column = np.unravel_index(int(np.argmax(distance)), distance.shape)
        text = axis.text(
            float(np.degrees(found.angles[column])), float(found.spins[row]), name.replace("-", "-\n"),
            ha="center", va="center", fontsize=8, fontweight="bold", color="0.1", zorder=4,
        )  # fmt: skip
        text.set_path_effects([withStroke(linewidth=3.0, foreground=marked.colours[number])])
        names.append(text)
    return names


def _draw_impacts(axis: Axes, found: RegimeMap, impacts: Impacts, source: str) -> list[Line2D]:
    speed = impacts.speed
    angle = np.degrees(impacts.angle)
    near = np.abs(speed / found.window.speed - 1.0) < NEAR
    handles = []
    for chosen, face, words in (
        (near, "black", f"within {100 * NEAR:.0f} % of this speed"),
        (~near, "none", "others"),
    ):
        (mark,) = axis.plot(
            angle[chosen], impacts.omega_1[chosen], "o", markersize=5 if face == "black" else 4.5,
            markerfacecolor=face, markeredgecolor="white" if face == "black" else "0.15", markeredgewidth=0.8,
            linestyle="none", label=verbatim(f"{source}: {words} ({int(chosen.sum())})"), zorder=5,
        )  # fmt: skip
        if chosen.any():
            handles.append(mark)
    return handles


def map_text(found: RegimeMap, title: str) -> str:
    """The map in words: areas, and the angles between sequences without spin."""
    window = found.window
    low, high = np.degrees(window.angle)
    head = f"{title}: regimes of contact at {window.speed:.4g} m/s, {low:.4g} to {high:.4g} deg, "
    head += f"{window.spin[0]:.4g} to {window.spin[1]:.4g} rad/s"
    lines = [head, "-" * len(head)]
    if window.spin[0] <= 0.0 <= window.spin[1]:
        lines.append("without spin, by angle to the court:")
        lines += [
            f"  {np.degrees(start):8.3f} to {np.degrees(end):7.3f} deg  {name or NO_SOLUTION}"
            for name, start, end in found.along_angle
        ]
    lines.append("share of the map:")
    lines += [f"  {100.0 * share:5.1f} %  {name or NO_SOLUTION}" for name, share in found.areas.items()]
    for status in np.unique(found.status[found.status != Status.OK]).tolist():
        lines.append(f"no solution: {STATUS_REASON[Status(status)]}")
    return "\n".join(lines)


def map_json(found: RegimeMap) -> dict[str, object]:
    """The map without its grid, SI units."""
    return {
        "speed": found.window.speed,
        "angle": list(found.window.angle),
        "spin": list(found.window.spin),
        "without_spin": [{"regime": name, "from": start, "to": end} for name, start, end in found.along_angle],
        "areas": found.areas,
    }


def map_rows(found: RegimeMap) -> list[dict[str, object]]:
    """One row for each impact of a coarser grid: incidence, regime and rebound, in SI."""
    rows: list[dict[str, object]] = []
    stride = (max(1, found.spins.size // 48), max(1, found.angles.size // 64))
    for row in range(stride[0] // 2, found.spins.size, stride[0]):
        for column in range(stride[1] // 2, found.angles.size, stride[1]):
            cell: dict[str, object] = {
                "theta_1 [rad]": float(found.angles[column]),
                "omega_1 [rad/s]": float(found.spins[row]),
                "regime": regime_name(int(found.regime[row, column])),
            }
            for name, values in found.outputs.items():
                value = float(values[row, column])
                cell[f"{name} [{OBSERVABLES[name].unit}]"] = value if np.isfinite(value) else None
            rows.append(cell)
    return rows


def contour_names() -> Mapping[str, str]:
    """Outputs that contours may show, with their titles."""
    return {name: column.title for name, column in OBSERVABLES.items()}
