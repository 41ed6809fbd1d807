"""The error budget as a table and in sentences: arithmetic beside measurement beside parameters."""

from __future__ import annotations

from fitball.inference.results.results import ErrorBudget
from fitball.report.form.display_units import output_scale
from fitball.report.form.rounding import digits
from fitball.report.form.text_table import Row


def budget_rows(budget: ErrorBudget) -> tuple[Row, ...]:
    """A row for each output, in handy units."""
    rows = []
    for name, line in budget.lines.items():
        scale = output_scale(name)
        width = "-" if line.posterior is None else digits(line.posterior * scale.factor, 2)
        least = min(line.measurement, line.posterior or line.measurement)
        rows.append(
            {
                "output": name,
                "unit": scale.unit,
                "arithmetic, at most": _power(line.numerical * scale.factor, ".1e"),
                "measurement, one sd": digits(line.measurement * scale.factor, 2),
                "parameters, half of 68 %": width,
                "arithmetic over the smaller": _power(line.numerical / least, ".0e"),
            }
        )
    return tuple(rows)


def _power(value: float, form: str) -> str:
    """An error as a power of ten; none at all where every compared digit is the same."""
    return format(value, form) if value > 0.0 else "none found"


def budget_sentence(budget: ErrorBudget) -> str:
    """What the table of the budget says."""
    measured = {not line.posterior or line.measurement > line.posterior for line in budget.lines.values()}
    most = "the measurement limits some outputs, the uncertain parameters others"
    if measured == {True}:
        most = "the measurement limits every single impact"
    elif measured == {False}:
        most = "the uncertain parameters limit the prediction"
    size = "no error of it was found"
    if budget.share > 0.0:
        size = f"its error is at most {budget.share:.0e} of the smaller of the other two"
    return f"The arithmetic adds nothing: {size}, comparing {budget.impacts} impacts with {budget.reference}; {most}."


def budget_line(budget: ErrorBudget) -> str:
    """The budget in one sentence, where there is no table."""

    def text(name: str, value: float) -> str:
        scale = output_scale(name)
        return f"{value * scale.factor:.1e} {scale.unit}"

    parts = []
    for name, line in budget.lines.items():
        width = "" if line.posterior is None else f", prediction {text(name, line.posterior)}"
        parts.append(f"{name} {text(name, line.numerical)} (measurement {text(name, line.measurement)}{width})")
    return (
        f"Error budget: numerical error at most {budget.share:.0e} of the others, over {budget.impacts} impacts "
        f"against {budget.reference}: {', '.join(parts)}."
    )
