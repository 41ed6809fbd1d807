"""A calibrated bounce as a C99 header that needs nothing but the standard library."""

from __future__ import annotations

import math
from textwrap import wrap

from fitball.export.port.c_statements import c_function, signature
from fitball.export.port.c_text import CALLS, CLAMP_COR, FACE, HELPERS, SELF_TEST
from fitball.export.port.c_types import STRIDE, Type, fields_of, struct_definitions, structs_of
from fitball.export.port.kernel_source import Constant
from fitball.export.port.port import SELF_TEST_TOLERANCE, SERIES_SIZE, Port, range_sentences, status_reasons
from fitball.inference.prediction.valid_range import GRAZING, TINY
from fitball.models.capabilities import LINES
from fitball.models.kernels.events import MAX_DEPTH
from fitball.models.types import PHASE_SYMBOL

WIDTH = 110


def c_port(port: Port, prefix: str = "fitball_") -> str:
    """The header's text; every name in it begins with `prefix`. Raises UnportableError."""
    functions = port.source.functions
    structs = structs_of(port.source.structs)
    signatures = {item.name: signature(item, structs) for item in functions}
    kinds = [*structs.values(), *(kind for taken, result in signatures.values() for kind in (*taken, result))]
    complex_numbers = any("z" in _flat(kind) for kind in kinds)
    parts = [
        _head(port, prefix, complex_numbers),
        "\n".join(struct_definitions(kinds, prefix)),
        "\n".join(c_constant(name, value, prefix) for name, value in port.source.constants.items()),
        HELPERS.replace("COMPLEX_HELPER", _COMPLEX if complex_numbers else ""),
        *(c_function(item, signatures, port.source.constants, structs, prefix) for item in functions),
        _face(port),
        _self_test(port),
        f"#endif /* {_guard(prefix)} */",
    ]
    text = "\n\n".join(part.strip("\n") for part in parts if part.strip()) + "\n"
    return text.replace("@@", prefix).replace("@UP@", prefix.upper())


_COMPLEX = """
static inline double complex @@complex(double re, double im)
{
    const double parts[2] = {re, im};
    double complex z = 0.0;
    memcpy(&z, parts, sizeof z);
    return z;
}
"""


def _flat(kind: Type) -> str:
    return kind if isinstance(kind, str) else "".join(_flat(item) for _name, item in fields_of(kind))


def _guard(prefix: str) -> str:
    return f"{prefix.upper()}PORT_H"


def _head(port: Port, prefix: str, complex_numbers: bool) -> str:
    titles = [line for title in port.titles for line in wrap(title, WIDTH)]
    lines = [
        *titles,
        "",
        "SI units: m/s, rad/s, s. v_x along the court in the direction of travel; v_y1 towards the court and v_y2",
        "away from it, both positive; topspin positive.",
        f"Check:  cc -std=c99 -x c -D{prefix.upper()}SELF_TEST THIS_FILE -lm -o check && ./check",
        "Build without -ffast-math: the search for transitions relies on IEEE arithmetic.",
    ]
    comment = "\n".join(["/*", *(f" * {line}".rstrip() for line in lines), " */"])
    includes = ["math", "stdbool", "stddef", "stdint", "string", *(["complex"] if complex_numbers else [])]
    guard = _guard(prefix)
    return "\n".join(
        [comment, f"#ifndef {guard}", f"#define {guard}", "", *(f"#include <{name}.h>" for name in includes)]
    )


def c_constant(name: str, value: Constant, prefix: str) -> str:
    """The definition of a module constant."""
    if isinstance(value, tuple):
        return f"static const {prefix}{type(value).__name__} {prefix.upper()}{name} = {_braced(value)};"
    return f"#define {prefix.upper()}{name} ({value!r})"


def _braced(value: Constant) -> str:
    if isinstance(value, tuple):
        return f"{{{', '.join(map(_braced, value))}}}"
    return repr(value).lower()


def _face(port: Port) -> str:
    cor = "cor" if port.needs_cor else "(COR_10 + COR_SLOPE * (v_y1 - ANCHOR))" if port.call.lines else "NAN"
    call = CALLS[port.call.convention].replace("THE_KERNEL", port.call.entry.__name__).replace("THE_COR", cor)
    call = call.replace("ANCHOR", repr(port.anchor))
    for name in LINES:
        call = call.replace(name.upper(), repr(port.call.lines.get(name, 0.0)))
    row = "\n".join(
        f"        {value!r}, /* {name} */" for name, value in zip(port.call.columns, port.call.row, strict=True)
    )
    phases = ", ".join(f'"{PHASE_SYMBOL.get(k, "")}"' for k in range(len(PHASE_SYMBOL) + 1))  # type: ignore[call-overload]
    reasons = "\n".join(f'    case {status}: return "{text}";' for status, text in status_reasons().items())
    text = FACE
    for token, value in {
        "CALL_THE_KERNEL": call.strip("\n"),
        "PARAMETER_ROW": row,
        "RANGE_COMMENT": _range_comment(port),
        "VALID_LOW": repr(port.valid.low),
        "VALID_HIGH": repr(port.valid.high),
        "CALIBRATED_LOW": repr(port.calibrated[0]),
        "CALIBRATED_HIGH": repr(port.calibrated[1]),
        "CLAMP_COR": CLAMP_COR.strip("\n") if port.needs_cor else "",
        "COR_LOW_END": repr(port.cor_range[0]),
        "COR_HIGH_END": repr(port.cor_range[1]),
        "COR_PARAMETER": ", double cor" if port.needs_cor else "",
        "COR_ARGUMENT": ", cor" if port.needs_cor else "",
        "GRAZING_SHARE": repr(GRAZING),
        "TINY_SPEED": repr(TINY),
        "BALL_RADIUS": repr(port.radius),
        "SERIES_SIZE": str(SERIES_SIZE),
        "STACK_SIZE": str((MAX_DEPTH + 1) * STRIDE),
        "CODE_LIST": ", ".join(map(str, port.call.codes)),
        "RIGID_LIST": ", ".join(map(str, port.rigid_codes)),
        "PHASE_NAMES": phases,
        "REASON_CASES": reasons,
    }.items():
        text = text.replace(token, value)
    return text


def _range_comment(port: Port) -> str:
    lines = [line for sentence in range_sentences(port) for line in wrap(sentence, WIDTH)]
    return "\n".join(["/*", *(f" * {line}" for line in lines), " */"])


def _self_test(port: Port) -> str:
    def number(value: float) -> str:
        return "NAN" if math.isnan(value) else repr(value)

    rows = "\n".join(
        "        {{"
        + ", ".join(map(number, row.incident))
        + "}, {"
        + ", ".join(map(number, row.rebound))
        + f"}}, {row.regime}}},"
        for row in port.golden
    )
    incident = "in[0], in[1], in[2]" + (", in[3]" if port.needs_cor else "")
    return (
        SELF_TEST.replace("GOLDEN_ROWS", rows)
        .replace("TOLERANCE_", repr(SELF_TEST_TOLERANCE))
        .replace("GOLDEN_INCIDENT", incident)
        .replace("BALL_RADIUS", repr(port.radius))
        .replace("MODEL_NAME", port.model)
    )
