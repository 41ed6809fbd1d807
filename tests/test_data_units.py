"""Units: exact factors, round trips, and refusals that name what is known."""

from fractions import Fraction
from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fitball.data.units import DEFAULT_UNIT, UNITS, Dimension, parse_unit, symbols
from fitball.errors import UnitError

# International definitions: inch 25.4 mm, foot 12 in, mile 5280 ft, nautical mile 1852 m, 360 deg a turn.
EXACT = {
    "m/s": Fraction(1),
    "cm/s": Fraction(1, 100),
    "mm/s": Fraction(1, 1000),
    "km/h": Fraction(1000, 3600),
    "mph": Fraction(254, 10000) * 12 * 5280 / 3600,
    "ft/s": Fraction(254, 10000) * 12,
    "in/s": Fraction(254, 10000),
    "kn": Fraction(1852, 3600),
    "rad": Fraction(1),
    "mrad": Fraction(1, 1000),
    "rad/s": Fraction(1),
    "s": Fraction(1),
    "ms": Fraction(1, 1000),
    "us": Fraction(1, 1000000),
    "N": Fraction(1),
    "kN": Fraction(1000),
    # The pound is 0.45359237 kg, standard gravity 9.80665 m/s2.
    "m": Fraction(1),
    "cm": Fraction(1, 100),
    "mm": Fraction(1, 1000),
    "in": Fraction(254, 10000),
    "ft": Fraction(254, 10000) * 12,
    "lbf": Fraction(45359237, 10**8) * Fraction(980665, 10**5),
}
TURNS = {"deg": Fraction(1, 360), "deg/s": Fraction(1, 360), "rev/s": Fraction(1), "rpm": Fraction(1, 60)}


def test_factors_are_the_definitions() -> None:
    assert set(EXACT) | set(TURNS) == set(UNITS)
    for symbol, factor in EXACT.items():
        assert Fraction(UNITS[symbol].numerator) / Fraction(UNITS[symbol].denominator) == factor, symbol
    for symbol, turn in TURNS.items():
        unit = UNITS[symbol]
        assert Fraction(unit.numerator) / Fraction(unit.denominator) == Fraction(pi) * 2 * turn, symbol


def test_round_decimals_stay_round() -> None:
    assert UNITS["ms"].to_si(5.0) == 0.005
    assert UNITS["km/h"].to_si(36.0) == 10.0
    assert UNITS["deg"].to_si(180.0) == pi


@given(st.sampled_from(sorted(UNITS)), st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-6))
def test_round_trip(symbol: str, value: float) -> None:
    unit = UNITS[symbol]
    # Two products and two quotients, each correctly rounded: 4 half-ulps.
    assert unit.from_si(unit.to_si(value)) == pytest.approx(value, rel=4 * 2.0**-53, abs=0.0)
    assert unit.to_si(np.array([value]))[0] == unit.to_si(value)


SPELLED = {
    "m/s": "M/S|m / s|m s^-1|m s-1|m.s-1|m·s⁻¹|m*s^-1|m s**-1|ms-1|mps|m/sec|meters per second|metres/second",
    "km/h": " km/h |kmh|KM/H|km h^-1|kph|kmph|km/hr|kilometres per hour",
    "mph": "MPH|mi/h|miles per hour|Mi/Hr",
    "ft/s": "fps|ft/sec|feet per second|ft s^-1",
    "in/s": "inch/s|inches per second|ips",
    "cm/s": "cm s^-1|CM/S",
    "kn": "knots|kt|kts",
    "rad/s": "rad s^-1|rad s-1|rad·s⁻¹|rad/sec|radians per second",
    "deg/s": "°/s|degree/s|degrees per second|deg s^-1|dps",
    "rev/s": "Hz|hz|rps|revolutions per second|rev s^-1|turns/s|U/s",
    "rpm": "RPM|rev/min|r.p.m.|U/min|1/min|min^-1|min⁻¹|revolutions per minute",
    "deg": "°|degree|Degrees|DEG|º",
    "rad": "RAD|radian|radians",
    "mrad": "milliradian",
    "s": "sec|seconds|S",
    "ms": "msec|milliseconds|MS",
    "us": "µs|μs|usec|microseconds",
    "N": "newton|n",
    "kN": "kilonewton",
    "cm": "CM|centimetre|centimeters",
    "mm": "millimetre",
    "m": "meter|metres",
    "in": 'inch|inches|"',
    "ft": "foot|feet",
}


@pytest.mark.parametrize(("symbol", "text"), [(s, text) for s, texts in SPELLED.items() for text in texts.split("|")])
def test_units_as_people_spell_them(symbol: str, text: str) -> None:
    unit = UNITS[symbol]
    assert parse_unit(text, unit.dimension) is unit


@pytest.mark.parametrize(
    ("text", "dimension", "words"),
    [
        *((text, Dimension.SPIN, "write") for text in ("1/s", "s^-1", "s⁻¹")),
        ("grad", Dimension.ANGLE, "write"),
        *(
            (text, Dimension.SPIN, f"which is unknown;.* units of spin: {', '.join(symbols(Dimension.SPIN))}")
            for text in ("furlong/h", "", "RPN", "m / min", "K", "rev/day", "per second")
        ),
        ("RPN", Dimension.SPIN, "did you mean 'rpm'"),
        ("rpm", Dimension.SPEED, r"'\[rpm\]', which measures spin; expected a unit of speed: m/s"),
    ],
)
def test_what_is_no_unit_of_a_quantity_is_refused_and_the_known_are_named(
    text: str, dimension: Dimension, words: str
) -> None:
    with pytest.raises(UnitError, match=words):
        parse_unit(text, dimension)


def test_no_bracket_means_the_default() -> None:
    symbol = dict(zip(Dimension, ("m/s", "rad/s", "deg", "s", "N", "m"), strict=True))
    assert {item: parse_unit(None, item).symbol for item in Dimension} == symbol
    assert set(DEFAULT_UNIT) == set(Dimension)
