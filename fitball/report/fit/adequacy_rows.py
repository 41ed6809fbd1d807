"""Whether the model describes the table, as lines and rows of text for terminal and page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fitball.inference.results.adequacy import FALSE_EXCEPT, MOVED, Adequacy, Answer, Check, Misfit, NoiseCheck
from fitball.inference.results.results import Estimate, Fit, Verdict
from fitball.observables import OBSERVABLES
from fitball.report.form.display_units import output_scale
from fitball.report.form.rounding import significant
from fitball.report.form.text_table import Row
from fitball.wording import option, spoken

# The order in which kinds of checks are shown, of each and each column the surest; the file has them all.
KINDS = (
    "bias", "trend", "bend", "together", "regime", "group", "level", "row", "drift", "jointly", "spread", "order",
    "scatter", "linked", "uneven", "outlier", "tails", "loo-pit",
)  # fmt: skip


def adequacy_lines(fit: Fit) -> list[str]:
    """What stands on a terminal below the answer: what it is based on in one sentence, the rates on the page."""
    found = _of(fit)
    far = ", ".join(
        f"{row['impact']} {row['column']} {row['measured']} ({row['point']} at the point, {row['distance [sd]']} sd)"
        for row in map(misfit_row, found.misfits[:3])
    )
    based_on, end, _ = found.based_on.partition(". ")
    return [based_on + end.rstrip(), *remarks(fit), *([f"Largest misfits: {far}."] if far else [])]


def remarks(fit: Fit) -> tuple[str, ...]:
    """What to do about what was found, and what rests on it."""
    found = _of(fit)
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
    return tuple(lines)


def conditional_words(parameters: Mapping[str, Estimate], adequacy: Adequacy | None) -> str:
    """What to add to a number that rests on all parameters, "" where the model describes the table."""
    if adequacy is not None and adequacy.answer is Answer.FAILS:
        return "conditional: the model does not describe the table"
    names = [name for name, item in parameters.items() if item.verdict is Verdict.CONDITIONAL]
    return f"conditional, as {', '.join(names)} is" if names else ""


def _of(fit: Fit) -> Adequacy:
    assert fit.adequacy is not None
    return fit.adequacy


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
        "explains": "-" if check.explained is None else f"{100.0 * check.explained:.0f} %",
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
