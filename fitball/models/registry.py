"""The ladder of models by name, and `model`, which composes one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, fields, replace

from fitball.errors import ModelError, suggestion
from fitball.models.grip_slip import BRODY_PARAMETERS, GRIP_SLIP_PARAMETERS, GripSlipModel
from fitball.models.model import Model
from fitball.models.specs import SPECS
from fitball.models.thesis.model import ThesisModel, thesis_parameters
from fitball.models.two_mass_model import TwoMassModel, two_mass_parameters
from fitball.models.types import Closures, ThesisClosures
from fitball.values import Ball

COMPOSITIONS: Mapping[str, Closures] = {
    "two-mass": Closures("zero_force", "momentum", "contact", "mean", "tied", "matched", "line"),
    "thesis-exact": Closures("zero_displacement", "inner", "grip", "shell", "tied", "matched", "line"),
}
ALGEBRAIC: Mapping[str, tuple[str, ...]] = {"grip-slip": GRIP_SLIP_PARAMETERS, "brody": BRODY_PARAMETERS}
THESIS = "thesis"
THESIS_CLOSURES = ThesisClosures("chapter_five", "tied", "line")
MODEL_NAMES = (*COMPOSITIONS, *ALGEBRAIC, THESIS)
DEFAULT_MODEL = "two-mass"


def model(name: str = DEFAULT_MODEL, *, ball: Ball | None = None, tangential: bool = True, **closures: str) -> Model:
    """Compose the model called `name`, with any closure replaced by keyword (`normal="total"`).

    `ball` defaults to Wang's. `tangential=False` keeps the vertical motion only, for drop tests; algebraic
    models have no such reduction and ignore it. Raises ModelError for an unknown name, closure or option.
    """
    chosen = ball if ball is not None else Ball()
    if name in ALGEBRAIC:
        if closures:
            raise ModelError(f"model {name} has no closures, so {', '.join(sorted(closures))} cannot be chosen")
        names = ALGEBRAIC[name] if tangential else ("cor_10", "cor_slope")
        return GripSlipModel(name, chosen, {}, tuple(SPECS[item] for item in names))
    if name == THESIS:
        _check_names(ThesisClosures, closures)
        mine = replace(THESIS_CLOSURES, **closures)  # type: ignore[arg-type]
        specs = tuple(SPECS[item] for item in thesis_parameters(mine))
        return ThesisModel(name, chosen, asdict(mine), specs, closures=mine)
    if name not in COMPOSITIONS:
        raise ModelError(f"unknown model '{name}': {suggestion(name, MODEL_NAMES)}")
    _check_names(Closures, closures)
    composed = replace(COMPOSITIONS[name], **closures)  # type: ignore[arg-type]
    parameters = tuple(SPECS[item] for item in two_mass_parameters(composed, tangential))
    return TwoMassModel(name, chosen, asdict(composed), parameters, closures=composed, tangential=tangential)


def _check_names(kind: type[Closures | ThesisClosures], chosen: Mapping[str, str]) -> None:
    known = [item.name for item in fields(kind)]
    for closure in chosen:
        if closure not in known:
            raise ModelError(f"unknown closure '{closure}': {suggestion(closure, known)}")
