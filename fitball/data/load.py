"""What every fit begins with: one table or several, read, doubted and joined, with their scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias, Unpack

from fitball.base.errors import Fault, InputError, Note, ParameterError
from fitball.base.text import listed
from fitball.data.misreading import doubts
from fitball.data.read import (
    Reading,
    TableSource,
    load_table,
    located,
    readings_in_words,
    scene_beside,
    unique_ids,
)
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable, join_tables

# Several sources, one, or none.
Sources: TypeAlias = Sequence[TableSource] | TableSource | None


def load_data(
    sources: Sources,
    scene: Scene | str | Path | None,
    as_read: bool,
    **reading: Unpack[Reading],
) -> tuple[ImpactTable, Scene]:
    """The table and the scene of a fit: one or several tables joined; the scene that is passed, or
    that beside the first table.

    Readings that explain a table far better are refused or, `as_read`, noted. Scenes beside further
    tables must name the same ball. `reading` are options of `load_table`.

    Raises:
        InputError: A table cannot be read or has faults, is probably misread (`misread`), or does
            not belong to the others (`scenes-differ`, and the codes of `join_tables`).
        ParameterError: There is no source (`no-data`), an option names no column
            (`unknown-column`, `columns`), or a source is no table (`not-a-table`,
            `read-already`).
        FolderError: There is no such file (`not-found`).
    """
    every_source = list_of_sources(sources)
    pairs = [_table_and_scene(source, scene, reading) for source in every_source]
    if not pairs:
        raise ParameterError(
            "no table was given; expected files, data frames, or names of bundled ones",
            "no-data",
        )
    first_scene = pairs[0][1]
    notes = list[Note]()
    for source, (table, scene_of_table) in zip(every_source, pairs, strict=True):
        if scene_of_table.ball != first_scene.ball:
            words = (
                "the scene beside this table names another ball than that of the first; "
                "expected one ball, or one scene for all (--scene)"
            )
            raise InputError(table.name, [Fault("scenes-differ", words)])
        others = doubts(table, first_scene.ball_value())
        readings = readings_in_words(others, source, scene_of_table, **reading)
        if readings and not as_read:
            words = (
                "another reading of the columns fits the data much better; if the table is "
                "right, pass --as-read"
            )
            raise InputError(table.name, [Fault("misread", words)], readings)
        notes += [Note("misread", f"{table.name}: {text}") for text in readings]
    tables = [table for table, _ in pairs]
    # Files of several folders may have one name.
    numbered = [str(k + 1) for k in range(len(tables))]
    names = unique_ids([table.name for table in tables], numbered)
    named = [replace(table, name=name) for table, name in zip(tables, names, strict=True)]
    table = join_tables(named)
    return replace(table, notices=(*table.notices, *notes)), first_scene


def list_of_sources(sources: Sources) -> list[TableSource]:
    """The sources of an argument that is a sequence of them, a single source, or None."""
    if sources is None:
        return []
    if isinstance(sources, Sequence) and not isinstance(sources, str | bytes):
        return [*sources]
    return [sources]


def _table_and_scene(
    source: TableSource,
    scene: Scene | str | Path | None,
    reading: Reading,
) -> tuple[ImpactTable, Scene]:
    """A table and its scene: the scene that is passed, or that beside the table. Raises what
    `load_table` raises, and ParameterError (`read-already`).
    """
    if isinstance(source, ImpactTable):
        if any(reading.values()):
            options = listed(reading, "or")
            words = f"{source.name} has been read already; pass {options} to load_table"
            raise ParameterError(words, "read-already")
        read_from = Path(source.read[0]["source"]) if source.read else source
        return source, scene if isinstance(scene, Scene) else scene_beside(read_from, scene)
    if not isinstance(scene, Scene):
        scene = scene_beside(located(source)[0], scene)
    return load_table(source, scene=scene, **reading), scene
