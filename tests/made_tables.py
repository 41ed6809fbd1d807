"""Tables for tests, made from numbers or from the text of a bundled file, without fitball's
reader.
"""

import csv

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.data.bundled import path_of_source
from fitball.data.table import ImpactTable, pair_of

_SI = {
    "m/s": 1.0,
    "rad/s": 1.0,
    "deg": np.pi / 180.0,
    "ms": 1e-3,
    "mm": 1e-3,
}


def impact_table(values, sd=None, corr=None, name="made", **parts):
    """A table of columns by name; numbers are repeated for all rows."""
    count = max(np.size(numbers) for numbers in values.values())

    def in_all_rows(columns):
        repeated = {}
        for column, numbers in (columns or {}).items():
            numbers = np.asarray(numbers, float)
            repeated[column] = np.broadcast_to(numbers, count).copy()
        return repeated

    ids = tuple(map(str, range(1, count + 1)))
    labels = {"id": ids, **parts.pop("labels", {})}
    pairs = {pair_of(*pair): numbers for pair, numbers in in_all_rows(corr).items()}
    return ImpactTable(
        name,
        in_all_rows(values),
        in_all_rows(sd),
        pairs,
        labels,
        **parts,
    )


def written(folder, text, name="t.csv"):
    """A file of a text or bytes."""
    path = folder / name
    if isinstance(text, bytes):
        path.write_bytes(text)
    else:
        path.write_bytes(text.encode())
    return path


def bundled(name, columns):
    """Some columns of a bundled table as a table, with its stated errors and correlations."""
    with path_of_source(name).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))

    def numbers(head, factor):
        return [float(row[head]) * factor for row in rows]

    values = {}
    sd = {}
    corr = {}
    for head in rows[0]:
        bare, _, unit = head.rstrip("]").partition(" [")
        column = bare.removesuffix("_sd")
        if bare in columns:
            values[bare] = numbers(head, _SI[unit])
        elif column in columns:
            sd[column] = numbers(head, _SI[unit])
        elif bare.startswith("corr("):
            pair = bare.removeprefix("corr(").removesuffix(")")
            corr[tuple(pair.split(","))] = numbers(head, 1.0)
    assert {*values} == {*columns}
    assert {*columns} <= {*COLUMNS}
    ids = tuple(row["id"] for row in rows)
    return impact_table(values, sd, corr, name, labels={"id": ids})
