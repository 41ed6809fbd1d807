"""Pictures of tracked impacts: both flights with the gap between them, residuals, angles; and a whole session."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitball.observables import OBSERVABLES
from fitball.report.figures.canvas import Margins, drawn_handles, filled, heading, legend_below, own_style, panels
from fitball.report.form.numbers import output_scale
from fitball.report.form.palette import FAINT, GUIDE, MEASURED, MODEL, PHASES, PRIOR, SERIES
from fitball.tracks.flight import fly, resistance
from fitball.tracks.frames import AFTER, BEFORE, CONTACT, NINE, Flight, TrackedImpact, Tracks
from fitball.values import FloatArray

# Frames with a smaller probability than this of belonging to their flight are ringed.
RINGED = 0.5
GAPS = ("gap_time", "gap_path", "gap_turn")
POINTS = 60
SIZE = 3.0


@own_style()
def impact_figure(impact: TrackedImpact, tracks: Tracks) -> Figure:
    """Track, residuals and angles of one impact."""
    marked = impact.track.angle is not None and bool(impact.pairs)
    count = 3 if marked else 2
    margins = Margins(left=0.7, right=0.2, top=0.6, bottom=0.7, across=0.75)
    figure, axes = panels(1, count, (3.3, 2.6), margins)
    _path(axes[0, 0], impact, tracks)
    _residuals(axes[0, 1], impact, tracks)
    if marked:
        _angles(axes[0, 2], impact)
    heading(figure, f"Impact {impact.id}")
    legend_below(figure, drawn_handles(*axes.ravel()), 6)
    return figure


def _sign(impact: TrackedImpact) -> float:
    return -1.0 if impact.mirrored else 1.0


def _flown(flight: Flight, times: FloatArray, tracks: Tracks) -> FloatArray:
    """Places (times, 2) on a flight."""
    k = resistance(tracks.filmed.ball, tracks.filmed.air.density)
    start = (flight.x, flight.y, flight.v_x, flight.v_y)
    return fly(start, flight.drag, flight.lift, k, times - flight.time)[:, :2]


def _path(axis: Axes, impact: TrackedImpact, tracks: Tracks) -> None:
    """The ball along the court [m]: frames, both flights, and what is between them."""
    track, role = impact.track, impact.role
    x = _sign(impact) * track.x
    ours = role > 0
    first, last = (float(end) for end in track.time[ours][[0, -1]])
    one, two = impact.before, impact.after
    for flight, ends in ((one, (first, one.time)), (two, (two.time, last))):
        course = _flown(flight, np.linspace(ends[0], ends[1], POINTS), tracks)
        axis.plot(course[:, 0], course[:, 1], color=MODEL, linewidth=1.2, label="flights", zorder=2)
    axis.axvspan(*sorted((one.x, two.x)), color=PHASES[2], label="gap", zorder=0)
    flying = (role == BEFORE) | (role == AFTER)
    axis.plot(x[flying], track.y[flying], "o", color=MEASURED, markersize=SIZE, label="frames", zorder=3)
    axis.plot(
        x[role == CONTACT], track.y[role == CONTACT], "o", color=GUIDE, markersize=SIZE, markerfacecolor="white",
        label="in contact", zorder=3,
    )  # fmt: skip
    off = flying & (impact.weight < RINGED)
    if off.any():
        axis.plot(
            x[off], track.y[off], "o", color=PRIOR, markersize=8, markerfacecolor="none", label="outliers", zorder=4
        )
    if tracks.filmed.court is not None:
        axis.axhline(tracks.filmed.court, color=GUIDE, linewidth=0.8)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set_xlabel("along the court [m]")
    axis.set_ylabel("height [m]")
    axis.set_title("Track")


def _residuals(axis: Axes, impact: TrackedImpact, tracks: Tracks) -> None:
    """Measured less fitted [mm] over time from landing [ms], with twice the noise."""
    noise = tracks.noise.get(impact.track.session)
    time = 1e3 * (impact.track.time - impact.before.time)
    flying = np.isfinite(impact.residual[:, 0])
    if noise is not None:
        for size, colour in ((noise.x, SERIES[0]), (noise.y, SERIES[1])):
            for sign in (-2.0, 2.0):
                axis.axhline(sign * 1e3 * size, color=colour, linewidth=0.8, linestyle="--", alpha=0.7)
    reach = 4e3 * max(noise.x, noise.y) if noise is not None else np.inf
    for k, (name, marker) in enumerate((("x", "o"), ("y", "s"))):
        shown = np.clip(1e3 * impact.residual[flying, k], -reach, reach)
        axis.plot(time[flying], shown, marker, color=SERIES[k], markersize=SIZE, label=f"residual of {name}")
    off = flying & (impact.weight < RINGED)
    for k in (0, 1):
        shown = np.clip(1e3 * impact.residual[off, k], -reach, reach)
        axis.plot(time[off], shown, "o", color=PRIOR, markersize=8, markerfacecolor="none")
    axis.axvspan(0.0, 1e3 * (impact.after.time - impact.before.time), color=PHASES[2], zorder=0)
    axis.axhline(0.0, color=GUIDE, linewidth=0.8)
    axis.set_xlabel("time from landing [ms]")
    axis.set_ylabel("residual [mm]", labelpad=1.0)
    axis.set_title("Residuals, with ± 2 sigma")


def _angles(axis: Axes, impact: TrackedImpact) -> None:
    """Unwrapped angle of the mark [turns], topspin positive, with both lines, and those of other spins in grey."""
    track = impact.track
    assert track.angle is not None
    whole = 2.0 * np.pi / track.fold
    sign = 1.0 if impact.mirrored else -1.0
    best = max(impact.pairs, key=lambda pair: pair.probability)
    ends_of_contact: list[float] = []
    for role, flight, chosen in ((BEFORE, impact.before, best.omega_1), (AFTER, impact.after, best.omega_2)):
        own = (impact.role == role) & np.isfinite(track.angle)
        since = track.time[own] - flight.time
        angle = sign * track.angle[own]
        base = flight.angle if np.isfinite(flight.angle) else _start(angle - chosen * since, whole)
        if ends_of_contact:
            # As far from the line before as the turn says.
            base += whole * round((ends_of_contact[0] + best.turn - base) / whole)
        ends_of_contact.append(base)
        line = base + chosen * since
        near = line + (angle - line + 0.5 * whole) % whole - 0.5 * whole
        ends = np.array([since[0], since[-1], 0.0]) if since.size else np.zeros(1)
        ends = np.array([ends.min(), ends.max()])
        time = 1e3 * (flight.time - impact.before.time + ends)
        others = {round(pair.omega_1 if role == BEFORE else pair.omega_2, 1) for pair in impact.pairs}
        for other in others - {round(chosen, 1)}:
            axis.plot(
                time, (base + other * ends) / (2 * np.pi), color=FAINT, linewidth=1.0, label="other spins", zorder=1
            )
        axis.plot(time, (base + chosen * ends) / (2 * np.pi), color=MODEL, linewidth=1.2, zorder=2)
        axis.plot(
            1e3 * (track.time[own] - impact.before.time), near / (2 * np.pi), "o", color=MEASURED, markersize=SIZE,
            zorder=3,
        )  # fmt: skip
    axis.axvspan(0.0, 1e3 * (impact.after.time - impact.before.time), color=PHASES[2], zorder=0)
    axis.set_xlabel("time from landing [ms]")
    axis.set_ylabel("turns of the mark", labelpad=1.0)
    axis.set_title("Angle" if impact.sure else f"Angle: most probable spin ({best.probability:.2f})")


def _start(angle: FloatArray, whole: float) -> float:
    """The mean of angles that are known modulo `whole`."""
    return float(np.angle(np.exp(2j * np.pi * angle / whole).mean()) * whole / (2.0 * np.pi))


@own_style()
def session_figure(tracks: Tracks) -> Figure:
    """COR over speed, and the gaps over the incident speed, each with its error."""
    impacts = tracks.impacts
    turned = any(impact.sd("gap_turn") > 0.0 for impact in impacts)
    margins = Margins(left=0.75, right=0.2, top=0.6, bottom=0.65, across=0.75, down=0.7)
    names = GAPS if turned else GAPS[:2]
    figure, axes = filled(1 + len(names), 4, (2.6, 2.3), margins)
    values = np.array([impact.values for impact in impacts])
    v_y1, v_y2 = values[:, NINE.index("v_y1")], values[:, NINE.index("v_y2")]
    _points(axes[0, 0], v_y1, v_y2 / v_y1, _cor_errors(impacts))
    axes[0, 0].set_ylabel("COR")
    for axis, name in zip(axes.ravel()[1:], names, strict=False):
        scale, column = output_scale(name), OBSERVABLES[name]
        errors = np.array([impact.sd(name) for impact in impacts])
        kept = np.isfinite(values[:, NINE.index(name)]) & (errors > 0.0)
        _points(axis, v_y1[kept], scale.factor * values[kept, NINE.index(name)], scale.factor * errors[kept])
        axis.set_ylabel(f"{column.symbol}, {name} [{scale.unit}]", labelpad=1.0)
    for axis in axes.ravel()[: 1 + len(names)]:
        axis.set_xlabel("$v_{y1}$ [m/s]")
    heading(figure, f"{len(impacts)} impacts")
    return figure


def _points(axis: Axes, x: FloatArray, y: FloatArray, errors: FloatArray) -> None:
    axis.errorbar(x, y, errors, fmt="o", color=MEASURED, markersize=SIZE, elinewidth=0.8)


def _cor_errors(impacts: Sequence[TrackedImpact]) -> FloatArray:
    """Standard errors of v_y2/v_y1 (impacts,)."""
    one, two = NINE.index("v_y1"), NINE.index("v_y2")
    found = []
    for impact in impacts:
        slope = np.zeros(len(NINE))
        slope[one], slope[two] = -impact.values[two] / impact.values[one] ** 2, 1.0 / impact.values[one]
        found.append(float(np.sqrt(slope @ impact.covariance @ slope)))
    return np.array(found)
