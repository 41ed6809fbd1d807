"""Units and inputs of the thesis's simulations, turned to SI: what was printed, and how it was read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from fitball.data.published import fraction
from fitball.models.thesis import ThesisModel, compose_thesis
from fitball.models.types import ThesisClosures
from fitball.values import Ball

# The thesis converts with 39.37 inches to the metre; within its own numbers that is the inch.
INCH = 1.0 / 39.37
POUND_FORCE = 4.4482216152605
STIFFNESS = POUND_FORCE / INCH
TORSION = POUND_FORCE * INCH
DAMPING = POUND_FORCE / INCH
MASS = POUND_FORCE / INCH
INERTIA = POUND_FORCE * INCH

# Appendix B: weight 0.127 lb and g = 386.4 in/s^2 within the programs; 0.000329 lb s^2/in in the text. The printed
# spins follow the first, the printed contact times the second.
BALL_MASS = 0.127 / 386.4 * MASS
BALL_MASS_ROUNDED = 0.000329 * MASS
# 1.3 in as in Eq. (72), not the 1.25 in of Appendix B.
BALL_RADIUS = 1.3 * INCH
FRICTION = 0.55
K_THETA = 1000.0 * TORSION
# Eq. (53), inches against metres a second.
C1, C2 = 0.0431, -0.189
# Chapter II, sets (a) to (c); Appendix C rounds the last two to 0.00026 and 0.00025.
INERTIA_OF: Mapping[str, float] = {"1/2": 0.00028, "2/3": 0.000264, "3/4": 0.000257}


def offset_line() -> dict[str, float]:
    """Eq. (53) as `eps_10` [m] and `eps_slope` [m/(m/s)]."""
    return {"eps_10": (10.0 * C1 + C2) * INCH, "eps_slope": C1 * INCH}


def case_parameters(
    mass_ratio: str, k_y: float, i1_over_i: float, c_y: float | None = None, *, rounded_mass: bool = False
) -> dict[str, float]:
    """Parameters of model `thesis` for a set of the thesis; `k_y` [lb/in], `c_y` [lb s/in]."""
    mass = BALL_MASS_ROUNDED if rounded_mass else BALL_MASS
    values = {
        "mass_ratio": fraction(mass_ratio),
        "k_y": k_y * STIFFNESS,
        "k_theta": K_THETA,
        "mu": FRICTION,
        **offset_line(),
        "inertia_split": i1_over_i,
        "ball_mass": mass,
        "ball_radius": BALL_RADIUS,
        "inertia_ratio": INERTIA_OF[mass_ratio] * INERTIA / (mass * BALL_RADIUS**2),
    }
    return values if c_y is None else {**values, "c_y": c_y * DAMPING}


def row_parameters(row: Mapping[Any, Any], *, rounded_mass: bool = False) -> dict[str, float]:
    """`case_parameters` of a row of Appendix C with its own `c_y`."""
    set_values = (row["mass_ratio"], row["k_y [lb/in]"], row["i1_over_i"], row["c_y [lb s/in]"])
    return case_parameters(*set_values, rounded_mass=rounded_mass)


def printed_model() -> ThesisModel:
    """Model `thesis` as Appendix C and the examples use it: damping, inertia and restitution given."""
    return compose_thesis("thesis", Ball(), True, ThesisClosures("given", "table", "measured"))


def relative_error(computed: Any, printed: Any) -> Any:
    """Deviation from a printed value in per cent of its size."""
    return 100.0 * (np.asarray(computed) - np.asarray(printed)) / np.abs(np.asarray(printed))
