"""What a film of one bounce shows at each instant: places, turns, forces, slip or grip; numbers only."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from fitball.inference.prediction.simulate import Simulation
from fitball.models.history import History
from fitball.models.types import PHASE_SYMBOL, Phase
from fitball.values import FloatArray

# Time in flight on either side of the contact, in shares of it.
FLIGHT = 0.3
# About how long a film lasts [s]; how many times it is slowed down is a round number.
LASTS = 5.0
IN_FLIGHT, IN_CONTACT = "in flight", "contact"


@dataclass(frozen=True)
class Motion:
    """A bounce at instants `time` [s after landing], all arrays (instants,) in SI: `x` of the centre along the court,
    `height` of the shell above it, `compression`; how far core and shell have turned since landing [rad], topspin
    positive; `normal_force` and `friction_force` of the court, `slip`, velocities and spins as in `History`; `state`
    in a word; `slowed` how many times slower than life the film runs.
    """

    time: FloatArray
    x: FloatArray
    height: FloatArray
    compression: FloatArray
    core_turned: FloatArray
    shell_turned: FloatArray
    normal_force: FloatArray
    friction_force: FloatArray
    slip: FloatArray
    v_x: FloatArray
    v_y: FloatArray
    omega_1: FloatArray
    omega_2: FloatArray
    state: tuple[str, ...]
    slowed: float


def motion(simulation: Simulation, frames_per_second: float) -> Motion:
    """The instants of a film of about `LASTS` seconds, the flight before and after the contact included."""
    history = simulation.history
    flight = FLIGHT * history.contact_time
    whole = history.contact_time + 2.0 * flight
    slowed = _round(LASTS / whole)
    count = max(2, round(whole * slowed * frames_per_second) + 1)
    time = np.linspace(-flight, whole - flight, count)
    before, after = history.landing.before, history.release.after
    early, late = np.minimum(time, 0.0), np.maximum(time - history.contact_time, 0.0)
    moved = [_integral(history, course) for course in (history.v_x, history.omega_1, history.omega_2)]

    def placed(course: FloatArray, rate_before: float, rate_after: float) -> FloatArray:
        return _inside(history, time, course) + rate_before * early + rate_after * late

    def in_contact(course: FloatArray, outside: tuple[float, float]) -> FloatArray:
        inside = _inside(history, time, course)
        return np.where(early < 0.0, outside[0], np.where(late > 0.0, outside[1], inside))

    nothing = (0.0, 0.0)
    return Motion(
        time=time,
        x=placed(moved[0], before.v_x, after.v_x),
        height=-before.v_y * early - after.v_y * late,
        compression=in_contact(history.y, nothing),
        core_turned=placed(moved[1], before.omega_1, after.omega_1),
        shell_turned=placed(moved[2], before.omega_2, after.omega_2),
        normal_force=in_contact(history.normal_force, nothing),
        friction_force=in_contact(history.friction_force, nothing),
        slip=in_contact(history.slip, nothing),
        v_x=in_contact(history.v_x, (before.v_x, after.v_x)),
        v_y=in_contact(history.v_y, (before.v_y, after.v_y)),
        omega_1=in_contact(history.omega_1, (before.omega_1, after.omega_1)),
        omega_2=in_contact(history.omega_2, (before.omega_2, after.omega_2)),
        state=tuple(map(_state(history), time.tolist())),
        slowed=slowed,
    )


def _inside(history: History, time: FloatArray, course: FloatArray) -> FloatArray:
    """A course at `time`, its ends outside of the contact."""
    return np.interp(time, history.times, course)


def _integral(history: History, course: FloatArray) -> FloatArray:
    """The integral of a course from landing on, by trapezoids."""
    steps = 0.5 * (course[1:] + course[:-1]) * np.diff(history.times)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _state(history: History) -> Callable[[float], str]:
    def at(time: float) -> str:
        if not 0.0 <= time <= history.contact_time:
            return IN_FLIGHT
        for span in history.spans:
            if time <= span.end:
                return PHASE_SYMBOL[span.phase]
        return IN_CONTACT

    return at


def phase_of(state: str) -> Phase | None:
    """The phase that a state names; None for others."""
    return next((phase for phase, symbol in PHASE_SYMBOL.items() if symbol == state), None)


def _round(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda digit: abs(math.log(value / (digit * power))))
