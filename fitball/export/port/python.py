"""A calibrated bounce as a Python module that needs nothing but `math`."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Iterable, Mapping
from textwrap import wrap

from fitball.export.port.kernel_source import Constant, UnportableError, free_names
from fitball.export.port.port import SELF_TEST_TOLERANCE, SERIES_SIZE, Port, range_sentences, status_reasons
from fitball.export.port.python_text import CALLS, CLAMP_COR, FACE, SELF_TEST
from fitball.inference.prediction.valid_range import GRAZING, TINY
from fitball.models.capabilities import LINES
from fitball.models.types import PHASE_BITS, PHASE_SYMBOL

WIDTH = 110


def python_port(port: Port) -> str:
    """The module's text. Raises UnportableError when it would use more than `math` and what it defines itself."""
    parts = [
        _docstring(port),
        "import math",
        _data(port),
        *(_class(name, fields) for name, fields in port.source.structs.items()),
        _constants(port.source.constants),
        *(_function(item) for item in port.source.functions),
        _face(port),
        SELF_TEST.replace("TOLERANCE", repr(SELF_TEST_TOLERANCE)),
    ]
    text = "\n\n\n".join(part.strip("\n") for part in parts) + "\n"
    check_self_contained(text)
    return text


def check_self_contained(text: str) -> None:
    """Raise UnportableError unless a module imports `math` alone and every name in it is its own or a builtin."""
    tree = ast.parse(text)
    known = {*dir(builtins), "math", "__name__"}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) or (isinstance(node, ast.Import) and node.names[0].name != "math"):
            raise UnportableError(f"the module imports more than math: {ast.unparse(node)}")
    for item in tree.body:
        if isinstance(item, (ast.ClassDef, ast.FunctionDef)):
            known.add(item.name)
        elif isinstance(item, ast.Assign):
            known |= {node.id for node in ast.walk(item.targets[0]) if isinstance(node, ast.Name)}
    for item in tree.body:
        if isinstance(item, ast.FunctionDef) and (strange := free_names(item) - known):
            raise UnportableError(f"{item.name} uses {', '.join(sorted(strange))}, which the module does not have")


def _docstring(port: Port) -> str:
    lines = [line for title in port.titles for line in wrap(title, WIDTH)]
    usage = "rebound(v_x1, v_y1, omega_1" + (", cor)" if port.needs_cor else ")")
    return "\n".join(
        [
            '"""' + lines[0],
            "",
            *lines[1:],
            "",
            f"    {usage} -> (v_x2, v_y2, omega_2, contact_time, regime, extrapolated)",
            "",
            "SI units: m/s, rad/s, s. `v_x` along the court in the direction of travel; `v_y1` towards the court and",
            "`v_y2` away from it, both positive; topspin positive. Run this file to check it on its golden impacts.",
            "",
            *(line for sentence in range_sentences(port) for line in wrap(sentence, WIDTH)),
            '"""',
        ]
    )


def _data(port: Port) -> str:
    lines = [f"MODEL = {port.model!r}", "# The fitted parameter set and the ball, SI.", "ROW = ("]
    lines += [f"    {value!r},  # {name}" for name, value in zip(port.call.columns, port.call.row, strict=True)]
    lines.append(")")
    if port.call.codes:
        lines += ["# Which closures the kernel follows.", f"CODES = {port.call.codes!r}"]
    if port.call.convention == "two-mass":
        lines += ["# The same for a ball without twist.", f"RIGID = {port.rigid_codes!r}"]
    if port.call.lines:
        lines += [f"{name.upper()} = {port.call.lines[name]!r}" for name in LINES]
    lines += [
        f"RADIUS = {port.radius!r}",
        "# Valid range of v_y1, and that of the impacts the model was fitted to [m/s].",
        f"V_Y1_LOW, V_Y1_HIGH = {port.valid.low!r}, {port.valid.high!r}",
        f"CALIBRATED_V_Y1_LOW, CALIBRATED_V_Y1_HIGH = {port.calibrated[0]!r}, {port.calibrated[1]!r}",
        *([f"COR_LOW, COR_HIGH = {port.cor_range[0]!r}, {port.cor_range[1]!r}"] if port.needs_cor else []),
        "# In what a bounce is extrapolated; see `rebound`.",
        "BEYOND_SPEEDS, BEYOND_RESTITUTION, WITHOUT_TWIST = 1, 2, 4",
        f"PHASES = { ({int(phase): name for phase, name in PHASE_SYMBOL.items()})!r}",
        "# Why an impact cannot be evaluated.",
        "REASONS = {",
        *(f"    {status}: {reason!r}," for status, reason in status_reasons().items()),
        "}",
        "# Incident state, rebound and phases of each golden impact.",
        "GOLDEN = (",
    ]
    for row in port.golden:
        incident = row.incident if port.needs_cor else row.incident[:3]
        time = row.rebound[3] if port.has_time else None
        lines.append(f"    ({incident!r}, ({', '.join(map(repr, row.rebound[:3]))}, {time!r}), {row.regime}),")
    return "\n".join([*lines, ")"])


def _constants(constants: Mapping[str, Constant]) -> str:
    return "\n".join(f"{name} = {value!r}" for name, value in constants.items())


def _class(name: str, fields: Iterable[str]) -> str:
    """A class for a named tuple, which would need an import."""
    lines = [f"class {name}:", f"    def __init__(self, {', '.join(fields)}):"]
    return "\n".join([*lines, *(f"        self.{field} = {field}" for field in fields)])


def _function(function: ast.FunctionDef) -> str:
    """A kernel's text without annotations, which name types that a port does not have."""
    plain = ast.parse(ast.unparse(function)).body[0]
    assert isinstance(plain, ast.FunctionDef)
    plain.returns = None
    for argument in plain.args.args:
        argument.annotation = None
    return ast.unparse(plain)


def _face(port: Port) -> str:
    text = FACE.replace("CALL_THE_KERNEL", _call(port)).replace("CLAMP_COR", CLAMP_COR if port.needs_cor else "")
    text = text.replace("GRAZING_SHARE", repr(GRAZING)).replace("TINY_SPEED", repr(TINY))
    named = ", cor" if port.needs_cor else ""
    return text.replace(", SIGNATURE", named).replace("COR_ARGUMENT", named)


def _call(port: Port) -> str:
    cor = "cor" if port.needs_cor else "(COR_10 + COR_SLOPE * (v_y1 - ANCHOR))" if port.call.lines else "math.nan"
    text = CALLS[port.call.convention].replace("THE_KERNEL", port.call.entry.__name__).replace("THE_COR", cor)
    text = text.replace("SERIES_SIZE", str(SERIES_SIZE))
    return text.replace("ANCHOR", repr(port.anchor))


assert PHASE_BITS == 3, "python_text.FACE unpacks phases by three bits"
