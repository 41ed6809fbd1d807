"""What `check` returns: a table as it is read, with all of its faults and doubts."""

from pathlib import Path
from typing import Any

from fitball.base.errors import InputError
from fitball.base.findings import Findings
from fitball.data.bundled import descriptions, published
from fitball.data.read import Source, list_of_sources, load_data
from fitball.data.scene import Scene


def check(
    sources: Source, scene: Scene | str | Path | None, as_read: bool, **reading: Any
) -> Findings:
    """Frames `table` (as read), `faults` (code, row, line, column, message), `doubts`; without
    sources `bundled`, `priors`.
    """
    import pandas as pd

    if not (given := list_of_sources(sources)):
        known = pd.DataFrame(descriptions().items(), columns=["table", "description"])
        return Findings({"bundled": known, "priors": pd.DataFrame(published())})
    errors = dict[str, InputError]()
    whole = None
    # Of several tables the faults of each, then those of all together.
    for tried in (*([one] for one in given if len(given) > 1), given):
        try:
            whole = load_data(tried, scene, True, **reading)[0]
        except InputError as error:
            errors[error.source], whole = error, None
    names = ("code", "row", "line", "column", "message")
    faults = [
        (e.source, *(getattr(one, n) for n in names)) for e in errors.values() for one in e.faults
    ]
    notes = () if whole is None else whole.notices
    doubted = [hint for error in errors.values() for hint in error.hints]
    doubted += [note.text for note in notes if note.code == "misread"]
    notes = tuple(note for note in notes if note.code != "misread")
    frames = {
        "table": pd.DataFrame() if whole is None else whole.to_frame(),
        "faults": pd.DataFrame(faults, columns=["source", *names], dtype=object),
        "doubts": pd.DataFrame({"reading": doubted}),
    }
    return Findings(frames, notes, bool(faults) or (bool(doubted) and not as_read))
