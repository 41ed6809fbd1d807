"""What a port holds: a kernel with the fitted parameter set, and the golden impacts it is checked with; and its text:
the kernels in a language, set into that language's template.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from fitball.exports.port import face
from fitball.exports.port.face import (
    BAD_INPUT,
    BEYOND_RESTITUTION,
    BEYOND_SPEEDS,
    WITHOUT_TWIST,
    fitted_impulse,
    fitted_thesis,
    fitted_two_mass,
    golden_agreement,
    total_bounce,
)
from fitball.exports.port.kernel_source import Constant, KernelSource, kernel_source
from fitball.exports.port.translate import STRIDE, Program, compound, fields_of, translated
from fitball.inference.prediction.reach import GRAZING, TINY, ValidRange, restitution_range, valid_range
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Fit, Golden
from fitball.models.kernels.contact import ANCHOR_SPEED, TORSION, TORSION_RIGID
from fitball.models.kernels.oscillator import MAX_DEPTH, SERIES_LENGTH, SIZE
from fitball.models.model import Convention, KernelCall
from fitball.models.types import OUTPUTS, PHASE_BITS, PHASE_SYMBOL, STATUS_REASON, Status
from fitball.version import __version__

if TYPE_CHECKING:
    from fitball.exports.port.languages import Dialect

# Largest difference a self-test allows: of speeds and R*omega relative to the incident speed (of centre and surface
# together), of the contact time relative to itself. Other mathematical libraries differ by their last digit, 2e-16,
# which the search for transitions amplifies a hundredfold or so.
SELF_TEST_TOLERANCE = 1e-12

# Length of the first three arrays of the two-mass kernel's scratch; see `bounce.scratch_in`.
SERIES_SIZE = max(SERIES_LENGTH, SIZE)

WIDTH = 110
# Punctuation that means nothing in a comment or between double quotes.
HARMLESS = " .,:;_-+=>()[]/%'"
STACK_SIZE = (MAX_DEPTH + 1) * STRIDE
FLAGS = {
    "BEYOND_SPEEDS": BEYOND_SPEEDS,
    "BEYOND_RESTITUTION": BEYOND_RESTITUTION,
    "WITHOUT_TWIST": WITHOUT_TWIST,
}


@dataclass(frozen=True)
class Port:
    """All that a generator of source text needs; `titles` say what the port is and where it is from.

    `valid` is the range of `v_y1` in which the port is the model as fitted, `calibrated` those of the impacts it was
    fitted to [m/s]; `cor_range` what a model that is given each impact's restitution solves, else (0, 1). `golden`
    has a row for each golden impact, see `face.GOLDEN_NUMBERS`, and `regimes` its phases packed.
    """

    model: str
    titles: tuple[str, ...]
    call: KernelCall
    source: KernelSource
    needs_cor: bool
    golden: Sequence[Sequence[float]]
    regimes: Sequence[int]
    valid: ValidRange
    calibrated: tuple[float, float]
    cor_range: tuple[float, float]
    offset_jumps: bool

    @property
    def rigid_codes(self) -> tuple[int, ...]:
        """The closures of the same ball without twist, for the two-mass kernel."""
        codes = list(self.call.codes)
        if self.call.convention == "two-mass":
            codes[TORSION] = TORSION_RIGID
        return tuple(codes)

    @property
    def row(self) -> tuple[tuple[str, float], ...]:
        """The parameter set and the ball by name, as `face` takes them."""
        return tuple(zip(self.call.columns, self.call.row, strict=True))

    @property
    def constants(self) -> Mapping[str, Constant]:
        """What the port offers and its kernels use, by name."""
        ends = dict(zip(("CALIBRATED_V_Y1_LOW", "CALIBRATED_V_Y1_HIGH"), self.calibrated, strict=True))
        return {**FLAGS, **ends, **self.source.constants}


FITTED: Mapping[Convention, Callable[..., Any]] = {
    "impulse": fitted_impulse,
    "two-mass": fitted_two_mass,
    "thesis": fitted_thesis,
}


def origin_of(saved: Fit) -> str:
    """Which fit a port is of, in a line."""
    table = saved.source
    origin = f"table {table.file} ({table.impacts} impacts), point estimate, fit {saved.status}"
    pooled = sorted({item.parameter for item in saved.levels})
    return f"{origin}, {', '.join(pooled)} at the value common to all levels" if pooled else origin


def port_of(saved: Fit) -> Port:
    """The port of a fit. Raises ModelError as `make_port` does."""
    return make_port(saved.fitted, saved.golden, origin_of(saved))


def make_port(fitted: FittedModel, golden: Golden, origin: str, more: Sequence[Callable[..., Any]] = ()) -> Port:
    """The port of a fitted model at its point estimate; `origin` says which fit it is, `more` are functions that it
    has besides.

    Raises ModelError when the model solves none of the impacts it was fitted to.
    """
    model = fitted.model
    kept = fitted.model_columns
    call = model.kernel_call([fitted.names[k] for k in kept], fitted.point[kept])
    closures = ", ".join(f"{name} = {value}" for name, value in fitted.options.items())
    titles = (
        f"Bounce of a ball: model {fitted.model_name}.",
        *([f"Model assumptions: {closures}."] if closures else []),
        f"Calibrated: {origin}. Generated by fitball {__version__} from the source code of its kernel.",
    )
    valid, cor_range = valid_range(fitted), restitution_range(fitted) if model.needs_cor else (0.0, 1.0)
    given: dict[str, Constant | Callable[..., Any]] = {
        "FITTED": FITTED[call.convention],
        "KERNEL": call.entry,
        "TOLD_COR": int(model.needs_cor),
        "ANCHOR": ANCHOR_SPEED,
        "RADIUS": call.row[call.columns.index("ball_radius")],
        "V_Y1_LOW": valid.low,
        "V_Y1_HIGH": valid.high,
        "COR_LOW": cor_range[0],
        "COR_HIGH": cor_range[1],
        "GRAZING": GRAZING,
        "TINY": TINY,
    }
    return Port(
        model=fitted.model_name,
        titles=titles,
        call=call,
        source=kernel_source(total_bounce, golden_agreement, *more, given=given),
        needs_cor=model.needs_cor,
        golden=_golden_rows(golden),
        regimes=golden.rebound.regime.tolist(),
        valid=valid,
        calibrated=(float(fitted.impacts.v_y1.min()), float(fitted.impacts.v_y1.max())),
        cor_range=cor_range,
        offset_jumps=model.options.get("offset") == "grip",
    )


def range_sentences(port: Port) -> tuple[str, ...]:
    """Sentences on the range of a port."""
    valid, (low, high) = port.valid, port.calibrated
    some = f"more kinetic energy than {100.0 * valid.gain:.2g} %, as some do within the calibrated range"
    gained = some if valid.gain > 0.0 else "kinetic energy"
    said = [
        f"Valid range: v_y1 from {valid.low:.4g} to {valid.high:.4g} m/s. The model was fitted to impacts from "
        f"{low:.4g} to {high:.4g} m/s. The valid range extends beyond as far as the model has a rebound, v_y2 grows "
        f"with v_y1, and no bounce gains {gained}.",
        f"Reason of the lower end: {valid.below}. Reason of the upper end: {valid.above}.",
        "Outside of the valid range, restitution and offset of the normal force keep their values at its nearer end. "
        "Every bounce there has a rebound, without a jump, and is marked as extrapolated.",
    ]
    # A range that ends with the calibrated one has that fault within it.
    faults = {valid.below} if valid.low >= low else set()
    faults |= {valid.above} if valid.high <= high else set()
    said += [f"Within the calibrated range already: {fault}." for fault in sorted(faults)]
    if port.offset_jumps:
        said.append("With offset = grip the model itself has jumps of some mm/s, where a hold just touches a grip.")
    if port.model == "thesis":
        said.append(
            "This model repeats a printed computation: its bounces gain energy and jump at a change of phase."
        )
    return tuple(said)


def _golden_rows(golden: Golden) -> Sequence[Sequence[float]]:
    given, made = golden.impacts, golden.rebound
    cor = np.full(len(given), np.nan) if given.cor is None else given.cor
    rebound = (getattr(made, name) for name in OUTPUTS)
    columns = [given.v_x1, given.v_y1, given.omega_1, cor, *rebound, np.zeros(len(given))]
    return list(map(tuple, np.stack(columns, axis=1).tolist()))


def status_reasons(needs_cor: bool) -> dict[int, str]:
    """Why an impact cannot be evaluated, by status."""
    numbers = "finite numbers, a finite cor" if needs_cor else "finite numbers"
    bad = {BAD_INPUT: f"expected {numbers}, and v_y1 >= 0 towards the court"}
    return bad | {int(status): STATUS_REASON[status] for status in Status if status is not Status.OK}


def rendered(port: Port, template: str, **context: object) -> str:
    """A template filled with the facts of a port, and `context`."""
    return _environment().get_template(template).render(
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
    )  # fmt: skip


def translated_port(port: Port, dialect: Dialect) -> str:
    """The port in a language. Raises UnportableError."""
    names = ("min_real", "max_real", "min_whole", "max_whole", *dialect.helpers)
    texts = []
    for source in (kernel_source(*(getattr(face, name) for name in names)), port.source):
        program = Program.from_source(source, dialect)
        texts.append("\n\n".join(translated(item, program) for item in source.functions))

    def number(value: float) -> str:
        return dialect.values["nan"] if math.isnan(value) else dialect.number(value)

    return rendered(
        port,
        dialect.template,
        structs=dialect.structs(program.kinds),
        complex_numbers="z" in program.kinds
        or any(item == "z" for kind in compound(program.kinds) for _name, item in fields_of(kind)),
        definitions={name: dialect.constant_definition(name, value) for name, value in port.constants.items()},
        number=number,
        functions="\n\n".join(texts),
        dialect=dialect,
    )


def wrapped(sentences: Sequence[str]) -> list[str]:
    """Sentences as lines of a comment, each begun anew."""
    return [line for sentence in sentences for line in wrap(sentence, WIDTH)]


def source_text(text: str) -> str:
    """`text` as it may be in a comment or between double quotes of every language: letters, digits and harmless
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


def python_port(port: Port) -> str:
    """The module's text, which needs `math` alone: kernels that use more are refused where they are collected."""
    source = port.source
    return rendered(
        port,
        "port.py.j2",
        number=lambda value: "math.nan" if value != value else repr(value),
        classes="\n\n\n".join(_class(name, fields) for name, fields in source.structs.items()),
        functions="\n\n\n".join(map(_function, source.functions)),
    )


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


assert PHASE_BITS == 3, "the templates unpack phases by three bits"
