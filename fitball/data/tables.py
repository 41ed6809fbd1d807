"""Tables for a fit: one, or several joined, each checked by itself; refused if another reading fits much better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from fitball.data.between_flights import doubt_of_gaps
from fitball.data.covariance_entries import LEFT_OUT, Given
from fitball.data.laws import copies_between, repeats_of
from fitball.data.misreading import check_named, doubt_of_table, gaps_of_table, named_of
from fitball.data.read import Source, framed, load_table, name_of
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable, joined
from fitball.errors import ParameterError, ReadingError


def load_tables(
    sources: Sequence[ImpactTable | Source],
    scene: Scene | None = None,
    flip: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    ignore: Sequence[str] = (),
    covariances: Sequence[Given | None] | None = None,
) -> ImpactTable:
    """One table, or several joined; `flip`, `columns` and `ignore` as `load_table` has them, a column of one of
    several tables is flipped or ignored as `TABLE:COLUMN`; `covariances` are those of each. Raises as `load_table`
    does for each, TableError for tables that differ, ParameterError for a table that is not there.
    """
    return joined(_read_each(sources, scene, covariances, flip=flip, columns=columns, ignore=ignore))


def trusted_table(
    data: Sequence[ImpactTable | Source],
    scene: Scene,
    flip: Sequence[str] = (),
    as_read: bool = False,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    ignore: Sequence[str] = (),
    covariance: Given | None = None,
) -> tuple[ImpactTable, tuple[str, ...]]:
    """A table, or the one joined from several, and notes on how it was read.

    Each table is checked by itself, with the scene's ball. With `as_read` a table that another reading fits much
    better is accepted, with a note; otherwise ReadingError is raised. Raises ParameterError for `flip`, `columns`
    and the like of a table that has been read already, for one `covariance` of several tables, and as `load_tables`
    does.
    """
    read_already = [item for item in data if isinstance(item, ImpactTable)]
    named = {"flip": flip, "columns": columns, "units": units, "ignore": ignore}
    asked = [what for what, given in named.items() if given] + ["covariance"] * (covariance is not None)
    if asked and read_already:
        raise ParameterError(
            f"{asked[0]}: this table has been read already; pass it to load_table(file, {asked[0]}=...) instead"
        )
    for table in read_already:
        if kept := [name for name in named_of(scene.ignore, table.name) if table.measurement(name) is not None]:
            raise ParameterError(
                f"the scene ignores {', '.join(kept)}, but {table.name} has been read already; pass it to "
                f"load_table(file, ignore={kept}) instead"
            )
    off = isinstance(covariance, str) and covariance == LEFT_OUT
    if covariance is not None and not off and len(data) > 1:
        raise ParameterError(
            f"covariance: read one for {len(data)} tables; expected a file NAME_covariance.csv beside each of them"
        )
    tables = _read_each(data, scene, [covariance] * len(data), flip=flip, columns=columns, units=units, ignore=ignore)
    notes = []
    for table in tables:
        gaps = gaps_of_table(table, scene.ball)
        notes += [] if gaps is None else [f"{table.name}: {gaps}"]
        copies, near = repeats_of(table, scene.ball)
        if copies is not None and not as_read:
            raise ReadingError(table.source, (copies,), "rows are copies of others:")
        notes += [f"{table.name}: all rows are used, on request (as_read), although {copies}"] if copies else []
        notes += [f"{table.name}: {near}"] if near else []
        doubt = doubt_of_table(table, scene.ball)
        if doubt is not None and not as_read:
            raise ReadingError(table.source, doubt.lines(scene))
        if doubt is not None:
            notes.append(
                f"{table.name}: read as in its header, on request (as_read), although {doubt.lines(scene)[0]}"
            )
        asked_of = doubt_of_gaps(table, scene)
        if asked_of and not as_read:
            raise ReadingError(
                table.source, asked_of, "gaps between the flights disagree with speeds, spins or times:"
            )
        notes += [f"{table.name}: read as in its header, on request (as_read), although {item}" for item in asked_of]
    whole = joined(tables)
    if len(tables) > 1 and (copies := copies_between(tables, scene.ball)):
        if not as_read:
            raise ReadingError(" + ".join(table.source for table in tables), (copies,), "rows are copies of others:")
        notes.append(f"all tables are used, on request (as_read), although {copies}")
    return whole, tuple(notes)


def _read_each(
    sources: Sequence[ImpactTable | Source],
    scene: Scene | None,
    covariances: Sequence[Given | None] | None,
    *,
    flip: Sequence[str],
    ignore: Sequence[str],
    **reading: Any,
) -> list[ImpactTable]:
    """The tables one by one, those that were read already as they are."""
    names = [name_of(framed(source)) for source in sources if not isinstance(source, ImpactTable)]
    check_named("flip", flip, names)
    check_named("ignore", ignore, names)

    def read(source: ImpactTable | Source, covariance: Given | None) -> ImpactTable:
        if isinstance(source, ImpactTable):
            return source
        return load_table(source, scene=scene, flip=flip, ignore=ignore, covariance=covariance, **reading)

    return [*map(read, sources, [None] * len(sources) if covariances is None else covariances)]
