"""Measured columns as the likelihood sees them: what a model predicts for each, and with which noise, its own or one
that the columns of the velocity share.

The two components of the velocity are seldom measured equally well: a lens, a shutter, the line of sight of a radar
act on one of them. So each column gets a noise of its own, unless the table is too short to distinguish two. The
ratio of two sds that are fitted with `nu` degrees of freedom each scatters about the true ratio as the root of
Fisher's F(nu, nu). Its 95 % interval reaches a factor `sqrt(F_0.975(nu, nu))` to either side: 2.7 for `nu` = 5, just
under `FACTOR` = 2 for `nu` = `FREEDOM` = 10. With fewer, equal noises come out twice as large as each other by mere
chance, and one noise for all, known from twice the numbers, is the better guess. Of the rows of a column the
parameters spend some: the eight of the default model act on three columns, about `SPENT` = 3 on each; offsets of
groups spend one more for each group.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.errors import ParameterError, suggestion
from fitball.inference.problem.noise import Sizes
from fitball.inference.problem.parameters import SD_SPECS
from fitball.models.model import Model
from fitball.models.specs import ParameterSpec
from fitball.models.types import Rebound
from fitball.observables import NOISE_OF, OBSERVABLES, SHARED_SD, VELOCITIES, ReboundColumn
from fitball.values import FloatArray
from fitball.wording import option


@dataclass(frozen=True)
class Observable:
    """One measured column: `observed` (impacts,), its stated `sd` (impacts,), and the `noise` parameter it uses: all
    of its noise where no sd is stated, else what measurements scatter by beyond that.

    With `rows` only those impacts of the problem have a measurement here, and (impacts,) means (rows,). It is None
    where all have: this is the one place where it is known which measurements are missing, and residuals, densities
    and derivatives are formed of those that are there.
    """

    name: str
    observed: FloatArray
    sd: FloatArray | None
    noise: str | None
    rows: NDArray[np.int64] | None = None

    @property
    def column(self) -> ReboundColumn:
        """What is true of this column in every table."""
        return OBSERVABLES[self.name]

    def predict(self, rebound: Rebound) -> FloatArray:
        """The prediction of the model, (draws, impacts) or (impacts,)."""
        return self._mine(self.column.predict(rebound))

    @property
    def turned(self) -> bool:
        """Whether this is an angle with the noise of a velocity component: that noise over the rebound speed."""
        return self.column.angle and self.noise == SHARED_SD

    @property
    def scatters(self) -> bool:
        """Whether a noise parameter adds to the stated sd."""
        return self.sd is not None and self.noise is not None

    def known(self, names: Collection[str]) -> bool:
        """Whether the noise of this column is stated, or among the parameters `names`."""
        return self.sd is not None or self.noise in names

    def scatter(self, noise: FloatArray | float, rebound: Rebound) -> FloatArray:
        """Standard deviation beside the stated one, broadcastable to (draws, impacts); `noise` is (draws, 1) or a
        number.
        """
        if self.turned:
            return noise / self._mine(np.hypot(rebound.v_x2, rebound.v_y2))
        return np.asarray(noise, dtype=np.float64)

    def sds(self, sizes: Sizes, rebound: Rebound) -> FloatArray:
        """Standard deviation, broadcastable to (draws, impacts), for the noise parameters among `sizes`: stated error
        and scatter are independent.
        """
        if self.sd is not None and self.noise is None:
            return self.sd
        own = self.scatter(0.0 if self.noise is None else np.asarray(sizes[self.noise])[..., None], rebound)
        return own if self.sd is None else np.hypot(self.sd, own)

    def scattered(self, sizes: Sizes, rebound: Rebound) -> FloatArray:
        """The share of the variance that is not stated, broadcastable to (draws, impacts): the derivative of the
        logarithm of `sds` with respect to that of the noise.
        """
        if self.sd is None:
            return np.ones(())
        if self.noise is None:
            return np.zeros(())
        own = self.scatter(np.asarray(sizes[self.noise])[..., None], rebound) ** 2
        return np.asarray(own / (self.sd**2 + own))

    def at(self, entries: NDArray[np.int64]) -> Observable:
        """The column with some of its entries alone; `rows` are still their impacts in the problem."""
        sd = None if self.sd is None else self.sd[entries]
        rows = entries if self.rows is None else self.rows[entries]
        return replace(self, observed=self.observed[entries], sd=sd, rows=rows)

    def everywhere(self, impacts: int) -> Observable:
        """The column over all impacts of the problem, `observed` and stated `sd` NaN where nothing was measured."""
        if self.rows is None:
            return self
        sd = None if self.sd is None else self.spread_out(self.sd, impacts, np.nan)
        return replace(self, observed=self.spread_out(self.observed, impacts, np.nan), sd=sd, rows=None)

    def places(self, impacts: int) -> NDArray[np.int64]:
        """Which impacts of the problem have a measurement, (measurements,)."""
        return np.arange(impacts) if self.rows is None else self.rows

    def count(self, impacts: int) -> int:
        """How many of the problem's impacts have a measurement."""
        return impacts if self.rows is None else int(self.rows.size)

    def spread_out(self, array: FloatArray, impacts: int, absent: float) -> FloatArray:
        """Numbers (..., measurements) over all impacts of the problem (..., impacts)."""
        if self.rows is None:
            return array
        whole = np.full((*array.shape[:-1], impacts), absent)
        whole[..., self.rows] = array
        return whole

    def _mine(self, array: FloatArray) -> FloatArray:
        return array if self.rows is None else array[..., self.rows]


def build_observables(
    table: ImpactTable, tangential: bool, chosen: Model, noise_of: Mapping[str, str]
) -> tuple[tuple[Observable, ...], list[str]]:
    """Observables the model can answer for, and a sentence for each column it cannot.

    `noise_of` names the noise parameter of each column that has one.
    """
    observables, notes = [], []
    for measurement in table.measurements:
        column = OBSERVABLES[measurement.name]
        if column.tangential and not tangential:
            notes.append(f"{measurement.name} is not used: without v_x1 only the vertical motion is fitted")
        elif not chosen.gives(column):
            why = "does not follow the ball between its flights" if chosen.has_time else "has no time axis"
            notes.append(f"{measurement.name} is not used: this model {why}")
        elif column.restitution and chosen.needs_cor:
            notes.append(f"{measurement.name} is not scored: the measured coefficient of restitution is an input")
        else:
            whole = Observable(measurement.name, measurement.values, measurement.sd, noise_of.get(measurement.name))
            observables.append(whole if measurement.complete else whole.at(np.flatnonzero(measurement.measured)))
    return tuple(observables), notes


TIED, SEPARATE, STATED = "tied", "separate", "stated"
FACTOR, FREEDOM, SPENT = 2.0, 10, 3
# The directions of v_x2 and v_y2 among the components of the velocity.
COMPONENTS = {"v_x2": np.array([1.0, 0.0]), "v_y2": np.array([0.0, 1.0])}


def noise_by_column(
    table: ImpactTable, wanted: str | None, named: Collection[str], groups: int, notes: list[str]
) -> Mapping[str, str]:
    """The noise parameter of each column: what is `wanted` ("tied" or "separate"), else what is `named` (noise
    parameters of which a value or a prior is given), else as many as the rows can distinguish. Columns share one
    only if none, or each, of them states an sd; of both kinds in a table, those that state one have their own. With
    "stated" these have none.

    `groups` is how many biases are fitted to each column. A noise of velocities that is shared for want of rows, or
    because it is named, is in `notes`. Raises ParameterError where `wanted` is unknown or contradicts `named`.
    """
    if wanted not in (None, TIED, SEPARATE, STATED):
        raise ParameterError(f"unknown velocity noise '{wanted}': {suggestion(wanted, (TIED, SEPARATE, STATED))}")
    stated = {measurement.name for measurement in table.measurements if measurement.sd is not None}
    if wanted == STATED and not stated:
        raise ParameterError(
            f"{option('noise', STATED)}: {table.source} states no sd of a rebound column. State one, such as "
            "v_x2_sd, or fit the noise"
        )
    rows = {
        measurement.name: int(measurement.measured.sum())
        for measurement in table.measurements
        if measurement.name in VELOCITIES and (table.has_tangential or not OBSERVABLES[measurement.name].tangential)
    }
    if wanted == STATED or not rows.keys() <= stated:
        rows = {name: count for name, count in rows.items() if name not in stated}
    columns, least = list(rows), min(rows.values(), default=0)
    own = [NOISE_OF[name] for name in columns if NOISE_OF[name] in named]
    if wanted == TIED and own:
        raise ParameterError(
            f"{option('noise', TIED)} with a value or prior of {' and '.join(own)}: expected {SHARED_SD} there, or "
            f"{option('noise', SEPARATE)}"
        )
    each = " and ".join(NOISE_OF[name] for name in columns)
    if wanted == SEPARATE and SHARED_SD in named and columns:
        raise ParameterError(
            f"{option('noise', SEPARATE)} with a value or prior of {SHARED_SD}, which all columns of the velocity "
            f"share: expected {each} there, or {option('noise', TIED)}"
        )
    enough = FREEDOM + SPENT + groups
    shared = wanted == TIED or SHARED_SD in named
    if not (shared or own or wanted == SEPARATE):
        shared = len(columns) < 2 or least < enough
    rest = [name for name in columns if NOISE_OF[name] not in own]
    if shared and wanted in (None, STATED) and len(rest) > 1:
        why = (
            "a value or prior of it is given"
            if SHARED_SD in named
            else f"{least} row{'s' * (least != 1)} cannot distinguish two that differ by a factor of {FACTOR:g}, "
            f"{enough} could (noise '{SEPARATE}' fits {each} anyway)"
        )
        notes.append(f"{' and '.join(rest)} share one noise, {SHARED_SD}: {why}")
    chosen = dict(NOISE_OF)
    if shared:
        chosen |= dict.fromkeys(rest, SHARED_SD)
    return {name: noise for name, noise in chosen.items() if wanted != STATED or name not in stated}


def noise_in(names: Collection[str]) -> Mapping[str, str]:
    """The noise parameter of each column in a fit with parameters `names`."""
    return {
        column: SHARED_SD if own not in names and SHARED_SD in names and column in VELOCITIES else own
        for column, own in NOISE_OF.items()
    }


def named_noise(scene: Scene, *given: Mapping[str, object]) -> set[str]:
    """Noise parameters that the scene states, or of which a value or prior is `given`."""
    known = {name for name in SD_SPECS if getattr(scene, name) is not None}
    return known | (SD_SPECS.keys() & {name for values in given for name in values})


def expected_sizes(scene: Scene, table: ImpactTable) -> Mapping[str, float]:
    """The size of each noise that is expected before a measurement, in SI: what the scene expects, its typical size
    where that expects nothing; an angle is turned by the noise of a velocity at the median incident speed.
    """
    speed = float(np.median(table.impacts.speed))
    by_unit = {
        "m/s": scene.nominal_velocity_sd,
        "rad": float(f"{np.arctan2(scene.nominal_velocity_sd, speed):.2g}"),
        "rad/s": scene.nominal_spin_sd,
    }
    own = {
        column.noise.name: by_unit.get(column.unit, float(column.noise.typical)) for column in OBSERVABLES.values()
    }
    return {SHARED_SD: scene.nominal_velocity_sd, **own}


def noise_parameters(
    observables: Sequence[Observable],
    table: ImpactTable,
    scene: Scene,
    priors: dict[str, str],
    fixed: dict[str, tuple[float, str]],
) -> tuple[str, ...]:
    """Noise parameters the observables use; a sd known to the scene fixes one, an expected one centres its prior."""
    used = tuple(dict.fromkeys(observable.noise for observable in observables if observable.noise is not None))
    scatters = beyond_stated(observables)
    for name in used:
        value = getattr(scene, name)
        if value is not None:
            fixed[name] = (value, "stated in the scene")
        else:
            priors[name] = expected_prior(name, scene, table, name in scatters)
    return used


def beyond_stated(observables: Sequence[Observable]) -> dict[str, tuple[str, ...]]:
    """The noise parameters that add to stated sds, and the columns that have them."""
    names = dict.fromkeys(str(item.noise) for item in observables if item.scatters)
    return {name: tuple(item.name for item in observables if item.noise == name) for name in names}


# Degrees of freedom of the half-t prior of a scatter beyond stated errors, which may vanish.
SCATTER_FREEDOM = 4


def expected_prior(name: str, scene: Scene, table: ImpactTable, scatter: bool) -> str:
    """The prior of a noise parameter of which none is stated: of all of a noise, or of the `scatter` beyond what is
    stated. That may be nothing: half of a Student's t, as of the spreads of levels.
    """
    size = f"{expected_sizes(scene, table)[name]:.10g}"
    return f"half-t({size}, {SCATTER_FREEDOM})" if scatter else f"lognormal({size}, 0.7)"


def scatter_specs(observables: Sequence[Observable]) -> dict[str, ParameterSpec]:
    """What noise parameters that add to stated sds are, by name. One fixed at zero adds nothing."""
    return {
        name: replace(
            SD_SPECS[name],
            meaning=f"scatter of {columns[0] if len(columns) == 1 else 'velocity'}, beyond stated errors",
        )
        for name, columns in beyond_stated(observables).items()
    }


@dataclass(frozen=True)
class Derived(Observable):
    """A quantity of the velocity that a fit has no noise for; it follows, to first order, from the independent
    noises of two columns, its `parts`. A stated sd adds to it.
    """

    parts: tuple[str, str] = ("v_x2", "v_y2")

    def known(self, _names: Collection[str]) -> bool:
        """Always: see `derived`, which makes these."""
        return True

    def sds(self, sizes: Sizes, rebound: Rebound) -> FloatArray:
        """See `Observable`."""
        mine, one, other = (OBSERVABLES[name].slopes(rebound, COMPONENTS) for name in (self.name, *self.parts))
        first, second = (np.asarray(sizes[NOISE_OF[name]])[..., None] for name in self.parts)
        # mine = a one + b other by Cramer's rule; no finite sd where the two say the same of the velocity.
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = _cross(mine, other) / _cross(one, other), _cross(one, mine) / _cross(one, other)
            own = np.asarray(np.hypot(a * first, b * second))
        return own if self.sd is None else np.hypot(self.sd, own)


def derived(observable: Observable, names: Collection[str]) -> Observable:
    """The observable in a fit with parameters `names`: its noise from others where it has none, else only what is
    stated.
    """
    if observable.noise in names:
        return observable
    of = [name for name in VELOCITIES if NOISE_OF[name] in names]
    if observable.name not in VELOCITIES or len(of) < 2:
        return replace(observable, noise=None)
    return Derived(observable.name, observable.observed, observable.sd, None, observable.rows, (of[0], of[1]))


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])
