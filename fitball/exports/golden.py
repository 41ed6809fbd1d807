"""The golden impacts as a table, what a port is fed with and what it should answer; and the check of a port against
them, in words and as plain data.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fitball.inference.prediction.outputs import PortCheck, expected_outputs
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Golden
from fitball.models.types import OUTPUTS, regime_name
from fitball.observables import INCIDENT_UNITS, SI_UNITS
from fitball.report.form.files import csv_text
from fitball.values import FloatArray

EXPLANATION = (
    "Relative: speeds to the incident speed of the ball's centre and surface together, spins times the radius\n"
    "likewise, contact times to themselves; angles in radians. Double precision gives 1e-12 or better."
)


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


def port_text(check: PortCheck, ids: Sequence[str], model: str) -> str:
    """The check for a terminal."""
    lines = [f"Port of {model} on {len(ids)} golden impacts", ""]
    head = f"{'output':<14}{'largest difference':<28}{'relative':<12}{'at':<12}"
    lines += [head.rstrip()]
    for output in check.outputs:
        size = f"{output.absolute:.3g} {SI_UNITS[output.name]}"
        verdict = "ok" if output.relative <= check.tolerance else "FAIL"
        lines.append(f"{output.name:<14}{size:<28}{output.relative:<12.2g}{ids[output.worst]:<12}{verdict}")
    lines += ["", f"{'impact':<12}{'relative':<12}{'':<6}regime"]
    for k, label in enumerate(ids):
        verdict = "FAIL" if check.failed[k] else "ok"
        other = "  (the port says another)" if k in check.regimes_wrong else ""
        lines.append(f"{label:<12}{check.relative[k]:<12.2g}{verdict:<6}{check.regimes[k]}{other}")
    failed = int(check.failed.sum())
    result = "passed" if check.passed else f"FAILED: {failed} of {len(ids)} impacts"
    lines += ["", EXPLANATION, "", f"{result} (tolerance {check.tolerance:g} relative)"]
    return "\n".join(lines)


def port_json(check: PortCheck, ids: Sequence[str], model: str) -> dict[str, Any]:
    """The check for machines: SI units, angles in radians."""
    return {
        "kind": "fitball verify",
        "model": model,
        "passed": check.passed,
        "tolerance": check.tolerance,
        "outputs": {
            output.name: {
                "unit": SI_UNITS[output.name],
                "absolute": output.absolute,
                "relative": output.relative,
                "impact": ids[output.worst],
            }
            for output in check.outputs
        },
        "impacts": [
            {
                "id": label,
                "relative": float(check.relative[k]),
                "regime": check.regimes[k],
                "regime_agrees": k not in check.regimes_wrong,
                "passed": not bool(check.failed[k]),
            }
            for k, label in enumerate(ids)
        ],
    }
