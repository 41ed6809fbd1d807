"""From a scene file (TOML) to checked values by dotted key; every fault of the file at once.

`scene.schema.json` beside this file says the same to editors and other programs.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from math import isfinite
from pathlib import Path
from typing import Any

from fitball.data.scene_limits import range_fault
from fitball.errors import SceneError, fault_list, suggestion
from fitball.observables import NOISE_OF, SHARED_SD
from fitball.visible import folded, kind_of


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
