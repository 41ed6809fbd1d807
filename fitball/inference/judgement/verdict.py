"""The verdict of each quantity, by one table of rules.

The profile decides, the linearisation finds what is traded, adequacy and assumptions qualify. Of
the draws only modes and medians far from a profile enter, so no verdict depends on the seed.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fitball.base.numbers import fixed, percent
from fitball.base.prior_families import Prior
from fitball.base.priors import ParameterSpec
from fitball.base.text import listed
from fitball.base.values import BoolArray, FloatArray
from fitball.inference.derived import LAWS, Quantity, anchored
from fitball.inference.effort import PROFILED_ROWS
from fitball.inference.judgement.bounds import CONDITIONAL_SHIFT, NO_BOUNDS, AtBounds
from fitball.inference.judgement.first_order import FirstOrder, gradients
from fitball.inference.judgement.open_sides import side_with
from fitball.inference.judgement.profile import Profiled
from fitball.inference.problem.problem import Problem, base_of
from fitball.inference.schema import (
    Adequacy,
    Interval,
    Judgement,
    PointFit,
    Side,
    Verdict,
)

# Contraction below which the data add next to nothing. Chosen by hand.
LEAST_CONTRACTION = 0.2
# Degrees of freedom at and below which the variance of a noise, scaled inverse chi-square, has no
# mean.
LEAST_FREEDOM = 2.0
# Ratio of standard errors without and with the scene's contact time from which a value rests on
# that. Chosen by hand.
RESTING_RATIO = 2.0
# Share of a derived quantity's variance from which it moves with a parameter: half of it.
SHARED_VARIANCE = 0.5
# Width of a central 95 % interval of a normal distribution, in sds.
WIDTH_IN_SDS = 3.92
# Change of a rebound, in sds of its noise for an sd of the prior, above which a parameter acts in
# an impact. Chosen by hand.
LEAST_EFFECT = 1e-3
# Assumptions that a value rests on, as `given` has them.
CONTACT_TIME = "contact_time"
UNTESTED_MODEL = "model"
NOISE_PRIOR = "the prior of the noise"
# Shares of a distribution below the ends of its central 95 %.
CENTRAL_95 = np.array([0.025, 0.975])
# The medians of a fit without draws, and what is doubted where nothing is.
NO_MEDIANS: Mapping[str, float] = {}
NO_DOUBTS: Mapping[str, str] = {}
# How values are extrapolated, in words.
ANCHORED_WORDS = "It is that at 10 m/s, where no vertical speed was measured."
BEYOND_WORDS = "Nothing was measured there: the value follows from the laws of the model."


class Evidence(NamedTuple):
    """All that a verdict is based on.

    - `contraction`: 1 - variance over prior variance, to first order;
    - `interval`: the 95 % interval of the profile, None where profiles are `missing` or the table
      is long; `within`: whether the best value lies in it; `elsewhere`: whether it is that of
      another peak, and excludes best value or median; `wide`: whether it is as wide as the prior;
    - `bound`: that the best value lies on a hard bound of the prior, in words;
    - `traded`: parameters it is traded with, unless the contact time separates them;
    - `freedom`: the degrees of freedom of a noise;
    - `acting`, `extrapolated`: in how many impacts it acts, and how it is extrapolated, in words;
    - `open`, `bounded`: parameters that leave a derived quantity undetermined, or one-sided, and
      the `side` on which these leave it open; `opposed`: whether they do so on both.
    """

    spec: ParameterSpec
    contraction: float
    interval: Interval | None = None
    missing: bool = False
    within: bool = True
    elsewhere: bool = False
    wide: bool = False
    bound: str = ""
    traded: tuple[str, ...] = ()
    freedom: float = np.inf
    acting: str = ""
    extrapolated: str = ""
    open: tuple[str, ...] = ()
    bounded: tuple[str, ...] = ()
    side: Side = ""
    opposed: bool = False

    @property
    def sides(self) -> tuple[bool, bool]:
        """Whether the profile is open below, and above."""
        low, high = (0.0, 0.0) if self.interval is None else self.interval
        return low is None, high is None

    @property
    def open_side(self) -> Side:
        """The one side on which it is open, by its own profile or by `bounded`; else ""."""
        low, high = self.sides
        if low == high:
            return self.side
        return "below" if low else "above"

    @property
    def ends(self) -> str:
        """The 95 % interval of the profile, in words."""
        unit = self.spec.display_unit
        words = "" if self.interval is None else unit.with_unit(unit.interval(*self.interval))
        return words and f" (95 % interval of the profile likelihood: {words})"


class Rule(NamedTuple):
    """A rule: where it `holds` of the evidence it decides the `verdict`, for the reason that it
    `says`.
    """

    code: str
    verdict: Verdict
    holds: Callable[[Evidence], bool]
    says: Callable[[Evidence], str]


# The first rule that holds decides.
RULES = (
    Rule(
        code="traded",
        verdict="prior-dominated",
        holds=lambda seen: bool(seen.traded),
        says=lambda seen: (
            f"The data determine it only in combination with {listed(seen.traded)}; its own value "
            "is its prior's."
        ),
    ),
    Rule(
        code="no-maximum",
        verdict="prior-dominated",
        holds=lambda seen: seen.missing and np.isfinite(seen.freedom),
        says=lambda _: (
            "The model can reproduce the measurements all but exactly: the size of this noise is "
            "its prior's."
        ),
    ),
    Rule(
        code="no-freedom",
        verdict="prior-dominated",
        holds=lambda seen: seen.freedom <= LEAST_FREEDOM,
        says=lambda seen: (
            f"Its measurements have {fixed(seen.freedom, 1)} degrees of freedom left, too few for "
            "a noise."
        ),
    ),
    Rule(
        code="open",
        verdict="prior-dominated",
        holds=lambda seen: all(seen.sides),
        says=lambda seen: f"Its profile likelihood is open on both sides.{seen.acting}",
    ),
    Rule(
        code="open-part",
        verdict="prior-dominated",
        holds=lambda seen: bool(seen.open),
        says=lambda seen: f"It depends on {listed(seen.open)}, which the data do not determine.",
    ),
    Rule(
        code="opposed-parts",
        verdict="prior-dominated",
        holds=lambda seen: seen.opposed,
        says=lambda seen: (
            f"It depends on {listed(seen.bounded)}: the data limit each on one side, and so it on "
            "neither."
        ),
    ),
    Rule(
        code="at-bound",
        verdict="prior-dominated",
        holds=lambda seen: bool(seen.bound),
        says=lambda seen: seen.bound,
    ),
    Rule(
        code="bounded",
        verdict="one-sided",
        holds=lambda seen: any(seen.sides),
        says=lambda seen: f"The data give only a bound{seen.ends}.{seen.acting}",
    ),
    Rule(
        code="bounded-part",
        verdict="one-sided",
        holds=lambda seen: bool(seen.bounded),
        says=lambda seen: (
            f"It depends on {listed(seen.bounded)}, for which the data give only a bound."
        ),
    ),
    Rule(
        code="elsewhere",
        verdict="conditional",
        holds=lambda seen: seen.elsewhere,
        says=lambda seen: (
            f"The likelihood is highest elsewhere{seen.ends}, where little of the posterior lies."
        ),
    ),
    Rule(
        code="held-off",
        verdict="prior-dominated",
        holds=lambda seen: not seen.within,
        says=lambda seen: f"Priors keep it outside of what the data allow{seen.ends}.",
    ),
    Rule(
        code="unchanged",
        verdict="prior-dominated",
        holds=lambda seen: seen.contraction < LEAST_CONTRACTION,
        says=lambda seen: (
            "The data reduce the variance of its prior by "
            f"{percent(max(seen.contraction, 0.0))}.{seen.acting}"
        ),
    ),
    Rule(
        code="wide",
        verdict="prior-dominated",
        holds=lambda seen: seen.wide,
        says=lambda seen: f"The data alone allow as much as its prior{seen.ends}.",
    ),
    Rule(
        code="extrapolated",
        verdict="extrapolated",
        holds=lambda seen: bool(seen.extrapolated),
        says=lambda seen: seen.extrapolated,
    ),
    Rule(
        code="exact",
        verdict="given",
        holds=lambda seen: seen.missing,
        says=lambda _: (
            "The model can reproduce the measurements all but exactly: how well they determine it "
            "follows from the prior of the noise."
        ),
    ),
    Rule(
        code="determined",
        verdict="identified",
        holds=lambda _: True,
        says=lambda seen: f"The data determine it{seen.ends}.",
    ),
)


# The judgement of a derived quantity that no free parameter moves.
HELD = Judgement("fixed", "fixed", "It follows from held values alone.")


def judge(
    problem: Problem,
    point: PointFit,
    first: FirstOrder,
    profiled: Profiled,
    derived: Sequence[Quantity],
    bounds: AtBounds = NO_BOUNDS,
    medians: Mapping[str, float] = NO_MEDIANS,
) -> dict[str, Judgement]:
    """The judgement of each quantity by name, if the model is right: of parameters by their
    profiles, of derived quantities by their gradients in the linearisation and along the profiles
    that are open. `medians` are those of draws, if there are any.
    """
    judged = {
        parameter.spec.name: Judgement("fixed", "fixed", f"Held at its value: {parameter.why}.")
        for parameter in problem.parameters
        if parameter.fixed is not None
    }
    missing = not profiled.by_name and len(problem.rows.y) <= PROFILED_ROWS
    linear = _linear_of(problem, first, derived)
    extrapolated = _extrapolated_laws(problem)
    for k, parameter in enumerate(problem.prior.parameters):
        name = parameter.spec.name
        profile = profiled.by_name.get(name)
        interval = None if profile is None else profile.interval_95
        noise = name in problem.noises
        rests = _assumptions_of(problem, linear, k)
        prior_ends = parameter.prior.quantile(CENTRAL_95)
        if not (noise or _intervals_meet(interval, *prior_ends)):
            rests.append(f"the prior of {name}")
        evidence = Evidence(
            parameter.spec,
            linear.contraction[k],
            interval,
            missing,
            within=noise or _holds(interval, point.optima[0][name]),
            elsewhere=not noise and _is_elsewhere(interval, point, name, medians),
            wide=not parameter.measured and _is_as_wide(interval, parameter.prior),
            bound=bounds.reason(name, parameter.prior.text),
            traded=() if CONTACT_TIME in rests else first.traded.get(name, ()),
            freedom=first.freedom.get(name, np.inf),
            acting=_acting_words(first, name),
            extrapolated=ANCHORED_WORDS if name in extrapolated else "",
        )
        judged[name] = _judgement_of(evidence, rests)
    # A value that depends on a stated constant of ball, camera or air rests on that; one that
    # depends on a bound of a prior is doubted in `qualify`.
    depended = {parameter.spec.name for parameter in problem.parameters if parameter.measured}
    depended |= bounds.bound.keys()
    for k, quantity in enumerate(derived, start=len(problem.free)):
        if not linear.signs[k].any():
            judged[quantity.spec.name] = HELD
            continue
        shares = zip(problem.free, linear.shares[k], linear.signs[k], strict=True)
        moving = {name: sign for name, share, sign in shares if share > SHARED_VARIANCE}
        moving |= _carrying(problem, quantity, profiled, linear.sds[k])
        evidence = _evidence_of_derived(quantity, moving, judged, depended)
        rests = _assumptions_of(problem, linear, k)
        for name in moving:
            rests += judged[name].given
        evidence = evidence._replace(contraction=linear.contraction[k], missing=missing)
        judged[quantity.spec.name] = _judgement_of(evidence, rests)
    return judged


def _evidence_of_derived(
    quantity: Quantity,
    moving: Mapping[str, float],
    judged: Mapping[str, Judgement],
    depended: Collection[str],
) -> Evidence:
    """What the judgements of the parameters that a derived quantity moves with, each with the sign
    of the correlation, say of it. Of those it may depend on (`depended`) none leaves it open.
    """
    parents = {name: judged[name] for name in moving}
    bounded = [name for name, parent in parents.items() if parent.verdict == "one-sided"]
    sides = {side_with(parents[name].open_side, moving[name]) for name in bounded}
    opposed = sides >= {"above", "below"}
    undetermined = [
        name
        for name, parent in parents.items()
        if parent.verdict == "prior-dominated" and name not in depended
    ]
    return Evidence(
        quantity.spec,
        np.nan,
        elsewhere=not quantity.extrapolated
        and any(parent.rule == "elsewhere" for parent in parents.values()),
        extrapolated=BEYOND_WORDS if quantity.extrapolated else "",
        open=tuple(undetermined),
        bounded=tuple(bounded),
        side=next(iter(sides)) if len(sides) == 1 else "",
        opposed=opposed,
    )


def _carrying(
    problem: Problem,
    quantity: Quantity,
    profiled: Profiled,
    sd: float,
) -> dict[str, float]:
    """The parameters whose open profile carries a derived quantity of this `sd` further than its
    own 95 % interval is wide, each with the sign of its change from the lower end to the upper one.

    To first order a quantity hardly moves with a friction that few impacts feel at the best values,
    and that may be anything above them.
    """
    found = {}
    for name, profile in profiled.by_name.items():
        if None not in profile.interval_95:
            continue
        values = quantity.rule(problem.values(profiled.paths[name]))
        values = values[np.isfinite(values)]
        if values.size and np.ptp(values) > WIDTH_IN_SDS * sd:
            found[name] = float(np.sign(values[-1] - values[0]))
    return found


def _holds(interval: Interval | None, value: float) -> bool:
    """Whether an interval holds a value."""
    return _intervals_meet(interval, value, value)


def _is_elsewhere(
    interval: Interval | None,
    point: PointFit,
    name: str,
    medians: Mapping[str, float],
) -> bool:
    """Whether the interval of a profile excludes the best value or the median of a parameter, and
    is about another peak of the posterior.
    """
    value = point.optima[0][name]
    if _holds(interval, value) and _holds(interval, medians.get(name, value)):
        return False
    return any(_holds(interval, optimum[name]) for optimum in point.optima)


def _extrapolated_laws(problem: Problem) -> set[str]:
    """The parameters, levels included, that are values or slopes at 10 m/s beyond the data. With a
    slope that is held a value is none.
    """
    fitted = {base_of(name) for name in problem.free}
    # A root has a slope of its own, which is not fitted.
    if problem.forward.model.options.get("cor") == "root":
        fitted.add("cor_slope")
    far = anchored(problem.forward, problem.calibrated)
    return {name for name in far if LAWS.get(base_of(name), base_of(name)) in fitted}


def _judgement_of(evidence: Evidence, rests: Iterable[str]) -> Judgement:
    """The judgement of the first rule that holds, with what the value rests on."""
    rule = next(rule for rule in RULES if rule.holds(evidence))
    unique = dict.fromkeys(rests)
    if rule.code == "exact":
        unique[NOISE_PRIOR] = None
    verdict = rule.verdict
    if verdict == "identified" and unique:
        verdict = "given"
    assumptions = tuple(unique) if verdict == "given" else ()
    reason = rule.says(evidence)
    side = evidence.open_side if verdict == "one-sided" else ""
    contraction = float(evidence.contraction)
    return Judgement(verdict, rule.code, reason, assumptions, contraction, side)


def _intervals_meet(interval: Interval | None, low: float, high: float) -> bool:
    """Whether an interval has anything from `low` to `high`; an open end reaches everywhere."""
    lower, upper = interval or (None, None)
    return (lower is None or lower <= high) and (upper is None or low <= upper)


def _is_as_wide(interval: Interval | None, prior: Prior) -> bool:
    """Whether the closed interval of a profile is as wide as that of a prior, in its coordinate:
    then the prior says as much as the data.
    """
    low, high = interval or (None, None)
    if low is None or high is None:
        return False
    ends = prior.coordinate(np.stack([np.array([low, high]), prior.quantile(CENTRAL_95)]))
    of_data, of_prior = np.diff(ends, axis=1)[:, 0]
    return bool(of_data >= of_prior)


class _LinearQuantities(NamedTuple):
    """Free parameters and then derived quantities to first order: their `contraction`
    (quantities,), zero where nothing moves them; the squared correlation with each parameter
    (`shares`, (quantities, coordinates)), and its `signs`; whether the standard error rests on the
    contact time (`timed`, (quantities,)); and its sd (`sds`, (quantities,)).
    """

    contraction: FloatArray
    shares: FloatArray
    signs: FloatArray
    timed: BoolArray
    sds: FloatArray


def _linear_of(
    problem: Problem, first: FirstOrder, derived: Sequence[Quantity]
) -> _LinearQuantities:
    """The free parameters and derived quantities of a problem to first order."""
    prior = problem.prior
    factor = first.proposal.factor
    tiny = np.finfo(float).tiny
    following = gradients(problem, first.proposal.centre, derived)
    moves = np.concatenate([np.eye(len(problem.free)), following])
    variance = np.sum((moves @ factor) ** 2, axis=1)
    before = np.sum((moves * prior.width) ** 2, axis=1)
    contraction = np.where(before > 0.0, 1.0 - variance / np.maximum(before, tiny), 0.0)
    product = np.maximum(np.outer(variance, np.sum(factor**2, axis=1)), tiny)
    together = moves @ factor @ factor.T
    shares = np.minimum(together**2 / product, 1.0)
    signs = np.sign(together)
    sds = np.sqrt(variance)
    if problem.contact_time is None:
        return _LinearQuantities(contraction, shares, signs, np.zeros(len(moves), np.bool_), sds)
    fitted = [problem.free.index(name) for name in first.names]
    along = (moves[:, fitted] * first.sds) @ first.root
    time = first.slopes[first.residual.size] @ first.root
    # The covariance without a row (Sherman and Morrison).
    more = (along @ time) ** 2 / (1.0 - time @ time)
    timed = more > (RESTING_RATIO**2 - 1.0) * np.sum(along**2, axis=1)
    return _LinearQuantities(contraction, shares, signs, timed, sds)


def _assumptions_of(problem: Problem, linear: _LinearQuantities, k: int) -> list[str]:
    """The measurements of the scene that the value of quantity `k` rests on, in words: the contact
    time, if its error doubles without that; a stated constant of ball or camera, if two of its
    stated sds move the value by the error that this has with the constant held.
    """
    rests = [CONTACT_TIME] if linear.timed[k] else []
    for m, parameter in enumerate(problem.prior.parameters):
        share = linear.shares[k, m]
        # Squares over the variance: the shift as the prior moves by two of its sds, and the error
        # that remains with the constant held.
        moved = 4.0 * share * (1.0 - linear.contraction[m])
        if parameter.measured and m != k and moved > 1.0 - share:
            rests.append(f"the prior of {parameter.spec.name}")
    return rests


def _acting_words(first: FirstOrder, name: str) -> str:
    """The sentence in how many impacts a parameter acts; "" where it acts in all tested ones."""
    if name not in first.names:
        return ""
    slopes = first.slopes[: first.residual.size, first.names.index(name)]
    acting = np.unique(first.rows[np.abs(slopes) > LEAST_EFFECT]).size
    impacts = np.unique(first.rows).size
    return "" if acting == impacts else f" It acts in {acting} of {impacts} impacts."


def qualify(
    within: Mapping[str, Judgement],
    tested: Adequacy,
    rests: Mapping[str, tuple[str, ...]],
    doubts: Mapping[str, str] = NO_DOUBTS,
    denied: Mapping[str, str] = NO_DOUBTS,
) -> dict[str, Judgement]:
    """The final judgements: those `within` the model, `conditional` where the model fails, a
    pattern in the residuals moves a value by its sd, or there are other `doubts` (sentences by
    name), and `given` all that it rests on, with the `model` where that could not be tested. What
    variants have `denied` (sentences by name) is `conditional`, and rests on as much.
    """
    from msgspec.structs import replace

    final = {}
    for name, judgement in within.items():
        if judgement.verdict not in ("identified", "given"):
            final[name] = judgement
            continue
        moved = tested.moved.get(name, 0.0)
        doubt = doubts.get(name, "")
        if tested.answer == "does not describe":
            doubt = "But the model does not describe the data: this holds only if it is right."
        elif moved > CONDITIONAL_SHIFT:
            doubt = f"But a pattern of the residuals moves it by {fixed(moved, 1)} of its sds."
        if doubt:
            reason = f"{judgement.reason} {doubt}"
            final[name] = replace(judgement, verdict="conditional", reason=reason, given=())
            continue
        assumptions = [*judgement.given, *rests.get(name, ())]
        if tested.answer == "undecided":
            assumptions.append(UNTESTED_MODEL)
        unique = tuple(dict.fromkeys(assumptions))
        if name in denied:
            reason = f"{judgement.reason} {denied[name]}"
            final[name] = replace(judgement, verdict="conditional", reason=reason, given=unique)
        else:
            verdict = "given" if unique else "identified"
            final[name] = replace(judgement, verdict=verdict, given=unique)
    return final
