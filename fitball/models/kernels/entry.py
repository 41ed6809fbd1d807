"""Kernels that are compiled once and called, where others would each be compiled with a copy in them."""

# mypy: allow-untyped-calls
from __future__ import annotations

from collections.abc import Callable, Sequence
from inspect import Parameter, Signature
from typing import Any, Generic, ParamSpec, TypeVar, cast

import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core import cgutils
from numba.core.typing.templates import Signature as Kinds
from numba.extending import intrinsic

from fitball.values import FloatArray

P = ParamSpec("P")
R = TypeVar("R")


class Entry(Generic[P, R]):
    """A compiled kernel that the linker knows by name, for one kind of arguments: of these and of the result it is
    given examples. Kernels that `call` it name it in their decorator, `calling`, so that it is linked before them
    where these come from disk; where they are compiled it is linked last, when another process may have compiled it.
    """

    def __init__(self, kernel: Callable[P, R], arguments: Sequence[Any], result: R) -> None:
        self.kernel: Any = kernel
        self.name = f"fitball.{self.kernel.__name__}"
        self.signature = Kinds(numba.typeof(result), tuple(map(numba.typeof, arguments)), None)
        self.call = cast("Callable[P, R]", intrinsic(self._typed()))
        # How many of the kernels that are being compiled name it.
        self.named = 0
        self._linked = False

    def link(self) -> None:
        """Compile the kernel or read it from disk, if that was not done, and tell the linker where it is.

        Raises TypeError where it gives something else than its example says.
        """
        if self._linked:
            return
        self.kernel.compile(self.signature.args)
        made = self.kernel.overloads[self.signature.args]
        if made.signature.return_type != self.signature.return_type:
            raise TypeError(f"{self.name} gives {made.signature.return_type}, not {self.signature.return_type}")
        llvm.add_symbol(self.name, made.library.get_pointer_to_function(made.fndesc.llvm_func_name))
        self._linked = True

    def _typed(self) -> Any:
        """The call, as numba wants it from `intrinsic`."""

        def typed(_context: Any, *_kinds: Any) -> Any:
            if not self.named:
                # From disk the code would call nothing, and end the process.
                raise numba.TypingError(f"{self.name} is not linked: name it in @calling")
            return self.signature, self._emit

        names = ["context", *(f"x{k}" for k in range(len(self.signature.args)))]
        typed.__signature__ = Signature([Parameter(name, Parameter.POSITIONAL_ONLY) for name in names])  # type: ignore[attr-defined]
        return typed

    def _emit(self, context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        self.link()
        conventions, given, taken = context.call_conv, self.signature.return_type, self.signature.args
        kind = conventions.get_function_type(given, taken)
        function = cgutils.get_or_insert_function(builder.module, kind, self.name)
        status, result = conventions.call_function(builder, function, given, taken, values)
        with cgutils.if_unlikely(builder, status.is_error):
            conventions.return_status_propagate(builder, status)
        return result


def read_only(shape: tuple[int, ...]) -> FloatArray:
    """An array as kernels are given impacts."""
    array = np.zeros(shape)
    array.flags.writeable = False
    return array
