"""The results of a fit as frozen values in SI, nothing computed: the schema of fit.json.

They are in one module that needs no sampler: reports, exports and batch read results without
importing what makes them.
"""

from collections.abc import Mapping
from math import nan
from typing import Annotated, Literal, TypeAlias

from msgspec import Struct

from fitball.base.shown import as_html, as_text
from fitball.base.values import DataFrame, FloatArray

Verdict: TypeAlias = Literal[
    "identified", "given", "conditional", "extrapolated", "one-sided", "prior-dominated", "fixed"
]
Answer: TypeAlias = Literal["describes", "describes except", "does not describe", "undecided"]
FitStatus: TypeAlias = Literal["converged", "not converged", "point only"]
# Where the data leave a value open; "" where they do not, or both ways.
Side: TypeAlias = Literal["", "below", "above"]
# Why least squares has no standard error where a parameter moves nothing, or too little.
UNDETERMINED = "the data alone do not determine it"
Interval: TypeAlias = tuple[float | None, float | None]


class Summary(Struct, frozen=True):
    """A quantity in SI: its value at the best fit (`point`), and median, sd and quantiles of its
    draws, NaN where there are none.
    """

    point: float
    median: float
    sd: float
    q025: float
    q16: float
    q84: float
    q975: float

    @property
    def half(self) -> float:
        """Half of the width of the central 68 %. For a normal distribution it is the sd, and a few
        far draws do not make it large.
        """
        return 0.5 * (self.q84 - self.q16)


class PointFit(Struct, frozen=True):
    """The best fit: the `optima` (all parameters by name) and their log posteriors, highest first
    but for the maxima of modes, which come before, that of the largest share first; the log
    likelihood, and the rms residual of each column in SI, at the first.
    """

    optima: tuple[Mapping[str, float], ...]
    log_posterior: tuple[float, ...]
    log_likelihood: float
    rms: Mapping[str, float]


class Mode(Struct, frozen=True):
    """A mode of the posterior, of several: its `share` of the draws with Monte Carlo `error`, and
    the `summaries` of quantities by name, of its draws alone; `point` of each is at its maximum.
    """

    share: float
    error: float
    summaries: Mapping[str, Summary]


class LeastSquares(Struct, frozen=True):
    """The least-squares fit by lmfit: no prior but bounds and what is stated; standard errors by
    how measurements scatter, chi-square by the noise that was expected. Where a `stderr` is None,
    `missing` has the cause in words.
    """

    values: Mapping[str, float]
    stderr: Mapping[str, float | None]
    missing: Mapping[str, str]
    chi_square: float
    degrees_of_freedom: int
    aic: float
    bic: float

    def __repr__(self) -> str:
        return as_text(self._title, self._frame)

    def _repr_html_(self) -> str:
        return as_html(self._title, self._frame)

    @property
    def _title(self) -> str:
        freedom = f"with {self.degrees_of_freedom} degrees of freedom"
        criteria = f"AIC {self.aic:.1f}, BIC {self.bic:.1f}"
        return f"Least squares, in SI: chi-square {self.chi_square:.1f} {freedom}, {criteria}"

    @property
    def _frame(self) -> DataFrame:
        """A row a parameter, with why it has no standard error."""
        import pandas as pd

        frame = pd.DataFrame({"value": self.values, "stderr": self.stderr})
        frame["missing"] = [self.missing.get(name, "") for name in frame.index]
        return frame if self.missing else frame.drop(columns="missing")


class Posterior(Struct, frozen=True):
    """The draws after warm-up of the free parameters `names`, in SI, and their log posterior
    density. Weighted draws, drawn again with equal weights, are the first steps of each ensemble;
    those of fits by earlier builds are one ensemble of one walker.
    """

    names: tuple[str, ...]
    values: Annotated[FloatArray, "ensembles steps walkers parameters"]
    log_density: Annotated[FloatArray, "ensembles steps walkers"]


class Diagnostics(Struct, frozen=True):
    """How well sampling converged: effective sample sizes and nested R-hat by parameter, the Pareto
    k of weights, complaints in words.

    Effective sizes are those of weighted draws and chains together; warm-up, steps, acceptance and
    R-hat are those of the chains. `in_full` says why emcee sampled alone, where it was not enough
    that its chains confirm weighted draws. `pareto_k` is None where no weights are left. Fits by
    earlier builds have no `in_full`; with weights they have no chains, and R-hat is None.
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
    in_full: str = ""

    @property
    def by_weights(self) -> bool:
        """Whether the posterior has weighted draws."""
        return self.pareto_k is not None and not self.in_full


class Profile(Struct, frozen=True):
    """The profile likelihood of a parameter: the `drop` of the log likelihood, scene included,
    below its maximum, at rising `values` in SI.

    Ends of intervals are None on an open side. The 95 % level is a drop of n/2 ln(1 + t^2/(n-p)),
    with t that of Student's t of n-p. No page shows `interval_68`, the standard error of a point
    fit; it is there for users of `fit.profiles`.
    """

    values: Annotated[FloatArray, "points"]
    drop: Annotated[FloatArray, "points"]
    interval_68: Interval
    interval_95: Interval


class Judgement(Struct, frozen=True):
    """The judgement of a quantity: its verdict, the code of the `rule` that decided, the reason in
    words, the assumptions that a determined value is `given`, its `contraction` (1 - variance over
    prior variance, to first order), and the side on which a one-sided value is open.
    """

    verdict: Verdict
    rule: str
    reason: str
    given: tuple[str, ...] = ()
    contraction: float = nan
    open_side: Side = ""


class Estimate(Summary, frozen=True, kw_only=True):
    """A parameter or derived quantity: its `kind` (model, level, noise, camera, ball, derived),
    prior, `contraction` (1 - variance over prior variance, to first order), and its judgement.
    Fits stored by earlier builds have no `open_side`.
    `prior_source` is the work that a published prior is from, for readers of `fit.json` or of the
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
    open_side: Side = ""


class Estimates(dict[str, Estimate]):
    """Estimates by name, shown as a table."""

    def __repr__(self) -> str:
        return as_text("In SI", self._frame)

    def _repr_html_(self) -> str:
        return as_html("In SI", self._frame)

    @property
    def _frame(self) -> DataFrame:
        """A row an estimate; the best value where there are no draws."""
        import pandas as pd

        heads = ("point", "median", "sd", "q025", "q975", "unit", "verdict")
        rows = {name: [getattr(row, head) for head in heads] for name, row in self.items()}
        frame = pd.DataFrame.from_dict(rows, orient="index", columns=list(heads))
        return frame.dropna(axis="columns", how="all")


class ResidualTest(Struct, frozen=True):
    """A test of residuals: its `kind` (trend, bias, row, group, parameter, drift, law, growth,
    outlier, linked, camera), its `column` ("": all), the `pattern` in words; the chance `p` that
    any test finds as much in data that the model describes; the share of the variance that the
    pattern explains; whether it is `found`, that is an exception.
    """

    kind: str
    column: str
    pattern: str
    p: float
    explained: float
    found: bool


class NoiseCheck(Struct, frozen=True):
    """The size of a column's noise in SI beside its `reference`, which was `stated` or is expected,
    and whether it is `found` too large. With `beyond` it is a scatter beyond stated errors.
    """

    column: str
    size: float
    reference: float
    stated: bool
    found: bool
    beyond: bool = False


class Adequacy(Struct, frozen=True):
    """Whether the model describes the data: the `answer`, the same in a `sentence`, and the tests
    behind it. `moved` has by how many sds found patterns move each quantity, `unseen` the share of
    each column's variance that a trend could have without being found.
    """

    answer: Answer
    sentence: str
    tests: tuple[ResidualTest, ...]
    noise: tuple[NoiseCheck, ...]
    moved: Mapping[str, float]
    unseen: Mapping[str, float]


class Alternative(Struct, frozen=True):
    """The fit with a `choice` (offset=grip, noise=student-t) `instead_of` another: `model` and
    `values` predict by it. `score` is its leave-one-out score less the fit's (None below 6
    impacts), with standard `error`; `as_good` means not surely worse, `better` surely better. Where
    the choice could not be tried, the `reason` says why. `unsure` has quantities whose move lies
    at the limit, for all that draws say: the move and its Monte Carlo error, in sds of the fit.
    `unsure_given` has the same of quantities that are *given* something else already: for these no
    draws are added, and none rests on such a move.
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
    better: bool = False
    unsure: Mapping[str, tuple[float, float]] = {}
    unsure_given: Mapping[str, tuple[float, float]] = {}


class Constant(Struct, frozen=True):
    """A held constant of ball or camera, its range in SI (two stated sds, the ITF's tolerance, or
    what a camera may be off), and by how many sds each quantity moves over half of the range.
    """

    name: str
    low: float
    high: float
    moves: Mapping[str, float]
