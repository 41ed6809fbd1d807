"""Parameters that differ between surfaces, balls or tables: partial pooling over the levels of a label.

The coordinate of the parameter (its logarithm for a log prior) at a level is that of the common value plus `spread`
times a standard normal number: the form without centre, whose prior stays a product (Papaspiliopoulos, Roberts and
Skoeld 2007). How far levels lie apart, `spread`, is itself fitted; so a level with few impacts leans on the others.

The prior of the spread is that of `spreads`. Beside these stand biases of whole groups, shown as such instead of
hidden in the noise.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from fitball.data.labels import Role, grouping
from fitball.data.table import ImpactTable
from fitball.errors import FitError, ParameterError, suggestion
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.parameters import Prior
from fitball.inference.problem.spreads import SpreadPrior, general_spread, kind_of, spread_prior
from fitball.models.model import Model
from fitball.models.specs import BALL_PARAMETERS, EVERYTHING, POSITIVE, ParameterSpec
from fitball.values import FloatArray
from fitball.wording import in_formula, option, spoken

# What is asked for instead of a column where a parameter is to be the same everywhere, and of all parameters at once.
NOT_POOLED, ALL = "none", "all"
# What asks for a surface or a ball of which nothing was measured.
NEW = "new"
# Fewer levels determine hardly how far others lie apart: what is said of another one then follows from the prior of
# the spread (Gelman 2006, *Bayesian Analysis* 1, 515: flat priors need five groups or more).
FEW_LEVELS = 5
# The largest spread that is looked for, over what is expected of levels of any kind.
WIDEST = 20.0


@dataclass(frozen=True)
class Levels:
    """A parameter over the `labels` of a `column`. `log` is whether its coordinate is the logarithm; `bounds` are
    those of the parameter, in SI.
    """

    parameter: str
    column: str
    labels: tuple[str, ...]
    log: bool
    bounds: tuple[float, float]

    @property
    def spread_name(self) -> str:
        """Name of the parameter for the spread between levels."""
        return f"{self.parameter}_spread"

    def place_name(self, label: str) -> str:
        """Name of the parameter for the place of a level, in spreads from the common value."""
        return f"{self.parameter}_place[{label}]"

    def level_name(self, label: str) -> str:
        """What the parameter at a level is called."""
        return f"{self.parameter}[{label}]"

    @property
    def hidden(self) -> tuple[str, ...]:
        """The parameters of the scatter between levels: spread and places."""
        return self.spread_name, *map(self.place_name, self.labels)

    def value(self, columns: Mapping[str, FloatArray], label: str) -> FloatArray:
        """The parameter (draws,) at a level, from the columns of all parameters."""
        return self.away(columns, columns[self.place_name(label)])

    def away(self, columns: Mapping[str, FloatArray], places: FloatArray) -> FloatArray:
        """The parameter (draws,) so many spreads away (draws,) from the common value."""
        shift: FloatArray = columns[self.spread_name] * places
        common = columns[self.parameter]
        return np.asarray(common * np.exp(shift) if self.log else common + shift)

    def elsewhere(self, columns: Mapping[str, FloatArray], chance: FloatArray) -> FloatArray:
        """The parameter (draws,) at levels of which nothing was measured, one for each number of `chance` (draws,)
        between 0 and 1. Their places are normal, as those of the fitted levels, between the bounds of the parameter.
        """
        common = columns[self.parameter]
        with np.errstate(divide="ignore", over="ignore"):
            ways = [np.log(end) - np.log(common) if self.log else end - common for end in self.bounds]
            low, high = (ndtr(way / np.maximum(columns[self.spread_name], np.finfo(float).tiny)) for way in ways)
        return self.away(columns, ndtri(low + (high - low) * chance))

    def outside(self, values: FloatArray) -> NDArray[np.bool_]:
        """Where values leave the bounds of the parameter."""
        return np.asarray((values < self.bounds[0]) | (values > self.bounds[1]))


@dataclass(frozen=True)
class Pooling(Levels):
    """Levels of the impacts of a table; `index` (impacts,) says which label an impact has."""

    index: NDArray[np.int64]

    @property
    def levels(self) -> Levels:
        """The levels alone."""
        return Levels(self.parameter, self.column, self.labels, self.log, self.bounds)

    def take(self, rows: NDArray[np.int64]) -> Pooling:
        """The same levels for some of the impacts."""
        return replace(self, index=self.index[rows])

    def spread_prior(self, prior: Prior, tennis: bool = True) -> SpreadPrior:
        """The prior of the spread by default, of `tennis` balls or others; `prior` is that of the parameter."""
        return spread_prior(self.parameter, kind_of(self.column), self.log, prior, tennis)

    def specs(self, unit: str, prior: Prior, tennis: bool = True) -> dict[str, ParameterSpec]:
        """What the additional parameters are, by name; see `spread_prior`."""
        most = WIDEST * general_spread(self.log, prior)
        made = {
            self.spread_name: ParameterSpec(
                self.spread_name, "" if self.log else unit, 0.0, most,
                self.spread_prior(prior, tennis).text,
                f"spread of {self.parameter}, between {self.column}s (one standard deviation"
                + (" of its logarithm)" if self.log else ")"),
                rf"$\tau_{{{in_formula(self.parameter)}}}$", possible=POSITIVE,
            )
        }  # fmt: skip
        for label in self.labels:
            name = self.place_name(label)
            made[name] = ParameterSpec(
                name, "", -8.0, 8.0, "normal(0, 1)",
                f"{self.parameter} of {self.column} {label}, in spreads from the common value",
                rf"$z_{{{in_formula(label)}}}$", possible=EVERYTHING,
            )  # fmt: skip
        return made


# What belongs to a surface, to a ball, to a place on a court. Stiffnesses only show where contacts were timed.
OWNED: Mapping[Role, tuple[str, ...]] = {
    Role.SURFACE: ("mu", "cor_10"),
    Role.PLACE: ("mu",),
    Role.BALL: ("cor_10", "offset", "eps_10"),
}
TIMED = {Role.BALL: ("k_y",)}


# Rows that two levels must have for a fit to each without being asked to. Places have one parameter each and belong
# to a test of three impacts a place. Two surfaces and two balls with four rows each have about as many parameters as
# measurements: such a table was not sampled within the default steps.
ENOUGH_ROWS = {Role.SURFACE: 5, Role.PLACE: 3, Role.BALL: 5}


def default_pool(
    table: ImpactTable,
    chosen: Model,
    fixed: Collection[str],
    asked: Collection[str],
    offsets: str | None,
    timed: bool,
) -> tuple[dict[str, str], list[str]]:
    """The parameters that are fitted to each surface, ball or place without being asked to, by label column; and
    notes on them.

    A parameter belongs to one column: to surfaces before places, and these before balls. Those that are `fixed`, or
    `asked` for otherwise, and the column of `offsets` are left alone. The balls of a drop test have an analysis of
    their own (see `prediction.drop_test`).
    """
    pool, notes = dict[str, str](), []
    for role in OWNED if chosen.tangential else ():
        for item in grouping(table):
            if item.role is not role or item.column == offsets:
                continue
            names = [
                name
                for name in (*OWNED[role], *(TIMED.get(role, ()) if timed else ()))
                if name in chosen.parameter_names and name not in {*fixed, *asked, *pool}
            ]
            if not names:
                continue
            head = f"{len(item.counts)} {item.noun} in column {item.column}"
            if item.has(ENOUGH_ROWS[role]):
                pool |= dict.fromkeys(names, item.column)
                none = spoken("--pool none", "pool='none'")
                notes.append(f"{head}: {', '.join(names)} fitted to each ({none}: one value for all)")
            else:
                each = spoken(f"--pool {names[0]}={item.column}", f"pool={{{names[0]!r}: {item.column!r}}}")
                notes.append(
                    f"{head}: fewer than two have {ENOUGH_ROWS[role]} rows, so one value is fitted to all "
                    f"({each} fits {names[0]} to each)"
                )
    return pool, notes


def levels_of(table: ImpactTable, column: str, asked_by: str) -> tuple[tuple[str, ...], NDArray[np.int64]]:
    """The distinct labels of a column, and which of them each impact has (impacts,).

    Raises FitError for a column that the table has not, naming those it has, and for one that holds one label only.
    """
    if column not in table.labels:
        known = ", ".join(table.labels) or "none"
        raise FitError(f"{asked_by}: {table.source} has no label column '{column}' (label columns: {known})")
    distinct = tuple(dict.fromkeys(table.labels[column]))
    if len(distinct) < 2:
        raise FitError(f"{asked_by}: column {column} of {table.source} holds one label only: {distinct[0]}")
    return distinct, np.array([distinct.index(label) for label in table.labels[column]], dtype=np.int64)


def build_pooling(
    table: ImpactTable, pool: Mapping[str, str], names: Sequence[str], priors: Mapping[str, Prior]
) -> tuple[Pooling, ...]:
    """Pooling for `pool` (parameter -> label column), in the order of `pool`.

    `names` are the parameters of the model, `priors` those of the pooled ones. Raises ParameterError for a parameter
    it has not, and what `levels_of` raises.
    """
    pooled = []
    for name, column in pool.items():
        asked = spoken(f"--pool {name}={column}", f"pool={{{name!r}: {column!r}}}")
        if name not in names or name in BALL_PARAMETERS:
            raise ParameterError(f"{asked}: unknown parameter '{name}' of the model: {suggestion(name, names)}")
        prior = priors[name]
        bounds = (prior.lower, prior.upper)
        labels, index = levels_of(table, column, asked)
        pooled.append(Pooling(name, column, labels, prior.log, bounds, index))
    return tuple(pooled)


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
        """Offset (draws, impacts) of an observable; none of a column that the fit did not measure."""
        if self.name(observable, self.labels[0]) not in columns:
            return np.zeros((1, self.index.size))
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
                    f"bias of {observable.name} in group {label}, measured less predicted",
                    rf"$\Delta_{{{column},{in_formula(label)}}}$", possible=EVERYTHING,
                )  # fmt: skip
        return made


def _expected_noise(observable: Observable, nominal: Mapping[str, float]) -> float:
    stated = 0.0 if observable.sd is None else float(np.median(observable.sd))
    if observable.noise is None:
        return stated
    size = nominal[observable.noise]
    return math.hypot(stated, ANGLE_OF_SPEED * size if observable.turned else size)


def build_group_bias(table: ImpactTable, column: str) -> GroupBias:
    """Offsets over a label column. Raises what `levels_of` raises."""
    return GroupBias(column, *levels_of(table, column, option("offsets", column)))
