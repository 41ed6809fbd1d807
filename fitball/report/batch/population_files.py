"""Populations in full: `population.json` all in SI, `population.csv` with a row a quantity and table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from fitball.inference.population.reweighting import Known
from fitball.report.batch.populations import Populated
from fitball.report.form.atomic_write import remove, write_text
from fitball.report.form.csv import write_csv
from fitball.report.form.json_text import json_text

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
    for table in populated.population.tables:
        row: dict[str, object] = {
            "quantity": populated.quantity.name, "unit": populated.quantity.unit, "table": table.name
        }  # fmt: skip
        for head, known in (("", populated.own[table.name]), ("pooled_", table.known)):
            row |= {f"{head}{end}": value for end, value in _ends(populated, known).items()}
        row |= {"effective_draws": table.effective, "pareto_k": _finite(table.pareto_k), "trusted": table.trusted}
        rows.append(row)
    return rows


def content(populated: Sequence[Populated]) -> Mapping[str, object]:
    """What `population.json` holds."""
    return {"kind": KIND, "quantities": {one.quantity.name: _quantity(one) for one in populated}}


def _quantity(one: Populated) -> Mapping[str, object]:
    spread = one.population.spread
    return {
        "unit": one.quantity.unit,
        "logarithmic": one.quantity.log,
        "tables": len(one.population.tables),
        "centre": _ends(one, one.population.centre) | {"error": one.population.centre.error},
        "spread": {"median": spread.median, "q025": spread.low, "q975": spread.high, "error": spread.error},
        "not_trusted": list(one.population.doubtful),
        "left_out": dict(one.left_out),
    }


def _ends(populated: Populated, known: Known) -> dict[str, float]:
    return dict(zip(("median", "q025", "q975"), populated.ends(known), strict=True))


def _finite(k: float) -> float | None:
    """Infinite where weights have no tail, or are equal."""
    return float(k) if np.isfinite(k) else None
