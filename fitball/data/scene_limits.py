"""Numbers of a scene that no ball, court or instrument has: a wrong unit, which no prior should hide."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from fitball.observables import OBSERVABLES, SHARED_SD


@dataclass(frozen=True)
class Range:
    """A quantity is `least` to `most` [SI]; `words` say so in units that people use, and which unit the file has."""

    least: float
    most: float
    words: str


# Balls from a grain of shot to the largest that people throw; instruments from far better to far worse than any.
_TIME_SD = Range(1e-12, 0.1, "1e-12 to 0.1 s, in s")
_SDS: Mapping[str, Range] = {
    "m/s": Range(1e-9, 1000.0, "1e-9 to 1000 m/s"),
    "rad": Range(1e-9, 6.3, "1e-9 to 6.3 rad, in rad"),
    "rad/s": Range(1e-9, 1e5, "1e-9 to 1e5 rad/s"),
    "s": _TIME_SD,
}
RANGES: Mapping[str, Range] = {
    "ball.mass": Range(1e-6, 20.0, "1 mg to 20 kg, in kg"),
    "ball.radius": Range(1e-4, 0.5, "0.1 mm to 0.5 m, in m"),
    "ball.inertia_ratio": Range(0.01, 1.0, "0.01 to 1"),
    "surface.mu": Range(1e-6, 100.0, "1e-6 to 100"),
    "contact_time.value": Range(1e-4, 0.1, "0.1 to 100 ms, in s"),
    "contact_time.sd": _TIME_SD,
    f"measurement.{SHARED_SD}": _SDS["m/s"],
    "measurement.nominal_velocity_sd": _SDS["m/s"],
    "measurement.nominal_spin_sd": _SDS["rad/s"],
    **{f"measurement.{item.noise.name}": _SDS[item.unit] for item in OBSERVABLES.values()},
    "force.sd": Range(1e-9, 1e6, "1e-9 to 1e6 N"),
    "force.start_sd": _TIME_SD,
}
# A standard deviation this many times smaller than its quantity is no measurement.
LEAST_SHARE = 1e-9


def range_fault(key: str, value: float, sd: float | None) -> str | None:
    """What is wrong with the size of a positive number and its standard deviation, or None."""
    allowed = RANGES.get(key)
    if allowed is None:
        return None
    if not allowed.least <= value <= allowed.most:
        return f"{key} = {value:g}: expected {allowed.words}"
    if sd is not None and not LEAST_SHARE * value <= sd <= allowed.most:
        return f"{key}: sd = {sd:g}: expected 1e-9 times the value to {allowed.most:g}"
    return None
