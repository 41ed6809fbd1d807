"""Quantities that a user writes as expressions of others by name: `mu*(1 + cor_10)`.

An expression is read by Python's own grammar and computed by a closed list of its nodes: numbers,
names, `+ - * / **`, and a few functions. Nothing is ever executed as code.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import NamedTuple, TypeAlias

import numpy as np

from fitball.base.errors import ParameterError, suggestion
from fitball.base.values import FloatArray

FUNCTIONS: Mapping[str, Callable[[FloatArray], FloatArray]] = {
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "abs": np.abs,
}
# Letters of an expression: more are no formula, and Python's parser has limits of its own.
_MOST_LETTERS = 500
# Numbers beyond this are no part of a formula, nor are all of them floats.
_MOST = 1e300
# What stands for names in Python's grammar begins so.
_PLACEHOLDER = "__"
# Exponents of units are ratios of small numbers, so that what cancels is exactly zero.
_MOST_DENOMINATOR = 12
# Exponents of units, by unit.
Dimensions: TypeAlias = dict[str, Fraction]
_OPERATIONS: Mapping[type[ast.operator], Callable[[FloatArray, FloatArray], FloatArray]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
}


class _Measure(NamedTuple):
    """The `dimensions` of a value; not `sure` where a number of the formula may have a unit that it
    does not show, as the speed in `eps_10 - 3*eps_slope`.
    """

    dimensions: Dimensions
    sure: bool = True


@dataclass(frozen=True)
class Expression:
    """An expression as the user wrote it (`text`), its tree, and the names in it by what stands for
    them there.
    """

    name: str
    text: str
    tree: ast.expr
    names: Mapping[str, str]

    def values(self, of_names: Mapping[str, FloatArray]) -> FloatArray:
        """The values (draws,) of the expression; NaN where it has none."""
        size = next(iter(of_names.values())).shape
        with np.errstate(all="ignore"):
            found = np.broadcast_to(self._value(self.tree, of_names), size)
        return np.where(np.isfinite(found), found, np.nan)

    def _value(self, node: ast.expr, of_names: Mapping[str, FloatArray]) -> FloatArray:
        """The value of a node."""
        match node:
            case ast.Constant(value=int() | float() as number):
                return np.array(number, dtype=np.float64)
            case ast.Name(id=placeholder):
                return of_names[self.names[placeholder]]
            case ast.UnaryOp(op=operator, operand=operand):
                inner = self._value(operand, of_names)
                return -inner if isinstance(operator, ast.USub) else inner
            case ast.BinOp(left=left, op=operator, right=right):
                operation = _OPERATIONS[type(operator)]
                return operation(self._value(left, of_names), self._value(right, of_names))
            case ast.Call(func=ast.Name(id=function), args=[argument]):
                return FUNCTIONS[function](self._value(argument, of_names))
        raise AssertionError(ast.dump(node))

    def unit(self, units: Mapping[str, str]) -> str:
        """The SI unit of the expression by those of its names; "" where there is none, or a number
        in it leaves it open.

        Raises:
            ParameterError: values of several units are added, or a function or an exponent has a
                unit (`derive`).
        """
        return unit_text(self._measure(self.tree, units).dimensions)

    def _measure(self, node: ast.expr, units: Mapping[str, str]) -> _Measure:
        """The unit of a node."""
        match node:
            case ast.Constant():
                return _Measure({}, False)
            case ast.Name(id=placeholder):
                return _Measure(dimensions_of(units[self.names[placeholder]]))
            case ast.UnaryOp(operand=operand):
                return self._measure(operand, units)
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return self._measure_of_power(left, right, units)
            case ast.BinOp(left=left, op=operator, right=right):
                pair = self._measure(left, units), self._measure(right, units)
                if isinstance(operator, ast.Add | ast.Sub):
                    return self._measure_of_sum(*pair)
                return _measure_of_product(*pair, 1 if isinstance(operator, ast.Mult) else -1)
            case ast.Call(func=ast.Name(id=function), args=[argument]):
                inner = self._measure(argument, units)
                if function == "abs":
                    return inner
                if function == "sqrt":
                    return inner._replace(dimensions=_power(inner.dimensions, Fraction(1, 2)))
                if inner.sure and inner.dimensions:
                    unit = unit_text(inner.dimensions)
                    raise self.refusal(f"{function} of a value in {unit}; expected one without")
                return _Measure({})
        raise AssertionError(ast.dump(node))

    def _measure_of_sum(self, first: _Measure, second: _Measure) -> _Measure:
        """The unit of a sum."""
        if first.sure and second.sure and first.dimensions != second.dimensions:
            pair = " and ".join(unit_text(each.dimensions) or "none" for each in (first, second))
            raise self.refusal(f"a sum of values in units {pair}; expected one unit")
        if first.sure or second.sure:
            return first if first.sure else second
        return first if first.dimensions == second.dimensions else _Measure({}, False)

    def _measure_of_power(
        self,
        base: ast.expr,
        exponent: ast.expr,
        units: Mapping[str, str],
    ) -> _Measure:
        """The unit of a power."""
        raised = self._measure(base, units)
        by = self._measure(exponent, units)
        if by.sure and by.dimensions:
            raise self.refusal(f"an exponent in {unit_text(by.dimensions)}; expected a number")
        if not raised.dimensions:
            return raised
        number = self.constant(exponent)
        if number is None:
            raise self.refusal("a value with a unit to a power that is no number")
        ratio = Fraction(number).limit_denominator(_MOST_DENOMINATOR)
        return raised._replace(dimensions=_power(raised.dimensions, ratio))

    @staticmethod
    def constant(node: ast.expr) -> float | None:
        """The number that a node is, with its sign; None if it is none."""
        match node:
            case ast.Constant(value=int() | float() as number):
                return float(number)
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as number)):
                return -float(number)
        return None

    def refusal(self, read: str) -> ParameterError:
        """The error that an expression cannot be used."""
        return refusal(self.name, self.text, read)

    @cached_property
    def used(self) -> tuple[str, ...]:
        """Names in the expression, in the order in which they occur."""
        nodes = [node for node in ast.walk(self.tree) if isinstance(node, ast.Name)]
        nodes.sort(key=lambda node: (node.lineno, node.col_offset))
        found = [node.id for node in nodes if node.id in self.names]
        return tuple(dict.fromkeys(self.names[placeholder] for placeholder in found))


def refusal(name: str, text: str, read: str) -> ParameterError:
    """The error that an expression of a name cannot be read or used."""
    return ParameterError(f"derive: {name}={text}: read {read}", "derive")


def expression(name: str, text: str, known: Collection[str]) -> Expression:
    """An expression of `known` names, among which are those of levels, as `mu[clay]`.

    Raises:
        ParameterError: it is none (`derive`), or has a name that is not known
            (`unknown-parameter`).
    """
    if len(text) > _MOST_LETTERS:
        raise refusal(name, text[:20] + "...", f"{len(text)} letters; expected a short formula")
    if _PLACEHOLDER in text:
        raise refusal(name, text, f"'{_PLACEHOLDER}'; expected names of this fit")
    placeholders = {f"{_PLACEHOLDER}{number}": each for number, each in enumerate(known)}
    by_name = {each: placeholder for placeholder, each in placeholders.items()}
    # The longest first: `mu[clay]` before `mu`. What follows must not go on with the name.
    pattern = "|".join(re.escape(each) for each in sorted(by_name, key=len, reverse=True))
    replaced = re.sub(
        rf"(?<![\w.\]])(?:{pattern})(?![\w\[(])",
        lambda found: by_name[found[0]],
        text,
    )
    try:
        tree = ast.parse(replaced.strip(), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise refusal(name, text, "no formula; expected one as mu*(1 + cor_10)") from None
    if not any(isinstance(node, ast.Name) for node in ast.walk(tree)):
        raise refusal(name, text, "no name; expected one as in mu*(1 + cor_10)")
    for unusable in _unusable(tree, placeholders):
        if isinstance(unusable, ast.Name | ast.Subscript):
            word = ast.unparse(unusable)
            raise ParameterError(
                f"derive: {name}={text}: read '{word}': {suggestion(word, known)}",
                "unknown-parameter",
            )
        allowed = f"numbers, names, + - * / **, {', '.join(FUNCTIONS)}"
        raise refusal(name, text, f"'{ast.unparse(unusable)}'; expected {allowed}")
    return Expression(name, text, tree, placeholders)


def _unusable(node: ast.expr, placeholders: Collection[str]) -> Iterator[ast.expr]:
    """The nodes of a tree that no expression may have."""
    match node:
        case ast.Constant(value=bool()):
            yield node
        case ast.Constant(value=int() | float() as value) if value <= _MOST:
            pass
        case ast.Name(id=placeholder) if placeholder in placeholders:
            pass
        case ast.UnaryOp(op=ast.USub() | ast.UAdd(), operand=operand):
            yield from _unusable(operand, placeholders)
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _OPERATIONS:
            yield from _unusable(left, placeholders)
            yield from _unusable(right, placeholders)
        case ast.Call(func=ast.Name(id=function), args=[argument], keywords=[]) if (
            function in FUNCTIONS
        ):
            yield from _unusable(argument, placeholders)
        case _:
            yield node


def dimensions_of(unit: str) -> Dimensions:
    """The exponents of a unit as specs have it, such as `m/(m/s)` or `N m/rad`."""
    if not unit:
        return {}
    tree = ast.parse(re.sub(r"\s+", "*", unit.replace("^", "**")), mode="eval").body
    return _of_unit(tree)


def _of_unit(node: ast.expr) -> Dimensions:
    """The exponents of a node of a unit."""
    match node:
        case ast.Constant():
            return {}
        case ast.Name(id=name):
            return {name: Fraction(1)}
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int() as exponent)):
            return _power(_of_unit(left), Fraction(exponent))
        case ast.BinOp(left=left, op=ast.Mult(), right=right):
            return _product(_of_unit(left), _of_unit(right))
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return _product(_of_unit(left), _power(_of_unit(right), Fraction(-1)))
    raise AssertionError(ast.dump(node))


def _product(first: Dimensions, second: Dimensions) -> Dimensions:
    """The exponents of a product."""
    names = dict.fromkeys((*first, *second))
    none = Fraction(0)
    sums = {name: first.get(name, none) + second.get(name, none) for name in names}
    return {name: exponent for name, exponent in sums.items() if exponent}


def _power(dimensions: Dimensions, exponent: Fraction) -> Dimensions:
    """The exponents of a power."""
    powers = {name: exponent * each for name, each in dimensions.items()}
    return {name: each for name, each in powers.items() if each}


def unit_text(dimensions: Dimensions) -> str:
    """A unit by its exponents, `N m/rad`."""
    above = [_factor(name, each) for name, each in dimensions.items() if each > 0]
    below = [_factor(name, -each) for name, each in dimensions.items() if each < 0]
    text = " ".join(above) or ("1" if below else "")
    if not below:
        return text
    return f"{text}/{below[0]}" if len(below) == 1 else f"{text}/({' '.join(below)})"


def _measure_of_product(first: _Measure, second: _Measure, power: int) -> _Measure:
    """The unit of a product, or of a quotient with the power of -1."""
    other = _power(second.dimensions, Fraction(power))
    return _Measure(_product(first.dimensions, other), first.sure and second.sure)


def _factor(name: str, exponent: Fraction) -> str:
    """A unit to a power."""
    if exponent == 1:
        return name
    power = f"{exponent}" if exponent.denominator == 1 else f"({exponent})"
    return f"{name}^{power}"
