"""Write the bundled table of forty impacts, `datasets/synthetic_court.csv`, whose truth is known.

It resembles a student's table: km/h, degrees, rpm, two sessions, more flat balls than topspin. The model is two-mass;
each measured column has its own noise.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import fitball

TRUTH = {
    "mass_ratio": 0.86,
    "k_y": 2.3e4,
    "k_theta": 24.0,
    "mu": 0.66,
    "eps_10": 1.8e-3,
    "eps_slope": 0.0,
    "cor_10": 0.76,
    "cor_slope": -0.012,
}
NOISE = {"v_x2": 0.30, "v_y2": 0.25, "omega_2": 9.0}  # m/s, m/s, rad/s
ROWS = 40
RPM = 2.0 * np.pi / 60.0


def table_text(seed: int) -> str:
    """The table as text."""
    rng = np.random.default_rng(seed)
    topspin = np.arange(ROWS) % 8 > 4
    speed = rng.uniform(14.0, 27.0, ROWS)
    angle = np.radians(rng.uniform(14.0, 62.0, ROWS))
    spin = np.where(topspin, rng.uniform(120.0, 300.0, ROWS), rng.normal(0.0, 25.0, ROWS))
    # As printed, so that the truth is that of the printed incidence.
    speed, spin = np.round(3.6 * speed, 1) / 3.6, np.round(spin / RPM) * RPM
    angle = np.radians(np.round(np.degrees(angle), 1))
    impacts = fitball.impacts(v_x1=speed * np.cos(angle), v_y1=speed * np.sin(angle), omega_1=spin)
    rebound = fitball.model("two-mass").rebound(TRUTH, impacts)
    measured = {name: getattr(rebound, name) + sd * rng.standard_normal(ROWS) for name, sd in NOISE.items()}
    columns = {
        "id": [str(row + 1) for row in range(ROWS)],
        "group": ["tuesday" if row < ROWS // 2 else "friday" for row in range(ROWS)],
        "v_1 [km/h]": [f"{3.6 * value:.1f}" for value in speed],
        "theta_1 [deg]": [f"{np.degrees(value):.1f}" for value in angle],
        "omega_1 [rpm]": [f"{value / RPM:.0f}" for value in spin],
        "v_x2 [km/h]": [f"{3.6 * value:.1f}" for value in measured["v_x2"]],
        "v_y2 [km/h]": [f"{3.6 * value:.1f}" for value in measured["v_y2"]],
        "omega_2 [rpm]": [f"{value / RPM:.0f}" for value in measured["omega_2"]],
    }
    return "\n".join([",".join(columns), *map(",".join, zip(*columns.values(), strict=True))]) + "\n"


if __name__ == "__main__":
    place = Path(__file__).resolve().parent.parent / "datasets" / "synthetic_court.csv"
    place.write_text(table_text(seed=1), encoding="utf-8")
