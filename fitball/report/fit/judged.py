"""How far a fit is to be believed: does the model describe the table, how is each parameter known, what rests on
assumptions. As parts of its report.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TypeVar

from fitball.inference.results.assumptions import PACE, Alternative, Assumptions
from fitball.inference.results.evidence import FALSE_EXCEPT, MOVED, Adequacy, Answer, Check
from fitball.inference.results.results import Estimate, Fit, Verdict
from fitball.observables import OBSERVABLES
from fitball.report.form.document import Part, Row, Table, Words, judged
from fitball.report.form.numbers import (
    Scale,
    decimals,
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
    "What the residuals show beside what was stated, or expected before the table. Probability: of a noise as large, "
    "in any of them, if what was known of it is right."
)
PATTERNS = (
    "Of each kind and column the surest of its checks; `fit.json` has them all. Usual below: what 95 % of the tables "
    "stay below that the fitted model makes. Probability: that such a table shows as much in any of all checks."
)
EVIDENCE = (
    "Four kinds of evidence. Profile: where the likelihood of the measurements{0}, all other parameters refitted and "
    "no prior, falls by less than 1.92: 95 % intervals when rows are many, about {1:.0f} % for a table of this size. "
    "Information: the standard error to first order, in sds of the prior{2}. Contraction: one minus posterior over "
    "prior variance. Power-scaling: how much the posterior follows priors and likelihood (above 0.05 it does; "
    "Kallioinen et al. 2023)."
)
DIRECTIONS = (
    "Combinations of parameters from the best known to the least (eigenvectors of the Fisher information in sds of "
    "the priors; SI units)."
)
CHANGED = (
    "Each choice that the equations or the noise leave open, changed one at a time: does the table tell, and how far "
    "do the values move? {}"
)
SCORES = (
    "Score: log predictive density of impacts left out one at a time, with the standard error of the difference. As "
    "well: not surely worse, that is by less than two standard errors or less than 4. A value holds only given a "
    "choice where another one, as good, moves its median or an end of its 95 % interval outwards by more than two of "
    "its standard deviations. `fitball compare` fits such models in full."
)
CONSTANTS = (
    "Medians at both ends of what is known of a constant (two sds that the scene states, else the ITF's tolerance, "
    "0.53 to 0.59 for I/(M R^2) of a tennis ball), to first order. Listed is what moves by more than one of its sds. "
    "The scene takes an sd of each."
)


def adequacy_parts(fit: Fit) -> list[Part]:
    """Whether the model describes the table: what to do about it, noise, misfits, patterns, what it is based on."""
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
            "pattern looked for": it.words,
            "seen": significant(it.statistic, 2),
            "usual below": significant(it.usual, 2),
            "explains": "-" if it.explained is None else percent(it.explained),
            "probability": _chance(it.p),
            "": "exception" if it.found else "not found" if it.p > FALSE_EXCEPT else "far below the noise",
        }
        for it in sorted(surest.values(), key=lambda it: (KINDS.index(it.kind), it.column))
    ]
    return [
        Words(remarks(fit)),
        Table.of("Largest misfits", misfits, ["column"]),
        Words([NOISE], only="page"),
        Table.of("Fitted noise beside what was known of it", _noises(found), ["columns", ""], only="page"),
        Words([PATTERNS] * bool(patterns), only="page"),
        Table.of("Checks of the residuals", patterns, [""], only="page"),
        Words([found.based_on], "quiet"),
    ]


def _sureness(check: Check) -> tuple[float, float]:
    return check.p, -(check.explained or 0.0)


def remarks(fit: Fit) -> list[str]:
    """What to do about what was found, and what rests on it."""
    found = fit.adequacy
    assert found is not None
    fails, lines = found.answer is Answer.FAILS, []
    if not fails and (moved := {name: by for name, by in found.moved.items() if by > MOVED}):
        said = ", ".join(f"{name} by {significant(by, 2)}" for name, by in moved.items())
        lines.append(
            f"Without what was found parameters would move, in their sds: {said}; of these is conditional what would "
            "be identified."
        )
    seen: dict[str, list[Check]] = {}
    for check in found.checks:
        if check.found:
            seen.setdefault(check.kind, []).append(check)
    if "group" in seen and fit.problem.group_bias is None:
        asked = option("offsets", seen["group"][0].over)
        lines.append(f"If that group was measured differently: {asked} fits a bias of each.")
    if "level" in seen and not fit.problem.pooling:
        best = min(seen["level"], key=_sureness)
        name = best.words.partition(" ")[0]
        pooled = spoken(f"--pool {name}={best.over}", f"pool={{'{name}': '{best.over}'}}")
        lines.append(f"{pooled} fits {name} to each {best.over}.")
    if "uneven" in seen:
        lines.append(f"{option('noise', 'separate')} fits a noise of its own to each column.")
    if seen.keys() & {"outlier", "tails"} and not fit.problem.noise.parameters:
        lines.append(f"Outliers count for less with {option('noise', 'student-t')}.")
    if "linked" in seen and fit.problem.incident is None and not fails:
        lines.append(
            "Columns deviate together where the incident state was not what the table says: state its errors "
            "(columns such as v_1_sd)."
        )
    if fails:
        lines.append(
            "Look for a sign, a unit or a column that was read wrongly "
            + spoken("(fitball datasets check)", "(fitball.check)")
            + ", for another ball or surface among the impacts, and at other models "
            + spoken("(fitball compare).", "(fitball.compare).")
        )
    return lines


def conditional_words(parameters: Mapping[str, Estimate], adequacy: Adequacy | None) -> str:
    """What to add to a number that rests on all parameters, "" where the model describes the table."""
    if adequacy is not None and adequacy.answer is Answer.FAILS:
        return "conditional: the model does not describe the table"
    names = [name for name, item in parameters.items() if item.verdict is Verdict.CONDITIONAL]
    return f"conditional, as {', '.join(names)} is" if names else ""


def _noises(found: Adequacy) -> list[Row]:
    """Each noise as fitted beside what was known of it."""
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
                "": "exception" if check.found else "",
            }
        )
    return rows


def _chance(p: float) -> str:
    return "1" if p > 0.995 else f"{p:.2f}" if p >= 0.1 else significant(p, 2)


def evidence_parts(fit: Fit, pictures: Sequence[Part]) -> list[Part]:
    """Every look at every parameter, and which combinations of them are known; beside them those without what the
    scene knows of the contact time, if it knows anything.
    """
    found, scene = fit.identifiability, fit.problem.contact_time is not None
    also = (" and of the scene's contact time", ", with and without the scene's contact time") if scene else ("", "")
    directions = found.eigendirections
    combined = [{"combination": item.words, "known to": item.known_to} for item in directions.directions]
    if scene:
        combined = [
            row | {"without the scene: combination": alone.words, "known to, without": alone.known_to}
            for row, alone in zip(combined, directions.directions_without_scene, strict=True)
        ]
    held = listed(directions.held)
    ends = (
        f"The model ends next to the maximum in {held}: there is no derivative, and what is said to first order "
        f"takes {held} as fixed."
    )
    missing = f"There are no profiles: {found.profiles_missing}."
    return [
        Words([EVIDENCE.format(also[0], 100.0 * found.profile_coverage, also[1])], only="page"),
        Table.of("Evidence on each parameter", _looks(fit, scene), ["", "unit", "verdict"], only="page"),
        Words([*[missing] * bool(found.profiles_missing), *[ends] * bool(held)], "list"),
        *pictures,
        Words([DIRECTIONS] * bool(combined), only="page"),
        Table.of("Combinations of parameters", combined, ["without the scene: combination"], only="page"),
    ]


def _looks(fit: Fit, scene: bool) -> list[Row]:
    """Every look at every free parameter, dashes where there is none."""
    rows = []
    for name, item in fit.identifiability.evidence.items():
        estimate = fit.parameters[name]
        scale, look, power, acts = handy(name, estimate.unit), item.information, item.power, item.active_impacts
        row = named(fit, name, scale) | {"profile, 95 %": profile_interval(item.profile, scale)}
        if scene:
            row["without scene"] = "the same" if item.alone is None else profile_interval(item.alone, scale)
        errors = [] if look is None else [look.error, look.error_without_scene][: 1 + scene]
        told = " | ".join("none" if error is None else significant(error, 2) for error in errors)
        rows.append(
            row
            | {
                "information": told or "-",
                "contraction": "-" if item.contraction is None else f"{item.contraction.contraction:.2f}",
                "power: priors | likelihood": "-" if power is None else f"{power.prior:.2f} | {power.likelihood:.2f}",
                "acts in": "-" if acts is None else f"{acts.acting} of {acts.of}",
                "verdict": judged(estimate.verdict, estimate.verdict_words, estimate.reason),
            }
        )
    return rows


def named(fit: Fit, name: str, scale: Scale) -> Row:
    """How a row of the page that is about a parameter begins: name, symbol as on figures, unit."""
    label = next((item.spec.label for item in fit.problem.parameters if item.name == name), "")
    return {"parameter": name, "": symbol_cell(label), "unit": scale.unit}


def assumption_parts(fit: Fit) -> list[Part]:
    """What rests on assumptions; nothing where that was not asked."""
    found = fit.assumptions
    if found is None:
        return []
    parts: list[Part] = [Words([f"Not looked at: {found.missing}."])]
    if not found.missing:
        changes = [
            {
                "changed to": item.name,
                "from": item.instead_of,
                "score less this fit's": "-"
                if item.difference is None
                else plus_minus(item.difference.value, item.difference.se, 1),
                "describes the table": _verdict(item),
            }
            for item in found.alternatives
        ]
        parts = [
            Words([CHANGED.format(_sentence(found))], only="page"),
            Words([_sentence(found)], only="terminal"),
            Table.of(
                "What moves with the assumptions", _spans(fit, found), ["unit", "most by", "holds only given"],
                aside=("95 % over all", "holds only given"),
            ),
            Table.of("Choices changed", changes, ["changed to", "from", "describes the table"], only="page"),
            Words([SCORES], "quiet", "page"),
        ]  # fmt: skip
    moved = _moved_by_constants(fit, found)
    return [
        *parts,
        Table.of("What moves with constants of the ball", moved, ["quantity", "unit", "over", "in this fit"]),
        Words([CONSTANTS] * bool(moved), "quiet", "page"),
    ]


T = TypeVar("T")


def _quantities(fit: Fit, found: Mapping[str, T], paces: Mapping[str, T]) -> Iterator[tuple[str, Scale, T]]:
    """What was found of each quantity of the model and of the rating of each surface, with its unit."""
    known = {**fit.parameters, **fit.derived}
    for name, item in found.items():
        yield name, handy(name, known[name].unit if name in known else ""), item
    for surface, item in paces.items():
        yield f"{PACE} of {surface}" if surface else PACE, Scale(""), item


def _spans(fit: Fit, found: Assumptions) -> list[Row]:
    rows = []
    for name, scale, item in _quantities(fit, found.parameters, found.court_pace):
        places = scale.decimals(item.own.sd)
        rows.append(
            {
                "parameter": name,
                "unit": scale.unit,
                "within this fit": scale.plus_minus(item.own.median, item.own.sd),
                "over all as good": f"{scale.fixed(item.low, places)} to {scale.fixed(item.high, places)}",
                "95 % over all": scale.interval(item.q025, item.q975, places),
                "moved by [sd]": fixed(item.shift, 1),
                "most by": item.by,
                "holds only given": ", ".join(item.given),
            }
        )
    return rows


def _moved_by_constants(fit: Fit, found: Assumptions) -> list[Row]:
    """Each constant with the quantities that rest on it."""
    rows = []
    for constant in found.constants:
        own = handy(constant.name, fit.problem.model.specs[constant.name].unit)
        digits = decimals(0.1 * (own.factor * constant.high - own.factor * constant.low))
        low, high, value = (own.fixed(at, digits) for at in (constant.low, constant.high, constant.value))
        for name, scale, ends in _quantities(fit, constant.parameters, constant.court_pace):
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


# What is said of changes by their verdict, of one and of several.
CHANGES = {
    "as well": "describe{s} the table as well as this fit, within the error of the score",
    "not refused": "fit{s} too, and with so few impacts no score can refuse {them}",
    "better": "describe{s} it better",
    "worse": "describe{s} it worse",
    "not scored": "could not be scored",
}


def _sentence(found: Assumptions) -> str:
    """Which changes the table cannot tell from the fit, which it prefers, and which it refuses."""
    if not found.alternatives:
        return "No choice of the model can be changed here."
    parts = []
    for verdict, words in CHANGES.items():
        names = [item.name for item in found.alternatives if _verdict(item).partition(":")[0] == verdict]
        one = len(names) == 1
        parts += [f"{listed(names)} {words.format(s='s' * one, them='it' if one else 'them')}"] * bool(names)
    return f"Changed one at a time, {'; '.join(parts)}."


def _verdict(item: Alternative) -> str:
    if item.difference is None:
        return f"not scored: {item.reason}" if item.reason else "not refused"
    verdict = "better" if item.better else "as well" if item.as_good else "worse"
    return f"{verdict}: {item.reason}" if item.reason else verdict
