"""A number type for kernels that holds `WIDTH` doubles side by side, and one that holds as many truths.

A condition is a `Mask`: `choose` takes the place of `if`, `any_of` asks whether a branch is needed at all.
Exponential, sine and cosine, and logarithm are good to about one unit in the last place: the reductions and the
polynomials of sine, cosine and logarithm are those of fdlibm (Sun Microsystems 1993), whose constants split so that
their products with a small integer are exact without a fused multiply-add. That of the exponential is Chebyshev
interpolation of `(exp(r) - 1 - r)/r^2` on `|r| <= log(2)/2`.
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

from fitball.models.kernels.compiled import inlined
from fitball.models.kernels.dual import (
    DOUBLES,
    SCALARS,
    WIDTH,
    Emit,
    VectorModel,
    VectorType,
    array_view,
    carry,
    choose,
    constant,
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


# Added to a number below 2^51 it leaves its nearest integer in the last bits.
ROUNDING = 6755399441055744.0
LOG_2_HIGH, LOG_2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
HALF_PI_HIGH, HALF_PI_LOW = 1.57079632673412561417e00, 6.07710050650619224932e-11
# Arguments beyond these have fewer digits, or none.
LARGEST_EXPONENT, LARGEST_ANGLE = 700.0, 1.0e5
# The bits of sqrt(1/2), above which a mantissa is left where it is, and of `ROUNDING`.
HALF_ROOT_BITS, ROUNDING_BITS, FRACTION_BITS = 0x3FE6A09E667F3BCD, 0x4338000000000000, 52


@intrinsic
def scaled(_typing: Any, x: Any, rounded: Any) -> Any:
    """`x 2^n` where `rounded` is `n + ROUNDING`."""

    def emit(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        power = builder.shl(builder.bitcast(args[1], WORDS), constant(WORDS, FRACTION_BITS))
        return builder.bitcast(builder.add(builder.bitcast(args[0], WORDS), power), DOUBLES)

    return lanes_type(x, rounded), emit


@intrinsic
def quadrant_bit(_typing: Any, rounded: Any, _ahead: Any, _bit: Any) -> Any:
    """Whether the integer `n + ahead` has a bit, where `rounded` is `n + ROUNDING`."""

    def emit(_context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        step, mask = (spread(builder, word) for word in args[1:])
        whole = builder.add(builder.bitcast(args[0], WORDS), step)
        return builder.icmp_unsigned("!=", builder.and_(whole, mask), constant(WORDS, 0))

    return mask_type(rounded, types.int64, types.int64), emit


@intrinsic
def fraction_and_exponent(_typing: Any, x: Any) -> Any:
    """`f` and `k` with `x = 2^k f`, `f` between sqrt(1/2) and sqrt(2)."""
    both = types.UniTuple(lanes_type, 2)

    def emit(context: Any, builder: Any, _sig: Any, args: Any) -> Any:
        bits = builder.bitcast(args[0], WORDS)
        power = builder.ashr(builder.sub(bits, constant(WORDS, HALF_ROOT_BITS)), constant(WORDS, FRACTION_BITS))
        fraction = builder.sub(bits, builder.shl(power, constant(WORDS, FRACTION_BITS)))
        whole = builder.bitcast(builder.add(power, constant(WORDS, ROUNDING_BITS)), DOUBLES)
        exponent = builder.fsub(whole, ir.Constant(DOUBLES, [ROUNDING] * DOUBLES.count))
        return context.make_tuple(builder, both, [builder.bitcast(fraction, DOUBLES), exponent])

    return both(x), emit


@inlined
def exp(x: Lanes) -> Lanes:
    """Exponential for `|x| <= LARGEST_EXPONENT`."""
    rounded = x * 1.44269504088896338700 + ROUNDING
    n = rounded - ROUNDING
    r = (x - n * LOG_2_HIGH) - n * LOG_2_LOW
    r2 = r * r
    r4 = r2 * r2
    low = (0.5000000000000001 + r * 0.16666666666666669) + r2 * (0.041666666666623824 + r * 0.008333333333330039)
    middle = (0.0013888888917367081 + r * 0.00019841269863171557) + r2 * (
        2.4801521057868204e-05 + r * 2.7557268276905696e-06
    )
    high = 2.7620201591031547e-07 + r * 2.5100472505694996e-08
    return scaled(1.0 + (r + r2 * (low + r4 * (middle + r4 * high))), rounded)


@inlined
def sin_cos(x: Lanes) -> tuple[Lanes, Lanes]:
    """Sine and cosine for `|x| <= LARGEST_ANGLE`."""
    rounded = x * 0.63661977236758134308 + ROUNDING
    n = rounded - ROUNDING
    r = (x - n * HALF_PI_HIGH) - n * HALF_PI_LOW
    z = r * r
    z2 = z * z
    p = (8.33333333332248946124e-03 + z * -1.98412698298579493134e-04) + z2 * (
        (2.75573137070700676789e-06 + z * -2.50507602534068634195e-08) + z2 * 1.58969099521155010221e-10
    )
    sine = r + r * z * (-1.66666666666666324348e-01 + z * p)
    q = (4.16666666666666019037e-02 + z * -1.38888888888741095749e-03) + z2 * (
        (2.48015872894767294178e-05 + z * -2.75573143513906633035e-07)
        + z2 * (2.08757232129817482790e-09 + z * -1.13596475577881948265e-11)
    )
    half = 0.5 * z
    top = 1.0 - half
    cosine = top + (((1.0 - top) - half) + z2 * q)
    odd = quadrant_bit(rounded, 0, 1)
    s = choose(odd, cosine, sine)
    c = choose(odd, sine, cosine)
    return choose(quadrant_bit(rounded, 0, 2), -s, s), choose(quadrant_bit(rounded, 1, 2), -c, c)


@inlined
def log(x: Lanes) -> Lanes:
    """Natural logarithm of a positive normal number."""
    fraction, k = fraction_and_exponent(x)
    f = fraction - 1.0
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    odd = z * (
        6.666666666666735130e-01
        + w * (2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01))
    )
    half = 0.5 * f * f
    return k * LOG_2_HIGH - ((half - (s * (half + (even + odd)) + k * LOG_2_LOW)) - f)
