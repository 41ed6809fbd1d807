"""What a fit found: frozen values, no computing. Everything a report, a file or a caller reads is here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from fitball.data.balances import Balances
from fitball.inference.problem.pooling import Levels
from fitball.inference.problem.problem import Problem
from fitball.inference.results.assumptions import Assumptions
from fitball.inference.results.evidence import Adequacy, Difference, Identifiability
from fitball.inference.results.fitted_model import PREDICTING, FittedModel
from fitball.inference.results.lab import CourtPace, DropTest
from fitball.inference.results.source import Counted, NotNegative, Share, Source, Whole
from fitball.models.types import Rebound
from fitball.values import FloatArray, Impacts, same

# Versions 1 to 4 were laid out by hand; 5 is these types as they are.
SCHEMA_VERSION: Literal[8] = 8
KIND: Literal["fitball fit"] = "fitball fit"
TARGET_ESS = 1000.0
TARGET_R_HAT = 1.01


class Verdict(StrEnum):
    """Do the data determine a parameter?"""

    IDENTIFIED = "identified"
    GIVEN = "identified, given assumptions"
    UNEXAMINED = "identified, assumptions not examined"
    CONDITIONAL = "conditional"
    EXTRAPOLATED = "extrapolated"
    ONE_SIDED = "one-sided"
    PRIOR_DOMINATED = "prior-dominated"
    FIXED = "fixed"
    NOT_JUDGED = "not judged"


def reported(
    parameters: Mapping[str, Estimate], derived: Mapping[str, Estimate], levels: Sequence[Levels]
) -> tuple[Estimate, ...]:
    """See `Record.reported`."""
    scatter = {name for item in levels for name in item.hidden}
    own = {item.parameter: [item.level_name(label) for label in item.labels] for item in levels}
    found = dict[str, Estimate]()
    for name, item in parameters.items():
        # A level for which the model has hardly an answer has no value.
        found |= {one: derived[one] for one in own.get(name, ()) if one in derived}
        found |= {} if name in own or name in scatter else {name: item}
    return tuple({**found, **derived}.values())


def verdict_words(verdict: Verdict, given: Sequence[str]) -> str:
    """A verdict as it is printed: `identified, given offset=contact` names the assumptions."""
    return f"identified, given {', '.join(given)}" if verdict is Verdict.GIVEN else str(verdict)


class RunStatus(StrEnum):
    """How a run ended."""

    CONVERGED = "converged"
    NOT_CONVERGED = "not converged"
    POINT_ONLY = "point only"
    INTERRUPTED = "interrupted"


@dataclass(frozen=True)
class LeastSquares:
    """Weighted least squares: no prior but the bounds, noise at its stated or nominal size.

    `values` holds every parameter by name in SI. `stderr` is a number, or None with the cause in `missing`.
    `covariance` is that of the parameters that have one, in their order. `evaluations` are those of lmfit. `rms` is
    the root mean square residual of each observable, in its unit.
    """

    values: Mapping[str, float]
    stderr: Mapping[str, float | None]
    missing: Mapping[str, str]
    chi_square: float
    degrees_of_freedom: int
    rms: Mapping[str, float]
    starts: int
    optima: tuple[Mapping[str, float], ...]
    optima_chi_square: tuple[float, ...]
    evaluations: int
    covariance: FloatArray | None = None


@dataclass(frozen=True)
class PointFit:
    """The maximum of the posterior density, with respect to the coordinates of the priors.

    `values` holds every parameter by name in SI; `log_posterior` is the density there, up to the evidence.
    """

    values: Mapping[str, float]
    log_posterior: float
    log_likelihood: float
    rms: Mapping[str, float]
    rebound: Rebound
    optima: tuple[Mapping[str, float], ...]
    optima_log_posterior: tuple[float, ...]


@dataclass(frozen=True)
class Estimate:
    """One parameter: quantiles of its posterior in SI, its prior and the verdict on it.

    Quantities that do not exist (a fixed parameter, a run without posterior) are None. `contraction` is 1 - posterior
    variance / prior variance in the coordinate of the prior, where the prior includes the scene. `prior_source` is
    the publication of a prior from the literature. `given` are the assumptions on which a determined value depends.
    """

    name: str
    unit: str
    meaning: str
    prior: str
    point: float
    median: float | None
    sd: NotNegative | None
    q025: float | None
    q05: float | None
    q16: float | None
    q84: float | None
    q95: float | None
    q975: float | None
    contraction: float | None
    verdict: Verdict
    given: tuple[str, ...]
    reason: str
    ess_bulk: float | None
    ess_tail: float | None
    r_hat: float | None
    prior_source: str = ""

    @property
    def verdict_words(self) -> str:
        """The verdict with the assumptions it is given."""
        return verdict_words(self.verdict, self.given)


@dataclass(frozen=True)
class Posterior:
    """Draws kept for inference.

    `values` is (ensembles, steps, walkers, free parameters) in SI; `log_posterior` is aligned with it, (ensembles,
    steps, walkers). `prior_draws` (draws, free parameters) are draws from the priors with what the scene states.
    """

    names: tuple[str, ...]
    values: FloatArray
    log_posterior: FloatArray
    prior_draws: FloatArray

    @property
    def draws(self) -> FloatArray:
        """All draws, (draws, free parameters)."""
        return self.values.reshape(-1, self.values.shape[-1])


@dataclass(frozen=True)
class Diagnostics:
    """Convergence of the sampler. `warm_up` steps precede those used. Of the latter `kept` were stored: all, or of a
    long run every second, fourth and so on. `r_hat` is rank-normalised and nested (ensembles over walkers). Where
    draws were weighted each step is one proposal, and `pareto_k` measures the tail of the weights.
    """

    ensembles: Counted
    walkers: Counted
    warm_up: Whole
    steps: Counted
    kept: Counted
    max_steps: Counted
    acceptance: tuple[Share, ...]
    min_ess_bulk: float
    min_ess_tail: float
    max_r_hat: float
    ess_bulk: Mapping[str, float]
    ess_tail: Mapping[str, float]
    r_hat: Mapping[str, float]
    evaluations: int
    converged: bool
    complaints: tuple[str, ...]
    target_ess: float = TARGET_ESS
    pareto_k: float | None = None


@dataclass(frozen=True)
class ObservablePrediction:
    """Posterior prediction of one measured column at the table's impacts, all (impacts,) in SI.

    `mean_*` are quantiles of the noise-free rebound (parameter uncertainty alone), `data_*` of a new measurement
    (with noise). `sd` is the measurement noise at the posterior median. `observed` is NaN where nothing was measured.
    There `sd` and `data_*` are NaN too, if the table states sds.
    """

    name: str
    unit: str
    observed: FloatArray
    sd: FloatArray
    point: FloatArray
    median: FloatArray
    mean_q025: FloatArray
    mean_q16: FloatArray
    mean_q84: FloatArray
    mean_q975: FloatArray
    data_q025: FloatArray
    data_q975: FloatArray


@dataclass(frozen=True)
class Curve:
    """Noise-free predictions at one speed and spin over incidence angle; of a drop test over speed.

    `label` is the surface, ball or table where these differ. `speed` [m/s] (None for a drop test) and `spin` [rad/s]
    are common to the `impacts` (points,); `along` (points,) is their angle [rad] or speed [m/s]. `rows` are the
    impacts of the table near that speed and spin. `outputs` holds quantiles (2.5, 16, 50, 84, 97.5 %) of shape (5,
    points) by name in SI, NaN where the model has none.
    """

    label: str
    speed: float | None
    spin: float
    rows: NDArray[np.int64]
    along: FloatArray
    impacts: Impacts
    outputs: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Predictive:
    """Predictions of every observable, the regime sequences of each impact with their posterior probability, and a
    few curves for figures.

    `regimes[i]` maps a sequence in words to its probability at impact i.
    """

    observables: tuple[ObservablePrediction, ...]
    regimes: tuple[Mapping[str, float], ...]
    curves: tuple[Curve, ...]


@dataclass(frozen=True)
class Golden:
    """Impacts with their rebounds at the point estimate, to check ports of the model."""

    parameters: Mapping[str, float]
    impacts: Impacts
    rebound: Rebound


@dataclass(frozen=True)
class LevelEstimate:
    """A parameter at one level (`label` of `column`, with so many `impacts`), in SI; None without a posterior."""

    parameter: str
    column: str
    label: str
    unit: str
    impacts: int
    point: float
    median: float | None
    sd: float | None
    q025: float | None
    q16: float | None
    q84: float | None
    q975: float | None


@dataclass(frozen=True)
class BudgetLine:
    """Errors of one measured column in its SI unit: `numerical` of the arithmetic (largest), `measurement` (median
    sd), and `posterior`, half of the 68 % interval of the noise-free prediction (median; None without a posterior).
    """

    numerical: float
    measurement: float
    posterior: float | None


@dataclass(frozen=True)
class ErrorBudget:
    """Numerical error beside the others, by column; `reference` is what `impacts` rebounds were compared with."""

    impacts: Counted
    reference: str
    lines: Mapping[str, BudgetLine]

    @property
    def share(self) -> float:
        """Largest numerical error as a share of the smaller of measurement and posterior width."""
        shares = [
            line.numerical / min(line.measurement, line.posterior if line.posterior else line.measurement)
            for line in self.lines.values()
        ]
        return max(shares)


@dataclass(frozen=True)
class Timing:
    """Wall time of a stage [s]."""

    stage: str
    seconds: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Record:
    """The content of `fit.json`, numbers in SI. `derived` are quantities that follow from several parameters, those
    at a measured speed first. `notes` are those of table, problem and fit. `covariance` and `correlation` are those
    of the free parameters. `differences` says which parameters differ between levels of labels. Log densities and
    root mean square residuals by column (`rms`) are those at the point estimate; `optima` are all that its search
    found, best first.
    """

    schema_version: Literal[8] = SCHEMA_VERSION
    kind: Literal["fitball fit"] = KIND
    status: RunStatus
    verdict: str
    source: Source
    notes: tuple[str, ...]
    seed: Whole
    parameters: Mapping[str, Estimate]
    derived: Mapping[str, Estimate]
    covariance: FloatArray | None
    correlation: FloatArray | None
    log_posterior: float
    log_likelihood: float
    rms: Mapping[str, float]
    optima: tuple[Mapping[str, float], ...]
    optima_log_posterior: tuple[float, ...]
    least_squares: LeastSquares
    diagnostics: Diagnostics | None
    levels: tuple[LevelEstimate, ...]
    differences: tuple[Difference, ...]
    error_budget: ErrorBudget
    court_pace: CourtPace | None = None
    drop_test: DropTest | None = None
    adequacy: Adequacy | None = None
    assumptions: Assumptions | None = None
    golden: Golden
    identifiability: Identifiability
    fitted: FittedModel
    versions: Mapping[str, str]

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The parameters in order."""
        return tuple(self.parameters.values())

    @property
    def scatter(self) -> tuple[Estimate, ...]:
        """Of the parameters that differ between levels the common value, spread and places."""
        return tuple(self.parameters[name] for item in self.fitted.levels for name in (item.parameter, *item.hidden))

    @property
    def reported(self) -> tuple[Estimate, ...]:
        """The parameters in order, those that differ between levels by their values there; then other quantities that
        follow from them.
        """
        return reported(self.parameters, self.derived, self.fitted.levels)

    @property
    def free_names(self) -> tuple[str, ...]:
        """The parameters that were fitted, in order."""
        return tuple(name for name, item in self.parameters.items() if item.verdict is not Verdict.FIXED)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fit(Record):
    """All that one calibration found: its record, and what lies in files beside `fit.json`.

    A fit that was read back has its `place`, and a function `later` in its dictionary. It reads those files
    when something in them is first asked for. Two fits are equal when they agree to the last digit.
    """

    problem: Problem
    balances: Balances
    point: PointFit
    posterior: Posterior | None
    predictive: Predictive | None
    timings: tuple[Timing, ...] = ()
    place: Path | None = None

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> object:
            """What is not in memory yet. Raises as `later` does."""
            if hasattr(type(self), name):
                # A property that failed: what it lacked, not its own name.
                return object.__getattribute__(self, name)
            if name not in BESIDE or "later" not in self.__dict__:
                own = self.__dict__.get("parameters", ())
                raise AttributeError(f"a fit has no {name!r}{f': see fit.parameters[{name!r}]' * (name in own)}")
            self.__dict__[name] = self.__dict__["later"](self, name)
            return self.__dict__[name]

    @property
    def impacts(self) -> Impacts:
        """Every impact of the fit: of a long table the record holds those alone that span its range."""
        known = self.fitted.impacts
        return known if len(known) == self.source.impacts else self.problem.impacts

    @cached_property
    def predicting(self) -> FittedModel:
        """The fitted model with `PREDICTING` draws, which may be more than its own."""
        posterior = self.posterior
        if posterior is None:
            return self.fitted
        return self.fitted.with_draws(posterior.names, thinned(posterior, PREDICTING))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Fit):
            return NotImplemented
        names = [item.name for item in fields(Record)]
        return self is other or all(same(getattr(self, name), getattr(other, name)) for name in [*names, "posterior"])

    def __hash__(self) -> int:
        return hash((self.verdict, self.seed, tuple(self.parameters)))


# What of a fit is not in its record.
BESIDE = ("problem", "balances", "point", "posterior", "predictive")


def thinned(posterior: Posterior, count: int) -> FloatArray:
    """`count` draws (draws, free), one at random from each of as many equal shares of the chains, or all if fewer.

    At even spaces the same few walkers would recur wherever the spacing and their number have a
    divisor in common. The places depend on the numbers of draws alone.
    """
    draws = posterior.draws
    if draws.shape[0] <= count:
        return draws
    edges = np.arange(count + 1) * draws.shape[0] // count
    rows: FloatArray = draws[np.random.default_rng([draws.shape[0], count]).integers(edges[:-1], edges[1:])]
    return rows
