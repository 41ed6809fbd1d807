"""The scene of a table: ball, surface, noise, model; and what is assumed."""

from __future__ import annotations

import datetime
import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from fitball.data.bundled import resolve_table
from fitball.data.heights import BALL_TYPES, like_tennis
from fitball.data.scene_keys import (
    EXCLUSIVE,
    KINDS,
    PRIOR,
    SECTIONS,
    SIZES,
    Kind,
    density_fault,
    meant_inertia,
    range_fault,
    unlikely,
    unlikely_density,
)
from fitball.data.table import FrozenMapping
from fitball.errors import ParameterError, SceneError, fault_list, suggestion
from fitball.kinds import checked
from fitball.observables import NOISE_OF, SHARED_SD
from fitball.values import WANG_INERTIA_RATIO, WANG_MASS, WANG_RADIUS, Ball, FloatArray, quotient
from fitball.visible import folded, kind_of
from fitball.wording import option

# How an entry of a free section is written (None: a number), and in words.
_FREE = {
    Kind.TEXTS: (re.compile(r".*\S.*", re.DOTALL), "a text in quotes"),
    Kind.NUMBERS: (None, "a finite number"),
    Kind.PRIORS: (
        re.compile(PRIOR),
        'a word and numbers in brackets, such as "normal(0.55, 0.05)", or "literature:KEY"',
    ),
}
NOMINAL_VELOCITY_SD = 0.25
NOMINAL_SPIN_SD = 10.0
DEFAULT_MODEL = "two-mass"

# Assumptions where a scene has no value.
_NO_FILE = "no scene file: ball, court and measurement are not described"
_BALL_WORDS = {
    "mass": f"ball mass {1e3 * WANG_MASS:g} g (the ITF allows 56.0 to 59.4 g)",
    "radius": f"ball radius {1e3 * WANG_RADIUS:g} mm (the ITF allows 32.7 to 34.3 mm)",
    "inertia_ratio": f"I/(M R^2) = {WANG_INERTIA_RATIO:g}, the value of a tennis ball",
}
NO_MU = "no friction coefficient in the scene: mu has a wide prior"
NO_CONTACT_TIME = "no contact time in the scene: the stiffness k_y depends on its prior"
NO_VELOCITY_SD = f"no velocity noise in the scene: it is fitted, with a prior around {NOMINAL_VELOCITY_SD:g} m/s"
NO_SPIN_SD = f"no spin noise in the scene: it is fitted, with a prior around {NOMINAL_SPIN_SD:g} rad/s"


@dataclass(frozen=True)
class Quantity:
    """A number with its standard deviation, when one was stated; SI units."""

    value: float
    sd: float | None = None


@dataclass(frozen=True)
class Camera:
    """What a session of filming shares. `scale` and `clock` are true lengths and times over those in the table,
    factors about 1. `tilt` [rad] is the angle by which the court rises along the ball's travel, `court_height` [m]
    the height of the court above that which was taken for it. Of the others (frames/s, mm, s, and the height of the
    court in files of positions, m) a fit makes no use.
    """

    scale: Quantity | None = None
    clock: Quantity | None = None
    tilt: Quantity | None = None
    court_height: Quantity | None = None
    fps: float | None = None
    mm_per_px: float | None = None
    row_time: float | None = None
    court: float | None = None


def _said(key: str, default: object = None) -> Any:
    """The field of a key of the schema."""
    if isinstance(default, Mapping):
        return field(default_factory=FrozenMapping, metadata={"key": key})
    return field(default=default, metadata={"key": key})


@dataclass(frozen=True)
class Scene:
    """What is known about a table besides its numbers; SI units, sds are one standard deviation.

    Ball and court. `source` is the scene file (None: no file). `ball_sd` has some of the keys mass, radius and
    inertia_ratio. `ball_type` is a type of the ITF (see `heights`); `ball_temperature` and its sd are in degrees
    Celsius. `mu` is (value, sd or None), `contact_time` (value, sd), None when unknown.

    Noise. `velocity_sd` (of each component) and those in `observables.NOISE_OF` are known and not fitted; the nominal
    ones are orders of magnitude. With `velocity_noise` "tied" all velocity columns share one noise, with "separate"
    each has its own (None: "separate" if the table has enough rows). Where the table states sds these noises are the
    scatter beyond stated errors; with "stated" there is none. `distribution` is that of the noise. `offsets` is the
    label column whose groups may have a measurement bias. `ignore` are measured rebound columns that are left out.

    Model. `priors` are texts such as `normal(0.55, 0.05)` by parameter. `pool` maps parameters to the label column
    between whose groups they differ. `columns` maps fitball's names to those of the table.

    Force records. `force_file` is relative to the scene file. `force_sd` [N] is the known noise of a sample.
    `force_start_sd` [s] is the uncertainty of t = 0 as the start of contact (None: the start is found from the
    record). `camera` is what a session of filming shares. `assumed` are sentences on assumptions for missing values.

    Positions on film. `y_axis` is "up" or "down". `air_density` [kg/m^3], or `air_temperature` in degrees Celsius and
    `air_pressure` [Pa], `drag` and `lift` coefficients, and `incident_spin_sd` [rad/s] are used by no fit.

    Certificates carry `surface`, `court`, `laboratory`, `operator`, `instrument` and `date`, as they are written.
    """

    source: str | None = None
    ball: Ball = field(default_factory=Ball)
    ball_sd: Mapping[str, float] = field(default_factory=FrozenMapping)
    ball_type: str | None = _said("ball.type")
    ball_temperature: float | None = None
    ball_temperature_sd: float | None = None
    surface: str | None = _said("surface.name")
    court: str | None = _said("surface.court")
    mu: tuple[float, float | None] | None = None
    contact_time: tuple[float, float] | None = None
    velocity_sd: float | None = _said("measurement.velocity_sd")
    v_x_sd: float | None = _said("measurement.v_x_sd")
    v_y_sd: float | None = _said("measurement.v_y_sd")
    speed_sd: float | None = _said("measurement.speed_sd")
    angle_sd: float | None = _said("measurement.angle_sd")
    spin_sd: float | None = _said("measurement.spin_sd")
    contact_time_sd: float | None = _said("measurement.contact_time_sd")
    gap_time_sd: float | None = _said("measurement.gap_time_sd")
    gap_path_sd: float | None = _said("measurement.gap_path_sd")
    gap_turn_sd: float | None = _said("measurement.gap_turn_sd")
    nominal_velocity_sd: float = _said("measurement.nominal_velocity_sd", NOMINAL_VELOCITY_SD)
    nominal_spin_sd: float = _said("measurement.nominal_spin_sd", NOMINAL_SPIN_SD)
    velocity_noise: str | None = _said("measurement.velocity_noise")
    model: str = _said("model.name", DEFAULT_MODEL)
    closures: Mapping[str, str] = _said("model.closures", {})
    priors: Mapping[str, str] = _said("priors", {})
    fix: Mapping[str, float] = _said("fix", {})
    distribution: str = _said("measurement.distribution", "normal")
    pool: Mapping[str, str] = _said("pool", {})
    columns: Mapping[str, str] = _said("columns", {})
    offsets: str | None = _said("measurement.offsets")
    ignore: tuple[str, ...] = _said("measurement.ignore", ())
    force_file: str | None = _said("force.file")
    force_sd: float | None = _said("force.sd")
    force_start_sd: float | None = _said("force.start_sd")
    camera: Camera | None = None
    y_axis: str | None = _said("camera.y")
    air_density: float | None = _said("air.density")
    air_temperature: Quantity | None = None
    air_pressure: float | None = _said("air.pressure")
    drag: Quantity | None = None
    lift: Quantity | None = None
    incident_spin_sd: float | None = _said("flight.spin_sd")
    assumed: tuple[str, ...] = ()
    laboratory: str | None = _said("laboratory.name")
    operator: str | None = _said("laboratory.operator")
    instrument: str | None = _said("laboratory.instrument")
    date: str | None = _said("laboratory.date")
    description: str = _said("source.description", "")
    citation: str = _said("source.citation", "")

    @property
    def tennis(self) -> bool:
        """Whether its ball is a tennis ball, by what is stated or by mass and size: the ITF's tests are of these."""
        return self.ball_type is not None or like_tennis(self.ball)

    def noise_of(self, name: str, speed: FloatArray) -> FloatArray:
        """One sd (impacts,) of a rebound column without sds in the table, as known or else expected. For an angle it
        is that of a velocity across the flight at this `speed` [m/s]: NaN if that is unknown, infinite for a ball at
        rest.
        """
        velocity = self.nominal_velocity_sd if self.velocity_sd is None else self.velocity_sd
        own = getattr(self, NOISE_OF[name])
        if own is None and name == "theta_2":
            return quotient(velocity, np.abs(speed))
        expected = self.nominal_spin_sd if name == "omega_2" else velocity
        return np.full(len(speed), expected if own is None else own)

    @property
    def states_ball(self) -> bool:
        """Whether the radius of the ball was stated and not assumed."""
        return self.source is not None and not any(_BALL_WORDS["radius"] in sentence for sentence in self.assumed)


# The fields that take a key as it is; of the others something is made, see `_make_scene`.
_FIELDS: Mapping[str, str] = {item.metadata["key"]: item.name for item in fields(Scene) if item.metadata}


@checked
def load_scene(
    table_source: str | os.PathLike[str] | None, config: str | os.PathLike[str] | None = None, as_read: bool = False
) -> Scene:
    """The scene of a table: from `config`, else from the TOML file beside the table, else assumed. A table
    without a file (None) has an assumed scene.

    Raises SceneError with every fault of the file and, unless `as_read`, as `likely_scene` does; TableError when the
    table does not exist.

    >>> fitball.load_scene("wang_zero_spin").surface
    'acrylic'
    """
    if config is not None:
        return likely_scene(_read_scene(Path(config)), as_read)
    if table_source is None:
        return _make_scene(None, {})
    beside = resolve_table(table_source).with_suffix(".toml")
    # A folder or a link to nowhere of that name is no scene, and reading it says so.
    return likely_scene(_read_scene(beside) if os.path.lexists(beside) else _make_scene(None, {}), as_read)


def likely_scene(scene: Scene, as_read: bool = False) -> Scene:
    """The scene, where its ball, court and instruments are like others. Raises SceneError otherwise; with `as_read`
    what is unlikely is listed in `assumed`.
    """
    doubts = _doubts(scene)
    if not doubts:
        return scene
    if as_read:
        taken = tuple(f"accepted on request (as_read): {doubt}" for doubt in doubts)
        return replace(scene, assumed=(*scene.assumed, *taken))
    message = fault_list(scene.source or "scene", len(doubts), doubts)
    raise SceneError(f"{message}\n  if the scene is right, pass {option('as_read')}")


def _doubts(scene: Scene) -> list[str]:
    ball = scene.ball
    time, time_sd = scene.contact_time or (None, None)
    stated: dict[str, Any] = {
        "ball.mass": ball.mass, "ball.radius": ball.radius, "ball.inertia_ratio": ball.inertia_ratio,
        "air.temperature": scene.air_temperature, "flight.drag": scene.drag, "flight.lift": scene.lift,
        "surface.mu": scene.mu[0] if scene.mu else None, "contact_time.value": time, "contact_time.sd": time_sd,
        **{key: getattr(scene, name) for key, name in _FIELDS.items() if key in SIZES},
    }  # fmt: skip
    filmed = {} if scene.camera is None else {f"camera.{name}": value for name, value in vars(scene.camera).items()}
    pairs = {
        key: (it.value, it.sd) if isinstance(it, Quantity) else (it, None) for key, it in (stated | filmed).items()
    }
    doubts = [unlikely(key, value, sd) for key, (value, sd) in pairs.items() if value is not None]
    return [doubt for doubt in (*doubts, unlikely_density(ball)) if doubt is not None]


def _read_scene(path: Path) -> Scene:
    return _make_scene(str(path), read_scene_file(path))


def _make_scene(source: str | None, known: Mapping[str, Any]) -> Scene:
    ball, ball_sd = _ball(source, known)
    mu, time, warmth = (known.get(key) for key in ("surface.mu", "contact_time.value", "ball.temperature"))
    given = known.keys() | ({"ball.inertia_ratio"} if "ball.inertia" in known else set())
    kind = known.get("ball.type")
    if kind is not None and kind not in BALL_TYPES:
        raise SceneError(f'{source}: ball.type = "{kind}": {suggestion(kind, BALL_TYPES)}')
    if known.get("camera.y", "up") not in ("up", "down"):
        raise SceneError(f'{source}: camera.y = "{known["camera.y"]}": expected "up" or "down"')
    filmed = {item.name: known[key] for item in fields(Camera) if (key := f"camera.{item.name}") in known}
    silences = {
        _NO_FILE: source is None,
        **{f"assumed {words}": f"ball.{name}" not in given for name, words in _BALL_WORDS.items()},
        NO_MU: mu is None,
        NO_CONTACT_TIME: time is None,
        NO_VELOCITY_SD: not {f"measurement.{SHARED_SD}", "measurement.nominal_velocity_sd"} & given,
        NO_SPIN_SD: not {"measurement.spin_sd", "measurement.nominal_spin_sd"} & given,
    }
    return Scene(
        source=source,
        ball=ball,
        ball_sd=FrozenMapping(ball_sd),
        ball_temperature=None if warmth is None else warmth.value,
        ball_temperature_sd=None if warmth is None else warmth.sd,
        mu=None if mu is None else (mu.value, mu.sd),
        contact_time=None if time is None else (time, known["contact_time.sd"]),
        camera=Camera(**filmed) if filmed else None,
        air_temperature=known.get("air.temperature"),
        drag=known.get("flight.drag"),
        lift=known.get("flight.lift"),
        assumed=tuple(sentence for sentence, silent in silences.items() if silent),
        **{_FIELDS[key]: value for key, value in known.items() if key in _FIELDS},
    )


def _ball(source: str | None, known: Mapping[str, Any]) -> tuple[Ball, dict[str, float]]:
    """The ball and the stated sds; an sd of the inertia becomes one of the ratio, M and R being as stated."""
    mass = known.get("ball.mass", Quantity(WANG_MASS))
    radius = known.get("ball.radius", Quantity(WANG_RADIUS))
    unit = mass.value * radius.value**2
    inertia = known.get("ball.inertia")
    ratio = known.get("ball.inertia_ratio", Quantity(WANG_INERTIA_RATIO))
    if inertia is not None:
        ratio = Quantity(inertia.value / unit, None if inertia.sd is None else inertia.sd / unit)
    moment = ratio.value * unit if inertia is None else inertia.value
    try:
        ball = Ball(mass.value, radius.value, moment)
    except ParameterError as error:
        raise SceneError(f"{source}: [ball]: {error}{meant_inertia(moment / unit, moment)}") from None
    dense = density_fault(ball)
    if dense is not None:
        raise SceneError(f"{source}: [ball]: {dense}")
    fault = range_fault("ball.inertia_ratio", ball.inertia_ratio, ratio.sd)
    if fault is not None:
        meant = meant_inertia(ball.inertia_ratio, moment)
        raise SceneError(f"{source}: [ball]: inertia {moment:g} kg m^2 makes {fault}{meant}")
    stated = {"mass": mass.sd, "radius": radius.sd, "inertia_ratio": ratio.sd}
    return ball, {name: sd for name, sd in stated.items() if sd is not None}


def read_scene_file(path: Path) -> Mapping[str, Any]:
    """The checked content of a scene file by dotted key, such as `ball.mass`: texts, numbers, `Quantity`, and what is
    in the free sections. Raises SceneError that lists every fault.
    """
    try:
        tree = tomllib.loads(path.read_bytes().decode("utf-8-sig"))
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise SceneError(f"{path}: cannot be opened: {reason}; expected a scene file (TOML)") from None
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: byte {error.start} is not UTF-8; expected TOML, which is UTF-8") from None
    except (ValueError, RecursionError) as error:  # TOMLDecodeError, an integer of thousands of digits, deep nesting
        raise SceneError(f"{path}: not TOML: {error}; correct that place") from None
    faults: list[str] = []
    values: dict[str, Any] = {}
    for section, content in tree.items():
        names = [key.partition(".")[2] for key in KINDS if key.startswith(f"{section}.")]
        if section in KINDS:
            _read(section, content, values, faults)
        elif not names:
            faults.append(f"[{section}]: unknown key; {suggestion(section, SECTIONS)}")
        elif not isinstance(content, dict):
            faults.append(f"{section} = {content!r}: expected a section [{section}] with keys {', '.join(names)}")
        else:
            for name, value in content.items():
                if name in names:
                    _read(f"{section}.{name}", value, values, faults)
                else:
                    faults.append(f"{section}.{name}: unknown key; {suggestion(name, names)}")
    faults += [
        f"{one} and {other} are both given, but mean the same; keep one of them"
        for one, other in EXCLUSIVE
        if one in values and other in values
    ]
    time = tree.get("contact_time")
    if isinstance(time, dict) and ("value" in time) != ("sd" in time):
        faults.append("[contact_time]: expected both value and sd")
    if faults:
        raise SceneError(fault_list(str(path), len(faults), folded((kind_of(fault), fault) for fault in faults)))
    return values


def _read(key: str, content: object, values: dict[str, Any], faults: list[str]) -> None:
    """Add the value of a key, or what is wrong with it."""
    kind = KINDS[key]
    value = _free(key, content, kind, faults) if kind in _FREE else _checked(content, kind)
    if value is None:
        faults.append(f"{key} = {_shown(content)}: expected {kind.value}")
        return
    if isinstance(value, float | Quantity):
        number, sd = (value.value, value.sd) if isinstance(value, Quantity) else (value, None)
        fault = range_fault(key, number, sd)
        faults += [fault] if fault is not None else []
    values[key] = value


def _free(key: str, content: object, kind: Kind, faults: list[str]) -> FrozenMapping[str | float] | None:
    """The entries of a free section, each if it is of its kind; None where it is no section."""
    if not isinstance(content, dict):
        return None
    form, expected = _FREE[kind]
    entries: dict[str, str | float] = {}
    for name, value in content.items():
        number = _number(value)
        if form is None and number is not None:
            entries[name] = number
        elif form is not None and isinstance(value, str) and form.fullmatch(value):
            entries[name] = value
        else:
            faults.append(f"{key}.{name} = {_shown(value)}: expected {expected}")
    return FrozenMapping(entries)


def _checked(content: object, kind: Kind) -> str | float | Quantity | tuple[str, ...] | None:
    """The value when it is of its kind, else None."""
    if kind is Kind.DATE:
        return _date(content)
    if kind is Kind.LIST:
        named = isinstance(content, list) and all(isinstance(item, str) and item.strip() for item in content)
        return tuple(item.strip() for item in content) if named else None  # type: ignore[attr-defined]
    if kind is Kind.TEXT:
        return content if isinstance(content, str) and content.strip() else None
    number, sd = _number(content), None
    if kind is not Kind.POSITIVE and isinstance(content, dict) and set(content) == {"value", "sd"}:
        number, sd = _number(content["value"]), _number(content["sd"])
        if sd is None or sd <= 0.0:
            return None
    if number is None or (number <= 0.0 and kind not in (Kind.DEGREES, Kind.SIGNED)):
        return None
    return number if kind is Kind.POSITIVE else Quantity(number, sd)


def _date(content: object) -> str | None:
    """A day of the calendar, or a period between two, as text; None for anything else."""
    if isinstance(content, datetime.date) and not isinstance(content, datetime.datetime):
        return content.isoformat()
    if not isinstance(content, str):
        return None
    try:
        days = [datetime.date.fromisoformat(day) for day in content.strip().split(" to ")]
    except ValueError:
        return None
    return content.strip() if len(days) <= 2 and days == sorted(days) else None


def _number(content: object) -> float | None:
    if isinstance(content, bool) or not isinstance(content, int | float):
        return None
    try:
        number = float(content)
    except OverflowError:  # TOML integers have no upper bound
        return None
    return number if isfinite(number) else None


def _shown(content: object) -> str:
    """A TOML value as in a file."""
    if isinstance(content, bool):
        return "true" if content else "false"
    if isinstance(content, str):
        return f'"{content}"'
    if isinstance(content, dict):
        return "{ " + ", ".join(f"{name} = {_shown(value)}" for name, value in content.items()) + " }"
    return str(content)
