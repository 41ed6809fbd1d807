"""A film of one bounce: core and shell with the springs between them, forces, slip and grip, in slow motion."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from subprocess import CalledProcessError
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.animation import FFMpegWriter
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, FancyArrowPatch
from PIL import Image
from scipy.integrate import cumulative_trapezoid

from fitball.errors import ParameterError, ResultFolderError
from fitball.inference.prediction.simulate import Simulation
from fitball.models.history import History
from fitball.models.types import PHASE_SYMBOL, Phase
from fitball.report.figures.canvas import new_figure, own_style
from fitball.report.form.files import write_bytes
from fitball.report.form.palette import SERIES
from fitball.report.history.figure import SHADES
from fitball.values import FloatArray
from fitball.wording import option

# Time in flight on either side of the contact, in shares of it.
FLIGHT = 0.3
# About how long a film lasts [s]; how many times it is slowed down is a round number.
LASTS = 5.0
IN_FLIGHT, IN_CONTACT = "in flight", "contact"


@dataclass(frozen=True)
class Motion:
    """A bounce at instants `time` [s after landing], all arrays (instants,) in SI: `x` of the centre along the court,
    `height` of the shell above it, `compression`; how far core and shell have turned since landing [rad], topspin
    positive; `normal_force` and `friction_force` of the court, `slip`, velocities and spins as in `History`; `state`
    in a word; `slowed` how many times slower than life the film runs.
    """

    time: FloatArray
    x: FloatArray
    height: FloatArray
    compression: FloatArray
    core_turned: FloatArray
    shell_turned: FloatArray
    normal_force: FloatArray
    friction_force: FloatArray
    slip: FloatArray
    v_x: FloatArray
    v_y: FloatArray
    omega_1: FloatArray
    omega_2: FloatArray
    state: tuple[str, ...]
    slowed: float


def motion(simulation: Simulation, frames_per_second: float) -> Motion:
    """The instants of a film of about `LASTS` seconds, the flight before and after the contact included."""
    history = simulation.history
    flight = FLIGHT * history.contact_time
    whole = history.contact_time + 2.0 * flight
    slowed = _round(LASTS / whole)
    count = max(2, round(whole * slowed * frames_per_second) + 1)
    time = np.linspace(-flight, whole - flight, count)
    before, after = history.landing.before, history.release.after
    early, late = np.minimum(time, 0.0), np.maximum(time - history.contact_time, 0.0)

    def moved(name: str) -> FloatArray:
        """How far, by the integral of a velocity."""
        way: FloatArray = cumulative_trapezoid(getattr(history, name), history.times, initial=0)
        inside = np.interp(time, history.times, way)
        rates: tuple[float, float] = getattr(before, name), getattr(after, name)
        return inside + rates[0] * early + rates[1] * late

    def in_contact(name: str, outside: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
        inside = np.interp(time, history.times, getattr(history, name))
        return np.where(early < 0.0, outside[0], np.where(late > 0.0, outside[1], inside))

    def always(name: str) -> FloatArray:
        return in_contact(name, (getattr(before, name), getattr(after, name)))

    return Motion(
        time=time,
        x=moved("v_x"),
        height=-before.v_y * early - after.v_y * late,
        compression=in_contact("y"),
        core_turned=moved("omega_1"),
        shell_turned=moved("omega_2"),
        normal_force=in_contact("normal_force"),
        friction_force=in_contact("friction_force"),
        slip=in_contact("slip"),
        v_x=always("v_x"),
        v_y=always("v_y"),
        omega_1=always("omega_1"),
        omega_2=always("omega_2"),
        state=tuple(_state(history, at) for at in time.tolist()),
        slowed=slowed,
    )


def _state(history: History, time: float) -> str:
    if not 0.0 <= time <= history.contact_time:
        return IN_FLIGHT
    return next((PHASE_SYMBOL[span.phase] for span in history.spans if time <= span.end), IN_CONTACT)


def phase_of(state: str) -> Phase | None:
    """The phase that a state names; None for others."""
    return next((phase for phase, symbol in PHASE_SYMBOL.items() if symbol == state), None)


def _round(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda digit: abs(math.log(value / (digit * power))))


ENDINGS = (".gif", ".mp4")
FRAMES_PER_SECOND = 20
DPI = 100
# Colours that all frames of a GIF share: it is a drawing, and a common palette keeps it small.
PALETTE = 96
# Height of the stripe by which a colour makes sure of its place in the palette.
SWATCH = 24
RUBBER = "#E9F2C4"
# The drawing, in radii of the ball: inner edge of the shell, the core, how far compression may move the core.
SHELL, CORE, REACH = 0.86, 0.40, 0.42
SPRINGS, TURNS, WIDTH = 6, 5, 0.05
# Length of the arrow of the greatest force, in radii.
ARROW = 1.2
NORMAL, FRICTION = SERIES[0], SERIES[1]
RPM = 30.0 / np.pi


def check_film(place: Path) -> None:
    """Raise ParameterError where no such film can be made: another ending, or MP4 without ffmpeg."""
    ending = place.suffix.lower()
    if ending not in ENDINGS:
        raise ParameterError(f"{option('animate', str(place))}: expected a name that ends in .gif or .mp4")
    if ending == ".mp4" and not FFMpegWriter.isAvailable():
        raise ParameterError(
            f"{option('animate', str(place))}: MP4 needs ffmpeg, which is not on the PATH here; install it, or name "
            f"{place.with_suffix('.gif')}"
        )


@own_style()
def write_film(simulation: Simulation, title: str, place: Path, frames_per_second: int = FRAMES_PER_SECOND) -> None:
    """Write a film as GIF (equal bounces become equal bytes) or MP4. Raises ParameterError, ResultFolderError."""
    check_film(place)
    film = Film(simulation, title, motion(simulation, frames_per_second))
    make = _gif if place.suffix.lower() == ".gif" else _mp4
    write_bytes(place, make(film, frames_per_second), named=True)


class Film:
    """The figure of a bounce, drawn anew for each instant."""

    def __init__(self, simulation: Simulation, title: str, found: Motion) -> None:
        self.found, self.history = found, simulation.history
        self.radius = self.history.radius
        deepest = float(found.compression.max())
        # A core that moves further than the shell is wide is drawn to a smaller scale, which is stated.
        self.scale = min(1.0, REACH * self.radius / deepest) if deepest > 0.0 else 1.0
        self.greatest = float(np.max(found.normal_force))
        self.figure = new_figure(6.4, 5.2, None)
        self.scene = self.figure.add_axes((0.02, 0.33, 0.71, 0.58))
        self.course = self.figure.add_axes((0.11, 0.09, 0.86, 0.2))
        self.figure.suptitle(title, fontsize=10, y=0.985)
        self._set_scene()
        self._set_course()

    def _set_scene(self) -> None:
        axis, radius, found = self.scene, self.radius, self.found
        axis.set_aspect("equal")
        axis.set_xlim(float(found.x.min()) - 1.35 * radius, float(found.x.max()) + 1.35 * radius)
        axis.set_ylim(-(ARROW + 0.15) * radius, 2.15 * radius + float(found.height.max()))
        axis.set_anchor("S")
        axis.axis("off")
        left, right = axis.get_xlim()
        axis.plot([left, right], [0.0, 0.0], color="0.25", linewidth=2.0, zorder=1)
        for mark in np.arange(math.ceil(left / 0.05), math.floor(right / 0.05) + 1) * 0.05:
            axis.plot([mark, mark], [0.0, -0.12 * radius], color="0.25", linewidth=1.0)
            axis.text(mark, -0.16 * radius, f"{100.0 * mark:.0f} cm", ha="center", va="top", fontsize=7, color="0.35")
        self.rings = [
            Circle((0.0, 0.0), radius, facecolor=RUBBER, edgecolor="0.2", linewidth=1.5),
            Circle((0.0, 0.0), SHELL * radius, facecolor="white", edgecolor="0.2", linewidth=1.0),
        ]
        self.springs = [Line2D([], [], color="0.45", linewidth=1.0, zorder=2) for _ in range(SPRINGS)]
        self.core = Circle((0.0, 0.0), CORE * radius, facecolor="0.75", edgecolor="0.2", zorder=3)
        # Marks that make rotation visible.
        self.on_shell = Line2D([], [], color=SERIES[2], linewidth=3.5, solid_capstyle="butt", zorder=3)
        self.on_core = Line2D([], [], color=SERIES[2], linewidth=3.0, zorder=4)
        self.arrows = [
            FancyArrowPatch((0, 0), (0, 0), color=colour, linewidth=2.2, arrowstyle="-|>", mutation_scale=12,
                            shrinkA=0.0, shrinkB=0.0, zorder=5)
            for colour in (NORMAL, FRICTION)
        ]  # fmt: skip
        for patch in (*self.rings, self.core, *self.arrows):
            axis.add_patch(patch)
        for line in (*self.springs, self.on_shell, self.on_core):
            axis.add_line(line)
        place: dict[str, Any] = {"transform": self.figure.transFigure, "va": "top", "clip_on": False}
        self.box = {"boxstyle": "round", "edgecolor": "0.4"}
        self.state = axis.text(0.755, 0.86, "", fontsize=10, **place)
        self.numbers = axis.text(0.745, 0.78, "", fontsize=8, family="monospace", linespacing=1.5, **place)
        smaller = "" if self.scale == 1.0 else f"; compression drawn at {100.0 * self.scale:.0f} %"
        words = f"slowed down {self.found.slowed:,.0f} times{smaller}"
        self.figure.text(0.5, 0.945, words, fontsize=8, ha="center", va="top", color="0.3")

    def _set_course(self) -> None:
        axis, history = self.course, self.history
        for span in history.spans:
            axis.axvspan(1e3 * span.start, 1e3 * span.end, color=SHADES[span.phase], linewidth=0)
            middle = 0.5 * (span.start + span.end)
            if span.end - span.start > 0.08 * history.contact_time:
                axis.text(1e3 * middle, 0.97, PHASE_SYMBOL[span.phase], transform=axis.get_xaxis_transform(),
                          ha="center", va="top", fontsize=7.5, color="0.3")  # fmt: skip
        axis.plot(1e3 * history.times, history.normal_force, color=NORMAL, linewidth=1.4, label="normal force")
        axis.plot(1e3 * history.times, history.friction_force, color=FRICTION, linewidth=1.4, label="friction")
        axis.axhline(0.0, color="0.4", linewidth=0.6)
        axis.set_xlim(1e3 * self.found.time[0], 1e3 * self.found.time[-1])
        axis.set_ylim(top=1.25 * self.greatest)
        axis.set_xlabel("time [ms]", fontsize=8, labelpad=1)
        axis.set_ylabel("force [N]", fontsize=8)
        axis.tick_params(labelsize=7)
        axis.legend(fontsize=7, frameon=False, loc="center right")
        self.now = axis.axvline(0.0, color="0.1", linewidth=1.2)

    def show(self, k: int) -> None:
        """Draw instant `k`."""
        found, radius = self.found, self.radius
        x, bottom = float(found.x[k]), float(found.height[k])
        centre = np.array([x, bottom + radius])
        core = centre - [0.0, self.scale * float(found.compression[k])]
        for part in self.rings:
            part.center = (x, bottom + radius)
        self.core.center = (float(core[0]), float(core[1]))
        # Topspin of a ball that flies to the right turns clockwise.
        shell_at, core_at = -float(found.shell_turned[k]), -float(found.core_turned[k])
        for number, spring in enumerate(self.springs):
            at = 2.0 * np.pi * (number + 0.5) / SPRINGS
            inner, outer = CORE * radius * _unit(core_at + at), SHELL * radius * _unit(shell_at + at)
            spring.set_data(*_zigzag(core + inner, centre + outer, WIDTH * radius))
        rim = [centre + share * radius * _unit(shell_at + 0.5 * np.pi) for share in (SHELL, 1.0)]
        self.on_shell.set_data(*np.transpose(rim))
        self.on_core.set_data(*np.transpose([core, core + CORE * radius * _unit(core_at + 0.5 * np.pi)]))
        self._show_forces(k, x)
        self._show_words(k)
        self.now.set_xdata([1e3 * found.time[k]] * 2)

    def _show_forces(self, k: int, x: float) -> None:
        reach = ARROW * self.radius / self.greatest if self.greatest > 0.0 else 0.0
        up, along = reach * float(self.found.normal_force[k]), reach * float(self.found.friction_force[k])
        for arrow, tail, tip in (
            (self.arrows[0], (x, -up), (x, 0.0)),
            (self.arrows[1], (x, 0.0), (x + along, 0.0)),
        ):
            arrow.set_positions(tail, tip)
            arrow.set_visible(math.dist(tail, tip) > 0.05 * self.radius)

    def _show_words(self, k: int) -> None:
        found = self.found
        phase = phase_of(found.state[k])
        self.state.set_text(found.state[k])
        self.state.set_bbox({**self.box, "facecolor": "white" if phase is None else SHADES[phase]})
        rows = [
            ("time", f"{1e3 * found.time[k]:.2f}", "ms"),
            ("v_x", f"{found.v_x[k]:.1f}", "m/s"),
            ("v_y, up", f"{-found.v_y[k]:.1f}", "m/s"),
            ("slip", "-" if found.state[k] == IN_FLIGHT else f"{found.slip[k]:.1f}", "m/s"),
            ("shell", f"{RPM * found.omega_2[k]:.0f}", "rpm"),
            ("core", f"{RPM * found.omega_1[k]:.0f}", "rpm"),
        ]
        self.numbers.set_text("\n".join(f"{name:<8}{value:>7} {unit:<3}" for name, value, unit in rows))

    @property
    def moving(self) -> list[tuple[Axes, Artist]]:
        """What differs from instant to instant, the lowest first."""
        parts = (*self.rings, *self.springs, self.core, self.on_shell, self.on_core, *self.arrows)
        return [(self.scene, part) for part in (*parts, self.state, self.numbers)] + [(self.course, self.now)]

    def frames(self) -> Iterator[Image.Image]:
        """Every instant as a picture: what moves is drawn over what does not, which is ten times as quick."""
        canvas: Any = self.figure.canvas
        self.figure.set_dpi(DPI)
        for _axis, part in self.moving:
            part.set_animated(True)
        canvas.draw()
        still = canvas.copy_from_bbox(self.figure.bbox)
        for k in range(self.found.time.size):
            self.show(k)
            canvas.restore_region(still)
            for axis, part in self.moving:
                axis.draw_artist(part)
            yield Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])


def _unit(angle: float) -> FloatArray:
    return np.array([math.cos(angle), math.sin(angle)])


def _zigzag(start: FloatArray, end: FloatArray, width: float) -> FloatArray:
    """A coil spring from `start` to `end`, (2, points)."""
    along = end - start
    across = width * np.array([-along[1], along[0]]) / max(math.hypot(*along), 1e-12)
    shares = np.linspace(0.0, 1.0, 2 * TURNS + 2)
    sides = np.array([0.0, *(1.0 if turn % 2 else -1.0 for turn in range(2 * TURNS)), 0.0])
    return (start + shares[:, None] * along + sides[:, None] * across).T


def _gif(film: Film, frames_per_second: int) -> bytes:
    pictures = list(film.frames())
    palette = _palette(pictures)
    made = io.BytesIO()
    first, *rest = (picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures)
    first.save(
        made, format="GIF", save_all=True, append_images=rest, duration=round(1000 / frames_per_second), loop=0
    )
    return made.getvalue()


def _palette(pictures: Sequence[Image.Image]) -> Image.Image:
    """Colours for all frames: those of a few instants, and those that mean something, however little they cover."""
    sample = [pictures[k] for k in np.linspace(0, len(pictures) - 1, 5).astype(int)]
    width, height = sample[0].size
    named = [*SERIES, *SHADES.values(), RUBBER]
    together = Image.new("RGB", (width, height * len(sample) + SWATCH * len(named)))
    for k, picture in enumerate(sample):
        together.paste(picture, (0, k * height))
    for k, colour in enumerate(named):
        top = height * len(sample) + SWATCH * k
        together.paste(colour, (0, top, width, top + SWATCH))
    return together.quantize(PALETTE, dither=Image.Dither.NONE)


def _mp4(film: Film, frames_per_second: int) -> bytes:
    writer = FFMpegWriter(fps=frames_per_second, extra_args=["-f", "mp4", "-pix_fmt", "yuv420p"])
    with TemporaryDirectory(prefix="fitball-film-") as folder:
        made = Path(folder) / "film.mp4"
        try:
            with writer.saving(film.figure, str(made), DPI):
                for k in range(film.found.time.size):
                    film.show(k)
                    writer.grab_frame()
            return made.read_bytes()
        except (OSError, CalledProcessError) as error:
            raise ResultFolderError(f"{made}: ffmpeg could not write it: {error}; is there room?") from None
