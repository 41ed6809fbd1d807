"""The two values that all rooms share, a ball and states of incident balls, and names of types."""

from __future__ import annotations

import reprlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitball.base.errors import ParameterError

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
if TYPE_CHECKING:
    from matplotlib.figure import Figure as Figure
    from pandas import DataFrame as DataFrame
else:
    # Neither package is imported for a name in a signature.
    Figure = DataFrame = Any

# Least constant of a ball: far below any, and far from where products of masses and lengths vanish.
_SMALLEST = 1e-30
# Largest: far above any, and far from where such products overflow.
_LARGEST = 1e6


@dataclass(frozen=True)
class Ball:
    """A ball: `mass` [kg], outer `radius` [m], and `inertia_ratio`, moment of inertia over M R^2.

    The defaults are Wang's balls: 0.127 lb and 1.3 in (Jafri 2004, Appendix B), and the inertia of
    the bifilar test (Table 8). Fits take 0.54 where their scene states none (`Scene.ball_value`).

    Raises:
        ParameterError: a constant is no positive number of a possible size (`ball`).

    Example:
        >>> import fitball
        >>> fitball.Ball(mass=0.058)
        Ball(mass=0.058, radius=0.03302, inertia_ratio=0.56)
    """

    mass: float = 0.0576
    radius: float = 0.03302
    inertia_ratio: float = 0.56

    def __post_init__(self) -> None:
        # No body has more inertia than a ring of its mass and radius.
        for name, largest in (("mass", _LARGEST), ("radius", _LARGEST), ("inertia_ratio", 1.0)):
            value = getattr(self, name)
            if not isinstance(value, int | float) or not _SMALLEST <= value <= largest:
                wanted = (
                    f"expected a number above 0 and at most {largest:g}, in SI "
                    "(inertia_ratio is I/(M R^2))"
                )
                raise ParameterError(f"ball: read {name} = {reprlib.repr(value)}; {wanted}", "ball")


@dataclass(frozen=True, eq=False)
class Impacts:
    """Incident states: `v_x1` [m/s] along the court, `v_y1` [m/s] towards it (positive), `omega_1`
    [rad/s], topspin positive. All (impacts,), or (draws, impacts) where every draw of parameters
    has states of its own.

    Unchecked: a camera or an error may make `v_y1 <= 0`, which has no answer; `impacts()` refuses
    it.

    Example:
        >>> import fitball
        >>> len(fitball.impacts([16.0, 14.0], [5.8, 7.0]))
        2
    """

    v_x1: FloatArray
    v_y1: FloatArray
    omega_1: FloatArray

    def __len__(self) -> int:
        return int(self.v_x1.shape[-1])

    def polar(self) -> tuple[FloatArray, FloatArray]:
        """Speed [m/s], and angle between velocity and court [rad], 0 to pi, each shaped as `v_x1`.

        Example:
            >>> import fitball
            >>> speed, angle = fitball.impacts(3.0, 4.0).polar()
            >>> float(speed[0]), round(float(angle[0]), 3)
            (5.0, 0.927)
        """
        return np.hypot(self.v_x1, self.v_y1), np.arctan2(self.v_y1, self.v_x1)

    @property
    def side(self) -> FloatArray:
        """To which side each ball flies, 1 towards positive v_x and -1 towards negative v_x; of one
        that falls straight down the sign of its spin, and 1 without spin. Shaped as `v_x1`.

        Example:
            >>> import fitball
            >>> fitball.impacts([16.0, -14.0, 0.0], 5.0).side.tolist()
            [1.0, -1.0, 1.0]
        """
        falls = self.v_x1 == 0.0
        backwards = (self.v_x1 < 0.0) | (falls & (self.omega_1 < 0.0))
        return np.where(backwards, -1.0, 1.0)

    @property
    def forwards(self) -> Impacts:
        """The impacts, and the mirror images of those whose `side` is -1.

        Example:
            >>> import fitball
            >>> mirrored = fitball.impacts(-14.0, 5.0, 20.0).forwards
            >>> float(mirrored.v_x1[0]), float(mirrored.omega_1[0])
            (14.0, -20.0)
        """
        side = self.side
        return Impacts(side * self.v_x1, self.v_y1, side * self.omega_1)

    def moved(self, errors: Annotated[FloatArray, "... impacts 3"]) -> Impacts:
        """The impacts with errors added to `v_x1` and `v_y1` [m/s] and `omega_1` [rad/s].

        Example:
            >>> import fitball
            >>> import numpy as np
            >>> moved = fitball.impacts(16.0, 5.0).moved(np.array([[0.5, 0.0, 0.0]]))
            >>> float(moved.v_x1[0])
            16.5
        """
        return Impacts(
            self.v_x1 + errors[..., 0],
            self.v_y1 + errors[..., 1],
            self.omega_1 + errors[..., 2],
        )

    def take(self, rows: Annotated[IntArray, "rows"]) -> Impacts:
        """The impacts with these row numbers, of every draw.

        Example:
            >>> import fitball
            >>> import numpy as np
            >>> fitball.impacts([16.0, 14.0], 5.0).take(np.array([1])).v_x1.tolist()
            [14.0]
        """
        return Impacts(self.v_x1[..., rows], self.v_y1[..., rows], self.omega_1[..., rows])


def impacts(v_x1: ArrayLike, v_y1: ArrayLike, omega_1: ArrayLike = 0.0) -> Impacts:
    """Impacts from numbers or arrays (impacts,) in SI: `v_x1` and `v_y1` [m/s], `omega_1` [rad/s];
    a single number holds for all.

    Raises:
        ParameterError: NaN or infinity, unequal lengths, or `v_y1 <= 0` (`impacts`).

    Example:
        >>> import fitball
        >>> fitball.impacts([16.0, 14.0], [5.8, 7.0]).omega_1.tolist()
        [0.0, 0.0]
    """
    columns = {"v_x1": v_x1, "v_y1": v_y1, "omega_1": omega_1}
    arrays = {name: _numbers(name, values) for name, values in columns.items()}
    shapes = {name: array.shape for name, array in arrays.items()}
    lengths = {array.size for array in arrays.values()} - {1}
    if len(lengths) > 1 or any(len(shape) > 1 for shape in shapes.values()):
        raise ParameterError(
            f"impacts: read shapes {shapes}; expected one number for each impact",
            "impacts",
        )
    v_x, v_y, omega = (
        np.array(array) for array in np.broadcast_arrays(*map(np.atleast_1d, arrays.values()))
    )
    return Impacts(v_x, v_y, omega)


def _numbers(name: str, values: ArrayLike) -> FloatArray:
    """The values of a column as an array of finite numbers, of `v_y1` positive ones; what is masked
    is missing.
    """
    try:
        array = np.ma.filled(np.ma.asarray(values, dtype=np.float64), np.nan)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(
            f"{name}: read {reprlib.repr(values)}; expected numbers",
            "impacts",
        ) from None
    good = np.isfinite(array) & ((name != "v_y1") | (array > 0.0))
    for impact in np.flatnonzero(~good)[:1]:
        wanted = "a positive speed towards the court" if name == "v_y1" else "a finite number"
        raise ParameterError(
            f"{name}: read {array.flat[impact]} for impact {impact + 1}; expected {wanted}",
            "impacts",
        )
    return array
