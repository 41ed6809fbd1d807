"""The golden impacts as a table: what a port is fed with, and what it should answer."""

from __future__ import annotations

from collections.abc import Mapping

from fitball.inference.prediction.port_check import expected_outputs
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Golden
from fitball.models.types import regime_name
from fitball.report.form.csv import csv_text
from fitball.values import FloatArray

UNITS: Mapping[str, str] = {
    "v_x1": "m/s", "v_y1": "m/s", "omega_1": "rad/s", "v_x2": "m/s", "v_y2": "m/s", "omega_2": "rad/s",
    "contact_time": "s",
}  # fmt: skip


def golden_ids(golden: Golden) -> tuple[str, ...]:
    """Names of the golden impacts."""
    return tuple(f"golden-{k}" for k in range(1, len(golden.impacts) + 1))


def golden_table(fitted: FittedModel, golden: Golden, inputs_only: bool) -> str:
    """CSV of the golden impacts to 17 digits, with the expected rebounds unless `inputs_only`."""
    expected = expected_outputs(fitted, golden)
    columns: dict[str, FloatArray] = {name: getattr(golden.impacts, name) for name in ("v_x1", "v_y1", "omega_1")}
    if not inputs_only:
        columns |= {name: expected[name] for name in UNITS if name in expected}
    rows: list[dict[str, object]] = []
    for k, label in enumerate(golden_ids(golden)):
        row: dict[str, object] = {"id": label}
        row |= {f"{name} [{UNITS[name]}]": repr(float(values[k])) for name, values in columns.items()}
        if fitted.model.needs_cor and golden.impacts.cor is not None:
            row["cor"] = repr(float(golden.impacts.cor[k]))
        if not inputs_only:
            row["regime"] = regime_name(int(golden.rebound.regime[k]))
        rows.append(row)
    return csv_text(rows)
