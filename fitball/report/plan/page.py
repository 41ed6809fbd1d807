"""`plan.html`: a plan as one page that needs nothing but itself."""

from __future__ import annotations

from fitball.inference.design.results import Plan
from fitball.report.figures.embed import embed
from fitball.report.form.template import render_template
from fitball.report.plan.words import (
    LEGEND,
    SENSORS_LEGEND,
    chosen_table,
    headline,
    parts_table,
    points,
    ranges_text,
    sensors_table,
)

CAPTION = (
    "Expected gain of one more impact, measured as before, over what the machine can be set to. Numbers: the chosen "
    "impacts in their order. Dots: impacts of the fitted table, at the nearest spin."
)


def plan_page(plan: Plan, title: str, image: bytes, command: str | None = None) -> str:
    """The page as text; `image` is the map as PNG, `command` the line that made it, None where none did."""
    said = headline(plan)
    return render_template(
        "fitball.report",
        "plan.html.j2",
        heading=title,
        headline=said,
        points=points(plan),
        figure_item=embed(image, CAPTION, f"{CAPTION} {said}"),
        chosen=chosen_table(plan),
        legend=LEGEND,
        sensors=sensors_table(plan),
        sensors_legend=SENSORS_LEGEND,
        parts=parts_table(plan),
        ranges=ranges_text(plan),
        plan=plan,
        command=command,
    )
