"""`Problem`: all that defines a posterior."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import msgspec
import numpy as np

from fitball.base.columns import COLUMNS, Column
from fitball.base.errors import Note
from fitball.base.priors import parse_prior
from fitball.base.values import FloatArray, Impacts, IntArray
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.derived import Quantity, quantities
from fitball.inference.forward import CalibratedRange, ForwardModel, Values
from fitball.inference.noise import NOISE_KINDS
from fitball.inference.problem.camera import CAMERA_SPECS, CameraModel, filmed_rebounds
from fitball.inference.problem.joint_prior import JointPrior, Parameter
from fitball.inference.problem.levels import ALL
from fitball.inference.problem.row_errors import RowErrors
from fitball.models.specs import BALL_PARAMETERS, SPECS
from fitball.models.types import Rebound

# Parameters that belong to no model.
COMMON_PARAMETERS = frozenset(
    {
        *(column.noise.name for column in COLUMNS.values() if column.noise is not None),
        *(spec.name for kind in NOISE_KINDS.values() for spec in kind.parameters),
        *BALL_PARAMETERS,
        *CAMERA_SPECS,
    }
)


class Choices(msgspec.Struct, frozen=True):
    """The user's choices, which override the scene's sections of the same names; empty: the
    default.
    """

    model: str = ""
    fix: dict[str, float] = {}
    prior: dict[str, str] = {}
    pool: dict[str, str] = {}
    noise: str = ""

    def for_model(self, model: str, parameters: Collection[str]) -> Choices:
        """The same for another model, without what concerns parameters that it lacks: so compare
        and assumptions keep priors and fixed values.
        """
        names = {*parameters, *COMMON_PARAMETERS, ALL}

        def fitting(texts: Mapping[str, str]) -> dict[str, str]:
            return {name: text for name, text in texts.items() if base_of(name) in names}

        fix = {name: value for name, value in self.fix.items() if base_of(name) in names}
        return Choices(model, fix, fitting(self.prior), fitting(self.pool), self.noise)


def base_of(name: str) -> str:
    """The parameter that a name is about: `mu` of `mu[clay]` and of `mu_spread`."""
    return name.partition("[")[0].removesuffix("_spread")


class Observable(NamedTuple):
    """A measured column of a problem, its `noise` parameter, and whether rows state errors beside
    that.
    """

    column: Column
    noise: str
    stated: bool


@dataclass(frozen=True)
class Rows:
    """What has one entry an impact: measured `states`, `y` (impacts, columns), NaN where not
    measured or withheld (the one mask), `sd` (impacts, columns) of independent stated errors, zero
    where none, `index` (impacts, levels).
    """

    states: Impacts
    y: FloatArray
    sd: FloatArray
    errors: RowErrors | None
    index: IntArray

    def take(self, rows: IntArray) -> Rows:
        """Some of the rows."""
        return Rows(
            states=self.states.take(rows),
            y=self.y[rows],
            sd=self.sd[rows],
            errors=None if self.errors is None else self.errors.take(rows),
            index=self.index[rows],
        )


@dataclass(frozen=True)
class Problem:
    """A table under a forward model with priors; `contact_time` is the scene's mean of the table,
    (value, sd) [s]; `free` names free parameters in the order of coordinates; `prior_texts` has the
    prior, or fixed value, of every parameter as text, with which `build_problem` makes the same
    problem whatever its defaults.
    """

    table: ImpactTable
    scene: Scene
    choices: Choices
    forward: ForwardModel
    parameters: tuple[Parameter, ...]
    free: tuple[str, ...]
    prior: JointPrior
    observables: tuple[Observable, ...]
    rows: Rows
    camera: CameraModel | None
    contact_time: tuple[float, float] | None
    notes: tuple[Note, ...]
    prior_texts: Mapping[str, str]

    @property
    def calibrated(self) -> CalibratedRange:
        """The impacts of the table."""
        index = self.forward.levels_of(self.table.labels, len(self.table))
        return CalibratedRange(self.table.impacts, index, self.forward.model.ball.radius)

    @property
    def noises(self) -> frozenset[str]:
        """The parameters of noise, which move no prediction."""
        kind = self.forward.noise.parameters
        return frozenset(
            [*(item.noise for item in self.observables), *(spec.name for spec in kind)]
        )

    @property
    def derived(self) -> tuple[Quantity, ...]:
        """What follows from parameters."""
        return quantities(self.forward, self.calibrated, self.scene)

    def values(self, q: FloatArray) -> Values:
        """Every parameter by name at coordinates (draws, free)."""
        values = dict(zip(self.free, self.prior.value(q).T, strict=True))
        for item in self.parameters:
            if item.fixed is not None:
                values[item.spec.name] = np.full(len(q), item.fixed)
        return values

    def coordinates(self, values: Mapping[str, float]) -> FloatArray:
        """Coordinates (free,) of named values."""
        free = np.array([[values[name] for name in self.free]])
        return np.asarray(self.prior.coordinate(free)[0])

    def rebounds(
        self,
        values: Values,
        states: Impacts | None = None,
        like: IntArray | None = None,
    ) -> Rebound:
        """Rebounds (draws, impacts) of its rows, at measured `states` (default: theirs), as the
        camera shows them; states of another number are those of the rows `like`.
        """
        measured = self.rows.states if states is None else states
        index = self.rows.index if like is None else self.rows.index[like]
        camera = self.camera if self.camera is None or like is None else self.camera.take(like)
        return filmed_rebounds(camera, self.forward, values, measured, index)

    def on_rows(self, rows: IntArray) -> Problem:
        """The problem of some rows, for sums over them: the table is still the whole one."""
        camera = None if self.camera is None else self.camera.take(rows)
        return replace(self, rows=self.rows.take(rows), camera=camera)

    def take(self, rows: IntArray) -> Problem:
        """The problem of some rows."""
        return replace(self.on_rows(rows), table=self.table.take(rows))

    def with_constant(self, name: str, value: float) -> Problem:
        """Another value of a constant of ball or camera; of a camera that nobody stated, of all
        sessions.
        """
        key = name.partition("[")[0]
        camera = self.camera
        names = [name]
        if key in CAMERA_SPECS and (camera is None or key not in camera.keys):
            if camera is None:
                one_session = np.zeros(len(self.rows.y), dtype=np.int64)
                camera = CameraModel((), ("",), one_session)
            camera = camera._replace(keys=(*camera.keys, key))
            names = [camera.name(key, session) for session in camera.sessions]
        spec = {**SPECS, **CAMERA_SPECS}[key]
        prior = parse_prior(spec)
        held = [Parameter(replace(spec, name=name), prior, value) for name in names]
        others = tuple(item for item in self.parameters if item.spec.name not in names)
        return replace(self, parameters=(*others, *held), camera=camera)

    def without_rows(self, rows: IntArray) -> Problem:
        """The measurements of some rows withheld; these impacts must still be possible."""
        y = self.rows.y.copy()
        y[rows] = np.nan
        return replace(self, rows=replace(self.rows, y=y))

    def only_columns(self, columns: Collection[str]) -> Problem:
        """The measurements of other columns withheld."""
        counted = [item.column.name in columns for item in self.observables]
        y = np.where(counted, self.rows.y, np.nan)
        return replace(self, rows=replace(self.rows, y=y))
