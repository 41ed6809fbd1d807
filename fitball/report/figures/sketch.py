"""A sketch of the ball of a model, with the symbols of its parameters and the signs of its state."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyArrowPatch

from fitball.inference.results.results import Fit
from fitball.models.specs import SPECS
from fitball.report.figures.canvas import new_figure
from fitball.report.form.palette import FAINT, GUIDE, MEASURED, MODEL
from fitball.values import FloatArray

# Radii of shell and core in the sketch, how far the core has come down, and how far ahead the normal force acts.
SHELL, CORE, DOWN, AHEAD = 1.0, 0.5, 0.1, 0.3
CENTRE = (0.0, SHELL - DOWN)
TURNS = 5
FORCE = GUIDE


def sketch_figure(fit: Fit) -> Figure:
    """The sketch for the parameters that the model of a fit has."""
    return ball_sketch(fit.problem.model.specs, f"{fit.problem.model.name}: symbols and signs")


def ball_sketch(names: Collection[str], title: str) -> Figure:
    """A sketch with the symbols of the parameters `names`: no core, spring or offset where a model has none."""
    figure = new_figure(8.4, 4.1, layout=None)
    axis = figure.add_axes((0.01, 0.01, 0.98, 0.92))
    axis.set_xlim(-3.6, 3.6)
    axis.set_ylim(-0.62, 2.66)
    axis.set_aspect("equal")
    axis.axis("off")
    axis.plot([-3.4, 3.4], [0.0, 0.0], color=MEASURED, linewidth=1.6)
    hatches = [[(x - 0.1, -0.1), (x, 0.0)] for x in np.arange(-3.35, 3.4, 0.16)]
    axis.add_collection(LineCollection(hatches, colors=FAINT, linewidths=0.8), autolim=False)
    axis.text(-3.4, -0.27, "court", fontsize=9, color=GUIDE)
    tangential = "mu" in names
    _ball(axis, names)
    _flight(axis, tangential)
    _contact(axis, names)
    if tangential:
        _spin(axis)
    axis.text(0.0, 2.56, title, ha="center", fontsize=12)
    return figure


def _ball(axis: Axes, names: Collection[str]) -> None:
    """Shell and core with what joins them, or one body."""
    cored = "mass_ratio" in names
    middle = (0.0, SHELL)
    axis.add_patch(Circle(middle, SHELL, fill=False, edgecolor=MODEL, linewidth=5 if cored else 2))
    axis.plot([0.0, -SHELL * np.cos(0.5)], [SHELL, SHELL + SHELL * np.sin(0.5)], color=GUIDE, linewidth=0.8)
    axis.text(-0.62, 1.42, _symbol("ball_radius"), fontsize=10)
    if not cored:
        axis.add_patch(Circle(middle, SHELL, color=MODEL, alpha=0.12, linewidth=0))
        axis.text(0.06, 1.2, f"ball: {_symbol('ball_mass')}, {_symbol('inertia_ratio')}", fontsize=10)
        return
    axis.add_patch(Circle(CENTRE, CORE, color=MODEL, alpha=0.35, linewidth=0))
    axis.text(CENTRE[0], CENTRE[1] - 0.2, "core $M_1, I_1$", ha="center", fontsize=9)
    axis.annotate("shell $M-M_1$", (-0.7, 1.73), (-1.0, 2.28), fontsize=9, ha="right", arrowprops=_thin())
    lowest, bottom = CENTRE[1] - CORE, 0.05
    _spring(axis, (-0.17, lowest + 0.03), (-0.17, bottom))
    _damper(axis, 0.14, lowest + 0.02, bottom)
    axis.text(-0.3, 0.17, _symbol("k_y"), fontsize=10, ha="right", va="center")
    axis.text(0.29, 0.19, _symbol("c_y"), fontsize=10, va="center")
    if "k_theta" in names:
        _spring(axis, (CORE - 0.02, CENTRE[1] + 0.1), (SHELL - 0.06, SHELL + 0.12))
        joint = f"{_symbol('k_theta')}, {_symbol('zeta_theta')}"
        axis.text(0.9, 1.32, joint, fontsize=10, ha="right")


def _spring(axis: Axes, start: tuple[float, float], end: tuple[float, float]) -> None:
    """A zigzag between two points."""
    along = np.linspace(0.0, 1.0, 2 * TURNS + 3)
    across = np.array([0.0, 0.0, *([1.0, -1.0] * TURNS)[: 2 * TURNS - 1], 0.0, 0.0])
    one, other = np.array(start), np.array(end)
    way = other - one
    side = np.array([-way[1], way[0]]) / np.hypot(*way)
    points: FloatArray = one + along[:, None] * way + 0.055 * across[:, None] * side
    axis.plot(points[:, 0], points[:, 1], color=MEASURED, linewidth=1.1)


def _damper(axis: Axes, x: float, top: float, bottom: float) -> None:
    """A piston in a cup."""
    middle = 0.5 * (top + bottom)
    axis.plot([x, x], [top, middle], color=MEASURED, linewidth=1.1)
    axis.plot([x - 0.05, x + 0.05], [middle, middle], color=MEASURED, linewidth=1.6)
    axis.plot([x - 0.08, x - 0.08, x + 0.08, x + 0.08], [middle + 0.07, bottom + 0.07, bottom + 0.07, middle + 0.07],
              color=MEASURED, linewidth=1.1)  # fmt: skip
    axis.plot([x, x], [bottom + 0.07, bottom], color=MEASURED, linewidth=1.1)


def _thin() -> dict[str, object]:
    return {"arrowstyle": "-", "color": GUIDE, "linewidth": 0.8}


def _arrow(axis: Axes, start: tuple[float, float], end: tuple[float, float], colour: str, bend: float = 0.0) -> None:
    axis.add_patch(
        FancyArrowPatch(
            start, end, arrowstyle="-|>", mutation_scale=13, color=colour, linewidth=1.6, shrinkA=0, shrinkB=0,
            connectionstyle=f"arc3,rad={bend}",
        )
    )  # fmt: skip


def _flight(axis: Axes, tangential: bool) -> None:
    """Velocities before and after, with their angles to the court."""
    if not tangential:
        _arrow(axis, (-1.7, 2.2), (-1.7, 0.9), MEASURED)
        _arrow(axis, (1.7, 0.9), (1.7, 1.9), MODEL)
        axis.text(-1.85, 1.6, r"$v_{y1} > 0$", ha="right", fontsize=11)
        axis.text(1.85, 1.4, r"$v_{y2} = \mathrm{COR}\,v_{y1}$", fontsize=11)
        return
    for side, angle, length, colour, name in ((-1, 38.0, 1.75, MEASURED, "1"), (1, 47.0, 1.55, MODEL, "2")):
        slope = np.radians(angle)
        foot = (side * 1.55, 0.45)
        far = (foot[0] + side * length * float(np.cos(slope)), foot[1] + length * float(np.sin(slope)))
        _arrow(axis, far if side < 0 else foot, foot if side < 0 else far, colour)
        axis.plot([foot[0], foot[0] + side * 1.0], [foot[1], foot[1]], color=GUIDE, linewidth=0.8, linestyle=":")
        begin, end = (180.0 - angle, 180.0) if side < 0 else (0.0, angle)
        axis.add_patch(Arc(foot, 1.3, 1.3, theta1=begin, theta2=end, color=GUIDE, linewidth=1.0))
        half = 0.5 * slope
        axis.text(foot[0] + side * 0.82 * np.cos(half), foot[1] + 0.82 * np.sin(half) - 0.04, rf"$\theta_{name}$",
                  ha="center", fontsize=11)  # fmt: skip
        axis.text(far[0] - side * 0.3, far[1] - 0.02, rf"$v_{name}$", fontsize=12, ha="center", color=colour)
    axis.text(-3.4, 0.12, r"$v_{x1},\ v_{y1} > 0$", fontsize=10)
    axis.text(3.4, 0.12, r"$v_{y2} = \mathrm{COR}\,v_{y1}$", fontsize=10, ha="right")


def _contact(axis: Axes, names: Collection[str]) -> None:
    """The forces of the court: the normal force, ahead of the centre where the model has an offset, and friction."""
    offset = next((name for name in ("eps_10", "offset") if name in names), None)
    ahead = AHEAD if offset else 0.0
    _arrow(axis, (ahead, -0.56), (ahead, -0.02), FORCE)
    axis.text(ahead + 0.07, -0.5, "$F$", fontsize=11, color=FORCE)
    if offset:
        axis.plot([0.0, 0.0], [-0.45, CENTRE[1] - CORE], color=GUIDE, linewidth=0.8, linestyle="--")
        axis.annotate("", (0.0, -0.24), (ahead, -0.24), arrowprops={"arrowstyle": "<->", "color": GUIDE})
        axis.text(-0.06, -0.33, r"$\varepsilon$", fontsize=11, ha="right")
    if "mu" in names:
        _arrow(axis, (-0.08, -0.05), (-0.85, -0.05), FORCE)
        grip = f", grip {_symbol('e_x')}" if "e_x" in names else ""
        axis.text(-0.9, -0.33, rf"slide $\mu F${grip}", fontsize=10, ha="right", color=FORCE)


def _spin(axis: Axes) -> None:
    """Topspin of a ball that flies to the right turns it clockwise."""
    _arrow(axis, (-0.62, SHELL + 1.0), (0.72, SHELL + 0.93), MEASURED, bend=-0.35)
    axis.text(0.95, SHELL + 1.06, r"$\omega > 0$: topspin", fontsize=10)


def _symbol(name: str) -> str:
    return SPECS[name].label


def sketch_words(fit: Fit) -> str:
    """The figure in words and numbers."""
    specs = fit.problem.model.specs
    what = "a core within a shell, joined by springs and dampers" if "mass_ratio" in specs else "one body"
    meanings = "; ".join(f"{name}: {spec.meaning}" for name, spec in specs.items())
    return f"Sketch of the ball on the court: {what}. Topspin and speeds towards the right are positive. {meanings}."
