"""Quantities that a user derives by expressions of others, each at every level that names in it
have.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Self

from fitball.base.display_units import SI
from fitball.base.errors import ParameterError
from fitball.base.numbers import Unit
from fitball.base.priors import ParameterSpec
from fitball.base.values import FloatArray
from fitball.inference.derived import (
    Labels,
    Quantity,
    derived_spec,
    measured_labels,
    spec_at_labels,
)
from fitball.inference.expressions import Expression, dimensions_of, expression, refusal
from fitball.inference.forward import CalibratedRange, ForwardModel, Values


@dataclass(frozen=True)
class Known:
    """What formulas may name: parameters and what is `following` from them, with their `specs`, and
    names without a label, such as `mu`, of what has a value at each level: `leveled` has the full
    names of each by its labels.
    """

    forward: ForwardModel
    calibrated: CalibratedRange
    specs: Mapping[str, ParameterSpec]
    following: Mapping[str, Quantity]
    leveled: Mapping[str, Mapping[Labels, str]]

    @classmethod
    def of(
        cls,
        forward: ForwardModel,
        calibrated: CalibratedRange,
        specs: Mapping[str, ParameterSpec],
        following: Sequence[Quantity],
    ) -> Self:
        """All names of parameters with these `specs`, and of quantities `following` from them."""
        of_all = {**specs, **{quantity.spec.name: quantity.spec for quantity in following}}
        leveled = dict[str, dict[Labels, str]]()
        for level in forward.levels:
            leveled[level.parameter] = {
                ((level.column, label),): level.name(label) for label in level.labels
            }
        for quantity in following:
            if quantity.labels:
                at_labels = leveled.setdefault(quantity.base, {})
                at_labels[quantity.labels] = quantity.spec.name
        by_name = {quantity.spec.name: quantity for quantity in following}
        return cls(forward, calibrated, of_all, by_name, leveled)

    def places(self, names: Sequence[str]) -> Iterator[tuple[Labels, Mapping[str, str]]]:
        """Labels of each measured combination of levels that `names` without a label have, with the
        full name that each of `names` has there. There is one without labels if none needs them.
        """
        without_label = [self.leveled[name] for name in names if name in self.leveled]
        columns = {column for each in without_label for labels in each for column, _ in labels}
        for labels, _ in measured_labels(self.forward, self.calibrated, columns):
            yield labels, {name: self._full_name(name, labels) for name in names}

    def _full_name(self, name: str, labels: Labels) -> str:
        """The name, with those of the labels that it has a value for."""
        for own, full in self.leveled.get(name, {}).items():
            if {*own} <= {*labels}:
                return full
        return name


def written(
    derive: Mapping[str, str],
    known: Known,
    skip_unknown: bool,
) -> tuple[Quantity, ...]:
    """The quantities that a user derives by expressions of `known` names; `skip_unknown` leaves out
    those with names that are not among them.

    Raises:
        ParameterError: an expression is none, or its name has been given (`derive`), or it has an
            unknown name (`unknown-parameter`).
    """
    found = dict[str, Quantity]()
    for name, text in derive.items():
        try:
            quantities = [*_written(name, text, known)]
        except ParameterError as error:
            if not (skip_unknown and error.code == "unknown-parameter"):
                raise
            continue
        for quantity in quantities:
            full = quantity.spec.name
            if full in known.specs or full in found:
                raise refusal(name, text, f"the name '{full}'; expected a new one")
            found[full] = quantity
    return tuple(found.values())


def _written(name: str, text: str, known: Known) -> Iterator[Quantity]:
    """The quantities of one formula, one at each level that it has. Raises ParameterError."""
    if not name or name in known.specs or name in known.leveled:
        raise refusal(name, text, f"the name '{name}'; expected a new one")
    formula = expression(name, text, [*known.specs, *known.leveled])
    for labels, full_names in known.places(formula.used):
        specs = {used: known.specs[full] for used, full in full_names.items()}
        unit = formula.unit({used: spec.unit for used, spec in specs.items()})
        spec = derived_spec(name, unit, text, "", _shown_in(unit, specs.values()))
        following = {
            used: known.following[full]
            for used, full in full_names.items()
            if full in known.following
        }
        yield Quantity(
            spec_at_labels(spec, labels),
            partial(_values, formula, full_names, following),
            any(quantity.extrapolated for quantity in following.values()),
            name,
            labels,
            tuple(dict.fromkeys(full_names.values())),
        )


def _shown_in(unit: str, specs: Iterable[ParameterSpec]) -> Unit:
    """The unit in which people read a quantity in this SI unit that is made of such `specs`: that
    of the first of the same dimensions, else the SI unit itself.
    """
    dimensions = dimensions_of(unit)
    alike = (spec.display_unit for spec in specs if dimensions_of(spec.unit) == dimensions)
    return next(alike, SI) if dimensions else SI


def _values(
    formula: Expression,
    full_names: Mapping[str, str],
    following: Mapping[str, Quantity],
    of_parameters: Values,
) -> FloatArray:
    """The draws (draws,) of a formula by those of parameters, with names in it by `full_names`, of
    which some are `following` from parameters.
    """
    of_names = {}
    for used, full in full_names.items():
        if used in following:
            of_names[used] = following[used].rule(of_parameters)
        else:
            of_names[used] = of_parameters[full]
    return formula.values(of_names)
