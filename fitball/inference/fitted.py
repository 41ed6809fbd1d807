"""`Fitted`: a calibration, of which some is stored and the rest is computed from that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from hashlib import sha256
from typing import Annotated, Self

import msgspec
import numpy as np

from fitball.base.environment import packages
from fitball.base.errors import ModelError, Note, ParameterError, suggestion
from fitball.base.selection import evenly_begun
from fitball.base.text import listed
from fitball.base.values import DataFrame, FloatArray
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference import frames, schema
from fitball.inference.curves import curves_frame
from fitball.inference.derived import Quantity, level_differences, quantity_of
from fitball.inference.effort import PREDICTION_DRAWS, Effort
from fitball.inference.forward import Draws
from fitball.inference.judgement.open_sides import open_sides
from fitball.inference.judgement.rivals import Rival, rivals
from fitball.inference.marginal import Marginal
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.summary import end_errors, summarise
from fitball.models.model import Model
from fitball.models.specs import BALL_PARAMETERS, SPECS
from fitball.version import __version__

# Verdicts, each weaker than those before it.
_WEAKER: tuple[schema.Verdict, ...] = (
    "fixed",
    "identified",
    "given",
    "conditional",
    "one-sided",
    "extrapolated",
    "prior-dominated",
)


@dataclass(frozen=True)
class Run:
    """All that a fit depends on: the data themselves, the scene, what was chosen, and versions.

    `known` has the prior or fixed value of every parameter as text. `model_source` is the SHA-256
    of a user's own function, empty without one. `key` is the SHA-256 of all but `cores`: equal keys
    give equal bytes, and by it a batch knows which fits are finished. `packages` are versions of
    other packages, on which last digits may depend; they are not in the key.
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
    """All that a fit of this problem depends on, with its key."""
    table = problem.table
    source = problem.forward.model.source
    # No number depends on the number of cores.
    same = msgspec.structs.replace(effort, cores=None)
    contents = [
        problem.scene,
        problem.choices,
        same,
        dict(problem.prior_texts),
        source,
        __version__,
        dict(table.labels),
    ]
    digest = sha256(msgspec.json.encode(contents, order="deterministic"))
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
    """Draws of every parameter, PREDICTION_DRAWS of them at most, with `mu[new]` and `mu_spread` of
    leveled ones; no draws of a point fit.
    """
    point = fit.optima[0]
    best = {name: np.array([value]) for name, value in point.items()}
    # A level of which nothing was measured has no best value: the median of its prior, given the
    # best values of the others, takes its place.
    q = np.repeat(problem.coordinates(point)[np.newaxis], PREDICTION_DRAWS, axis=0)
    beyond = problem.prior.draw_new_levels(q, effort.stream("levels"))
    for name, draws in beyond.items():
        best[name] = np.asarray(np.median(draws, keepdims=True))
    if posterior is None:
        return Draws(point, {name: np.empty(0) for name in best}, best)
    chains = posterior.values.reshape(-1, len(posterior.names))
    count = min(PREDICTION_DRAWS, len(chains))
    chosen = chains[evenly_begun(len(chains), count)]
    values = dict(zip(posterior.names, chosen.T, strict=True))
    for name, value in point.items():
        if name not in values:
            values[name] = np.full(count, value)
    free = np.stack([values[name] for name in problem.free], axis=1)
    beyond = problem.prior.draw_new_levels(problem.prior.coordinate(free), effort.stream("levels"))
    return Draws(point, {**values, **beyond}, best)


def medians_of(draws: Draws) -> dict[str, float]:
    """The median of each parameter by name, in SI; none without draws."""
    sampled = draws.values.items()
    return {name: float(np.median(column)) for name, column in sampled if column.size}


@dataclass(frozen=True, eq=False, repr=False)
class Fitted:
    """A calibration. Its fields are stored, but for `own`, a user's own model.

    What follows from them in under a second is computed when first asked for and never stored:
    problem, draws, frames. `modes` are those of a posterior that has several. Two are equal (`==`)
    if all but times, cores and notes is equal to the last digit.
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
    modes: tuple[schema.Mode, ...] = ()
    own: Model | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        # Plain mappings print all that they hold.
        object.__setattr__(self, "parameters", schema.Estimates(self.parameters))
        object.__setattr__(self, "derived", schema.Estimates(self.derived))

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

    # A fit has names, and is no sequence.
    __iter__ = None

    def __getitem__(self, name: str) -> Marginal:
        """One parameter or derived quantity by name, with its draws and its row of `summary`.

        Raises:
            ParameterError: there is no quantity of this name (`unknown-quantity`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> float(fit["cor_10"].summary["point"].round(2))
            0.73
        """
        reported = {**self.parameters, **self.derived}
        if name not in reported:
            raise ParameterError(
                f"read '{name}': {suggestion(name, reported)}",
                "unknown-quantity",
            )
        draws = self.quantity(name).rule(self.draws.values)
        (row,) = (row for _, row in self.summary.loc[[name]].iterrows())
        return Marginal(reported[name], draws, row)

    def _ipython_key_completions_(self) -> list[str]:
        return [estimate.name for estimate in self.reported]

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """The frames that are saved as tables, by name.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> list(fit.frames)
            ['summary', 'predictions', 'balances', 'regimes']
        """
        return {
            name: getattr(self, name) for name in ("summary", "predictions", "balances", "regimes")
        }

    @cached_property
    def problem(self) -> Problem:
        """The problem that was fitted, built again from `run`.

        Raises:
            ModelError: the fit was made with a function of the user's own, and `own` is not that
                (`own-model`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.problem.free
            ('cor_10', 'cor_slope')
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
        """Draws of every parameter, up to 4,000, with `mu[new]` and `mu_spread` of leveled ones; no
        draws of a point fit. `point` has the best values, in SI.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> round(fit.draws.point["cor_10"], 2)
            0.73
            >>> fit.draws.values["cor_10"].size
            0
        """
        return draws_of(self.problem, self.point, self.posterior, self.run.effort)

    @property
    def reported(self) -> list[schema.Estimate]:
        """The estimates of all parameters, then of derived quantities.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> [estimate.name for estimate in fit.reported]
            ['k_y', 'cor_10', 'cor_slope', 'v_y_sd', 'cor_254cm', 'rebound_254cm']
        """
        return [*self.parameters.values(), *self.derived.values()]

    @cached_property
    def covariance(self) -> DataFrame:
        """The covariance of all draws of the free parameters, in SI, a row and a column for each;
        empty for a point fit.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.covariance.empty
            True
        """
        import pandas as pd

        if self.posterior is None:
            return pd.DataFrame()
        names = list(self.posterior.names)
        draws = self.posterior.values.reshape(-1, len(self.posterior.names))
        return pd.DataFrame(np.atleast_2d(np.cov(draws, rowvar=False)), names, names)

    @property
    def correlation(self) -> DataFrame:
        """The correlation of all draws of the free parameters, a row and a column for each; empty
        for a point fit.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.correlation.empty
            True
        """
        sd = np.sqrt(np.diagonal(self.covariance))
        correlation: DataFrame = self.covariance / np.multiply.outer(sd, sd)
        return correlation

    def quantity(self, name: str) -> Quantity:
        """A parameter or derived quantity by name, with its rule from values to draws in SI.

        Raises:
            ParameterError: there is no quantity of this name (`unknown-quantity`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> height = fit.quantity("rebound_254cm")
            >>> height.spec.unit
            'm'
            >>> height.rule(fit.draws.best).round(2)
            array([1.26])
        """
        if name not in self._quantities:
            raise ParameterError(
                f"read '{name}': {suggestion(name, self._quantities)}",
                "unknown-quantity",
            )
        return self._quantities[name]

    @property
    def differences(self) -> DataFrame:
        """Of each parameter with levels the two that are farthest apart: a frame, index
        `parameter`. Difference and ratio of two levels are quantities of the fit as well.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.differences.empty
            True
        """
        return level_differences(self.problem.forward, self.draws)

    def derive(self, **formulas: str) -> Self:
        """The same fit with quantities of one's own, each a formula of names of others, as option
        `derive` of `calibrate` has them. Each has the weakest verdict of those that it is made of;
        `calibrate` judges it by itself.

        Raises:
            ParameterError: a formula is none, or its name has been given (`derive`), or it has an
                unknown name (`unknown-parameter`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> more = fit.derive(lost="1 - cor_254cm**2")
            >>> round(more.derived["lost"].point, 2)
            0.46
        """
        choices = self.run.choices
        choices = msgspec.structs.replace(choices, derive=choices.derive | formulas)
        problem = replace(self.problem, choices=choices)
        problem.refuse_unknown_names()
        derived = dict(self.derived)
        for quantity in problem.derived:
            if quantity.base in formulas and quantity.parts:
                derived[quantity.spec.name] = self._derived_estimate(quantity)
        return replace(self, run=run_of(problem, self.run.effort), derived=derived)

    def _derived_estimate(self, quantity: Quantity) -> schema.Estimate:
        """The estimate of a quantity that is derived from others, with their weakest verdict."""
        spec = quantity.spec
        used = quantity.parts
        parents = [estimate for estimate in self.reported if estimate.name in used]
        verdict = max((parent.verdict for parent in parents), key=_WEAKER.index)
        given = dict.fromkeys(choice for parent in parents for choice in parent.given)
        point = float(quantity.rule(self.draws.best)[0])
        summary = summarise(quantity.rule(self.draws.values), point)
        reason = f"It has the weakest verdict of {listed(used)}, from which it is computed."
        sides = open_sides(quantity, parents, self.draws.best)
        if verdict == "one-sided" and sides >= {"above", "below"}:
            verdict = "prior-dominated"
            reason = f"Of {listed(used)} the data limit some on one side, and so it on neither."
        return schema.Estimate(
            **msgspec.structs.asdict(summary),
            name=spec.name,
            kind="derived",
            unit=spec.unit,
            meaning=spec.meaning,
            prior="",
            prior_source="",
            contraction=np.nan,
            verdict=verdict,
            rule="derived",
            reason=reason,
            given=tuple(given),
            open_side=sides.pop() if verdict == "one-sided" and len(sides) == 1 else "",
        )

    @cached_property
    def rivals(self) -> tuple[Rival, ...]:
        """Models of another kind that predict left-out impacts as well as this one: some seconds.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.rivals
            ()
        """
        return rivals(self.problem, self.point, self.run.effort.stream("rivals"))

    @cached_property
    def _quantities(self) -> Mapping[str, Quantity]:
        """All quantities by name: parameters, derived ones, and held constants."""
        # Held constants of ball and camera, which may be tried, are no parameters of the problem.
        held = {name: SPECS[name] for name in BALL_PARAMETERS} | dict(CAMERA_SPECS)
        quantities = {name: quantity_of(spec) for name, spec in held.items()}
        for fitted in self.problem.parameters:
            quantities[fitted.spec.name] = quantity_of(fitted.spec)
        for quantity in self.problem.derived:
            quantities[quantity.spec.name] = quantity
        return quantities

    @cached_property
    def end_errors(self) -> Mapping[str, tuple[float, float]]:
        """The Monte Carlo errors of both ends of the 95 % interval of each quantity by name, in SI;
        none without draws. A derived quantity has the effective draws of the parameter that has
        fewest.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.end_errors
            {}
        """
        if self.diagnostics is None:
            return {}
        sizes = self.diagnostics.ess_tail
        least = min(sizes.values())
        errors = {}
        for estimate in self.reported:
            draws = self.quantity(estimate.name).rule(self.draws.values)
            effective = min(sizes.get(estimate.name, least), float(draws.size))
            errors[estimate.name] = end_errors(draws, effective)
        return errors

    def prior_draws(self, name: str, count: int) -> Annotated[FloatArray, "draws"]:
        """Draws of a quantity under the priors alone, in SI, `count` of them.

        Raises:
            ParameterError: there is no quantity of this name (`unknown-quantity`).

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.prior_draws("cor_10", 1000).shape
            (1000,)
        """
        problem = self.problem
        q = problem.prior.draw(self.run.effort.stream("prior"), count)
        return self.quantity(name).rule(problem.values(q))

    @cached_property
    def summary(self) -> DataFrame:
        """The frame of results: a row for each parameter and derived quantity, by name, with its
        median, intervals and verdict, in SI. The report explains its columns.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.summary.loc["cor_10", "verdict"]
            'given'
            >>> float(fit.summary["point"]["cor_10"].round(2))
            0.73
        """
        return frames.summary_frame(self.reported, self.profiles, self.diagnostics, self.variants)

    @cached_property
    def predictions(self) -> DataFrame:
        """The frame of predictions of the fitted impacts: a row for each impact and measured
        column, in SI.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.predictions["observed"].tolist()
            [2.9773, 4.3706, 5.7912, 7.3798, 8.8007]
        """
        return frames.predictions_frame(self.problem, self.draws, self.run.effort.stream("predict"))

    @cached_property
    def balances(self) -> DataFrame:
        """The frame of balances: a row for each impact, with restitution, friction, offset and lost
        energy by conservation laws alone, and their sds.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.balances["cor"].round(2).tolist()
            [0.74, 0.73, 0.72, 0.74, 0.73]
        """
        return frames.balances_frame(self.problem, self.draws)

    @cached_property
    def regimes(self) -> DataFrame:
        """The frame of regimes: a row for each impact and sequence of slip and grip, with its share
        of the draws; no sequence in a drop test.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.regimes["share"].tolist()
            [1.0, 1.0, 1.0, 1.0, 1.0]
        """
        return frames.regimes_frame(self.problem, self.draws)

    @cached_property
    def curves(self) -> DataFrame:
        """The frame of curves: a row for each curve, measured column and point, in SI. A curve is
        the model over incidence, at a speed and spin of the table.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.curves["column"].unique().tolist()
            ['v_y2']
        """
        return curves_frame(self.problem, self.draws)

    @cached_property
    def variants(self) -> DataFrame:
        """The frame of variants: a row for each choice, or held constant, and each quantity, with
        the value under it, in SI.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> sorted(set(fit.variants["choice"]))[-3:]
            ['noise=student-t', 'normal=inner', 'normal=momentum']
        """
        return frames.variants_frame(self.reported, self.alternatives, self.constants)

    def moved_from(self, other: Fitted) -> dict[str, float]:
        """By how many sds each median differs from that of another fit; by which share of the best
        value where there are no draws. Empty if all is equal to the last digit.

        Example:
            >>> import fitball
            >>> fit = fitball.calibrate("synthetic_drop", point_only=True)
            >>> fit.moved_from(fit)
            {}
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
