"""Offsets of whole groups: a bias of one group's measurements shown as such instead of hidden in the noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.table import ImpactTable
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.pooling import levels_of
from fitball.models.specs import EVERYTHING, ParameterSpec
from fitball.values import FloatArray
from fitball.wording import in_formula, option

# A bias of twice the noise is expected: more would have been noticed by who measured.
EXPECTED = 2.0
# Angle [rad] that a velocity noise turns a rebound by, when it is asked for without knowing the rebound: per m/s.
ANGLE_OF_SPEED = 0.1


@dataclass(frozen=True)
class GroupBias:
    """An offset for each observable and each of `labels`; `index` (impacts,) says which label an impact has."""

    column: str
    labels: tuple[str, ...]
    index: NDArray[np.int64]

    def name(self, observable: str, label: str) -> str:
        """Name of the offset of an observable in a group."""
        return f"{observable}_offset[{label}]"

    def names(self, observables: Sequence[Observable]) -> set[str]:
        """Names of all offsets."""
        return {self.name(observable.name, label) for observable in observables for label in self.labels}

    def offset(self, columns: Mapping[str, FloatArray], observable: str) -> FloatArray:
        """Offset (draws, impacts) of an observable."""
        by_label = np.stack([columns[self.name(observable, label)] for label in self.labels], axis=1)
        return by_label[:, self.index]

    def take(self, rows: NDArray[np.int64]) -> GroupBias:
        """The same groups for some of the impacts."""
        return replace(self, index=self.index[rows])

    def specs(self, observables: Sequence[Observable], nominal: Mapping[str, float]) -> dict[str, ParameterSpec]:
        """What the offsets are, by name; `nominal` is the expected noise by noise parameter."""
        made = {}
        for observable in observables:
            column = observable.column.symbol.strip("$")
            size = EXPECTED * _expected_noise(observable, nominal)
            for label in self.labels:
                name = self.name(observable.name, label)
                made[name] = ParameterSpec(
                    name, observable.column.unit, -50.0 * size, 50.0 * size, f"normal(0, {size:.6g})",
                    f"how much more than the model {observable.name} is in group {label}",
                    rf"$\Delta_{{{column},{in_formula(label)}}}$", possible=EVERYTHING,
                )  # fmt: skip
        return made


def _expected_noise(observable: Observable, nominal: Mapping[str, float]) -> float:
    if observable.sd is not None:
        return float(np.median(observable.sd))
    size = nominal[str(observable.noise)]
    return ANGLE_OF_SPEED * size if observable.turned else size


def build_group_bias(table: ImpactTable, column: str) -> GroupBias:
    """Offsets over a label column. Raises what `levels_of` raises."""
    return GroupBias(column, *levels_of(table, column, option("offsets", column)))
