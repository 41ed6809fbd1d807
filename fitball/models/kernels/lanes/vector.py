"""A number type for kernels that holds `WIDTH` doubles side by side, and one that holds as many truths.

A condition is a `Mask`: `choose` takes the place of `if`, `any_of` asks whether a branch is needed at all.
"""

from __future__ import annotations

import math
import operator
from typing import Any, TypeAlias

from llvmlite import ir
from numba import types
from numba.core.imputils import lower_getattr
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import models, register_model

from fitball.models.kernels.dual import carry, choose
from fitball.models.kernels.vectors import (
    DOUBLES,
    SCALARS,
    WIDTH,
    Emit,
    VectorModel,
    VectorType,
    array_view,
    intrinsic,
    operation,
    spread,
    with_scalars,
)

# To a checker lanes are any number, and a mask any truth.
Lanes: TypeAlias = Any
Mask: TypeAlias = Any
LaneArray: TypeAlias = Any

WORDS = ir.VectorType(ir.IntType(64), WIDTH)
TRUTHS = ir.VectorType(ir.IntType(1), WIDTH)


class LanesType(VectorType):
    """The type of `WIDTH` doubles, each a number of its own."""

    def __init__(self) -> None:
        super().__init__(name=f"lanes{WIDTH}")


class MaskType(types.Type):
    """The type of `WIDTH` truths."""

    def __init__(self) -> None:
        super().__init__(name=f"mask{WIDTH}")


lanes_type, mask_type = LanesType(), MaskType()
lane_array = array_view(lanes_type)
register_model(LanesType)(VectorModel)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, TRUTHS)


def in_lanes(builder: Any, number: Any) -> Any:
    """A double or lanes as lanes."""
    return number if number.type == DOUBLES else spread(builder, number)


def call(builder: Any, name: str, *values: Any) -> Any:
    """LLVM's intrinsic function on doubles in lanes."""
    kind = ir.FunctionType(DOUBLES, [DOUBLES] * len(values))
    function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
    return builder.call(function, values)


def _of_two(function: Any, result: Any, emit: Emit) -> None:
    def in_lanes_both(builder: Any, x: Any, y: Any) -> Any:
        return emit(builder, in_lanes(builder, x), in_lanes(builder, y))

    operation(function, LanesType, with_scalars(LanesType), result, in_lanes_both)


for _name, _functions in {
    "fadd": (operator.add, operator.iadd),
    "fsub": (operator.sub, operator.isub),
    "fmul": (operator.mul, operator.imul),
    "fdiv": (operator.truediv,),
}.items():
    for _function in _functions:
        _of_two(_function, lanes_type, lambda builder, x, y, _name=_name: getattr(builder, _name)(x, y))
for _sign, _function in {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}.items():
    _of_two(_function, mask_type, lambda builder, x, y, _sign=_sign: builder.fcmp_ordered(_sign, x, y))
for _sign, _function in {"<": min, ">": max}.items():
    _of_two(
        _function,
        lanes_type,
        lambda builder, x, y, _sign=_sign: builder.select(builder.fcmp_ordered(_sign, x, y), x, y),
    )
_of_one: dict[Any, Emit] = {
    operator.neg: lambda builder, x: builder.fneg(x),
    abs: lambda builder, x: call(builder, f"llvm.fabs.v{WIDTH}f64", x),
    math.sqrt: lambda builder, x: call(builder, f"llvm.sqrt.v{WIDTH}f64", x),
}
for _function, _emit in _of_one.items():
    operation(_function, LanesType, [(LanesType,)], lanes_type, _emit)
for _function in (operator.and_, operator.iand):
    operation(_function, MaskType, [(MaskType,) * 2], mask_type, lambda builder, x, y: builder.and_(x, y))
for _function in (operator.or_, operator.ior):
    operation(_function, MaskType, [(MaskType,) * 2], mask_type, lambda builder, x, y: builder.or_(x, y))
_numbers = (LanesType, *SCALARS)
operation(
    choose,
    MaskType,
    [(MaskType, first, second) for first in _numbers for second in _numbers],
    lanes_type,
    lambda builder, mask, x, y: builder.select(mask, in_lanes(builder, x), in_lanes(builder, y)),
)
operation(carry, LanesType, [(LanesType,) * 3], lanes_type, lambda _builder, value, _x, _slope: value)
operation(operator.invert, MaskType, [(MaskType,)], mask_type, lambda builder, x: builder.not_(x))


@infer_getattr
class _RealPart(AttributeTemplate):
    key = LanesType

    def resolve_real(self, kind: Any) -> Any:
        """Lanes are real numbers."""
        return kind


lower_getattr(LanesType, "real")(lambda _context, _builder, _kind, value: value)


@intrinsic
def spread_lanes(_typing: Any, _x: Any) -> Any:
    """A double in every lane."""
    return lanes_type(types.float64), lambda _context, builder, _sig, args: spread(builder, args[0])


@intrinsic
def any_of(_typing: Any, mask: Any) -> Any:
    """Whether a mask holds anywhere."""
    word = ir.IntType(WIDTH)

    def emit(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        return builder.icmp_unsigned("!=", builder.bitcast(args[0], word), ir.Constant(word, 0))

    return types.boolean(mask), emit


@intrinsic
def largest(_typing: Any, x: Any) -> Any:
    """The largest of the lanes; NaN is passed over."""

    def emit(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        name = f"llvm.vector.reduce.fmax.v{WIDTH}f64"
        kind = ir.FunctionType(ir.DoubleType(), [DOUBLES])
        return builder.call(builder.module.globals.get(name) or ir.Function(builder.module, kind, name), args)

    return types.float64(x), emit
