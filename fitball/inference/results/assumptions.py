"""How results depend on model assumptions, as frozen values; and when a value rests on one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitball.values import FloatArray

# The difference of two scores by left-out impacts, and when it is significant.

# Below this many impacts a leave-one-out score means nothing: five differences give no standard error.
FEW = 6
# Differences of elpd within two standard errors, or below 4, do not distinguish two models (Sivula, Magnusson,
# Matamoros and Vehtari 2020, who also find the standard error too small on few observations).
SURE_ERRORS = 2.0
SURE_SIZE = 4.0


@dataclass(frozen=True)
class ElpdDifference:
    """Difference of two totals of log predictive density with its standard error over impacts."""

    value: float
    se: float

    @property
    def sure(self) -> bool:
        """Whether the difference is significant."""
        return abs(self.value) > max(SURE_ERRORS * self.se, SURE_SIZE)


def elpd_difference(one: FloatArray, other: FloatArray) -> ElpdDifference:
    """Score of `one` minus that of `other`, each (impacts,); its standard error by the impacts' differences."""
    gaps = one - other
    return ElpdDifference(float(gaps.sum()), float(np.sqrt(gaps.size) * np.std(gaps, ddof=1)))


# Sds of a fit's own posterior by which its median, or an end of its 95 % interval, must move for a value to rest on
# an assumption: the other median is then outside of the interval, or the other interval about twice as wide.
MOVED = 2.0
# Levels of a summary.
LEVELS = np.array([0.025, 0.5, 0.975])
# What the scene states that a value may rest on, as it is named in a verdict.
CONTACT_TIME = "contact_time"
# What the rating is called among other quantities.
PACE = "court pace rating"


def own_prior(name: str) -> str:
    """The name of a parameter's prior in the verdict on a value that rests on it."""
    return f"the prior of {name}"


@dataclass(frozen=True)
class Summary:
    """Posterior of one quantity under one choice."""

    median: float
    sd: float
    q025: float
    q975: float


def summary(column: FloatArray, weights: FloatArray) -> Summary:
    """Of draws (draws,) that count by `weights`, among those for which the quantity is finite."""
    known = np.isfinite(column)
    column, weights = column[known], weights[known]
    low, median, high = np.quantile(column, LEVELS, weights=weights, method="inverted_cdf").tolist()
    mean = np.average(column, weights=weights)
    return Summary(median, float(np.sqrt(np.average((column - mean) ** 2, weights=weights))), low, high)


@dataclass(frozen=True)
class Alternative:
    """The fit with the choice `name` (`offset=grip`) `instead_of` another (`offset=contact`), nothing else changed.

    `difference` is its score less that of the fit itself; None, with the `reason`, where there is none. A `reason`
    beside a `difference` names impacts that are not scored. `values` are the parameters at the mean of its posterior,
    for predictions. `parameters` and `court_pace` (points of the ITF's rating by surface) are summaries of quantities
    that the fit has too. `unsettled`: it could be fitted, but not quickly enough to be scored.
    """

    name: str
    instead_of: str
    difference: ElpdDifference | None
    reason: str
    values: Mapping[str, float]
    parameters: Mapping[str, Summary]
    court_pace: Mapping[str, Summary]
    unsettled: bool = False

    @property
    def as_good(self) -> bool:
        """Whether it is not significantly worse than the fit itself, or impacts are too few for a score."""
        if self.difference is None:
            return not self.reason
        return self.difference.value >= 0.0 or not self.difference.sure

    @property
    def better(self) -> bool:
        """Whether it is significantly better than the fit itself."""
        return self.as_good and self.difference is not None and self.difference.sure


@dataclass(frozen=True)
class Span:
    """One quantity over the fit itself and all alternatives that fit equally well.

    `low` and `high` are the lowest and highest median, `q025` and `q975` the outermost ends of the 95 % intervals.
    `own` is the summary within the fit itself. `shift` is the largest move of the median, in the fit's own sds, `by`
    the alternative that makes it. `given` are the choices on which the value depends (see `MOVED`), the strongest
    first.
    """

    own: Summary
    low: float
    high: float
    q025: float
    q975: float
    shift: float
    by: str
    given: tuple[str, ...]


@dataclass(frozen=True)
class Constant:
    """A constant of the ball or of a camera, `held` at its `value` or free under a prior that the scene states, with
    its range `low` to `high`. Of each parameter, and of the rating of each surface, that depends on it: the median at
    both ends, to first order.
    """

    name: str
    held: bool
    value: float
    low: float
    high: float
    parameters: Mapping[str, tuple[float, float]]
    court_pace: Mapping[str, tuple[float, float]]

    @property
    def words(self) -> str:
        """Its name in the verdict on a value that rests on it."""
        return self.name if self.held else own_prior(self.name)


@dataclass(frozen=True)
class Assumptions:
    """Alternatives to each choice, and each quantity over those that fit equally well; or `missing`: why there are
    none. `constants` are those of ball and camera on which something depends; `tilt` is what a tilt of the camera
    would move, of which nothing is stated.
    """

    alternatives: tuple[Alternative, ...]
    parameters: Mapping[str, Span]
    court_pace: Mapping[str, Span]
    missing: str = ""
    constants: tuple[Constant, ...] = field(default_factory=tuple)
    tilt: Constant | None = None

    @property
    def as_good(self) -> tuple[Alternative, ...]:
        """Those that fit as well as the fit itself, or better."""
        return tuple(alternative for alternative in self.alternatives if alternative.as_good)

    @property
    def examined(self) -> bool:
        """Whether everything that could be changed was examined."""
        return not self.missing and not any(alternative.unsettled for alternative in self.alternatives)

    @property
    def given(self) -> Mapping[str, tuple[str, ...]]:
        """By parameter the choices and the constants of the ball that its value rests on."""
        by_constant: dict[str, tuple[str, ...]] = {}
        for constant in self.constants:
            for name in constant.parameters:
                by_constant[name] = (*by_constant.get(name, ()), constant.words)
        return {
            name: (*(self.parameters[name].given if name in self.parameters else ()), *by_constant.get(name, ()))
            for name in {**self.parameters, **by_constant}
        }


def span(own: Summary, others: Sequence[tuple[str, str, Summary]]) -> Span:
    """A quantity over the fit itself and `others`: name, what it replaces, and its summary of the quantity."""
    everyone = [own, *(summary for _name, _instead, summary in others)]
    moves = [(abs(summary.median - own.median), name) for name, _instead, summary in others]
    furthest, by = max(moves, key=lambda move: move[0], default=(0.0, ""))
    reached = sorted(((reach(own, summary), instead) for _name, instead, summary in others), reverse=True)
    return Span(
        own=own,
        low=min(summary.median for summary in everyone),
        high=max(summary.median for summary in everyone),
        q025=min(summary.q025 for summary in everyone),
        q975=max(summary.q975 for summary in everyone),
        shift=furthest / own.sd if own.sd > 0.0 else 0.0,
        by=by,
        given=tuple(dict.fromkeys(instead for distance, instead in reached if distance > MOVED)),
    )


def reach(own: Summary, other: Summary) -> float:
    """How far a quantity moves, in sds of `own`: its median either way, the ends of its 95 % interval outwards."""
    if not own.sd > 0.0:
        return 0.0
    moves = (abs(other.median - own.median), own.q025 - other.q025, other.q975 - own.q975)
    return max(moves) / own.sd


@dataclass(frozen=True)
class Quantity:
    """A parameter, or the court pace rating, in SI: its posterior by each model that has it, best score first.

    `stacked` is that of the mixture by stacking weights, of which those models have a share `weight` (None where it
    is nothing). `span` is over the models that fit equally well, `as_good`: the best, and those not significantly
    worse. None where no model has the quantity.
    """

    unit: str
    by_model: Mapping[str, Summary]
    stacked: Summary | None
    weight: float
    as_good: tuple[str, ...]
    span: Span | None
