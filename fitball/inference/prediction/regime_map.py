"""Which sequence of slip and grip an impact goes through, over angle and spin at one speed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitball.errors import ModelError
from fitball.inference.prediction.engine_fit import refuse_told
from fitball.inference.results.fitted_model import FittedModel
from fitball.models.types import Rebound, regime_name
from fitball.observables import OBSERVABLES
from fitball.values import FloatArray, Impacts

# Points along angle and along spin: a point a pixel of the figure.
ANGLES, SPINS = 640, 480
# What an impact without a solution has for a sequence; no packed sequence is zero.
NONE = 0
# Points along the angle from which the ends of the sequences at one spin are narrowed down, and halvings.
SCANNED, HALVINGS = 2001, 40


@dataclass(frozen=True)
class Window:
    """What a map shows: one incident `speed` [m/s], and the range of `angle` [rad] and of `spin` [rad/s]."""

    speed: float
    angle: tuple[float, float]
    spin: tuple[float, float]

    def impacts(self, angle: FloatArray, spin: FloatArray) -> Impacts:
        """Impacts at this speed, of the shape (impacts,) of both."""
        return Impacts.polar(self.speed, angle, spin)

    def grid(self, angles: int, spins: int) -> tuple[FloatArray, FloatArray]:
        """The middles of equal cells, angles (angles,) [rad] and spins (spins,) [rad/s]."""
        cells = []
        for (low, high), count in ((self.angle, angles), (self.spin, spins)):
            cells.append(low + (high - low) * (np.arange(count) + 0.5) / count)
        return cells[0], cells[1]


@dataclass(frozen=True)
class RegimeMap:
    """Sequences over angle and spin: `regime` (spins, angles) packed (`NONE`: no solution, for the reason `status`),
    `outputs` by column of the rebound in SI. `along_angle` are the sequences of an impact without spin, each with the
    angles [rad] between which it is passed through.
    """

    window: Window
    angles: FloatArray
    spins: FloatArray
    regime: NDArray[np.int64]
    status: NDArray[np.int8]
    outputs: Mapping[str, FloatArray]
    along_angle: tuple[tuple[str, float, float], ...]

    @property
    def areas(self) -> dict[str, float]:
        """The share of the map that each sequence takes, the largest first; "" has no solution."""
        codes, counts = np.unique(self.regime, return_counts=True)
        order = sorted(zip(codes, counts, strict=True), key=lambda pair: (-pair[1], pair[0]))
        return {regime_name(code): float(count) / self.regime.size for code, count in order}


def regime_map(fitted: FittedModel, window: Window) -> RegimeMap:
    """The map at the point estimate.

    Raises ModelError for a model that follows no motion along the court, or is told each impact's restitution.
    """
    if not fitted.tangential:
        raise ModelError("a drop test follows no motion along the court: there are no regimes to map")
    refuse_told(fitted)
    angles, spins = window.grid(ANGLES, SPINS)
    rebound = fitted.rebound(_meshed(window, angles, spins))
    shape = (spins.size, angles.size)
    codes = _codes(rebound)[0].reshape(shape)
    return RegimeMap(
        window=window,
        angles=angles,
        spins=spins,
        regime=codes,
        status=rebound.status[0].reshape(shape),
        outputs={name: column.predict(rebound)[0].reshape(shape) for name, column in OBSERVABLES.items()},
        along_angle=_along_angle(fitted, window),
    )


def _meshed(window: Window, angles: FloatArray, spins: FloatArray) -> Impacts:
    angle, spin = np.meshgrid(angles, spins)
    return window.impacts(angle.ravel(), spin.ravel())


def _codes(rebound: Rebound) -> NDArray[np.int64]:
    codes: NDArray[np.int64] = np.where(rebound.status == 0, rebound.regime, NONE)
    return codes


def _along_angle(fitted: FittedModel, window: Window) -> tuple[tuple[str, float, float], ...]:
    """Sequences without spin, the angles between them found by halving."""

    def codes_at(angle: FloatArray) -> NDArray[np.int64]:
        rebound = fitted.rebound(window.impacts(angle, np.zeros_like(angle)))
        return _codes(rebound).ravel()

    scanned = np.linspace(*window.angle, SCANNED)
    codes = codes_at(scanned)
    changes = np.flatnonzero(codes[1:] != codes[:-1])
    low, high, left = scanned[changes], scanned[changes + 1], codes[changes]
    for _ in range(HALVINGS if changes.size else 0):
        middle = 0.5 * (low + high)
        same = codes_at(middle) == left
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    ends = [*map(float, low), window.angle[1]]
    starts = [window.angle[0], *ends[:-1]]
    names = [regime_name(code) for code in (codes[0], *codes[changes + 1])]
    return tuple(zip(names, starts, ends, strict=True))
