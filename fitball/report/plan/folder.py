"""The result folder of a plan: the writing of it, `plan.json` last."""

from __future__ import annotations

from pathlib import Path

from fitball.files import all_or_none
from fitball.inference.design.results import Plan
from fitball.inference.problem.problem import Problem
from fitball.report.figures.save import save_figure
from fitball.report.form.atomic_write import write_text
from fitball.report.form.csv import csv_text
from fitball.report.form.json_text import json_text
from fitball.report.plan.figure import plan_figure
from fitball.report.plan.page import plan_page
from fitball.report.plan.rows import plan_json, plan_rows

JSON_NAME, PAGE_NAME, CSV_NAME, PICTURE = "plan.json", "plan.html", "plan.csv", "plan.png"


def title_of(problem: Problem) -> str:
    """What a plan is headed by."""
    return f"{problem.table.name}, {problem.model.name}: what to measure next"


@all_or_none()
def write_all(plan: Plan, problem: Problem, folder: Path, command: str | None = None) -> None:
    """Write every file, each whole or not at all; `command` is the line that asked. Raises ResultFolderError."""
    title = title_of(problem)
    image = save_figure(plan_figure(plan, title), folder / PICTURE)
    write_text(folder / PAGE_NAME, plan_page(plan, title, image, command))
    write_text(folder / CSV_NAME, csv_text(plan_rows(plan, problem)))
    write_text(folder / JSON_NAME, json_text(plan_json(plan)))
