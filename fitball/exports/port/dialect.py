"""What the languages of the ports differ in; the walk over a kernel (`expressions`, `statements`) is one for all."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

from fitball.exports.port.kernel_source import Constant
from fitball.exports.port.kinds import STRIDE, Struct, Type


class Dialect(ABC):
    """A language of the C family; a subclass says what is otherwise.

    Texts go in and out; types are those of `kinds`. `math` maps functions of Python's `math` to what they are called,
    `values` its constants. Names that are `taken` in the language get a line behind them.
    """

    language: ClassVar[str]
    math: ClassVar[Mapping[str, str]]
    values: ClassVar[Mapping[str, str]]
    taken: ClassVar[frozenset[str]] = frozenset()
    compare: ClassVar[Mapping[str, str]] = {sign: sign for sign in ("<", "<=", ">", ">=", "==", "!=")}
    opening: ClassVar[str] = " {"
    otherwise: ClassVar[str] = "} else {"
    closing: ClassVar[tuple[str, ...]] = ("}",)
    nothing: ClassVar[tuple[str, ...]] = ()
    end: ClassVar[str] = ";"
    # What makes an integer real where that does not come by itself, and what declares a counter.
    cast: ClassVar[str] = ""
    counter: ClassVar[str] = ""
    # Functions of a language whose operators do not know complex numbers.
    complex_calls: ClassVar[Mapping[str, str]] = {}

    def name(self, text: str) -> str:
        """A variable, field or parameter."""
        return f"{text}_" if text in self.taken else text

    def function(self, text: str) -> str:
        """A function of the port."""
        return self.name(text)

    def constant(self, text: str) -> str:
        """A constant of the port."""
        return self.name(text)

    def shared(self, text: str) -> str:
        """A constant of the port that is a struct."""
        return self.constant(text)

    def number(self, value: float) -> str:
        """A finite number or truth value."""
        return repr(value).lower() if isinstance(value, bool) else repr(value)

    def literal(self, value: Constant) -> str:
        """A number, or a named tuple of such."""
        if isinstance(value, tuple):
            kinds = Struct(type(value).__name__, tuple((name, "d") for name in value._fields))  # type: ignore[attr-defined]
            return self.make(kinds, [self.literal(item) for item in value])
        return self.number(value)

    def fit(self, text: str, kind: Type, wanted: Type) -> str:
        """A value where `wanted` is held, which is `kind` or wider."""
        return f"complex({text}, 0.0)" if self.complex_calls and wanted == "z" != kind else text

    def binary(self, operator: str, left: tuple[str, Type], right: tuple[str, Type], kind: Type) -> str:
        """Sum, difference, product or quotient, of type `kind`; division of two integers is of real numbers."""
        if kind == "z" and self.complex_calls:
            return f"{self.complex_calls[operator]}({self.fit(*left, 'z')}, {self.fit(*right, 'z')})"
        cast = self.cast if operator == "/" and left[1] == right[1] == "i" else ""
        return f"({cast}{left[0]} {operator} {cast}{right[0]})"

    def negative(self, text: str, kind: Type) -> str:
        """The number with its other sign."""
        called = kind == "z" and self.complex_calls
        return f"{self.complex_calls['-']}(complex(0.0, 0.0), {text})" if called else f"(-{text})"

    def bits(self, operator: str, left: str, right: str) -> str:
        """`|`, `&` or `<<` of integers of 60 bits."""
        return f"({left} {operator} {right})"

    def choice(self, test: str, one: str, other: str) -> str:
        """A conditional expression."""
        return f"({test} ? {one} : {other})"

    @abstractmethod
    def whole(self, text: str) -> str:
        """A real number cut to an integer."""

    def absolute(self, text: str) -> str:
        """The magnitude of a real number."""
        return f"{self.math['fabs']}({text})"

    def test(self, function: str, text: str) -> str:
        """`isnan` or `isfinite`."""
        return f"{self.math[function]}({text})"

    def part(self, which: str, text: str) -> str:
        """The `real` or `imag` part of a complex number."""
        return f"{text}.{which}"

    @abstractmethod
    def make(self, kind: Type, texts: Sequence[str]) -> str:
        """A struct or tuple of these."""

    def item(self, text: str, place: int) -> str:
        """An item of a tuple."""
        return f"{text}.f{place}"

    def element(self, text: str, index: str) -> str:
        """An element of an array."""
        return f"{text}[{index}]"

    def cell(self, text: str, row: str, column: str) -> str:
        """An element of an array of two dimensions, laid out by rows."""
        return f"{text}[{STRIDE} * {row} + {column}]"

    @abstractmethod
    def held(self, kind: Type, name: str, text: str) -> str:
        """A new variable that is not changed."""

    @abstractmethod
    def local(self, kind: Type, name: str) -> str:
        """A variable at the top of a function, set to something harmless."""

    def condition(self, word: str, test: str) -> str:
        """The head of an `if` or `while`."""
        return f"{word} ({test}){self.opening}"

    def counting(self, counter: str, start: str, stop: str, down: bool) -> str:
        """The head of a loop from `start` to before `stop`, which is looked at once."""
        end = f"{counter}end"
        step = f"{counter} > {end}; --{counter}" if down else f"{counter} < {end}; ++{counter}"
        return f"for ({self.counter} {counter} = {start}, {end} = {stop}; {step}) {{"

    def together(self, lines: Sequence[str]) -> list[str]:
        """Lines whose variables are seen by nobody else."""
        return ["{", *(f"    {line}" for line in lines), "}"]

    @abstractmethod
    def define(self, comment: str, result: Type, name: str, taken: Sequence[tuple[Type, str]]) -> list[str]:
        """The lines that begin a function, its comment first."""

    def unread(self, name: str) -> list[str]:  # noqa: ARG002
        """What to say of a parameter that is not read."""
        return []
