"""Units against their definitions and the spellings that people use; what is none is refused."""

from fractions import Fraction
from math import inf, pi

import pytest

from fitball.base.columns import COLUMNS
from fitball.base.errors import ParameterError
from fitball.base.units import factor_of, symbol_of

# International definitions: inch 25.4 mm, foot 12 in, mile 5280 ft, nautical mile 1852 m; 360 deg a
# turn.
INCH = Fraction(254, 10000)
EXACT = {
    "m/s": {
        "m/s": 1,
        "cm/s": Fraction(1, 100),
        "mm/s": Fraction(1, 1000),
        "km/h": Fraction(1000, 3600),
        "mph": INCH * 12 * 5280 / 3600,
        "ft/s": INCH * 12,
        "in/s": INCH,
        "kn": Fraction(1852, 3600),
    },
    "rad": {"rad": 1, "mrad": Fraction(1, 1000), "deg": Fraction(1, 360) * 2 * Fraction(pi)},
    "rad/s": {
        "rad/s": 1,
        "deg/s": Fraction(1, 360) * 2 * Fraction(pi),
        "rev/s": 2 * Fraction(pi),
        "rpm": Fraction(1, 60) * 2 * Fraction(pi),
    },
    "s": {
        "s": 1,
        "ms": Fraction(1, 1000),
        "us": Fraction(1, 1_000_000),
        "ns": Fraction(1, 1_000_000_000),
    },
    "m": {
        "m": 1,
        "cm": Fraction(1, 100),
        "mm": Fraction(1, 1000),
        "in": INCH,
        "ft": INCH * 12,
    },
}
SPELLED = {
    "m/s": "M/S|m / s|m s^-1|m s-1|m.s-1|m·s⁻¹|m*s^-1|m s**-1|ms-1|mps|m/sec|meters per "
    "second|metres/second",
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
    "ns": "nsec|nanosecond|nanoseconds",
    "cm": "CM|centimetre|centimeters",
    "mm": "millimetre",
    "m": "meter|metres",
    "in": 'inch|inches|"',
    "ft": "foot|feet",
}
SI = {symbol: si for si, units in EXACT.items() for symbol in units}


@pytest.mark.parametrize("symbol", SI)
def test_factors_are_the_definitions_rounded_once(symbol):
    """Of pi, which is rounded itself, to two roundings more."""
    wanted = EXACT[SI[symbol]][symbol]
    found = factor_of(symbol, SI[symbol])
    exact = SI[symbol] != "rad/s" and symbol != "deg"
    assert (
        found == float(wanted)
        if exact
        else found == pytest.approx(float(wanted), rel=2 * 2.0**-53, abs=0.0)
    )


@pytest.mark.parametrize(
    ("symbol", "text"),
    [(s, text) for s, texts in SPELLED.items() for text in texts.split("|")],
)
def test_units_as_people_spell_them(symbol, text):
    assert factor_of(text, SI[symbol]) == factor_of(symbol, SI[symbol])
    assert symbol_of(text.strip()) == symbol


def test_without_a_unit_angles_are_in_degrees_and_all_else_in_si():
    assert {si: factor_of(None, si) for si in EXACT} == {
        "m/s": 1,
        "rad": pi / 180,
        "rad/s": 1,
        "s": 1,
        "m": 1,
    }


@pytest.mark.parametrize(
    ("text", "si", "code"),
    [
        *((text, "rad/s", "ambiguous-unit") for text in ("1/s", "s^-1", "s⁻¹")),
        ("grad", "rad", "ambiguous-unit"),
        # Kilonewtons are no knots.
        *((text, "m/s", "ambiguous-unit") for text in ("KN", "kN", "Kn")),
        *(
            (text, "rad/s", "unknown-unit")
            for text in ("furlong/h", "", "RPN", "m / min", "K", "rev/day", "per second")
        ),
        *(
            (text, "m", "unknown-unit")
            for text in ("a" * 100_000, "m " * 50_000, " " * 100_000 + "x", "yd", "km")
        ),
        ("rpm", "m/s", "other-quantity"),
        ("m", "s", "other-quantity"),
        ("mm", "m/s", "other-quantity"),
    ],
)
def test_what_is_no_unit_of_a_quantity_is_refused(text, si, code):
    with pytest.raises(ParameterError) as caught:
        factor_of(text, si)
    assert caught.value.code == code
    assert len(str(caught.value)) < 400


def test_units_of_columns_and_of_their_noises_agree():
    for column in COLUMNS.values():
        assert column.unit in {*EXACT, ""}
        if column.noise:
            assert column.noise.unit == column.unit
            assert column.noise.display_unit == column.display_unit
            assert 0.0 < column.noise.lower < column.noise.upper < inf
