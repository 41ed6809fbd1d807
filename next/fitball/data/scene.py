"""Scenes: what is known besides the numbers; the type is the file, the value, a part of fit.json. Imports: itf, base.

Sections `prior`, `fix`, `pool`, `columns` are the options of the same names, which override them.
"""

import os
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from math import log, pi
from pathlib import Path
from typing import Any, Literal, NamedTuple, NoReturn, TypeGuard

import msgspec

from fitball.columns import COLUMNS
from fitball.errors import Fault, InputError, Note, suggestion
from fitball.itf import BALL_TYPES
from fitball.text import listed, one_line
from fitball.values import Ball


class Section(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A section; an unknown key is a fault."""


class Quantity(Section, frozen=True):
    """A number with its sd, which is fitted; a plain number is held."""

    value: float
    sd: float


class BallSection(Section, frozen=True):
    """The ball: kg, m, I/(M R^2) or I [kg m^2] (`inertia`, not both), degrees Celsius, ITF type. What is None is
    assumed: `Scene.value` and `Scene.ball_sd` have the numbers.
    """

    mass: float | Quantity | None = None
    radius: float | Quantity | None = None
    inertia_ratio: float | Quantity | None = None
    inertia: float | Quantity | None = None
    temperature: float | None = None
    type: str = "type-2"


class CameraSection(Section, frozen=True):
    """What the impacts of a camera share. Of fits: `scale`, `clock` (true over measured), `tilt` [rad],
    `court_height` [m]. Of films: rate, scale, directions, `court` [m], `fold` of marks, and `lasting` [m], errors
    that last over frames, `row_time` [s/px] of a rolling shutter.
    """

    scale: float | Quantity | None = None
    clock: float | Quantity | None = None
    tilt: float | Quantity | None = None
    court_height: float | Quantity | None = None
    fps: float | None = None
    mm_per_px: float | None = None
    y: Literal["up", "down"] = "up"
    angles: Literal["counterclockwise", "clockwise"] = "counterclockwise"
    court: float | Quantity | None = None
    fold: int = 1
    lasting: float = 0.0
    row_time: float | None = None


class Scene(Section, frozen=True):
    """What is known; SI, every section may be left out. `surface` has name, court, mu; `measurement` for each noise
    parameter NAME (held) or nominal_NAME (median of its prior), `noise`, `ignore`, `flip`; `flight` drag, lift,
    spin_sd and `air` of a film; `model` a name as `--model` takes it; `laboratory` and `source` texts for reports.
    Raises InputError (`scene`) for what no ball, court or instrument has.
    """

    ball: BallSection = BallSection()
    surface: dict[str, str | float | Quantity] = {}
    contact_time: Quantity | None = None
    measurement: dict[str, float | str | tuple[str, ...]] = {}
    camera: CameraSection | None = None
    flight: dict[str, float | Quantity] = {}
    air: dict[str, float] = {}
    model: dict[str, str] = {}
    prior: dict[str, str] = {}
    fix: dict[str, float] = {}
    pool: dict[str, str] = {}
    columns: dict[str, str] = {}
    laboratory: dict[str, str] = {}
    source: dict[str, str] = {}

    def __post_init__(self) -> None:
        _check(msgspec.to_builtins(self))
        _check_ball(self.ball)

    def value(self) -> Ball:
        """The ball at its stated values."""
        assumed, ball = Ball(), self.ball
        mass, radius = (_number(getattr(ball, name), getattr(assumed, name)) for name in ("mass", "radius"))
        if ball.inertia is not None:
            return Ball(mass, radius, _number(ball.inertia, 0.0) / (mass * radius**2))
        return Ball(mass, radius, _number(ball.inertia_ratio, assumed.inertia_ratio))

    def ball_sd(self) -> dict[str, float]:
        """Stated sds of mass [kg], radius [m] and inertia_ratio; that of an inertia at the stated mass and radius."""
        stated = {name: getattr(self.ball, name) for name in ("mass", "radius", "inertia_ratio")}
        found = {name: one.sd for name, one in stated.items() if isinstance(one, Quantity)}
        if isinstance(self.ball.inertia, Quantity):
            ball = self.value()
            found["inertia_ratio"] = self.ball.inertia.sd / (ball.mass * ball.radius**2)
        return found

    def assumed(self) -> tuple[Note, ...]:
        """What is assumed because nothing was stated."""
        ball, noise, fitted = self.ball, self.measurement.keys(), "it is fitted with a default prior"
        inertia = ball.inertia_ratio if ball.inertia is None else ball.inertia
        parts = {"mass": ball.mass, "radius": ball.radius, "inertia": inertia}
        unstated = listed(name for name, one in parts.items() if one is None)
        tennis = f"the {unstated} of a tennis ball (57.6 g, 33.02 mm, I/(M R^2) = 0.56)"
        silent = (
            ("assumed-ball", tennis, bool(unstated)),
            ("no-friction", "nothing of the friction: mu has a wide prior", "mu" not in self.surface),
            ("no-contact-time", "nothing of the contact time: k_y depends on its prior", self.contact_time is None),
            ("no-velocity-noise", f"nothing of the noise of velocities: {fitted}", not _VELOCITY_NOISES & noise),
            ("no-spin-noise", f"nothing of the noise of spins: {fitted}", not {"spin_sd", "nominal_spin_sd"} & noise),
        )
        return tuple(Note(code, f"Assumed: {text}.") for code, text, is_so in silent if is_so)


# Each of these says something of the noise of velocities.
_VELOCITY_NOISES = {"velocity_sd", "nominal_velocity_sd", "v_x_sd", "v_y_sd", "speed_sd"}


class _Size(NamedTuple):
    """A number is `low` to `high` in `unit`; of other `units` that may have been meant, the one that makes it most
    `typical` is asked about.
    """

    low: float
    high: float
    unit: str = ""
    typical: float = 1.0
    units: Mapping[str, float] = {}


_MASSES = {"g": 1e-3, "mg": 1e-6, "oz": 0.028349523125, "lb": 0.45359237}
_INERTIAS = {"g cm^2": 1e-7, "g mm^2": 1e-9, "kg cm^2": 1e-4, "kg mm^2": 1e-6, "g m^2": 1e-3}
_SPEEDS, _SPINS = {"mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1 / 3.6}, {"rpm": pi / 30.0}
_ANGLES, _TIMES = {"deg": pi / 180.0}, {"ms": 1e-3, "us": 1e-6}
_LENGTHS = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254}
_UNITS = {"m/s": _SPEEDS, "rad/s": _SPINS, "rad": _ANGLES, "s": _TIMES, "m": _LENGTHS}


def _noises() -> Iterator[tuple[str, _Size]]:
    """Sds of each noise parameter, held or nominal; of a velocity component too, where columns share one."""
    specs = {spec.name: spec for column in COLUMNS.values() if (spec := column.noise) is not None}
    for name, spec in {**specs, "velocity_sd": specs["v_x_sd"]}.items():
        median = float(spec.prior.partition("(")[2].partition(",")[0])
        for prefix in ("", "nominal_"):
            yield f"measurement.{prefix}{name}", _Size(spec.lower, spec.upper, spec.unit, median, _UNITS[spec.unit])


# From a grain of shot to the largest ball that people throw; from the best instruments to useless ones.
_SIZES: Mapping[str, _Size] = {
    "ball.mass": _Size(1e-6, 20.0, "kg", 0.05, _MASSES),
    "ball.radius": _Size(1e-4, 0.5, "m", 0.03, _LENGTHS),
    "ball.inertia_ratio": _Size(0.01, 1.0),
    "ball.inertia": _Size(1e-14, 5.0, "kg m^2", 3.5e-5, _INERTIAS),
    "ball.temperature": _Size(-40.0, 80.0, "degrees Celsius"),
    "surface.mu": _Size(1e-6, 100.0, "", 0.5, {"%": 1e-2}),
    "contact_time": _Size(1e-6, 0.1, "s", 5e-3, _TIMES),
    **dict(_noises()),
    "camera.scale": _Size(0.2, 5.0, "", 1.0, {"%": 1e-2}),
    "camera.clock": _Size(0.2, 5.0, "", 1.0, {"%": 1e-2}),
    "camera.tilt": _Size(-pi / 18.0, pi / 18.0, "rad", 5e-3, _ANGLES),
    "camera.court_height": _Size(-0.2, 0.2, "m", 3e-3, _LENGTHS),
    "camera.fps": _Size(1.0, 1e7, "frames/s", 1e3, {"1/ms": 1e3}),
    "camera.mm_per_px": _Size(1e-4, 1e3, "mm", 1.0, {"um": 1e-3, "m": 1e3}),
    "camera.court": _Size(-100.0, 100.0, "m", 1.0, _LENGTHS),
    "camera.fold": _Size(1, 100),
    "camera.lasting": _Size(0.0, 0.1, "m", 1e-3, _LENGTHS),
    "camera.row_time": _Size(1e-10, 0.01, "s", 1e-5, _TIMES),
    "flight.drag": _Size(0.01, 3.0),
    "flight.lift": _Size(-2.0, 2.0),
    "flight.spin_sd": _Size(0.1, 1e4, "rad/s", 250.0, _SPINS),
    "air.density": _Size(0.3, 2.0, "kg/m^3", 1.2, {"g/cm^3": 1e3}),
    "air.temperature": _Size(-40.0, 60.0, "degrees Celsius"),
    "air.pressure": _Size(3e4, 1.2e5, "Pa", 1e5, {"hPa": 1e2, "kPa": 1e3, "bar": 1e5}),
}
_LISTS = ("measurement.ignore", "measurement.flip")
_TEXTS = ("surface.name", "surface.court", "model.name")
_CHOICES: Mapping[str, Sequence[str]] = {
    "ball.type": [*BALL_TYPES],
    "measurement.noise": ["normal", "student-t"],
    "camera.y": ["up", "down"],
    "camera.angles": ["counterclockwise", "clockwise"],
}
# Sections that take any name: for texts, and `fix` for numbers.
_FREE = ("prior", "fix", "pool", "columns", "laboratory", "source")
_SAME = (
    ("ball.inertia", "ball.inertia_ratio"),
    ("air.density", "air.temperature"),
    ("air.density", "air.pressure"),
    *((key, key.replace(".", ".nominal_")) for key in _SIZES if key.startswith("measurement.")),
)
# Density [kg/m^3]: no matter is denser than osmium, and what is lighter than air does not come down.
_LIGHTEST, _DENSEST = 1.2, 22_600.0


def load_scene(table: Path | None, given: str | Path | None = None) -> Scene:
    """The scene in `given`, else beside the table, else all defaults. Raises InputError (`scene`)."""
    place = Path(given) if given else None if table is None else table.with_suffix(".toml")
    if place is None or not (given or os.path.lexists(place)):
        return Scene()
    try:
        tree = tomllib.loads(place.read_bytes().decode("utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        words = one_line(str(getattr(error, "strerror", "") or error))
        raise InputError(str(place), [Fault("scene", f"expected a scene file (TOML in UTF-8): {words}")]) from None
    laboratory = tree.get("laboratory")
    if isinstance(laboratory, dict):
        tree["laboratory"] = {name: str(one) if isinstance(one, date) else one for name, one in laboratory.items()}
    try:
        _check(tree)
        return msgspec.convert(tree, Scene)
    except InputError as error:
        raise InputError(str(place), error.faults) from None
    except msgspec.ValidationError as error:
        # What is left: a whole number, and numbers that have no sd.
        what, _, where = str(error).partition(" - at `$.")
        raise InputError(str(place), [Fault("scene", what, column=where.rstrip("`") or None)]) from None


def _fail(key: str, message: str) -> NoReturn:
    raise InputError("scene", [Fault("scene", message, column=key)])


def _number(quantity: float | Quantity | None, assumed: float) -> float:
    return quantity.value if isinstance(quantity, Quantity) else assumed if quantity is None else quantity


def _check(tree: Mapping[str, Any]) -> None:
    """The first fault of a scene that says most: a number in a wrong unit before a misspelled key."""
    leaves = []
    for section, part in tree.items():
        if section == "contact_time" or not isinstance(part, dict):
            leaves.append((section, part))
        else:
            leaves += [(f"{section}.{name}", item) for name, item in part.items()]
    for key, item in leaves:
        if key in _SIZES or key.startswith("fix."):
            _check_size(key, item)
    for key, item in leaves:
        _check_key(key, item)
    for one, other in _SAME:
        if {one, other} <= dict(leaves).keys():
            _fail(one, f"given beside {other}, which says the same; keep one of them")


def _check_size(key: str, item: object) -> None:
    """A number and its sd against their limits; what is no number is left to `_check_key`."""
    value, sd = (item.get("value"), item.get("sd")) if isinstance(item, dict) else (item, None)
    if not _is_number(value):
        return
    if not -1e300 <= value <= 1e300:
        _fail(key, f"read {one_line(repr(value))}; expected a finite number")
    size = _SIZES.get(key, _Size(-1e300, 1e300))
    if not size.low <= value <= size.high:
        wanted = f"expected {size.low:g} to {size.high:g} {size.unit}".strip()
        _fail(key, f"read {value:g}; {wanted}{_meant(value, size, size.high)}")
    most = size.high if size.low < 0.0 or key == "surface.mu" else value
    if _is_number(sd) and not (1e-9 * abs(value) <= sd <= most and sd > 0.0):
        # Quantities about zero are as large as their sds.
        typical = size.typical if size.low < 0.0 else 0.02 * size.typical
        hint = _meant(sd, size._replace(low=0.0, typical=typical), 0.2 * most) if sd > most else ""
        _fail(key, f"read sd = {sd:g}; expected above 0, at most {most:g}, in the unit of the value{hint}")


def _check_key(key: str, item: object) -> None:
    """Whether there is such a key, and whether it holds such a thing."""
    section, _, name = key.partition(".")
    if section not in Scene.__struct_fields__:
        _fail(section, f"unknown key; {suggestion(section, Scene.__struct_fields__)}")
    known = [known for known in (*_SIZES, *_LISTS, *_TEXTS, *_CHOICES) if known.partition(".")[0] == section]
    if name and section not in _FREE and key not in known:
        _fail(key, f"unknown key; {suggestion(name, [one.partition('.')[2] for one in known])}")
    if key in _SIZES or (section == "fix" and name):
        whole = not isinstance(item, dict) or item.keys() == {"value", "sd"}
        good = whole and all(map(_is_number, item.values() if isinstance(item, dict) else [item]))
        wanted = "a number, or { value = ..., sd = ... }"
    elif key in _LISTS:
        good = isinstance(item, list | tuple) and all(isinstance(one, str) for one in item)
        wanted = 'a list of columns, such as ["omega_2"]'
    else:
        good, wanted = isinstance(item, str) and bool(name), "a text" if name else f"a section [{section}]"
    if not good:
        _fail(key, f"read {one_line(repr(item))}; expected {wanted}")
    if key in _CHOICES and item not in _CHOICES[key]:
        _fail(key, f"read {one_line(str(item))}; {suggestion(str(item), _CHOICES[key])}")


def _is_number(item: object) -> TypeGuard[float]:
    return isinstance(item, int | float) and not isinstance(item, bool)


def _meant(value: float, size: _Size, most: float) -> str:
    """A question, where another unit makes the value possible."""
    fitting = {unit: factor for unit, factor in size.units.items() if size.low <= value * factor <= most}
    if not fitting:
        return ""
    unit = min(fitting, key=lambda one: abs(log(abs(value) * fitting[one] / size.typical)))
    return f"; did you mean {value:g} {unit} ({value * fitting[unit]:.4g})?"


def _check_ball(ball: BallSection) -> None:
    """Mass, size and inertia belong together: often one of them was left out, or is in another unit."""
    mass, radius = (_number(getattr(ball, name), getattr(Ball(), name)) for name in ("mass", "radius"))
    density, square = mass / (4.0 / 3.0 * pi * radius**3), mass * radius**2
    if not _LIGHTEST <= density <= _DENSEST:
        than = "denser than any metal" if density > _DENSEST else "lighter than air"
        # Hollow balls have some 300 kg/m^3.
        size = _SIZES["ball.mass"]._replace(typical=300.0 * mass / density)
        hint = _meant(mass, size, _DENSEST * mass / density) if density > _DENSEST else ""
        _fail("ball.mass", f"read {mass:g} kg for a ball of radius {radius:g} m, {than}; state both, in SI{hint}")
    inertia = _number(ball.inertia, 0.5 * square)
    if not 0.01 <= inertia / square <= 1.0:
        size = _SIZES["ball.inertia"]._replace(low=0.2 * square, typical=0.5 * square)
        wanted = f"expected {0.01 * square:.3g} to {square:.3g} kg m^2 (M R^2)"
        _fail("ball.inertia", f"read {inertia:g}; {wanted}{_meant(inertia, size, square)}")
