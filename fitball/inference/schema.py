"""What a fit found: frozen values, SI, nothing computed; the schema of fit.json.

In one module that needs no sampler: reports, exports and batch read results without importing what
makes them.
"""

from collections.abc import Mapping
from math import nan
from typing import Literal, TypeAlias

from msgspec import Struct

from fitball.base.values import FloatArray

Verdict: TypeAlias = Literal[
    "identified", "given", "conditional", "extrapolated", "one-sided", "prior-dominated", "fixed"
]
Answer: TypeAlias = Literal["describes", "describes except", "does not describe", "undecided"]
FitStatus: TypeAlias = Literal["converged", "not converged", "point only"]
Interval: TypeAlias = tuple[float | None, float | None]


class Summary(Struct, frozen=True):
    """A number at the point, and what draws say of it."""

    point: float
    median: float
    sd: float
    q025: float
    q16: float
    q84: float
    q975: float

    @property
    def half(self) -> float:
        """Half of the central 68 %: of a normal distribution its sd, and no few far draws make it
        large.
        """
        return 0.5 * (self.q84 - self.q16)


class PointFit(Struct, frozen=True):
    """The `optima` (all parameters by name) and their log posteriors, best first; log likelihood
    and rms residual by column at the best.
    """

    optima: tuple[Mapping[str, float], ...]
    log_posterior: tuple[float, ...]
    log_likelihood: float
    rms: Mapping[str, float]


class LeastSquares(Struct, frozen=True):
    """By lmfit: no prior but the bounds, errors scaled by chi-square; `stderr` None for the cause
    in `missing`.
    """

    values: Mapping[str, float]
    stderr: Mapping[str, float | None]
    missing: Mapping[str, str]
    chi_square: float
    degrees_of_freedom: int
    aic: float
    bic: float


class Posterior(Struct, frozen=True):
    """Draws after warm-up of the parameters `names`: `values` (ensembles, steps, walkers, free),
    `log_density` (ensembles, steps, walkers). Weighted draws are resampled to one ensemble of one
    walker.
    """

    names: tuple[str, ...]
    values: FloatArray
    log_density: FloatArray


class Diagnostics(Struct, frozen=True):
    """How well draws were made: effective sizes and nested R-hat by parameter (R-hat None for
    weighted draws, which cannot disagree), Pareto k of weights, complaints in words.
    """

    warm_up: int
    steps: int
    acceptance: tuple[float, ...]
    ess_bulk: Mapping[str, float]
    ess_tail: Mapping[str, float]
    r_hat: Mapping[str, float] | None
    pareto_k: float | None
    converged: bool
    complaints: tuple[str, ...]


class Profile(Struct, frozen=True):
    """`drop` (points,) of the log likelihood, scene included, below its maximum, at rising `values`
    (points,). Ends of intervals are None on an open side; 95 % is a drop of n/2 ln(1 + t^2/(n-p)),
    Student's t of n-p. No page shows `interval_68`: it is the standard error of a point fit, for
    who works with `fit.profiles`.
    """

    values: FloatArray
    drop: FloatArray
    interval_68: Interval
    interval_95: Interval


class Judgement(Struct, frozen=True):
    """A verdict, the code of the `rule` that decided, its reason in words, what a determined value
    is `given`; the `contraction` of its prior.
    """

    verdict: Verdict
    rule: str
    reason: str
    given: tuple[str, ...] = ()
    contraction: float = nan


class Estimate(Summary, frozen=True, kw_only=True):
    """A parameter or derived quantity: its `kind` (model, level, noise, camera, ball, derived),
    prior, `contraction` (1 - variance over prior variance, to first order), and its judgement.
    `prior_source` is the work that a published prior is from, for who reads `fit.json` or the
    export `json`; pages name it in a note.
    """

    name: str
    kind: str
    unit: str
    meaning: str
    prior: str
    prior_source: str
    contraction: float
    verdict: Verdict
    rule: str
    reason: str
    given: tuple[str, ...]


class ResidualTest(Struct, frozen=True):
    """A test: `kind` (trend, bias, row, group, parameter, drift, law, growth, outlier, linked),
    `column` ("": all), the `pattern` in words; `p` that any test finds as much; share of the
    variance `explained`.
    """

    kind: str
    column: str
    pattern: str
    p: float
    explained: float
    found: bool


class NoiseCheck(Struct, frozen=True):
    """The noise of a column beside its `reference`, stated or expected; or its scatter `beyond`
    stated errors.
    """

    column: str
    size: float
    reference: float
    stated: bool
    found: bool
    beyond: bool = False


class Adequacy(Struct, frozen=True):
    """The `answer`, the same in a `sentence`; sds by which found patterns would move each value; by
    column the share of the variance that could hide `unseen`.
    """

    answer: Answer
    sentence: str
    tests: tuple[ResidualTest, ...]
    noise: tuple[NoiseCheck, ...]
    moved: Mapping[str, float]
    unseen: Mapping[str, float]


class Alternative(Struct, frozen=True):
    """The fit with a `choice` (offset=grip, noise=student-t) `instead_of` another: `model` and
    `values` predict by it; `score` is its leave-one-out score less the fit's, with standard `error`
    (None below 6 impacts); `as_good`: not surely worse. Or the `reason` why there is none.
    """

    choice: str
    instead_of: str
    model: str
    values: Mapping[str, float]
    summaries: Mapping[str, Summary]
    score: float | None
    error: float
    as_good: bool
    reason: str = ""


class Constant(Struct, frozen=True):
    """A held constant of ball or camera, its range (two stated sds, the ITF's tolerance, or what a
    camera may be off), and the sds that each value moves over half of it.
    """

    name: str
    low: float
    high: float
    moves: Mapping[str, float]
