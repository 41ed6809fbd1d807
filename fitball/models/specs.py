"""Every parameter that a model can have, in one table.

Priors are wide, and truncated by the bounds; a scene states narrower ones. Typical values are round
numbers near the fits to Wang's 21 impacts.
"""

from collections.abc import Mapping

from fitball.base.display_units import GRAM, KN_PER_M, MILLI_S_PER_M, MM, MM_PER_M_PER_S
from fitball.base.priors import ParameterSpec

# In the order in which reports list parameters; numbers are in SI.
_ALL = (
    ParameterSpec(
        name="mass_ratio",
        unit="",
        lower=0.3,
        upper=1.0,
        prior="uniform(0.3, 1)",
        meaning="relative core mass, over that of the ball",
        symbol=r"$M_1/M$",
        typical=0.87,
    ),
    ParameterSpec(
        name="k_y",
        unit="N/m",
        lower=1.0e2,
        upper=1.0e7,
        prior="lognormal(2.0e4, 1.0)",
        meaning="vertical stiffness, between core and shell",
        symbol=r"$K_y$",
        typical=2.0e4,
        display_unit=KN_PER_M,
        logarithmic=True,
    ),
    ParameterSpec(
        name="k_theta",
        unit="N m/rad",
        lower=1.0e-2,
        upper=1.0e8,
        prior="lognormal(30, 1.5)",
        meaning="torsional stiffness, between core and shell",
        symbol=r"$K_\theta$",
        typical=20.0,
        logarithmic=True,
    ),
    ParameterSpec(
        name="mu",
        unit="",
        lower=0.0,
        upper=5.0,
        prior="lognormal(0.6, 0.4)",
        meaning="friction coefficient, of the ball sliding on the court",
        symbol=r"$\mu$",
        typical=0.56,
    ),
    ParameterSpec(
        name="eps_10",
        unit="m",
        lower=-0.033,
        upper=0.033,
        prior="normal(0, 0.005)",
        meaning="normal-force offset, ahead of the centre, at 10 m/s",
        symbol=r"$\varepsilon_{10}$",
        typical=2.4e-3,
        display_unit=MM,
    ),
    ParameterSpec(
        name="eps_slope",
        unit="m/(m/s)",
        lower=-0.01,
        upper=0.01,
        prior="normal(0, 0.001)",
        meaning="slope of the offset, its change per m/s of vertical speed",
        symbol=r"$\varepsilon'$",
        typical=0.0,
        display_unit=MM_PER_M_PER_S,
    ),
    ParameterSpec(
        name="cor_10",
        unit="",
        lower=0.0,
        upper=1.0,
        prior="normal(0.75, 0.15)",
        meaning="vertical restitution, the coefficient at 10 m/s",
        symbol=r"$\mathrm{COR}_{10}$",
        typical=0.776,
    ),
    ParameterSpec(
        name="cor_slope",
        unit="1/(m/s)",
        lower=-0.1,
        upper=0.1,
        prior="normal(0, 0.02)",
        meaning="slope of restitution, its change per m/s of vertical speed",
        symbol=r"$\mathrm{COR}'$",
        typical=-0.0158,
        display_unit=MILLI_S_PER_M,
    ),
    ParameterSpec(
        name="zeta_theta",
        unit="",
        lower=0.0,
        upper=10.0,
        prior="lognormal(0.5, 1.0)",
        meaning="torsional damping, its ratio during slip",
        symbol=r"$\zeta_\theta$",
        typical=0.5,
        logarithmic=True,
    ),
    ParameterSpec(
        name="inertia_split",
        unit="",
        lower=1.0e-6,
        upper=1.0 - 1.0e-6,
        prior="uniform(0.1, 0.98)",
        meaning="relative core inertia, over that of the ball",
        symbol=r"$I_1/I$",
        typical=0.7,
    ),
    ParameterSpec(
        name="e_x",
        unit="",
        lower=-1.0,
        upper=1.0,
        prior="normal(0, 0.5)",
        meaning="grip restitution, tangential coefficient of the contact point",
        symbol=r"$e_x$",
        typical=0.1,
    ),
    ParameterSpec(
        name="offset",
        unit="m",
        lower=-0.033,
        upper=0.033,
        prior="normal(0, 0.005)",
        meaning="normal-force offset, ahead of the centre",
        symbol=r"$\varepsilon$",
        typical=2.4e-3,
        display_unit=MM,
    ),
    ParameterSpec(
        name="ball_mass",
        unit="kg",
        lower=1.0e-6,
        upper=20.0,
        prior="normal(0.0576, 0.001)",
        meaning="mass of the ball",
        symbol=r"$M$",
        display_unit=GRAM,
    ),
    ParameterSpec(
        name="ball_radius",
        unit="m",
        lower=1.0e-4,
        upper=0.5,
        prior="normal(0.03302, 0.0005)",
        meaning="outer radius of the ball",
        symbol=r"$R$",
        display_unit=MM,
    ),
    ParameterSpec(
        name="inertia_ratio",
        unit="",
        lower=0.05,
        upper=1.0,
        prior="normal(0.54, 0.03)",
        meaning="relative inertia, of the ball over M R^2",
        symbol=r"$I/MR^2$",
    ),
)

SPECS: Mapping[str, ParameterSpec] = {spec.name: spec for spec in _ALL}
# Parameters of the ball, which every model has, in the order of the last columns of a kernel's row.
INERTIA = "inertia_ratio"
BALL_PARAMETERS = ("ball_mass", "ball_radius", INERTIA)
# Names of the models of `registry`, which no function of a user may have.
MODEL_NAMES = ("two-mass", "thesis-exact", "grip-slip", "brody")
# Names that no parameter of a function may have: parameters that are not of a model, derived
# quantities, and dimensions of files.
TAKEN_NAMES = (
    "scale",
    "clock",
    "tilt",
    "court_height",
    "row_delay",
    "degrees_of_freedom",
    "cor_median",
    "eps_median",
    "cor_slope_median",
    "eps_slope_median",
    "court_pace",
    "cor_254cm",
    "rebound_254cm",
    "chain",
    "draw",
    "ensemble",
)
