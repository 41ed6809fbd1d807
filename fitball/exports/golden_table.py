"""The golden impacts as a table: what a port is fed with, and what it should answer."""

from __future__ import annotations

from fitball.inference.prediction.port_check import expected_outputs
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Golden
from fitball.models.types import OUTPUTS, regime_name
from fitball.observables import INCIDENT_UNITS, SI_UNITS
from fitball.report.form.files import csv_text
from fitball.values import FloatArray


def golden_ids(golden: Golden) -> tuple[str, ...]:
    """Names of the golden impacts."""
    return tuple(f"golden-{k}" for k in range(1, len(golden.impacts) + 1))


def golden_table(fitted: FittedModel, golden: Golden, inputs_only: bool) -> str:
    """CSV of the golden impacts to 17 digits, with the expected rebounds unless `inputs_only`."""
    expected = expected_outputs(fitted, golden)
    columns: dict[str, FloatArray] = {name: getattr(golden.impacts, name) for name in INCIDENT_UNITS}
    if not inputs_only:
        columns |= {name: expected[name] for name in OUTPUTS if name in expected}
    rows: list[dict[str, object]] = []
    for k, label in enumerate(golden_ids(golden)):
        row: dict[str, object] = {"id": label}
        row |= {f"{name} [{SI_UNITS[name]}]": repr(float(values[k])) for name, values in columns.items()}
        if fitted.model.needs_cor and golden.impacts.cor is not None:
            row["cor"] = repr(float(golden.impacts.cor[k]))
        if not inputs_only:
            row["regime"] = regime_name(int(golden.rebound.regime[k]))
        rows.append(row)
    return csv_text(rows)
