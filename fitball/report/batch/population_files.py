"""Populations in full: `population.json` all in SI, `population.csv` with a row a quantity and table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fitball.inference.population.hyper import Known
from fitball.inference.population.levels import Level
from fitball.report.batch.populations import Populated
from fitball.report.form.files import json_text, remove, write_csv, write_text

JSON_NAME, CSV_NAME = "population.json", "population.csv"
KIND = "fitball population"


def write_populations(populated: Sequence[Populated], folder: Path) -> None:
    """Write both files, or remove those of an earlier run where there is no population."""
    if not populated:
        for name in (JSON_NAME, CSV_NAME):
            remove(folder / name)
        return
    write_csv(folder / CSV_NAME, (row for one in populated for row in table_rows(one)))
    write_text(folder / JSON_NAME, json_text(content(populated)))


def table_rows(populated: Populated) -> list[dict[str, object]]:
    """Each table alone and given the others: medians with the ends of 95 % intervals in SI, effective draws, k."""
    rows: list[dict[str, object]] = []
    levels = {name: level.name for level in populated.population.levels for name in level.tables}
    for table in populated.population.tables:
        row: dict[str, object] = {
            "quantity": populated.quantity.name, "unit": populated.quantity.unit, "table": table.name
        }  # fmt: skip
        for head, known in (("", populated.own[table.name]), ("pooled_", table.known)):
            row |= {f"{head}{end}": value for end, value in _ends(populated, known).items()}
        row |= {"effective_draws": table.effective, "pareto_k": _finite(table.pareto_k), "trusted": table.trusted}
        row |= {"level": levels.get(table.name)}
        rows.append(row)
    return rows


def content(populated: Sequence[Populated]) -> Mapping[str, object]:
    """What `population.json` holds."""
    return {"kind": KIND, "quantities": {one.quantity.name: _quantity(one) for one in populated}}


def _quantity(one: Populated) -> Mapping[str, object]:
    found = one.population
    told: dict[str, object] = {
        "unit": one.quantity.unit,
        "logarithmic": one.quantity.log,
        "tables": len(found.tables),
        "centre": _ends(one, found.centre) | {"error": found.centre.error},
        "spread": _spread(found.spread),
        "new_table": _ends(one, found.new),
        "not_trusted": list(found.doubtful),
        "left_out": dict(one.left_out),
    }
    if found.levels:
        told |= {
            "over": one.over,
            "within": None if found.within is None else _spread(found.within),
            "new_level": None if found.new_level is None else _ends(one, found.new_level),
            "levels": {level.name: _level(one, level) for level in found.levels},
        }
    return told


def _level(one: Populated, level: Level) -> Mapping[str, object]:
    return {
        "tables": list(level.tables), **_ends(one, level.known), "error": level.known.error,
        "new_table": None if level.new is None else _ends(one, level.new),
    }  # fmt: skip


def _spread(spread: Known) -> Mapping[str, float]:
    return {"median": spread.median, "q025": spread.low, "q975": spread.high, "error": spread.error}


def _ends(populated: Populated, known: Known) -> dict[str, float]:
    return dict(zip(("median", "q025", "q975"), populated.ends(known), strict=True))


def _finite(k: float) -> float | None:
    """Infinite where weights have no tail, or are equal."""
    return float(k) if np.isfinite(k) else None
