"""What operators give for numbers, asked of numba once.

Numba tries every template of an operator at each place where one stands: a tenth of a cold start.
"""

# mypy: allow-untyped-calls
from __future__ import annotations

from typing import Any

from numba import types

PLAIN = (types.Number, types.Boolean)


class TypingMemo:
    """Stands in for `resolve_function_type` of a typing context while kernels are compiled."""

    def __init__(self) -> None:
        self._context: Any = None
        self._known: dict[Any, Any] = {}

    def use(self, context: Any) -> None:
        """Answer instead of `context`."""
        self._context, self._ask = context, context.resolve_function_type
        context.resolve_function_type = self._resolve

    def leave(self) -> None:
        """Let it answer itself."""
        del self._context.resolve_function_type

    def _resolve(self, function: Any, args: Any, kws: Any) -> Any:
        operator = getattr(getattr(function, "typing_key", None), "__module__", "") == "_operator"
        if kws or not operator or not all(map(_plain, args)):
            return self._ask(function, args, kws)
        asked = (function, tuple(args))
        if asked not in self._known:
            self._known[asked] = self._ask(function, args, kws)
        return self._known[asked]


def _plain(kind: Any) -> bool:
    """Whether a type is that of a number, or of lanes of numbers."""
    return isinstance(kind, PLAIN) or type(kind).__module__.startswith(f"{__package__}.")
