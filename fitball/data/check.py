"""What `check` returns: a table as it is read, with all of its faults and doubts."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

from fitball.base.errors import InputError, Note
from fitball.base.findings import Findings
from fitball.data.bundled import descriptions, published_priors
from fitball.data.idle import idle_keys, idle_note
from fitball.data.load import Sources, list_of_sources, load_data
from fitball.data.read import Reading, TableSource
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable

# Columns of the frame of faults, behind the source: fields of a fault.
_FAULT_FIELDS = ("code", "row", "line", "column", "message")


def check(
    sources: Sources,
    scene: Scene | str | Path | None,
    as_read: bool,
    **reading: Unpack[Reading],
) -> Findings:
    """Frames `table` (as read), `faults` (source, code, row, line, column, message) and `doubts`
    (readings); without sources `bundled` (tables) and `priors` (published ones). `reading` are
    options of `load_table`.

    Raises:
        ParameterError: An option names no column, or a source is no table (`unknown-column`,
            `columns`, `not-a-table`, `read-already`).
        FolderError: There is no such file (`not-found`).
    """
    import pandas as pd

    listed_sources = list_of_sources(sources)
    if not listed_sources:
        bundled = pd.DataFrame(descriptions().items(), columns=["table", "description"])
        return Findings({"bundled": bundled, "priors": pd.DataFrame(published_priors())})
    table, scene_read, errors = _read(listed_sources, scene, reading)
    notes: tuple[Note, ...] = ()
    if table is not None:
        notes = (*table.notices, *idle_note(idle_keys(table, scene_read), "fits of this table"))
    doubts = [hint for error in errors for hint in error.hints]
    doubts += [note.text for note in notes if note.code == "misread"]
    notes = tuple(note for note in notes if note.code != "misread")
    faults = []
    for error in errors:
        for fault in error.faults:
            fields = (getattr(fault, field) for field in _FAULT_FIELDS)
            faults.append((error.source, *fields))
    head = ["source", *_FAULT_FIELDS]
    frames = {
        "table": pd.DataFrame() if table is None else table.to_frame(),
        "faults": pd.DataFrame(faults, columns=head, dtype=object),
        "doubts": pd.DataFrame({"reading": doubts}),
    }
    failed = bool(faults) or (bool(doubts) and not as_read)
    return Findings(frames, notes, failed)


def _read(
    sources: list[TableSource],
    scene: Scene | str | Path | None,
    reading: Reading,
) -> tuple[ImpactTable | None, Scene, list[InputError]]:
    """The tables joined, None where they cannot be read or joined, with their scene, and the
    errors: of several tables those of each, then those of all together.
    """
    errors = dict[str, InputError]()
    table = None
    scene_read = Scene()
    attempts = [sources]
    if len(sources) > 1:
        attempts = [*([source] for source in sources), sources]
    for attempt in attempts:
        try:
            table, scene_read = load_data(attempt, scene, True, **reading)
        except InputError as error:
            errors[error.source] = error
            table = None
    return table, scene_read, [*errors.values()]
