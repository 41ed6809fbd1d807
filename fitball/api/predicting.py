"""Predictions from a fit: rebounds of new impacts; and plans of measurements."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fitball.api.reading import Wanted, listed, reporting
from fitball.data.header import naming, split_cell
from fitball.data.lines import Range, checked_range, parse_range, parse_uncertain_impact
from fitball.data.read import framed, in_memory, load_table, written_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import ImpactTable
from fitball.errors import ParameterError, check_whole
from fitball.inference.design import make_plan as plans
from fitball.inference.design.make_plan import Asked
from fitball.inference.prediction.impact_levels import Asked as AskedLevels
from fitball.inference.prediction.impact_levels import levels_of_impacts, new_words, written_columns
from fitball.inference.prediction.new_impacts import (
    NewPrediction,
    ObservableScore,
    observed_observables,
    predict_new,
    scores,
    with_assumptions,
)
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import Answer
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Fit, RunStatus, Verdict
from fitball.inference.results.source import Source
from fitball.kinds import checked
from fitball.observables import OBSERVABLES
from fitball.report.form.folders import clear_folder, held
from fitball.report.plan.document import plan_json, plan_rows, render
from fitball.report.predict.rows import prediction_csv_rows
from fitball.values import Ball, FloatArray, Impacts
from fitball.wording import option

if TYPE_CHECKING:
    import pandas as pd

    from fitball.report.figures.canvas import Figure

DRAWN = "the incident state is uncertain: a new one is drawn with each posterior draw"
IGNORED = "the given uncertainty of the incident state is not used"
NO_LINE = (
    "the line of restitution has no valid value at some of these speeds; a fit with the model assumption cor = "
    "saturating is valid at every speed"
)
POINT_ONLY = "a point fit has no posterior: best-fit values without intervals"


@dataclass(frozen=True)
class New:
    """Impacts to predict, their names, the table they are from, the covariance of their states if given.
    `index` is that of the data frame they are from.
    """

    impacts: Impacts
    ids: tuple[str, ...]
    table: ImpactTable | None = None
    covariance: FloatArray | None = None
    index: Any = None


@dataclass(frozen=True)
class Foretold:
    """A prediction with its scores on measurements of the same impacts, and notes."""

    new: New
    prediction: NewPrediction
    scores: tuple[ObservableScore, ...]
    notes: tuple[str, ...]

    def frame(self) -> pd.DataFrame:
        """One row for each impact."""
        import pandas as pd

        made = pd.DataFrame(prediction_csv_rows(self.prediction, self.new.ids))
        index = self.new.index
        made = made.set_index("id") if index is None else made.drop(columns="id").set_index(index)
        made.attrs = {"notes": list(self.notes), "scores": [asdict(score) for score in self.scores]}
        return made


def new_impacts(
    data: Any, ball: Ball, units: Mapping[str, str] | None, flip: Sequence[str], columns: Mapping[str, str] | None
) -> New:
    """Impacts to predict, from any argument that `Fit.predict` takes. Raises as reading does, ParameterError for
    anything else.
    """
    if isinstance(data, Impacts):
        if not len(data):
            raise ParameterError("read no impacts, expected at least one")
        return New(data, _numbered(len(data)))
    if isinstance(data, ImpactTable):
        return New(data.impacts, data.ids, data, data.incident_covariance)
    if in_memory(data):
        frame: Any = framed(data)
        table = load_table(frame, rebound=False, scene=Scene(ball=ball), flip=flip, columns=columns, units=units)
        index = frame.index[[row - 1 for row in table.rows]]
        return New(table.impacts, table.ids, table, table.incident_covariance, index)
    if _in_words(data):
        return _written([data])
    if isinstance(data, str | os.PathLike):
        # Names of columns are from the table's own scene, the ball from the fit.
        scene = Scene(ball=ball, columns=load_scene(data, as_read=True).columns)
        table = load_table(data, rebound=False, scene=scene, flip=flip, columns=columns, units=units)
        return New(table.impacts, table.ids, table, table.incident_covariance)
    if isinstance(data, Sequence) and data and all(isinstance(item, str) for item in data):
        return _written(data)
    raise ParameterError(
        f"read impacts of type {type(data).__name__}, expected a data frame, a path, the name of a bundled table, "
        "Impacts, columns by name, or texts such as 'v=17, theta=18, spin=100'"
    )


def _in_words(data: Any) -> bool:
    """Whether this is an impact as text; a file may have such a name too."""
    return isinstance(data, str) and "=" in data and not os.path.isfile(data)  # noqa: PTH113 - of texts of any length


def _numbered(count: int) -> tuple[str, ...]:
    return tuple(f"impact {k}" for k in range(1, count + 1))


def _written(texts: Sequence[str]) -> New:
    parsed = [parse_uncertain_impact(text) for text in texts]
    joined = [np.concatenate([getattr(item, name) for item, _ in parsed]) for name in ("v_x1", "v_y1", "omega_1")]
    covariance = None
    if any(item is not None for _, item in parsed):
        covariance = np.concatenate([np.zeros((1, 3, 3)) if item is None else item for _, item in parsed])
    return New(Impacts(*joined), _numbered(len(parsed)), covariance=covariance)


def foretell(
    saved: Fit,
    fitted: FittedModel,
    data: Any,
    units: Mapping[str, str] | None = None,
    flip: str | Sequence[str] = (),
    exact_incidence: bool = False,
    seed: int = 1,
    columns: Mapping[str, str] | None = None,
    levels: AskedLevels | None = None,
) -> Foretold:
    """Predict impacts from `fitted`, the model of `saved` with the draws to use, at `levels` where the impacts name
    no surface or ball of their own. Raises as `new_impacts`, `levels_of_impacts` and `predict_new` do.
    """
    check_whole(seed=seed)
    columns, assumed = _named_as_before(data, columns, saved.source.columns)
    new = new_impacts(data, fitted.ball, units, listed(flip), columns)
    stated, table = new.covariance is not None, new.table
    covariance = None if exact_incidence else new.covariance
    observables, unused = observed_observables(fitted, table) if table is not None else ((), ())
    cells = {} if table is None else table.labels
    at = levels_of_impacts(fitted, len(new.impacts), levels or {}, cells, new.ids)
    together = None if table is None else table.covariance
    prediction = predict_new(fitted, new.impacts, observables, seed, covariance, at, together)
    prediction = with_assumptions(prediction, fitted, saved.assumptions)
    # What limits every prediction comes first: a terminal shows a few.
    point = saved.status is RunStatus.POINT_ONLY
    elsewhere = {column: name for column, name in written_columns(fitted, cells).items() if name != column}
    assumed += tuple(f"labels of {column} are read from the column {name}" for column, name in elsewhere.items())
    notes = [*[POINT_ONLY] * point, *[IGNORED if point or exact_incidence else DRAWN] * stated]
    notes += [*_cautions(saved, fitted, prediction), *assumed]
    notes += [*(() if table is None else (*table.remarks, *_other_flips(saved.source, table))), *unused]
    return Foretold(new, prediction, scores(prediction), tuple(notes))


def _named_as_before(
    data: Any, asked: Mapping[str, str] | None, fitted: Mapping[str, str]
) -> tuple[Mapping[str, str] | None, tuple[str, ...]]:
    """The names of columns, and a note: those `asked`, else those of the fit's table that this one has too."""
    own = {ours: text for ours, text in fitted.items() if naming({ours: text}, (ours,)).theirs[ours] != ours}
    read = in_memory(data) or (isinstance(data, str | os.PathLike) and not _in_words(data))
    if asked or not own or not read:
        return asked, ()
    known = naming(own, tuple(own))
    cells = written_table(framed(data), known).heads
    found = {known.ours(cell, split_cell(cell, known)[0]) for cell in cells}
    taken = {ours: text for ours, text in own.items() if ours in found}
    names = ", ".join(f"{ours}={text}" for ours, text in taken.items())
    return taken, (f"columns are named as in the table of the fit: {names}",) if taken else ()


def _cautions(saved: Fit, fitted: FittedModel, prediction: NewPrediction) -> list[str]:
    """Notes on limits of the fit."""
    asked_new = [name for name, labels in prediction.levels.items() if set(labels) - {*fitted.labels[name]}]
    notes = new_words(fitted, asked_new)
    if any(f"{name}_offset[" in parameter for name in OBSERVABLES for parameter in saved.parameters):
        notes.append("the fit has a measurement bias for each group (offsets); predictions are without bias")
    if saved.status is RunStatus.NOT_CONVERGED:
        notes.append("sampling of this fit did not converge: intervals may change")
    unknown = [output.name for output in prediction.outputs if output.rebound is not None and output.measured is None]
    # Contact times are seldom measured: their noise is not missed.
    silent = [name for name in unknown if not OBSERVABLES[name].timed]
    if silent:
        notes.append(f"the fit has no noise of {', '.join(silent)}: no interval for a new measurement of it")
    stiffness = saved.parameters.get("k_y")
    if stiffness is not None and stiffness.verdict is Verdict.FIXED:
        notes.append("k_y is fixed in this fit: contact times depend on its value")
    # Another law of restitution has a solution there.
    if fitted.model.options.get("cor") == "line" and np.any(prediction.unsolved > 0.0):
        notes.append(NO_LINE)
    return notes


def _other_flips(fitted: Source | ImpactTable, table: ImpactTable) -> tuple[str, ...]:
    """A note if the fit flipped columns that these impacts do not, or the reverse."""
    flipped = [", ".join(sorted({name.rpartition(":")[2] for name in item.flipped})) for item in (fitted, table)]
    if flipped[0] == flipped[1]:
        return ()
    made, here = (names or "no column" for names in flipped)
    return (
        f"flipped columns differ: {made} in the fit, {here} in these impacts ({option('flip', '...')} changes them)",
    )


# A range as text, as its ends in SI, or one value in SI.
Span = str | float | tuple[float, float]
NOT_CONVERGED = "Sampling of this fit did not converge: gains may change."
NOT_DESCRIBED = "The model does not describe the fitted data: gains hold within the model only."


class Plan:
    """The next measurements: impacts in the order of choice, sensors, and their expected information gain."""

    def __init__(self, result: plans.Plan, problem: Problem) -> None:
        self.result = result
        self._problem = problem

    @property
    def gain(self) -> float:
        """Expected information gain of all chosen impacts about the target [nats], to first order."""
        return self.result.gain

    def to_frame(self) -> pd.DataFrame:
        """One row for each impact, as in `plan.csv`, with empty columns for the measurements."""
        import pandas as pd

        return pd.DataFrame(plan_rows(self.result, self._problem)).set_index("id")

    @checked
    def report(self, folder: Path | None = None) -> str:
        """The plan as text, with the `folder` that it was saved in."""
        return render(self.result, self._problem, folder)

    def json(self) -> Mapping[str, object]:
        """The content of `plan.json`."""
        return plan_json(self.result)

    def plot(self) -> Figure:
        """The map of gains, as a matplotlib Figure that is not registered with pyplot."""
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
        """The impacts, for a notebook."""
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
    """A range of speeds, angles or spins. Raises ParameterError."""
    if given is None:
        return None
    if isinstance(given, str):
        return parse_range(quantity, given)
    try:
        low, high = (given, given) if isinstance(given, int | float | Integral) else (float(end) for end in given)
    except (TypeError, ValueError):
        raise ParameterError(
            f"{option(quantity, str(given))}: expected a text such as '5:20', a number, or a pair (low, high), in SI"
        ) from None
    return checked_range(quantity, Range(float(low), float(high)), option(quantity, str(given)))
