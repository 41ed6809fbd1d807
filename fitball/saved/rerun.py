"""A stored fit run again from what it depends on, as it was or varied."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import msgspec

from fitball.base.display_units import PLAIN
from fitball.base.errors import Note, ParameterError
from fitball.base.files import FIT_FILE
from fitball.base.numbers import percent
from fitball.base.progress import Progress
from fitball.base.text import listed
from fitball.inference.calibrate import calibrate
from fitball.inference.effort import StatedEffort
from fitball.inference.fitted import Fitted
from fitball.inference.problem.build import ChoiceOptions, build_problem, choices_of
from fitball.inference.problem.problem import Choices, Problem
from fitball.models.model import Model
from fitball.models.registry import model as model_of
from fitball.saved import files_of_fit


def stored_fit(source: object) -> Fitted | Path | None:
    """A fit, its folder, or the record there, where a source of data is one of them; else None."""
    if isinstance(source, Fitted):
        return source
    if not isinstance(source, str | Path):
        return None
    # Unlike that of Path, this answers for a name too long for the system.
    has_record = os.path.exists(os.path.join(source, FIT_FILE))  # noqa: PTH110, PTH118
    path = Path(source)
    return path if has_record or path.name == FIT_FILE else None


def run_again(
    stored: Fitted | Path,
    reading: Mapping[str, object],
    options: ChoiceOptions,
    effort: StatedEffort,
    progress: Progress,
) -> Fitted:
    """The fit to the table of a stored fit, with what is stated of choices and effort, and a note
    by how much values moved. No option of `reading` may be stated.

    Raises:
        ParameterError: an option of reading is stated (`stored-table`), or one of the choices is
            wrong.
        FolderError: there is no fit that can be read (`no-fit`, `other-version`, `changed`).
        ModelError: the model cannot be used (`own-model`, ...).
        FitError: the table cannot be fitted so (`nothing-to-fit`, ...).
    """
    if names := [name for name, value in reading.items() if value]:
        text = (
            f"{listed(names)}: a stored fit has its table as it was read; to read it "
            "otherwise, fit the table again"
        )
        raise ParameterError(text, "stored-table")
    changed, user_model = choices_of(**options)
    if isinstance(stored, Path):
        stored = files_of_fit.read(stored, user_model)
    user_model = user_model or stored.own
    if changed.model == stored.run.choices.model:
        changed = msgspec.structs.replace(changed, model="")
    problem = stored.problem
    if changed != Choices():
        problem = _varied(stored, changed, user_model)
    new_effort = msgspec.structs.replace(stored.run.effort, **effort)
    fit = calibrate(problem, new_effort, progress, user_model)
    return replace(fit, notes=(*fit.notes, _moved(fit, stored)))


def _varied(stored: Fitted, changed: Choices, user_model: Model | None) -> Problem:
    """The problem of a stored fit with changed choices. What is changed has the defaults of this
    version, all else the priors and values of the stored fit.
    """
    run = stored.run
    choices = run.choices
    if changed.model:
        model = user_model or model_of(changed.model)
        choices = choices.for_model(changed.model, [spec.name for spec in model.parameters])
    elif run.model_source:
        user_model = stored.problem.forward.model
    new_names = {*changed.fix, *changed.prior}
    fix = {name: value for name, value in choices.fix.items() if name not in new_names}
    prior = {name: text for name, text in choices.prior.items() if name not in new_names}
    choices = Choices(
        choices.model,
        fix | changed.fix,
        prior | changed.prior,
        choices.pool | changed.pool,
        changed.noise or choices.noise,
        choices.derive | changed.derive,
    )
    prior_texts = {name: text for name, text in run.known.items() if name not in new_names}
    problem = build_problem(run.table, run.scene, choices, user_model, prior_texts)
    problem.refuse_unknown_names()
    return problem


def _moved(fit: Fitted, stored: Fitted) -> Note:
    """A note by how much values moved since the stored fit."""
    moved = fit.moved_from(stored)
    if not any(moved.values()):
        return Note(
            "run-again",
            "Run again: all values are those of the stored fit to the last digit.",
        )
    name = max(moved, key=moved.__getitem__)
    sampled = stored.posterior is not None and fit.posterior is not None
    distance = f"{percent(moved[name])} of its value"
    if sampled:
        distance = f"{PLAIN.number(moved[name], 2)} of its sds"
    return Note("run-again", f"Run again: of {len(moved)} values {name} moved most, by {distance}.")
