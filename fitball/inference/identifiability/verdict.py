"""One verdict a parameter: do the data determine it, bound it on one side, or leave it to its prior?

One record of numbers, one table of rules: the first that holds is the verdict, and its template in
`results.sentences` the reason. The posterior decides where there is one, corrected by the profile; else the profile;
of many rows the information.

The marginal likelihood of a parameter is, up to a constant, its posterior density over that of the reference: the
prior with what the scene states. Where that ratio does not fall off towards an end, the data leave that side open.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property

import numpy as np

from fitball.inference.identifiability.information import scene_words
from fitball.inference.identifiability.profile import degrees_of_freedom, left_of, profile_contraction
from fitball.inference.problem.observables import beyond_stated
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter, Prior
from fitball.inference.problem.problem import Problem
from fitball.inference.results import sentences
from fitball.inference.results.assumptions import CONTACT_TIME, own_prior
from fitball.inference.results.evidence import End, Evidence, InformationEvidence, Profile
from fitball.inference.results.results import Verdict
from fitball.inference.results.sentences import listed
from fitball.values import FloatArray

# Share of its peak that the marginal likelihood must keep over the outer twentieth of the reference for that side
# to count as open. A normal likelihood 1.75 times as wide as a normal prior just does.
OPEN_SHARE = 0.5
EDGE = 0.05
# Contraction below which the data add next to nothing, whatever the shape.
NEGLIGIBLE = 0.2
# Loss of contraction without the scene's contact time from which a parameter rests on it, and the contraction by
# data and priors alone below which it is not the data that determine it.
RESTS_ON_SCENE = 0.1
NOT_ALONE = 0.5
# Correlation that is mentioned.
TIED = 0.9
# Share of the information about a parameter from which the impacts it comes from are named, and how many of them.
DRIVEN, NAMED_IN_WORDS = 1.0 / 3.0, 20
# Distance from its bound, in the range of a parameter, at which a profile has reached it.
NEAR_BOUND = 1e-3
# Degrees of freedom of a noise at and below which its variance, scaled inverse chi-square, has no mean.
LEAST_FREEDOM = 2.0
# Ratio of outer twentieths of a posterior that does not fall off towards zero.
VANISHING = 0.1
# The authors' threshold of power-scaling (see `evidence`), and their diagnosis of sensitivity to both.
SENSITIVE, CONFLICT = 0.05, "prior-data conflict"
# Ends of the central 95 % of a prior; levels of a posterior: outer twentieths and central 68 %.
CENTRAL_95, MARGINAL = np.array([0.025, 0.975]), np.array([0.05, 0.16, 0.84, 0.95])
# Levels at which the prior alone is the reference, where what the scene states is to count as evidence.
LEVELS = (np.arange(2000) + 0.5) / 2000


class Source(StrEnum):
    """What a verdict is based on, the best that is available."""

    DRAWS = "posterior"
    PROFILE = "profile"
    INFORMATION = "information"


@dataclass(frozen=True)
class Judgement:
    """Verdict on one parameter, the reason in words, and the scene's or priors' part in a determined value."""

    contraction: float | None
    verdict: Verdict
    reason: str
    given: tuple[str, ...] = ()


@dataclass(frozen=True)
class Marginal:
    """A posterior beside its reference: its `contraction` relative to prior and scene, `narrowed` the one by which it
    is judged, which sides stay open, how many `percent` of the sd are left; in SI at `levels` (see `MARGINAL`).
    `rests`: whether some of the contraction comes from the scene.
    """

    contraction: float
    narrowed: float
    open_sides: tuple[bool, bool]
    percent: float
    levels: tuple[float, ...]
    rests: bool = False


def marginal(prior: Prior, values: FloatArray, before: FloatArray, alone: float | None = None) -> Marginal:
    """Draws (draws,) of a parameter beside those of the prior with the scene, `before` (draws,), in SI; `alone` is as
    in `Numbers`. A size that comes from the scene is judged against the prior alone, because `before` already holds
    what the scene states.
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
    """Whether the marginal likelihood stays high at the left and at the right end of the reference.

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
    """The contraction by data and priors alone of a parameter that the scene touches, None of others: to first order,
    or by its profile `alone` without the scene where that is more (at a bound the first order means little). Zero for
    one that is `traded`: there it comes from the priors of others.
    """
    if look is None or not touched_by_scene(problem, {parameter.name: look}):
        return None
    found = 0.0 if traded else within_support(look.contraction_without_scene, parameter.prior)
    return found if traded or alone is None else max(found, profile_contraction(alone, parameter.prior))


def within_support(contraction: float, prior: Prior) -> float:
    """A contraction to first order, against a normal prior that ends nowhere, as that of a prior with its ends: by
    the variance that a normal likelihood of the same precision, about the prior's median, leaves of it.
    """
    unit = prior.width if prior.bell else prior.width / 12.0**0.5
    precision = contraction / (1.0 - contraction) / unit**2
    return left_of(prior, lambda at: 0.5 * precision * (at - np.median(at)) ** 2)


@dataclass(frozen=True)
class Numbers:
    """All that the verdict on one free parameter is based on. `marginal` is None without a posterior, `value` the
    best one in SI, `alone` the contraction without the scene's contact time, None where that does not touch it.
    `many`: profiles were left out because rows are many, so that the likelihood is near normal. `traded`: only the
    priors of these others hold it. `agreed`: there are several fits, which agree on it. `tied` and `beyond` are parts
    of the reason: with what it is correlated, and that it is extrapolated.
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
        """How much it contracts the reference. That of the information counts the scene with the prior: what rests on
        the scene is judged by its error.
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
        """Whether it is about the same as the reference."""
        return all(self.sides) or self.contraction < NEGLIGIBLE

    @property
    def vanishes(self) -> bool:
        """Whether it is a scatter beyond stated errors that may be nothing at all. Of a half-normal posterior the
        5 % quantile is 3 % of the 95 % one; of one that falls to half of its peak at zero, 9 %.
        """
        if self.parameter.name not in beyond_stated(self.problem.observables) or self.parameter.prior.log:
            return False
        if self.marginal is not None:
            return self.marginal.levels[0] < VANISHING * self.marginal.levels[-1]
        return self.sides[0] and not self.sides[1]

    @property
    def most(self) -> str:
        """What it is below, with a probability of 95 %."""
        if self.marginal is not None:
            return plain(self.marginal.levels[-1], self.parameter.spec.unit)
        assert self.profile is not None
        high = self.profile.interval_95[1]
        assert high is not None
        return plain(high, self.parameter.spec.unit)

    @property
    def closed(self) -> bool:
        """Whether it closes both sides."""
        return not any(self.sides) and not self.nothing

    @property
    def rests(self) -> bool:
        """Whether some of it comes from the scene's contact time: without that its profile would be open."""
        if self.marginal is not None:
            return self.marginal.rests
        opened = self.evidence.alone is not None and any(self.evidence.alone.open_sides)
        return self.alone is not None and (self.traded is not None or (opened and not all(self.sides)))

    @property
    def by_scene(self) -> bool:
        """Whether it is that time that closes it, and not the data."""
        return self.rests and self.alone is not None and self.alone < NOT_ALONE

    @property
    def of_others(self) -> bool:
        """Whether its size is that of other parameters' priors."""
        timed = self.problem.contact_time is not None if self.marginal is None else self.rests
        return self.traded is not None and not timed

    @property
    def heeded(self) -> tuple[bool, bool]:
        """The sides of a posterior that the data do not close, as the profile shows."""
        profile, found = self.profile, self.marginal
        # A level or bias is followed as far as its scatter goes: what would be further out is not known.
        if profile is None or found is None or End.SCATTER in profile.ends:
            return (False, False)
        # And a peak so narrow that the posterior is elsewhere does not show where that ends.
        if self.closed and (self.agreed or not reaches(profile, *found.levels[1:3])):
            return (False, False)
        return profile.open_sides

    @property
    def held_off(self) -> bool:
        """Whether priors, such as the end of a range, keep it away from all that the data allow. Where only the
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
        """Whether its posterior follows both prior and data, whose 95 % intervals do not overlap."""
        power, profile = self.evidence.power, self.profile
        if power is None or profile is None or power.diagnosis != CONFLICT or power.own_prior < SENSITIVE:
            return False
        first, last = self.parameter.prior.quantile(CENTRAL_95)
        return self.parameter.name not in NOISE_SPECS and not reaches(profile, float(first), float(last))

    @property
    def freedom(self) -> float:
        """Degrees of freedom that are left of the measurements whose noise it is."""
        return max(degrees_of_freedom(self.problem, (self.parameter.name,)), 0.0)

    # --- facts of the reasons

    def __getitem__(self, name: str) -> object:
        """A fact by the name that a template gives it."""
        return getattr(self, name)

    @property
    def together(self) -> str:
        """With what it moves, and whose priors hold it."""
        others = self.traded or ()
        whose = "both" if len(others) == 1 else "all"
        return sentences.WITH_WHOM.format(others=listed(others) or sentences.OTHERS, whose=whose)

    @property
    def scene(self) -> str:
        """What of it is the scene's."""
        if self.by_scene:
            return sentences.FROM_SCENE.format(scene=scene_words(self.problem))
        if not self.rests or self.marginal is None:
            return ""
        return sentences.PARTLY_SCENE.format(scene=scene_words(self.problem), alone=self.alone)

    @property
    def bounded(self) -> str:
        """Which bound the posterior gives, or else the profile, and what limits the other side."""
        if self.marginal is None or not any(self.marginal.open_sides):
            return self._bounded_by_profile()
        right = self.marginal.open_sides[1]
        end = plain(self.marginal.levels[0 if right else 3], self.parameter.spec.unit)
        return self._limited(right, end, limit_words(self.problem, self.parameter, right))

    def _limited(self, right: bool, end: str, limit: str) -> str:
        return sentences.BOUNDS[right].format(end=end) + sentences.LIMITED.format(limit=limit)

    def _bounded_by_profile(self) -> str:
        profile, spec = self.profile, self.parameter.spec
        assert profile is not None
        right = profile.open_sides[1]
        at, end = profile.interval_95[not right], profile.ends[right]
        bound = "..." if at is None else plain(at, spec.unit)
        closes = sentences.PRIOR_CLOSES if self.marginal is not None else ""
        if end is End.RANGE:
            searched = sentences.SEARCHED.format(others=listed(profile.leans_on[right]))
            return sentences.BOUNDS[right].format(end=bound) + searched + closes
        # What ends it for all priors.
        near = abs(float(profile.values[-right]) - (spec.lower, spec.upper)[right])
        limit = limit_words(self.problem, self.parameter, right)
        within = near < NEAR_BOUND * (spec.upper - spec.lower)
        if limit != sentences.PRIOR and (within or (not right and end is End.MODEL)):
            return self._limited(right, bound, limit)
        return sentences.BOUNDS[right].format(end=bound) + sentences.PROFILE_IS.format(end=end) + closes

    @property
    def within(self) -> str:
        """The 95 % interval of the profile, an open end as dots."""
        assert self.profile is not None
        low, high = ("..." if end is None else plain(end, "") for end in self.profile.interval_95)
        return f"[{low}, {high}] {self.parameter.spec.unit}".rstrip()

    @property
    def leaning(self) -> str:
        """The bounds of others that a closed profile ends on: part of the model, but mentioned."""
        sides = () if self.profile is None else zip(self.profile.ends, self.profile.leans_on, strict=True)
        names = sorted({name for end, lean in sides if end is End.CLOSED for name in lean})
        at = sentences.ITS_BOUND if len(names) == 1 else sentences.THEIR_BOUNDS
        return sentences.AT_BOUND.format(names=listed(names), at=at) if names else ""

    @property
    def acting(self) -> str:
        """That it acts nowhere, or by what share in impacts whose regime is in doubt."""
        active = self.evidence.active_impacts
        if active is not None and not active.impacts:
            regimes = f" ({', '.join(active.regimes)})" if active.regimes else ""
            return sentences.ACTS_NOWHERE.format(impacts=active.total, regimes=regimes)
        if active is None or active.share_doubtful <= DRIVEN or not active.doubtful:
            return ""
        more = active.in_doubt - NAMED_IN_WORDS
        return sentences.IN_DOUBT.format(
            share=100.0 * active.share_doubtful,
            ids=", ".join(active.doubtful[:NAMED_IN_WORDS]),
            more=sentences.MORE.format(more=more) if more > 0 else "",
        )


# Reasons by what is judged by.
UNCHANGED = {
    Source.DRAWS: sentences.UNCHANGED_BY_DRAWS,
    Source.PROFILE: sentences.UNCHANGED_BY_PROFILE,
    Source.INFORMATION: sentences.UNCHANGED_BY_INFORMATION,
}
KNOWN = {
    Source.DRAWS: sentences.KNOWN_BY_DRAWS,
    Source.PROFILE: sentences.KNOWN_BY_PROFILE,
    Source.INFORMATION: sentences.KNOWN_BY_INFORMATION,
}
NOT_JUDGED, DOMINATED, ONE_SIDED, IDENTIFIED = (
    Verdict.NOT_JUDGED,
    Verdict.PRIOR_DOMINATED,
    Verdict.ONE_SIDED,
    Verdict.IDENTIFIED,
)
# What holds, the verdict then, and why: the first that holds decides.
RULES: tuple[tuple[Callable[[Numbers], bool], Verdict, str | Mapping[Source, str]], ...] = (
    (lambda n: n.of_others, DOMINATED, sentences.TOGETHER),
    (lambda n: n.source is None and n.evidence.information is None, NOT_JUDGED, sentences.NO_EVIDENCE),
    (lambda n: n.source is None, NOT_JUDGED, sentences.NO_PROFILE),
    (lambda n: n.marginal is None and all(n.sides), DOMINATED, sentences.OPEN),
    (lambda n: n.vanishes and n.contraction >= NEGLIGIBLE, ONE_SIDED, sentences.NO_SCATTER),
    (lambda n: n.nothing, DOMINATED, UNCHANGED),
    (lambda n: all(n.heeded), DOMINATED, sentences.NARROWED),
    (lambda n: n.freedom <= LEAST_FREEDOM, DOMINATED, sentences.NO_FREEDOM),
    (lambda n: n.marginal is not None and any(n.sides), ONE_SIDED, sentences.BOUNDED_BY_DRAWS),
    (lambda n: any(n.sides) or any(n.heeded), ONE_SIDED, sentences.BOUNDED_BY_PROFILE),
    (lambda n: n.held_off, DOMINATED, sentences.HELD_OFF),
    (lambda _n: True, IDENTIFIED, KNOWN),
)


def judge(n: Numbers) -> Judgement:
    """The verdict on one free parameter, with its reason and what it is given."""
    verdict, words = next((verdict, words) for holds, verdict, words in RULES if holds(n))
    template = words if isinstance(words, str) else words[n.source or Source.DRAWS]
    reason, given = template.format_map(n), []
    if n.by_scene and verdict is IDENTIFIED:
        given.append(CONTACT_TIME)
    # Whatever the profile of one that others hold does, it does within their ranges.
    if n.traded is None or (n.by_scene and n.closed):
        if n.apart and template != sentences.HELD_OFF and verdict in (IDENTIFIED, DOMINATED):
            reason += sentences.CONTRADICTED.format_map(n)
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
    """What limits an open side of a parameter: a condition of the model, physics, or its prior."""
    demanded = [c for c in problem.model.linear_constraints(problem.impacts) if c.lower_bound_of == parameter.name]
    if demanded and not right:
        return sentences.CONDITION.format(condition=demanded[0].words)
    bound, possible = (parameter.spec.lower, parameter.spec.upper)[right], parameter.spec.beyond[right]
    end = parameter.prior.support[right]
    if bound == possible and end == parameter.prior.ends[right]:
        return sentences.POSSIBLE.format(limit=plain(bound, parameter.spec.unit))
    return sentences.PRIOR


def tied_words(names: tuple[str, ...], correlation: FloatArray, column: int) -> str:
    """With which of the others a parameter is correlated most, if strongly."""
    row = np.abs(correlation[column]).copy()
    row[column] = 0.0
    partner = int(np.argmax(row))
    if row[partner] < TIED:
        return ""
    return sentences.TIED.format(name=names[partner], correlation=correlation[column, partner])


def plain(value: float, unit: str) -> str:
    """A value with its unit, to three digits; thousands are written out."""
    return f"{float(f'{value:.3g}'):g} {unit}".rstrip()
