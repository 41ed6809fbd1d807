"""How far a fit can be trusted, as parts of its report: does the model fit the data, what determines each parameter,
how do results depend on model assumptions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TypeVar

from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.observables import beyond_stated
from fitball.inference.results.assumptions import CONTACT_TIME, PACE, Alternative, Assumptions, Span
from fitball.inference.results.assumptions import MOVED as MOVED_SDS
from fitball.inference.results.evidence import FALSE_EXCEPT, MOVED, Adequacy, Answer, Check
from fitball.inference.results.results import Estimate, Fit, Verdict
from fitball.inference.results.sentences import HINTS, RESIDUALS, capital
from fitball.models.specs import BALL_SPECS
from fitball.observables import OBSERVABLES
from fitball.report.form.document import Part, Row, Table, Words, judged
from fitball.report.form.numbers import (
    Scale,
    decimals,
    digits,
    fixed,
    handy,
    listed,
    output_scale,
    percent,
    plus_minus,
    profile_interval,
    significant,
    symbol_cell,
)
from fitball.wording import option, spoken

# The order in which kinds of checks are shown, of each and each column the surest; the file has them all.
KINDS = (
    "bias", "trend", "bend", "together", "regime", "group", "level", "row", "drift", "jointly", "spread", "order",
    "scatter", "linked", "uneven", "outlier", "tails", "loo-pit",
)  # fmt: skip
NOISE = (
    "Residuals beside the noise that was stated, or expected before the fit. Probability: of residuals this large in "
    "any column, if that noise is right."
)
PATTERNS = (
    "Of each kind of test and each column the test with the smallest probability; `fit.json` has all of them. Limit: "
    "95 % of the data sets simulated from the fitted model are below it. Probability: that a simulated data set "
    "shows as much in any of all tests."
)
EVIDENCE = (
    "Profile: 95 % interval of the profile likelihood of the measurements{0}, without priors. It covers the truth in "
    "95 % of large data sets, and in about {1:.0f} % of data sets of this size. Information: first-order standard "
    "error, in sds of the prior{2}. Contraction: one minus posterior variance over prior variance. Power-scaling: "
    "how sensitive the posterior is to priors and to the likelihood; above 0.05 it is (Kallioinen et al. 2024)."
)
DIRECTIONS = (
    "Combinations of parameters, from the best determined to the least: eigenvectors of the Fisher information, in "
    "sds of the priors (SI units)."
)
SCORES = (
    "Score: log predictive density of impacts left out one at a time, with the standard error of the difference. A "
    "variant fits equally well unless it is significantly worse: by more than two standard errors and by more than "
    "4. A value depends on an assumption if a variant that fits equally well moves it by more than two of its "
    "sds. What counts is the median, or an end of the 95 % interval outwards. To fit variants in full: "
    "`fitball compare`."
)
CONSTANTS = (
    "Medians at both ends of the range of a constant, to first order. The range is two stated sds, else the ITF's "
    "tolerance, or 0.53 to 0.59 for I/(M R^2) of a tennis ball. Only shifts of more than one sd are listed. The "
    "scene takes an sd of each constant."
)
# The answer in a few words.
ANSWERS = {
    Answer.DESCRIBES: "yes", Answer.EXCEPT: "with exceptions", Answer.FAILS: "no",
    Answer.UNDECIDED: "too few data to test",
}  # fmt: skip


def adequacy_parts(fit: Fit) -> list[Part]:
    """Whether the model fits the data: what to do about it, noise, misfits, residual tests, what it is based on."""
    found = fit.adequacy
    assert found is not None
    surest: dict[tuple[str, str], Check] = {}
    for check in sorted(found.checks, key=_sureness):
        surest.setdefault((check.kind, check.column), check)
    misfits = [
        {
            "impact": it.id,
            "column": it.column,
            "measured": output_scale(it.column).measured(it.measured, 4),
            "point": output_scale(it.column).measured(it.predicted, 4),
            "distance [sd]": f"{it.distance:+.1f}",
        }
        for it in found.misfits
    ]
    patterns = [
        {
            "test": it.words,
            "statistic": significant(it.statistic, 2),
            "limit": significant(it.usual, 2),
            "variance explained": "-" if it.explained is None else percent(it.explained),
            "probability": _chance(it.p),
            "": "found" if it.found else "not found" if it.p > FALSE_EXCEPT else "far below the noise",
        }
        for it in sorted(surest.values(), key=lambda it: (KINDS.index(it.kind), it.column))
    ]
    return [
        Words([found.sentence, *remarks(fit), *([] if _repeats_matter(found) else found.repeats)]),
        Table.from_rows("Largest misfits", misfits, ["column"]),
        Words([NOISE], only="page"),
        Table.from_rows("Fitted noise, and noise stated or expected", _noises(found), ["columns", ""], only="page"),
        Words([PATTERNS] * bool(patterns), only="page"),
        Table.from_rows("Residual tests", patterns, [""], only="page"),
        Words([found.based_on], "quiet"),
    ]


# How sentences begin that a first screen has no room for: sizes of residuals, and hints that may be chance.
DETAILS = tuple(capital(template.partition("{")[0]) for template in (RESIDUALS, HINTS))


def brief_answer(sentence: str) -> str:
    """The sentences of an answer without details, which are with the residual tests."""
    parts = re.split(r"(?<=[.]) (?=[A-Z])", sentence)
    return " ".join(part for part in parts if not part.startswith(DETAILS))


def _sureness(check: Check) -> tuple[float, float]:
    return check.p, -(check.explained or 0.0)


def remarks(fit: Fit) -> list[str]:
    """What to do about what was found, and what depends on it."""
    found = fit.adequacy
    assert found is not None
    fails, lines = found.answer is Answer.FAILS, []
    scatter = {item.name for item in fit.scatter}
    if not fails and (moved := {name: by for name, by in found.moved.items() if by > MOVED and name not in scatter}):
        shifts = ", ".join(f"{name} by {significant(by, 2)} sd" for name, by in moved.items())
        lines.append(f"Removing what the model misses would shift {shifts}. These values are conditional.")
    seen: dict[str, list[Check]] = {}
    for check in found.checks:
        if check.found:
            seen.setdefault(check.kind, []).append(check)
    explained = {item.column for item in fit.differences if item.found and not item.fitted}
    if "group" in seen and fit.problem.group_bias is None and seen["group"][0].over not in explained:
        asked = option("offsets", seen["group"][0].over)
        lines.append(f"If that group was measured differently, use {asked}: it fits a bias of each group.")
    if "uneven" in seen:
        lines.append(f"To fit a separate noise for each column, use {option('noise', 'separate')}.")
    if seen.keys() & {"outlier", "tails"} and not fit.problem.noise.parameters:
        lines.append(f"To give outliers less weight, use {option('noise', 'student-t')}.")
    if "linked" in seen and not fit.problem.uncertain and not fails:
        lines.append(
            "Correlated residuals may come from errors of the incident state. State these in columns such as v_1_sd."
        )
    if any(item.found and item.stated and item.ratio > 1.0 for item in found.noise):
        lines.append(
            "The stated noise is smaller than the residuals. State standard deviations: a 95 % accuracy is about "
            "two. Errors of the incident state belong in columns such as v_1_sd. Without a stated noise it is fitted."
        )
    if found.repeats and _repeats_matter(found):
        lines.append(" ".join(found.repeats))
    if fails:
        lines.append(
            "Check for a wrong sign, unit or column "
            + spoken("(fitball datasets check)", "(fitball.check)")
            + ", and for a second ball or surface in the table. Then try other models "
            + spoken("(fitball compare).", "(fitball.compare).")
        )
    return lines


def _repeats_matter(found: Adequacy) -> bool:
    """Whether it matters for the answer how far measurements repeat."""
    return found.answer in (Answer.FAILS, Answer.EXCEPT) or bool(found.scattering)


def conditional_words(parameters: Mapping[str, Estimate], adequacy: Adequacy | None) -> str:
    """What to add to a number that depends on all parameters, "" where the model fits the data."""
    if adequacy is not None and adequacy.answer is Answer.FAILS:
        return "conditional: the model does not fit the data"
    names = [name for name, item in parameters.items() if item.verdict is Verdict.CONDITIONAL]
    return f"conditional, as {listed(names, 3)} {'is' if len(names) == 1 else 'are'}" if names else ""


def _noises(found: Adequacy) -> list[Row]:
    """Each noise as fitted, and as it was stated or expected."""
    rows = []
    for check in found.noise:
        column, scale = check.columns[0], Scale(check.unit)
        if column in OBSERVABLES and OBSERVABLES[column].unit == check.unit:
            scale = output_scale(column)
        rows.append(
            {
                "noise": check.noise,
                "columns": ", ".join(check.columns),
                "residuals": scale.measured(check.fitted),
                "stated or expected": f"{scale.measured(check.reference)} {'stated' if check.stated else 'expected'}",
                "ratio": significant(check.ratio, 2),
                "probability": _chance(check.adjusted),
                "": "found" if check.found else "",
            }
        )
    return rows


def _chance(p: float) -> str:
    return "1" if p > 0.995 else f"{p:.2f}" if p >= 0.1 else significant(p, 2)


def evidence_parts(fit: Fit, pictures: Sequence[Part]) -> list[Part]:
    """The evidence on every parameter, and which combinations of them the data determine; both without the contact
    time of the scene too, where it states one.
    """
    found, scene = fit.identifiability, fit.problem.contact_time is not None
    also = (" and of the scene's contact time", ", with and without the scene's contact time") if scene else ("", "")
    directions = found.eigendirections
    combined = [{"combination": item.words, "standard error": item.known_to} for item in directions.directions]
    if scene:
        combined = [
            row | {"without the scene: combination": alone.words, "standard error, without": alone.known_to}
            for row, alone in zip(combined, directions.directions_without_scene, strict=True)
        ]
    held = listed(directions.held)
    ends = (
        f"The best value of {held} is at the edge of the model, where there is no derivative. First-order results "
        f"take {held} as fixed."
    )
    missing = f"No profile likelihoods: {found.profiles_missing}."
    return [
        Words([EVIDENCE.format(also[0], 100.0 * found.profile_coverage, also[1])], only="page"),
        Table.from_rows("Evidence on each parameter", _looks(fit, scene), ["", "unit", "verdict"], only="page"),
        Words([*[missing] * bool(found.profiles_missing), *[ends] * bool(held)], "list"),
        *pictures,
        Words([DIRECTIONS] * bool(combined), only="page"),
        Table.from_rows("Combinations of parameters", combined, ["without the scene: combination"], only="page"),
    ]


def _looks(fit: Fit, scene: bool) -> list[Row]:
    """The evidence on every free parameter, dashes where there is none."""
    rows = []
    for name, item in fit.identifiability.evidence.items():
        estimate = fit.parameters[name]
        scale, look, power, acts = handy(name, estimate.unit), item.information, item.power, item.active_impacts
        row = named(fit, name, scale) | {"profile, 95 %": profile_interval(item.profile, scale)}
        if scene:
            row["without scene"] = "the same" if item.alone is None else profile_interval(item.alone, scale)
        errors = [] if look is None else [look.error, look.error_without_scene][: 1 + scene]
        texts = " | ".join("none" if error is None else significant(error, 2) for error in errors)
        rows.append(
            row
            | {
                "information": texts or "-",
                "contraction": "-" if item.contraction is None else f"{item.contraction.contraction:.2f}",
                "power: priors | likelihood": "-" if power is None else f"{power.prior:.2f} | {power.likelihood:.2f}",
                "acts in": "-" if acts is None else f"{acts.acting} of {acts.total}",
                "verdict": judged(estimate.verdict, estimate.verdict_words, estimate.reason),
            }
        )
    return rows


def named(fit: Fit, name: str, scale: Scale) -> Row:
    """How a row of the page that is about a parameter begins: name, symbol as on figures, unit."""
    label = next((item.spec.label for item in fit.problem.parameters if item.name == name), "")
    return {"parameter": name, "": symbol_cell(label), "unit": scale.unit}


def assumption_parts(fit: Fit, pictures: Sequence[Part]) -> list[Part]:
    """How results depend on model assumptions; nothing where that was not asked."""
    found = fit.assumptions
    if found is None:
        return []
    moved = Table.from_rows(
        "Shifts with constants of ball and camera",
        _moved_by_constants(fit, found),
        ["quantity", "unit", "over", "in this fit"],
    )
    constants: list[Part] = [moved, Words([CONSTANTS] * bool(moved), "quiet", "page"), Words(tilt_line(fit), "quiet")]
    if found.missing:
        return [Words([f"Not examined: {found.missing}."]), *constants]
    changes = [
        {
            "changed to": item.name,
            "from": item.instead_of,
            "score less this fit's": "-"
            if item.difference is None
            else plus_minus(item.difference.value, item.difference.se, 1),
            "fits": _verdict(item),
        }
        for item in found.alternatives
    ]
    return [
        Words([_sentence(found)]),
        *pictures,
        Table.from_rows(
            "Values over all variants that fit equally well", _spans(fit, found), ["unit", "with", "depends on"],
            aside=("95 % over all", "depends on"), rank="folded",
        ),
        Table.from_rows("Model variants", changes, ["changed to", "from", "fits"], only="page", rank="folded"),
        Words([SCORES], "quiet", "page"),
        *constants,
    ]  # fmt: skip


T = TypeVar("T")


def quantities(fit: Fit, found: Mapping[str, T], paces: Mapping[str, T]) -> Iterator[tuple[str, Scale, T]]:
    """What was found of each quantity of the model and of the rating of each surface, with its unit."""
    known, scatter = {**fit.parameters, **fit.derived}, {item.name for item in fit.scatter}
    for name, item in found.items():
        if name in scatter:
            continue
        yield name, handy(name, known[name].unit if name in known else ""), item
    for surface, item in paces.items():
        yield f"{PACE} of {surface}" if surface else PACE, Scale(""), item


def _spans(fit: Fit, found: Assumptions) -> list[Row]:
    rows = []
    for name, scale, item in quantities(fit, found.parameters, found.court_pace):
        places = scale.decimals(item.own.sd)
        rows.append(
            {
                "parameter": name,
                "unit": scale.unit,
                "this fit": scale.plus_minus(item.own.median, item.own.sd),
                "medians over all": f"{scale.fixed(item.low, places)} to {scale.fixed(item.high, places)}",
                "95 % over all": scale.interval(item.q025, item.q975, places),
                "shift [sd]": fixed(item.shift, 1),
                "with": item.by,
                "depends on": ", ".join(item.given),
            }
        )
    return rows


def assumption_line(fit: Fit) -> list[str]:
    """The assumptions that values depend on, how many variants fit equally well, and the largest shift among them."""
    given = dict.fromkeys(one for item in fit.reported for one in item.given)
    lines = [f"Values move, by so many sd, with these assumptions: {', '.join(given)}."] if given else []
    return [*lines, *_variants(fit, fit.assumptions)]


def _variants(fit: Fit, found: Assumptions | None) -> list[str]:
    if found is None:
        return []
    if found.missing:
        return [f"Model assumptions: not examined, {found.missing}."]
    count, good = len(found.alternatives), len(found.as_good)
    if not good:
        return [f"Model assumptions: none of {count} model variants fits equally well."]
    widest = _widest(fit, found)
    friction = [
        one
        for one in quantities(fit, found.parameters, {})
        if one[0].partition("[")[0] == "mu" and one[0] != widest[0]
    ]
    medians = [f"that of {name} {_ends(scale, span)}" for name, scale, span in friction]
    first = f"the median of {widest[0]} {_ends(*widest[1:])} (with {widest[2].by})"
    return [f"Model variants: {good} of {count} fit equally well. Over these, {listed([first, *medians])}."]


def brief_verdict(fit: Fit, estimate: Estimate) -> str:
    """A verdict in a few letters: of a value that assumptions move, by how many of its sds they move the median; of
    one whose interval alone they widen, its end.
    """
    found = None if fit.assumptions is None else fit.assumptions.parameters.get(estimate.name)
    if estimate.given == (CONTACT_TIME,):
        return "by contact time"
    if fit.assumptions is None or found is None or estimate.verdict is not Verdict.GIVEN or not found.own.sd > 0.0:
        return estimate.verdict
    ends = [end for one in fit.assumptions.constants for end in one.parameters.get(estimate.name, ())]
    moves = [found.shift, *(abs(end - found.own.median) / found.own.sd for end in ends)]
    wider = max(found.own.q025 - found.q025, found.q975 - found.own.q975) / found.own.sd
    if max(moves) <= MOVED_SDS < wider:
        return f"end moves {digits(wider, 2)} sd"
    return f"moves {digits(max(moves), 2)} sd"


# Surfaces whose friction is named beside the quantity that shifts most.
FRICTIONS = 3


def _ends(scale: Scale, span: Span) -> str:
    """Between which values the median lies over the variants that fit equally well."""
    places, factor = scale.decimals(span.own.sd), "x " * scale.unit[:1].isdigit()
    return (
        f"goes from {scale.fixed(span.low, places)} to {scale.fixed(span.high, places)} {factor}{scale.unit}".rstrip()
    )


def _widest(fit: Fit, found: Assumptions) -> tuple[str, Scale, Span]:
    """The quantity that shifts most between variants that fit equally well."""
    return max(quantities(fit, found.parameters, found.court_pace), key=lambda quantity: quantity[2].shift)


def next_line(fit: Fit) -> list[str]:
    """What would help most: to determine what is not, else to separate the variants that matter; nothing where the
    model does not fit.
    """
    if fit.adequacy is not None and fit.adequacy.answer is Answer.FAILS:
        return []
    open_ended = (Verdict.PRIOR_DOMINATED, Verdict.ONE_SIDED)
    # Nobody needs to know how much less than the stated errors a scatter is that was not found, nor more of a camera
    # or a ball than was measured apart, or of the tails of a noise.
    known = {*beyond_stated(fit.problem.observables), *fit.problem.known_apart, "degrees_of_freedom"}
    unknown = [item.name for item in fit.reported if item.verdict in open_ended and item.name not in known]
    if "k_y" in unknown and fit.problem.contact_time is None:
        stiff = listed([name for name in unknown if name in ("k_y", "k_theta")])
        source = "the contact time (scene, force records), or gap_time from a film"
        return [f"Most useful next: {source}. It determines {stiff}."]
    if unknown:
        plan = spoken("`fitball plan`", "`fit.plan`")
        return [f"Most useful next: impacts that determine {listed(unknown)}; {plan} proposes them."]
    found = fit.assumptions
    if found is None or found.missing or not found.as_good:
        return []
    widest = _widest(fit, found)[2]
    instead = next(item.instead_of for item in found.as_good if item.name == widest.by)
    if widest.shift <= MOVED_SDS:
        return []
    return [f"Most useful next: data that decide between {instead} and {widest.by}."]


# Values that a tilt moves which are named.
TILTED = 3
TILT_ADVICE = "if balls were filmed, state tilt in [camera] of the scene"


def tilt_line(fit: Fit) -> list[str]:
    """What a tilt of the camera would move of which nothing is stated."""
    found = fit.assumptions
    if found is None or found.tilt is None:
        return []
    ends = found.tilt.parameters
    moves = {
        name: max(abs(end - item.own.median) for end in ends[name]) / item.own.sd
        for name, item in found.parameters.items()
        if name in ends and item.own.sd > 0.0
    }
    what = f"A camera tilted by {math.degrees(found.tilt.high):.2g} deg would move"
    if not moves:
        return [f"{what} no value by more than 1 sd."]
    strongest = sorted(moves, key=lambda name: -moves[name])[:TILTED]
    more = f" and {len(moves) - TILTED} more" if len(moves) > TILTED else ""
    return [f"{what} {listed([f'{name} by {moves[name]:.1f} sd' for name in strongest])}{more}: {TILT_ADVICE}."]


def _moved_by_constants(fit: Fit, found: Assumptions) -> list[Row]:
    """Each constant with the quantities that depend on it."""
    rows = []
    for constant in found.constants:
        specs = {**BALL_SPECS, **CAMERA_SPECS}
        own = handy(constant.name, specs[constant.name.partition("[")[0]].unit)
        digits = decimals(0.1 * (own.factor * constant.high - own.factor * constant.low))
        low, high, value = (own.fixed(at, digits) for at in (constant.low, constant.high, constant.value))
        for name, scale, ends in quantities(fit, constant.parameters, constant.court_pace):
            places = decimals(0.1 * abs(scale.factor * ends[1] - scale.factor * ends[0]))
            rows.append(
                {
                    "quantity": name,
                    "unit": scale.unit,
                    "from": scale.fixed(ends[0], places),
                    "to": scale.fixed(ends[1], places),
                    "over": f"{constant.name} {low} to {high} {own.unit}".rstrip(),
                    "in this fit": f"held at {value}" if constant.held else f"prior of {value}",
                }
            )
    return rows


def pace_moves(fit: Fit) -> list[str]:
    """How ratings by the model depend on constants, as sentences."""
    found = () if fit.assumptions is None else _moved_by_constants(fit, fit.assumptions)
    return [
        f"The {row['quantity']} by the model goes from {row['from']} to {row['to']} over {row['over']} "
        f"({row['in this fit']})."
        for row in found
        if row["quantity"].startswith(PACE)
    ]


# How well a variant fits, and the sentence about one or several that do.
CHANGES = {
    "better": "fit{s} significantly better",
    "equally well": "fit{s} equally well",
    "too few data": "fit{s} too; with so few impacts the scores cannot be compared",
    "worse": "fit{s} significantly worse",
    "not scored": "could not be scored",
}


def _sentence(found: Assumptions) -> str:
    """Which variants fit better, equally well and worse."""
    if not found.alternatives:
        return "This model has no assumption that can be changed."
    parts = []
    for verdict, words in CHANGES.items():
        names = [item.name for item in found.alternatives if _verdict(item).partition(":")[0] == verdict]
        parts += [f"{listed(names)} {words.format(s='s' * (len(names) == 1))}."] * bool(names)
    return f"The assumptions were changed one at a time. {' '.join(parts)}"


def _verdict(item: Alternative) -> str:
    if item.difference is None:
        return f"not scored: {item.reason}" if item.reason else "too few data"
    verdict = "better" if item.better else "equally well" if item.as_good else "worse"
    return f"{verdict}: {item.reason}" if item.reason else verdict
