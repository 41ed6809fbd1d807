"""Every parameter that a model can have, in one table.

Priors are wide, and truncated by the bounds; a scene states narrower ones. Typical values are round
numbers near the fits to Wang's 21 impacts.
"""

from collections.abc import Mapping

from fitball.base.display_units import GRAM, KN_PER_M, MILLI_S_PER_M, MM, MM_PER_M_PER_S
from fitball.base.priors import ParameterSpec

# A row a parameter: name, unit, bounds and prior; meaning and symbol; what else is known of it.
_ALL = (
    ParameterSpec(
        "mass_ratio",
        "",
        0.3,
        1.0,
        "uniform(0.3, 1)",
        "relative core mass, over that of the ball",
        r"$M_1/M$",
        typical=0.87,
    ),
    ParameterSpec(
        "k_y",
        "N/m",
        1.0e2,
        1.0e7,
        "lognormal(2.0e4, 1.0)",
        "vertical stiffness, between core and shell",
        r"$K_y$",
        typical=2.0e4,
        display_unit=KN_PER_M,
        logarithmic=True,
    ),
    ParameterSpec(
        "k_theta",
        "N m/rad",
        1.0e-2,
        1.0e8,
        "lognormal(30, 1.5)",
        "torsional stiffness, between core and shell",
        r"$K_\theta$",
        typical=20.0,
        logarithmic=True,
    ),
    ParameterSpec(
        "mu",
        "",
        0.0,
        5.0,
        "lognormal(0.6, 0.4)",
        "friction coefficient, of the ball sliding on the court",
        r"$\mu$",
        typical=0.56,
    ),
    ParameterSpec(
        "eps_10",
        "m",
        -0.033,
        0.033,
        "normal(0, 0.005)",
        "normal-force offset, ahead of the centre, at 10 m/s",
        r"$\varepsilon_{10}$",
        typical=2.4e-3,
        display_unit=MM,
    ),
    ParameterSpec(
        "eps_slope",
        "m/(m/s)",
        -0.01,
        0.01,
        "normal(0, 0.001)",
        "slope of the offset, its change per m/s of vertical speed",
        r"$\varepsilon'$",
        typical=0.0,
        display_unit=MM_PER_M_PER_S,
    ),
    ParameterSpec(
        "cor_10",
        "",
        0.0,
        1.0,
        "normal(0.75, 0.15)",
        "vertical restitution, the coefficient at 10 m/s",
        r"$\mathrm{COR}_{10}$",
        typical=0.776,
    ),
    ParameterSpec(
        "cor_slope",
        "1/(m/s)",
        -0.1,
        0.1,
        "normal(0, 0.02)",
        "slope of restitution, its change per m/s of vertical speed",
        r"$\mathrm{COR}'$",
        typical=-0.0158,
        display_unit=MILLI_S_PER_M,
    ),
    ParameterSpec(
        "zeta_theta",
        "",
        0.0,
        10.0,
        "lognormal(0.5, 1.0)",
        "torsional damping, its ratio during slip",
        r"$\zeta_\theta$",
        typical=0.5,
        logarithmic=True,
    ),
    ParameterSpec(
        "inertia_split",
        "",
        1.0e-6,
        1.0 - 1.0e-6,
        "uniform(0.1, 0.98)",
        "relative core inertia, over that of the ball",
        r"$I_1/I$",
        typical=0.7,
    ),
    ParameterSpec(
        "e_x",
        "",
        -1.0,
        1.0,
        "normal(0, 0.5)",
        "grip restitution, tangential coefficient of the contact point",
        r"$e_x$",
        typical=0.1,
    ),
    ParameterSpec(
        "offset",
        "m",
        -0.033,
        0.033,
        "normal(0, 0.005)",
        "normal-force offset, ahead of the centre",
        r"$\varepsilon$",
        typical=2.4e-3,
        display_unit=MM,
    ),
    ParameterSpec(
        "ball_mass",
        "kg",
        1.0e-6,
        20.0,
        "normal(0.0576, 0.001)",
        "mass of the ball",
        r"$M$",
        display_unit=GRAM,
    ),
    ParameterSpec(
        "ball_radius",
        "m",
        1.0e-4,
        0.5,
        "normal(0.03302, 0.0005)",
        "outer radius of the ball",
        r"$R$",
        display_unit=MM,
    ),
    ParameterSpec(
        "inertia_ratio",
        "",
        0.05,
        1.0,
        "normal(0.56, 0.015)",
        "relative inertia, of the ball over M R^2",
        r"$I/MR^2$",
    ),
)

SPECS: Mapping[str, ParameterSpec] = {spec.name: spec for spec in _ALL}
BALL_PARAMETERS = ("ball_mass", "ball_radius", "inertia_ratio")
# Names of the models of `registry`, which no function of one's own may have; parameters that are
# not of a model, and names of derived quantities and of dimensions of files, which no parameter of
# a function may have.
NAMES = ("two-mass", "thesis-exact", "grip-slip", "brody")
TAKEN = (
    "scale",
    "clock",
    "tilt",
    "court_height",
    "degrees_of_freedom",
    "cor_median",
    "eps_median",
    "court_pace",
    "cor_254cm",
    "rebound_254cm",
    "chain",
    "draw",
    "ensemble",
)
