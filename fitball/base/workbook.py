"""Frames as an Excel workbook, a sheet each. openpyxl is an optional package."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from io import BytesIO

from fitball.base.environment import install_command
from fitball.base.errors import ParameterError
from fitball.base.files import with_index
from fitball.base.values import DataFrame

# The file beside the page.
WORKBOOK_FILE = "results.xlsx"
# Letters of a sheet's name that Excel takes.
_LETTERS = 31
# Widths of columns, in letters.
_NARROWEST = 8
_WIDEST = 40
# When a workbook says that it was made: the same content, the same sheets.
_NO_DATE = datetime(2000, 1, 1, tzinfo=UTC).replace(tzinfo=None)


def require_openpyxl() -> None:
    """Refuse, before a long run, what ends in a workbook that cannot be written.

    Raises:
        ParameterError: openpyxl is not installed (`no-openpyxl`).
    """
    try:
        import openpyxl  # noqa: F401
    except ImportError:
        command = install_command("fitball[xlsx]")
        text = f"a workbook needs openpyxl: {command}, or leave out --xlsx"
        raise ParameterError(text, "no-openpyxl") from None


def workbook_bytes(frames: Mapping[str, DataFrame]) -> bytes:
    """A workbook with a sheet for each frame, by name: its heads, then a row each, in SI. What is
    no finite number is an empty cell.

    Raises:
        ParameterError: openpyxl is not installed (`no-openpyxl`).
    """
    require_openpyxl()
    from openpyxl import Workbook
    from openpyxl.styles import Font
    from openpyxl.utils import get_column_letter

    workbook = Workbook()
    workbook.remove(workbook.active)
    workbook.properties.created = _NO_DATE
    workbook.properties.modified = _NO_DATE
    for name, frame in frames.items():
        sheet = workbook.create_sheet(name[:_LETTERS])
        cells = with_index(frame)
        heads = [str(head) for head in cells.columns]
        sheet.append(heads)
        for cell in sheet[1]:
            cell.font = Font(bold=True)
        for row in cells.itertuples(index=False, name=None):
            sheet.append([_cell(value) for value in row])
        sheet.freeze_panes = "B2"
        for k, head in enumerate(heads, 1):
            width = min(max(len(head) + 2, _NARROWEST), _WIDEST)
            sheet.column_dimensions[get_column_letter(k)].width = width
    buffer = BytesIO()
    workbook.save(buffer)
    return buffer.getvalue()


def _cell(value: object) -> object:
    """A value as a cell has it: text that begins like a formula is no formula."""
    from numbers import Integral, Real

    import numpy as np
    import pandas as pd

    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value) if np.isfinite(float(value)) else None
    if pd.isna(value):  # type: ignore[call-overload]
        return None
    text = str(value)
    return f"'{text}" if text.startswith(("=", "+", "-", "@")) else text
