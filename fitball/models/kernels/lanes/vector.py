"""A number type for kernels that holds `WIDTH` doubles, and one that holds as many truths.

Arithmetic and comparisons are LLVM's vector instructions: the compiler cuts them to what a machine has, and each lane
is rounded as a double is. Nothing is contracted into a multiply-add, so that a lane has the same bits on every
machine that computes by IEEE 754. A condition is a `Mask`: `choose` takes the place of `if`, `any_of` asks whether a
branch is needed at all.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, TypeAlias

from llvmlite import ir
from numba import types
from numba.core.imputils import lower_builtin, lower_getattr
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import intrinsic as numba_intrinsic
from numba.extending import models, register_model

from fitball.models.kernels.dual import choose

WIDTH = 8
# To a checker lanes are any number, and a mask any truth.
Lanes: TypeAlias = Any
Mask: TypeAlias = Any
LaneArray: TypeAlias = Any

DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
WORDS = ir.VectorType(ir.IntType(64), WIDTH)
TRUTHS = ir.VectorType(ir.IntType(1), WIDTH)
FIRST = ir.VectorType(ir.IntType(32), WIDTH)


class LanesType(types.Type):
    """The type of `WIDTH` doubles."""

    def __init__(self) -> None:
        super().__init__(name=f"lanes{WIDTH}")


class MaskType(types.Type):
    """The type of `WIDTH` truths."""

    def __init__(self) -> None:
        super().__init__(name=f"mask{WIDTH}")


lanes_type, mask_type = LanesType(), MaskType()


@register_model(LanesType)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, DOUBLES)


@register_model(MaskType)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, TRUTHS)


def intrinsic(function: Callable[..., Any]) -> Any:
    """A function written as instructions; kernels call it without its first argument, numba's typing context."""
    return numba_intrinsic(function)


def constant(kind: Any, value: Any) -> Any:
    """The same constant in every lane."""
    return ir.Constant(kind, [value] * WIDTH)


def spread(builder: Any, scalar: Any) -> Any:
    """One scalar in every lane."""
    nothing = ir.Constant(ir.VectorType(scalar.type, WIDTH), ir.Undefined)
    one = builder.insert_element(nothing, scalar, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, nothing, constant(FIRST, 0))


def as_lanes(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """A value of a number type in lanes."""
    if isinstance(kind, LanesType):
        return value
    return spread(builder, context.cast(builder, value, kind, types.float64))


def call(builder: Any, name: str, *values: Any) -> Any:
    """LLVM's intrinsic function on doubles in lanes."""
    kind = ir.FunctionType(DOUBLES, [DOUBLES] * len(values))
    function = builder.module.globals.get(name) or ir.Function(builder.module, kind, name)
    return builder.call(function, values)


def _is_number(kind: Any) -> bool:
    return isinstance(kind, (LanesType, types.Float, types.Integer))


def _operation(function: Any, result: Any, emit: Callable[..., Any], operands: int = 2) -> None:
    """Teach numba `function` of numbers of which one at least is in lanes."""

    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:  # noqa: ARG002 - numba's face
            fits = len(args) == operands and all(map(_is_number, args))
            if fits and any(isinstance(kind, LanesType) for kind in args):
                return signature(result, *args)
            return None

    infer_global(function)(Template)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        return emit(builder, *(as_lanes(context, builder, *pair) for pair in zip(sig.args, args, strict=True)))

    kinds: list[tuple[type[types.Type], ...]] = [(LanesType,) * operands]
    if operands == 2:
        for other in (types.Float, types.Integer):
            kinds += [(LanesType, other), (other, LanesType)]
    for kind in kinds:
        lower_builtin(function, *kind)(lower)


def _compared(sign: str) -> Callable[..., Any]:
    return lambda builder, x, y: builder.fcmp_ordered(sign, x, y)


def _smaller(sign: str) -> Callable[..., Any]:
    return lambda builder, x, y: builder.select(builder.fcmp_ordered(sign, x, y), x, y)


_operation(operator.add, lanes_type, lambda builder, x, y: builder.fadd(x, y))
_operation(operator.sub, lanes_type, lambda builder, x, y: builder.fsub(x, y))
_operation(operator.mul, lanes_type, lambda builder, x, y: builder.fmul(x, y))
_operation(operator.truediv, lanes_type, lambda builder, x, y: builder.fdiv(x, y))
for _function in (operator.iadd, operator.isub, operator.imul):
    _plain = {operator.iadd: "fadd", operator.isub: "fsub", operator.imul: "fmul"}[_function]
    _operation(_function, lanes_type, lambda builder, x, y, _name=_plain: getattr(builder, _name)(x, y))
_operation(operator.lt, mask_type, _compared("<"))
_operation(operator.le, mask_type, _compared("<="))
_operation(operator.gt, mask_type, _compared(">"))
_operation(operator.ge, mask_type, _compared(">="))
_operation(min, lanes_type, _smaller("<"))
_operation(max, lanes_type, _smaller(">"))
_operation(operator.neg, lanes_type, lambda builder, x: builder.fneg(x), 1)
_operation(abs, lanes_type, lambda builder, x: call(builder, f"llvm.fabs.v{WIDTH}f64", x), 1)
_operation(math.sqrt, lanes_type, lambda builder, x: call(builder, f"llvm.sqrt.v{WIDTH}f64", x), 1)


def _logic(function: Any, emit: Callable[..., Any], operands: int) -> None:
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:  # noqa: ARG002 - numba's face
            fits = len(args) == operands and all(isinstance(kind, MaskType) for kind in args)
            return signature(mask_type, *args) if fits else None

    infer_global(function)(Template)
    lower_builtin(function, *[MaskType] * operands)(lambda _context, builder, _sig, args: emit(builder, *args))


for _function in (operator.and_, operator.iand):
    _logic(_function, lambda builder, x, y: builder.and_(x, y), 2)
for _function in (operator.or_, operator.ior):
    _logic(_function, lambda builder, x, y: builder.or_(x, y), 2)
_logic(operator.invert, lambda builder, x: builder.not_(x), 1)


@infer_getattr
class _RealPart(AttributeTemplate):
    key = LanesType

    def resolve_real(self, kind: Any) -> Any:
        """Lanes are real numbers."""
        return kind


lower_getattr(LanesType, "real")(lambda _context, _builder, _kind, value: value)


@intrinsic
def spread_lanes(_typing: Any, x: Any) -> Any:
    """A number in every lane."""
    return lanes_type(x), lambda context, builder, sig, args: as_lanes(context, builder, sig.args[0], args[0])


@infer_global(choose)
class _Choice(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:  # noqa: ARG002 - numba's face
        fits = isinstance(args[0], MaskType) and all(map(_is_number, args[1:]))
        return signature(lanes_type, *args) if fits else None


def _lower_choice(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    pairs = zip(sig.args[1:], args[1:], strict=True)
    return builder.select(args[0], *(as_lanes(context, builder, *pair) for pair in pairs))


lower_builtin(choose, MaskType, types.Any, types.Any)(_lower_choice)


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


@intrinsic
def lane_array(_typing: Any, array: Any) -> Any:
    """An array of doubles (n, WIDTH) as `n` lanes."""
    kind = types.Array(lanes_type, 1, "C", aligned=False)

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        given = context.make_array(sig.args[0])(context, builder, args[0])
        made = context.make_array(kind)(context, builder)
        count = builder.extract_value(given.shape, 0)
        size = ir.Constant(given.itemsize.type, 8 * WIDTH)
        context.populate_array(
            made,
            data=builder.bitcast(given.data, made.data.type),
            shape=[count],
            strides=[size],
            itemsize=size,
            meminfo=given.meminfo,
            parent=given.parent,
        )
        value = made._getvalue()
        if context.enable_nrt:
            context.nrt.incref(builder, kind, value)
        return value

    return kind(array), emit
