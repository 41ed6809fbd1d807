"""Golden rebounds, how far the outputs of a port are from them, and which familiar mistake would explain it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Golden
from fitball.models.types import regime_name
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts

# Golden impacts.
COUNT = 12
# A mistake explains an output that it reproduces to this share of the incident speed: a thousandth of what the
# smallest of them does (a mile an hour for a knot), and far above the rounding of printed digits.
EXPLAINED = 1e-5
# Differences of single-precision arithmetic: its rounding is 6e-8, and a bounce amplifies it a hundredfold at most.
SINGLE = (1e-8, 1e-5)


def golden_impacts(impacts: Impacts) -> Impacts:
    """Half of them spread over the table; the others inside its range with spins from back to top."""
    rows = np.unique(np.linspace(0, len(impacts) - 1, min(COUNT // 2, len(impacts))).astype(int))
    count = COUNT - rows.size
    share = (np.arange(count) + 0.5) / count

    def across(column: np.ndarray, order: np.ndarray) -> np.ndarray:
        return np.concatenate([column[rows], column.min() + (column.max() - column.min()) * order])

    # Golden-ratio steps cover the square evenly without a random generator.
    other = np.modf(share * count * 0.6180339887498949)[0]
    v_x1, v_y1 = across(impacts.v_x1, other), across(impacts.v_y1, share)
    omega = np.concatenate([impacts.omega_1[rows], np.linspace(-200.0, 400.0, count)])
    if np.ptp(impacts.v_x1) + np.max(np.abs(impacts.v_x1)) <= 0.0:
        omega = np.zeros(COUNT)
    return Impacts(v_x1, v_y1, omega, None if impacts.cor is None else across(impacts.cor, share))


def golden(fitted: FittedModel, impacts: Impacts) -> Golden:
    """Rebounds of those impacts at the point estimate; impacts the model cannot evaluate are left out."""
    chosen = golden_impacts(impacts)
    rebound = fitted.rebound(chosen)
    kept = np.flatnonzero(rebound.status[0] == 0)
    names = dict(zip(fitted.names, map(float, fitted.point), strict=True))
    return Golden(names, chosen.take(kept), rebound.each(lambda array: array[0][kept]))


@dataclass(frozen=True)
class OutputCheck:
    """One output: largest absolute difference [SI], largest relative one, and the impact that has it.

    Relative: speeds to the incident speed `sqrt(v_x1^2 + v_y1^2 + (R omega_1)^2)`, spins times `R` likewise, times to
    themselves, angles [rad] as they are.
    """

    name: str
    absolute: float
    relative: float
    worst: int


@dataclass(frozen=True)
class PortCheck:
    """All golden impacts (in their order): `relative` (impacts,) is the largest over outputs, `regimes` the model's.

    `regimes_wrong` are the impacts whose regime the port names differently; `causes` are likely mistakes, in words.
    """

    outputs: tuple[OutputCheck, ...]
    relative: FloatArray
    regimes: tuple[str, ...]
    regimes_wrong: tuple[int, ...]
    causes: tuple[str, ...]
    tolerance: float

    @property
    def failed(self) -> NDArray[np.bool_]:
        """Which impacts fail, (impacts,)."""
        failed = ~(self.relative <= self.tolerance)
        failed[list(self.regimes_wrong)] = True
        return failed

    @property
    def passed(self) -> bool:
        """Whether no impact fails."""
        return not bool(np.any(self.failed))


def expected_outputs(fitted: FittedModel, golden: Golden) -> dict[str, FloatArray]:
    """Every output of the golden impacts, (impacts,), in SI; no contact time for a model without."""
    return {
        name: np.asarray(column.predict(golden.rebound), dtype=np.float64)
        for name, column in OBSERVABLES.items()
        if fitted.model.has_time or not column.timed
    }


def check_port(
    fitted: FittedModel,
    golden: Golden,
    outputs: Mapping[str, FloatArray],
    regimes: tuple[str, ...] | None,
    tolerance: float,
) -> PortCheck:
    """Compare `outputs` (impacts,), in SI and in the order of the golden impacts, with what the model gives."""
    expected = expected_outputs(fitted, golden)
    scales = _scales(fitted, golden, expected)
    errors = {name: np.abs(values - expected[name]) for name, values in outputs.items()}
    relative = {name: errors[name] / scales[name] for name in errors}
    checks = tuple(
        OutputCheck(name, float(errors[name].max()), float(relative[name].max()), int(np.argmax(relative[name])))
        for name in errors
    )
    names = tuple(regime_name(code) for code in golden.rebound.regime)
    codes = [str(int(code)) for code in golden.rebound.regime]
    said = regimes if regimes is not None else names
    wrong = tuple(k for k, text in enumerate(said) if text not in (names[k], codes[k]))
    largest = np.max(np.stack(list(relative.values())), axis=0)
    causes: tuple[str, ...] = ()
    if largest.max() > tolerance:
        causes = _causes(fitted, golden, outputs, expected, scales, tolerance)
        if not causes and SINGLE[0] < largest.max() < SINGLE[1]:
            causes = ("differences of this size are those of single precision (float): use double throughout",)
    return PortCheck(checks, largest, names, wrong, causes, tolerance)


def _scales(fitted: FittedModel, golden: Golden, expected: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    given, radius = golden.impacts, fitted.ball.radius
    speed = np.sqrt(given.v_x1**2 + given.v_y1**2 + (radius * given.omega_1) ** 2)
    by_unit = {"m/s": speed, "rad/s": speed / radius, "rad": np.ones_like(speed)}
    return {name: by_unit.get(OBSERVABLES[name].unit, values) for name, values in expected.items()}


Change = Callable[[Impacts], Impacts]


def _spin(factor: float, given: Impacts) -> Impacts:
    return Impacts(given.v_x1, given.v_y1, factor * given.omega_1, given.cor)


# What may be done to the incident state before the port sees it, likeliest first.
_INCIDENT: tuple[tuple[str, Change], ...] = (
    ("", lambda given: given),
    ("the incident spin has the other sign (topspin is positive)", partial(_spin, -1.0)),
    ("the incident spin is not used", partial(_spin, 0.0)),
    ("the incident spin in rad/s was taken for rpm", partial(_spin, math.pi / 30.0)),
    ("the incident spin was turned into rpm; rad/s was expected", partial(_spin, 30.0 / math.pi)),
)
# What may be done to an output: `port = factor * expected`.
_OUTPUT: tuple[tuple[str, float, tuple[str, ...]], ...] = (
    ("{} has the other sign: it is positive away from the court", -1.0, ("v_y2",)),
    ("{} has the other sign: topspin is positive", -1.0, ("omega_2",)),
    ("{} has the other sign", -1.0, ("v_x2", "theta_2")),
    ("{} is in rpm: divide by 9.549, or write 'omega_2 [rpm]'", 30.0 / math.pi, ("omega_2",)),
    ("{} was turned from rpm into rad/s once too often", math.pi / 30.0, ("omega_2",)),
    ("{} is in degrees a second: write 'omega_2 [deg/s]'", 180.0 / math.pi, ("omega_2",)),
    ("{} is in rpm and has the other sign: topspin is positive", -30.0 / math.pi, ("omega_2",)),
    ("{} is in radians: write 'theta_2 [rad]'", math.pi / 180.0, ("theta_2",)),
    ("{} is in degrees", 180.0 / math.pi, ("theta_2",)),
    ("{} is in milliseconds: write 'contact_time [ms]'", 1e3, ("contact_time",)),
    ("{} is in km/h: write the unit behind its name", 3.6, ("v_x2", "v_y2", "v_2")),
    ("{} is in mph: write the unit behind its name", 1.0 / 0.44704, ("v_x2", "v_y2", "v_2")),
)


def _causes(
    fitted: FittedModel,
    golden: Golden,
    outputs: Mapping[str, FloatArray],
    expected: Mapping[str, FloatArray],
    scales: Mapping[str, FloatArray],
    tolerance: float,
) -> tuple[str, ...]:
    """The mistakes that explain every output, fewest first; those that explain some, if none explains all."""
    best: tuple[str, ...] = ()
    most = -1
    level = max(EXPLAINED, tolerance)
    for words, change in _INCIDENT:
        made = expected
        if words:
            there = fitted.rebound(change(golden.impacts))
            made = {name: OBSERVABLES[name].predict(there)[0] for name in expected}
        reasons = [_reason(name, values, made[name], scales[name], level) for name, values in outputs.items()]
        if all(reason is not None for reason in reasons):
            return tuple(dict.fromkeys([*([words] if words else []), *(reason for reason in reasons if reason)]))
        explained = [reason for reason in reasons if reason]
        if not words and len(explained) > most:
            best, most = tuple(explained), len(explained)
    return best


def _reason(name: str, port: FloatArray, made: FloatArray, scale: FloatArray, level: float) -> str | None:
    """Why an output is as it is: "" if it is right, None if nothing familiar explains it."""
    if np.max(np.abs(port - made) / scale) <= level:
        return ""
    # Zeros would agree with zeros in any unit and of any sign.
    if np.max(np.abs(made) / scale) <= level:
        return None
    for words, factor, names in _OUTPUT:
        if name in names and np.max(np.abs(port - factor * made) / (scale * max(1.0, abs(factor)))) <= level:
            return words.format(name)
    return None
