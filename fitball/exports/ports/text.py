"""Numbers, ranges, golden impacts and the text of a port; no text of a user becomes code."""

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
from fitball.exports.ports import offered, python
from fitball.exports.ports.dialects import CSHARP, JAVASCRIPT, C, Dialect
from fitball.exports.ports.offered import FRONTS, Front
from fitball.exports.ports.source import Source, collected
from fitball.exports.ports.translate import translated
from fitball.models.kernels.batch import OUTPUTS
from fitball.models.kernels.contact import CHOICES, Flags
from fitball.models.kernels.phases import PHASE_BITS
from fitball.models.model import KernelCall, Model
from fitball.models.types import PHASE_NAMES, REASONS, Rebound, Status, regime_name
from fitball.version import __version__

# Largest difference that a self-test allows: other mathematical libraries differ by their last
# digit, 2e-16, which the search for the ends of phases amplifies a hundredfold or so.
TOLERANCE = 1e-12
# Vertical speeds of golden impacts where none were measured [m/s]; speeds along the court, and R
# omega, over them.
SPEEDS = (4.0, 25.0)
ALONG = (0.3, 1.2, 4.0)
SPINNING = (-0.8, 0.0, 1.5)
# What is the other way for a ball that flies to the left.
MIRRORED = ("v_x1", "omega_1", "v_x2", "omega_2", "gap_path", "gap_turn")
# A double holds so many phases, and JavaScript has no other numbers.
PHASES = 17
# Characters of a name at most, beginnings included: C99 distinguishes 63. Names that files have
# besides.
LONGEST = 40
TAKEN = ("SELF_TEST",)
# Punctuation that means nothing in a comment.
HARMLESS = " .,:;_-+=()[]%'/&^×±"
_DIALECTS: dict[str, Dialect] = {"c": C, "csharp": CSHARP, "javascript": JAVASCRIPT}
# The file of each language.
FILES = {
    "c": "bounce.h",
    "csharp": "Bounce.cs",
    "javascript": "bounce.js",
    "python": "bounce.py",
    "golden": "golden.csv",
}


def golden_of(one: ParameterSet) -> list[list[float]]:
    """Impacts over the measured speeds, of all kinds of slip, every other one to the left: their
    states, OUTPUTS and packed regimes. Raises ParameterError (`no-answer`) if the model has no
    answer for any of them.
    """
    radius = one.values.get("ball_radius", one.model.ball.radius)
    v_y, along, spinning = np.array(list(product(one.measured or SPEEDS, ALONG, SPINNING))).T
    given = Impacts(along * v_y, v_y, spinning * v_y / radius)
    # As the kernel has it, with the phases of a drop.
    values = np.array([list(one.values.values())])
    found: Rebound = one.model.solve(one.model.ball, tuple(one.values), values, given, None)
    good = (found.status[0] == Status.OK) & (found.regime[0] < 1 << PHASES * PHASE_BITS)
    if not good.any():
        reason = REASONS[Status(int(found.status[0, 0]))]
        raise ParameterError(
            f"model {one.model.text} has no answer at these values: {reason}",
            "no-answer",
        )
    numbers = np.stack(
        [*vars(given).values(), *(getattr(found, name)[0] for name in (*OUTPUTS, "regime"))],
        axis=1,
    )
    numbers = numbers[good]
    numbers[1::2] *= [
        -1.0 if name in MIRRORED else 1.0 for name in (*vars(given), *OUTPUTS, "regime")
    ]
    rows: list[list[float]] = numbers.tolist()
    return rows


def front_of(model: Model) -> Front:
    """What a port of a model is built on. Raises ModelError (`no-port`) for a model whose solver
    has no row of FRONTS.
    """
    for solver, front in FRONTS.items():
        if type(model.solve) is solver:
            return front
    raise ModelError(f"model {model.name} has no port to other languages", "no-port")


def port(sets: Sequence[ParameterSet], language: str) -> str:
    """The text of a port, or of the golden table, the impacts and rebounds of its self-test as CSV,
    as FILES names them. `sets` are the surfaces and balls of one fit, each a constant of the file:
    the same model and choices. Raises ModelError (`own-model`, and `no-port` without a front or of
    a kernel that has no translation), ParameterError (`no-answer`, and as `Model.rebound`).
    """
    calls = [one.model.kernel_call(one.values) for one in sets]
    front = front_of(sets[0].model)
    golden = [golden_of(one) for one in sets]
    if language == "golden":
        return _golden_table(sets, golden)
    dialect = _DIALECTS.get(language)
    margin = "# " if language == "python" else " * "
    source = _source(sets, front, calls, golden, dialect)
    names = _names([one.label for one in sets])
    if dialect is None:
        _check_translation(_source(sets, front, calls, golden, C))
        structs = [python.struct_text(kind) for kind in source.compounds]
        functions = [python.function_text(source, name) for name in source.functions]
        constants = [python.constant_text(name, value) for name, value in source.constants.items()]
    else:
        structs = [dialect.definition(kind) for kind in source.compounds]
        functions = [translated(source, name, dialect) for name in source.functions]
        constants = [dialect.constant_of(name, value) for name, value in source.constants.items()]
    parts = {
        "head": "\n".join(f"{margin}{line}".rstrip() for line in _head(sets, names)),
        "licence": "\n".join(
            f"{margin}{line}".rstrip() for line in _template("licence.txt").splitlines()
        ),
        "structs": "\n".join(filter(None, structs)),
        "constants": "\n".join(constants),
        "tolerance": repr(TOLERANCE),
        "functions": "\n\n".join(functions),
        "impacts": str(source.constants["IMPACTS_"]),
    }

    def filled(found: re.Match[str]) -> str:
        if found["line"]:
            return "\n".join(
                found["line"].replace("@name@", name).replace("@place@", str(k))
                for k, name in enumerate(names)
            )
        return "\n".join(
            f"{found['indent']}{line}".rstrip() for line in parts[found["part"]].split("\n")
        )

    # A line of a template with @name@ stands for one of each set.
    pattern = r"(?m)^(?P<line>.*@name@.*)$|(?P<indent>(?:^ +)?)@(?P<part>[a-z]+)@"
    return re.sub(pattern, filled, _template(f"port.{language}"))


def _check_translation(source: Source) -> None:
    """Raises UnportableError for what C would not be given: Python would notice it only when the
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
) -> Source:
    """The functions of a port with its numbers."""
    struct: Any = NamedTuple
    columns = (*calls[0].columns, "v_y1_low", "v_y1_high")
    parameters = struct("Parameters", [(name, float) for name in columns])
    choices = struct("Choices", [(name, int) for name, _ in CHOICES])
    flags = calls[0].flags
    rows = [[float(k), *np.nan_to_num(row).tolist()] for k, one in enumerate(golden) for row in one]
    given = {
        "SOLVED": front.answer,
        "FLAGS": choices(*flags),
        "LEVELS": [
            parameters(*call.row, *(one.measured or (0.0, 0.0)))
            for one, call in zip(sets, calls, strict=True)
        ],
        "GOLDEN": list(chain.from_iterable(rows)),
        "IMPACTS": len(rows),
        "GRIP_ONLY": int(front.grip_only(flags)),
        "MAX_PACKED_PHASES": PHASES,
    }
    types = {FloatArray: parameters, Flags: choices, offered.Parameters: parameters}
    helpers = python.HELPERS if dialect is None else dialect.helpers
    return collected(
        (offered.rebound, offered.rebound_3d, offered.self_test), given, types, helpers
    )


def _golden_table(sets: Sequence[ParameterSet], golden: Sequence[list[list[float]]]) -> str:
    """Golden impacts and rebounds as CSV."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["level", "v_x1", "v_y1", "omega_1", *OUTPUTS, "regime"])
    for one, rows in zip(sets, golden, strict=True):
        for *numbers, regime in rows:
            cells = ["" if number != number else repr(number) for number in numbers]
            writer.writerow([source_text(one.label), *cells, regime_name(int(regime))])
    return text.getvalue()


def _names(labels: Sequence[str]) -> list[str]:
    """Constants for labels: capitals, digits and underscores of ASCII, all different."""
    found: list[str] = []
    for label in labels:
        apart = unicodedata.normalize("NFKD", label)
        plain = "".join(c for c in apart if not unicodedata.combining(c)).upper()
        plain = re.sub("[^A-Z0-9]+", "_", plain).strip("_")
        name = (plain if plain[:1].isalpha() else f"BALL_{plain}".rstrip("_"))[:LONGEST].rstrip("_")
        numbered = chain([name], (f"{name}_{k}" for k in count(2)))
        found.append(next(one for one in numbered if one not in found and one not in TAKEN))
    return found


def _head(sets: Sequence[ParameterSet], names: Sequence[str]) -> list[str]:
    """What stands at the head of a port, in lines."""
    first = sets[0]
    phases = ", ".join(f"{int(phase)} {name}" for phase, name in PHASE_NAMES.items())
    sentences = [
        f"Bounce of a ball: model {first.model.text}. Made by fitball {__version__} from its "
        "kernels."
    ]
    sentences += [*dict.fromkeys(one.origin for one in sets), ""]
    if not first.model.tangential:
        sentences[-1:] = [
            "A model of drops: the ball keeps its velocity along the court and its spin.",
            "",
        ]
    for one, name in zip(sets, names, strict=True):
        low, high = one.measured or (0.0, 0.0)
        known = (
            f"measured from v_y1 = {low:.4g} to {high:.4g} m/s"
            if one.measured
            else "not fitted to measurements"
        )
        sentences.append(f"{name}: {one.label or 'the ball'}, {known}.")
        sentences += [f"{own} of {name}: {text}." for own, text in one.sources.items()]
    sentences += [
        "",
        *(
            f"{spec.name} [{spec.unit or 1}]: {spec.meaning}."
            for spec in first.model.specs.values()
        ),
    ]
    said = [
        *map(source_text, sentences),
        "",
        *_template("usage.txt").replace("@phases@", phases).splitlines(),
    ]
    return [line for text in said for line in wrap(text, 110) or [""]]


def source_text(text: str) -> str:
    """`text` as it may be in a comment of every language: letters, digits and harmless punctuation
    as they are, every other character by its code point, such as U+005C.

    Nothing is left that ends a comment, a string or a script, continues or breaks a line, begins an
    escape, a trigraph or a directive, or turns the direction of text.
    """
    return "".join(
        char if char.isalnum() or char in HARMLESS else f"U+{ord(char):04X}" for char in text
    )


@cache
def _template(name: str) -> str:
    return (Path(__file__).parent / "templates" / name).read_text("utf-8")
