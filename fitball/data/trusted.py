"""The road by which tables come to a fit: read, and refused while another reading explains them much better."""

from __future__ import annotations

import os
from collections.abc import Sequence

from fitball.data.join import joined, read_each
from fitball.data.reading.doubt import doubt_of_table
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.errors import ParameterError, ReadingError


def trusted_table(
    data: ImpactTable | Sequence[str | os.PathLike[str]],
    scene: Scene,
    flip: Sequence[str] = (),
    as_read: bool = False,
) -> tuple[ImpactTable, tuple[str, ...]]:
    """A table, or the one joined from files, and what is to be said of how it was read.

    Each table is looked at by itself, as one of the scene's ball. With `as_read` one that another reading explains
    much better is taken all the same, and a sentence tells. Raises ReadingError for it otherwise, ParameterError for
    a table that was read already and is to be flipped, and as `load_tables` does.
    """
    if isinstance(data, ImpactTable):
        if flip:
            raise ParameterError(
                "flip: this table was read already; flip where it is read, load_table(file, flip=...)"
            )
        tables = [data]
    else:
        tables = read_each(data, scene, flip)
    notes = []
    for table in tables:
        doubt = doubt_of_table(table, scene.ball)
        if doubt is not None and not as_read:
            raise ReadingError(table.source, doubt.lines(scene))
        if doubt is not None:
            notes.append(
                f"{table.name}: taken as its header says, on request (as_read), although {doubt.lines(scene)[0]}"
            )
    return joined(tables), tuple(notes)
