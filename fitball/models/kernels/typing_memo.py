"""What operators give for numbers and arrays, asked of numba once.

Numba tries every template of an operator wherever one stands, and again when it makes code of it: a sixth of a cold
start.
"""

# mypy: allow-untyped-calls
from __future__ import annotations

from typing import Any

from numba import types

_FUNCTION: Any = types.Function
PLAIN = (types.Number, types.Boolean, types.Array)
# Where the functions come from whose results depend on nothing but the types of their arguments.
PURE = ("_operator", "builtins", "math")


class TypingMemo:
    """Stands in for `Function.get_call_type` while kernels are compiled, which one thread does at a time."""

    def __init__(self) -> None:
        self._ask = _FUNCTION.get_call_type
        self._known: dict[Any, Any] = {}

    def use(self) -> None:
        """Answer instead."""
        known, ask = self._known, self._ask

        def get_call_type(function: Any, context: Any, args: Any, kws: Any) -> Any:
            pure = getattr(function.typing_key, "__module__", "") in PURE
            if kws or not pure or not all(map(_plain, args)):
                return ask(function, context, args, kws)
            asked = (function, tuple(args))
            if asked not in known:
                known[asked] = ask(function, context, args, kws)
            return known[asked]

        _FUNCTION.get_call_type = get_call_type

    def leave(self) -> None:
        """Let numba answer itself."""
        _FUNCTION.get_call_type = self._ask


def _plain(kind: Any) -> bool:
    """Whether a type is that of a number, an array, or lanes of numbers."""
    return isinstance(kind, PLAIN) or type(kind).__module__.startswith(f"{__package__}.")
