"""Where the force records of a table are: named by the user, by the scene, or beside the table."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from fitball.data.bundled import FORCE_ENDING, resolve_table
from fitball.data.dialect.frames import PARQUET_SUFFIXES
from fitball.data.force_file import ForceFile, load_force
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.errors import SceneError, TableError
from fitball.wording import option

LEFT_OUT = "none"


def find_force(
    sources: Sequence[str], table: ImpactTable, scene: Scene, named: str | None = None
) -> tuple[ForceFile | None, tuple[str, ...]]:
    """The force records of a table read from `sources`, None where there are none, and what to tell the user.

    `named` "none" leaves them out. What is `named` wins over the scene's `[force] file` (relative to the scene), and
    that over a file `<table>_force.csv` (or Parquet) beside a single table. Raises TableError as `load_force` does,
    SceneError for a scene that says how records are and no record.
    """
    if named == LEFT_OUT:
        return None, ("force records are left out on request",)
    if named is not None:
        return load_force(Path(named), table), ()
    if scene.force_file is not None:
        place = Path(scene.source or ".").parent / scene.force_file
        if not os.path.lexists(place):
            raise SceneError(f"{scene.source}: [force] file = '{scene.force_file}': there is no file {place}")
        return load_force(place, table), ()
    beside = [found for found in map(_beside, sources) if found is not None]
    if beside and len(sources) == 1:
        only = beside[0]
        return load_force(only, table), (f"force records found beside the table: {only.name}",)
    if beside:
        files = ", ".join(place.name for place in beside)
        named = option("force", "FILE")
        return None, (f"{files} not used: name one file for tables fitted together with {named} (id = table:id)",)
    if scene.force_sd is not None or scene.force_start_sd is not None:
        raise SceneError(f"{scene.source}: [force] describes records, but there are none: name them by file = ...")
    return None, ()


def _beside(source: str) -> Path | None:
    try:
        table = resolve_table(source)
    except TableError:
        # A table made in memory lies nowhere.
        return None
    places = [table.with_name(table.stem + FORCE_ENDING + suffix) for suffix in (".csv", *PARQUET_SUFFIXES)]
    return next((place for place in places if os.path.lexists(place)), None)
