"""Parameters before any data: what each is, and its prior.

Models, noises, the camera, spreads between levels and derived quantities all describe themselves by
`ParameterSpec`.
"""

import re
from dataclasses import dataclass

import numpy as np

from fitball.base.display_units import SI
from fitball.base.errors import ParameterError, suggestion
from fitball.base.numbers import Unit
from fitball.base.prior_families import FAMILIES, Prior

_WRITTEN = re.compile(r"\s*([A-Za-z-]+)\s*\(([^()]*)\)\s*")
# Least and largest size of a number in a prior: their squares are doubles still.
_SMALLEST = 1e-100
_LARGEST = 1e100
# The least share of a density that bounds must leave: with less, prior and bounds contradict each
# other.
_LEAST_MASS = 1e-6


@dataclass(frozen=True)
class ParameterSpec:
    """A parameter: SI `unit` (empty: dimensionless), closed bounds, default `prior` as text,
    `meaning` (a comma after its short name), `symbol` in mathtext; `typical` is the default of
    simulations, `display_unit` the unit that people read, by default `unit`; `logarithmic` its
    axes.
    """

    name: str
    unit: str
    lower: float
    upper: float
    prior: str
    meaning: str
    symbol: str
    typical: float | None = None
    display_unit: Unit = SI
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if self.display_unit is SI:
            object.__setattr__(self, "display_unit", Unit(self.unit))


def parse_prior(spec: ParameterSpec, text: str = "") -> Prior:
    """A prior as its family is written (see `FAMILIES`), truncated to the bounds of `spec`; without
    text the spec's.

    Raises:
        ParameterError: it cannot be read, or the bounds leave less than a millionth of it
            (`prior`).
    """
    prior = _within_bounds(spec, text)
    if not prior.lower < prior.upper or not prior.share > _LEAST_MASS:
        bounds = f"{spec.lower:g} to {spec.upper:g} {spec.unit}".rstrip()
        words = (
            f"prior of {spec.name}: read '{prior.text}'; the bounds {bounds} leave nothing of it; "
            "change the prior"
        )
        raise ParameterError(words, "prior")
    return prior


def usual_value(spec: ParameterSpec) -> float:
    """The value [SI] at the location of a specification's own prior. It needs no share of the
    density, and so not SciPy, whose import takes a fifth of the time of a check.
    """
    prior = _within_bounds(spec, "")
    return float(prior.value(np.array(prior.location)))


def _within_bounds(spec: ParameterSpec, text: str) -> Prior:
    """The prior of a `text`, or of the `spec`, within the bounds of this."""
    text = (text or spec.prior).strip()
    family, numbers = _read(spec.name, text)
    return family.within(text, numbers, spec.lower, spec.upper)


def _read(name: str, text: str) -> tuple[type[Prior], tuple[float, ...]]:
    """Family and numbers of a prior. Raises ParameterError for those that the family cannot
    have.
    """

    def fault(wanted: str) -> ParameterError:
        return ParameterError(f"prior of {name}: read '{text}'; {wanted}", "prior")

    written = _WRITTEN.fullmatch(text)
    if written is None:
        raise fault("expected a form such as normal(0.55, 0.05)")
    family = FAMILIES.get(written[1].lower())
    if family is None:
        hint = suggestion(written[1].lower(), FAMILIES)
        raise fault(f"unknown family '{written[1]}', {hint}")
    try:
        numbers = tuple(float(number) for number in written[2].split(","))
    except ValueError:
        numbers = ()
    sizes = [abs(number) for number in numbers]
    good = all(size <= _LARGEST and not 0.0 < size < _SMALLEST for size in sizes)
    if len(numbers) != family.form.count(",") + 1 or not good:
        raise fault(f"expected {family.form}, numbers of {_SMALLEST:g} to {_LARGEST:g} in size")
    if wanted := family.fault(numbers):
        raise fault(f"expected {family.form} {wanted}")
    return family, numbers
