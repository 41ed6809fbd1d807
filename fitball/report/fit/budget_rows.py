"""The error budget as a table and a sentence: arithmetic beside measurement beside parameters."""

from __future__ import annotations

from dataclasses import dataclass

from fitball.inference.results.results import ErrorBudget
from fitball.report.form.display_units import output_scale
from fitball.report.form.rounding import digits


@dataclass(frozen=True)
class BudgetTable:
    """Rows of output, unit, numerical error, measurement error, parameter uncertainty, and the share of the first."""

    rows: tuple[tuple[str, ...], ...]
    sentence: str


def budget_table(budget: ErrorBudget) -> BudgetTable:
    """The budget in handy units."""
    rows = []
    larger = []
    for name, line in budget.lines.items():
        scale = output_scale(name)
        posterior = None if line.posterior is None else line.posterior * scale.factor
        least = line.measurement if not line.posterior else min(line.measurement, line.posterior)
        rows.append(
            (
                name,
                scale.unit,
                _power(line.numerical * scale.factor, ".1e"),
                digits(line.measurement * scale.factor, 2),
                "-" if posterior is None else digits(posterior, 2),
                _power(line.numerical / least, ".0e"),
            )
        )
        larger.append("measurement" if not line.posterior or line.measurement > line.posterior else "parameters")
    return BudgetTable(tuple(rows), _sentence(budget, larger))


def _power(value: float, form: str) -> str:
    """An error as a power of ten; none at all where every compared digit is the same."""
    return format(value, form) if value > 0.0 else "none found"


def _sentence(budget: ErrorBudget, larger: list[str]) -> str:
    most = (
        "the measurement limits every single impact"
        if set(larger) == {"measurement"}
        else "the uncertain parameters limit the prediction"
        if set(larger) == {"parameters"}
        else "the measurement limits some outputs, the uncertain parameters others"
    )
    size = (
        f"its error is at most {budget.share:.0e} of the smaller of the other two"
        if budget.share > 0.0
        else "no error of it was found"
    )
    return f"The arithmetic adds nothing: {size}, comparing {budget.impacts} impacts with {budget.reference}; {most}."
