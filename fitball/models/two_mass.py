"""The two-mass ball: its parameters, and the flags of its kernel, for each choice of options."""

from collections.abc import Mapping
from typing import ClassVar

from fitball.base.values import Ball
from fitball.models.kernels.batch import bounces
from fitball.models.kernels.contact import FLAG_CHOICES, TWO_MASS_COLUMNS
from fitball.models.kernels.phases import bounce
from fitball.models.model import KernelSolver, Model
from fitball.models.specs import BALL_PARAMETERS, SPECS

# Options of each choice, in the order of a kernel's flags.
CHOICES: Mapping[str, tuple[str, ...]] = dict(FLAG_CHOICES)
# Values of columns without a parameter, where not zero: in a drop core and shell have any inertia.
ABSENT_VALUES = {"inertia_split": 0.5}
# Options without motion along the court: a drop has no twist, whose damping could not be matched.
DROP_OPTIONS = {"torsion": "free", "inertia": "table"}


class TwoMass(KernelSolver):
    """Rebounds of the two-mass ball under its choices, by the kernels of `phases`."""

    entry = staticmethod(bounce)
    batch = staticmethod(bounces)
    columns: ClassVar[tuple[str, ...]] = TWO_MASS_COLUMNS


def _parameters(options: Mapping[str, str], tangential: bool) -> tuple[str, ...]:
    """Names of the parameters of a composition; without motion along the court (not `tangential`)
    those of the vertical motion only.

    The mass ratio acts on the vertical motion unless the whole mass rides the spring, and on the
    spin where it sets the inertia of the core.
    """
    tied = tangential and options["inertia"] == "tied"
    acts = {
        "mass_ratio": options["normal"] != "total" or tied,
        "k_y": True,
        "k_theta": tangential,
        "mu": tangential,
        "eps_10": tangential,
        "eps_slope": tangential,
        "cor_10": True,
        "cor_slope": options["cor"] != "root",
        "zeta_theta": tangential and options["torsion"] == "free",
        "inertia_split": tangential and options["inertia"] == "table",
    }
    return tuple(name for name in acts if acts[name])


def compose(
    name: str,
    text: str,
    ball: Ball,
    tangential: bool,
    options: Mapping[str, str],
) -> Model:
    """The two-mass model under `options`, which has one option of each choice.

    The ball moves along the court too if `tangential`. `name` and `text` are those of the model.
    """
    used = options if tangential else {**options, **DROP_OPTIONS}
    flags = (
        CHOICES["normal"].index(used["normal"]),
        CHOICES["offset"].index(used["offset"]),
        CHOICES["torsion"].index(used["torsion"]),
        CHOICES["inertia"].index(used["inertia"]),
        CHOICES["spin"].index(used["spin"]),
        CHOICES["release"].index(used["release"]),
        CHOICES["cor"].index(used["cor"]),
    )
    columns = TWO_MASS_COLUMNS[: -len(BALL_PARAMETERS)]
    solver = TwoMass(flags, tuple(ABSENT_VALUES.get(column, 0.0) for column in columns))
    specs = tuple(SPECS[parameter] for parameter in _parameters(options, tangential))
    below = (("cor_10", "mass_ratio"),) if options["normal"] == "momentum" else ()
    return Model(name, text, ball, options, specs, solver, tangential, timed=True, below=below)
