"""A fit as rows of text and numbers, shared by terminal, page and files; nothing is laid out here."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from markupsafe import Markup

from fitball.inference.results.results import Diagnostics, ErrorBudget, Estimate, Fit, LevelEstimate, RunStatus
from fitball.inference.thesis.published_cases import wang_rows
from fitball.report.form.display_units import THESIS, Scale, handy, output_scale
from fitball.report.form.palette import verdict_mark
from fitball.report.form.rounding import decimals, fixed, interval, significant
from fitball.report.form.sentences import listed
from fitball.report.form.symbols import symbol_html
from fitball.report.form.text_table import Row
from fitball.report.saved.fit_file import DiagnosticsPart
from fitball.values import FloatArray
from fitball.wording import spoken

NO_SYMBOL = Markup("")
# Heads of the columns that show fields of a `ParameterRow`.
NUMBERS = {"median": "median", "68 %": "interval_68", "95 %": "interval_95", "point": "point"}


@dataclass(frozen=True)
class ParameterRow:
    """One parameter as text, in one system of units; intervals are empty without a posterior. `mark` is the verdict
    as style sheets name it, `symbol` that of figures as HTML.
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
    symbol: Markup = NO_SYMBOL
    meaning: str = ""


@dataclass(frozen=True)
class PredictionRow:
    """One impact: incidence, regime with its probability, and each output measured and predicted."""

    id: str
    theta_1: str
    v_1: str
    regime: str
    cells: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class PredictionTable:
    """All impacts; `heads` names the outputs with units, in the order of `PredictionRow.cells`."""

    heads: tuple[str, ...]
    rows: tuple[PredictionRow, ...]


def _rounded(numbers: Estimate | LevelEstimate, scale: Scale) -> dict[str, str]:
    """Point, median, sd and intervals in the unit of `scale`, as text to the places that the sd tells; "-" for what a
    run without posterior has not.
    """

    def scaled(name: str) -> float | None:
        value = getattr(numbers, name)
        return None if value is None else value * scale.factor

    if numbers.median is None or numbers.sd is None:
        absent = dict.fromkeys(("median", "sd", "interval_68", "interval_95"), "-")
        return absent | {"point": significant(scaled("point"), 4)}
    places = decimals(numbers.sd * scale.factor)
    return {
        **{name: fixed(scaled(name), places) for name in ("median", "sd", "point")},
        "interval_68": interval(scaled("q16"), scaled("q84"), places),
        "interval_95": interval(scaled("q025"), scaled("q975"), places),
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
        symbol=NO_SYMBOL,
        meaning=estimate.meaning,
        **_rounded(estimate, scale),
    )


def parameter_rows(fit: Fit) -> tuple[ParameterRow, ...]:
    """Every parameter in handy multiples of SI; priors are quoted in SI itself."""
    symbols = parameter_symbols(fit)
    return tuple(replace(parameter_row(item), symbol=symbols[item.name]) for item in fit.estimates)


def parameter_symbols(fit: Fit) -> dict[str, Markup]:
    """The symbol of every parameter, as on figures."""
    return {item.name: symbol_html(item.spec.label) for item in fit.problem.parameters}


def parameter_row(estimate: Estimate) -> ParameterRow:
    """One parameter in handy multiples of SI."""
    return _row(estimate, handy(estimate.name, estimate.unit))


def level_rows(fit: Fit) -> tuple[Row, ...]:
    """What each surface, ball or table has of a parameter that differs between them; empty where none does."""
    rows = []
    for level in fit.levels:
        scale = handy(level.parameter, level.unit)
        numbers = _rounded(level, scale)
        named = {"level": f"{level.parameter}[{level.label}]", "unit": scale.unit, "impacts": str(level.impacts)}
        rows.append(named | {head: numbers[field] for head, field in NUMBERS.items()})
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
    values = fit.point.values
    if "eps_10" not in values or "eps_slope" not in values:
        return []
    inch = THESIS["eps_10"].factor
    point = (values["eps_10"] - 10.0 * values["eps_slope"]) * inch
    columns = {} if fit.posterior is None else dict(fit.problem.all_values(fit.posterior.draws))
    if not {"eps_10", "eps_slope"} & set(fit.problem.free_names) or not columns:
        return [ParameterRow("C2", "in", "-", "-", "-", "-", significant(point, 4), "", "-", "", "derived")]
    draws = (columns["eps_10"] - 10.0 * columns["eps_slope"]) * inch
    places = decimals(float(np.std(draws)))
    low, mid_low, median, mid_high, high = (float(x) for x in np.quantile(draws, (0.025, 0.16, 0.5, 0.84, 0.975)))
    return [
        ParameterRow(
            name="C2",
            unit="in",
            median=fixed(median, places),
            sd=fixed(float(np.std(draws)), places),
            interval_68=interval(mid_low, mid_high, places),
            interval_95=interval(low, high, places),
            point=fixed(point, places),
            prior="",
            contraction="-",
            verdict="",
            reason="derived: eps_10 - 10 eps_slope",
        )
    ]


def prediction_table(fit: Fit, most: int | None = None) -> PredictionTable:
    """Measured against predicted: the posterior median with the 68 % half-width of the noise-free prediction, or
    the point estimate where there is no posterior; of the first `most` impacts.
    """
    problem = fit.problem
    impacts = problem.impacts
    shown = range(len(impacts))[:most]
    theta = np.degrees(np.arctan2(impacts.v_y1, impacts.v_x1))
    speed = np.hypot(impacts.v_x1, impacts.v_y1)
    heads, columns = [], []
    for observable in (item.everywhere(len(impacts)) for item in problem.observables):
        scale = output_scale(observable.name)
        heads.append(f"{observable.name} [{scale.unit}]")
        predicted = observable.predict(fit.point.rebound)[0] * scale.factor
        half = None
        if fit.predictive is not None:
            prediction = next(
                prediction for prediction in fit.predictive.observables if prediction.name == observable.name
            )
            predicted = prediction.median * scale.factor
            half = 0.5 * (prediction.mean_q84 - prediction.mean_q16) * scale.factor
        columns.append([_cell(observable.observed[k] * scale.factor, predicted[k], half, k) for k in shown])
    rows = tuple(
        PredictionRow(
            id=problem.table.ids[k],
            theta_1=f"{theta[k]:.1f}",
            v_1=f"{speed[k]:.1f}",
            regime=_regime(fit, k),
            cells=tuple(column[k] for column in columns),
        )
        for k in shown
    )
    return PredictionTable(tuple(heads), rows)


def _cell(observed: float, predicted: float, half: FloatArray | None, k: int) -> tuple[str, str]:
    if half is None:
        return significant(observed, 4), significant(predicted, 4)
    # Measurement and prediction side by side need the same decimals; never finer than three.
    places = min(max(decimals(float(half[k])), 0), 3)
    return fixed(observed, places), f"{fixed(float(predicted), places)} +- {fixed(float(half[k]), places)}"


def _regime(fit: Fit, k: int) -> str:
    from fitball.models.types import regime_name

    if fit.predictive is None:
        return regime_name(int(fit.point.rebound.regime[0, k]))
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
        lines.append(_budget_line(fit.error_budget))
    for cause in dict.fromkeys(squares.missing.values()):
        names = [name for name, why in squares.missing.items() if why == cause]
        lines.append(f"No standard error of {listed(names)} by least squares: {cause}.")
    if fit.status is RunStatus.NOT_CONVERGED:
        again = spoken("Use --resume with more --max-steps.", "Fit again with a larger max_steps.")
        lines.append(f"NOT CONVERGED: intervals and verdicts may change. {again}")
    return tuple(lines)


def _optima(fit: Fit) -> str:
    """What the search found, in words; nothing where a fit was read back, which does not know."""
    count = len(fit.point.optima)
    return f", {count} optimum{'s' if count != 1 else ''} worth an ensemble" if fit.least_squares.starts else ""


def sampler_words(diagnostics: Diagnostics | DiagnosticsPart) -> str:
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


def _budget_line(budget: ErrorBudget) -> str:
    def text(name: str, value: float) -> str:
        scale = output_scale(name)
        return f"{value * scale.factor:.1e} {scale.unit}"

    parts = []
    for name, line in budget.lines.items():
        width = "" if line.posterior is None else f", prediction {text(name, line.posterior)}"
        parts.append(f"{name} {text(name, line.numerical)} (measurement {text(name, line.measurement)}{width})")
    return (
        f"Error budget: numerical error at most {budget.share:.0e} of the others, over {budget.impacts} impacts "
        f"against {budget.reference}: " + ", ".join(parts) + "."
    )


def notes(fit: Fit) -> tuple[str, ...]:
    """What the reader of the table and of the scene should know."""
    return (*fit.problem.table.remarks, *fit.notes)
