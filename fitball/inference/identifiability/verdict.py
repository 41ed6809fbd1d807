"""Four kinds of evidence, one verdict: the posterior's where there is one, corrected by the profile."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fitball.inference.identifiability.posterior_verdict import (
    NEGLIGIBLE,
    PRIOR,
    Judgement,
    limit_words,
    plain,
    traded_words,
)
from fitball.inference.identifiability.power_scaling import CONFLICT, SENSITIVE
from fitball.inference.identifiability.profile import degrees_of_freedom
from fitball.inference.identifiability.profile_ends import profile_contraction
from fitball.inference.identifiability.scene_share import known_by_scene, scene_words
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results.assumptions import CONTACT_TIME, own_prior
from fitball.inference.results.evidence import (
    ActiveImpacts,
    End,
    Evidence,
    InformationEvidence,
    Profile,
)
from fitball.inference.results.results import Verdict

# Share of the information about a parameter that makes the impacts it comes from worth naming.
DRIVEN = 1.0 / 3.0
# Distance from its bound, in the range of a parameter, at which a profile has come to it.
NEAR_BOUND = 1e-3
# Degrees of freedom of a noise at and below which its variance, scaled inverse chi-square, has no mean.
LEAST_FREEDOM = 2.0
# Ends of the central 95 %.
CENTRAL_95 = (0.025, 0.975)
# Impacts that a sentence names.
NAMED_IN_WORDS = 20


def combine(
    problem: Problem,
    parameter: Parameter,
    base: Judgement | None,
    evidence: Evidence,
    *,
    value: float | None = None,
    many: bool = False,
    traded: Sequence[str] | None = None,
    agreed: bool = False,
) -> Judgement:
    """The verdict on one free parameter; `base` is that of the posterior, `value` the best one in SI, `many` says
    that profiles were left out because rows are many, `traded` that only the priors of others hold it, and which,
    `agreed` that there are several fits, which agree on it.
    """
    judged = (
        from_profile(problem, parameter, evidence, many, traded)
        if base is None
        else base
        if agreed and base.verdict is Verdict.IDENTIFIED
        else _corrected(problem, parameter, base, evidence)
    )
    if traded is not None and not judged.given:
        # Whatever its profile does, it does within the ranges of others.
        return judged
    freedom = degrees_of_freedom(problem, (parameter.name,))
    if judged.verdict in (Verdict.IDENTIFIED, Verdict.ONE_SIDED) and freedom <= LEAST_FREEDOM:
        judged = replace(judged, verdict=Verdict.PRIOR_DOMINATED, reason=_few_words(freedom))
    held_off = False
    if judged.verdict is Verdict.IDENTIFIED and evidence.profile is not None:
        # Where only the posterior's middle lies elsewhere the profile is a narrow peak, and no prior holds it off.
        known = [at for at in (value, *((base and base.middle) or ())) if at is not None]
        held_off = bool(known) and not agreed and not _reaches(evidence.profile, min(known), max(known))
        if held_off:
            judged = _held_off(parameter, judged, evidence.profile)
    told = judged.verdict in (Verdict.IDENTIFIED, Verdict.PRIOR_DOMINATED) and not held_off
    if told and _apart_from_prior(parameter, evidence):
        apart = f"; its prior and the table disagree: the table alone has it within {_within(parameter, evidence)}"
        given = (own_prior(parameter.name),) if judged.verdict is Verdict.IDENTIFIED else ()
        judged = replace(judged, reason=judged.reason + apart, given=(*judged.given, *given))
    remarks = _leaning(evidence.profile) + _active(evidence.active_impacts)
    return replace(judged, reason=judged.reason + remarks)


def _within(parameter: Parameter, evidence: Evidence) -> str:
    return "" if evidence.profile is None else interval(evidence.profile, parameter.spec.unit)


def _apart_from_prior(parameter: Parameter, evidence: Evidence) -> bool:
    """Whether a posterior follows its prior and the table, which have no 95 % in common."""
    power, profile = evidence.power, evidence.profile
    if power is None or profile is None or power.diagnosis != CONFLICT or power.own_prior < SENSITIVE:
        return False
    first, last = parameter.prior.quantile(np.array(CENTRAL_95))
    return parameter.name not in NOISE_SPECS and not _reaches(profile, float(first), float(last))


def _few_words(freedom: float) -> str:
    return (
        f"the parameters leave its measurements {max(freedom, 0.0):.2g} degrees of freedom, and the table no mean of "
        "its variance: its size comes from its prior"
    )


def from_profile(
    problem: Problem,
    parameter: Parameter,
    evidence: Evidence,
    many: bool = False,
    traded: Sequence[str] | None = None,
) -> Judgement:
    """The verdict without a posterior, from the profile and the information; from the information alone where rows
    are `many`, so that the likelihood is near normal; `traded` as in `combine`.
    """
    profile, information = evidence.profile, evidence.information
    if traded is not None and problem.contact_time is None:
        return Judgement(None, Verdict.PRIOR_DOMINATED, traded_words(traded))
    if profile is None:
        if information is None:
            return Judgement(None, Verdict.NOT_JUDGED, "a point fit alone cannot tell")
        return _from_information(problem, information, many, traded is not None)
    judged = _by_profile(problem, parameter, profile)
    if judged.verdict is Verdict.IDENTIFIED and known_by_scene(problem, parameter, evidence, traded is not None):
        source = f"its size comes from {scene_words(problem)}"
        return replace(judged, reason=f"{judged.reason}; {source}", given=(CONTACT_TIME,))
    return judged


def _by_profile(problem: Problem, parameter: Parameter, profile: Profile) -> Judgement:
    unit = parameter.spec.unit
    left, right = profile.open_sides
    if (left and right) or profile_contraction(profile, parameter.prior) < NEGLIGIBLE:
        words = (
            "the profile is open on both sides" if left and right else "the table adds next to nothing to its prior"
        )
        return Judgement(None, Verdict.PRIOR_DOMINATED, f"{words}: the table leaves it as it was known before")
    if left or right:
        return Judgement(None, Verdict.ONE_SIDED, _one_sided_words(problem, parameter, profile))
    return Judgement(
        None, Verdict.IDENTIFIED, f"the profile is closed on both sides, 95 % within {interval(profile, unit)}"
    )


def _from_information(problem: Problem, look: InformationEvidence, many: bool, traded: bool) -> Judgement:
    if not many:
        return Judgement(None, Verdict.NOT_JUDGED, "there is no profile, and a point fit alone cannot tell")
    # What the scene knows stands before the table in a contraction: of what rests on it the error judges.
    if look.error is None or (1.0 / (1.0 + look.error**2) if traded else look.contraction) < NEGLIGIBLE:
        return Judgement(None, Verdict.PRIOR_DOMINATED, "to first order the table leaves it as it was known before")
    words = f"known to {look.error:.2g} sd of its prior, to first order"
    if traded:
        words = f"{words}; its size comes from {scene_words(problem)}"
        return Judgement(None, Verdict.IDENTIFIED, words, given=(CONTACT_TIME,))
    return Judgement(None, Verdict.IDENTIFIED, words)


def interval(profile: Profile, unit: str) -> str:
    """The 95 % interval in words, an open end as dots."""
    low, high = ("..." if end is None else plain(end, "") for end in profile.interval_95)
    return f"[{low}, {high}] {unit}".rstrip()


def _one_sided_words(problem: Problem, parameter: Parameter, profile: Profile) -> str:
    (low, high), right = profile.interval_95, profile.open_sides[1]
    side, end, sign = ("below", low, ">") if right else ("above", high, "<")
    known = "..." if end is None else plain(end, parameter.spec.unit)
    return (
        f"the table bounds it from {side} only ({sign} {known} with 95 %); "
        f"{'upwards' if right else 'downwards'} {_why_open(problem, parameter, profile, right)}"
    )


def _why_open(problem: Problem, parameter: Parameter, profile: Profile, right: bool) -> str:
    end, lean = profile.ends[right], ", ".join(profile.leans_on[right])
    if end is End.RANGE:
        return f"the profile falls only because {lean} was searched no further"
    limit = _limited(problem, parameter, profile, right)
    return f"it is limited by {limit}" if limit else f"the profile stays {end}"


def _limited(problem: Problem, parameter: Parameter, profile: Profile, right: bool) -> str:
    """What ends an open side of a profile for all priors, empty where that is none of physics."""
    spec, at = parameter.spec, float(profile.values[-right])
    bound = (spec.lower, spec.upper)[right]
    reached = abs(at - bound) < NEAR_BOUND * (spec.upper - spec.lower)
    demanded = not right and profile.ends[0] is End.MODEL
    limit = limit_words(problem, parameter, right)
    return limit if limit != PRIOR and profile.ends[right] is not End.RANGE and (reached or demanded) else ""


def _leaning(profile: Profile | None) -> str:
    """The bounds of others that a closed profile ends on: part of the model, but worth knowing."""
    if profile is None:
        return ""
    names = {
        name for end, lean in zip(profile.ends, profile.leans_on, strict=True) if end is End.CLOSED for name in lean
    }
    if not names:
        return ""
    named = " and ".join(sorted(names))
    return f"; where its profile ends, {named} {'lies on its bound' if len(names) == 1 else 'lie on their bounds'}"


def _corrected(problem: Problem, parameter: Parameter, base: Judgement, evidence: Evidence) -> Judgement:
    """The posterior's verdict, where the profile shows that it is not the table that closes a side."""
    profile = evidence.profile
    if profile is None or base.verdict is Verdict.PRIOR_DOMINATED or not any(profile.open_sides):
        return base
    # A level or bias is followed as far as its scatter goes: what would be further out is not known.
    if End.SCATTER in profile.ends:
        return base
    # A peak so narrow that the posterior is elsewhere says nothing of where that ends.
    if base.middle is not None and not _reaches(profile, *base.middle):
        return base
    left, right = profile.open_sides
    if left and right:
        return replace(
            base,
            verdict=Verdict.PRIOR_DOMINATED,
            reason="the profile is open on both sides: the priors, its own or others', narrow it, not the table",
        )
    if base.verdict is Verdict.ONE_SIDED:
        return base
    words = _one_sided_words(problem, parameter, profile)
    if not _limited(problem, parameter, profile, right):
        words += "; there its prior closes the posterior"
    return replace(base, verdict=Verdict.ONE_SIDED, reason=words)


def _reaches(profile: Profile, first: float, last: float) -> bool:
    """Whether a 95 % interval of a profile has anything from `first` to `last`; an open end reaches everywhere."""
    low, high = profile.interval_95
    return (low is None or low <= last) and (high is None or first <= high)


def _held_off(parameter: Parameter, judged: Judgement, profile: Profile) -> Judgement:
    """The verdict where priors, such as the end of a range, keep a parameter away from all that the table allows it.
    The profile of a noise is no judge: with few rows it lies too low.
    """
    if parameter.name in NOISE_SPECS:
        return judged
    within = interval(profile, parameter.spec.unit)
    reason = f"priors, its own or others', keep it from where the table alone has it: 95 % within {within}"
    return replace(judged, verdict=Verdict.PRIOR_DOMINATED, reason=reason)


def _active(active: ActiveImpacts | None) -> str:
    if active is None:
        return ""
    if not active.impacts:
        where = f" ({', '.join(active.regimes)})" if active.regimes else ""
        return f"; at these values it moves the rebound of none of the {active.of} impacts{where}"
    if active.share_doubtful > DRIVEN and active.doubtful:
        more = f" and {active.in_doubt - NAMED_IN_WORDS:,} more" if active.in_doubt > NAMED_IN_WORDS else ""
        return (
            f"; {100.0 * active.share_doubtful:.0f} % of what the table says of it comes from impacts whose regime "
            f"is in doubt ({', '.join(active.doubtful[:NAMED_IN_WORDS])}{more})"
        )
    return ""
