"""`Fitted`: a calibration, stored and computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256

import msgspec
import numpy as np

from fitball.base.environment import packages
from fitball.base.errors import ModelError, Note, ParameterError, suggestion
from fitball.base.selection import evenly_begun
from fitball.base.values import DataFrame, FloatArray
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference import frames, schema
from fitball.inference.curves import curves_frame
from fitball.inference.derived import Quantity, quantity_of
from fitball.inference.effort import PREDICTING, Effort
from fitball.inference.forward import Draws
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.problem import Choices, Problem
from fitball.models.model import Model
from fitball.models.specs import BALL_PARAMETERS, SPECS
from fitball.version import __version__


@dataclass(frozen=True)
class Run:
    """All that a fit depends on: the data themselves; prior or fixed value of every parameter,
    `known`; SHA-256 of a function of one's own; version. `key` is the SHA-256 of it but for
    `cores`: equal keys give equal bytes, and by it a batch knows what is finished, whatever words
    change. `packages` are versions of others, on which last digits may depend.
    """

    table: ImpactTable
    scene: Scene
    choices: Choices
    effort: Effort
    known: Mapping[str, str]
    model_source: str
    version: str
    key: str
    packages: Mapping[str, str] = field(default_factory=dict)


def run_of(problem: Problem, effort: Effort) -> Run:
    """What a fit of this problem depends on."""
    table = problem.table
    source = problem.forward.model.source
    # No number depends on the number of cores.
    same = msgspec.structs.replace(effort, cores=None)
    words = [
        problem.scene,
        problem.choices,
        same,
        dict(problem.prior_texts),
        source,
        __version__,
        dict(table.labels),
    ]
    digest = sha256(msgspec.json.encode(words, order="deterministic"))
    for columns in (table.values, table.sd, table.corr):
        for name, column in columns.items():
            digest.update(name.encode() + np.ascontiguousarray(column).tobytes())
    return Run(
        table=table,
        scene=problem.scene,
        choices=problem.choices,
        effort=effort,
        known=problem.prior_texts,
        model_source=source,
        version=__version__,
        key=digest.hexdigest(),
        packages=packages(),
    )


def draws_of(
    problem: Problem,
    fit: schema.PointFit,
    posterior: schema.Posterior | None,
    effort: Effort,
) -> Draws:
    """PREDICTING draws of every parameter, with `mu[new]` and `mu_spread` of levels; none of a
    point fit.
    """
    point = fit.optima[0]
    best = {name: np.array([value]) for name, value in point.items()}
    # A level of which nothing was measured has no best value: the middle of what is known of it
    # stands for that.
    q = np.repeat(problem.coordinates(point)[np.newaxis], PREDICTING, axis=0)
    beyond = problem.prior.draw_new_levels(q, effort.stream("levels"))
    for name, draws in beyond.items():
        best[name] = np.asarray(np.median(draws, keepdims=True))
    if posterior is None:
        return Draws(point, {name: np.empty(0) for name in best}, best)
    chains = posterior.values.reshape(-1, len(posterior.names))
    count = min(PREDICTING, len(chains))
    chosen = chains[evenly_begun(len(chains), count)]
    values = dict(zip(posterior.names, chosen.T, strict=True))
    for name, value in point.items():
        if name not in values:
            values[name] = np.full(count, value)
    free = np.stack([values[name] for name in problem.free], axis=1)
    beyond = problem.prior.draw_new_levels(problem.prior.coordinate(free), effort.stream("levels"))
    return Draws(point, {**values, **beyond}, best)


@dataclass(frozen=True, eq=False, repr=False)
class Fitted:
    """A calibration. Its fields are stored; what follows from them in under a second is computed
    when first asked for and never stored: problem, draws, frames, lab results, golden impacts.
    `own`, a model of one's own, is not stored either. Equal to the last digit but for `seconds`.
    """

    run: Run
    status: schema.FitStatus
    headline: str
    notes: tuple[Note, ...]
    parameters: Mapping[str, schema.Estimate]
    derived: Mapping[str, schema.Estimate]
    point: schema.PointFit
    least_squares: schema.LeastSquares
    posterior: schema.Posterior | None
    diagnostics: schema.Diagnostics | None
    profiles: Mapping[str, schema.Profile]
    adequacy: schema.Adequacy
    alternatives: tuple[schema.Alternative, ...]
    constants: tuple[schema.Constant, ...]
    seconds: Mapping[str, float]
    own: Model | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        return (
            f"<Fit of {self.run.table.name} by {self.problem.forward.model.text}: {self.headline}>"
        )

    def __eq__(self, other: object) -> bool:
        """Whether all but times, cores and notes is equal to the last digit."""
        if not isinstance(other, Fitted) or self.run.key != other.run.key:
            return False
        return not self.moved_from(other)

    __hash__ = None  # type: ignore[assignment]

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """As files have them."""
        return {
            name: getattr(self, name) for name in ("summary", "predictions", "balances", "regimes")
        }

    @cached_property
    def problem(self) -> Problem:
        """Built again from `run`. Raises ModelError (`own-model`) without its function of one's
        own.
        """
        run = self.run
        if run.model_source and (self.own is None or self.own.source != run.model_source):
            raise ModelError(
                f"this fit was made with a function of your own, {run.choices.model}: pass the "
                "same one as model=",
                "own-model",
            )
        return build_problem(run.table, run.scene, run.choices, self.own, run.known)

    @cached_property
    def draws(self) -> Draws:
        """PREDICTING draws of every parameter, with `mu[new]` and `mu_spread` of levels; none of a
        point fit.
        """
        return draws_of(self.problem, self.point, self.posterior, self.run.effort)

    @property
    def reported(self) -> list[schema.Estimate]:
        """Parameters, then derived quantities."""
        return [*self.parameters.values(), *self.derived.values()]

    @cached_property
    def covariance(self) -> DataFrame:
        """Of all draws of the free parameters, a row and a column each; empty for a point fit."""
        import pandas as pd

        if self.posterior is None:
            return pd.DataFrame()
        names = list(self.posterior.names)
        draws = self.posterior.values.reshape(-1, len(self.posterior.names))
        return pd.DataFrame(np.atleast_2d(np.cov(draws, rowvar=False)), names, names)

    @property
    def correlation(self) -> DataFrame:
        """The same over the sds."""
        sd = np.sqrt(np.diagonal(self.covariance))
        correlation: DataFrame = self.covariance / np.multiply.outer(sd, sd)
        return correlation

    def quantity(self, name: str) -> Quantity:
        """A parameter or derived quantity. Raises ParameterError (`unknown-quantity`)."""
        if name not in self._quantities:
            raise ParameterError(
                f"read '{name}': {suggestion(name, self._quantities)}",
                "unknown-quantity",
            )
        return self._quantities[name]

    @cached_property
    def _quantities(self) -> Mapping[str, Quantity]:
        # Held constants of ball and camera, which may be tried, are no parameters of the problem.
        held = {name: SPECS[name] for name in BALL_PARAMETERS} | dict(CAMERA_SPECS)
        quantities = {name: quantity_of(spec) for name, spec in held.items()}
        for item in self.problem.parameters:
            quantities[item.spec.name] = quantity_of(item.spec)
        for quantity in self.problem.derived:
            quantities[quantity.spec.name] = quantity
        return quantities

    def prior_draws(self, name: str, count: int) -> FloatArray:
        """Draws (count,) of a quantity under the priors alone."""
        problem = self.problem
        q = problem.prior.draw(self.run.effort.stream("prior"), count)
        return self.quantity(name).rule(problem.values(q))

    @cached_property
    def summary(self) -> DataFrame:
        """A row a parameter and derived quantity. The only layout of these numbers;
        `report.fit_page` has its columns and those of the other frames.
        """
        return frames.summary_frame(self.reported, self.profiles, self.diagnostics, self.variants)

    @cached_property
    def predictions(self) -> DataFrame:
        """A row an impact and measured column."""
        return frames.predictions_frame(self.problem, self.draws, self.run.effort.stream("predict"))

    @cached_property
    def balances(self) -> DataFrame:
        """A row an impact: restitution, friction, offset and energy by conservation laws alone,
        with sds.
        """
        return frames.balances_frame(self.problem, self.draws)

    @cached_property
    def regimes(self) -> DataFrame:
        """A row an impact and sequence of slip and grip, with its share of the draws."""
        return frames.regimes_frame(self.problem, self.draws)

    @cached_property
    def curves(self) -> DataFrame:
        """A row a curve, measured column and point: the model over incidence, at a speed and spin
        of the table.
        """
        return curves_frame(self.problem, self.draws)

    @cached_property
    def variants(self) -> DataFrame:
        """A row a choice (or held constant) and quantity: the value under it."""
        return frames.variants_frame(self.reported, self.alternatives, self.constants)

    def moved_from(self, other: Fitted) -> dict[str, float]:
        """Sds by which each median differs from another run's (shares of the point, where there are
        no draws); empty if all is equal to the last digit.
        """
        if self._judged() == other._judged() and self._same_draws(other):
            return {}
        mine = {**self.parameters, **self.derived}
        theirs = {**other.parameters, **other.derived}
        moved = {}
        for name in sorted(mine.keys() & theirs.keys()):
            here = mine[name]
            there = theirs[name]
            if min(here.sd, there.sd) > 0.0:
                away = abs(here.median - there.median)
                size = max(here.sd, there.sd)
            else:
                away = abs(here.point - there.point)
                size = max(abs(here.point), abs(there.point))
            moved[name] = away / size if away > 0.0 else 0.0
        return moved

    def _judged(self) -> bytes:
        """All numbers and judgements but draws, as they are stored."""
        stored = (self.parameters, self.derived, self.point, self.least_squares, self.adequacy)
        return msgspec.json.encode(stored, order="deterministic")

    def _same_draws(self, other: Fitted) -> bool:
        """Whether two fits have the same draws."""
        if self.posterior is None or other.posterior is None:
            return self.posterior is other.posterior
        return np.array_equal(self.posterior.values, other.posterior.values)
