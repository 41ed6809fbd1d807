"""From a scene file (TOML) to checked values by dotted key; every fault of the file at once. Numbers that no ball,
court or instrument has, or that one would doubt, are a wrong unit, which no prior should hide.

`scene.schema.json` beside this file says the same to editors and other programs.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import isfinite, log, pi
from pathlib import Path
from typing import Any

from fitball.errors import SceneError, fault_list, suggestion
from fitball.observables import NOISE_OF, OBSERVABLES, SHARED_NOISE, SHARED_SD, ColumnNoise
from fitball.values import Ball
from fitball.visible import folded, kind_of

# What people write where SI is meant: units by their factors, most usual first.
_MASSES = {"g": 1e-3, "mg": 1e-6, "oz": 0.028349523125, "lb": 0.45359237}
_LENGTHS = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254}
_INERTIAS = {"g cm^2": 1e-7, "g mm^2": 1e-9, "kg cm^2": 1e-4, "kg mm^2": 1e-6, "g m^2": 1e-3}
_TIMES = {"ms": 1e-3, "us": 1e-6}
_SPEEDS = {"mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1.0 / 3.6}
_SPINS = {"rpm": pi / 30.0}
_ANGLES = {"deg": pi / 180.0, "mrad": 1e-3}


@dataclass(frozen=True)
class Range:
    """A quantity is `least` to `most` [SI]; `words` say so in units that people use, and which unit the file has.

    Between the ends of `likely` nobody is asked. `units` may have been meant, each with its factor to SI; of these
    the one that makes the quantity most `typical`.
    """

    least: float
    most: float
    words: str
    likely: tuple[float, float]
    typical: float
    units: Mapping[str, float]

    def meant(self, value: float) -> str:
        """A question, where another unit makes the value likely."""
        low, high = self.likely
        return _question(value, {s: f for s, f in self.units.items() if low <= value * f <= high}, self.typical)


def _question(value: float, units: Mapping[str, float], typical: float) -> str:
    """Whether the unit was meant that brings `value` nearest to what is typical; "" without any."""
    if not units:
        return ""
    symbol, factor = min(units.items(), key=lambda item: abs(log(value * item[1] / typical)))
    return f"; did you mean {value:g} {symbol} ({value * factor:.4g})?"


def _sd_range(noise: ColumnNoise, unit: str) -> Range:
    """Of a noise: instruments from far better to far worse than any; as large as its parameter may be."""
    likely, units, least = _LIKELY_SDS[unit]
    words = f"{least:g} to {noise.upper:g} {unit}"
    return Range(least, noise.upper, words, likely, float(noise.typical), units)


_LIKELY_SDS: Mapping[str, tuple[tuple[float, float], Mapping[str, float], float]] = {
    "m/s": ((1e-6, 4.0), _SPEEDS, 1e-9),
    "rad": ((1e-6, 0.2), _ANGLES, 1e-9),
    "rad/s": ((1e-6, 300.0), _SPINS, 1e-9),
    "s": ((1e-9, 5e-3), _TIMES, 1e-12),
}
# Balls from a grain of shot to the largest that people throw; likely are those of games, and of laboratories.
RANGES: Mapping[str, Range] = {
    "ball.mass": Range(1e-6, 20.0, "1 mg to 20 kg, in kg", (1e-5, 8.0), 0.05, _MASSES),
    "ball.radius": Range(1e-4, 0.5, "0.1 mm to 0.5 m, in m", (5e-4, 0.25), 0.03, _LENGTHS),
    "ball.inertia_ratio": Range(0.01, 1.0, "0.01 to 1", (0.2, 0.7), 0.5, {}),
    "ball.temperature": Range(-40.0, 80.0, "-40 to 80 degrees Celsius", (-40.0, 80.0), 20.0, {}),
    "surface.mu": Range(1e-6, 100.0, "1e-6 to 100", (0.005, 3.0), 0.5, {"%": 1e-2}),
    "contact_time.value": Range(1e-6, 0.1, "1 us to 100 ms, in s", (5e-6, 0.05), 5e-3, _TIMES),
    "contact_time.sd": Range(1e-12, 0.1, "1e-12 to 0.1 s, in s", (1e-9, 0.05), 5e-4, _TIMES),
    f"measurement.{SHARED_SD}": _sd_range(SHARED_NOISE, "m/s"),
    "measurement.nominal_velocity_sd": _sd_range(SHARED_NOISE, "m/s"),
    "measurement.nominal_spin_sd": _sd_range(OBSERVABLES["omega_2"].noise, "rad/s"),
    **{f"measurement.{item.noise.name}": _sd_range(item.noise, item.unit) for item in OBSERVABLES.values()},
    "force.sd": Range(1e-9, 1e6, "1e-9 to 1e6 N", (1e-6, 1e4), 10.0, {"mN": 1e-3}),
    "force.start_sd": Range(1e-12, 0.1, "1e-12 to 0.1 s, in s", (1e-9, 0.01), 1e-4, _TIMES),
}
# A standard deviation this many times smaller than its quantity is no measurement.
LEAST_SHARE = 1e-9
# Density [kg/m^3]: no matter is denser than osmium, and what is lighter than air does not come down; balls of games
# reach from a beach ball's few kilograms to a golf ball's 1,130, those of laboratories to tungsten's 19,300.
DENSEST, LIGHTEST, LIKELY_LIGHTEST = 22_600.0, 1.2, 12.0


def range_fault(key: str, value: float, sd: float | None) -> str | None:
    """What is wrong with the size of a positive number and its standard deviation, or None."""
    allowed = RANGES.get(key)
    if allowed is None:
        return None
    if not allowed.least <= value <= allowed.most:
        return f"{key} = {value:g}: expected {allowed.words}{allowed.meant(value)}"
    if sd is not None and not LEAST_SHARE * abs(value) <= sd <= allowed.most:
        return f"{key}: sd = {sd:g}: expected 1e-9 times the value to {allowed.most:g}"
    if sd is not None and key not in ("surface.mu", "ball.temperature") and sd > value:
        return (
            f"{key}: sd = {sd:g}: expected less than the value, {value:g}, in its unit{_meant_sd(allowed, sd, value)}"
        )
    return None


def _meant_sd(allowed: Range, sd: float, value: float) -> str:
    return _question(sd, {s: f for s, f in allowed.units.items() if sd * f <= 0.2 * value}, 0.02 * value)


def unlikely(key: str, value: float) -> str | None:
    """What to ask about a number that can be but that no ball, court or instrument of a bounce has, or None."""
    allowed = RANGES[key]
    low, high = allowed.likely
    if low <= value <= high:
        return None
    return f"{key} = {value:g} is far from any: {low:g} to {high:g} are usual{allowed.meant(value)}"


def density_fault(ball: Ball) -> str | None:
    """What is wrong with a mass that a ball of this size cannot have, or None."""
    density = _density(ball)
    if LIGHTEST <= density <= DENSEST:
        return None
    than = "denser than any metal" if density > DENSEST else "lighter than air"
    mass = f"a mass of {ball.mass:g} kg in a ball of radius {ball.radius:g} m"
    return f"{mass} is {than} ({density:.3g} kg/m^3){_meant_ball(ball)}"


def unlikely_density(ball: Ball) -> str | None:
    """What to ask about a ball that is lighter for its size than any of a game, or None."""
    density = _density(ball)
    if density >= LIKELY_LIGHTEST:
        return None
    return (
        f"a mass of {ball.mass:g} kg in a ball of radius {ball.radius:g} m ({density:.3g} kg/m^3) is less than a "
        f"ball of a game has: state both mass and radius{_meant_ball(ball)}"
    )


def meant_inertia(ratio: float, moment: float) -> str:
    """A question about a moment of inertia whose `ratio` to `M R^2` no ball has, where another unit would do."""
    low, high = RANGES["ball.inertia_ratio"].likely
    units = {symbol: factor for symbol, factor in _INERTIAS.items() if low <= ratio * factor <= high}
    return _question(moment, units, 0.5 * moment / ratio)


def _density(ball: Ball) -> float:
    return ball.mass / (4.0 / 3.0 * pi * ball.radius**3)


def _meant_ball(ball: Ball) -> str:
    """A question, where another unit of mass or of length makes the ball one of a game."""
    for name, value, units in (("mass", ball.mass, _MASSES), ("radius", ball.radius, _LENGTHS)):
        for symbol, factor in units.items():
            mass, radius = (factor * value, ball.radius) if name == "mass" else (ball.mass, factor * value)
            if LIKELY_LIGHTEST <= mass / (4.0 / 3.0 * pi * radius**3) <= DENSEST:
                return f"; did you mean a {name} of {value:g} {symbol} ({value * factor:.4g})?"
    return ""


class Kind(Enum):
    """What a key may hold, in the words of a fault message."""

    TEXT = "a text in quotes"
    POSITIVE = "a positive number"
    QUANTITY = "a positive number, or { value = ..., sd = ... } with both positive"
    DEGREES = "a number of degrees Celsius, or { value = ..., sd = ... } with a positive sd"
    FREE_TEXTS = "a section of names and texts"
    FREE_NUMBERS = "a section of names and numbers"
    FREE_PRIORS = 'a section of names and priors such as "normal(0.55, 0.05)"'


# Every key a scene may have. A section is a mapping; sections of the kinds FREE_* take any name.
KEYS: Mapping[str, Kind | Mapping[str, Kind]] = {
    "source": {"description": Kind.TEXT, "citation": Kind.TEXT},
    "ball": {
        "mass": Kind.QUANTITY,
        "radius": Kind.QUANTITY,
        "inertia": Kind.QUANTITY,
        "inertia_ratio": Kind.QUANTITY,
        "temperature": Kind.DEGREES,
        "type": Kind.TEXT,
    },
    "surface": {"name": Kind.TEXT, "mu": Kind.QUANTITY},
    "contact_time": {"value": Kind.POSITIVE, "sd": Kind.POSITIVE},
    "measurement": {
        **dict.fromkeys((SHARED_SD, *NOISE_OF.values()), Kind.POSITIVE),
        "nominal_velocity_sd": Kind.POSITIVE,
        "nominal_spin_sd": Kind.POSITIVE,
        "velocity_noise": Kind.TEXT,
        "distribution": Kind.TEXT,
        "offsets": Kind.TEXT,
    },
    "force": {"file": Kind.TEXT, "sd": Kind.POSITIVE, "start_sd": Kind.POSITIVE},
    "model": {"name": Kind.TEXT, "closures": Kind.FREE_TEXTS},
    "priors": Kind.FREE_PRIORS,
    "fix": Kind.FREE_NUMBERS,
    "pool": Kind.FREE_TEXTS,
    "columns": Kind.FREE_TEXTS,
}

# Pairs that say the same thing twice.
_EXCLUSIVE = (
    ("ball.inertia", "ball.inertia_ratio"),
    ("measurement.velocity_sd", "measurement.nominal_velocity_sd"),
    ("measurement.spin_sd", "measurement.nominal_spin_sd"),
)
_NUMBER = r"[+-]?([0-9]+(?:\.[0-9]*)?|\.[0-9]+)([eE][+-]?[0-9]+)?"
_PRIOR = re.compile(
    rf"\s*([A-Za-z_][A-Za-z0-9_]*\s*\(\s*{_NUMBER}\s*(,\s*{_NUMBER}\s*)*\)|literature:\s*[A-Za-z0-9_-]+)\s*"
)
# How an entry of a free section is written (None: a number), and in words.
_FREE = {
    Kind.FREE_TEXTS: (re.compile(r".*\S.*", re.DOTALL), "a text in quotes"),
    Kind.FREE_NUMBERS: (None, "a finite number"),
    Kind.FREE_PRIORS: (_PRIOR, 'a word and numbers in brackets, such as "normal(0.55, 0.05)", or "literature:KEY"'),
}


@dataclass(frozen=True)
class Quantity:
    """A number with its standard deviation, when one was stated; SI units."""

    value: float
    sd: float | None = None


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
        raise SceneError(f"{path}: not TOML: {error}; mend that place") from None
    faults: list[str] = []
    values: dict[str, Any] = {}
    for section, content in tree.items():
        if section in KEYS:
            _read(section, content, KEYS[section], values, faults)
        else:
            faults.append(_unknown(f"[{section}]", section, KEYS))
    faults += [
        f"{one} and {other} are both given; expected one of them, since they say the same"
        for one, other in _EXCLUSIVE
        if one in values and other in values
    ]
    contact = tree.get("contact_time")
    if isinstance(contact, dict) and ("value" in contact) != ("sd" in contact):
        faults.append("[contact_time]: expected both value and sd")
    if faults:
        raise SceneError(fault_list(str(path), len(faults), folded((kind_of(fault), fault) for fault in faults)))
    return values


def _unknown(where: str, name: str, known: Mapping[str, object]) -> str:
    return f"{where}: unknown key; {suggestion(name, known)}"


def _read(
    key: str, content: object, kind: Kind | Mapping[str, Kind], values: dict[str, Any], faults: list[str]
) -> None:
    if not isinstance(kind, Kind):
        if not isinstance(content, dict):
            faults.append(f"{key} = {content!r}: expected a section [{key}] with keys {', '.join(kind)}")
            return
        for name, value in content.items():
            if name in kind:
                _read(f"{key}.{name}", value, kind[name], values, faults)
            else:
                faults.append(_unknown(f"{key}.{name}", name, kind))
        return
    value = _free(key, content, kind, faults) if kind in _FREE else _checked(content, kind)
    if value is None:
        faults.append(f"{key} = {_shown(content)}: expected {kind.value}")
        return
    if isinstance(value, float | Quantity):
        number, sd = (value.value, value.sd) if isinstance(value, Quantity) else (value, None)
        fault = range_fault(key, number, sd)
        faults += [fault] if fault is not None else []
    values[key] = value


def _free(key: str, content: object, kind: Kind, faults: list[str]) -> dict[str, str | float] | None:
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
    return entries


def _checked(content: object, kind: Kind) -> str | float | Quantity | None:
    """The value when it is of its kind, else None."""
    if kind is Kind.TEXT:
        return content if isinstance(content, str) and content.strip() else None
    number, sd = _number(content), None
    if kind is not Kind.POSITIVE and isinstance(content, dict) and set(content) == {"value", "sd"}:
        number, sd = _number(content["value"]), _number(content["sd"])
        if sd is None or sd <= 0.0:
            return None
    if number is None or (number <= 0.0 and kind is not Kind.DEGREES):
        return None
    return number if kind is Kind.POSITIVE else Quantity(number, sd)


def _number(content: object) -> float | None:
    if isinstance(content, bool) or not isinstance(content, int | float):
        return None
    try:
        number = float(content)
    except OverflowError:  # TOML integers have no upper bound
        return None
    return number if isfinite(number) else None


def _shown(content: object) -> str:
    """A TOML value as it could stand in the file."""
    if isinstance(content, bool):
        return "true" if content else "false"
    if isinstance(content, str):
        return f'"{content}"'
    if isinstance(content, dict):
        return "{ " + ", ".join(f"{name} = {_shown(value)}" for name, value in content.items()) + " }"
    return str(content)
