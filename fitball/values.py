"""The two values that all rooms share: a ball, and the states of incident balls.

They are here, beside `errors`, because tables and scenes (`data`) and solvers (`models`) both need them and do not
import each other.
"""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitball.errors import ParameterError

FloatArray = NDArray[np.float64]

# Wang's balls as the thesis describes them: 0.127 lb and 1.3 in (Jafri 2004, Appendix B); the
# inertia from its bifilar test (Table 8), I/(M R^2) = 0.56, agrees with thick-shell theory.
WANG_MASS = 0.0576
WANG_RADIUS = 0.03302
WANG_INERTIA_RATIO = 0.56
# Beyond any ball, and far from where products of masses and lengths overflow or vanish.
SMALLEST, LARGEST = 1e-30, 1e6
# Quotients are told apart from infinity below this; numbers of tables times it are doubles still.
FARTHEST = 1e150


def numbers(name: str, values: ArrayLike) -> FloatArray:
    """`values` as float64, NaN where they are masked. Raises ParameterError for what are no numbers."""
    try:
        if isinstance(values, np.ma.MaskedArray):
            return np.ma.filled(values.astype(np.float64), np.nan)
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"{name}: read {reprlib.repr(values)}, expected a number or an array of them") from None


def quotient(top: ArrayLike, bottom: ArrayLike) -> FloatArray:
    """`top / bottom`: infinite with its sign where it is beyond FARTHEST, as over zero. NaN for zero by zero and
    infinity by infinity; nothing overflows.
    """
    above, below = np.asarray(top, dtype=np.float64), np.asarray(bottom, dtype=np.float64)
    far = np.abs(above) > np.abs(below) * FARTHEST
    result = np.where(far, np.copysign(np.inf, above) * np.copysign(1.0, below), np.nan)
    return np.divide(above, below, out=result, where=~far & (np.abs(below) > 0.0) & np.isfinite(above))


def same(one: object, other: object) -> bool:
    """Whether two frozen values are equal through and through: arrays number by number, NaN to NaN."""
    if is_dataclass(one) and not isinstance(one, type):
        if type(one) is not type(other):
            return False
        return all(same(getattr(one, item.name), getattr(other, item.name)) for item in fields(one) if item.compare)
    if isinstance(one, np.ndarray):
        kind = one.dtype.kind
        return isinstance(other, np.ndarray) and np.array_equal(one, other, equal_nan=kind in "fc")
    if isinstance(one, Mapping):
        if not isinstance(other, Mapping) or one.keys() != other.keys():
            return False
        return all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, tuple | list):
        return isinstance(other, type(one)) and len(one) == len(other) and all(map(same, one, other))
    return bool(one == other)


@dataclass(frozen=True)
class Ball:
    """A tennis ball: `mass` [kg], outer `radius` [m], central moment of `inertia` [kg m^2].

    Raises ParameterError for values that are not positive and finite, or absurd. Too large is an inertia above
    that of a ring of the same mass and radius.
    """

    mass: float = WANG_MASS
    radius: float = WANG_RADIUS
    inertia: float = WANG_INERTIA_RATIO * WANG_MASS * WANG_RADIUS**2

    def __post_init__(self) -> None:
        for name in ("mass", "radius", "inertia"):
            value = getattr(self, name)
            if not (isinstance(value, Real) and SMALLEST <= value <= LARGEST):  # type: ignore[operator]
                raise ParameterError(
                    f"ball {name} = {value!r}: expected a number from {SMALLEST:g} to {LARGEST:g}, in SI units"
                )
        if self.inertia > self.mass * self.radius**2:
            raise ParameterError(
                f"ball inertia = {self.inertia:g} kg m^2 exceeds M R^2 = {self.mass * self.radius**2:g}: "
                "no body of that mass and radius has it; check the units (SI)"
            )

    @property
    def inertia_ratio(self) -> float:
        """I/(M R^2), dimensionless."""
        return self.inertia / (self.mass * self.radius**2)


@dataclass(frozen=True, eq=False)
class Impacts:
    """Incident states, one entry per impact, all of shape (impacts,).

    `v_x1` [m/s] along the court, `v_y1` [m/s] towards the court (positive), `omega_1` [rad/s] with
    topspin positive. `cor` is each impact's own measured coefficient of restitution, needed only by
    the closure `cor="measured"`. Raises ParameterError on NaN, on unequal lengths, on `v_y1 <= 0`.
    """

    v_x1: FloatArray
    v_y1: FloatArray
    omega_1: FloatArray
    cor: FloatArray | None = field(default=None)

    def __post_init__(self) -> None:
        names = ["v_x1", "v_y1", "omega_1"] + (["cor"] if self.cor is not None else [])
        for name in names:
            array = np.array(numbers(name, getattr(self, name)), ndmin=1)
            if array.ndim != 1:
                raise ParameterError(f"{name} has shape {array.shape}: expected one value per impact")
            bad = np.flatnonzero(~np.isfinite(array))
            if bad.size:
                raise ParameterError(f"{name}[{bad[0]}] = {array[bad[0]]}: expected finite numbers")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        lengths = {name: getattr(self, name).shape[0] for name in names}
        if len(set(lengths.values())) != 1:
            raise ParameterError(f"incident columns differ in length: {lengths}")
        slow = np.flatnonzero(self.v_y1 <= 0.0)
        if slow.size:
            raise ParameterError(
                f"v_y1[{slow[0]}] = {self.v_y1[slow[0]]}: expected a positive speed towards the court"
            )

    def __len__(self) -> int:
        return int(self.v_x1.shape[0])

    def __eq__(self, other: object) -> bool:
        return same(self, other) if isinstance(other, Impacts) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.v_x1.tobytes(), self.v_y1.tobytes(), self.omega_1.tobytes()))

    @staticmethod
    def polar(
        speed: FloatArray | float, angle: FloatArray, omega_1: FloatArray, cor: FloatArray | None = None
    ) -> Impacts:
        """Impacts at a speed [m/s] and an angle to the court [rad], above pi/2 against the direction of x."""
        return Impacts(speed * np.cos(angle), speed * np.sin(angle), omega_1, cor)

    @property
    def speed(self) -> FloatArray:
        """Speed of flight [m/s], (impacts,)."""
        return np.asarray(np.hypot(self.v_x1, self.v_y1))

    @property
    def angle(self) -> FloatArray:
        """Between the velocity and the court [rad], 0 to pi, (impacts,)."""
        return np.asarray(np.arctan2(self.v_y1, self.v_x1))

    def take(self, rows: NDArray[np.int64]) -> Impacts:
        """The impacts with these row numbers."""
        cor = None if self.cor is None else self.cor[rows]
        return Impacts(self.v_x1[rows], self.v_y1[rows], self.omega_1[rows], cor)

    def states(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
        """`(v_x1, v_y1, omega_1, cor)` as rows (1, impacts) that all draws of parameters share."""
        return self.v_x1[None], self.v_y1[None], self.omega_1[None], None if self.cor is None else self.cor[None]


@dataclass(frozen=True)
class OwnImpacts:
    """Incident states of which every draw of parameters has its own: all (draws, impacts), otherwise as `Impacts`."""

    v_x1: FloatArray
    v_y1: FloatArray
    omega_1: FloatArray
    cor: FloatArray | None = field(default=None)

    def __post_init__(self) -> None:
        for name in ("v_x1", "v_y1", "omega_1") + (("cor",) if self.cor is not None else ()):
            array = np.ascontiguousarray(getattr(self, name), dtype=np.float64)
            if array.shape != self.v_x1.shape or array.ndim != 2:
                raise ParameterError(f"{name} has shape {array.shape}: expected (draws, impacts)")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        # Written so that NaN is refused too.
        if not np.all(self.v_y1 > 0.0):
            raise ParameterError("v_y1 has a speed that is not towards the court")

    def __len__(self) -> int:
        return int(self.v_x1.shape[1])

    def take(self, rows: NDArray[np.int64]) -> OwnImpacts:
        """Of every draw the impacts with these row numbers."""
        cor = None if self.cor is None else self.cor[:, rows]
        return OwnImpacts(self.v_x1[:, rows], self.v_y1[:, rows], self.omega_1[:, rows], cor)

    def among(self, draws: NDArray[np.int64], rows: NDArray[np.int64]) -> OwnImpacts:
        """Single impacts (pairs, 1): of each of `draws` that with the row number beside it."""
        cor = None if self.cor is None else self.cor[draws, rows, None]
        return OwnImpacts(
            self.v_x1[draws, rows, None], self.v_y1[draws, rows, None], self.omega_1[draws, rows, None], cor
        )

    def of_draws(self, draws: NDArray[np.int64]) -> OwnImpacts:
        """The impacts of some of the draws."""
        cor = None if self.cor is None else self.cor[draws]
        return OwnImpacts(self.v_x1[draws], self.v_y1[draws], self.omega_1[draws], cor)

    def states(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray | None]:
        """`(v_x1, v_y1, omega_1, cor)`, each (draws, impacts)."""
        return self.v_x1, self.v_y1, self.omega_1, self.cor


def impacts(v_x1: ArrayLike, v_y1: ArrayLike, omega_1: ArrayLike = 0.0, cor: ArrayLike | None = None) -> Impacts:
    """Make impacts from numbers or arrays in SI units (m/s, m/s, rad/s); single numbers are broadcast.

    Raises ParameterError as `Impacts` does, and when the shapes cannot be broadcast to one length.

    >>> len(fitball.impacts(v_x1=15.0, v_y1=[6.0, 8.0]))
    2
    """
    given = {"v_x1": v_x1, "v_y1": v_y1, "omega_1": omega_1} | ({"cor": cor} if cor is not None else {})
    try:
        arrays = np.broadcast_arrays(*[numbers(name, value) for name, value in given.items()])
    except ValueError as error:
        raise ParameterError(f"impacts: {error}") from None
    return Impacts(*[np.array(array, dtype=np.float64, ndmin=1) for array in arrays])
