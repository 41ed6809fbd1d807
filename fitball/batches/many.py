"""Many tables, each fitted on its own over processes; continues what is not finished.

It writes as it goes, so it is given the locked folder; `batch.csv` is output, never read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import msgspec

from fitball.base.errors import (
    FitballError,
    FolderError,
    MachineError,
)
from fitball.base.files import ResultFolder
from fitball.base.numbers import counted
from fitball.base.progress import Progress
from fitball.base.scheduling import as_completed
from fitball.batches import rows
from fitball.batches.batch import Batch
from fitball.batches.rows import HEAD, Kept
from fitball.batches.tables import named
from fitball.data.scene import Scene, load_scene
from fitball.inference.calibrate import calibrate
from fitball.inference.effort import Effort
from fitball.inference.fitted import run_of
from fitball.inference.noise import noise_kind
from fitball.inference.problem.build import pose
from fitball.models.model import Model
from fitball.models.registry import model as model_of
from fitball.results.fit import Fit
from fitball.saved import files_of_fit

PAGE = "report.html"


@dataclass(frozen=True)
class Task:
    """What all tables of a batch have in common: the locked folder, options of a fit, its effort;
    whether fits of other data or settings are replaced; figures of each page, None for no page.
    """

    folder: ResultFolder
    options: Mapping[str, Any]
    effort: Effort
    overwrite: bool
    figures: bool | Literal["all"] | None


def fit_many(data: Any, task: Task, address: str, show: Progress) -> Batch:
    """Fit each table over processes as `calibrate` would, with one thread; a table whose `Run.key`
    is in the folder is not fitted again; one that fails is a row. Raises ParameterError
    (`no-tables`, `scheduler`, `noise`), ModelError, InputError (`scene`).
    """
    sources = named(data, task.folder.path)
    options = dict(task.options)
    # What all tables would fail for is said at once.
    if isinstance(options["model"], str) and options["model"]:
        model_of(options["model"])
    if options["noise"]:
        noise_kind(options["noise"])
    if options["scene"] and not isinstance(options["scene"], Scene):
        options["scene"] = load_scene(None, options["scene"])
    found = dict[str, Kept]()
    stage = f"fitting {counted(len(sources), 'table')}"
    show(stage, 0.0)
    names = list(sources)
    # One thread each; no number depends on it.
    one = partial(
        _one,
        replace(task, options=options, effort=msgspec.structs.replace(task.effort, cores=1)),
    )
    for place, made in as_completed(one, list(sources.items()), task.effort.cores, address):
        name = names[place]
        found[name] = rows.failed(name, made) if isinstance(made, FitballError) else made
        show(stage, len(found) / len(names))
    show("comparing tables", 0.0)
    model = task.options.get("model")
    return _batch(
        task.folder.path,
        [found[name] for name in names],
        model if isinstance(model, Model) else None,
    )


def _batch(folder: Path, found: Sequence[Kept], own: Model | None) -> Batch:
    """Of what was kept of each table."""
    import pandas as pd

    heads = dict.fromkeys([*HEAD, *(head for one in found for head in one.row)])
    tables = pd.DataFrame([one.row for one in found], columns=list(heads)).set_index("table")
    tables["impacts"] = tables["impacts"].astype("Int64")
    quantities = {one.row["table"]: one.quantities for one in found}
    names = dict.fromkeys(name for known in quantities.values() for name in known)
    by_name = {
        name: [known[name] for known in quantities.values() if name in known] for name in names
    }
    return Batch(folder, tables, rows.populations(by_name), quantities, (), own)


def _one(task: Task, item: tuple[str, Any]) -> Kept:
    """What is kept of a table. Raises FitballError alone: a table does not stop the others."""
    name, source = item
    try:
        return rows.kept(name, _fitted(task, name, source))
    except FitballError:
        raise
    except Exception as error:
        text = f"a fault of fitball, please report it: {type(error).__name__}: {error}"
        raise MachineError(text, "fault-of-fitball") from error


def _fitted(task: Task, name: str, source: Any) -> Fit:
    """The fit of a table, from its folder if that has the same one."""
    problem, own = pose([source], **task.options)
    place = task.folder.path / name
    key = files_of_fit.key_of(place)
    fit = None
    if key == run_of(problem, task.effort).key:
        # One that is damaged is made again.
        with suppress(FolderError):
            fit = Fit.of(files_of_fit.read(place, own))
    elif key and not task.overwrite:
        text = (
            f"{place}: has a fit of other data or settings; replace it with --overwrite "
            "(overwrite=True)"
        )
        raise FolderError(f"{text}, or name another folder", "older-result")
    if fit is not None and (task.figures is None or (place / PAGE).exists()):
        return fit
    fit = fit or Fit.of(calibrate(problem, task.effort, lambda _stage, _share: None, own))
    folder = replace(task.folder.below(name), record=files_of_fit.RECORD)
    if task.figures is not None:
        fit.save(folder, figures=task.figures)
        return fit
    folder.clear()
    for file, content in files_of_fit.files(fit).items():
        folder.write(file, content())
    return fit


def load(folder: Path, own: Model | None) -> Batch:
    """The finished tables of a folder, by name. Raises FolderError (`no-batch`), ModelError
    (`own-model`).
    """
    names = sorted(place.parent.name for place in folder.glob(f"*/{files_of_fit.RECORD}"))
    if not names:
        text = (
            f"{folder}: no finished table; expected the folder of a batch (to finish one, run "
            "it again)"
        )
        raise FolderError(text, "no-batch")
    return _batch(
        folder, [rows.kept(name, files_of_fit.read(folder / name, own)) for name in names], own
    )
