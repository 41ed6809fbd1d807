"""The uncertainty budgets of a fit's results on its page; `uses.budget` has the frame."""

from __future__ import annotations

import numpy as np

from fitball.base.display_units import CM, PLAIN
from fitball.base.numbers import Unit, counted, percent
from fitball.base.text import column_head, short
from fitball.inference.fitted import Fitted
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.fall import FALL_SPECS
from fitball.models.specs import SPECS
from fitball.report.blocks import Block, Mark, Section, Table, Text
from fitball.report.frame_rows import FrameRow, frame_rows
from fitball.report.quantities import unit_of
from fitball.uses.budget import budgets
from fitball.uses.sources import COVERAGE, LINEAR_SHARE

# The share of the variance below which sources have one row together.
_SMALL_SHARE = 0.005
# Letters of a name.
_NAME_LETTERS = 32
_ABOUT = (
    "Type A: scatter of measurements; type B: priors, stated values and constants that are held. "
    "Constants are normal where an sd is stated or was measured, else rectangular over the "
    "tolerance of the rules or of a camera. Sensitivity: change of the result by one unit of the "
    "source, both in SI. Sources are taken as independent. No verdict depends on this budget."
)
_MONTE_CARLO = (
    "Monte Carlo: all constants are drawn together, and the fit or the test is computed anew each "
    f"time (GUM Supplement 1). Beyond {percent(LINEAR_SHARE)} the result is not linear: its value "
    "counts."
)


def section(fit: Fitted) -> Section:
    """The section with the budgets, which is empty without a posterior."""
    rows = frame_rows(budgets(fit))
    totals = [row for row in rows if row.text("source") == "combined"]
    blocks: list[Block] = [_totals_table(fit, totals)]
    if totals:
        blocks.append(Text([_MONTE_CARLO], "quiet"))
    for total in totals:
        of_result = [row for row in rows if row.text("result") == total.text("result")]
        blocks.append(_source_table(fit, of_result))
    if totals:
        blocks.append(Text([_ABOUT], "quiet"))
    return Section("Uncertainty budget", blocks, True, _answer(totals))


def _answer(totals: list[FrameRow]) -> str:
    """How many results have a budget, and which of them are not linear."""
    bent = [row.text("result") for row in totals if not row.flag("linear")]
    text = f"Standard uncertainties of {len(totals)} results with held constants, by source"
    return f"{text}; {len(bent)} not linear." if bent else f"{text}."


def _totals_table(fit: Fitted, totals: list[FrameRow]) -> Table:
    """A row a result: its sd without constants, combined and expanded uncertainty, Monte Carlo."""
    rows = []
    for row in totals:
        name = row.text("result")
        unit = _unit_of_result(fit, row)
        value, sd = row.numbers("value", "uncertainty")
        combined, expanded, drawn = row.numbers("contribution", "expanded", "monte_carlo")
        outcome = ""
        if np.isfinite(drawn):
            linear = row.flag("linear")
            outcome = Mark("agrees", "good") if linear else Mark("not linear", "part")
        rows.append(
            {
                "result": Mark(short(name, _NAME_LETTERS), "name"),
                "value": unit.estimate(value, combined),
                "without constants": unit.number(sd, 2),
                "combined": unit.number(combined, 2),
                f"expanded, k = {COVERAGE:g}": unit.number(expanded, 2),
                "Monte Carlo": unit.number(drawn, 2),
                "": outcome,
                "unit": unit.name,
            }
        )
    return Table("Standard uncertainties", rows, ("", "unit"))


def _source_table(fit: Fitted, of_result: list[FrameRow]) -> Table:
    """The budget of one result, a row a source, the largest first."""
    rows = []
    name = of_result[0].text("result")
    unit = _unit_of_result(fit, of_result[0])
    small = [row for row in of_result if row.number("share") < _SMALL_SHARE]
    for row in of_result:
        last = row.text("source") == "combined"
        if last and small:
            rows.append(
                {
                    "source": Mark(f"{counted(len(small), 'smaller source')}", "quiet"),
                    "share": percent(sum(other.number("share") for other in small)),
                }
            )
        if row in small:
            continue
        cells = {
            "source": Mark(row.text("source"), "bold" if last else ""),
            "contribution": unit.number(row.number("contribution"), 2),
            "share": "" if last else percent(row.number("share")),
            "value": "",
            "u": "",
            "distribution": "",
            "sensitivity": "",
        }
        if not last:
            of_source = _unit_of_source(row)
            value, uncertainty = row.numbers("value", "uncertainty")
            if np.isfinite(uncertainty):
                cells["u"] = of_source.with_unit(of_source.number(uncertainty, 2))
                cells["sensitivity"] = _scientific(row.number("sensitivity"))
            if np.isfinite(value) and row.text("type") == "B":
                cells["value"] = of_source.with_unit(of_source.number(value, 4))
            cells["distribution"] = f"{row.text('distribution')} ({row.text('type')})"
        rows.append(cells)
    title = column_head(short(name, _NAME_LETTERS), unit.name)
    return Table(title, rows, ("distribution",))


def _unit_of_result(fit: Fitted, row: FrameRow) -> Unit:
    """The unit in which the result of a row is shown: that of a quantity of the fit, else of what a
    laboratory test measured.
    """
    name = row.text("result")
    if name in fit.summary.index:
        return unit_of(fit, name)
    return CM if row.text("unit") == "m" else PLAIN


def _unit_of_source(row: FrameRow) -> Unit:
    """The unit in which a source is shown: that of its parameter, else its own in SI."""
    name = row.text("source").removeprefix("prior of ").partition("[")[0]
    spec = {**SPECS, **CAMERA_SPECS, **FALL_SPECS}.get(name)
    if spec is not None:
        return spec.display_unit
    return Unit(row.text("source_unit"))


def _scientific(value: float) -> str:
    """A sensitivity with three digits."""
    if 1e-2 <= abs(value) < 1e3:
        return f"{value:+.3g}"
    return f"{value:+.2e}"
