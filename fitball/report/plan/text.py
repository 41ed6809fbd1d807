"""A plan on a terminal."""

from __future__ import annotations

from pathlib import Path

from fitball.inference.design.results import Plan
from fitball.report.form.text_table import listed_rows, wrapped
from fitball.report.plan.words import chosen_table, headline, points, sensors_table


def render(plan: Plan, folder: Path | None = None) -> str:
    """Headline, what stands out, the batch, the sensors, where the files are."""
    lines = [*wrapped([headline(plan)]), *wrapped(points(plan), "- ", "  "), "", *listed_rows(chosen_table(plan))]
    if len(plan.worths) > 1:
        lines += ["", *listed_rows(sensors_table(plan), 2)]
    if folder is not None:
        lines += ["", f"{folder / 'plan.html'}; plan.csv has the impacts to measure, with empty columns to fill in"]
    return "\n".join(lines)
