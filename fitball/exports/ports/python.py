"""The port in Python: the text of the kernels, with the arithmetic of IEEE 754 where Python raises
an error instead.
"""

import ast
import math
from collections.abc import Callable, Mapping

from fitball.exports.ports import offered
from fitball.exports.ports.source import KernelSource, PortConstant, Type, fields_of, is_struct
from fitball.exports.ports.wrapped import wrapped


def over(a: float, b: float) -> float:
    """The quotient, of zero too."""
    if b != 0.0:
        return a / b
    return a * math.copysign(math.inf, b) if a != 0.0 else math.nan


def exp(x: float) -> float:
    """The exponential."""
    # The logarithm of the largest double.
    return math.inf if x > 709.782712893384 else math.exp(x)


def log(x: float) -> float:
    """The logarithm."""
    return math.log(x) if x > 0.0 else -math.inf if x == 0.0 else math.nan


def sqrt(x: float) -> float:
    """The root."""
    return math.sqrt(x) if x >= 0.0 else math.nan


def whole(x: float) -> int:
    """A whole number, of no number too."""
    return int(x) if abs(x) < math.inf else 0


# Functions in place of those that raise errors. Cosines, sines and log1p of finite numbers raise
# none, and kernels have no others, whatever the impact.
HELPERS: Mapping[str, Callable[..., object]] = {
    "/": over,
    "**6": offered.sixth,
    "int": whole,
    "math.exp": exp,
    "math.log": log,
    "math.sqrt": sqrt,
}


def function_text(source: KernelSource, name: str) -> str:
    """The definition of a function."""
    return ast.unparse(source.functions[name])


def struct_text(kind: Type) -> str:
    """The class of a named tuple; empty for a tuple, which needs none."""
    if not is_struct(kind):
        return ""
    fields = [f"    {name}: {of_field.__name__}" for name, of_field in fields_of(kind).items()]
    return "\n".join([f"class {kind.__name__}(NamedTuple):", *fields])


def constant_text(name: str, value: PortConstant) -> str:
    """The definition of a constant."""
    if isinstance(value, list):
        return f"{name} = [\n{wrapped(map(repr, value))}]"
    return f"{name} = {value!r}"
