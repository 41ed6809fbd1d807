"""Simulations as a person reads them on a terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitball.inference.prediction.simulate import Simulation
from fitball.models.history import Motion
from fitball.models.types import PHASE_SYMBOL
from fitball.report.form.text_table import columns, wrapped


def render_simulation(simulation: Simulation) -> str:
    """Phases with their times, peaks, and the state before and after landing and release."""
    history, impact = simulation.history, simulation.impact
    v_x, v_y, omega = float(impact.v_x1[0]), float(impact.v_y1[0]), float(impact.omega_1[0])
    rpm = 30.0 / np.pi
    head = (
        f"{simulation.model.name}: {np.hypot(v_x, v_y):.2f} m/s at {np.degrees(np.arctan2(v_y, v_x)):.1f} deg, "
        f"spin {omega:.1f} rad/s ({omega * rpm:.0f} rpm)"
    )
    title = f"{simulation.label}: {head}" if simulation.label else head
    lines = [title, "-" * len(title)]
    if history.spans:
        lines += [f"phases: {history.regime_name}", ""]
        rows = [["phase", "from [ms]", "to [ms]", "from", "to"]]
        for span in history.spans:
            ends = [_ms(span.start), _ms(span.end), f"{span.start_share:.4f}", f"{span.end_share:.4f}"]
            rows.append([PHASE_SYMBOL[span.phase], *ends])
        lines += [*columns(rows), "(last two columns: shares of the contact time)", ""]
    force, deep = history.peak_force, history.peak_compression
    facts = [
        ["contact time", f"{1e3 * history.contact_time:.3f} ms", _contact_band(simulation)],
        ["greatest compression", f"{1e3 * deep.value:.2f} mm", f"at {_ms(deep.time)} ms"],
        ["greatest normal force", f"{force.value:.1f} N", f"at {_ms(force.time)} ms"],
    ]
    if history.landing.normal_impulse > 0.0:
        impulse = f"{history.landing.normal_impulse:.4f} N s up, {history.landing.friction_impulse:+.4f} N s along"
        facts.append(["landing impulse", impulse, "stops the shell at once"])
    width = max(len(row[1]) for row in facts)
    lines += [f"{row[0]:<22}  {row[1]:<{width}}  {row[2]}".rstrip() for row in facts]
    states = [
        ["", "v_x [m/s]", "v_y of the core [m/s]", "core spin [rad/s]", "shell spin [rad/s]"],
        _state("before landing", history.landing.before),
        _state("after landing", history.landing.after),
        _state("before release", history.release.before),
        _state("rebound", history.release.after),
    ]
    lines += ["", *columns(states), "(v_y counts towards the court; topspin is positive)"]
    lost = f"{100.0 * simulation.unsolved:.0f} %"
    if simulation.band is not None:
        shares = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in simulation.band.regimes.items() if name)
        said = f"{simulation.band.draws} draws of the posterior: {shares or 'no motion along the court'}."
        if simulation.band.failed:
            said += f" {simulation.band.failed} more, {lost}, cannot be solved at this impact: bands are of the rest."
        lines += ["", *wrapped([said])]
    elif simulation.unsolved > 0.0:
        lines += ["", f"{lost} of the draws cannot be solved at this impact: no bands."]
    return "\n".join(lines)


def render_all(simulations: Sequence[Simulation]) -> str:
    """Every curve, one below the other."""
    return "\n\n".join(render_simulation(simulation) for simulation in simulations)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.4f}"


def _contact_band(simulation: Simulation) -> str:
    if simulation.band is None:
        return ""
    low, *_middle, high = simulation.band.contact_time
    return f"95 %: {1e3 * low:.2f} to {1e3 * high:.2f} ms"


def _state(name: str, motion: Motion) -> list[str]:
    return [name, f"{motion.v_x:.3f}", f"{motion.v_y:.3f}", f"{motion.omega_1:.2f}", f"{motion.omega_2:.2f}"]
