"""Numbers that carry a derivative, so that one kernel gives values and, called with these, derivatives.

A complex step (Squire and Trapp 1998): an input `x` becomes `x + i STEP`; the imaginary part of whatever is computed
from it is its derivative times `STEP`, and nothing is subtracted. `STEP` squared is nothing beside any real part, so
first order is all that the functions below need; of a float they are those of `math`, at no cost. Branches look at
real parts. Numbers of `gradient` carry several derivatives at once in the same way.
"""

from __future__ import annotations

import math
from typing import Any, TypeVar

from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from fitball.models.kernels.compiled import inner
from fitball.models.kernels.vectors import operation

# Nothing beside the rounding of a real part, even squared and times a condition number of 1e40; far from underflow.
STEP = 1e-60

Number = TypeVar("Number", float, complex)
# An array of either kind.
NumberArray = NDArray[Any]


def carry(value: float, x: Number, slope: float) -> Number:
    """A function's `value` at the real part of `x` with what `x` carries, times the slope of the function there."""
    carried: Number = _carried(value, x, slope) if isinstance(x, complex) else value  # type: ignore[redundant-expr]
    return carried


def _carried(value: Any, x: Any, slope: Any) -> Any:
    return complex(value, slope * x.imag)


def _carry_compiled(value: Any, x: Any, slope: Any) -> Any:  # noqa: ARG001 - numba asks for one signature
    """What `carry` compiles to for complex numbers."""
    return _carried if isinstance(x, types.Complex) else None


_overload: Any = overload
_overload(carry, jit_options={"error_model": "numpy"})(_carry_compiled)
operation(carry, types.Float, [(types.Float,) * 3], types.float64, lambda _builder, value, _x, _slope: value)


def choose(condition: bool, x: float, y: float) -> float:
    """`x` where the condition holds, else `y`."""
    return x if condition else y


_doubles = (types.Boolean, types.Float, types.Float)
operation(choose, types.Boolean, [_doubles], types.float64, lambda builder, *given: builder.select(*given))


@inner
def magnitude(x: Number) -> Number:
    """`|x|`."""
    return carry(abs(x.real), x, choose(x.real < 0.0, -1.0, 1.0))


@inner
def exp(x: Number) -> Number:
    """Exponential."""
    value = math.exp(x.real)
    return carry(value, x, value)


@inner
def log(x: Number) -> Number:
    """Natural logarithm."""
    return carry(math.log(x.real), x, 1.0 / x.real)


@inner
def log1p(x: Number) -> Number:
    """Natural logarithm of `1 + x`."""
    return carry(math.log1p(x.real), x, 1.0 / (1.0 + x.real))


@inner
def sqrt(x: Number) -> Number:
    """Square root; its slope at zero is infinite."""
    value = math.sqrt(x.real)
    return carry(value, x, 0.5 / value)


@inner
def sin(x: Number) -> Number:
    """Sine."""
    return carry(math.sin(x.real), x, math.cos(x.real))


@inner
def cos(x: Number) -> Number:
    """Cosine."""
    return carry(math.cos(x.real), x, -math.sin(x.real))


@inner
def sinh(x: Number) -> Number:
    """Hyperbolic sine."""
    return carry(math.sinh(x.real), x, math.cosh(x.real))


@inner
def cosh(x: Number) -> Number:
    """Hyperbolic cosine."""
    return carry(math.cosh(x.real), x, math.sinh(x.real))
