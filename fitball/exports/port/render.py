"""From a port to the text of a file: the kernels in a language, set into that language's template."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from textwrap import wrap

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from fitball.exports.port.dialect import Dialect
from fitball.exports.port.face import BEYOND_RESTITUTION, BEYOND_SPEEDS, WITHOUT_TWIST
from fitball.exports.port.kinds import STRIDE, holds_complex
from fitball.exports.port.port import SELF_TEST_TOLERANCE, SERIES_SIZE, Port, range_sentences, status_reasons
from fitball.exports.port.statements import program_of, translated
from fitball.models.kernels.search import MAX_DEPTH
from fitball.models.types import PHASE_BITS, PHASE_SYMBOL

WIDTH = 110
# Punctuation that means nothing in a comment or between double quotes.
HARMLESS = " .,:;_-+=>()[]/%'"
STACK_SIZE = (MAX_DEPTH + 1) * STRIDE
FLAGS = {
    "BEYOND_SPEEDS": BEYOND_SPEEDS,
    "BEYOND_RESTITUTION": BEYOND_RESTITUTION,
    "WITHOUT_TWIST": WITHOUT_TWIST,
}


def rendered(port: Port, template: str, **context: object) -> str:
    """A template filled with what every language says of a port, and `context`."""
    return (
        _environment()
        .get_template(template)
        .render(
            port=port,
            titles=wrapped(port.titles),
            sentences=wrapped(range_sentences(port)),
            reasons=status_reasons(port.needs_cor),
            flags=FLAGS,
            phases=[PHASE_SYMBOL.get(code, "") for code in range(len(PHASE_SYMBOL) + 1)],  # type: ignore[call-overload]
            tolerance=SELF_TEST_TOLERANCE,
            series_size=SERIES_SIZE,
            stack_size=STACK_SIZE,
            cor_argument=", cor" if port.needs_cor else "",
            **context,
        )
    )


def translated_port(port: Port, dialect: Dialect, template: str) -> str:
    """The port in a language. Raises UnportableError."""
    program = program_of(port.source, dialect)
    kinds = [
        *program.structs.values(),
        *(kind for taken, result in program.signatures.values() for kind in (*taken, result)),
    ]

    def number(value: float) -> str:
        return dialect.values["nan"] if math.isnan(value) else dialect.number(value)

    return rendered(
        port,
        template,
        kinds=kinds,
        structs=program.structs.values(),
        complex_numbers=any(map(holds_complex, kinds)),
        constants=port.source.constants,
        literal=dialect.literal,
        constant=dialect.constant,
        number=number,
        functions="\n\n".join(translated(item, program) for item in port.source.functions),
        dialect=dialect,
    )


def wrapped(sentences: Sequence[str]) -> list[str]:
    """Sentences as lines of a comment, each begun anew."""
    return [line for sentence in sentences for line in wrap(sentence, WIDTH)]


def camel_case(prefix: str) -> str:
    """`red_clay_` as `RedClay`."""
    return "".join(word[0].upper() + word[1:] for word in prefix.split("_") if word)


def source_text(text: str) -> str:
    """`text` as it may stand in a comment or between double quotes of every language: letters, digits and harmless
    punctuation as they are, every other character by its code point, such as U+005C.

    Nothing is left that ends a comment, a string or a script, continues a line, breaks one, begins an escape, a
    trigraph or a directive, or turns the direction of text.
    """
    return "".join(char if char.isalnum() or char in HARMLESS else f"U+{ord(char):04X}" for char in text)


@cache
def _environment() -> Environment:
    return Environment(
        loader=PackageLoader("fitball.exports.port"),
        # Whatever a template inserts is text, unless it says `| safe` of code that is translated from kernels.
        autoescape=False,
        finalize=lambda value: value if isinstance(value, Markup) else source_text(str(value)),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


assert PHASE_BITS == 3, "the templates unpack phases by three bits"
