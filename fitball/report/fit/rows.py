"""A fit as rows and lines: parameters, predictions, balances, point fit and sampler, error budget; its `repr`, a
table for notebooks, a report in the manner of lmfit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np

from fitball.data.balances import Balance, Balances
from fitball.inference.results.quantiles import ESSENTIALS, SUMMARY, quantiles
from fitball.inference.results.results import (
    Diagnostics,
    ErrorBudget,
    Estimate,
    Fit,
    LeastSquares,
    RunStatus,
    Verdict,
)
from fitball.inference.thesis.published_cases import wang_rows
from fitball.models.types import regime_name
from fitball.report.figures.quantities import prediction, prediction_of
from fitball.report.fit.judged import ANSWERS, brief_verdict, named, remarks
from fitball.report.form.document import MOST_ROWS, Row, Table, columns, judged, term, wrapped
from fitball.report.form.numbers import (
    THESIS,
    ParameterRow,
    Scale,
    decimals,
    digits,
    file_words,
    fixed,
    handy,
    listed,
    output_scale,
    parameter_row,
    percent,
    plus_minus,
    row_of,
    significant,
)
from fitball.values import FloatArray
from fitball.wording import short, spoken

# Sequence of slip and grip that is named without its probability.
SURE = 0.995
# Correlations that a report lists.
LISTED_CORRELATION = 0.5


def parameter_table(fit: Fit, brief: bool = False) -> list[Row]:
    """Every parameter and every quantity that follows from several. In brief: short name, median, 95 %, unit
    and verdict; else meaning, intervals, point estimate, prior and contraction.
    """
    sampled, rows = fit.posterior is not None, []
    for item in fit.reported:
        row = parameter_row(item)
        if brief:
            numbers = {"median": row.best, "95 %": row.interval_95} if sampled else {"point": row.point}
            verdict = judged(item.verdict, brief_verdict(fit, item), f"{item.verdict_words}; {item.reason}")
            meaning = short(item.meaning.partition(",")[0])
            rows.append(
                {"parameter": row.name, "meaning": meaning} | numbers | {"unit": row.unit, "verdict": verdict}
            )
            continue
        known = None if item.median is None else item.contraction
        cells = named(fit, item.name, handy(item.name, item.unit))
        cells |= {"meaning": item.meaning} | row.numbers(sampled) | {"prior": item.prior}
        rows.append(cells | ({"contraction": "-" if known is None else f"{known:.2f}"} if sampled else {}))
    return rows


def measured_lines(fit: Fit) -> list[str]:
    """Values at a measured speed of what is otherwise given at 10 m/s, where that was not measured."""
    if fit.drop_test is not None:
        return []
    speeds = fit.problem.impacts.v_y1
    lines = []
    for item in fit.derived.values():
        if " at " in item.name:
            row = parameter_row(item)
            among = f"{significant(float(speeds.min()), 2)} to {significant(float(speeds.max()), 2)} m/s"
            sure = " (95 %)" if row.median != "-" else ""
            lines.append(f"{item.name}: {row.within}{f' {row.unit}' if row.unit else ''}{sure}; measured at {among}.")
    return lines


def thesis_rows(fit: Fit) -> list[ParameterRow]:
    """The parameters that the thesis quotes in units of its own, in those, with `C1`, `C2` of its Eq. (51); none
    where the data are not the thesis's.
    """
    if wang_rows(fit.problem.table) is None:
        return []
    rows = [parameter_row(estimate, THESIS[estimate.name]) for estimate in fit.estimates if estimate.name in THESIS]
    renamed = [replace(row, name="C1 = eps_slope") if row.name == "eps_slope" else row for row in rows]
    return [*renamed, *_offset_at_zero(fit)]


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
    return [row_of("C2", numbers, Scale("in"))]


def prediction_table(fit: Fit) -> list[Row]:
    """Measured | predicted: the posterior median with the 68 % half-width of the noise-free prediction, or the point
    estimate where there is no posterior, with the regime and its probability; of as many impacts as a page lists.
    """
    problem = fit.problem
    impacts = problem.impacts
    shown = range(len(impacts))[:MOST_ROWS]
    theta = np.degrees(impacts.angle)
    speed = impacts.speed
    columns: dict[str, list[str]] = {}
    for observable in (item.everywhere(len(impacts)) for item in problem.observables):
        scale = output_scale(observable.name)
        drawn, observed = prediction_of(fit, observable), observable.observed * scale.factor
        predicted = prediction(fit, observable) * scale.factor
        half = None if drawn is None else 0.5 * (drawn.mean_q84 - drawn.mean_q16) * scale.factor
        cells = [_cell(observed[k], predicted[k], None if half is None else half[k]) for k in shown]
        columns[f"{observable.name} [{scale.unit}]"] = cells
    along = problem.table.has_tangential
    return [
        {"impact": problem.table.ids[k]}
        | ({"incidence [deg]": f"{theta[k]:.1f}"} if along else {})
        | {"speed [m/s]": f"{speed[k]:.1f}"}
        | {head: column[k] for head, column in columns.items()}
        | ({"contact": _regime(fit, k)} if problem.model.has_regimes else {})
        for k in shown
    ]


def _cell(observed: float, predicted: float, half: float | None) -> str:
    if half is None:
        return f"{significant(observed, 4)} | {significant(predicted, 4)}"
    # Measurement and prediction side by side need the same decimals; never finer than three.
    places = min(max(decimals(half), 0), 3)
    return f"{fixed(observed, places)} | {plus_minus(predicted, half, places)}"


def _regime(fit: Fit, k: int) -> str:
    if fit.predictive is None:
        return regime_name(int(fit.point.rebound.regime[0, k]))
    name, share = next(iter(fit.predictive.regimes[k].items()))
    return name if share > SURE else f"{name} ({percent(share)})"


def balance_table(balances: Balances) -> tuple[Table, list[str]]:
    """The balances that at least one impact has, value and one standard deviation, and a sentence for each."""
    known = [(item, handy(item.name, item.unit)) for item in balances.all if item.known]
    heads = [f"{item.name} [{scale.unit}]" if scale.unit else item.name for item, scale in known]
    rows = [
        [name, *(_balance(item, k, scale) for item, scale in known)]
        for k, name in enumerate(balances.ids[:MOST_ROWS])
    ]
    rest = file_words("`balances.csv`", len(balances.ids))
    table = Table("Model-free balances", [["impact", *heads], *rows], count=len(balances.ids), rest=rest)
    return table, [term(item.name, item.meaning) for item, _scale in known]


def _balance(balance: Balance, index: int, scale: Scale) -> str:
    if balance.reasons[index]:
        return "-"
    value, sd = balance.values[index], balance.sd[index]
    return scale.plus_minus(value, sd) if sd > 0.0 else significant(value * scale.factor)


def diagnosis_lines(fit: Fit) -> list[str]:
    """Sampler and point fit in sentences."""
    squares = fit.least_squares
    rms = ", ".join(f"{name} {output_scale(name).measured(value)}" for name, value in squares.rms.items())
    starts, count = squares.starts, len(fit.point.optima)
    # A fit that was read back does not know what its search found.
    found = f", {_maxima(len(squares.optima), 'optimum', 'optima')} found from {starts} starts" if starts else ""
    maxima = f", {_maxima(count, 'maximum', 'maxima')} found" if starts else ""
    lines = [
        f"Least squares: chi-square {squares.chi_square:.1f} for {squares.degrees_of_freedom} degrees of freedom"
        f"{found}. Root mean square residuals: {rms}.",
        f"Maximum a posteriori: log posterior {fit.point.log_posterior:.2f}{maxima}.",
    ]
    sampler = fit.diagnostics
    if sampler is not None:
        after, k = sampler.steps - sampler.warm_up, sampler.pareto_k
        kept = "" if sampler.kept == after else f", {sampler.kept} of the other {after} kept"
        lines.append(
            f"Sampling: {sampler_words(sampler)} ({sampler.warm_up} of them warm-up{kept}). Acceptance "
            f"{np.mean(sampler.acceptance):.2f}; smallest effective sample size {sampler.min_ess_bulk:.0f} (bulk), "
            f"{sampler.min_ess_tail:.0f} (tail); largest R-hat {sampler.max_r_hat:.4f}"
            f"{'' if k is None else f'; Pareto k of the weights {k:.2f}'}."
        )
    for cause in dict.fromkeys(squares.missing.values()):
        names = [name for name, why in squares.missing.items() if why == cause]
        lines.append(f"No standard error of {listed(names)} by least squares: {cause}.")
    return lines


def _maxima(count: int, one: str, several: str) -> str:
    return f"one {one}" if count == 1 else f"{count} {several}"


def warning_lines(fit: Fit) -> list[str]:
    """What to know, and to do, before a result is used; the most serious first."""
    again = spoken("Use --resume with more --max-steps.", "Fit again with a larger max_steps.")
    unsure = f"NOT CONVERGED: intervals and verdicts may change. {again}"
    return [*[unsure] * (fit.status is RunStatus.NOT_CONVERGED), *remarks(fit)]


def sampler_words(diagnostics: Diagnostics) -> str:
    """The chains or ensembles, and their steps."""
    chains, steps = diagnostics.ensembles, diagnostics.steps
    if diagnostics.pareto_k is not None:
        return f"{chains} chains of {steps} draws, weighted by their density"
    return f"{chains} ensembles of {diagnostics.walkers} walkers, {steps} steps"


def budget_rows(budget: ErrorBudget) -> list[Row]:
    """A row for each output, in handy units."""

    def power(value: float, form: str) -> str:
        return format(value, form) if value > 0.0 else "none found"

    rows = []
    for name, line in budget.lines.items():
        scale, width = output_scale(name), line.posterior
        least = min(line.measurement, width or line.measurement)
        rows.append(
            {
                "output": name,
                "unit": scale.unit,
                "numerical error, at most": power(line.numerical * scale.factor, ".1e"),
                "measurement error, sd": digits(line.measurement * scale.factor, 2),
                "parameters, half of 68 %": "-" if width is None else digits(width * scale.factor, 2),
                "numerical / smaller of both": power(line.numerical / least, ".0e"),
            }
        )
    return rows


def budget_sentence(budget: ErrorBudget) -> str:
    """The table of the budget in two sentences."""
    measured = {not line.posterior or line.measurement > line.posterior for line in budget.lines.values()}
    limits = "Measurement errors dominate in some outputs, uncertain parameters in others"
    if len(measured) == 1:
        one = "Measurement errors dominate in every output", "Uncertain parameters dominate in every output"
        limits = one[False in measured]
    size = f"at most {budget.share:.0e} of the smaller of the other two" if budget.share > 0.0 else "none found"
    return f"Numerical errors are negligible: {size} ({budget.impacts} impacts against {budget.reference}). {limits}."


def _head(fit: Fit) -> str:
    table, free = fit.source, len(fit.free_names)
    return (
        f"{fit.fitted.model_name} to {table.name}: {table.impacts:,} impacts, {free} free parameter"
        f"{'s' if free != 1 else ''}, {fit.status}"
    )


def _rows(items: Iterable[Estimate]) -> list[tuple[Estimate, ParameterRow]]:
    return [(item, parameter_row(item)) for item in items]


def _brief(fit: Fit) -> list[str]:
    """Whether the model fits the data, and the fitted parameters by verdict."""
    adequacy, rows = fit.adequacy, _rows(fit.reported)
    lines = [] if adequacy is None else [f"does the model fit the data: {ANSWERS[adequacy.answer]}"]
    for verdict in Verdict:
        values = [f"{item.name} = {row.plus_minus}" for item, row in rows if item.verdict is verdict]
        if values and verdict is not Verdict.FIXED:
            lines.append(f"{verdict}: {'; '.join(values)}")
    return lines


def short_text(fit: Fit) -> str:
    """The fit and its result in a few lines."""
    return "\n".join([f"<Fit of {_head(fit)}>", *wrapped(_brief(fit), "  ", " " * 4)])


def html_text(fit: Fit) -> str:
    """The same as a table of HTML."""
    heads = ("", "median", "sd", "95 %", "unit", "verdict")
    lines = []
    for item, row in _rows(fit.reported):
        cells = (item.name, row.best, row.sd, row.interval_95, row.unit, item.verdict_words)
        shown = "".join(f"<td>{escape(cell)}</td>" for cell in cells[1:])
        lines.append(f'<tr title="{escape(item.meaning)}"><th>{escape(item.name)}</th>{shown}</tr>')
    top = "".join(f"<th>{head}</th>" for head in heads)
    return (
        f"<p><b>Fit of {escape(_head(fit))}</b>{''.join(f'<br>{escape(line)}' for line in _brief(fit)[:1])}</p>"
        f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(lines)}</tbody></table>"
    )


def _correlations(names: Sequence[str], matrix: FloatArray) -> list[str]:
    pairs = [(abs(matrix[i, j]), names[j], names[i], matrix[i, j]) for i in range(len(names)) for j in range(i)]
    strong = sorted((pair for pair in pairs if pair[0] > LISTED_CORRELATION), reverse=True)
    head = [f"[[Correlations]] (those above {LISTED_CORRELATION:g})"] if strong else []
    return head + [f"    C({one}, {other}) = {value:+.3f}" for _size, one, other, value in strong]


def _least_squares(squares: LeastSquares) -> list[str]:
    """Best values by lmfit with their standard errors, in SI, and the correlations of these."""
    errors = {name: error for name, error in squares.stderr.items() if error is not None}
    if not errors or squares.covariance is None:
        return []
    freedom = squares.degrees_of_freedom
    reduced = f", reduced chi-square {squares.chi_square / freedom:.3f}" if freedom > 0 else ""
    cells = [[f"{name}:", f"{squares.values[name]:.6g} +/- {error:.3g}"] for name, error in errors.items()]
    size = np.sqrt(np.diagonal(squares.covariance))
    return [
        f"[[Least squares]] (lmfit; noise as stated, SI; {squares.evaluations} evaluations{reduced})",
        *(f"    {line}" for line in columns(cells, left=2)),
        *_correlations(tuple(errors), squares.covariance / np.outer(size, size)),
    ]


def report_text(fit: Fit) -> str:
    """Outcome, statistics, parameters, correlations and notes."""
    measured = listed(fit.source.measurements)
    head = f"{fit.fitted.model_name} on {fit.source.name}: {fit.source.impacts:,} impacts with {measured}"
    closures = ", ".join(f"{name} = {value}" for name, value in fit.fitted.options.items())
    lines = ["[[Fit]]", f"    {head}; {len(fit.free_names)} free parameters"]
    lines += [f"    model assumptions: {closures}"] if closures else []
    lines += wrapped([fit.verdict], " " * 4, " " * 4)
    lines += ["[[Statistics]]", *(f"    {name:<24} = {value}" for name, value in _statistics(fit).items())]
    cells = []
    for item, row in _rows((*fit.reported, *fit.scatter)):
        prior = "" if item.verdict is Verdict.FIXED else item.prior
        within = "" if row.interval_95 == "-" else row.interval_95
        cells.append([f"{item.name}:", row.plus_minus, within, prior, item.verdict_words])
    lines += ["[[Parameters]] (median +- sd; 95 % interval; prior in SI)"]
    lines += [f"    {line}" for line in columns(cells, left=5)]
    if fit.correlation is not None:
        lines += _correlations(fit.free_names, fit.correlation)
    lines += _least_squares(fit.least_squares)
    if fit.notes:
        lines += ["[[Notes]]", *wrapped(fit.notes, " " * 4, " " * 6)]
    return "\n".join(lines)


def _statistics(fit: Fit) -> dict[str, str]:
    sampler = fit.diagnostics
    known = {
        "log posterior": f"{fit.log_posterior:.3f}",
        "log likelihood": f"{fit.log_likelihood:.3f}",
        "chi-square": f"{fit.least_squares.chi_square:.3f}",
        "degrees of freedom": str(fit.least_squares.degrees_of_freedom),
    }
    if sampler is not None:
        known |= {
            "sampler": sampler_words(sampler),
            "effective sample size": f"{min(sampler.min_ess_bulk, sampler.min_ess_tail):.0f}",
            "R-hat": f"{sampler.max_r_hat:.4f}",
        }
    return known | {"seed": str(fit.seed)}


def summary_rows(fit: Fit) -> list[dict[str, Any]]:
    """One row per parameter, before it those of its levels, SI at full precision; None where a point fit has no
    number.
    """
    squares = fit.least_squares
    own = {item.parameter: [item.level_name(label) for label in item.labels] for item in fit.fitted.levels}
    listed = [
        one
        for it in fit.estimates
        for one in (*(fit.derived[name] for name in own.get(it.name, ()) if name in fit.derived), it)
    ]
    return [
        {"parameter": it.name}
        | {name: getattr(it, name) for name in ("unit", *SUMMARY, "point")}
        | {"least_squares": squares.values.get(it.name), "least_squares_stderr": squares.stderr.get(it.name)}
        | {"prior": it.prior, "contraction": it.contraction, "verdict": it.verdict_words}
        | {name: getattr(it, name) for name in ("reason", "ess_bulk", "ess_tail", "r_hat")}
        for it in listed
    ]


def summary_columns(fit: Fit) -> Mapping[str, list[object]]:
    """The same by column, without reasons and least squares."""
    names = ("unit", *SUMMARY, "point", "prior", "contraction", "verdict", "ess_bulk", "ess_tail", "r_hat")
    rows = summary_rows(fit)
    return {name: [row[name] for row in rows] for name in ("parameter", *names)}
