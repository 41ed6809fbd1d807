"""What to measure next, for a caller of Python and for the verb `plan`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.api.progress import Wanted, reporting
from fitball.data.lines import Range, checked_range, parse_range
from fitball.errors import ParameterError
from fitball.inference.design import make_plan as plans
from fitball.inference.design.make_plan import Asked
from fitball.inference.problem.problem import Problem
from fitball.inference.results.adequacy import Answer
from fitball.inference.results.results import Fit, RunStatus
from fitball.kinds import checked
from fitball.report.form.folders import clear_folder, held
from fitball.report.plan.document import plan_json, plan_rows, render
from fitball.wording import option

if TYPE_CHECKING:
    import pandas as pd

    from fitball.report.figures.canvas import Figure

# A range as text, as its ends in SI, or one value in SI.
Span = str | float | tuple[float, float]
NOT_CONVERGED = "The sampler of this fit did not converge: gains may change."
NOT_DESCRIBED = "The model does not describe the fitted table: gains hold within the model only."


class Plan:
    """What to measure next: impacts in the order of their worth, ways of measuring, and what they would tell."""

    def __init__(self, result: plans.Plan, problem: Problem) -> None:
        self.result = result
        self._problem = problem

    @property
    def gain(self) -> float:
        """Nats that all chosen impacts are expected to tell of the target, to first order."""
        return self.result.gain

    def to_frame(self) -> pd.DataFrame:
        """One row an impact, as `plan.csv` has it: with empty columns for what is to be measured."""
        import pandas as pd

        return pd.DataFrame(plan_rows(self.result, self._problem)).set_index("id")

    @checked
    def report(self, folder: Path | None = None) -> str:
        """All of it as text, with the `folder` that it was saved in."""
        return render(self.result, self._problem, folder)

    def json(self) -> Mapping[str, object]:
        """All of it as `plan.json` has it."""
        return plan_json(self.result)

    def plot(self) -> Figure:
        """The map of gains, as a matplotlib Figure that pyplot does not know."""
        from fitball.report.plan.document import title_of
        from fitball.report.plan.figure import plan_figure

        return plan_figure(self.result, title_of(self._problem))

    @checked
    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False, command: str | None = None) -> Path:
        """Write `plan.json`, `plan.csv`, `plan.png` and `plan.html`. Raises ResultFolderError."""
        from fitball.report.plan.document import JSON_NAME, write_all

        path = Path(folder)
        with held(path):
            clear_folder(path, JSON_NAME, overwrite=overwrite)
            write_all(self.result, self._problem, path, command)
        return path

    def __repr__(self) -> str:
        chosen = self.result.chosen
        return f"<Plan of {len(chosen)} impacts about {self.result.target}: {self.gain:.2f} nats>"

    def _repr_html_(self) -> str:
        """The impacts, as a notebook shows them."""
        return f"<p>{repr(self)[1:-1]}</p>{self.to_frame().to_html(notebook=True)}"


def planned(fit: Fit, asked: Asked, progress: Wanted) -> Plan:
    """A plan from a fit; see `api.fit.Fit.plan`. Raises FitError and ParameterError as `make_plan` does."""
    cautions = []
    if fit.status is RunStatus.NOT_CONVERGED:
        cautions.append(NOT_CONVERGED)
    if fit.adequacy is not None and fit.adequacy.answer is Answer.FAILS:
        cautions.append(NOT_DESCRIBED)
    with reporting(progress) as report:
        made = plans.make_plan(fit.problem, fit.posterior, asked, tuple(cautions), lambda stage: report(stage, None))
    return Plan(made, fit.problem)


def parsed(quantity: str, given: Span | None) -> Range | None:
    """What a caller says of a range. Raises ParameterError."""
    if given is None:
        return None
    if isinstance(given, str):
        return parse_range(quantity, given)
    try:
        low, high = (given, given) if isinstance(given, int | float | Integral) else (float(end) for end in given)
    except (TypeError, ValueError):
        raise ParameterError(
            f"{option(quantity, str(given))}: expected a text such as '5:20', a number, or two (low, high), in SI"
        ) from None
    return checked_range(quantity, Range(float(low), float(high)), option(quantity, str(given)))
