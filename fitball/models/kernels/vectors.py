"""Number types for kernels that are LLVM vectors of `WIDTH` doubles: what `lanes` and `gradient` have in common.

Arithmetic is LLVM's vector instructions: the compiler cuts them to what a machine has, and each element is rounded as
a double is. Nothing is contracted into a multiply-add, so that an element has the same bits on every machine that
computes by IEEE 754.
"""

# mypy: allow-untyped-calls
from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

from llvmlite import ir
from numba import types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import intrinsic as numba_intrinsic
from numba.extending import models

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
