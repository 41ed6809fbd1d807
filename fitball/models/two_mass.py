"""The two-mass ball: rows and flags of a composition, batches over threads."""

from collections.abc import Mapping
from typing import ClassVar

from fitball.base.values import Ball
from fitball.models.kernels.batch import bounces
from fitball.models.kernels.contact import CHOICES as FLAGS
from fitball.models.kernels.contact import COLUMNS
from fitball.models.kernels.phases import bounce
from fitball.models.model import KernelSolver, Model
from fitball.models.specs import SPECS

CHOICES: Mapping[str, tuple[str, ...]] = dict(FLAGS)
# What a column without a parameter holds, where not zero: in a drop core and shell have any
# inertia.
ABSENT = {"inertia_split": 0.5}
# A drop has no twist, whose damping could not be matched.
DROP = {"torsion": "free", "inertia": "table"}


class TwoMass(KernelSolver):
    """The two-mass ball under its choices."""

    entry = staticmethod(bounce)
    batch = staticmethod(bounces)
    columns: ClassVar[tuple[str, ...]] = COLUMNS


def _parameters(options: Mapping[str, str], tangential: bool) -> tuple[str, ...]:
    """Names of the parameters of a composition, without motion along the court only the vertical
    ones.

    The mass ratio acts on the vertical motion unless the whole mass rides the spring, and on the
    spin where it sets the inertia of the core.
    """
    heavy = options["normal"] != "total" or (tangential and options["inertia"] == "tied")
    wanted = {
        "mass_ratio": heavy,
        "k_y": True,
        "k_theta": tangential,
        "mu": tangential,
        "eps_10": tangential,
        "eps_slope": tangential,
        "cor_10": True,
        "cor_slope": True,
        "zeta_theta": tangential and options["torsion"] == "free",
        "inertia_split": tangential and options["inertia"] == "table",
    }
    return tuple(name for name, present in wanted.items() if present)


def compose(
    name: str,
    text: str,
    ball: Ball,
    tangential: bool,
    options: Mapping[str, str],
) -> Model:
    """The model of a composition with its parameters."""
    used = options if tangential else {**options, **DROP}
    normal, offset, torsion, inertia, spin, release = (
        values.index(used[key]) for key, values in CHOICES.items()
    )
    flags = (normal, offset, torsion, inertia, spin, release)
    solver = TwoMass(flags, tuple(ABSENT.get(column, 0.0) for column in COLUMNS[:-3]))
    specs = tuple(SPECS[own] for own in _parameters(options, tangential))
    below = (("cor_10", "mass_ratio"),) if options["normal"] == "momentum" else ()
    return Model(name, text, ball, options, specs, solver, tangential, timed=True, below=below)
