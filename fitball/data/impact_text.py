"""One impact written in a line, such as `v=38 mph, theta=18 deg, spin=950 rpm top`."""

from __future__ import annotations

import re
from math import isfinite, pi

import numpy as np

from fitball.data.columns import SD_SUFFIX
from fitball.data.limits import refuse_beyond
from fitball.data.propagation import Uncertain, covariance_matrix
from fitball.data.units import Dimension, parse_unit
from fitball.data.velocity import velocity
from fitball.errors import ParameterError, UnitError, suggestion
from fitball.values import FloatArray, Impacts

# What a quantity may be called, and what it measures; the first name of each is that of the tables.
_NAMES = {
    **dict.fromkeys(("v_1", "v"), ("v_1", Dimension.SPEED)),
    **dict.fromkeys(("theta_1", "theta"), ("theta_1", Dimension.ANGLE)),
    **dict.fromkeys(("v_x1", "v_x"), ("v_x1", Dimension.SPEED)),
    **dict.fromkeys(("v_y1", "v_y"), ("v_y1", Dimension.SPEED)),
    **dict.fromkeys(("omega_1", "omega", "spin"), ("omega_1", Dimension.SPIN)),
}
_SENSES = {"top": 1.0, "topspin": 1.0, "back": -1.0, "backspin": -1.0}
SIZE = r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_VALUE = re.compile(rf"^(?P<number>[+-]?{SIZE})\s*(?:(?:±|\+/-|\+-)\s*(?P<sd>{SIZE}))?\s*(?P<rest>.*)$")
_FORM = "expected NAME=VALUE UNIT, such as v=38 mph"
_FORMS = "expected v and theta, or v_x and v_y, or v_y alone for a dropped ball; spin where there is any"


def parse_impact(text: str) -> Impacts:
    """One impact as `parse_uncertain_impact` reads it. Raises ParameterError for a stated uncertainty too."""
    impact, covariance = parse_uncertain_impact(text)
    if covariance is not None:
        raise ParameterError(f"impact '{text}': states an uncertainty, which predictions alone take: leave it out")
    return impact


def parse_uncertain_impact(text: str) -> tuple[Impacts, FloatArray | None]:
    """One impact from NAME=VALUE UNIT items divided by commas, and its covariance (1, 3, 3) of (v_x1, v_y1, omega_1).

    Names: `v`, `theta`, `v_x`, `v_y`, `spin` or `omega`, or as in tables (`v_x1`, ...). Without a unit a number is in
    m/s, degrees or rad/s. Spin is topspin when positive; `top` or `back` behind the unit says it in words, and
    then the number has no sign. Spin left out is zero. `38±1 mph` (or `38 +/- 1 mph`) states one standard deviation,
    which is propagated to the components to first order; without any the covariance is None. Raises ParameterError
    that quotes the text.
    """
    try:
        return _impact(_values(text))
    except (ParameterError, UnitError) as error:
        raise ParameterError(f"impact '{text}': {error}") from None


def _values(text: str) -> dict[str, Uncertain]:
    """Quantities by the tables' names, in SI."""
    quantities: dict[str, Uncertain] = {}
    for item in text.split(","):
        key, value, name, dimension = named_value(item, _FORM)
        if name in quantities:
            raise ParameterError(f"{key} is given twice")
        number, sd = _number(key, value, dimension)
        at = np.array([number])
        refuse_beyond(name, at)
        if sd is not None:
            refuse_beyond(name + SD_SUFFIX, np.array([sd]))
        quantities[name] = Uncertain.exact(at) if sd is None else Uncertain.measured(name, at, np.array([sd]))
    return quantities


def named_value(item: str, form: str) -> tuple[str, str, str, Dimension]:
    """Key and value of an item KEY=VALUE, the tables' name of the quantity, and what it measures. Raises
    ParameterError, which says what `form` was expected.
    """
    # Blanks as one each: patterns try every way to divide a run of them.
    key, _equals, value = (" ".join(part.split()) for part in item.partition("="))
    if not key or not value:
        raise ParameterError(f"read '{item.strip()}', {form}")
    if key not in _NAMES:
        raise ParameterError(f"unknown quantity '{key}': {suggestion(key, _NAMES)}")
    return key, value, *_NAMES[key]


def _number(key: str, text: str, dimension: Dimension) -> tuple[float, float | None]:
    """A quantity and its standard deviation, if one is stated, in SI."""
    matched = _VALUE.match(text)
    if matched is None:
        raise ParameterError(f"{key}: read '{text}', expected a number and a unit")
    number, words = float(matched["number"]), matched["rest"].split()
    if not isfinite(number):
        raise ParameterError(f"{key}: read '{text}', expected a finite number")
    if dimension is Dimension.SPIN and words and words[-1].lower() in _SENSES:
        if matched["number"].startswith(("-", "+")):
            raise ParameterError(f"{key}: read '{text}', expected either a sign or a word for the sense of the spin")
        number *= _SENSES[words.pop().lower()]
    try:
        unit = parse_unit(" ".join(words) or None, dimension)
    except UnitError as error:
        raise UnitError(f"{key}: {error}") from None
    if matched["sd"] is None:
        return unit.to_si(number), None
    sd = float(matched["sd"])
    if not (isfinite(sd) and sd > 0.0):
        raise ParameterError(f"{key}: read '{text}', expected a positive standard deviation behind the sign")
    return unit.to_si(number), unit.to_si(sd)


def _impact(quantities: dict[str, Uncertain]) -> tuple[Impacts, FloatArray | None]:
    """Components from what was given. Raises ParameterError for too little, too much or the impossible."""
    given = frozenset(quantities) - {"omega_1"}
    if given == {"v_1", "theta_1"}:
        if not quantities["v_1"].value[0] > 0.0:
            raise ParameterError("expected a positive speed v")
        if not 0.0 < quantities["theta_1"].value[0] < pi:
            raise ParameterError("expected an angle theta to the court between 0 and 180 deg")
    elif given in ({"v_x1", "v_y1"}, {"v_y1"}):
        if not quantities["v_y1"].value[0] > 0.0:
            raise ParameterError("expected a positive speed v_y towards the court")
    else:
        words = ", ".join(sorted(given)) or "no velocity"
        raise ParameterError(f"read {words}; {_FORMS}")
    nothing = Uncertain.exact(np.zeros(1))
    along = velocity(quantities, "1")
    state = [along.x or nothing, along.y or nothing, quantities.get("omega_1", nothing)]
    known = any(item.parts for item in state)
    return Impacts(*(item.value for item in state)), covariance_matrix(state, 1) if known else None
