"""`Problem`: all that defines a posterior. `build` makes it of a table, a scene and choices."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from fitball.base.columns import COLUMNS, Column
from fitball.base.errors import Note
from fitball.base.priors import parse_prior
from fitball.base.values import FloatArray, Impacts, IntArray
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.derived import Quantity, compared_levels, quantities
from fitball.inference.formulas import Known, written
from fitball.inference.forward import CalibratedRange, ForwardModel, Values
from fitball.inference.noise import NOISE_KINDS
from fitball.inference.problem.camera import CAMERA_SPECS, CameraModel
from fitball.inference.problem.fall import FALL_SPECS, FallModel
from fitball.inference.problem.instruments import measured_rebounds
from fitball.inference.problem.joint_prior import JointPrior, Parameter
from fitball.inference.problem.levels import ALL
from fitball.inference.problem.row_errors import LearntOffsets, RowErrors
from fitball.models.specs import BALL_PARAMETERS, SPECS
from fitball.models.types import Rebound

# Parameters that belong to no model: noises, constants of ball, camera and air.
COMMON_PARAMETERS = frozenset(
    {
        *(column.noise.name for column in COLUMNS.values() if column.noise is not None),
        *(spec.name for kind in NOISE_KINDS.values() for spec in kind.parameters),
        *BALL_PARAMETERS,
        *CAMERA_SPECS,
        *FALL_SPECS,
    }
)


class Choices(msgspec.Struct, frozen=True):
    """The user's choices, which override the scene's sections of the same names. Empty fields mean
    the default.
    """

    model: str = ""
    fix: dict[str, float] = {}
    prior: dict[str, str] = {}
    pool: dict[str, str] = {}
    noise: str = ""
    derive: dict[str, str] = {}

    def for_model(self, model: str, parameters: Collection[str]) -> Choices:
        """These choices for another model, which has such `parameters`: those that concern a
        parameter that it lacks are left out. So compare and assumptions keep priors and fixed
        values.
        """
        names = {*parameters, *COMMON_PARAMETERS, ALL}

        def applicable(texts: Mapping[str, str]) -> dict[str, str]:
            return {name: text for name, text in texts.items() if base_of(name) in names}

        fix = {name: value for name, value in self.fix.items() if base_of(name) in names}
        prior = applicable(self.prior)
        pool = applicable(self.pool)
        return Choices(model, fix, prior, pool, self.noise, self.derive)


def base_of(name: str) -> str:
    """The name of the parameter that a name is about: `mu` for `mu[clay]` and for `mu_spread`."""
    return name.partition("[")[0].removesuffix("_spread")


class Observable(NamedTuple):
    """A measured `column` of a problem, the name of its `noise` parameter, and whether rows have
    `stated` errors beside that.
    """

    column: Column
    noise: str
    stated: bool


@dataclass(frozen=True)
class Rows:
    """The measurements of a problem, in SI: incident `states`, and rebounds `y`, NaN where not
    measured or withheld (there is no other mask). `sd` are independent stated errors, zero where
    there are none or where `errors` say all; `index` says which level each impact has. With offsets
    that draws taught (`learnt`) predictions at uncertain states are an approximation.
    """

    states: Impacts
    y: Annotated[FloatArray, "impacts columns"]
    sd: Annotated[FloatArray, "impacts columns"]
    errors: RowErrors | None
    index: Annotated[IntArray, "impacts levels"]
    learnt: LearntOffsets | None = None

    def take(self, rows: Annotated[IntArray, "rows"]) -> Rows:
        """The rows with these numbers."""
        return Rows(
            states=self.states.take(rows),
            y=self.y[rows],
            sd=self.sd[rows],
            errors=None if self.errors is None else self.errors.take(rows),
            index=self.index[rows],
            learnt=None if self.learnt is None else self.learnt.take(rows),
        )


@dataclass(frozen=True)
class Problem:
    """A table under a forward model with priors.

    `free` names the free parameters in the order of coordinates; `contact_time` is the mean of the
    table as the scene states it, (value, sd) [s]. `prior_texts` has the prior, or the fixed value,
    of every parameter as text: with these `build_problem` makes the same problem whatever its
    defaults are.
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
    fall: FallModel | None
    contact_time: tuple[float, float] | None
    notes: tuple[Note, ...]
    prior_texts: Mapping[str, str]

    @property
    def calibrated(self) -> CalibratedRange:
        """The range of the table's impacts, beyond which a prediction is extrapolated."""
        index = self.forward.levels_of(self.table.labels, len(self.table))
        return CalibratedRange(self.table.impacts, index, self.forward.model.ball.radius)

    @property
    def noises(self) -> frozenset[str]:
        """The names of the parameters of noise, which move no prediction."""
        of_columns = [observable.noise for observable in self.observables]
        of_kind = [spec.name for spec in self.forward.noise.parameters]
        return frozenset([*of_columns, *of_kind])

    @property
    def derived(self) -> tuple[Quantity, ...]:
        """The quantities that follow from parameters, such as the pace of the court, differences
        of two levels, and what the user derives; of a variant of the model only if it has all names
        in it.
        """
        return self._derived(skip_unknown=True)

    def refuse_unknown_names(self) -> None:
        """Refuse what the user derives where it cannot be.

        Raises:
            ParameterError: an expression is none, or its name has been given (`derive`), or it has
                an unknown name (`unknown-parameter`).
        """
        self._derived(skip_unknown=False)

    def _derived(self, *, skip_unknown: bool) -> tuple[Quantity, ...]:
        """All quantities that follow from parameters. Raises ParameterError."""
        specs = {parameter.spec.name: parameter.spec for parameter in self.parameters}
        following = quantities(self.forward, self.calibrated, self.scene)
        following += compared_levels(self.forward, self.calibrated, specs)
        known = Known.of(self.forward, self.calibrated, specs, following)
        return (*following, *written(self.choices.derive, known, skip_unknown))

    def values(self, q: Annotated[FloatArray, "draws coordinates"]) -> Values:
        """The values in SI of all parameters, free and fixed, by name, at coordinates."""
        values = dict(zip(self.free, self.prior.value(q).T, strict=True))
        for parameter in self.parameters:
            if parameter.fixed is not None:
                values[parameter.spec.name] = np.full(len(q), parameter.fixed)
        return values

    def coordinates(self, values: Mapping[str, float]) -> Annotated[FloatArray, "coordinates"]:
        """The coordinates of the free parameters at values in SI by name."""
        free = np.array([[values[name] for name in self.free]])
        return np.asarray(self.prior.coordinate(free)[0])

    def rebounds(
        self,
        values: Values,
        states: Impacts | None = None,
        of_rows: Annotated[IntArray, "impacts"] | None = None,
    ) -> Rebound:
        """Rebounds (draws, impacts) as the camera shows them, at measured incident `states`, by
        default those of the rows. `of_rows` has the row number of each state, whose level and
        session it has; by default there is a state for each row.
        """
        measured = self.rows.states if states is None else states
        index = self.rows.index
        camera = self.camera
        fall = self.fall
        if of_rows is not None:
            index = index[of_rows]
            camera = None if camera is None else camera.take(of_rows)
            fall = None if fall is None else fall.take(of_rows)
        return measured_rebounds(camera, fall, self.forward, values, measured, index)

    def on_rows(self, rows: Annotated[IntArray, "rows"]) -> Problem:
        """The problem with the measurements of these row numbers alone, for sums over rows. Its
        `table`, and what depends on that, is still that of all rows.
        """
        camera = None if self.camera is None else self.camera.take(rows)
        fall = None if self.fall is None else self.fall.take(rows)
        return replace(self, rows=self.rows.take(rows), camera=camera, fall=fall)

    def take(self, rows: Annotated[IntArray, "rows"]) -> Problem:
        """The problem with the rows of these numbers alone, `table` included."""
        return replace(self.on_rows(rows), table=self.table.take(rows))

    def with_constant(self, name: str, value: float) -> Problem:
        """The problem with a constant of ball or camera held at `value`, in SI. A constant of the
        camera that is no parameter of the problem is held in all sessions.
        """
        key = name.partition("[")[0]
        camera = self.camera
        names = [name]
        if key in CAMERA_SPECS and (camera is None or key not in camera.keys):
            if camera is None:
                only_session = np.zeros(len(self.rows.y), dtype=np.int64)
                camera = CameraModel((), ("",), only_session)
            camera = camera._replace(keys=(*camera.keys, key))
            names = [camera.name(key, session) for session in camera.sessions]
        spec = {**SPECS, **CAMERA_SPECS}[key]
        prior = parse_prior(spec)
        held = [Parameter(replace(spec, name=name), prior, value) for name in names]
        others = tuple(
            parameter for parameter in self.parameters if parameter.spec.name not in names
        )
        return replace(self, parameters=(*others, *held), camera=camera)

    def without_rows(self, rows: Annotated[IntArray, "rows"]) -> Problem:
        """The problem with the measured rebounds of these row numbers withheld. The model must
        still have a rebound for these impacts.
        """
        y = self.rows.y.copy()
        y[rows] = np.nan
        return replace(self, rows=replace(self.rows, y=y))

    def only_columns(self, columns: Collection[str]) -> Problem:
        """The problem with the measurements of all other columns withheld."""
        stays = [observable.column.name in columns for observable in self.observables]
        y = np.where(stays, self.rows.y, np.nan)
        return replace(self, rows=replace(self.rows, y=y))
