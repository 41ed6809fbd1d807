"""The evidence on each parameter (profile, information, contraction, power-scaling), and whether the model describes
the data, as frozen values.

Nothing is computed here; see `inference.identifiability` and `inference.adequacy`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from scipy.special import ndtri

from fitball.data.table import FrozenMapping
from fitball.inference.results import sentences
from fitball.values import FloatArray

Interval = tuple[float | None, float | None]


class End(StrEnum):
    """How a profile ends on one side, at the 95 % level."""

    CLOSED = "closed"
    BOUND = "open to the bound"
    MODEL = "open to where the model ends"
    RANGE = "open but for the range searched for others"
    SCATTER = "open but for its own scatter in the model"


@dataclass(frozen=True)
class Profile:
    """The profile likelihood of one parameter: `values` (points,) in SI, rising, and `drop` (points,) of the log
    likelihood below its maximum at `best`. An end of an interval is None where that side is open.

    `leans_on` names, for each side, other parameters that are at a bound where the profile ends. A bound of physics
    is part of the model and leaves the side closed. A bound of the search opens the side if only that closes it
    (`RANGE`). `unsettled` counts points at which the search stuck, where the true drop may be smaller.
    """

    name: str
    values: FloatArray
    drop: FloatArray
    best: float
    interval_68: Interval
    interval_95: Interval
    ends: tuple[End, End]
    leans_on: tuple[tuple[str, ...], tuple[str, ...]]
    unsettled: int

    @property
    def open_sides(self) -> tuple[bool, bool]:
        """Whether the left and the right side are open at the 95 % level."""
        left, right = (end is not End.CLOSED for end in self.ends)
        return left, right


@dataclass(frozen=True)
class Profiles:
    """Profiles by parameter name, the largest log likelihood, and whether the scene's contact time counts as a
    measurement in it. `missing` is the reason why there are none.
    """

    log_likelihood: float
    scene: bool
    by_name: Mapping[str, Profile]
    missing: str = ""


# Why profiles are missing: those of a large table take some thirty thousand evaluations of all its rows.
LEFT_OUT = "the table is large, and they were left out; fitball plot FIT profiles makes them"


@dataclass(frozen=True)
class InformationEvidence:
    """First-order standard errors of one parameter without any prior, in sds of its prior. They come from the data
    with and without the scene's contact time (None: not determined). `contraction` is what the data add to priors and
    scene, `contraction_without_scene` to priors alone.
    """

    error: float | None
    error_without_scene: float | None
    contraction: float
    contraction_without_scene: float


@dataclass(frozen=True)
class Direction:
    """One eigenvector of the information in sds of the priors. It has its `components` by name, that combination of
    parameters in words, and its standard error in words.
    """

    components: Mapping[str, float]
    words: str
    known_to: str


@dataclass(frozen=True)
class Eigendirections:
    """Directions of parameter space from stiff to sloppy, with and without the scene; `held` are the parameters next
    to whose best value the model ends.
    """

    directions: tuple[Direction, ...]
    directions_without_scene: tuple[Direction, ...]
    held: tuple[str, ...]


@dataclass(frozen=True)
class ContractionEvidence:
    """One minus posterior over prior variance, and whether the marginal likelihood stays high at either end."""

    contraction: float
    open_sides: tuple[bool, bool]


@dataclass(frozen=True)
class PowerEvidence:
    """How much the posterior of one parameter changes when a part of the density is raised to a power near one
    (Kallioinen et al. 2023). The parts are all priors, its own prior, the scene and the likelihood; `diagnosis` is in
    words ("" for none).
    """

    prior: float
    own_prior: float
    scene: float | None
    likelihood: float
    diagnosis: str


# Impacts of one kind of evidence that are named, however long the table.
NAMED = 40


@dataclass(frozen=True)
class ActiveImpacts:
    """The impacts in which one parameter changes a rebound over most of the posterior: `acting` of `total` examined.
    `regimes` are those that the impacts have most often. `share_doubtful` of its information comes from the
    `in_doubt` impacts whose regime is uncertain. `impacts` and `doubtful` are the ids of the first NAMED of them.
    """

    impacts: tuple[str, ...]
    acting: int
    total: int
    regimes: tuple[str, ...]
    doubtful: tuple[str, ...]
    in_doubt: int
    share_doubtful: float


@dataclass(frozen=True)
class Evidence:
    """All evidence on one parameter; None where a kind of evidence is missing.

    `alone` is the profile without the scene's contact time, for parameters that it touches.
    """

    profile: Profile | None
    alone: Profile | None
    information: InformationEvidence | None
    contraction: ContractionEvidence | None
    power: PowerEvidence | None
    active_impacts: ActiveImpacts | None


@dataclass(frozen=True)
class Identifiability:
    """The evidence on every free parameter, the spectrum of the information, and why profiles are missing, if they
    are. `profile_coverage` is how often a 95 % interval of a profile covers the truth on a table of this size.
    `several` names the fits that the data cannot distinguish, if there are several.
    """

    evidence: Mapping[str, Evidence]
    eigendirections: Eigendirections
    profiles_missing: str
    profile_coverage: float
    several: str = ""


# Probabilities of a difference below this are not resolved by draws, nor by doubles.
RESOLVED, LEAST = 1e-3, 1e-300
# Probabilities that simulated data are described only with exceptions, or not at all.
FALSE_EXCEPT, FALSE_FAILS = 0.05, 0.01
# A parameter that a misfit shifts by more than so many of its standard deviations is conditional.
MOVED = 1.0
# A noise that is so many times what the scene states is an exception however wide its prior.
FAR_FROM_STATED = 3.0


class Answer(StrEnum):
    """Does the model describe the data?"""

    DESCRIBES = "describes"
    EXCEPT = "describes except"
    FAILS = "does not describe"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class NoiseCheck:
    """The noise of the residuals of `columns` beside the stated (`stated`) or expected one. `assumed`: the scene
    states none, so that the expectation is fitball's default or a chosen prior.

    `fitted` is the root mean square residual by degree of freedom. `reference` is the stated size or the prior's
    median. Both are in `unit`, or in units of the stated sds where these differ by row. `ratio` is the one over the
    other. `p` is the probability of a ratio as large, under the stated noise or the prior; `adjusted` that of any
    noise or pattern as improbable. `found`: it is an exception.
    """

    noise: str
    columns: tuple[str, ...]
    unit: str
    stated: bool
    fitted: float
    reference: float
    degrees_of_freedom: float
    ratio: float
    p: float
    adjusted: float
    found: bool
    assumed: bool = False


@dataclass(frozen=True)
class Check:
    """One test for a pattern in the residuals of `column`, `over` a quantity, a group or another column.

    `statistic` is the observed one and `usual` the 95 % quantile of its size over simulated data sets. `p` is the
    probability that such a data set shows as much in any of all tests. `explained` is the share of the residual
    variance that the pattern explains. `size` is its root mean square in units of the noise (None: it has none).
    """

    kind: str
    column: str
    over: str
    words: str
    statistic: float
    usual: float
    p: float
    explained: float | None
    size: float | None
    found: bool


@dataclass(frozen=True)
class Misfit:
    """One measurement far from its prediction, in SI. `distance` is in sds of the model's prediction for a
    measurement that took no part in the fit (to first order).
    """

    id: str
    column: str
    unit: str
    measured: float
    predicted: float
    distance: float


@dataclass(frozen=True)
class Difference:
    """By how much a parameter differs between the levels of a `column`, from the level where it is `low`est to that
    where it is `high`est, in SI: `size` with its standard deviation and 95 % interval.

    `p` is the probability of as much without any difference, adjusted for the number of looks. `found`: the
    difference is sure. `fitted`: the parameter is fitted to each level; else this is of first order, and `values` are
    those of a quick fit to each, where one was found.
    """

    parameter: str
    column: str
    low: str
    high: str
    unit: str
    size: float
    sd: float
    q025: float
    q975: float
    p: float
    found: bool
    fitted: bool
    values: Mapping[str, float] = field(default_factory=FrozenMapping)

    @property
    def sds(self) -> float:
        """The difference in its standard deviations: of a normal number with the same `p`, as far as draws resolve
        that.
        """
        if self.fitted and self.p < RESOLVED:
            return self.size / self.sd
        return -float(ndtri(0.5 * max(self.p, LEAST)))


@dataclass(frozen=True)
class Adequacy:
    """Whether the model describes the data: the `answer`, the same in a `sentence`, and what it is `based_on`.

    `exceptions` are the findings in words. `moved` is by how many of its sds each free parameter would shift without
    the largest of the patterns. `given` names the kind of noise on which a noise's size depends, where outliers
    enlarge it. `unseen` is, by column, the share of the residual variance that a pattern must explain to be found.
    `loo_pit` are the probabilities that a measurement exceeds its prediction by all other impacts, by column. They
    are empty where impacts are too few, or so many that none matters. `replicates` is the number of simulated data
    sets. `repeats` says what incidences that were measured again show, `scattering` names columns that scatter far
    beyond their stated errors.
    """

    answer: Answer
    sentence: str
    based_on: str
    exceptions: tuple[str, ...]
    noise: tuple[NoiseCheck, ...]
    checks: tuple[Check, ...]
    misfits: tuple[Misfit, ...]
    moved: Mapping[str, float]
    unseen: Mapping[str, float]
    loo_pit: Mapping[str, tuple[float, ...]]
    replicates: int
    given: Mapping[str, tuple[str, ...]] = field(default_factory=FrozenMapping)
    repeats: tuple[str, ...] = ()
    scattering: tuple[str, ...] = ()

    def qualified(self, name: str, reason: str) -> str:
        """The `reason` of the verdict on a conditional parameter, with what it depends on."""
        if self.answer is Answer.FAILS:
            return sentences.IF_RIGHT.format(reason=reason)
        return sentences.IF_MISFIT.format(sds=self.moved[name], reason=reason)

    def conditional(self, name: str) -> bool:
        """Whether the verdict on parameter `name` holds only if the misfits do not matter."""
        return self.answer is Answer.FAILS or self.moved.get(name, 0.0) > MOVED
