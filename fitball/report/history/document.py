"""Simulations: for a person as a document, for machines as rows and JSON in SI units; and the folder of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fitball.files import all_or_none
from fitball.inference.prediction.simulate import COURSES, Band, Simulation
from fitball.inference.results.quantiles import BAND
from fitball.models.history import History, Motion
from fitball.models.types import PHASE_SYMBOL, Phase
from fitball.observables import OBSERVABLES
from fitball.report.form.document import Document, Rank, Section, Table, Words, on_terminal
from fitball.report.form.files import json_text, write_text
from fitball.report.form.numbers import output_scale, percent

if TYPE_CHECKING:
    from fitball.report.figures.canvas import Figure

JSON_NAME = "simulate.json"
CSV_NAME = "history.csv"
FIGURE_STEM = "history"
UNITS = {
    "y": "m", "v_y": "m/s", "v_x": "m/s", "omega_1": "rad/s", "omega_2": "rad/s", "twist": "rad", "slip": "m/s",
    "normal_force": "N", "friction_force": "N",
}  # fmt: skip
RPM = 30.0 / np.pi


def simulate_document(simulations: Sequence[Simulation]) -> Document:
    """Rebound, phases with their times, peaks, and the state before and after landing and release, of each
    simulation; of several a first screen has the rebounds alone.
    """
    first: Rank = "first" if len(simulations) == 1 else "full"
    return Document("", [], [_section(k, simulation, first) for k, simulation in enumerate(simulations)])


def render(simulations: Sequence[Simulation]) -> str:
    """Simulations on a terminal, one below the other."""
    return on_terminal(simulate_document(simulations))


def _section(place: int, simulation: Simulation, rank: Rank) -> Section:
    history, impact = simulation.history, simulation.impact
    v_x, v_y, omega = float(impact.v_x1[0]), float(impact.v_y1[0]), float(impact.omega_1[0])
    head = (
        f"{simulation.model.name}: {np.hypot(v_x, v_y):.2f} m/s at {np.degrees(np.arctan2(v_y, v_x)):.1f} deg, "
        f"spin {omega:.1f} rad/s ({omega * RPM:.0f} rpm)"
    )
    phases = [["phase", "from [ms]", "to [ms]", "from", "to"]]
    phases += [
        [PHASE_SYMBOL[it.phase], _ms(it.start), _ms(it.end), f"{it.start_share:.4f}", f"{it.end_share:.4f}"]
        for it in history.spans
    ]
    force, deep, landing = history.peak_force, history.peak_compression, history.landing
    facts = [
        ["", "value", "where"],
        ["contact time", f"{1e3 * history.contact_time:.3f} ms", _contact_band(simulation)],
        *([OBSERVABLES[name].title, *_gap(simulation, name)] for name in simulation.gaps),
        ["greatest compression", f"{1e3 * deep.value:.2f} mm", f"at {_ms(deep.time)} ms"],
        ["greatest normal force", f"{force.value:.1f} N", f"at {_ms(force.time)} ms"],
    ]
    if landing.normal_impulse > 0.0:
        impulse = f"{landing.normal_impulse:.4f} N s up, {landing.friction_impulse:+.4f} N s along"
        facts.append(["landing impulse", impulse, "stops the shell at once"])
    between = (
        ["(between the flights: each is followed to the height of the centre at landing)"] if simulation.gaps else []
    )
    states = [
        ["", "v_x [m/s]", "v_y of the core [m/s]", "core spin [rad/s]", "shell spin [rad/s]"],
        _state("before landing", landing.before),
        _state("after landing", landing.after),
        _state("before release", history.release.before),
        _state("rebound", history.release.after),
    ]
    shares = ["(last two columns: shares of the contact time)"] if history.spans else []
    return Section(f"simulation-{place}", f"{simulation.label}: {head}" if simulation.label else head, [
        Words([_rebound(history), *([f"phases: {history.regime_name}"] * bool(history.spans))], "lead", rank="first"),
        Table("Peaks", facts, ["where"], rank=rank), Words(between, rank=rank),
        Table("Phases", phases, rank=rank), Words(shares, rank=rank),
        Words(_draws(simulation), rank=rank), Table("States", states),
        Words(["(v_y is positive towards the court; topspin is positive)"]),
    ])  # fmt: skip


def _rebound(history: History) -> str:
    """The rebound and the contact time in a sentence."""
    after = history.release.after
    return (
        f"Rebound: v_x2 {after.v_x:.2f} m/s, v_y2 {-after.v_y:.2f} m/s, omega_2 {after.omega_2:.1f} rad/s, after "
        f"{1e3 * history.contact_time:.2f} ms of contact."
    )


def _draws(simulation: Simulation) -> list[str]:
    """The draws behind the bands."""
    lost, band = percent(simulation.unsolved), simulation.band
    if band is None:
        bare = f"{lost} of the draws have no solution at this impact: no bands."
        return [bare] if simulation.unsolved > 0.0 else []
    shares = ", ".join(f"{name} {percent(share)}" for name, share in band.regimes.items() if name)
    text = f"{band.draws} posterior draws: {shares or 'no motion along the court'}."
    if band.failed:
        text += f" {band.failed} more, {lost}, have no solution at this impact and are left out."
    return [text]


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.4f}"


def _contact_band(simulation: Simulation) -> str:
    if simulation.band is None:
        return ""
    low, *_middle, high = simulation.band.contact_time
    return f"95 %: {1e3 * low:.2f} to {1e3 * high:.2f} ms"


def _gap(simulation: Simulation, name: str) -> tuple[str, str]:
    """A time, path or turn between the flights, and its band."""
    scale = output_scale(name)
    value = f"{scale.factor * simulation.gaps[name]:.{3 if OBSERVABLES[name].unit == 's' else 2}f} {scale.unit}"
    if simulation.band is None:
        return value, ""
    low, *_middle, high = scale.factor * simulation.band.gaps[name]
    return value, f"95 %: {low:.2f} to {high:.2f} {scale.unit}"


def _state(name: str, motion: Motion) -> list[str]:
    return [name, f"{motion.v_x:.3f}", f"{motion.v_y:.3f}", f"{motion.omega_1:.2f}", f"{motion.omega_2:.2f}"]


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
    """One curve without its time series: inputs, phases, peaks, jumps, rebound."""
    history, after, impact = simulation.history, simulation.history.release.after, simulation.impact
    return {
        "label": simulation.label,
        "model": simulation.model.name,
        "closures": dict(simulation.model.options),
        "parameters": dict(simulation.parameters),
        "impact": {name: float(getattr(impact, name)[0]) for name in ("v_x1", "v_y1", "omega_1")},
        "regime": history.regime_name,
        "contact_time": history.contact_time,
        "gaps": dict(simulation.gaps),
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
        "gaps": {name: dict(zip(BAND, levels.tolist(), strict=True)) for name, levels in band.gaps.items()},
        "regimes": dict(band.regimes),
    }


@all_or_none()
def write_all(folder: Path, content: Mapping[str, Any], csv: str, figure: Figure, form: str) -> tuple[Path, ...]:
    """Write every file, each whole or not at all; `simulate.json` last; returns their places.

    Raises ResultFolderError.
    """
    from fitball.report.figures.canvas import save_figure

    picture, table, record = folder / f"{FIGURE_STEM}.{form}", folder / CSV_NAME, folder / JSON_NAME
    save_figure(figure, picture, form)
    write_text(table, csv)
    write_text(record, json_text(content))
    return picture, table, record
