"""A check of a port against the golden impacts, in words and as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fitball.inference.prediction.port_check import PortCheck
from fitball.observables import SI_UNITS

EXPLANATION = (
    "Relative: speeds to the incident speed of the ball's centre and surface together, spins times the radius\n"
    "likewise, contact times to themselves; angles in radians. Double precision gives 1e-12 or better."
)


def port_text(check: PortCheck, ids: Sequence[str], model: str) -> str:
    """The check for a terminal."""
    lines = [f"Port of {model} on {len(ids)} golden impacts", ""]
    head = f"{'output':<14}{'largest difference':<28}{'relative':<12}{'at':<12}"
    lines += [head.rstrip()]
    for output in check.outputs:
        size = f"{output.absolute:.3g} {SI_UNITS[output.name]}"
        verdict = _verdict(check, output.relative)
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


def _verdict(check: PortCheck, relative: float) -> str:
    return "ok" if relative <= check.tolerance else "FAIL"


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
