"""A stored fit run again from what it depends on, as it was or varied."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec

from fitball.base.display_units import PLAIN
from fitball.base.errors import Note, ParameterError
from fitball.base.numbers import percent
from fitball.base.progress import Progress
from fitball.base.text import listed
from fitball.inference.calibrate import calibrate
from fitball.inference.fitted import Fitted
from fitball.inference.problem.build import build_problem, choices_of
from fitball.inference.problem.problem import Choices, Problem
from fitball.models.model import Model
from fitball.models.registry import model as model_of
from fitball.saved import files_of_fit


def is_fit(source: Any) -> bool:
    """Whether a source is a fit, the folder of one, or the record there."""
    # Unlike that of Path, this answers for a name too long for the system.
    named = isinstance(source, str | Path)
    inside = named and os.path.exists(os.path.join(source, files_of_fit.RECORD))  # noqa: PTH110, PTH118
    return (
        isinstance(source, Fitted) or inside or (named and Path(source).name == files_of_fit.RECORD)
    )


def run_again(
    source: Any,
    reading: Mapping[str, Any],
    chosen: Mapping[str, Any],
    effort: Mapping[str, Any],
    progress: Progress,
) -> Fitted:
    """The fit to the stored table, with what is given of choices and effort, and a note by how much
    values moved. Raises ParameterError (`stored-table` for options of reading), FolderError,
    ModelError, FitError.
    """
    if names := [name for name, value in reading.items() if value]:
        text = (
            f"{listed(names)}: a stored fit has its table as it was read; to read it "
            "otherwise, fit the table again"
        )
        raise ParameterError(text, "stored-table")
    changed, own = choices_of(**chosen)
    stored = source if isinstance(source, Fitted) else files_of_fit.read(Path(source), own)
    own = own or stored.own
    if changed.model == stored.run.choices.model:
        changed = msgspec.structs.replace(changed, model="")
    problem = stored.problem if changed == Choices() else _varied(stored, changed, own)
    fit = calibrate(problem, msgspec.structs.replace(stored.run.effort, **effort), progress, own)
    return replace(fit, notes=(*fit.notes, _moved(fit, stored)))


def _varied(stored: Fitted, changed: Choices, own: Model | None) -> Problem:
    """What is changed has the defaults of this version, all else the priors and values of the
    stored fit.
    """
    run = stored.run
    was = stored.run.choices
    if changed.model:
        model = own or model_of(changed.model)
        was = was.for_model(changed.model, [spec.name for spec in model.parameters])
    elif run.model_source:
        own = stored.problem.forward.model
    new = {*changed.fix, *changed.prior}
    choices = Choices(
        was.model,
        {name: value for name, value in was.fix.items() if name not in new} | changed.fix,
        {name: text for name, text in was.prior.items() if name not in new} | changed.prior,
        was.pool | changed.pool,
        changed.noise or was.noise,
    )
    known = {name: text for name, text in run.known.items() if name not in new}
    return build_problem(run.table, run.scene, choices, own, known)


def _moved(fit: Fitted, stored: Fitted) -> Note:
    """By how much values moved since the stored fit."""
    moved = fit.moved_from(stored)
    if not any(moved.values()):
        return Note(
            "run-again",
            "Run again: all values are those of the stored fit to the last digit.",
        )
    name = max(moved, key=lambda one: moved[one])
    sampled = stored.posterior is not None and fit.posterior is not None
    by = (
        f"{PLAIN.number(moved[name], 2)} of its sds"
        if sampled
        else f"{percent(moved[name])} of its value"
    )
    return Note("run-again", f"Run again: of {len(moved)} values {name} moved most, by {by}.")
