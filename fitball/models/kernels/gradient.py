"""A number type for kernels that holds a value and its slopes along `SLOPES` directions: forward differentiation.

Its formulas are those of complex numbers whose imaginary part is a slope (see `dual`), along all directions at once:
one vector, the value in front, the slopes behind it. A slope is held times `dual.STEP` so that both ways round alike.
Branches look at `x.real`, the value.
"""

# mypy: allow-untyped-calls
from __future__ import annotations

import operator
from typing import Any, TypeAlias

from llvmlite import ir
from numba import types
from numba.core.imputils import lower_cast, lower_getattr
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import register_model

from fitball.models.kernels.dual import carry
from fitball.models.kernels.vectors import (
    DOUBLES,
    PLACES,
    SCALARS,
    WIDTH,
    VectorModel,
    VectorType,
    array_view,
    is_scalar,
    operation,
    spread,
    with_scalars,
)

SLOPES = WIDTH - 1
# To a checker a gradient is any number.
Gradient: TypeAlias = Any
GradientArray: TypeAlias = Any

FRONT = ir.Constant(ir.IntType(32), 0)
# A value from a second vector, slopes from a first.
VALUE_OF_SECOND = ir.Constant(PLACES, [WIDTH, *range(1, WIDTH)])
EVERYWHERE_FRONT = ir.Constant(PLACES, [0] * WIDTH)


class GradientType(VectorType):
    """The type of a number with its slopes."""

    def __init__(self) -> None:
        super().__init__(name=f"gradient{SLOPES}")

    def can_convert_from(self, _typing: Any, other: Any) -> Any:
        """A plain number is one without slopes."""
        return Conversion.safe if is_scalar(other) else None


gradient_type = GradientType()
gradient_array = array_view(gradient_type)
register_model(GradientType)(VectorModel)


def value_of(builder: Any, x: Any) -> Any:
    """The value of a gradient, as a double."""
    return builder.extract_element(x, FRONT)


def with_value(builder: Any, value: Any, slopes: Any) -> Any:
    """The value of the one and the slopes of the other gradient."""
    return builder.shuffle_vector(slopes, value, VALUE_OF_SECOND)


def as_gradient(builder: Any, number: Any) -> Any:
    """A double or a gradient as a gradient."""
    if number.type == DOUBLES:
        return number
    return builder.insert_element(ir.Constant(DOUBLES, [0.0] * WIDTH), number, FRONT)


def times(builder: Any, x: Any, y: Any) -> Any:
    """`x y`."""
    if x.type != y.type:
        return builder.fmul(*(number if number.type == DOUBLES else spread(builder, number) for number in (x, y)))
    straight = builder.fmul(builder.shuffle_vector(x, x, EVERYWHERE_FRONT), y)
    crossed = builder.fmul(x, builder.shuffle_vector(y, y, EVERYWHERE_FRONT))
    return with_value(builder, straight, builder.fadd(straight, crossed))


def over(builder: Any, x: Any, y: Any) -> Any:
    """`x/y`."""
    if y.type != DOUBLES:
        return builder.fdiv(x, spread(builder, y))
    x = as_gradient(builder, x)
    below = builder.shuffle_vector(y, y, EVERYWHERE_FRONT)
    lost = builder.fmul(builder.shuffle_vector(x, x, EVERYWHERE_FRONT), builder.fdiv(y, below))
    return builder.fdiv(with_value(builder, x, builder.fsub(x, lost)), below)


def plus(builder: Any, x: Any, y: Any) -> Any:
    """`x + y`."""
    return builder.fadd(as_gradient(builder, x), as_gradient(builder, y))


def minus(builder: Any, x: Any, y: Any) -> Any:
    """`x - y`."""
    return builder.fsub(as_gradient(builder, x), as_gradient(builder, y))


def carried(builder: Any, value: Any, x: Any, slope: Any) -> Any:
    """See `dual.carry`."""
    return builder.insert_element(builder.fmul(spread(builder, slope), x), value, FRONT)


for _emit, _functions in {
    plus: (operator.add, operator.iadd),
    minus: (operator.sub, operator.isub),
    times: (operator.mul, operator.imul),
    over: (operator.truediv, operator.itruediv),
}.items():
    for _function in _functions:
        operation(_function, GradientType, with_scalars(GradientType), gradient_type, _emit)
operation(operator.neg, GradientType, [(GradientType,)], gradient_type, lambda builder, x: builder.fneg(x))
operation(carry, GradientType, [(types.Float, GradientType, types.Float)], gradient_type, carried)


@infer_getattr
class _Value(AttributeTemplate):
    key = GradientType

    def resolve_real(self, _kind: Any) -> Any:
        """The value."""
        return types.float64


lower_getattr(GradientType, "real")(lambda _context, builder, _kind, number: value_of(builder, number))
for _scalar in SCALARS:
    lower_cast(_scalar, GradientType)(
        lambda context, builder, kind, _wanted, number: as_gradient(
            builder, context.cast(builder, number, kind, types.float64)
        )
    )
