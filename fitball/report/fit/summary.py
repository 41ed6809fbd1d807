"""A fit as rows of text and numbers, shared by terminal, page and files; nothing is laid out here."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fitball.inference.results.results import ErrorBudget, Estimate, Fit, RunStatus
from fitball.report.form.display_units import THESIS, Scale, handy, output_scale
from fitball.report.form.rounding import decimals, fixed, interval, significant
from fitball.values import FloatArray


@dataclass(frozen=True)
class ParameterRow:
    """One parameter as text, in one system of units; intervals are empty without a posterior."""

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


def _row(item: Estimate, scale: Scale) -> ParameterRow:
    def scaled(value: float | None) -> float | None:
        return None if value is None else value * scale.factor

    if item.median is None or item.sd is None:
        point = significant(scaled(item.point), 4)
        empty = "-"
        return ParameterRow(
            item.name, scale.unit, empty, empty, empty, empty, point, item.prior, empty, item.verdict, item.reason
        )
    places = decimals(item.sd * scale.factor)
    return ParameterRow(
        name=item.name,
        unit=scale.unit,
        median=fixed(scaled(item.median), places),
        sd=fixed(scaled(item.sd), places),
        interval_68=interval(scaled(item.q16), scaled(item.q84), places),
        interval_95=interval(scaled(item.q025), scaled(item.q975), places),
        point=fixed(scaled(item.point), places),
        prior=item.prior,
        contraction="-" if item.contraction is None else f"{item.contraction:.2f}",
        verdict=item.verdict,
        reason=item.reason,
    )


def parameter_rows(fit: Fit) -> tuple[ParameterRow, ...]:
    """Every parameter in handy multiples of SI; priors are quoted in SI itself."""
    return tuple(_row(item, handy(item.name, item.unit)) for item in fit.estimates)


@dataclass(frozen=True)
class LevelRow:
    """One level of a parameter, rounded, as text."""

    name: str
    unit: str
    impacts: str
    median: str
    interval_68: str
    interval_95: str
    point: str


def level_rows(fit: Fit) -> tuple[LevelRow, ...]:
    """What each surface, ball or table has of a parameter that differs between them; empty where none does."""
    rows = []
    for item in fit.levels:
        scale = handy(item.parameter, item.unit)
        name, count = f"{item.parameter}[{item.label}]", str(item.impacts)
        if item.median is None or item.sd is None:
            rows.append(LevelRow(name, scale.unit, count, "-", "-", "-", significant(item.point * scale.factor, 4)))
            continue
        places = decimals(item.sd * scale.factor)

        def text(value: float | None, factor: float = scale.factor) -> float | None:
            return None if value is None else value * factor

        rows.append(
            LevelRow(
                name,
                scale.unit,
                count,
                fixed(text(item.median), places),
                interval(text(item.q16), text(item.q84), places),
                interval(text(item.q025), text(item.q975), places),
                fixed(text(item.point), places),
            )
        )
    return tuple(rows)


def thesis_rows(fit: Fit) -> tuple[ParameterRow, ...]:
    """The parameters that the thesis quotes in units of its own, in those, with `C1`, `C2` of its Eq. (51)."""
    rows = [_row(item, THESIS[item.name]) for item in fit.estimates if item.name in THESIS]
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
    for observable in problem.observables:
        scale = output_scale(observable.name)
        heads.append(f"{observable.name} [{scale.unit}]")
        predicted = observable.predict(fit.point.rebound)[0] * scale.factor
        half = None
        if fit.predictive is not None:
            found = next(item for item in fit.predictive.observables if item.name == observable.name)
            predicted = found.median * scale.factor
            half = 0.5 * (found.mean_q84 - found.mean_q16) * scale.factor
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
        f"Least squares: chi-square {squares.chi_square:.1f} for {squares.degrees_of_freedom} degrees of freedom, "
        f"best of {squares.starts} starts ({len(squares.optima)} distinct optima); "
        f"root mean square residuals: {rms}.",
        f"Maximum a posteriori: log posterior {fit.point.log_posterior:.2f}, "
        f"{len(fit.point.optima)} optimum{'s' if len(fit.point.optima) != 1 else ''} worth an ensemble.",
    ]
    found = fit.diagnostics
    if found is not None:
        lines.append(
            f"Sampling: {found.ensembles} ensembles of {found.walkers} walkers, {found.steps} steps "
            f"({found.warm_up} of them warm-up), acceptance {np.mean(found.acceptance):.2f}, smallest effective "
            f"sample size {found.min_ess_bulk:.0f} (bulk), {found.min_ess_tail:.0f} (tail), "
            f"largest R-hat {found.max_r_hat:.4f}."
        )
    if budget:
        lines.append(_budget_line(fit.error_budget))
    for name, cause in squares.missing.items():
        lines.append(f"No standard error of {name} by least squares: {cause}.")
    if fit.status is RunStatus.NOT_CONVERGED:
        lines.append("NOT CONVERGED: intervals and verdicts may change. Use --resume with more --max-steps.")
    return tuple(lines)


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
