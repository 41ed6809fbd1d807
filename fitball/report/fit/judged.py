"""How far a fit is to be believed: does the model describe the table, how is each parameter known, what rests on
assumptions. As parts of its report.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from fitball.inference.results.adequacy import FALSE_EXCEPT, MOVED, Adequacy, Answer, Check, Misfit, NoiseCheck
from fitball.inference.results.assumptions import PACE, Alternative, Assumptions, Constant, Span
from fitball.inference.results.evidence import InformationEvidence
from fitball.inference.results.results import Estimate, Fit, Verdict
from fitball.observables import OBSERVABLES
from fitball.report.form.document import Part, Row, Table, Words, judged
from fitball.report.form.numbers import (
    Scale,
    decimals,
    fixed,
    handy,
    interval,
    listed,
    output_scale,
    percent,
    plus_minus,
    significant,
)
from fitball.report.form.parameters import profile_interval, symbol_cell
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
    checks = [check_row(check) for check in surest(found.checks)]
    return [
        Words(remarks(fit)),
        Table.of("Largest misfits", [misfit_row(misfit) for misfit in found.misfits], ["column"]),
        Words([NOISE], only="page"),
        Table.of(
            "Fitted noise beside what was known of it", [noise_row(check) for check in found.noise], ["columns", ""],
            only="page",
        ),
        Words([PATTERNS] * bool(checks), only="page"),
        Table.of("Checks of the residuals", checks, [""], only="page"),
        Words([found.based_on], "quiet"),
    ]  # fmt: skip


def remarks(fit: Fit) -> list[str]:
    """What to do about what was found, and what rests on it."""
    found = fit.adequacy
    assert found is not None
    lines = []
    moved = {name: by for name, by in found.moved.items() if by > MOVED}
    if moved and found.answer is not Answer.FAILS:
        said = ", ".join(f"{name} by {significant(by, 2)}" for name, by in moved.items())
        lines.append(
            f"Without what was found parameters would move, in their sds: {said}; of these is conditional what would "
            "be identified."
        )
    kinds = {check.kind for check in found.checks if check.found}
    if "group" in kinds and fit.problem.group_bias is None:
        column = next(check.over for check in found.checks if check.found and check.kind == "group")
        lines.append(f"If that group was measured differently: {option('offsets', column)} fits a bias of each.")
    levels = [check for check in found.checks if check.found and check.kind == "level"]
    if levels and not fit.problem.pooling:
        best = min(levels, key=lambda check: (check.p, -(check.explained or 0.0)))
        name = best.words.partition(" ")[0]
        pooled = spoken(f"--pool {name}={best.over}", f"pool={{'{name}': '{best.over}'}}")
        lines.append(f"{pooled} fits {name} to each {best.over}.")
    if "uneven" in kinds:
        lines.append(f"{option('velocity_noise', 'separate')} fits a noise of its own to each column.")
    if kinds & {"outlier", "tails"} and not fit.problem.noise.parameters:
        lines.append(f"Outliers count for less with {option('noise', 'student-t')}.")
    if "linked" in kinds and fit.problem.incident is None and found.answer is not Answer.FAILS:
        lines.append(
            "Columns deviate together where the incident state was not what the table says: state its errors "
            "(columns such as v_1_sd)."
        )
    if found.answer is Answer.FAILS:
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


def surest(checks: Sequence[Check]) -> list[Check]:
    """The surest check of each kind and column, in the order of kinds."""
    kept: dict[tuple[str, str], Check] = {}
    for check in sorted(checks, key=lambda check: (check.p, -(check.explained or 0.0))):
        kept.setdefault((check.kind, check.column), check)
    return sorted(kept.values(), key=lambda check: (KINDS.index(check.kind), check.column))


def noise_row(check: NoiseCheck) -> Row:
    """A noise as fitted beside what was known of it."""
    scale, unit = 1.0, check.unit
    shown = OBSERVABLES[check.columns[0]].shown if check.columns[0] in OBSERVABLES else None
    if shown is not None and check.unit == OBSERVABLES[check.columns[0]].unit:
        unit, scale = shown
    known = "stated" if check.stated else "expected"
    return {
        "noise": check.noise,
        "columns": ", ".join(check.columns),
        "residuals": f"{significant(check.fitted * scale)} {unit}".rstrip(),
        "stated or expected": f"{f'{significant(check.reference * scale)} {unit}'.rstrip()} {known}",
        "ratio": significant(check.ratio, 2),
        "probability": _chance(check.adjusted),
        "": "exception" if check.found else "",
    }


def check_row(check: Check) -> Row:
    """A pattern that was looked for in the residuals."""
    return {
        "pattern looked for": check.words,
        "seen": significant(check.statistic, 2),
        "usual below": significant(check.usual, 2),
        "explains": "-" if check.explained is None else percent(check.explained),
        "probability": _chance(check.p),
        "": "exception" if check.found else "not found" if check.p > FALSE_EXCEPT else "far below the noise",
    }


def misfit_row(misfit: Misfit) -> Row:
    """A measurement that lies far from the point estimate."""
    scale = output_scale(misfit.column)
    return {
        "impact": misfit.id,
        "column": misfit.column,
        "measured": f"{significant(misfit.measured * scale.factor, 4)} {scale.unit}",
        "point": f"{significant(misfit.predicted * scale.factor, 4)} {scale.unit}",
        "distance [sd]": f"{misfit.distance:+.1f}",
    }


def _chance(p: float) -> str:
    return "1" if p > 0.995 else f"{p:.2f}" if p >= 0.1 else significant(p, 2)


def evidence_parts(fit: Fit, pictures: Sequence[Part]) -> list[Part]:
    """Every look at every parameter, and which combinations of them are known."""
    scene = fit.problem.contact_time is not None
    found = fit.identifiability
    also = (" and of the scene's contact time", ", with and without the scene's contact time") if scene else ("", "")
    combined = direction_rows(fit)
    return [
        Words([EVIDENCE.format(also[0], 100.0 * found.profile_coverage, also[1])], only="page"),
        Table.of("Evidence on each parameter", evidence_rows(fit), ["", "unit", "verdict"], only="page"),
        Words([
            *([f"There are no profiles: {found.profiles_missing}."] if found.profiles_missing else []),
            *([_ends(found.eigendirections.held)] if found.eigendirections.held else []),
        ], "list"),
        *pictures,
        Words([DIRECTIONS] * bool(combined), only="page"),
        Table.of("Combinations of parameters", combined, ["without the scene: combination"], only="page"),
    ]  # fmt: skip


def _ends(held: Sequence[str]) -> str:
    names = listed(held)
    return (
        f"The model ends next to the maximum in {names}: there is no derivative, and what is said to first order "
        f"takes {names} as fixed."
    )


def evidence_rows(fit: Fit) -> list[Row]:
    """Every look at every free parameter, dashes where there is none."""
    scene = fit.problem.contact_time is not None
    rows = []
    for name, item in fit.identifiability.evidence.items():
        estimate = fit.parameters[name]
        scale = handy(name, estimate.unit)
        row = named(fit, name, scale) | {"profile, 95 %": profile_interval(item.profile, scale)}
        if scene:
            row["without scene"] = "the same" if item.alone is None else profile_interval(item.alone, scale)
        power, acts = item.power, item.active_impacts
        rows.append(
            row
            | {
                "information": _information(item.information, scene),
                "contraction": "-" if item.contraction is None else f"{item.contraction.contraction:.2f}",
                "power: priors | likelihood": "-" if power is None else f"{power.prior:.2f} | {power.likelihood:.2f}",
                "acts in": "-" if acts is None else f"{acts.acting} of {acts.of}",
                "verdict": judged(estimate.verdict, estimate.verdict_words, estimate.reason),
            }
        )
    return rows


def _information(look: InformationEvidence | None, scene: bool) -> str:
    if look is None:
        return "-"
    errors = [look.error, look.error_without_scene] if scene else [look.error]
    return " | ".join("none" if error is None else significant(error, 2) for error in errors)


def direction_rows(fit: Fit) -> list[Row]:
    """Combinations from stiff to sloppy with what each is known to; beside them those without the scene, if it knows
    anything.
    """
    found = fit.identifiability.eigendirections
    rows = [{"combination": item.words, "known to": item.known_to} for item in found.directions]
    if fit.problem.contact_time is None:
        return rows
    return [
        row | {"without the scene: combination": alone.words, "known to, without": alone.known_to}
        for row, alone in zip(rows, found.directions_without_scene, strict=True)
    ]


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
        spans = [_span_row(*item) for item in _spans(fit, found)]
        parts = [
            Words([CHANGED.format(_sentence(found))], only="page"),
            Words([_sentence(found)], only="terminal"),
            Table.of(
                "What moves with the assumptions", spans, ["unit", "most by", "holds only given"],
                aside=("95 % over all", "holds only given"),
            ),
            Table.of(
                "Choices changed", [_choice_row(item) for item in found.alternatives],
                ["changed to", "from", "describes the table"], only="page",
            ),
            Words([SCORES], "quiet", "page"),
        ]  # fmt: skip
    moved = [_constant_row(fit, *item) for item in _by_constant(found)]
    return [
        *parts,
        Table.of("What moves with constants of the ball", moved, ["quantity", "unit", "over", "in this fit"]),
        Words([CONSTANTS] * bool(moved), "quiet", "page"),
    ]


def _scale(fit: Fit, name: str) -> Scale:
    unit = next((item.unit for item in (*fit.estimates, *fit.derived.values()) if item.name == name), "")
    return handy(name, unit)


def _by_constant(found: Assumptions) -> Iterator[tuple[Constant, str, tuple[float, float]]]:
    """Each constant with the quantities that rest on it."""
    for constant in found.constants:
        for name, ends in constant.parameters.items():
            yield constant, name, ends
        for surface, ends in constant.court_pace.items():
            yield constant, f"{PACE} of {surface}" if surface else PACE, ends


def _constant_row(fit: Fit, constant: Constant, name: str, ends: tuple[float, float]) -> Row:
    scale, own = _scale(fit, name), handy(constant.name, fit.problem.model.specs[constant.name].unit)
    shown = [scale.factor * end for end in ends]
    places = decimals(0.1 * abs(shown[1] - shown[0]))
    known = [own.factor * at for at in (constant.low, constant.high, constant.value)]
    digits = decimals(0.1 * (known[1] - known[0]))
    return {
        "quantity": name,
        "unit": scale.unit,
        "from": fixed(shown[0], places),
        "to": fixed(shown[1], places),
        "over": f"{constant.name} {fixed(known[0], digits)} to {fixed(known[1], digits)} {own.unit}".rstrip(),
        "in this fit": f"held at {fixed(known[2], digits)}"
        if constant.held
        else f"prior of {fixed(known[2], digits)}",
    }


def _spans(fit: Fit, found: Assumptions) -> list[tuple[str, Scale, Span]]:
    """Name, scale and span of each quantity, those of the model first."""
    rows = []
    for name, item in found.parameters.items():
        rows.append((name, _scale(fit, name), item))
    for surface, item in found.court_pace.items():
        rows.append((f"{PACE} of {surface}" if surface else PACE, Scale("", 1.0), item))
    return rows


def _span_row(name: str, scale: Scale, item: Span) -> Row:
    factor = scale.factor
    places = decimals(item.own.sd * factor)
    return {
        "parameter": name,
        "unit": scale.unit,
        "within this fit": plus_minus(item.own.median * factor, item.own.sd * factor, places),
        "over all as good": f"{fixed(item.low * factor, places)} to {fixed(item.high * factor, places)}",
        "95 % over all": interval(item.q025 * factor, item.q975 * factor, places),
        "moved by [sd]": fixed(item.shift, 1),
        "most by": item.by,
        "holds only given": ", ".join(item.given),
    }


def _choice_row(item: Alternative) -> Row:
    scored = item.difference
    return {
        "changed to": item.name,
        "from": item.instead_of,
        "score less this fit's": "-" if scored is None else plus_minus(scored.value, scored.se, 1),
        "describes the table": _verdict(item),
    }


def _sentence(found: Assumptions) -> str:
    """Which changes the table cannot tell from the fit, which it prefers, and which it refuses."""
    if not found.alternatives:
        return "No choice of the model can be changed here."
    groups = (
        ("describe the table as well as this fit, within the error of the score", "as well"),
        ("fit too, and with so few impacts no score can refuse them", "not refused"),
        ("describe it better", "better"),
        ("describe it worse", "worse"),
        ("could not be scored", "not scored"),
    )
    parts = []
    for words, verdict in groups:
        names = [item.name for item in found.alternatives if _verdict(item).partition(":")[0] == verdict]
        if names:
            parts.append(f"{listed(names)} {words if len(names) > 1 else _singular(words)}")
    return "Changed one at a time, " + "; ".join(parts) + "."


def _singular(words: str) -> str:
    for plural, single in (("describe ", "describes "), ("fit too", "fits too"), ("refuse them", "refuse it")):
        words = words.replace(plural, single, 1)
    return words


def _verdict(item: Alternative) -> str:
    if item.difference is None:
        return f"not scored: {item.reason}" if item.reason else "not refused"
    verdict = "better" if item.better else "as well" if item.as_good else "worse"
    return f"{verdict}: {item.reason}" if item.reason else verdict
