"""The road by which tables come to a fit: read, and refused while another reading explains them much better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fitball.data.join import joined, read_each
from fitball.data.reading.doubt import doubt_of_table
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.data.written import Source
from fitball.errors import ParameterError, ReadingError


def trusted_table(
    data: Sequence[ImpactTable | Source],
    scene: Scene,
    flip: Sequence[str] = (),
    as_read: bool = False,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
) -> tuple[ImpactTable, tuple[str, ...]]:
    """A table, or the one joined from several, and what is to be said of how it was read.

    Each table is looked at by itself, as one of the scene's ball. With `as_read` one that another reading explains
    much better is taken all the same, and a sentence tells. Raises ReadingError for it otherwise, ParameterError for
    a table that was read already and is to be flipped or to have other names (`columns`), and as `load_tables` does.
    """
    for what, given in (("flip", flip), ("columns", columns), ("units", units)):
        if given and any(isinstance(item, ImpactTable) for item in data):
            raise ParameterError(
                f"{what}: this table was read already; say so where it is read, load_table(file, {what}=...)"
            )
    tables = read_each(data, scene, flip, columns, units)
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
