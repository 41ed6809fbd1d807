"""Every parameter that a model can have, in one table: unit, bounds, default prior and meaning. Beside it the names
of models, for help texts, which must not wait for kernels (`registry` describes each model).

Priors are written `NAME(numbers)` and truncated by the bounds; `inference.problem.parameters` reads them. They are
wide: a scene states narrower ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

DEFAULT_MODEL = "two-mass"
# Those that a comparison ranks, most complete first.
RANKED = ("two-mass", "thesis-exact", "grip-slip", "brody")
# Those whose `history` gives courses.
FOLLOWED = ("two-mass", "thesis-exact")


@dataclass(frozen=True)
class ParameterSpec:
    """A model parameter: `unit` (SI, empty when dimensionless), closed bounds, default prior, meaning (a comma
    after its first words, which are its short name).

    `label` is its symbol in figures and on pages (mathtext). `handy` is the unit of reports, with the factor from SI.
    `logarithmic`: its axis is so in every figure. `typical` is a round number near the fits to Wang's 21 impacts, the
    default of simulations. `open_above`: the model has no answer at the upper bound itself. `possible` is the
    physical range where that is wider than the bounds: a bound within it only ends a search.
    """

    name: str
    unit: str
    lower: float
    upper: float
    prior: str
    meaning: str
    label: str
    typical: float | None = None
    open_above: bool = False
    possible: tuple[float, float] | None = None
    handy: tuple[str, float] | None = None
    logarithmic: bool = False

    @property
    def beyond(self) -> tuple[float, float]:
        """Its physical range: the bounds, or more."""
        return self.possible or (self.lower, self.upper)


EVERYTHING, POSITIVE = (-math.inf, math.inf), (0.0, math.inf)
# Three lines a parameter: name, unit, bounds and prior; meaning and symbol; what else is known of it.
_ALL = (
    ParameterSpec("mass_ratio", "", 0.3, 1.0, "uniform(0.3, 1)",
        "relative core mass, over that of the ball", r"$M_1/M$", typical=0.87, open_above=True, possible=(0.0, 1.0)),
    ParameterSpec("k_y", "N/m", 1.0e2, 1.0e7, "lognormal(2.0e4, 1.0)",
        "vertical stiffness, between core and shell", r"$K_y$",
        typical=2.0e4, possible=POSITIVE, handy=("kN/m", 1e-3), logarithmic=True),
    ParameterSpec("k_theta", "N m/rad", 1.0e-2, 1.0e8, "lognormal(30, 1.5)",
        "torsional stiffness, between core and shell", r"$K_\theta$",
        typical=20.0, possible=POSITIVE, logarithmic=True),
    ParameterSpec("mu", "", 0.0, 5.0, "lognormal(0.6, 0.4)",
        "friction coefficient, of the ball sliding on the court", r"$\mu$", typical=0.56, possible=POSITIVE),
    ParameterSpec("eps_10", "m", -0.033, 0.033, "normal(0, 0.005)",
        "normal-force offset, ahead of the centre, at 10 m/s", r"$\varepsilon_{10}$",
        typical=2.4e-3, handy=("mm", 1e3)),
    ParameterSpec("eps_slope", "m/(m/s)", -0.01, 0.01, "normal(0, 0.001)",
        "slope of the offset, its change per m/s of vertical speed", r"$\varepsilon'$",
        typical=0.0, possible=EVERYTHING, handy=("mm/(m/s)", 1e3)),
    ParameterSpec("cor_10", "", 0.0, 1.0, "normal(0.75, 0.15)",
        "vertical restitution, the coefficient at 10 m/s", r"$\mathrm{COR}_{10}$", typical=0.776),
    ParameterSpec("cor_slope", "1/(m/s)", -0.1, 0.1, "normal(0, 0.02)",
        "slope of restitution, its change per m/s of vertical speed", r"$\mathrm{COR}'$",
        typical=-0.0158, possible=EVERYTHING, handy=("1e-3 s/m", 1e3)),
    ParameterSpec("zeta_theta", "", 0.0, 10.0, "lognormal(0.5, 1.0)",
        "torsional damping, its ratio during slip", r"$\zeta_\theta$",
        typical=0.5, possible=POSITIVE, logarithmic=True),
    ParameterSpec("inertia_split", "", 1.0e-6, 1.0 - 1.0e-6, "uniform(0.1, 0.98)",
        "relative core inertia, over that of the ball", r"$I_1/I$", typical=0.7),
    ParameterSpec("c_y", "N s/m", 0.0, 1.0e4, "lognormal(3, 1.0)",
        "vertical damping, between core and shell", r"$C_y$", possible=POSITIVE, logarithmic=True),
    ParameterSpec("e_x", "", -1.0, 1.0, "normal(0, 0.5)",
        "grip restitution, tangential coefficient of the contact point", r"$e_x$", typical=0.1),
    ParameterSpec("offset", "m", -0.033, 0.033, "normal(0, 0.005)",
        "normal-force offset, ahead of the centre", r"$\varepsilon$", handy=("mm", 1e3), typical=2.4e-3),
    ParameterSpec("ball_mass", "kg", 1.0e-6, 20.0, "normal(0.0576, 0.001)",
        "mass of the ball", r"$M$", possible=POSITIVE, handy=("g", 1e3)),
    ParameterSpec("ball_radius", "m", 1.0e-4, 0.5, "normal(0.03302, 0.0005)",
        "outer radius of the ball", r"$R$", possible=POSITIVE, handy=("mm", 1e3)),
    ParameterSpec("inertia_ratio", "", 0.05, 1.0, "normal(0.56, 0.015)",
        "relative inertia, of the ball over M R^2", r"$I/MR^2$", possible=POSITIVE),
)  # fmt: skip

SPECS: Mapping[str, ParameterSpec] = {spec.name: spec for spec in _ALL}
BALL_PARAMETERS = ("ball_mass", "ball_radius", "inertia_ratio")
BALL_SPECS: Mapping[str, ParameterSpec] = {name: SPECS[name] for name in BALL_PARAMETERS}


def specs(*names: str) -> tuple[ParameterSpec, ...]:
    """Those called `names`."""
    return tuple(SPECS[name] for name in names)
