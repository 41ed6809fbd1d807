"""Scenes: what is stated besides the measurements. The type is the file, the value and a part of
fit.json.

Sections `prior`, `fix`, `pool`, `columns` are the options of the same names, which override them.
"""

import os
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from math import pi
from pathlib import Path
from typing import Literal, NamedTuple, TypeGuard

import msgspec

from fitball.base.air import SLOW_DRAG, Coefficient
from fitball.base.columns import COLUMNS
from fitball.base.errors import Fault, InputError, Note, suggestion
from fitball.base.itf import BALL_TYPES, USUAL_TYPE, usual_radius
from fitball.base.text import listed, one_line
from fitball.base.values import Ball

# Inertia over M R^2 of a tennis ball of which nothing is stated: between what the bifilar test of
# Jafri (2004, Table 8) gives with its lever of 1.25 in, 0.5625, and with the radius, 0.520.
INERTIA_RATIO = 0.54


class SceneSection(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A section of a scene file; an unknown key is a fault."""


class ValueWithSd(SceneSection, frozen=True):
    """A number with its sd, which is fitted with this prior; a plain number is held."""

    value: float
    sd: float


class BallSection(SceneSection, frozen=True):
    """The ball: kg, m, I/(M R^2) or I [kg m^2] (`inertia`, not both), degrees Celsius, ITF type.
    What is None is assumed: `Scene.ball_value` and `Scene.ball_sd` have the numbers.
    """

    mass: float | ValueWithSd | None = None
    radius: float | ValueWithSd | None = None
    inertia_ratio: float | ValueWithSd | None = None
    inertia: float | ValueWithSd | None = None
    temperature: float | None = None
    type: str | None = None


class CameraSection(SceneSection, frozen=True):
    """What the impacts of a camera share. Of fits: `scale`, `clock` (true over measured), `tilt`
    [rad], `court_height` [m], `row_delay` [s/m], by which a lower row is read later than was taken.
    Of films: rate, scale, directions, `court` [m], `fold` of marks, and `lasting` [m], errors that
    last over frames, `row_time` [s/px] of a rolling shutter, whose sd makes that of `row_delay`,
    `min_confidence` of frames that are used.
    """

    scale: float | ValueWithSd | None = None
    clock: float | ValueWithSd | None = None
    tilt: float | ValueWithSd | None = None
    court_height: float | ValueWithSd | None = None
    row_delay: float | ValueWithSd | None = None
    fps: float | None = None
    mm_per_px: float | None = None
    y: Literal["up", "down"] = "up"
    angles: Literal["counterclockwise", "clockwise"] = "counterclockwise"
    court: float | ValueWithSd | None = None
    fold: int = 1
    lasting: float = 0.0
    row_time: float | ValueWithSd | None = None
    min_confidence: float | None = None


class Scene(SceneSection, frozen=True):
    """What is stated of ball, court and instruments, in SI. Every section may be left out.

    `surface` has name, court, mu. `measurement` has for each noise parameter NAME (held) or
    nominal_NAME (median of its prior), and `noise`, `ignore`, `flip`. `flight` has drag, lift and
    spin_sd of a film, `air` its density, temperature and pressure. `model` is a name as `--model`
    takes it, but no file to run. `laboratory` and `source` are texts for reports.

    Example:
        >>> import fitball
        >>> scene = fitball.Scene(surface={"name": "clay"}, fix={"mu": 0.6})
        >>> scene.surface["name"]
        'clay'

    Raises:
        InputError: A key has a value that no ball, court or instrument has (`scene`).
    """

    ball: BallSection = BallSection()
    surface: dict[str, str | float | ValueWithSd] = {}
    contact_time: ValueWithSd | None = None
    measurement: dict[str, float | str | tuple[str, ...]] = {}
    camera: CameraSection | None = None
    flight: dict[str, float | ValueWithSd] = {}
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
        _refuse(_faults(tree))
        # In Python a section, or a value with its sd, may be given as a dict.
        try:
            for field in msgspec.structs.fields(self):
                if field.name in tree:
                    value = msgspec.convert(tree[field.name], field.type)
                    msgspec.structs.force_setattr(self, field.name, value)
        except msgspec.ValidationError as error:
            _refuse([_fault_of_type(field.name, error)])
        _refuse(_faults_of(self.ball))

    def ball_value(self) -> Ball:
        """The ball at its stated values, those of a tennis ball where nothing is stated.

        Example:
            >>> import fitball
            >>> fitball.Scene().ball_value()
            Ball(mass=0.0576, radius=0.03302, inertia_ratio=0.54)
        """
        usual = Ball()
        ball = self.ball
        mass = _number(ball.mass, usual.mass)
        radius = _number(ball.radius, usual_radius(self.ball_type()))
        if ball.inertia is not None:
            return Ball(mass, radius, _number(ball.inertia, 0.0) / (mass * radius**2))
        return Ball(mass, radius, _number(ball.inertia_ratio, INERTIA_RATIO))

    def ball_type(self) -> str:
        """The type of the ball by the rules of the ITF, the usual one where none is stated.

        Example:
            >>> import fitball
            >>> fitball.Scene().ball_type()
            'type-2'
        """
        return self.ball.type or USUAL_TYPE

    def ball_sd(self) -> dict[str, float]:
        """Stated sds of mass [kg], radius [m] and inertia_ratio, by name. The sd of an inertia is
        one of the ratio at the stated mass and radius.

        Example:
            >>> import fitball
            >>> fitball.Scene().ball_sd()
            {}
        """
        sds = {}
        for name in ("mass", "radius", "inertia_ratio"):
            stated = getattr(self.ball, name)
            if isinstance(stated, ValueWithSd):
                sds[name] = stated.sd
        if isinstance(self.ball.inertia, ValueWithSd):
            ball = self.ball_value()
            sds["inertia_ratio"] = self.ball.inertia.sd / (ball.mass * ball.radius**2)
        return sds

    def slow_drag(self) -> Coefficient:
        """The drag coefficient of falls and rises below 15 m/s: as stated in [flight], without an
        sd where the scene states none; else that of a ball of which nothing was measured.

        Example:
            >>> import fitball
            >>> fitball.Scene(flight={"drag": 0.55}).slow_drag().value
            0.55
        """
        stated = self.flight.get("drag")
        if isinstance(stated, ValueWithSd):
            return Coefficient(stated.value, stated.sd)
        return SLOW_DRAG if stated is None else Coefficient(stated, 0.0)

    def assumed(self) -> tuple[Note, ...]:
        """Notes on what is assumed because nothing is stated.

        Example:
            >>> import fitball
            >>> [note.code for note in fitball.Scene(surface={"mu": 0.6}).assumed()]
            ['assumed-ball', 'no-contact-time', 'no-velocity-noise', 'no-spin-noise']
        """
        return tuple(Note(code, f"Assumed: {text}.") for code, text in self._unstated())

    def _unstated(self) -> Iterator[tuple[str, str]]:
        """Codes of what is not stated, and what is assumed for it."""
        ball = self.ball
        constants = {
            "mass": ball.mass,
            "radius": ball.radius,
            "inertia": ball.inertia or ball.inertia_ratio,
        }
        unstated = [name for name, stated in constants.items() if stated is None]
        if unstated:
            usual = Scene(ball=BallSection(type=ball.type)).ball_value()
            size = f"{1e3 * usual.mass:g} g, {1e3 * usual.radius:g} mm"
            tennis = f"of a tennis ball ({size}, I/(M R^2) = {usual.inertia_ratio:g})"
            yield "assumed-ball", f"the {listed(unstated)} {tennis}"
        if "mu" not in self.surface:
            yield "no-friction", "nothing of the friction: mu has a wide prior"
        if self.contact_time is None:
            yield "no-contact-time", "nothing of the contact time: k_y depends on its prior"
        fitted = "it is fitted with a default prior"
        noise = {name.removeprefix("nominal_") for name in self.measurement}
        if noise.isdisjoint(_VELOCITY_NOISES):
            yield "no-velocity-noise", f"nothing of the noise of velocities: {fitted}"
        if "spin_sd" not in noise:
            yield "no-spin-noise", f"nothing of the noise of spins: {fitted}"


class _Range(NamedTuple):
    """What a key takes: a number, or a value with its sd, from `low` to `high` in `unit`."""

    low: float
    high: float
    unit: str = ""


# Noise parameters; one sd may hold for both components of the velocity.
_NOISES = {noise.name: noise for column in COLUMNS.values() if (noise := column.noise) is not None}
_NOISES |= {"velocity_sd": _NOISES["v_x_sd"]}
# Any of these says something of the noise of velocities.
_VELOCITY_NOISES = ("velocity_sd", "v_x_sd", "v_y_sd", "speed_sd")
# Temperatures at which people play and measure.
_CELSIUS = _Range(-40.0, 80.0, "degrees Celsius")
# True lengths or times over measured ones.
_FACTOR = _Range(0.2, 5.0)
# Any text: there is no list to choose from.
_TEXT = ()
# What keys take: numbers from a grain of shot to the largest ball that people throw, and from the
# best instruments to useless ones; a text of a list; lists of columns. A section with `*` has keys
# of any name.
_KEYS: Mapping[str, _Range | tuple[str, ...] | type] = {
    "ball.mass": _Range(1e-6, 20.0, "kg"),
    "ball.radius": _Range(1e-4, 0.5, "m"),
    "ball.inertia_ratio": _Range(0.01, 1.0),
    "ball.inertia": _Range(1e-14, 5.0, "kg m^2"),
    "ball.temperature": _CELSIUS,
    "ball.type": (*BALL_TYPES,),
    "surface.name": _TEXT,
    "surface.court": _TEXT,
    "surface.mu": _Range(1e-6, 100.0),
    "contact_time": _Range(1e-6, 0.1, "s"),
    **{
        f"measurement.{nominal}{name}": _Range(noise.lower, noise.upper, noise.unit)
        for name, noise in _NOISES.items()
        for nominal in ("", "nominal_")
    },
    "measurement.noise": ("normal", "student-t"),
    "measurement.ignore": list,
    "measurement.flip": list,
    "camera.scale": _FACTOR,
    "camera.clock": _FACTOR,
    "camera.tilt": _Range(-pi / 18.0, pi / 18.0, "rad"),
    "camera.court_height": _Range(-0.2, 0.2, "m"),
    "camera.row_delay": _Range(-0.03, 0.03, "s/m"),
    "camera.fps": _Range(1.0, 1e7, "frames/s"),
    "camera.mm_per_px": _Range(1e-4, 1e3, "mm"),
    "camera.court": _Range(-100.0, 100.0, "m"),
    "camera.y": ("up", "down"),
    "camera.angles": ("counterclockwise", "clockwise"),
    "camera.fold": _Range(1, 100),
    "camera.lasting": _Range(0.0, 0.1, "m"),
    # Negative where the lowest row is read first.
    "camera.row_time": _Range(-0.01, 0.01, "s"),
    "camera.min_confidence": _Range(0.0, 1.0),
    "flight.drag": _Range(0.01, 3.0),
    "flight.lift": _Range(-2.0, 2.0),
    "flight.spin_sd": _Range(0.1, 1e4, "rad/s"),
    "air.density": _Range(0.3, 2.0, "kg/m^3"),
    "air.temperature": _CELSIUS,
    "air.pressure": _Range(3e4, 1.2e5, "Pa"),
    "model.name": _TEXT,
    "prior.*": _TEXT,
    "fix.*": _Range(-1e300, 1e300),
    "pool.*": _TEXT,
    "columns.*": _TEXT,
    "laboratory.*": _TEXT,
    "source.*": _TEXT,
}
# Units that people write numbers in where SI is expected, by the SI unit, with their factors.
_UNITS_MEANT = {
    "kg": {"g": 1e-3},
    "m": {"mm": 1e-3, "cm": 1e-2},
    "s": {"ms": 1e-3},
    "kg m^2": {"g cm^2": 1e-7},
    "m/s": {"cm/s": 1e-2},
    "rad": {"deg": pi / 180.0},
    "rad/s": {"rpm": pi / 30.0},
    "Pa": {"hPa": 1e2},
}
# Most bytes of a scene file: some files, such as devices, never end.
_MOST_BYTES = 1_000_000
# Two keys of one quantity, beside NAME and nominal_NAME.
_SAME_QUANTITY = {"inertia": "inertia_ratio"}
# Least density [kg/m^3]: what is lighter than air does not come down.
_LIGHTEST = 1.2
# Largest density [kg/m^3]: no matter is denser than osmium.
_DENSEST = 22_600.0
# Least inertia over M R^2: with all mass at the centre it would be zero.
_LEAST_RATIO = 0.01
# Least sd over its value: no instrument is better.
_LEAST_SD = 1e-9


def load_scene(table: str | Path | None, given: str | Path | None = None) -> Scene:
    """The scene in the file `given`, else in the .toml file beside the `table`; all defaults where
    there is none. A `table` that ends in .toml is the scene itself.

    Example:
        >>> import fitball
        >>> fitball.load_scene(None) == fitball.Scene()
        True

    Raises:
        InputError: The file cannot be read, or has faults, all of which are listed (`scene`).
    """
    path = _path_of_scene(table, given)
    if path is None:
        return Scene()
    try:
        text = _content(path).decode("utf-8-sig")
        # Dates become texts.
        tree = msgspec.to_builtins(tomllib.loads(text))
        _refuse(_faults(tree))
        return msgspec.convert(tree, Scene)
    except InputError as error:
        faults = error.faults
    except msgspec.ValidationError as error:
        faults = (_fault_of_type("", error),)
    except (OSError, ValueError, RecursionError) as error:
        words = one_line(str(getattr(error, "strerror", "") or error))
        message = f"cannot be read: {words}; expected a scene file (TOML in UTF-8)"
        faults = (Fault("scene", message),)
    raise InputError(str(path), faults)


def _path_of_scene(table: str | Path | None, scene: str | Path | None) -> Path | None:
    """The file of a scene; None where no file is named and none is beside the table."""
    if scene:
        return Path(scene)
    if table is None:
        return None
    if table and Path(table).suffix == ".toml":
        return Path(table)
    beside = Path(table).with_suffix(".toml")
    return beside if os.path.lexists(beside) else None


def _content(path: Path) -> bytes:
    """The bytes of a file. Raises ValueError where they are too many."""
    with path.open("rb") as file:
        content = file.read(_MOST_BYTES + 1)
    if len(content) > _MOST_BYTES:
        raise ValueError(f"more than {_MOST_BYTES:,} bytes")
    return content


def _fault(key: str, message: str) -> Fault:
    """A fault of the value of a key."""
    return Fault("scene", message, column=key)


def _fault_of_type(section: str, error: msgspec.ValidationError) -> Fault:
    """The fault of a value in a `section`, or in a whole scene, that `_faults` passes: a fraction
    where a whole number is expected, an sd of a number that takes none, none where there must be
    one.
    """
    message = str(error).replace("object", "{ value = ..., sd = ... }")
    what, _, where = message.partition(" - at `$")
    return _fault(f"{section}{where.rstrip('`')}".lstrip("."), what)


def _refuse(faults: Iterable[Fault]) -> None:
    """Raise InputError (`scene`) if there are faults."""
    every = tuple(faults)
    if every:
        raise InputError("scene", every)


def _number(quantity: float | ValueWithSd | None, usual: float) -> float:
    """The value of a quantity, with or without an sd, or the usual one where none is stated."""
    if quantity is None:
        return usual
    return quantity.value if isinstance(quantity, ValueWithSd) else quantity


def _faults(tree: Mapping[str, object]) -> Iterator[Fault]:
    """Faults of a scene: keys that do not exist, values that a key does not take, two keys of one
    quantity.
    """
    for section, content in tree.items():
        # The contact time is a key without a section.
        values = {"": content} if section == "contact_time" else content
        if section not in Scene.__struct_fields__:
            yield _fault(section, f"unknown key; {suggestion(section, Scene.__struct_fields__)}")
            continue
        if not isinstance(values, dict):
            read = one_line(repr(content))
            yield _fault(section, f"read {read}; expected a section [{section}]")
            continue
        for name, value in values.items():
            key = f"{section}.{name}".rstrip(".")
            other = _SAME_QUANTITY.get(name, f"nominal_{name}")
            words = _wrong(key, value)
            if words:
                yield _fault(key, words)
            elif other in values:
                words = f"given beside {other}, which says the same; keep one of them"
                yield _fault(key, words)


def _wrong(key: str, value: object) -> str:
    """What is wrong with the value of a key, in words; empty if nothing is."""
    section, _, name = key.partition(".")
    takes = _KEYS.get(key, _KEYS.get(f"{section}.*"))
    read = f"read {one_line(repr(value))}"
    if takes is None:
        prefix = f"{section}."
        names = [key.removeprefix(prefix) for key in _KEYS if key.startswith(prefix)]
        return f"unknown key; {suggestion(name, names)}"
    if isinstance(takes, _Range):
        return _wrong_number(value, takes)
    if isinstance(takes, type):
        if isinstance(value, list | tuple) and all(isinstance(text, str) for text in value):
            return ""
        return f'{read}; expected a list of columns, such as ["omega_2"]'
    if not isinstance(value, str):
        return f"{read}; expected a text"
    if takes and value not in takes:
        return f"{read}; {suggestion(value, takes)}"
    return ""


def _wrong_number(stated: object, takes: _Range) -> str:
    """What is wrong with a number, or a value and its sd, in words; empty if nothing is. The sd of
    a positive number is at most the number.
    """
    value = stated
    sd: object = 1.0
    has_sd = isinstance(stated, dict) and stated.keys() == {"value", "sd"}
    if isinstance(stated, dict) and has_sd:
        value = stated["value"]
        sd = stated["sd"]
    if not _is_number(value) or not _is_number(sd):
        return f"read {one_line(repr(stated))}; expected a number, or {{ value = ..., sd = ... }}"
    if not takes.low <= value <= takes.high:
        expected = f"{takes.low:g} to {takes.high:g} {takes.unit}".rstrip()
        return f"read {one_line(repr(value))}; expected {expected}{_question(value, takes)}"
    most = takes.high if takes.low < 0.0 else value
    if has_sd and not (sd > 0.0 and _LEAST_SD * abs(value) <= sd <= most):
        hint = _question(sd, _Range(0.0, most, takes.unit)) if sd > most else ""
        expected = f"above 0, at most {most:g}, in the unit of the value"
        return f"read sd = {sd:g}; expected {expected}{hint}"
    return ""


def _is_number(value: object) -> TypeGuard[float]:
    """Whether this is a number, which true and false are not."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def _question(value: float, takes: _Range) -> str:
    """The question whether another unit is meant; empty where none makes the value possible."""
    possible = []
    for unit, factor in _UNITS_MEANT.get(takes.unit, {}).items():
        if takes.low / factor <= value <= takes.high / factor:
            possible.append(f"{value:g} {unit}")
    return f"; did you mean {listed(possible, 'or')}?" if possible else ""


def _faults_of(ball: BallSection) -> Iterator[Fault]:
    """Faults of mass, size and inertia that do not belong together: often one of them was left out,
    or is in another unit.
    """
    usual = Ball()
    mass = _number(ball.mass, usual.mass)
    radius = _number(ball.radius, usual.radius)
    volume = 4.0 / 3.0 * pi * radius**3
    if not _LIGHTEST <= mass / volume <= _DENSEST:
        than = "denser than any metal" if mass > _DENSEST * volume else "lighter than air"
        hint = _question(mass, _Range(_LIGHTEST * volume, _DENSEST * volume, "kg"))
        read = f"read {mass:g} kg for a ball of radius {radius:g} m"
        yield _fault("ball.mass", f"{read}, {than}; state both{hint}")
    square = mass * radius**2
    possible = _Range(_LEAST_RATIO * square, square, "kg m^2")
    words = _wrong_number(_number(ball.inertia, square), possible)
    if words:
        yield _fault("ball.inertia", f"{words} (at most M R^2)")
