"""The keys of a scene file (TOML): the kind of each, and the limits beyond which numbers are impossible or doubtful
(often a wrong unit).

`scene.schema.json` beside this file declares them, each with what it holds and what it is about, for the reader here
as for editors and other programs. The field of `Scene` that takes a key names it there, with its default.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import log, pi
from pathlib import Path
from typing import Any

from fitball.observables import OBSERVABLES, SHARED_NOISE, ColumnNoise
from fitball.values import Ball

_SCHEMA: Mapping[str, Any] = json.loads(Path(__file__).with_name("scene.schema.json").read_text(encoding="utf-8"))


class Kind(Enum):
    """What a key may hold, in the words of a fault message; named as in the schema."""

    TEXT = "a text in quotes"
    LIST = 'a list of texts, such as ["gap_time"]'
    DATE = 'a date such as 2026-05-31, or a period such as "2026-05-30 to 2026-05-31"'
    POSITIVE = "a positive number"
    QUANTITY = "a positive number, or { value = ..., sd = ... } with both positive"
    DEGREES = "a number of degrees Celsius, or { value = ..., sd = ... } with a positive sd"
    SIGNED = "a number, or { value = ..., sd = ... } with a positive sd"
    TEXTS = "a section of names and texts"
    NUMBERS = "a section of names and numbers"
    PRIORS = 'a section of names and priors such as "normal(0.55, 0.05)"'


def _kind(node: Mapping[str, Any]) -> Kind:
    """What a node of the schema holds; of a section of free names, what these do."""
    entry = node.get("additionalProperties", False)
    name = (node if entry is False else entry).get("$ref", "text" if entry is False else "number")
    return Kind[name.removeprefix("#/$defs/").upper() + ("" if entry is False else "S")]


# By dotted key, in the order of the schema; a section that takes any name is a key of its own.
KINDS: Mapping[str, Kind] = {
    f"{section}.{name}" if name else section: _kind(child)
    for section, node in _SCHEMA["properties"].items()
    for name, child in node.get("properties", {"": node}).items()
}
SECTIONS: tuple[str, ...] = tuple(_SCHEMA["properties"])
PRIOR: str = _SCHEMA["$defs"]["prior"]["pattern"]
# Pairs that say the same thing twice.
EXCLUSIVE = (
    ("ball.inertia", "ball.inertia_ratio"),
    ("measurement.velocity_sd", "measurement.nominal_velocity_sd"),
    ("measurement.spin_sd", "measurement.nominal_spin_sd"),
    ("air.density", "air.temperature"),
    ("air.density", "air.pressure"),
)

# What people write where SI is meant: units by their factors, most usual first.
_MASSES = {"g": 1e-3, "mg": 1e-6, "oz": 0.028349523125, "lb": 0.45359237}
_LENGTHS = {"mm": 1e-3, "cm": 1e-2, "in": 0.0254}
_INERTIAS = {"g cm^2": 1e-7, "g mm^2": 1e-9, "kg cm^2": 1e-4, "kg mm^2": 1e-6, "g m^2": 1e-3}
_TIMES = {"ms": 1e-3, "us": 1e-6}
_SPEEDS = {"mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1.0 / 3.6}
_SPINS = {"rpm": pi / 30.0}
_RATES = {"1/ms": 1e3}
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
    symbol, factor = min(units.items(), key=lambda item: abs(log(abs(value) * item[1] / typical)))
    return f"; did you mean {value:g} {symbol} ({value * factor:.4g})?"


_LIKELY_SDS: Mapping[str, tuple[tuple[float, float], Mapping[str, float], float]] = {
    "m/s": ((1e-6, 4.0), _SPEEDS, 1e-9),
    "rad": ((1e-6, 0.2), _ANGLES, 1e-9),
    "rad/s": ((1e-6, 300.0), _SPINS, 1e-9),
    "s": ((1e-9, 5e-3), _TIMES, 1e-12),
    "m": ((1e-9, 0.05), _LENGTHS, 1e-12),
}


def _noise(noise: ColumnNoise, unit: str, name: str = "") -> tuple[str, Range]:
    """The key of a known noise, or of a nominal one called `name`: from far better instruments to far worse than any;
    as large as its parameter may be.
    """
    likely, units, least = _LIKELY_SDS[unit]
    words = f"{least:g} to {noise.upper:g} {unit}"
    return f"measurement.{name or noise.name}", Range(least, noise.upper, words, likely, float(noise.typical), units)


_RATIOS = Range(0.01, 1.0, "0.01 to 1", (0.2, 0.7), 0.5, {})
# Balls from a grain of shot to the largest that people throw; likely are those of games, and of laboratories.
SIZES: Mapping[str, Range] = {
    "ball.mass": Range(1e-6, 20.0, "1 mg to 20 kg, in kg", (1e-5, 8.0), 0.05, _MASSES),
    "ball.radius": Range(1e-4, 0.5, "0.1 mm to 0.5 m, in m", (5e-4, 0.25), 0.03, _LENGTHS),
    "ball.inertia_ratio": _RATIOS,
    "ball.temperature": Range(-40.0, 80.0, "-40 to 80 degrees Celsius", (-40.0, 80.0), 20.0, {}),
    "surface.mu": Range(1e-6, 100.0, "1e-6 to 100", (0.005, 3.0), 0.5, {"%": 1e-2}),
    "contact_time.value": Range(1e-6, 0.1, "1 us to 100 ms, in s", (5e-6, 0.05), 5e-3, _TIMES),
    "contact_time.sd": Range(1e-12, 0.1, "1e-12 to 0.1 s, in s", (1e-9, 0.05), 5e-4, _TIMES),
    **dict([_noise(SHARED_NOISE, "m/s"), *(_noise(item.noise, item.unit) for item in OBSERVABLES.values())]),
    **dict([_noise(SHARED_NOISE, "m/s", "nominal_velocity_sd")]),
    **dict([_noise(OBSERVABLES["omega_2"].noise, "rad/s", "nominal_spin_sd")]),
    "force.sd": Range(1e-9, 1e6, "1e-9 to 1e6 N", (1e-6, 1e4), 10.0, {"mN": 1e-3}),
    "force.start_sd": Range(1e-12, 0.1, "1e-12 to 0.1 s, in s", (1e-9, 0.01), 1e-4, _TIMES),
    "camera.scale": Range(0.2, 5.0, "a factor of 0.2 to 5", (0.8, 1.25), 1.0, {"%": 1e-2}),
    "camera.clock": Range(0.2, 5.0, "a factor of 0.2 to 5", (0.8, 1.25), 1.0, {"%": 1e-2}),
    "camera.tilt": Range(
        -pi / 18.0, pi / 18.0, "-10 to 10 deg, in rad", (-pi / 60.0, pi / 60.0), 5e-3, {"deg": pi / 180.0}
    ),
    "camera.court_height": Range(-0.2, 0.2, "-0.2 to 0.2 m, in m", (-0.03, 0.03), 3e-3, {"mm": 1e-3, "cm": 1e-2}),
    "camera.fps": Range(1.0, 1e7, "1 to 1e7 frames/s", (20.0, 1e6), 1e3, _RATES),
    "camera.mm_per_px": Range(1e-4, 1e3, "1e-4 to 1000 mm", (1e-3, 20.0), 1.0, {"um": 1e-3, "m": 1e3}),
    "camera.row_time": Range(1e-10, 0.01, "1e-10 to 0.01 s, in s", (1e-9, 1e-3), 1e-5, _TIMES),
    "camera.court": Range(-100.0, 100.0, "-100 to 100 m, in m", (-10.0, 10.0), 1.0, {"mm": 1e-3, "cm": 1e-2}),
    "air.density": Range(0.3, 2.0, "0.3 to 2 kg/m^3", (0.7, 1.5), 1.2, {"g/cm^3": 1e3}),
    "air.temperature": Range(-40.0, 60.0, "-40 to 60 degrees Celsius", (-40.0, 60.0), 20.0, {}),
    "air.pressure": Range(
        3e4, 1.2e5, "30 to 120 kPa, in Pa", (5e4, 1.1e5), 1e5, {"hPa": 1e2, "kPa": 1e3, "bar": 1e5}
    ),
    "flight.drag": Range(0.01, 3.0, "0.01 to 3", (0.1, 1.0), 0.5, {}),
    "flight.lift": Range(-2.0, 2.0, "-2 to 2", (-0.5, 0.5), 0.05, {}),
    "flight.spin_sd": Range(0.1, 1e4, "0.1 to 1e4 rad/s", (5.0, 2000.0), 250.0, _SPINS),
}
# Standard deviations that nobody is asked about, at most, and what is typical. Of quantities about zero that is all
# there is to be held against.
_LIKELY_SPREADS: Mapping[str, tuple[float, float]] = {
    "camera.scale": (0.2, 0.01),
    "camera.clock": (0.2, 0.01),
    "camera.tilt": (pi / 60.0, 5e-3),
    "camera.court_height": (0.03, 3e-3),
    "flight.lift": (0.5, 0.05),
}
# Quantities that may be zero or negative.
SIGNED = tuple(key for key, kind in KINDS.items() if kind is Kind.SIGNED)


# A standard deviation this many times smaller than its quantity is no measurement.
LEAST_SHARE = 1e-9
# Density [kg/m^3]: no matter is denser than osmium, and what is lighter than air does not come down; balls of games
# reach from a beach ball's few kilograms to a golf ball's 1,130, those of laboratories to tungsten's 19,300.
DENSEST, LIGHTEST, LIKELY_LIGHTEST = 22_600.0, 1.2, 12.0


def range_fault(key: str, value: float, sd: float | None) -> str | None:
    """What is wrong with the size of a positive number and its standard deviation, or None."""
    allowed = SIZES.get(key)
    if allowed is None:
        return None
    if not allowed.least <= value <= allowed.most:
        return f"{key} = {value:g}: expected {allowed.words}{allowed.meant(value)}"
    if sd is not None and key in SIGNED:
        if sd <= allowed.most:
            return None
        return f"{key}: sd = {sd:g}: expected at most {allowed.most:.2g}{_meant_spread(key, sd)}"
    if sd is not None and not LEAST_SHARE * abs(value) <= sd <= allowed.most:
        return f"{key}: sd = {sd:g}: expected 1e-9 times the value to {allowed.most:g}"
    if sd is not None and key not in ("surface.mu", "ball.temperature", "air.temperature") and sd > value:
        return (
            f"{key}: sd = {sd:g}: expected less than the value, {value:g}, in its unit{_meant_sd(allowed, sd, value)}"
        )
    return None


def _meant_sd(allowed: Range, sd: float, value: float) -> str:
    return _question(sd, {s: f for s, f in allowed.units.items() if sd * f <= 0.2 * value}, 0.02 * value)


def _meant_spread(key: str, sd: float) -> str:
    most, typical = _LIKELY_SPREADS[key]
    return _question(sd, {s: f for s, f in SIZES[key].units.items() if sd * f <= most}, typical)


def unlikely(key: str, value: float, sd: float | None = None) -> str | None:
    """What to ask about a number that can be but that no ball, court or instrument of a bounce has, or about its
    standard deviation; None for nothing.
    """
    allowed = SIZES[key]
    low, high = allowed.likely
    if not low <= value <= high:
        return f"{key} = {value:g} is unlikely: {low:.3g} to {high:.3g} are usual{allowed.meant(value)}"
    if sd is not None and key in _LIKELY_SPREADS and sd > _LIKELY_SPREADS[key][0]:
        most = _LIKELY_SPREADS[key][0]
        return f"{key}: sd = {sd:g} is unlikely: up to {most:.3g} is usual{_meant_spread(key, sd)}"
    return None


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
    low, high = _RATIOS.likely
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
