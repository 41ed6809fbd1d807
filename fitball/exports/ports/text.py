"""The text of a port, with its numbers, measured ranges and golden impacts.

No text of a user becomes code.
"""

import csv
import io
import re
import unicodedata
from collections.abc import Sequence
from functools import cache
from itertools import chain, count, product
from pathlib import Path
from textwrap import wrap
from typing import Any, NamedTuple

import numpy as np

from fitball.base.errors import ModelError, ParameterError
from fitball.base.values import FloatArray, Impacts
from fitball.exports.parameter_set import ParameterSet
from fitball.exports.ports import flight, in_place, offered, python, selftest
from fitball.exports.ports.dialects import CSHARP, GDSCRIPT, JAVASCRIPT, OFFERED_TYPES, C, Dialect
from fitball.exports.ports.offered import FRONTS, Front
from fitball.exports.ports.ranges import Face, Range, range_of, widened
from fitball.exports.ports.source import KernelSource, Type, fields_of, is_struct, source_of
from fitball.exports.ports.translate import translated
from fitball.models.kernels.batch import OUTPUTS
from fitball.models.kernels.contact import FLAG_CHOICES, Flags
from fitball.models.model import KernelCall, Model
from fitball.models.travel import Number, bounced
from fitball.models.types import PHASE_BITS, PHASE_NAMES, REASONS, Status, regime_name
from fitball.version import __version__

# Largest difference that a self-test allows: other mathematical libraries differ by their last
# digit, 2e-16, which the search for the ends of phases amplifies a hundredfold or so.
TOLERANCE = 1e-12
# Vertical speeds of golden impacts where none were measured [m/s]: from a lob to a serve.
GOLDEN_SPEEDS = (4.0, 25.0)
# Speeds of golden impacts along the court, over the vertical ones: balls that fall nearly straight
# down, balls that grip, balls that do both, balls that slide.
GOLDEN_SLOPES = (0.02, 0.3, 1.2, 4.0)
# R omega of golden impacts over their vertical speeds: backspin, no spin, topspin.
GOLDEN_SPINS = (-0.8, 0.0, 1.5)
# Phases of a packed regime at most: 51 bits, which a double holds, and JavaScript has no other
# numbers.
MOST_PHASES = 17
# Characters of the name of a constant at most: C99 distinguishes 63, with the prefix of a name.
LONGEST_CONSTANT = 40
# Names of constants that files have besides those of surfaces and balls.
TAKEN_CONSTANTS = ("SELF_TEST",)
# Punctuation that has no meaning in a comment of any language.
HARMLESS = " .,:;_-+=()[]%'/&^×±"
# Languages that are translated to; Python gets the kernels' own text.
_DIALECTS: dict[str, Dialect] = {
    "c": C,
    "csharp": CSHARP,
    "javascript": JAVASCRIPT,
    "esm": JAVASCRIPT,
    "types": JAVASCRIPT,
    "gdscript": GDSCRIPT,
}
# The file of each language.
FILES = {
    "c": "bounce.h",
    "csharp": "Bounce.cs",
    "javascript": "bounce.js",
    "esm": "bounce.mjs",
    "types": "bounce.d.mts",
    "python": "bounce.py",
    "gdscript": "bounce.gd",
    "golden": "golden.csv",
}


def golden_of(parameters: ParameterSet) -> list[list[float]]:
    """Golden impacts over the measured speeds, of all kinds of slip, every second one to the left.

    A row has the incident state, OUTPUTS and the packed regime of an impact, SI. Impacts for which
    the model has no answer are left out.

    Raises:
        ParameterError: the model has no answer for any of them (`no-answer`).
    """
    model = parameters.model
    radius = parameters.values.get("ball_radius", model.ball.radius)
    states = product(parameters.measured or GOLDEN_SPEEDS, GOLDEN_SLOPES, GOLDEN_SPINS)
    v_y, slope, spinning = np.array(list(states)).T
    side = np.where(np.arange(v_y.size) % 2, -1.0, 1.0)
    impacts = Impacts(side * slope * v_y, v_y, side * spinning * v_y / radius)
    # `Model.evaluate` would take the phases of a drop away, which ports have.
    names = tuple(parameters.values)
    values = np.array([list(parameters.values.values())])
    rebound = bounced(model.solve, model.ball, names, values, impacts, None)
    solved = rebound.status[0] == Status.OK
    short = rebound.regime[0] < 1 << MOST_PHASES * PHASE_BITS
    good = solved & short
    if not good.any():
        reason = REASONS[Status(int(rebound.status[0, 0]))]
        raise ParameterError(
            f"model {model.text} has no answer at these values: {reason}",
            "no-answer",
        )
    columns: dict[str, FloatArray] = {**vars(impacts)}
    for name in (*OUTPUTS, "regime"):
        columns[name] = getattr(rebound, name)[0]
    numbers = np.stack([*columns.values()], axis=1)[good]
    rows: list[list[float]] = numbers.tolist()
    return rows


def front_of(model: Model) -> Front:
    """The functions that a port of a model is built on.

    Raises:
        ModelError: the solver of the model has no row of FRONTS (`no-port`).
    """
    for solver, front in FRONTS.items():
        if type(model.solve) is solver:
            return front
    raise ModelError(f"model {model.name} has no port to other languages", "no-port")


def port(sets: Sequence[ParameterSet], language: str) -> str:
    """The text of a port in a language of FILES, or of the golden table: the impacts and rebounds
    of the self-test as CSV.

    `sets` are the surfaces and balls of one fit, with the same model and choices. Each is a
    constant of the file.

    Raises:
        ModelError: the model is a Python function (`own-model`), has no front, or a kernel has no
            translation (`no-port`).
        ParameterError: a parameter is missing (`parameters`), a value is outside its bounds
            (`out-of-bounds`), or no golden impact has an answer (`no-answer`).
    """
    calls = [parameters.model.kernel_call(parameters.values) for parameters in sets]
    front = front_of(sets[0].model)
    golden = [golden_of(parameters) for parameters in sets]
    if language == "golden":
        return _golden_table(sets, golden)
    dialect = _DIALECTS.get(language)
    margin = "# " if language in ("python", "gdscript") else " * "
    source = _source(sets, front, calls, golden, dialect)
    names = _names([parameters.label for parameters in sets])
    if dialect is None:
        _check_translation(_source(sets, front, calls, golden, C))
        structs = [python.struct_text(kind) for kind in source.compounds]
        texts = {name: python.function_text(source, name) for name in source.functions}
        constants = [python.constant_text(name, value) for name, value in source.constants.items()]
    else:
        translate = in_place.translated if dialect.in_place else translated
        texts = {name: translate(source, name, dialect) for name in source.functions}
        constants = [dialect.constant_of(name, value) for name, value in source.constants.items()]
        structs = [dialect.definition(kind) for kind in source.compounds]
        if language == "types":
            structs = [interface(kind) for kind in source.compounds if is_struct(kind)]
        elif dialect.in_place:
            code = "\n".join([*texts.values(), *constants])
            structs = in_place.definitions(source.compounds, code)
    # How it is said that a ball moves away differs from language to language.
    kin = "javascript" if dialect is JAVASCRIPT else language
    texts["leaving_"] = _template(f"leaving.{kin}")
    sections = {
        "head": _indented(margin, _head(sets, names)),
        "licence": _indented(margin, _template("licence.txt").splitlines()),
        "structs": "\n".join(filter(None, structs)),
        "constants": "\n".join(constants),
        "tolerance": repr(TOLERANCE),
        "functions": "\n\n".join(texts.values()),
        "impacts": str(source.constants["IMPACTS_"]),
    }

    def filled(match: re.Match[str]) -> str:
        line = match["line"]
        if line:
            copies = enumerate(names)
            return "\n".join(
                line.replace("@name@", name).replace("@place@", str(k)) for k, name in copies
            )
        return _indented(match["indent"], sections[match["section"]].split("\n"))

    # A line of a template with @name@ is written once for each set.
    pattern = r"(?m)^(?P<line>.*@name@.*)$|(?P<indent>(?:^ +)?)@(?P<section>[a-z]+)@"
    return re.sub(pattern, filled, _template(f"port.{language}"))


def _indented(margin: str, lines: Sequence[str]) -> str:
    """Lines behind a margin, without blanks at their ends."""
    return "\n".join(f"{margin}{line}".rstrip() for line in lines)


def _check_translation(source: KernelSource) -> None:
    """Raise UnportableError for what has no translation to C. Python would notice it only when the
    file is run, if at all.
    """
    for name in source.functions:
        translated(source, name, C)


def _source(
    sets: Sequence[ParameterSet],
    front: Front,
    calls: Sequence[KernelCall],
    golden: Sequence[list[list[float]]],
    dialect: Dialect | None,
) -> KernelSource:
    """The functions of a port with its numbers, for a dialect or, without one, for Python."""
    # Named tuples whose fields depend on the model.
    struct: Any = NamedTuple
    columns = (*calls[0].columns, "v_y1_low", "v_y1_high", "measured")
    row_type = struct("Parameters", [(name, float) for name in columns])
    choices = struct("Choices", [(name, int) for name, _ in FLAG_CHOICES])
    flags = calls[0].flags
    numbers = []
    for k, rows in enumerate(golden):
        numbers += [[float(k), *np.nan_to_num(row).tolist()] for row in rows]
    ranges = list[Range]()
    faces = list[Face]()
    levels = list[tuple[float, ...]]()
    for parameters, call in zip(sets, calls, strict=True):
        place = -1.0
        impacts = parameters.impacts
        if impacts is not None and parameters.model.tangential:
            place = float(len(ranges))
            measured, its = range_of(impacts, parameters.values["ball_radius"], len(faces))
            ranges.append(measured)
            faces += its
        low, high = widened(*parameters.measured) if parameters.measured else (0.0, 0.0)
        levels.append(row_type(*call.row, low, high, place))
    constants = {
        "SOLVED": front.answer,
        "FLAGS": choices(*flags),
        "LEVELS": levels,
        # A list has a type by its first item; without measured impacts none is read.
        "RANGES": ranges or [Range(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0, 0, False)],
        "FACES": faces or [Face(*[0.0] * len(Face._fields))],
        "GOLDEN": list(chain.from_iterable(numbers)),
        "IMPACTS": len(numbers),
        "GRIP_ONLY": int(front.grip_only(flags)),
        "MAX_PACKED_PHASES": MOST_PHASES,
    }
    types: dict[object, Type] = {
        FloatArray: row_type,
        Flags: choices,
        offered.Parameters: row_type,
        Number: float,
    }
    helpers = python.HELPERS if dialect is None else dialect.helpers
    functions = (offered.rebound, offered.rebound_3d, flight.step, selftest.self_test)
    return source_of(functions, constants, types, helpers)


def _golden_table(sets: Sequence[ParameterSet], golden: Sequence[list[list[float]]]) -> str:
    """Golden impacts and rebounds as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["level", "v_x1", "v_y1", "omega_1", *OUTPUTS, "regime"])
    for parameters, rows in zip(sets, golden, strict=True):
        for *numbers, regime in rows:
            cells = ["" if np.isnan(number) else repr(number) for number in numbers]
            writer.writerow([source_text(parameters.label), *cells, regime_name(int(regime))])
    return text.getvalue()


def _names(labels: Sequence[str]) -> list[str]:
    """Names of constants for labels: capitals, digits and underscores of ASCII, all different."""
    names: list[str] = []
    for label in labels:
        # Letters without their accents.
        apart = unicodedata.normalize("NFKD", label)
        plain = "".join(char for char in apart if not unicodedata.combining(char)).upper()
        name = re.sub("[^A-Z0-9]+", "_", plain).strip("_")
        if not name[:1].isalpha():
            name = f"BALL_{name}".rstrip("_")
        name = name[:LONGEST_CONSTANT].rstrip("_")
        numbered = chain([name], (f"{name}_{k}" for k in count(2)))
        names.append(next(name for name in numbered if name not in (*names, *TAKEN_CONSTANTS)))
    return names


def _head(sets: Sequence[ParameterSet], names: Sequence[str]) -> list[str]:
    """The comment at the head of a port, in lines: origin, sets, parameters and usage."""
    first = sets[0]
    phases = ", ".join(f"{int(phase)} {name}" for phase, name in PHASE_NAMES.items())
    sentences = [
        f"Bounce of a ball: model {first.model.text}. Made by fitball {__version__} from its "
        "kernels."
    ]
    sentences += [*dict.fromkeys(parameters.origin for parameters in sets), ""]
    if not first.model.tangential:
        sentences[-1:] = [
            "A model of drops: the ball keeps its velocity along the court and its spin.",
            "",
        ]
    for parameters, name in zip(sets, names, strict=True):
        basis = "not fitted to measurements"
        if parameters.measured is not None:
            low, high = parameters.measured
            basis = f"measured from v_y1 = {low:.4g} to {high:.4g} m/s"
        sentences.append(f"{name}: {parameters.label or 'the ball'}, {basis}.")
        for parameter, text in parameters.sources.items():
            sentences.append(f"{parameter} of {name}: {text.removesuffix('.')}.")
    sentences.append("")
    for spec in first.model.specs.values():
        sentences.append(f"{spec.name} [{spec.unit or 1}]: {spec.meaning}.")
    usage = _template("usage.txt").replace("@phases@", phases)
    paragraphs = [*map(source_text, sentences), "", *usage.splitlines()]
    return [line for text in paragraphs for line in wrap(text, 110) or [""]]


def source_text(text: str) -> str:
    """`text` made safe for a comment of every language. Letters, digits and harmless punctuation
    stay, every other character becomes its code point, such as U+005C.

    Nothing remains that ends a comment, a string or a script, continues or breaks a line, begins an
    escape, a trigraph or a directive, or turns the direction of text.
    """
    return "".join(
        char if char.isalnum() or char in HARMLESS else f"U+{ord(char):04X}" for char in text
    )


def interface(kind: Type) -> str:
    """The type of a struct in TypeScript; empty for those that are no argument or result."""
    if kind.__name__ not in OFFERED_TYPES:
        return ""
    names: dict[Type, str] = {float: "number", int: "number", bool: "boolean"}
    fields = [
        f"    {name}: {names.get(of_field) or of_field.__name__};"
        for name, of_field in fields_of(kind).items()
    ]
    return "\n".join([f"export interface {kind.__name__} {{", *fields, "}"])


@cache
def _template(name: str) -> str:
    return (Path(__file__).parent / "templates" / name).read_text("utf-8")
