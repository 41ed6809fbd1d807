"""Tables for tests, made from numbers or from the text of a bundled file, without fitball's
reader.
"""

import csv

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.data.bundled import place_of
from fitball.data.table import ImpactTable, pair_of

_SI = {
    "m/s": 1.0,
    "rad/s": 1.0,
    "deg": np.pi / 180.0,
    "ms": 1e-3,
    "mm": 1e-3,
}


def made(values, sd=None, corr=None, name="made", **parts):
    """A table of columns by name; numbers are repeated for all rows."""
    count = max(np.size(one) for one in values.values())

    def whole(part):
        return {
            name: np.broadcast_to(np.asarray(one, float), count).copy()
            for name, one in (part or {}).items()
        }

    labels = {"id": tuple(map(str, range(1, count + 1))), **parts.pop("labels", {})}
    pairs = {pair_of(*pair): one for pair, one in whole(corr).items()}
    return ImpactTable(name, whole(values), whole(sd), pairs, labels, **parts)


def written(folder, text, name="t.csv"):
    """A file of a text or bytes."""
    place = folder / name
    place.write_bytes(text if isinstance(text, bytes) else text.encode())
    return place


def bundled(name, columns):
    """Some columns of a bundled table as a table, with its stated errors and correlations."""
    with place_of(name).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    values = {}
    sd = {}
    corr = {}
    for head in rows[0]:
        bare, _, unit = head.rstrip("]").partition(" [")
        numbers = [float(row[head]) * _SI[unit] for row in rows] if unit in _SI else None
        if bare in columns:
            values[bare] = numbers
        elif bare.removesuffix("_sd") in columns:
            sd[bare.removesuffix("_sd")] = numbers
        elif bare.startswith("corr("):
            corr[tuple(bare[5:-1].split(","))] = [float(row[head]) for row in rows]
    assert {*values} == {*columns} <= {*COLUMNS}
    return made(values, sd, corr, name, labels={"id": tuple(row["id"] for row in rows)})
