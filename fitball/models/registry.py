"""The ladder of models by name, and `model`, which composes one.

A new model is one entry of `MODELS`, with what has to be known before it is composed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

from fitball.errors import ModelError, suggestion
from fitball.kinds import checked
from fitball.models.impulse import BRODY, GRIP_SLIP, VERTICAL, GripSlipModel
from fitball.models.model import Model
from fitball.models.own import NAMED, compose_own, is_own, own_spec
from fitball.models.specs import DEFAULT_MODEL, SPECS, ParameterSpec
from fitball.models.thesis import compose_thesis
from fitball.models.two_mass import compose_two_mass
from fitball.models.types import Closures, ImpulseClosures, ThesisClosures, options_of
from fitball.values import Ball

_Chosen = Closures | ThesisClosures | ImpulseClosures


@dataclass(frozen=True)
class Reduced:
    """A model on a table that does not show all of it. `closures` are those it has there by default, `candidates`
    those that a comparison tries of it by default, as names with closures.
    """

    closures: Mapping[str, str] = field(default_factory=dict)
    candidates: tuple[str, ...] = ()


@dataclass(frozen=True)
class Entry:
    """How a model is composed, from its name, ball, whether there is motion along the court, and its closures. These
    are `closures` with some replaced (None: it has none).

    `candidates` are what a comparison tries of it by default, `variants` what it adds unless it is to be quick.
    `spinless` and `vertical` are the model on a table without spin, and without any motion along the court; None
    where it cannot be fitted to such a table.
    """

    compose: Callable[[str, Ball, bool, Any], Model]
    closures: _Chosen | None = None
    candidates: tuple[str, ...] = ()
    variants: tuple[str, ...] = ()
    spinless: Reduced | None = Reduced()
    vertical: Reduced | None = Reduced()


# Without spin shell and core turn as one, and without motion along the court the mass ratio acts nowhere.
_RIGID = {"torsion": "rigid", "normal": "total"}
_TOTAL = {"normal": "total"}

# Most complete first; a comparison begins with the last.
MODELS: dict[str, Entry] = {
    "two-mass": Entry(
        compose_two_mass,
        Closures("zero_force", "momentum", "contact", "mean", "tied", "matched", "line"),
        candidates=("two-mass",),
        # One closure changed at a time. `normal = inner` is left to those who name it, because it breaks the momentum
        # balance of the ball; `cor = measured`, because it takes as an input a column that the others predict.
        variants=(
            "two-mass+release=zero_displacement",
            "two-mass+normal=total",
            "two-mass+offset=grip",
            "two-mass+spin=shell",
            "two-mass+inertia=table",
            "two-mass+torsion=free",
            "two-mass+torsion=rigid",
            "two-mass+cor=mean",
        ),
        spinless=Reduced(_RIGID, ("two-mass+cor=mean",)),
        vertical=Reduced(_TOTAL, ("two-mass", "two-mass+cor=mean")),
    ),
    "thesis-exact": Entry(
        compose_two_mass,
        Closures("zero_displacement", "inner", "grip", "shell", "tied", "matched", "line"),
        candidates=("thesis-exact",),
        spinless=Reduced(_RIGID),
        vertical=Reduced(_TOTAL),
    ),
    "grip-slip": Entry(
        GripSlipModel.composer(GRIP_SLIP, VERTICAL),
        ImpulseClosures("line"),
        candidates=("grip-slip",),
        spinless=Reduced(candidates=("grip-slip",)),
    ),
    "brody": Entry(
        GripSlipModel.composer(BRODY, VERTICAL),
        ImpulseClosures("line"),
        candidates=("brody",),
        spinless=Reduced(candidates=("brody",)),
    ),
    "thesis": Entry(compose_thesis, ThesisClosures("chapter_five", "tied", "line"), spinless=None, vertical=None),
}


def entry(name: str, options: Mapping[str, str] = MappingProxyType({})) -> Entry:
    """The entry of the model called `name`; a function of one's own is known by its `options` too. Raises ModelError
    for an unknown one.
    """
    if name not in MODELS and is_own(name, options):
        return Entry(lambda name, ball, tangential, _closures: compose_own(name, ball, tangential, options))
    if name not in MODELS:
        raise ModelError(f"unknown model '{name}': {suggestion(name, MODELS)}")
    return MODELS[name]


@checked
def model(name: str = DEFAULT_MODEL, *, ball: Ball | None = None, tangential: bool = True, **closures: str) -> Model:
    """Compose the model called `name`, with any closure replaced by keyword (`normal="total"`).

    `ball` defaults to Wang's. `tangential=False` keeps the vertical motion only, for drop tests. Raises ModelError
    for an unknown name, closure or option.

    >>> fitball.model("grip-slip").parameter_names
    ('mu', 'e_x', 'offset', 'cor_10', 'cor_slope')
    """
    chosen = entry(name, closures)
    if chosen.closures is None and closures and name in MODELS:
        raise ModelError(f"model {name} has no model variants (closures): read {', '.join(sorted(closures))}")
    composed = chosen.closures and _changed(chosen.closures, closures)
    return chosen.compose(name, ball if ball is not None else Ball(), tangential, composed)


def closure_options(name: str) -> dict[str, tuple[str, ...]]:
    """The options of each closure of the model called `name`; empty where it has none."""
    closures = entry(name).closures
    return {} if closures is None else options_of(type(closures))


def parameter_spec(name: str) -> ParameterSpec | None:
    """The specification of a parameter of any model, or of its ball; None for an unknown name."""
    own = (spec for other in MODELS for spec in model(other).parameters if spec.name == name)
    return SPECS.get(name) or next(own, None) or (own_spec(name) if name in NAMED else None)


def _changed(base: _Chosen, chosen: Mapping[str, str]) -> _Chosen:
    known = [closure.name for closure in fields(base)]
    for closure in chosen:
        if closure not in known:
            raise ModelError(f"unknown closure '{closure}': {suggestion(closure, known)}")
    return replace(base, **chosen)  # type: ignore[arg-type]
