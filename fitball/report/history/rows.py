"""Simulations as rows for CSV and as content for JSON, SI units throughout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from fitball.inference.prediction.simulate import COURSES, Band, Simulation
from fitball.inference.results.quantiles import BAND
from fitball.models.types import PHASE_SYMBOL, Phase

UNITS = {
    "y": "m", "v_y": "m/s", "v_x": "m/s", "omega_1": "rad/s", "omega_2": "rad/s", "twist": "rad", "slip": "m/s",
    "normal_force": "N", "friction_force": "N",
}  # fmt: skip


def history_rows(simulations: Sequence[Simulation]) -> list[dict[str, object]]:
    """One row a curve and time, with the quantiles of the band where there is one."""
    rows: list[dict[str, object]] = []
    for simulation in simulations:
        history = simulation.history
        for k, (share, time) in enumerate(zip(simulation.shares, history.times, strict=True)):
            row: dict[str, object] = {"curve": simulation.label, "share": float(share), "time [s]": float(time)}
            row |= {f"{name} [{UNITS[name]}]": float(getattr(history, name)[k]) for name in COURSES}
            # Empty where motion along the court is not followed.
            row["phase"] = PHASE_SYMBOL[Phase(history.phase[k])] if history.phase[k] else ""
            if simulation.band is not None:
                for name in COURSES:
                    levels = simulation.band.quantiles[name][:, k]
                    row |= {
                        f"{name}_{level} [{UNITS[name]}]": float(v) for level, v in zip(BAND, levels, strict=True)
                    }
            rows.append(row)
    return rows


def simulation_json(simulation: Simulation) -> dict[str, Any]:
    """One curve without its courses: what went in, the phases, the peaks, the jumps, the rebound."""
    history, after, impact = simulation.history, simulation.history.release.after, simulation.impact
    return {
        "label": simulation.label,
        "model": simulation.model.name,
        "closures": dict(simulation.model.options),
        "parameters": dict(simulation.parameters),
        "impact": {name: float(getattr(impact, name)[0]) for name in ("v_x1", "v_y1", "omega_1")},
        "regime": history.regime_name,
        "contact_time": history.contact_time,
        "phases": [asdict(span) | {"phase": PHASE_SYMBOL[span.phase]} for span in history.spans],
        "peak_compression": asdict(history.peak_compression),
        "peak_normal_force": asdict(history.peak_force),
        "landing": asdict(history.landing),
        "release": asdict(history.release),
        "rebound": {"v_x2": after.v_x, "v_y2": -after.v_y, "omega_2": after.omega_2},
        "posterior": None if simulation.band is None else _band(simulation.band),
        "unsolved": simulation.unsolved,
    }


def _band(band: Band) -> dict[str, object]:
    return {
        "draws": band.draws,
        "failed": band.failed,
        "contact_time": dict(zip(BAND, band.contact_time.tolist(), strict=True)),
        "regimes": dict(band.regimes),
    }
