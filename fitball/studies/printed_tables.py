"""Tables 2, 4, 6, 7 and 8 and the examples of Chapter III, recomputed."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from uncertainties import ufloat
from uncertainties.core import Variable

from fitball.data.thesis_tables import thesis_table
from fitball.data.wang import SPINS, measured
from fitball.inference.thesis_inputs import INCH, case_parameters, printed_model, relative_error
from fitball.values import impacts

TABLE_OF = {"zero": "table_2", "topspin": "table_4", "backspin": "table_6"}
# Appendix B, lbf s^2 in: what its programs use, against the 0.00028 of Chapter IV.
INERTIA_APPENDIX_B = 0.000342
MASS = 0.127 / 386.4
GRAVITY = 386.4


def energies() -> pd.DataFrame:
    """Tables 2, 4 and 6: restitutions and kinetic energies [lbf in] as printed, and recomputed from Wang's numbers.

    `implied_inertia` [lbf s^2 in] is what each printed rebound energy needs.
    """
    parts = []
    for spin in SPINS:
        printed, wang = thesis_table(TABLE_OF[spin]), measured(spin)
        speed_1 = printed["v_1 [m/s]"] / INCH
        speed_2 = printed["v_2 [m/s]"] / INCH
        spin_2 = printed["omega_2 [rad/s]"].to_numpy()
        moving = 0.5 * MASS * speed_2**2
        parts.append(
            pd.DataFrame(
                {
                    "spin": spin,
                    "theta_1 [deg]": printed["theta_1 [deg]"],
                    "cor": printed["cor"],
                    "cor_recomputed": wang["v_y2"] / wang["v_y1"],
                    "v_x2_over_v_x1": printed["v_x2_over_v_x1"],
                    "v_x2_over_v_x1_recomputed": wang["v_x2"] / wang["v_x1"],
                    "energy_1": printed["energy_1 [lb in]"],
                    "energy_1_recomputed": 0.5 * MASS * speed_1**2
                    + 0.5 * INERTIA_APPENDIX_B * printed["omega_1 [rad/s]"] ** 2,
                    "energy_2": printed["energy_2 [lb in]"],
                    "energy_2_recomputed": moving + 0.5 * INERTIA_APPENDIX_B * spin_2**2,
                    "implied_inertia": 2.0 * (printed["energy_2 [lb in]"] - moving) / spin_2**2,
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def mean_friction() -> pd.DataFrame:
    """Table 7 against Eq. (65) with the measured restitution: printed, recomputed, and how print was rounded."""
    printed = thesis_table("table_7")
    rows = []
    for spin in SPINS:
        wang = measured(spin)
        found = (wang["v_x1"] - wang["v_x2"]) / (wang["v_y1"] + wang["v_y2"])
        for angle, value, exact in zip(printed["nominal_theta_1 [deg]"], printed[spin], found, strict=True):
            if abs(value - exact) <= 0.0005 + 1e-12:
                how = "rounded"
            else:
                how = "truncated" if 0.0 <= exact - value < 0.001 else "differs"
            rows.append({"spin": spin, "theta_1 [deg]": angle, "printed": value, "recomputed": exact, "print": how})
    return pd.DataFrame(rows)


def bifilar_inertia() -> tuple[Variable, float, dict[str, float]]:
    """Table 8 and Eq. (79): the moment of inertia over `M R_s^2` with its standard deviation, the same inertia in
    lbf s^2 in, and the relative share of each source in the variance.

    Timing scatters as the ten runs do; length and radius carry the rounding of their last printed digit, as the
    thesis states nothing else. The mass cancels; `R_s` is the 1.25 in at which the strings were taped.
    """
    table = thesis_table("table_8")
    periods = (table["time [s]"] / table["cycles"]).to_numpy()
    period = ufloat(periods.mean(), periods.std(ddof=1) / math.sqrt(periods.size))
    length = ufloat(101.6, 0.1 / math.sqrt(12.0)) / 100.0 / INCH
    radius = ufloat(1.25, 0.01 / math.sqrt(12.0))
    ratio = GRAVITY / (length * (2.0 * math.pi / period) ** 2)
    inertia = MASS * radius**2 * ratio
    parts = inertia.error_components()
    named = {"timing": period, "radius": radius}
    total = inertia.std_dev**2
    shares = {name: parts.get(item, 0.0) ** 2 / total for name, item in named.items()}
    shares["string length"] = 1.0 - sum(shares.values())
    return ratio, inertia, shares


def examples() -> pd.DataFrame:
    """The two examples of Chapter III: printed, recomputed from the stated inputs, and from those that were used."""
    printed = thesis_table("chapter_three_examples")
    rows = []
    for row in printed.to_dict("records"):
        stated = (row["v_x1 [m/s]"], row["v_y1 [m/s]"], row["omega_1 [rad/s]"], row["c_y [lb s/in]"])
        used = stated if row["example"] == 1 else (12.63, 12.55, 136.32, 0.0129)
        for label, (v_x1, v_y1, omega_1, c_y) in (("stated", stated), ("used", used)):
            values = case_parameters(row["mass_ratio"], row["k_y [lb/in]"], row["i1_over_i"], c_y)
            chosen = printed_model()
            impact = impacts(v_x1, v_y1, omega_1, row["cor"])
            rebound, course = chosen.rebound(values, impact), chosen.course(values, impact, np.zeros(1))
            rows.append(
                {
                    "example": row["example"],
                    "inputs": label,
                    "v_x2": row["v_x2 [m/s]"],
                    "v_x2_recomputed": rebound.v_x2[0],
                    "v_x2_error": float(relative_error(rebound.v_x2[0], row["v_x2 [m/s]"])),
                    "omega_2": row["omega_2 [rad/s]"],
                    "omega_2_recomputed": rebound.omega_2[0],
                    "omega_2_error": float(relative_error(rebound.omega_2[0], row["omega_2 [rad/s]"])),
                    "transition": row["transition"],
                    "transition_recomputed": course.transition / course.contact_time,
                }
            )
    return pd.DataFrame(rows)
