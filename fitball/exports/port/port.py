"""What a port holds: a kernel with the fitted parameter set, and the golden impacts it is checked with; and its text:
the kernels in a language, set into that language's template.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from textwrap import wrap
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from fitball.exports.bounces import Bounces
from fitball.exports.port import face
from fitball.exports.port.face import (
    BAD_INPUT,
    BEYOND_RESTITUTION,
    BEYOND_SPEEDS,
    GOLDEN_NUMBERS,
    WITHOUT_TWIST,
    either_way,
    fitted_impulse,
    fitted_thesis,
    fitted_two_mass,
    golden_agreement,
)
from fitball.exports.port.kernel_source import Constant, InRow, KernelSource, kernel_source
from fitball.exports.port.names import Argument, arguments_of
from fitball.exports.port.translate import STRIDE, Program, compound, fields_of, translated
from fitball.inference.prediction.reach import (
    GRAZING,
    TINY,
    ValidRange,
    restitution_range,
    total_rebound,
    valid_range,
)
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Golden
from fitball.models.kernels.contact import ANCHOR_SPEED, TORSION, TORSION_RIGID
from fitball.models.kernels.oscillator import MAX_DEPTH, SERIES_LENGTH, SIZE
from fitball.models.model import Convention, KernelCall
from fitball.models.types import OUTPUTS, PHASE_BITS, PHASE_SYMBOL, STATUS_REASON, Status
from fitball.values import Impacts
from fitball.version import __version__

if TYPE_CHECKING:
    from fitball.exports.port.languages import Dialect

# Largest difference a self-test allows: of speeds and R*omega relative to the incident speed (of centre and surface
# together), of times relative to themselves, of path and turn between the flights to what that speed goes in between.
# Other mathematical libraries differ by their last digit, 2e-16, which the search for transitions amplifies a
# hundredfold or so.
SELF_TEST_TOLERANCE = 1e-12

# Length of the first three arrays of the two-mass kernel's scratch; see `bounce.scratch_in`.
SERIES_SIZE = max(SERIES_LENGTH, SIZE)

WIDTH = 110
# Punctuation that means nothing in a comment or between double quotes.
HARMLESS = " .,:;_-+=>()[]/%'"
STACK_SIZE = (MAX_DEPTH + 1) * STRIDE
# Speed along the court after a straight fall that is worth a sentence [m/s].
LEAST_FALLEN = 0.01
FLAGS = {
    "BEYOND_SPEEDS": BEYOND_SPEEDS,
    "BEYOND_RESTITUTION": BEYOND_RESTITUTION,
    "WITHOUT_TWIST": WITHOUT_TWIST,
}

SPEED_ENDS, COR_ENDS = ("v_y1_low", "v_y1_high"), ("cor_low", "cor_high")
CALIBRATED_ENDS = ("calibrated_v_y1_low", "calibrated_v_y1_high")


@dataclass(frozen=True)
class Port:
    """All that a generator of source text needs; `titles` say what the port is and where it is from.

    `valid` is the range of `v_y1` in which the port is the model as fitted, `calibrated` those of the impacts it was
    fitted to [m/s]; `cor_range` what a model that is given each impact's restitution solves, else (0, 1). `fallen` is
    v_x2 of a ball that falls straight down at the anchor speed without spin. `golden` has a row for each golden
    impact, see `face.GOLDEN_NUMBERS`, and `regimes` its phases packed. Where nothing was `measured`, `sources` are
    sentences on each parameter.

    With `arguments` it has several parameter sets: `sets` has a port of each combination of their labels (`words`),
    the last argument fastest, and what else is here is that of the first.
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
    fallen: float
    measured: bool = True
    sources: tuple[str, ...] = ()
    words: str = ""
    arguments: tuple[Argument, ...] = ()
    sets: tuple[Port, ...] = ()

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
    def ranges(self) -> Mapping[str, float]:
        """What follows `row` where there are several: the ends of the ranges."""
        known = dict(zip(SPEED_ENDS, (self.valid.low, self.valid.high), strict=True))
        known |= dict(zip(CALIBRATED_ENDS, self.calibrated, strict=True)) if self.measured else {}
        return known | (dict(zip(COR_ENDS, self.cor_range, strict=True)) if self.needs_cor else {})

    @property
    def whole_row(self) -> tuple[tuple[str, float], ...]:
        """`row` with `ranges` behind it."""
        return (*self.row, *self.ranges.items())

    @property
    def constants(self) -> Mapping[str, Constant]:
        """What the port offers and its kernels use, by name."""
        if self.arguments or not self.measured:
            return {**FLAGS, **self.source.constants}
        ends = dict(zip(("CALIBRATED_V_Y1_LOW", "CALIBRATED_V_Y1_HIGH"), self.calibrated, strict=True))
        return {**FLAGS, **ends, **self.source.constants}


FITTED: Mapping[Convention, Callable[..., Any]] = {
    "impulse": fitted_impulse,
    "two-mass": fitted_two_mass,
    "thesis": fitted_thesis,
}


def port_of(bounces: Bounces) -> Port:
    """The port of a fit, or of a model at given parameters. Raises ModelError as `make_port` does."""
    made = [
        replace(make_port(case.fitted, case.golden, bounces.origin, measured=bounces.measured), words=case.words)
        for case in bounces.cases
    ]
    first = replace(made[0], sources=bounces.sources)
    if not bounces.columns:
        return first
    # The ends of the ranges differ, so that kernels read them from the row.
    places = {name.upper(): InRow(len(first.row) + k) for k, name in enumerate(first.ranges)}
    source = _source(first.call, first.needs_cor, first.valid, first.cor_range, places)
    several = replace(first, source=source, sets=tuple(made))
    taken = [*several.source.structs, *(function.name for function in several.source.functions)]
    return replace(several, arguments=arguments_of(bounces.columns, taken, several.constants))


def make_port(
    fitted: FittedModel,
    golden: Golden,
    origin: str,
    more: Sequence[Callable[..., Any]] = (),
    measured: bool = True,
) -> Port:
    """The port of a model without levels at its point estimate; `origin` says which fit it is, `more` are functions
    that it has besides. If nothing was `measured`, its impacts are those at which it is tested.

    Raises ModelError when the model solves none of its impacts.
    """
    model = fitted.model
    kept = fitted.model_columns
    call = model.kernel_call([fitted.names[k] for k in kept], fitted.point[kept])
    closures = ", ".join(f"{name} = {value}" for name, value in fitted.options.items())
    known = "Calibrated" if measured else "Not calibrated"
    titles = (
        f"Bounce of a ball: model {fitted.model_name}.",
        *([f"Model assumptions: {closures}."] if closures else []),
        f"{known}: {origin}. Generated by fitball {__version__} from the source code of its kernel.",
    )
    valid, cor_range = valid_range(fitted), restitution_range(fitted) if model.needs_cor else (0.0, 1.0)
    told = None if fitted.impacts.cor is None else np.array([np.median(fitted.impacts.cor)])
    fall, _outside = total_rebound(fitted, valid, Impacts(np.zeros(1), np.array([ANCHOR_SPEED]), np.zeros(1), told))
    return Port(
        model=fitted.model_name,
        titles=titles,
        call=call,
        source=_source(call, model.needs_cor, valid, cor_range, more=more),
        needs_cor=model.needs_cor,
        golden=_golden_rows(golden),
        regimes=golden.rebound.regime.tolist(),
        valid=valid,
        calibrated=(float(fitted.impacts.v_y1.min()), float(fitted.impacts.v_y1.max())),
        cor_range=cor_range,
        offset_jumps=model.options.get("offset") == "grip",
        fallen=float(fall.v_x2[0, 0]),
        measured=measured,
    )


def _source(
    call: KernelCall,
    needs_cor: bool,
    valid: ValidRange,
    cor_range: tuple[float, float],
    places: Mapping[str, InRow] = MappingProxyType({}),
    more: Sequence[Callable[..., Any]] = (),
) -> KernelSource:
    """The functions of a port; `places` are numbers that are read from the row."""
    given: dict[str, Constant | Callable[..., Any] | InRow] = {
        "FITTED": FITTED[call.convention],
        "KERNEL": call.entry,
        "TOLD_COR": int(needs_cor),
        "ANCHOR": ANCHOR_SPEED,
        "RADIUS": call.row[call.columns.index("ball_radius")],
        "V_Y1_LOW": valid.low,
        "V_Y1_HIGH": valid.high,
        "COR_LOW": cor_range[0],
        "COR_HIGH": cor_range[1],
        "GRAZING": GRAZING,
        "TINY": TINY,
        **places,
    }
    return kernel_source(either_way, golden_agreement, *more, given=given)


def range_sentences(port: Port) -> tuple[str, ...]:
    """Sentences on the parameters of a port that nothing was fitted to, and on its ranges."""
    said = [*port.sources]
    for part in port.sets or (port,):
        of, valid = f", {part.words}" if port.sets else "", part.valid
        said += [
            f"Valid range{of}: v_y1 from {valid.low:.4g} to {valid.high:.4g} m/s. {_fitted_range(part)}",
            f"Reason of the lower end: {valid.below}. Reason of the upper end: {valid.above}.",
        ]
        if abs(part.fallen) > LEAST_FALLEN:
            said.append(
                f"Straight down{of}: a ball at {ANCHOR_SPEED:g} m/s without spin leaves with v_x2 = "
                f"{part.fallen:.2f} m/s. The offset of the normal force does not vanish at the vertical."
            )
    said.append(
        "Outside of the valid range, restitution and offset of the normal force keep their values at its nearer end. "
        "Every bounce there has a rebound, without a jump, and is marked as extrapolated."
    )
    for part in (item for item in port.sets or (port,) if item.measured):
        valid, (low, high) = part.valid, part.calibrated
        # A range that ends with the calibrated one has that fault within it.
        faults = {valid.below} if valid.low >= low else set()
        faults |= {valid.above} if valid.high <= high else set()
        before = f"{part.words}: " if port.sets else ""
        said += [
            f"{before}Within the calibrated range already: {fault}." for fault in sorted(faults) if part.measured
        ]
    if port.offset_jumps:
        said.append("With offset = grip the model itself has jumps of some mm/s, where a hold just touches a grip.")
    if port.model == "thesis":
        said.append(
            "This model repeats a printed computation: its bounces gain energy and jump at a change of phase."
        )
    return tuple(said)


def _fitted_range(port: Port) -> str:
    """How far the valid range reaches, in sentences."""
    (low, high), gain = port.calibrated, port.valid.gain
    known = "within the calibrated range" if port.measured else "at the speeds of a rally"
    gained = f"more kinetic energy than {100.0 * gain:.2g} %, as some do {known}" if gain > 0.0 else "kinetic energy"
    limits = f"as far as the model has a rebound, v_y2 grows with v_y1, and no bounce gains {gained}."
    if not port.measured:
        return f"It extends {limits}"
    fitted = f"The model was fitted to impacts from {low:.4g} to {high:.4g} m/s."
    return f"{fitted} The valid range extends beyond {limits}"


def _golden_rows(golden: Golden) -> Sequence[Sequence[float]]:
    given, made = golden.impacts, golden.rebound
    cor = np.full(len(given), np.nan) if given.cor is None else given.cor
    rebound = (getattr(made, name) for name in OUTPUTS)
    columns = [given.v_x1, given.v_y1, given.omega_1, cor, *rebound, np.zeros(len(given))]
    return list(map(tuple, np.stack(columns, axis=1).tolist()))


def status_reasons(port: Port) -> dict[int, str]:
    """Why an impact cannot be evaluated, by status."""
    numbers = "finite numbers, a finite cor" if port.needs_cor else "finite numbers"
    bad = {BAD_INPUT: f"expected {numbers}, and v_y1 >= 0 towards the court"}
    if port.arguments:
        levels = ", ".join(f"and as {item.name} one of {', '.join(item.names)}" for item in port.arguments)
        bad = {BAD_INPUT: f"expected {numbers}, v_y1 >= 0 towards the court, {levels}"}
    return bad | {int(status): STATUS_REASON[status] for status in Status if status is not Status.OK}


def rendered(port: Port, template: str, **context: object) -> str:
    """A template filled with the facts of a port, and `context`."""
    return _environment().get_template(template).render(
        port=port,
        titles=wrapped(port.titles),
        sentences=wrapped(range_sentences(port)),
        licence=_environment().get_template("licence.txt").render().splitlines(),
        reasons=status_reasons(port),
        flags=FLAGS,
        phases=[PHASE_SYMBOL.get(code, "") for code in range(len(PHASE_SYMBOL) + 1)],  # type: ignore[call-overload]
        tolerance=SELF_TEST_TOLERANCE,
        series_size=SERIES_SIZE,
        stack_size=STACK_SIZE,
        cor_argument=", cor" if port.needs_cor else "",
        golden=[row for part in port.sets or (port,) for row in part.golden],
        regimes=[regime for part in port.sets or (port,) for regime in part.regimes],
        counts=[len(part.regimes) for part in port.sets],
        golden_numbers=GOLDEN_NUMBERS,
        width=len(port.whole_row),
        speed_ends=[*SPEED_ENDS, *(CALIBRATED_ENDS if port.measured else ())],
        used="it was fitted" if port.measured else "it was set",
        bad_input=BAD_INPUT,
        level_arguments="".join(f", {item.name}" for item in port.arguments),
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
        functions="\n\n\n".join(_function(item, bool(port.arguments)) for item in source.functions),
    )


def _class(name: str, fields: Iterable[str]) -> str:
    """A class for a named tuple, which would need an import."""
    lines = [f"class {name}:", f"    def __init__(self, {', '.join(fields)}):"]
    return "\n".join([*lines, *(f"        self.{field} = {field}" for field in fields)])


def _function(function: ast.FunctionDef, ranges_behind: bool) -> str:
    """A kernel's text without annotations, which name types that a port does not have. With `ranges_behind` its row
    is longer than what it takes apart.
    """
    plain = ast.parse(ast.unparse(function)).body[0]
    assert isinstance(plain, ast.FunctionDef)
    plain.returns = None
    for argument in plain.args.args:
        argument.annotation = None
    for node in ast.walk(plain) if ranges_behind else ():
        match node:
            case ast.Assign(targets=[ast.Tuple() as names], value=ast.Name(id="row")):
                names.elts.append(ast.Starred(ast.Name("_ranges", ast.Store()), ast.Store()))
    return ast.unparse(plain)


assert PHASE_BITS == 3, "the templates unpack phases by three bits"
