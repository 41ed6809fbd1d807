"""Scenes: what is known besides the numbers; the type is the file, the value, a part of fit.json. Imports: itf, base.

Sections `prior`, `fix`, `pool`, `columns` are the options of the same names, which override them.
"""

import os
import tomllib
from collections.abc import Iterator, Mapping
from datetime import date
from math import log, pi
from pathlib import Path
from typing import Any, Literal, NamedTuple, NoReturn, TypeGuard

import msgspec

from fitball.columns import COLUMNS
from fitball.errors import Fault, InputError, Note, suggestion
from fitball.itf import BALL_TYPES
from fitball.text import one_line
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
    parameter NAME (held) or nominal_NAME (median of its prior), `noise`, `ignore`; `flight` drag, lift, spin_sd and
    `air` of a film; `model` a name as `--model` takes it; `laboratory` and `source` texts for reports. Raises
    InputError (`scene`) for what no ball, court or instrument has.
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
        tree = msgspec.to_builtins(self)
        _check_sizes(tree)
        _check_keys(tree)
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
        ball, noise, tennis = self.ball, self.measurement.keys(), Ball()
        mass = f"the ball has a mass of {1e3 * tennis.mass:g} g (the ITF allows 56.0 to 59.4 g)"
        radius = f"the ball has a radius of {1e3 * tennis.radius:g} mm (the ITF allows 32.7 to 34.3 mm)"
        inertia = f"I/(M R^2) = {tennis.inertia_ratio:g}, as of tennis balls"
        prior = "it is fitted with a default prior"
        silent = (
            ("assumed-mass", mass, ball.mass is None),
            ("assumed-radius", radius, ball.radius is None),
            ("assumed-inertia", inertia, ball.inertia is None and ball.inertia_ratio is None),
            ("no-friction", "mu has a wide prior", "mu" not in self.surface),
            ("no-contact-time", "no contact time: k_y depends on its prior", self.contact_time is None),
            ("no-velocity-noise", f"no noise of velocities: {prior}", not _VELOCITY_NOISES & noise),
            ("no-spin-noise", f"no noise of spins: {prior}", not {"spin_sd", "nominal_spin_sd"} & noise),
        )
        return tuple(Note(code, f"Assumed: {text}.") for code, text, is_so in silent if is_so)


# States of the noise of velocities, each of which says something of it.
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
# Keys with texts in sections whose other keys are numbers.
_TEXTS = {"surface": ("name", "court"), "measurement": ("noise", "ignore"), "model": ("name",)}
# Density [kg/m^3]: no matter is denser than osmium, and what is lighter than air does not come down.
_LIGHTEST, _DENSEST = 1.2, 22_600.0


def load_scene(table: Path | None, given: str | Path | None = None) -> Scene:
    """The scene in `given`, else beside the table, else all defaults. Raises InputError (`scene`)."""
    place = Path(given) if given else None if table is None else table.with_suffix(".toml")
    if place is None or not (given or os.path.lexists(place)):
        return Scene()
    try:
        tree = tomllib.loads(place.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        fault = Fault("scene", f"cannot be opened: {error.strerror}; expected a scene file (TOML)")
        raise InputError(str(place), [fault]) from None
    except (ValueError, RecursionError) as error:
        fault = Fault("scene", f"not TOML in UTF-8: {one_line(str(error))}; correct that place")
        raise InputError(str(place), [fault]) from None
    try:
        # A number in a wrong unit before a misspelled key, which says less.
        _check_sizes(tree)
        days = {name: str(item) if isinstance(item, date) else item for name, item in _part(tree, "laboratory")}
        return msgspec.convert(tree | ({"laboratory": days} if days else {}), Scene)
    except InputError as error:
        raise InputError(str(place), error.faults) from None
    except msgspec.ValidationError as error:
        raise InputError(str(place), [_in_words(str(error), tree)]) from None


def _fail(key: str, message: str) -> NoReturn:
    raise InputError("scene", [Fault("scene", message, column=key)])


def _number(quantity: float | Quantity | None, assumed: float) -> float:
    return quantity.value if isinstance(quantity, Quantity) else assumed if quantity is None else quantity


def _part(tree: Mapping[str, Any], section: str) -> list[tuple[str, Any]]:
    """Names and values of a section, none where it is none."""
    part = tree.get(section, {})
    return list(part.items()) if isinstance(part, dict) else []


def _check_sizes(tree: Mapping[str, Any]) -> None:
    """Numbers and their sds against their limits; what is no number is left to the types."""
    whole = [("contact_time", tree.get("contact_time"))]
    for key, item in (*whole, *((f"{part}.{name}", one) for part in tree for name, one in _part(tree, part))):
        value, sd = (item.get("value"), item.get("sd")) if isinstance(item, dict) else (item, None)
        if not _is_number(value):
            continue
        if not -1e300 <= value <= 1e300:
            _fail(key, f"read {one_line(repr(value))}; expected a finite number")
        if key not in _SIZES:
            continue
        size = _SIZES[key]
        if not size.low <= value <= size.high:
            wanted = f"expected {size.low:g} to {size.high:g} {size.unit}".strip()
            _fail(key, f"read {value:g}; {wanted}{_meant(value, size, size.high)}")
        most = size.high if size.low < 0.0 or key == "surface.mu" else value
        if _is_number(sd) and not (1e-9 * abs(value) <= sd <= most and sd > 0.0):
            # Quantities about zero are as large as their sds.
            typical = size.typical if size.low < 0.0 else 0.02 * size.typical
            hint = _meant(sd, size._replace(low=0.0, typical=typical), 0.2 * most) if sd > most else ""
            _fail(key, f"read sd = {sd:g}; expected above 0, at most {most:g}, in the unit of the value{hint}")


def _is_number(item: object) -> TypeGuard[float]:
    return isinstance(item, int | float) and not isinstance(item, bool)


def _meant(value: float, size: _Size, most: float) -> str:
    """A question, where another unit makes the value possible."""
    fitting = {unit: factor for unit, factor in size.units.items() if size.low <= value * factor <= most}
    if not fitting:
        return ""
    unit = min(fitting, key=lambda one: abs(log(abs(value) * fitting[one] / size.typical)))
    return f"; did you mean {value:g} {unit} ({value * fitting[unit]:.4g})?"


def _check_keys(tree: Mapping[str, Any]) -> None:
    """Keys of sections that are mappings, what is in them, and pairs that say one thing twice."""
    for section in ("surface", "measurement", "flight", "air", "model"):
        numbers = [key.partition(".")[2] for key in _SIZES if key.startswith(f"{section}.")]
        known = [*_TEXTS.get(section, ()), *numbers]
        for name, item in _part(tree, section):
            if name not in known:
                _fail(f"{section}.{name}", f"unknown key; {suggestion(name, known)}")
            wanted = "a number" if name in numbers else "a list of columns" if name == "ignore" else "a text"
            kind = (
                "a text" if isinstance(item, str) else "a list of columns" if isinstance(item, tuple) else "a number"
            )
            if wanted != kind:
                _fail(f"{section}.{name}", f"read {one_line(repr(item))}; expected {wanted}")
    noise, kind = tree.get("measurement", {}), tree.get("ball", {}).get("type", "type-2")
    if noise.get("noise", "normal") not in ("normal", "student-t"):
        _fail("measurement.noise", f"read {one_line(noise['noise'])}; expected normal or student-t")
    if kind not in BALL_TYPES:
        _fail("ball.type", f"read {one_line(kind)}; {suggestion(kind, BALL_TYPES)}")
    pairs = [("ball", "inertia", "inertia_ratio"), ("air", "density", "temperature"), ("air", "density", "pressure")]
    for section, one, other in (*pairs, *(("measurement", name, f"nominal_{name}") for name in noise)):
        if {one, other} <= tree.get(section, {}).keys():
            _fail(f"{section}.{one}", f"given beside {section}.{other}, which says the same; keep one of them")


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


_KINDS = {"str": "a text", "float": "a number", "int": "a whole number", "array": "a list", "object": "a section"}


def _in_words(error: str, tree: Mapping[str, Any]) -> Fault:
    """What msgspec says, with the key and the nearest name."""
    what, _, where = error.partition(" - at `$")
    section, _, key = where.partition("[")[0].strip("`.").partition(".")
    if "[" in where:
        # The entries of a mapping have no names there.
        key = next(name for name, item in _part(tree, section) if not _fits({section: {name: item}}))
    path = ".".join(filter(None, (section, key)))
    parts: dict[str, type[Section]] = {"": Scene, "ball": BallSection, "camera": CameraSection}
    if "unknown field" in what and path in parts:
        name, known = what.split("`")[1], [item.name for item in msgspec.structs.fields(parts[path])]
        return Fault("scene", f"unknown key; {suggestion(name, known)}", column=".".join(filter(None, (path, name))))
    read = dict(_part(tree, section)).get(key) if key else tree.get(section)
    kinds = what.split("`")[1].split(" | ") if what.startswith("Expected") else []
    wanted = " or ".join(_KINDS[kind] for kind in kinds if kind in _KINDS)
    if "enum" in what:
        wanted = "up or down" if key == "y" else "counterclockwise or clockwise"
    elif not kinds or {"float", "object"} <= {*kinds}:
        wanted = "a number, or { value = ..., sd = ... }"
    return Fault("scene", f"read {one_line(repr(read))}; expected {wanted}", column=path)


def _fits(tree: Mapping[str, Any]) -> bool:
    try:
        msgspec.convert(tree, Scene)
    except msgspec.ValidationError:
        return False
    return True
