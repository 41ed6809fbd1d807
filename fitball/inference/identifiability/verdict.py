"""One verdict a parameter: does the table fix it, bound it from one side, or leave it as it was known?

One record of numbers, one table of rules: the first that holds is the verdict, and its words are the reason. The
posterior decides where there is one, corrected by the profile; else the profile; of long tables the information.

The marginal likelihood of a parameter is, up to a constant, its posterior density over its density before the table
(the reference). Where that ratio does not fall off towards an end of the posterior, the table leaves that side open.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from fitball.inference.identifiability.information import scene_words
from fitball.inference.identifiability.profile import degrees_of_freedom, left_of, profile_contraction
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.priors import Prior
from fitball.inference.problem.problem import Problem
from fitball.inference.results.assumptions import CONTACT_TIME, own_prior
from fitball.inference.results.evidence import End, Evidence, InformationEvidence, Profile
from fitball.inference.results.results import Verdict
from fitball.values import FloatArray

# Share of its peak that the marginal likelihood must keep over the outer twentieth of what was possible before for
# that side to count as open. A normal likelihood 1.75 times as wide as a normal prior just does.
OPEN_SHARE = 0.5
EDGE = 0.05
# Contraction below which the table added next to nothing, whatever the shape.
NEGLIGIBLE = 0.2
# Loss of contraction without the scene's contact time from which a parameter is said to rest on it, and the
# contraction by table and priors alone below which it is not the table that fixes it.
RESTS_ON_SCENE = 0.1
NOT_ALONE = 0.5
# Correlation worth naming.
TIED = 0.9
# Share of the information about a parameter that makes the impacts it comes from worth naming, and of these those
# that a sentence names.
DRIVEN, NAMED_IN_WORDS = 1.0 / 3.0, 20
# Distance from its bound, in the range of a parameter, at which a profile has come to it.
NEAR_BOUND = 1e-3
# Degrees of freedom of a noise at and below which its variance, scaled inverse chi-square, has no mean.
LEAST_FREEDOM = 2.0
# The authors' threshold of power-scaling (see `evidence`), and what a sensitivity to prior and likelihood says.
SENSITIVE, CONFLICT = 0.05, "prior-data conflict"
# Ends of the central 95 % of a prior; levels of a posterior: outer twentieths and central 68 %.
CENTRAL_95, MARGINAL = np.array([0.025, 0.975]), np.array([0.05, 0.16, 0.84, 0.95])
# Levels at which a prior stands for what was known before, where the scene's knowledge is to count as evidence.
LEVELS = (np.arange(2000) + 0.5) / 2000
# What ends an open side that nothing else ends.
PRIOR = "the prior"


class Source(StrEnum):
    """What a verdict rests on, the best there is."""

    DRAWS = "posterior"
    PROFILE = "profile"
    INFORMATION = "information"


@dataclass(frozen=True)
class Judgement:
    """Verdict on one parameter, the reason in words, what of the scene or of priors an identified value rests on."""

    contraction: float | None
    verdict: Verdict
    reason: str
    given: tuple[str, ...] = ()


@dataclass(frozen=True)
class Marginal:
    """A posterior beside what it is judged against: its `contraction` by the table beyond all that was known before,
    `narrowed` that by which it is judged, which sides stay open, how many `percent` of the sd are left; in SI at
    `levels` (see `MARGINAL`). `rests` says whether some of the contraction is the scene's.
    """

    contraction: float
    narrowed: float
    open_sides: tuple[bool, bool]
    percent: float
    levels: tuple[float, ...]
    rests: bool = False


def marginal(prior: Prior, values: FloatArray, before: FloatArray, alone: float | None = None) -> Marginal:
    """Draws (draws,) of a parameter beside those of what was known `before` (draws,), in SI; `alone` is as in
    `Numbers`. A size that is the scene's is judged against the prior itself, because what was known before already
    holds what the scene knows.
    """
    after, reference = prior.coordinate(values), prior.coordinate(before)
    contraction = 1.0 - float(np.var(after) / np.var(reference))
    rests = alone is not None and 1.0 - float(np.var(after)) / prior.variance - alone > RESTS_ON_SCENE
    if rests and alone is not None and alone < NOT_ALONE:
        reference = prior.coordinate(prior.quantile(LEVELS))
    share = float(np.var(after) / np.var(reference))
    levels = tuple(np.quantile(values, MARGINAL).tolist())
    return Marginal(contraction, 1.0 - share, open_ends(after, reference), 100.0 * share**0.5, levels, rests)


def open_ends(after: FloatArray, before: FloatArray) -> tuple[bool, bool]:
    """Whether the marginal likelihood stays high at the left and at the right end of what was possible before.

    With `u` the place of a posterior draw `after` among the reference draws `before` (0 to 1), the density of `u` is
    the marginal likelihood up to a constant; its mean over each outer twentieth is compared with its peak over the
    deciles of the posterior.
    """
    ordered = np.sort(before)
    place = np.interp(after, ordered, (np.arange(ordered.size) + 0.5) / ordered.size)
    deciles = np.quantile(place, np.linspace(0.0, 1.0, 11))
    # A posterior far narrower than the spacing of the reference has no width here: its peak is infinite.
    narrowest = float(np.min(np.diff(deciles)))
    left, right = np.mean(place < EDGE) / EDGE, np.mean(place > 1.0 - EDGE) / EDGE
    return bool(left * narrowest > OPEN_SHARE * 0.1), bool(right * narrowest > OPEN_SHARE * 0.1)


def touched_by_scene(problem: Problem, information: Mapping[str, InformationEvidence]) -> list[str]:
    """Names of the parameters whose standard error the scene's contact time changes."""
    if problem.contact_time is None:
        return []
    return [
        name
        for name, look in information.items()
        if look.error is not None
        and (look.error_without_scene is None or look.error_without_scene > (1.0 + RESTS_ON_SCENE) * look.error)
    ]


def contraction_alone(
    problem: Problem, parameter: Parameter, look: InformationEvidence | None, alone: Profile | None, traded: bool
) -> float | None:
    """The contraction by table and priors alone of a parameter that the scene touches, None of others: to first
    order,
    or by its profile `alone` without the scene where that says more (at a bound the first order means little).
    Nothing of one that is `traded`: there it is the priors of others.
    """
    if look is None or not touched_by_scene(problem, {parameter.name: look}):
        return None
    found = 0.0 if traded else within_support(look.contraction_without_scene, parameter.prior)
    return found if traded or alone is None else max(found, profile_contraction(alone, parameter.prior))


def within_support(contraction: float, prior: Prior) -> float:
    """A contraction to first order, against a normal prior that ends nowhere, as that of a prior with its ends: by
    the variance that a normal likelihood of the same precision, about the prior's median, leaves of it.
    """
    unit = prior.width if prior.normal else prior.width / 12.0**0.5
    precision = contraction / (1.0 - contraction) / unit**2
    return left_of(prior, lambda at: 0.5 * precision * (at - np.median(at)) ** 2)


@dataclass(frozen=True)
class Numbers:
    """All that the verdict on one free parameter rests on. `marginal` is None without a posterior, `value` the best
    one in SI, `alone` the contraction without the scene's contact time, None where that does not touch it; `many`
    says that profiles were left out because rows are many, so that the likelihood is near normal; `traded` that only
    the priors of others hold it, and which; `agreed` that there are several fits, which agree on it; `tied` in words
    to what its draws are, `beyond` that it is a value where nothing was measured.
    """

    problem: Problem
    parameter: Parameter
    evidence: Evidence
    marginal: Marginal | None = None
    value: float | None = None
    alone: float | None = None
    many: bool = False
    traded: tuple[str, ...] | None = None
    agreed: bool = False
    tied: str = ""
    beyond: str = ""

    @property
    def profile(self) -> Profile | None:
        """That with the scene's contact time."""
        return self.evidence.profile

    @property
    def source(self) -> Source | None:
        """What is judged by: the posterior, else the profile, else the information where rows are many."""
        if self.marginal is not None:
            return Source.DRAWS
        if self.profile is not None:
            return Source.PROFILE
        return Source.INFORMATION if self.many and self.evidence.information is not None else None

    @property
    def sides(self) -> tuple[bool, bool]:
        """Which sides that leaves open."""
        seen = self.profile if self.marginal is None else self.marginal
        return (False, False) if seen is None else seen.open_sides

    @cached_property
    def contraction(self) -> float:
        """What it adds to what was known before. What the scene knows stands before the table in that of the
        information: of what rests on it the error judges.
        """
        look = self.evidence.information
        if self.marginal is not None:
            return self.marginal.narrowed
        if self.profile is not None:
            return profile_contraction(self.profile, self.parameter.prior)
        if look is None or look.error is None:
            return 0.0
        return look.contraction if self.traded is None else 1.0 / (1.0 + look.error**2)

    @property
    def nothing(self) -> bool:
        """Whether it is about what was known before."""
        return all(self.sides) or self.contraction < NEGLIGIBLE

    @property
    def closed(self) -> bool:
        """Whether it closes both sides."""
        return not any(self.sides) and not self.nothing

    @property
    def rests(self) -> bool:
        """Whether some of it is known by the scene's contact time: without that its profile would be open."""
        if self.marginal is not None:
            return self.marginal.rests
        opened = self.evidence.alone is not None and any(self.evidence.alone.open_sides)
        return self.alone is not None and (self.traded is not None or (opened and not all(self.sides)))

    @property
    def by_scene(self) -> bool:
        """Whether it is that time that closes it, and not the table."""
        return self.rests and self.alone is not None and self.alone < NOT_ALONE

    @property
    def of_others(self) -> bool:
        """Whether its size is that of other parameters' priors."""
        timed = self.problem.contact_time is not None if self.marginal is None else self.rests
        return self.traded is not None and not timed

    @property
    def heeded(self) -> tuple[bool, bool]:
        """The sides of a posterior that it is not the table that closes, as the profile shows."""
        profile, told = self.profile, self.marginal
        # A level or bias is followed as far as its scatter goes: what would be further out is not known.
        if profile is None or told is None or End.SCATTER in profile.ends:
            return (False, False)
        # And a peak so narrow that the posterior is elsewhere says nothing of where that ends.
        if self.closed and (self.agreed or not reaches(profile, *told.levels[1:3])):
            return (False, False)
        return profile.open_sides

    @property
    def held_off(self) -> bool:
        """Whether priors, such as the end of a range, keep it away from all that the table allows it. Where only the
        posterior's middle lies elsewhere the profile is a narrow peak, and no prior holds it off. The profile of a
        noise is no judge: with few rows it lies too low.
        """
        middle = () if self.marginal is None else self.marginal.levels[1:3]
        known = [at for at in (self.value, *middle) if at is not None]
        if self.profile is None or self.agreed or not known or self.parameter.name in NOISE_SPECS:
            return False
        return not reaches(self.profile, min(known), max(known))

    @property
    def apart(self) -> bool:
        """Whether its posterior follows its prior and the table, which have no 95 % in common."""
        power, profile = self.evidence.power, self.profile
        if power is None or profile is None or power.diagnosis != CONFLICT or power.own_prior < SENSITIVE:
            return False
        first, last = self.parameter.prior.quantile(CENTRAL_95)
        return self.parameter.name not in NOISE_SPECS and not reaches(profile, float(first), float(last))

    @property
    def freedom(self) -> float:
        """Degrees of freedom that are left of the measurements whose noise it is."""
        return max(degrees_of_freedom(self.problem, (self.parameter.name,)), 0.0)

    # --- words of the reasons

    @property
    def together(self) -> str:
        """With what it moves, and whose priors hold it."""
        others = self.traded or ()
        with_whom = " and ".join(others) or "others"
        return f"{with_whom}: its own size comes from the priors of {'both' if len(others) == 1 else 'all'}"

    @property
    def scene(self) -> str:
        """What of it is the scene's."""
        if self.by_scene:
            return f"; its size comes from {scene_words(self.problem)}"
        if not self.rests or self.marginal is None:
            return ""
        return f"; rests on {scene_words(self.problem)}, without it the contraction would be {self.alone:.2f}"

    @property
    def bounded(self) -> str:
        """From which side the posterior bounds it, or else the profile, and what ends the other side."""
        if self.marginal is None or not any(self.marginal.open_sides):
            return self._bounded_by_profile()
        right = self.marginal.open_sides[1]
        end = plain(self.marginal.levels[0 if right else 3], self.parameter.spec.unit)
        return f"{_side(right, end)} it is limited by {limit_words(self.problem, self.parameter, right)}"

    def _bounded_by_profile(self) -> str:
        profile, spec = self.profile, self.parameter.spec
        assert profile is not None
        right = profile.open_sides[1]
        at, end = profile.interval_95[not right], profile.ends[right]
        head = _side(right, "..." if at is None else plain(at, spec.unit))
        ends = "; there its prior closes the posterior" if self.marginal is not None else ""
        if end is End.RANGE:
            others = ", ".join(profile.leans_on[right])
            return f"{head} the profile falls only because {others} was searched no further{ends}"
        # What ends it for all priors.
        near = abs(float(profile.values[-right]) - (spec.lower, spec.upper)[right])
        limit = limit_words(self.problem, self.parameter, right)
        if limit != PRIOR and (near < NEAR_BOUND * (spec.upper - spec.lower) or (not right and end is End.MODEL)):
            return f"{head} it is limited by {limit}"
        return f"{head} the profile stays {end}{ends}"

    @property
    def within(self) -> str:
        """The 95 % interval of the profile, an open end as dots."""
        assert self.profile is not None
        low, high = ("..." if end is None else plain(end, "") for end in self.profile.interval_95)
        return f"[{low}, {high}] {self.parameter.spec.unit}".rstrip()

    @property
    def leaning(self) -> str:
        """The bounds of others that a closed profile ends on: part of the model, but worth knowing."""
        sides = () if self.profile is None else zip(self.profile.ends, self.profile.leans_on, strict=True)
        names = sorted({name for end, lean in sides if end is End.CLOSED for name in lean})
        if not names:
            return ""
        lies = "lies on its bound" if len(names) == 1 else "lie on their bounds"
        return f"; where its profile ends, {' and '.join(names)} {lies}"

    @property
    def acting(self) -> str:
        """That it acts nowhere, or by what share in impacts whose regime is in doubt."""
        active = self.evidence.active_impacts
        if active is not None and not active.impacts:
            where = f" ({', '.join(active.regimes)})" if active.regimes else ""
            return f"; at these values it moves the rebound of none of the {active.of} impacts{where}"
        if active is None or active.share_doubtful <= DRIVEN or not active.doubtful:
            return ""
        more = f" and {active.in_doubt - NAMED_IN_WORDS:,} more" if active.in_doubt > NAMED_IN_WORDS else ""
        return (
            f"; {100.0 * active.share_doubtful:.0f} % of what the table says of it comes from impacts whose regime "
            f"is in doubt ({', '.join(active.doubtful[:NAMED_IN_WORDS])}{more})"
        )


AS_BEFORE = "the table leaves it as it was known before"
HELD_OFF = "priors, its own or others', keep it from where the table alone has it: 95 % within {n.within}"
# Reasons by what is judged by.
UNTOLD = {
    Source.DRAWS: f"{AS_BEFORE} (contraction {{n.contraction:.2f}}){{n.scene}}{{n.tied}}",
    Source.PROFILE: f"the table adds next to nothing to its prior: {AS_BEFORE}",
    Source.INFORMATION: f"to first order {AS_BEFORE}",
}
TOLD = {
    Source.DRAWS: "the table narrows it from both sides to {n.marginal.percent:.2g} % of what was known before"
    "{n.scene}{n.tied}",
    Source.PROFILE: "the profile is closed on both sides, 95 % within {n.within}{n.scene}",
    Source.INFORMATION: "known to {n.evidence.information.error:.2g} sd of its prior, to first order{n.scene}",
}
NOT_JUDGED, NOT_TOLD, ONE_SIDED, IDENTIFIED = (
    Verdict.NOT_JUDGED,
    Verdict.PRIOR_DOMINATED,
    Verdict.ONE_SIDED,
    Verdict.IDENTIFIED,
)
# What holds, the verdict then, and why: the first that holds decides.
RULES: tuple[tuple[Callable[[Numbers], bool], Verdict, str | Mapping[Source, str]], ...] = (
    (lambda n: n.of_others, NOT_TOLD, "the table tells it only together with {n.together}{n.tied}"),
    (lambda n: n.source is None and n.evidence.information is None, NOT_JUDGED, "a point fit alone cannot tell"),
    (lambda n: n.source is None, NOT_JUDGED, "there is no profile, and a point fit alone cannot tell"),
    (lambda n: n.marginal is None and all(n.sides), NOT_TOLD, f"the profile is open on both sides: {AS_BEFORE}"),
    (lambda n: n.nothing, NOT_TOLD, UNTOLD),
    (
        lambda n: all(n.heeded),
        NOT_TOLD,
        "the profile is open on both sides: the priors, its own or others', narrow it, not the table",
    ),
    (
        lambda n: n.freedom <= LEAST_FREEDOM,
        NOT_TOLD,
        "the parameters leave its measurements {n.freedom:.2g} degrees of freedom, and the table no mean of its "
        "variance: its size comes from its prior",
    ),
    (lambda n: n.marginal is not None and any(n.sides), ONE_SIDED, "{n.bounded}{n.scene}{n.tied}"),
    (lambda n: any(n.sides) or any(n.heeded), ONE_SIDED, "{n.bounded}"),
    (lambda n: n.held_off, NOT_TOLD, HELD_OFF),
    (lambda _n: True, IDENTIFIED, TOLD),
)


def judge(n: Numbers) -> Judgement:
    """The verdict on one free parameter, with its reason and what it is given."""
    verdict, words = next((verdict, words) for holds, verdict, words in RULES if holds(n))
    template = words if isinstance(words, str) else words[n.source or Source.DRAWS]
    reason, given = template.format(n=n), []
    if n.by_scene and verdict is IDENTIFIED:
        given.append(CONTACT_TIME)
    # Whatever the profile of one that others hold does, it does within their ranges.
    if n.traded is None or (n.by_scene and n.closed):
        if n.apart and template != HELD_OFF and verdict in (IDENTIFIED, NOT_TOLD):
            reason += f"; its prior and the table disagree: the table alone has it within {n.within}"
            given += [own_prior(n.parameter.name)] * (verdict is IDENTIFIED)
        reason += n.leaning + n.acting
    if n.beyond:
        verdict, reason = Verdict.EXTRAPOLATED, f"{n.beyond}; {reason}"
    return Judgement(None if n.marginal is None else n.marginal.contraction, verdict, reason, tuple(given))


def reaches(profile: Profile, first: float, last: float) -> bool:
    """Whether a 95 % interval of a profile has anything from `first` to `last`; an open end reaches everywhere."""
    low, high = profile.interval_95
    return (low is None or low <= last) and (high is None or first <= high)


def limit_words(problem: Problem, parameter: Parameter, right: bool) -> str:
    """What ends an open side of a parameter: what the model demands, what is possible, or its prior."""
    demanded = [c for c in problem.model.linear_constraints(problem.impacts) if c.lower_bound_of == parameter.name]
    if demanded and not right:
        return f"{demanded[0].words}, which the model demands"
    bound, possible = (parameter.spec.lower, parameter.spec.upper)[right], parameter.spec.beyond[right]
    end = parameter.prior.support[right]
    if bound == possible and end == parameter.prior.ends[right]:
        return f"what is possible, {plain(bound, parameter.spec.unit)}"
    return PRIOR


def _side(right: bool, end: str) -> str:
    side, sign, way = ("below", ">", "upwards") if right else ("above", "<", "downwards")
    return f"the table bounds it from {side} only ({sign} {end} with 95 %); {way}"


def tied_words(names: tuple[str, ...], correlation: FloatArray, column: int) -> str:
    """To which of the others the draws of a parameter are tied."""
    row = np.abs(correlation[column]).copy()
    row[column] = 0.0
    partner = int(np.argmax(row))
    if row[partner] < TIED:
        return ""
    return f"; tied to {names[partner]} (correlation {correlation[column, partner]:.2f})"


def plain(value: float, unit: str) -> str:
    """A value with its unit, to three digits; thousands are written out."""
    return f"{float(f'{value:.3g}'):g} {unit}".rstrip()
