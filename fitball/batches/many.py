"""Many tables, each fitted on its own over processes; continues what is not finished.

It writes as it goes, so it is given the locked folder; `batch.csv` is output, never read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any, Literal

import msgspec

from fitball.base.errors import (
    FitballError,
    FolderError,
    MachineError,
    Note,
)
from fitball.base.files import FIT_FILE, REPORT_FILE, ResultFolder
from fitball.base.numbers import counted
from fitball.base.options import read_pairs, read_texts
from fitball.base.progress import Progress
from fitball.base.scheduling import as_completed
from fitball.base.text import listed
from fitball.base.values import DataFrame
from fitball.batches import rows
from fitball.batches.batch import Batch
from fitball.batches.control import (
    USUAL_CHARTING,
    Charting,
    Control,
    control_charts,
    in_order,
    why_no_chart,
)
from fitball.batches.rows import HEAD, TableRecord
from fitball.batches.tables import scenes_of_folders, tables_by_name
from fitball.data.read import TableSource
from fitball.data.scene import Scene, load_scene
from fitball.data.sources import file_and_sheet
from fitball.inference.calibrate import calibrate
from fitball.inference.effort import Effort
from fitball.inference.fitted import Fitted, run_of
from fitball.inference.noise import noise_kind
from fitball.inference.problem.build import problem_from_sources
from fitball.models.model import Model
from fitball.models.registry import model as model_of
from fitball.results.fit import Fit
from fitball.saved import files_of_fit
from fitball.uses.hierarchy import LEAST_GROUPS


@dataclass(frozen=True)
class Task:
    """What all tables of a batch have in common: the locked folder, options of a fit, its effort;
    whether fits of other data or settings are replaced; figures of each page, None for no page; how
    control charts are made; by folder the scene of its tables that have none of their own.
    """

    folder: ResultFolder
    options: Mapping[str, Any]
    effort: Effort
    overwrite: bool
    figures: bool | Literal["all"] | None
    charting: Charting = USUAL_CHARTING
    scenes: Mapping[Path, Scene] = field(default_factory=dict)

    def scene_of(self, source: TableSource) -> Scene | str:
        """The scene of a table: that of all, or of its folder where none is beside the table; ""
        where it is to be looked for.
        """
        of_all: Scene | str = self.options["scene"]
        if of_all or not isinstance(source, str | Path):
            return of_all
        file = Path(file_and_sheet(str(source))[0]).absolute()
        if file.with_suffix(".toml").exists():
            return ""
        return self.scenes.get(file.parent, "")


def fit_many(data: object, task: Task, address: str, show: Progress) -> Batch:
    """Fit each table over processes as `calibrate` would, with one thread; a table whose `Run.key`
    is in the folder is not fitted again; one that fails is a row.

    Raises:
        ParameterError: there are no tables (`no-tables`), several scenes of a folder
            (`several-scenes`), no scheduler at the `address` (`scheduler`), no such noise
            (`noise`), rules (`rules`) or baseline (`baseline`), or an option is no mapping
            (`pairs`).
        ModelError: there is no such model, or the user's function fails (`own-model`).
        InputError: the scene cannot be read (`scene`).
    """
    # Read twice, which no iterator can be.
    data = [*data] if isinstance(data, Iterator) else data
    sources = tables_by_name(data, task.folder.path)
    charting = task.charting.checked(len(sources))
    scene_files = {} if task.options["scene"] else scenes_of_folders(data)
    scenes = {folder: load_scene(None, file) for folder, file in scene_files.items()}
    options = _checked_options(task.options)
    # One thread each; no number depends on it.
    effort = msgspec.structs.replace(task.effort, cores=1)
    record = partial(_record, replace(task, options=options, effort=effort, scenes=scenes))
    stage = f"fitting {counted(len(sources), 'table')}"
    show(stage, 0.0)
    names = list(sources)
    records = dict[str, TableRecord]()
    for number, result in as_completed(record, list(sources.items()), task.effort.cores, address):
        name = names[number]
        if isinstance(result, FitballError):
            records[name] = rows.record_of_failure(name, result)
        else:
            records[name] = result
        show(stage, len(records) / len(names))
    show("comparing tables", 0.0)
    model = options["model"]
    user_model = model if isinstance(model, Model) else None

    def fit_of(name: str) -> Fitted:
        """The fit of a table, from its folder."""
        return files_of_fit.read(task.folder.path / name, user_model)

    notes = [_note_on_scene(folder, file) for folder, file in scene_files.items()]
    in_order = [records[name] for name in names]
    return batch_of(task.folder.path, in_order, user_model, fit_of, notes, charting)


def _note_on_scene(folder: Path, file: Path) -> Note:
    """The note that a scene counts for a folder."""
    words = f"{file.name} is the scene of all tables of {folder.name} that have none of their name."
    return Note("scene-of-folder", words)


def _checked_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """The options with the scene read, and a function of a file as the model that it is: all tables
    are fitted with it, and their fits are read with it. What all tables would fail for is said at
    once. Raises ParameterError (`noise`, `pairs`), ModelError, InputError (`scene`).
    """
    checked = dict(options)
    text = checked["model"]
    if text != "" and not isinstance(text, Model):
        model = model_of(text)
        if model.source:
            checked["model"] = model
    checked["fix"] = read_pairs("fix", checked["fix"])
    for name in ("columns", "prior", "pool", "derive"):
        checked[name] = read_texts(name, checked[name])
    if checked["noise"]:
        noise_kind(checked["noise"])
    if checked["scene"] and not isinstance(checked["scene"], Scene):
        checked["scene"] = load_scene(None, checked["scene"])
    return checked


def batch_of(
    folder: Path,
    records: Sequence[TableRecord],
    user_model: Model | None,
    fit_of: Callable[[str], Fitted],
    notes: Sequence[Note] = (),
    charting: Charting = USUAL_CHARTING,
) -> Batch:
    """The result of the records of all tables, in their order, with notes on all of them and
    control charts; `fit_of` reads the fit of a table by its name.
    """
    import pandas as pd

    heads = dict.fromkeys(HEAD)
    for record in records:
        heads |= dict.fromkeys(record.row)
    tables = pd.DataFrame([record.row for record in records], columns=list(heads))
    tables = tables.set_index("table")
    for counted_column in ("impacts", "seed"):
        tables[counted_column] = tables[counted_column].astype("Int64")
    quantities = {str(record.row["table"]): dict(record.quantities) for record in records}
    by_name = dict[str, list[rows.TableQuantity]]()
    for name in dict.fromkeys(name for record in records for name in record.quantities):
        of_tables = {table: row[name] for table, row in quantities.items() if name in row}
        if rows.is_compared([*of_tables.values()]):
            of_tables = rows.with_reliable_weights(name, of_tables, fit_of)
        for table, quantity in of_tables.items():
            quantities[table][name] = quantity
        by_name[name] = [*of_tables.values()]
    populations = rows.populations(by_name)
    control = control_charts(tables, quantities, charting)
    return Batch(
        folder,
        tables,
        populations,
        quantities,
        (*notes, *_notes(tables), *_notes_on_charts(tables, quantities, control)),
        user_model,
        control,
    )


def _notes(tables: DataFrame) -> Iterator[Note]:
    """What should be read of the fitted `tables`."""
    without = int((tables["status"] == "point only").sum())
    if without >= LEAST_GROUPS:
        text = (
            f"{without} tables have no posterior (--point-only), which means of parameters over "
            "tables need: leave the option out for them"
        )
        yield Note("no-posterior", f"{text}.")
    columns = [name for name in map(str, tables) if name.partition("[")[0] == rows.OUTLYING]
    apart = [
        f"{balls} of {table}"
        for column in columns
        for table, balls in tables[column].dropna().items()
    ]
    if apart:
        yield Note("outlying-balls", f"Balls apart from the others: {listed(apart)}.")


def _notes_on_charts(
    tables: DataFrame,
    quantities: Mapping[str, Mapping[str, rows.TableQuantity]],
    controls: Sequence[Control],
) -> Iterator[Note]:
    """The order of control charts, or why there are none."""
    if controls:
        yield from _notes_on_order(tables)
    elif why := why_no_chart(tables, quantities):
        yield Note("no-chart", why)


def _notes_on_order(tables: DataFrame) -> Iterator[Note]:
    """Why tables are not in the order of their dates."""
    repeated = in_order(tables).repeated
    if repeated is not None:
        column, first, second = repeated
        text = (
            f"Control charts are in the order of names: {first} and {second} have the same "
            f"{column}, and others between them by name have not. Correct the dates if they are "
            "wrong"
        )
        yield Note("dates-repeat", f"{text}.")


def _record(task: Task, named_source: tuple[str, TableSource]) -> TableRecord:
    """The record of a table. Raises FitballError alone: a table does not stop the others."""
    name, source = named_source
    try:
        fit = _fitted(task, name, source)
        return rows.record_of(name, fit, _day_of_fit(task.folder.path / name))
    except FitballError:
        raise
    except Exception as error:
        text = f"a fault of fitball, please report it: {type(error).__name__}: {error}"
        raise MachineError(text, "fault-of-fitball") from error


def _day_of_fit(folder: Path) -> str:
    """The day (UTC) on which the fit in a folder was written."""
    written = (folder / FIT_FILE).stat().st_mtime
    return datetime.fromtimestamp(written, UTC).date().isoformat()


def _fitted(task: Task, name: str, source: TableSource) -> Fit:
    """The fit of a table, from its folder if that has the same. Raises FitballError."""
    options = {**task.options, "scene": task.scene_of(source)}
    problem, user_model = problem_from_sources([source], **options)
    folder_of_table = task.folder.path / name
    key = files_of_fit.key_of(folder_of_table)
    fit = None
    if key == run_of(problem, task.effort).key:
        # One that is damaged is made again.
        with suppress(FolderError):
            fit = Fit.of(files_of_fit.read(folder_of_table, user_model))
    elif key and not task.overwrite:
        text = (
            f"{folder_of_table}: has a fit of other data or settings; replace it with --overwrite "
            "(overwrite=True)"
        )
        raise FolderError(f"{text}, or name another folder", "older-result")
    if fit is not None and (task.figures is None or (folder_of_table / REPORT_FILE).exists()):
        return fit
    if fit is None:
        fit = Fit.of(calibrate(problem, task.effort, _no_progress, user_model))
    folder = task.folder.below(name)
    if task.figures is not None:
        fit.save(folder, figures=task.figures)
        return fit
    contents = files_of_fit.files(fit)
    folder.replace({file: content() for file, content in contents.items()})
    return fit


def _no_progress(_stage: str, _share: float) -> None:
    """Tables are what the progress of a batch counts."""


def load(folder: Path, user_model: Model | None) -> Batch:
    """The finished tables of a folder, by name.

    Raises:
        FolderError: no table is finished there (`no-batch`), or a fit is damaged.
        ModelError: a fit was made with a function, which is not this one (`own-model`).
    """
    names = sorted(record.parent.name for record in folder.glob(f"*/{FIT_FILE}"))
    if not names:
        text = (
            f"{folder}: no finished table; expected the folder of a batch (to finish one, run "
            "it again)"
        )
        raise FolderError(text, "no-batch")
    fits = {name: files_of_fit.read(folder / name, user_model) for name in names}
    records = [rows.record_of(name, fit, _day_of_fit(folder / name)) for name, fit in fits.items()]
    return batch_of(folder, records, user_model, fits.__getitem__)
