"""Four kinds of evidence at how well a table tells a parameter, as frozen values: profile, information, contraction,
power-scaling.

Nothing is computed here; see `profile`, `information`, `identifiability` and `power_scaling`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

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
    """The profile of one parameter: `values` (points,) in SI, rising, and `drop` (points,) of the log likelihood
    below its maximum, which lies at `best`.

    An end of an interval is None where that side is open. `leans_on` names, for each side, other parameters that are
    at a bound where the profile ends: one of physics is part of the model and leaves the side closed, one that only
    ends a search does not where it is all that closes it (`RANGE`). `unsettled` counts points at which the search
    stuck, where the true drop may be smaller.
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
    measurement in it. `missing` says why there are none.
    """

    log_likelihood: float
    scene: bool
    by_name: Mapping[str, Profile]
    missing: str = ""


# Why profiles are missing: those of a large table take some thirty thousand evaluations of all its rows.
LEFT_OUT = "the table is large, and they were left out; fitball plot FIT profiles makes them"


@dataclass(frozen=True)
class InformationEvidence:
    """First-order standard errors of one parameter without any prior, in sds of its prior, from the table with and
    without the scene's contact time (None: the table does not see it at all). `contraction` is what the table is to
    add to priors and scene, `contraction_without_scene` to priors alone.
    """

    error: float | None
    error_without_scene: float | None
    contraction: float
    contraction_without_scene: float


@dataclass(frozen=True)
class Direction:
    """One eigenvector of the information in sds of the priors: its `components` by name, the combination of
    parameters it is in words, and the standard error of that combination in words.
    """

    components: Mapping[str, float]
    words: str
    known_to: str


@dataclass(frozen=True)
class Eigendirections:
    """Directions of parameter space from stiff to sloppy, with and without what the scene knows; `held` are the
    parameters next to whose best value the model ends.
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
    """How much the posterior of one parameter changes when all priors, its own prior, the scene's knowledge, or the
    likelihood are raised to a power near one (Kallioinen et al. 2023), and the diagnosis in words ("" for none).
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
    """Where one parameter moves a rebound: the number of impacts, `acting` of those looked at, in which it does over
    most of the posterior, the `regimes` that these have most often, and the share of its information that comes from
    the `in_doubt` impacts whose regime is in doubt. `impacts` and `doubtful` are the ids of the first NAMED of them.
    """

    impacts: tuple[str, ...]
    acting: int
    of: int
    regimes: tuple[str, ...]
    doubtful: tuple[str, ...]
    in_doubt: int
    share_doubtful: float


@dataclass(frozen=True)
class Evidence:
    """All that is known of how well one parameter is known; None where a kind of evidence could not be had.

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
    """The looks at every free parameter, the spectrum of the information, why profiles are missing, if they are, and
    how often a 95 % interval of a profile holds the truth on a table of this size; `several` says in words which fits
    the table cannot tell apart, if there is more than one.
    """

    evidence: Mapping[str, Evidence]
    eigendirections: Eigendirections
    profiles_missing: str
    profile_coverage: float
    several: str = ""
