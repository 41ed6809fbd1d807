"""Numbers that carry derivatives, so that one kernel gives values and, called with these, derivatives.

A complex step (Squire and Trapp 1998): an input `x` becomes `x + i STEP`; the imaginary part of whatever is computed
from it is its derivative times `STEP`, and nothing is subtracted. `STEP` squared is nothing beside any real part, so
first order is all that the functions below need; of a float they are those of `math`, at no cost. Branches look at
real parts. A gradient is such a number with `SLOPES` imaginary parts: one vector, the value in front, the slopes,
times `STEP` too, behind it.

A vector is `WIDTH` doubles of LLVM, whose instructions the compiler cuts to what a machine has; each element is
rounded as a double is. Nothing is contracted into a multiply-add, so that an element has the same bits on every
machine that computes by IEEE 754. `lanes` are vectors too.
"""

# mypy: allow-untyped-calls
from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any, TypeAlias, TypeVar

from llvmlite import ir
from numba import types
from numba.core.imputils import lower_builtin, lower_cast, lower_getattr
from numba.core.typeconv.castgraph import Conversion
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.extending import intrinsic as numba_intrinsic
from numba.extending import models, overload, register_model
from numpy.typing import NDArray

from fitball.models.kernels.compiled import inner

WIDTH = 8
DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
PLACES = ir.VectorType(ir.IntType(32), WIDTH)
SCALARS = (types.Float, types.Integer)
# What writes the instructions of an operation: builder and operands to the result.
Emit: TypeAlias = Callable[..., Any]


class VectorType(types.Type):
    """A type of `WIDTH` doubles."""


class VectorModel(models.PrimitiveModel):
    """How LLVM holds such a type; numba asks that each is registered with it."""

    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, DOUBLES)


def intrinsic(function: Callable[..., Any]) -> Any:
    """A function written as instructions; kernels call it without its first argument, numba's typing context."""
    return numba_intrinsic(function)


def constant(kind: Any, value: Any) -> Any:
    """The same constant in every element."""
    return ir.Constant(kind, [value] * WIDTH)


def spread(builder: Any, scalar: Any) -> Any:
    """One scalar in every element."""
    nothing = ir.Constant(ir.VectorType(scalar.type, WIDTH), ir.Undefined)
    one = builder.insert_element(nothing, scalar, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, nothing, constant(PLACES, 0))


def is_scalar(kind: Any) -> bool:
    """Whether a type is that of one number."""
    return isinstance(kind, SCALARS)


def operation(function: Any, own: type[types.Type], kinds: list[tuple[Any, ...]], result: Any, emit: Emit) -> None:
    """Teach numba a `function` of operands of which one at least is of the `own` type: `kinds` names the others too.

    `emit` gets the builder and the operands, scalars among them as doubles.
    """

    class Template(AbstractTemplate):
        # Asked before those of any target: there are dozens for an operator.
        metadata = {"target": "cpu"}  # noqa: RUF012 - numba's face

        def generic(self, args: Any, kws: Any) -> Any:  # noqa: ARG002 - numba's face
            if any(isinstance(kind, own) for kind in args) and any(_fit(args, wanted) for wanted in kinds):
                return signature(result, *args)
            return None

    infer_global(function)(Template)

    def lower(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        operands = [
            context.cast(builder, value, kind, types.float64) if is_scalar(kind) else value
            for kind, value in zip(sig.args, args, strict=True)
        ]
        return emit(builder, *operands)

    for wanted in kinds:
        lower_builtin(function, *wanted)(lower)


def _fit(args: Any, wanted: tuple[Any, ...]) -> bool:
    return len(args) == len(wanted) and all(map(isinstance, args, wanted))


def with_scalars(own: type[types.Type]) -> list[tuple[Any, ...]]:
    """The operands of an operation of two numbers one of which is of a type."""
    return [(own, own), *((own, scalar) for scalar in SCALARS), *((scalar, own) for scalar in SCALARS)]


def array_view(kind: VectorType) -> Any:
    """The intrinsic that takes an array of doubles (n, WIDTH) as `n` numbers of a type."""
    viewed = types.Array(kind, 1, "C", aligned=False)

    def view(_typing: Any, array: Any) -> Any:
        return viewed(array), emit

    def emit(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        given = context.make_array(sig.args[0])(context, builder, args[0])
        made = context.make_array(viewed)(context, builder)
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
            context.nrt.incref(builder, viewed, value)
        return value

    return intrinsic(view)


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
