"""What a film of one bounce shows at each instant: places, turns, forces, slip or grip; numbers only."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

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

    def moved(name: str) -> FloatArray:
        """How far, by the integral of a velocity."""
        way: FloatArray = cumulative_trapezoid(getattr(history, name), history.times, initial=0)
        inside = np.interp(time, history.times, way)
        rates: tuple[float, float] = getattr(before, name), getattr(after, name)
        return inside + rates[0] * early + rates[1] * late

    def in_contact(name: str, outside: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
        inside = np.interp(time, history.times, getattr(history, name))
        return np.where(early < 0.0, outside[0], np.where(late > 0.0, outside[1], inside))

    def always(name: str) -> FloatArray:
        return in_contact(name, (getattr(before, name), getattr(after, name)))

    return Motion(
        time=time,
        x=moved("v_x"),
        height=-before.v_y * early - after.v_y * late,
        compression=in_contact("y"),
        core_turned=moved("omega_1"),
        shell_turned=moved("omega_2"),
        normal_force=in_contact("normal_force"),
        friction_force=in_contact("friction_force"),
        slip=in_contact("slip"),
        v_x=always("v_x"),
        v_y=always("v_y"),
        omega_1=always("omega_1"),
        omega_2=always("omega_2"),
        state=tuple(_state(history, at) for at in time.tolist()),
        slowed=slowed,
    )


def _state(history: History, time: float) -> str:
    if not 0.0 <= time <= history.contact_time:
        return IN_FLIGHT
    return next((PHASE_SYMBOL[span.phase] for span in history.spans if time <= span.end), IN_CONTACT)


def phase_of(state: str) -> Phase | None:
    """The phase that a state names; None for others."""
    return next((phase for phase, symbol in PHASE_SYMBOL.items() if symbol == state), None)


def _round(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda digit: abs(math.log(value / (digit * power))))
