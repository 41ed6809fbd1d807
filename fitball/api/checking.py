"""Is a table fit to be fitted: every fault of it, of its scene and of its force records, at once."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from fitball.api.asked import flips, sources_of
from fitball.api.calibrating import PathLike, Table
from fitball.data.force_file import find_force
from fitball.data.join import trusted_table
from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import ImpactTable, Notice
from fitball.errors import Fault, FitballError, ParameterError, ReadingError, SceneError, TableError
from fitball.kinds import checked
from fitball.visible import one_line

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, repr=False)
class Checked:
    """What a look at a table found: `errors` for which it would be refused, `notices`, and the `table` if it could be
    read. It counts as true where there is no error.
    """

    source: str
    errors: tuple[FitballError, ...]
    notices: tuple[Notice, ...]
    table: ImpactTable | None

    @property
    def ok(self) -> bool:
        """Whether the table would be taken."""
        return not self.errors

    def __bool__(self) -> bool:
        return self.ok

    @property
    def faults(self) -> list[dict[str, Any]]:
        """Every fault with its file, row, line and column, as far as it has them."""
        return [fault for error in self.errors for fault in _faults(error)]

    def to_frame(self) -> pd.DataFrame:
        """The faults, one row each."""
        import pandas as pd

        return pd.DataFrame(self.faults, columns=["file", "row", "line", "column", "message"])

    def __repr__(self) -> str:
        lines = [str(error) for error in self.errors]
        if self.table is not None:
            lines.append(f"{self.table.source}: {len(self.table)} impacts{', no fault' if self.ok else ''}")
            told = (*self.table.remarks, *(str(item) for item in self.notices[len(self.table.notices) :]))
            lines += [one_line(f"  - {remark}") for remark in told]
        return "\n".join(lines)


@checked
def check(
    data: Table,
    *,
    scene: Scene | None = None,
    config: PathLike | None = None,
    force: PathLike | None = None,
    units: Mapping[str, str] | None = None,
    flip: str | Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    as_read: bool = False,
) -> Checked:
    """Look for every fault of a table, its scene and its force records, as the verb `datasets check` does.

    For what is handed over, one table, see `calibrate`. Raises nothing that is a fault of the table.

    >>> fitball.check({"v_y1": [4.0, 6.0], "v_y2": [3.2, -4.7]}).ok
    False
    """
    errors: list[FitballError] = []
    table: ImpactTable | None = None
    extra: tuple[str, ...] = ()
    sources, files = sources_of(data)
    if len(sources) > 1:
        raise ParameterError(f"read a list of {len(sources)} tables, expected one: check each by itself")
    known = scene
    try:
        if known is None:
            try:
                known = load_scene(files[0] if files else None, config, as_read)
            except SceneError as error:
                # The table is still looked at, as one of tennis balls.
                errors.append(error)
        source = sources[0]
        table = source if isinstance(source, ImpactTable) else load_table(
            source, scene=known or Scene(), flip=flips(flip), columns=columns, units=units
        )  # fmt: skip
        if known is not None:
            extra = trusted_table([table], known, as_read=as_read)[1]
            records, found = find_force(files, table, known, None if force is None else os.fspath(force))
            extra += found
            extra += () if records is None else (f"{records.source}: {len(records.records)} force records",)
    except FitballError as error:
        errors.append(error)
    notices = (*(table.notices if table is not None else ()), *(Notice(text) for text in extra))
    return Checked(files[0] if files else "DataFrame", tuple(errors), notices, table)


def _faults(error: FitballError) -> list[dict[str, Any]]:
    if isinstance(error, TableError):
        faults = [*error.faults, *(Fault(f"what may be meant: {hint}") for hint in error.hints)]
    else:
        faults = [Fault(text) for text in (error.readings if isinstance(error, ReadingError) else [str(error)])]
    return [{"file": getattr(error, "source", None), **asdict(fault)} for fault in faults]
