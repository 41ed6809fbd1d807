"""What `check` returns: a table as it is read, with all of its faults and doubts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fitball.base.errors import InputError
from fitball.base.findings import Findings
from fitball.data.bundled import descriptions, published_priors
from fitball.data.read import TableSource, list_of_sources, load_data
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable

# Columns of the frame of faults, behind the source: fields of a fault.
_FIELDS = ("code", "row", "line", "column", "message")


def check(
    sources: TableSource, scene: Scene | str | Path | None, as_read: bool, **reading: Any
) -> Findings:
    """Frames `table` (as read), `faults` (code, row, line, column, message), `doubts`; without
    sources `bundled`, `priors`. Raises ParameterError and FolderError as `load_data` does.
    """
    import pandas as pd

    listed_sources = list_of_sources(sources)
    if not listed_sources:
        bundled = pd.DataFrame(descriptions().items(), columns=["table", "description"])
        return Findings({"bundled": bundled, "priors": pd.DataFrame(published_priors())})
    table, errors = _tried(listed_sources, scene, reading)
    notes = () if table is None else table.notices
    doubts = [hint for error in errors for hint in error.hints]
    doubts += [note.text for note in notes if note.code == "misread"]
    notes = tuple(note for note in notes if note.code != "misread")
    faults = [
        (error.source, *(getattr(fault, field) for field in _FIELDS))
        for error in errors
        for fault in error.faults
    ]
    frames = {
        "table": pd.DataFrame() if table is None else table.to_frame(),
        "faults": pd.DataFrame(faults, columns=["source", *_FIELDS], dtype=object),
        "doubts": pd.DataFrame({"reading": doubts}),
    }
    failed = bool(faults) or (bool(doubts) and not as_read)
    return Findings(frames, notes, failed)


def _tried(
    sources: list[TableSource],
    scene: Scene | str | Path | None,
    reading: dict[str, Any],
) -> tuple[ImpactTable | None, list[InputError]]:
    """All tables as one, None where they cannot be, and the errors: of several tables those of
    each, then those of all together.
    """
    errors = dict[str, InputError]()
    table = None
    attempts = [[source] for source in sources] if len(sources) > 1 else []
    for attempt in (*attempts, sources):
        try:
            table = load_data(attempt, scene, True, **reading)[0]
        except InputError as error:
            errors[error.source] = error
            table = None
    return table, [*errors.values()]
