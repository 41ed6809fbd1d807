"""Which parameters differ between the surfaces, balls, places or groups of a table, as rows and lines."""

from __future__ import annotations

from fitball.inference.results.evidence import Difference
from fitball.inference.results.results import Fit
from fitball.report.form.document import Row
from fitball.report.form.numbers import fixed, handy, listed, parameter_row, significant
from fitball.wording import spoken


def difference_rows(fit: Fit) -> list[Row]:
    """By how much each parameter differs between the levels of each label, those that are fitted to each first."""
    rows = []
    for item in fit.differences:
        scale = handy(item.parameter, item.unit)
        rows.append(
            {
                "parameter": item.parameter,
                "unit": scale.unit,
                "from": item.low,
                "to": item.high,
                "difference": scale.fixed(item.size, scale.decimals(item.sd)),
                "95 %": scale.interval(item.q025, item.q975, scale.decimals(item.sd)),
                "in sd": fixed(item.sds, 1),
                "probability": significant(item.p, 2),
                "": "found" if item.found else "not found",
                "fitted": f"to each {item.column}" if item.fitted else f"to all ({item.column})",
            }
        )
    return rows


def scatter_rows(fit: Fit) -> list[Row]:
    """Common value, spread and places of the parameters that are fitted to each level."""
    sampled = fit.posterior is not None
    rows = map(parameter_row, fit.scatter)
    return [{"parameter": row.name, "unit": row.unit} | row.numbers(sampled) for row in rows]


def difference_lines(fit: Fit) -> list[str]:
    """Which parameters differ between surfaces, balls or groups, with their values there; and the option that fits
    those to each that are not.
    """
    lines = []
    for column in dict.fromkeys(item.column for item in fit.differences):
        mine = [item for item in fit.differences if item.column == column]
        lines += [_difference_line(fit, item) for item in mine if item.found]
        if same := [item.parameter for item in mine if item.fitted and not item.found]:
            lines.append(f"No difference in {listed(same)} is found between levels of {column}.")
        if wanted := [item.parameter for item in mine if item.found and not item.fitted]:
            flags = " ".join(spoken(f"--pool {name}={column}", "") for name in wanted)
            asked = spoken(flags, f"pool={dict.fromkeys(wanted, column)}")
            lines.append(f"To fit {listed(wanted)} to each {column}: {asked}.")
    return lines


# Levels whose values are given one by one.
NAMED_LEVELS = 3


def _difference_line(fit: Fit, item: Difference) -> str:
    scale = handy(item.parameter, item.unit)
    fitted = {
        level.label: level.point if level.median is None else level.median
        for level in fit.levels
        if (level.parameter, level.column) == (item.parameter, item.column)
    }
    known = fitted or item.values
    labels = [*known] if len(known) <= NAMED_LEVELS else [item.low, item.high]
    places = scale.decimals(item.sd)
    values = [f"{label} {scale.fixed(known[label], places)}" for label in labels if label in known]
    size = f"{scale.fixed(item.size, places)} {scale.interval(item.q025, item.q975, places)} (95 %)"
    between = f"between {item.low} and {item.high} " if len(known) > NAMED_LEVELS else ""
    what = f"difference {between}{size}" if item.fitted else f"a quick fit to each {item.column}"
    return (
        f"{item.parameter} differs by {item.column}: {', '.join(values)} {scale.unit}".rstrip()
        + f" ({what}, {item.sds:.1f} sd)."
    )
