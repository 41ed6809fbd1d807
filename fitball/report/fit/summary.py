"""A fit as rows of text and numbers, shared by terminal, page and files; nothing is laid out here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from markupsafe import Markup

from fitball.inference.results.quantiles import ESSENTIALS, quantiles
from fitball.inference.results.results import Diagnostics, Estimate, Fit, RunStatus
from fitball.inference.thesis.published_cases import wang_rows
from fitball.models.types import regime_name
from fitball.report.figures.measured import prediction, prediction_of
from fitball.report.fit.budget_rows import budget_line
from fitball.report.form.display_units import THESIS, Scale, handy, output_scale
from fitball.report.form.palette import verdict_html, verdict_mark
from fitball.report.form.rounding import decimals, fixed, interval, significant
from fitball.report.form.sentences import listed
from fitball.report.form.symbols import symbol_html
from fitball.report.form.text_table import Row
from fitball.wording import spoken

# Heads of the columns that show fields of a `ParameterRow`.
NUMBERS = {"median": "median", "68 %": "interval_68", "95 %": "interval_95", "point": "point"}


@dataclass(frozen=True)
class ParameterRow:
    """One parameter as text, in one system of units; intervals are empty without a posterior. `mark` is the verdict
    as style sheets name it.
    """

    name: str
    unit: str
    median: str
    sd: str
    interval_68: str
    interval_95: str
    point: str
    prior: str
    contraction: str
    verdict: str
    reason: str
    mark: str = ""


def _rounded(numbers: Mapping[str, Any], factor: float) -> dict[str, str]:
    """Point, median, sd and intervals, times a factor, as text to the places that the sd tells; "-" for what a run
    without posterior has not.
    """
    scaled = {name: None if numbers[name] is None else numbers[name] * factor for name in ("point", *ESSENTIALS)}
    if scaled["median"] is None or scaled["sd"] is None:
        absent = dict.fromkeys(("median", "sd", "interval_68", "interval_95"), "-")
        return absent | {"point": significant(scaled["point"], 4)}
    places = decimals(scaled["sd"])
    return {
        **{name: fixed(scaled[name], places) for name in ("median", "sd", "point")},
        "interval_68": interval(scaled["q16"], scaled["q84"], places),
        "interval_95": interval(scaled["q025"], scaled["q975"], places),
    }


def _row(estimate: Estimate, scale: Scale) -> ParameterRow:
    contraction = None if estimate.median is None else estimate.contraction
    return ParameterRow(
        name=estimate.name,
        unit=scale.unit,
        prior=estimate.prior,
        contraction="-" if contraction is None else f"{contraction:.2f}",
        verdict=estimate.verdict_words,
        reason=estimate.reason,
        mark=verdict_mark(estimate.verdict),
        **_rounded(vars(estimate), scale.factor),
    )


def parameter_row(estimate: Estimate) -> ParameterRow:
    """One parameter in handy multiples of SI; its prior is quoted in SI itself."""
    return _row(estimate, handy(estimate.name, estimate.unit))


def parameter_rows(fit: Fit) -> tuple[ParameterRow, ...]:
    """Every parameter, and what follows from several."""
    return tuple(map(parameter_row, (*fit.estimates, *fit.derived.values())))


def measured_lines(fit: Fit) -> tuple[str, ...]:
    """What comes first where lines are anchored at a speed that was not measured: their values at one that was."""
    if fit.drop_test is not None:
        return ()
    speeds = fit.problem.impacts.v_y1
    lines = []
    for item in fit.derived.values():
        if " at " in item.name:
            row = parameter_row(item)
            value = row.point if row.median == "-" else f"{row.median} {row.interval_95}"
            among = f"{significant(float(speeds.min()), 2)} to {significant(float(speeds.max()), 2)} m/s measured"
            sure = " (95 %)" if row.median != "-" else ""
            lines.append(f"{item.name}: {value}{f' {row.unit}' if row.unit else ''}{sure}, {row.verdict}; {among}.")
    return tuple(lines)


def named(fit: Fit, name: str, scale: Scale) -> Row:
    """How a row of the page that is about a parameter begins: name, symbol as on figures, unit."""
    label = next((item.spec.label for item in fit.problem.parameters if item.name == name), "")
    return {"parameter": name, "": symbol_html(label), "unit": scale.unit}


def verdict_cell(estimate: Estimate) -> Markup:
    """The verdict of a parameter as the page has it."""
    return verdict_html(estimate.verdict, estimate.verdict_words, estimate.reason)


def numbers_of(row: ParameterRow, sampled: bool) -> Row:
    """Median and intervals, where there is a posterior, and the point estimate, by their heads."""
    return {head: getattr(row, field) for head, field in NUMBERS.items() if sampled or field == "point"}


def parameter_table(fit: Fit) -> tuple[Row, ...]:
    """Every parameter, as the page has it."""
    sampled, rows = fit.posterior is not None, []
    for item, row in zip((*fit.estimates, *fit.derived.values()), parameter_rows(fit), strict=True):
        cells = named(fit, item.name, handy(item.name, item.unit)) | {"meaning": item.meaning}
        cells |= numbers_of(row, sampled) | {"prior (SI)": item.prior}
        rows.append(cells | ({"contraction": row.contraction} if sampled else {}) | {"verdict": verdict_cell(item)})
    return tuple(rows)


def level_rows(fit: Fit) -> tuple[Row, ...]:
    """What each surface, ball or table has of a parameter that differs between them; empty where none does."""
    rows = []
    for level in fit.levels:
        scale = handy(level.parameter, level.unit)
        numbers = _rounded(vars(level), scale.factor)
        place = {"level": f"{level.parameter}[{level.label}]", "unit": scale.unit, "impacts": str(level.impacts)}
        rows.append(place | {head: numbers[field] for head, field in NUMBERS.items()})
    return tuple(rows)


def thesis_rows(fit: Fit) -> tuple[ParameterRow, ...]:
    """The parameters that the thesis quotes in units of its own, in those, with `C1`, `C2` of its Eq. (51); none
    where the data are not the thesis's.
    """
    if wang_rows(fit.problem.table) is None:
        return ()
    rows = [_row(estimate, THESIS[estimate.name]) for estimate in fit.estimates if estimate.name in THESIS]
    renamed = [replace(row, name="C1 = eps_slope") if row.name == "eps_slope" else row for row in rows]
    return (*renamed, *_offset_at_zero(fit))


def _offset_at_zero(fit: Fit) -> list[ParameterRow]:
    """`C2` of `eps = C1 v_y + C2`: the offset line at zero speed, `eps_10 - 10 eps_slope`, draw by draw."""
    if not {"eps_10", "eps_slope"} <= fit.point.values.keys():
        return []

    def at_zero(values: Mapping[str, Any]) -> Any:
        return (values["eps_10"] - 10.0 * values["eps_slope"]) * THESIS["eps_10"].factor

    numbers: dict[str, float | None] = dict.fromkeys(ESSENTIALS) | {"point": at_zero(fit.point.values)}
    if fit.posterior is not None and {"eps_10", "eps_slope"} & set(fit.problem.free_names):
        draws = at_zero(fit.problem.all_values(fit.posterior.draws))
        numbers |= {"sd": float(np.std(draws)), **quantiles(draws)}
    reason = "derived: eps_10 - 10 eps_slope"
    return [ParameterRow("C2", "in", prior="", contraction="-", verdict="", reason=reason, **_rounded(numbers, 1.0))]


def prediction_table(fit: Fit, most: int | None = None) -> tuple[Row, ...]:
    """Measured | predicted: the posterior median with the 68 % half-width of the noise-free prediction, or the point
    estimate where there is no posterior; of the first `most` impacts, with the regime and its probability.
    """
    problem = fit.problem
    impacts = problem.impacts
    shown = range(len(impacts))[:most]
    theta = np.degrees(np.arctan2(impacts.v_y1, impacts.v_x1))
    speed = np.hypot(impacts.v_x1, impacts.v_y1)
    columns: dict[str, list[str]] = {}
    for observable in (item.everywhere(len(impacts)) for item in problem.observables):
        scale = output_scale(observable.name)
        told, observed = prediction_of(fit, observable), observable.observed * scale.factor
        predicted = prediction(fit, observable) * scale.factor
        half = None if told is None else 0.5 * (told.mean_q84 - told.mean_q16) * scale.factor
        cells = [_cell(observed[k], predicted[k], None if half is None else half[k]) for k in shown]
        columns[f"{observable.name} [{scale.unit}]"] = cells
    return tuple(
        {"impact": problem.table.ids[k], "incidence [deg]": f"{theta[k]:.1f}", "speed [m/s]": f"{speed[k]:.1f}"}
        | {head: column[k] for head, column in columns.items()}
        | {"contact": _regime(fit, k)}
        for k in shown
    )


def _cell(observed: float, predicted: float, half: float | None) -> str:
    if half is None:
        return f"{significant(observed, 4)} | {significant(predicted, 4)}"
    # Measurement and prediction side by side need the same decimals; never finer than three.
    places = min(max(decimals(half), 0), 3)
    return f"{fixed(observed, places)} | {fixed(predicted, places)} +- {fixed(half, places)}"


def _regime(fit: Fit, k: int) -> str:
    if fit.predictive is None:
        return regime_name(int(fit.point.rebound.regime[0, k])) if fit.problem.model.tangential else ""
    name, share = next(iter(fit.predictive.regimes[k].items()))
    return name if share > 0.995 else f"{name} ({100.0 * share:.0f} %)"


def diagnosis_lines(fit: Fit, *, budget: bool = True) -> tuple[str, ...]:
    """Sampler and point fit in sentences, with the error budget unless it is told elsewhere."""
    squares = fit.least_squares
    rms = ", ".join(
        f"{name} {significant(value * output_scale(name).factor)} {output_scale(name).unit}"
        for name, value in squares.rms.items()
    )
    lines = [
        f"Least squares: chi-square {squares.chi_square:.1f} for {squares.degrees_of_freedom} degrees of freedom"
        + (f", best of {squares.starts} starts ({len(squares.optima)} distinct optima)" if squares.starts else "")
        + f"; root mean square residuals: {rms}.",
        f"Maximum a posteriori: log posterior {fit.point.log_posterior:.2f}{_optima(fit)}.",
    ]
    diagnostics = fit.diagnostics
    if diagnostics is not None:
        lines.append(
            f"Sampling: {sampler_words(diagnostics)} "
            f"({diagnostics.warm_up} of them warm-up{thinning(diagnostics)}), acceptance "
            f"{np.mean(diagnostics.acceptance):.2f}, smallest effective sample size "
            f"{diagnostics.min_ess_bulk:.0f} (bulk), {diagnostics.min_ess_tail:.0f} (tail), "
            f"largest R-hat {diagnostics.max_r_hat:.4f}{_tail(diagnostics)}."
        )
    if budget:
        lines.append(budget_line(fit.error_budget))
    for cause in dict.fromkeys(squares.missing.values()):
        names = [name for name, why in squares.missing.items() if why == cause]
        lines.append(f"No standard error of {listed(names)} by least squares: {cause}.")
    if fit.status is RunStatus.NOT_CONVERGED:
        again = spoken("Use --resume with more --max-steps.", "Fit again with a larger max_steps.")
        lines.append(f"NOT CONVERGED: intervals and verdicts may change. {again}")
    return tuple(lines)


def _optima(fit: Fit) -> str:
    """What the search found, in words."""
    count = len(fit.point.optima)
    return f", {count} optimum{'s' if count != 1 else ''} worth an ensemble"


def sampler_words(diagnostics: Diagnostics) -> str:
    """How often was drawn by whom."""
    chains, steps = diagnostics.ensembles, diagnostics.steps
    if diagnostics.pareto_k is not None:
        return f"{chains} chains of {steps} draws weighed by their density"
    return f"{chains} ensembles of {diagnostics.walkers} walkers, {steps} steps"


def _tail(diagnostics: Diagnostics) -> str:
    return "" if diagnostics.pareto_k is None else f", Pareto k of the weights {diagnostics.pareto_k:.2f}"


def thinning(diagnostics: Diagnostics) -> str:
    """That of a long run not all steps are kept, in words; nothing where they are."""
    after = diagnostics.steps - diagnostics.warm_up
    return "" if diagnostics.kept == after else f", {diagnostics.kept} of the other {after} kept"


def notes(fit: Fit) -> tuple[str, ...]:
    """What the reader of the table and of the scene should know."""
    return fit.notes
