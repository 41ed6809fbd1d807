"""One verdict a quantity, by one table of rules.

The profile decides, the linearisation finds what is traded, adequacy and assumptions qualify; draws
decide nothing, so no verdict depends on the seed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from fitball.base.numbers import fixed, percent
from fitball.base.priors import ParameterSpec
from fitball.base.text import listed
from fitball.base.values import BoolArray, FloatArray
from fitball.inference.derived import LAWS, Quantity, anchored
from fitball.inference.effort import PROFILED_ROWS
from fitball.inference.judgement.first_order import FirstOrder, gradients
from fitball.inference.problem.problem import Problem, base_of
from fitball.inference.schema import Adequacy, Interval, Judgement, PointFit, Profile, Verdict

# Contraction below which the data add next to nothing.
NEGLIGIBLE = 0.2
# Degrees of freedom at and below which the variance of a noise, scaled inverse chi-square, has no
# mean.
LEAST_FREEDOM = 2.0
# Ratio of standard errors without and with the scene's contact time from which a value rests on
# that.
RESTS = 2.0
# Share of its variance from which a quantity moves with a parameter.
SHARED = 0.5
# Sds by which a pattern moves what is conditional.
MOVED = 1.0
# Change of a rebound, in sds of its noise for an sd of the prior, below which a parameter does not
# act.
ACTS = 1e-3
# What a value rests on, as `given` has it.
CONTACT_TIME = "contact_time"
MODEL = "model"
NOISE = "the prior of the noise"
# How values are extrapolated, in words.
ANCHOR = "It is the value at 10 m/s, where no vertical speed was measured."
BEYOND = "Nothing was measured there: the value follows from the laws of the model."


class Evidence(NamedTuple):
    """All that a verdict is based on: `contraction` (1 - variance over prior variance); the 95 %
    `interval` of the profile (None: `missing`, or the table is long), and whether the point is
    `within`; what a parameter is `traded` with, unless the contact time separates them; the
    `freedom` of a noise; in how many impacts it is `acting`, and how it is `extrapolated`, in
    words; parameters that leave a derived quantity `open`, or `bounded`.
    """

    spec: ParameterSpec
    contraction: float
    interval: Interval | None = None
    missing: bool = False
    within: bool = True
    traded: tuple[str, ...] = ()
    freedom: float = np.inf
    acting: str = ""
    extrapolated: str = ""
    open: tuple[str, ...] = ()
    bounded: tuple[str, ...] = ()

    @property
    def sides(self) -> tuple[bool, bool]:
        """Which sides the profile leaves open."""
        low, high = (0.0, 0.0) if self.interval is None else self.interval
        return low is None, high is None

    @property
    def ends(self) -> str:
        """The 95 % interval of the profile, in words."""
        unit = self.spec.display_unit
        words = "" if self.interval is None else unit.with_unit(unit.interval(*self.interval))
        return words and f" (95 % interval of the profile likelihood: {words})"


class Rule(NamedTuple):
    """A rule of `code`: where it `holds`, the verdict is this, for the reason that it `says`."""

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
        code="held-off",
        verdict="prior-dominated",
        holds=lambda seen: not seen.within,
        says=lambda seen: f"Priors keep it outside of what the data allow{seen.ends}.",
    ),
    Rule(
        code="unchanged",
        verdict="prior-dominated",
        holds=lambda seen: seen.contraction < NEGLIGIBLE,
        says=lambda seen: (
            "The data reduce the variance of its prior by "
            f"{percent(max(seen.contraction, 0.0))}.{seen.acting}"
        ),
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


def judge(
    problem: Problem,
    point: PointFit,
    first: FirstOrder,
    found: Mapping[str, Profile],
    derived: Sequence[Quantity],
) -> dict[str, Judgement]:
    """Within the model: parameters by their profiles, derived quantities by their gradient in the
    linearisation; `extrapolated` is what lies at a speed, or on a surface, where nothing was
    measured.
    """
    judged = {
        item.spec.name: Judgement("fixed", "fixed", f"Held at its value: {item.why}.")
        for item in problem.parameters
        if item.fixed is not None
    }
    noises = problem.noises
    missing = not found and len(problem.rows.y) <= PROFILED_ROWS
    linear = _linear(problem, first, derived)
    far = anchored(problem.forward, problem.calibrated)
    for k, item in enumerate(problem.prior.parameters):
        name = item.spec.name
        profile = found.get(name)
        interval = None if profile is None else profile.interval_95
        value = point.optima[0][name]
        rests = _rests(problem, linear, k)
        prior_ends = item.prior.quantile(np.array([0.025, 0.975]))
        if name not in noises and not _meet(interval, *prior_ends):
            rests.append(f"the prior of {name}")
        anchor = name in far and LAWS[base_of(name)] in problem.free
        evidence = Evidence(
            item.spec,
            linear.contraction[k],
            interval,
            missing,
            within=name in noises or _meet(interval, value, value),
            traded=() if CONTACT_TIME in rests else first.traded.get(name, ()),
            freedom=first.freedom.get(name, np.inf),
            acting=_acting(first, name),
            extrapolated=ANCHOR if anchor else "",
        )
        judged[name] = _judged(evidence, rests)
    for k, quantity in enumerate(derived, start=len(problem.free)):
        shares = zip(problem.free, linear.shares[k], strict=True)
        parts = [name for name, share in shares if share > SHARED]
        verdicts = {name: judged[name].verdict for name in parts}
        rests = _rests(problem, linear, k)
        for name in parts:
            rests += judged[name].given
        evidence = Evidence(
            quantity.spec,
            linear.contraction[k],
            missing=missing,
            extrapolated=BEYOND if quantity.extrapolated else "",
            open=tuple(name for name in parts if verdicts[name] == "prior-dominated"),
            bounded=tuple(name for name in parts if verdicts[name] == "one-sided"),
        )
        judged[quantity.spec.name] = _judged(evidence, rests)
    return judged


def _judged(evidence: Evidence, rests: Iterable[str]) -> Judgement:
    """The judgement of the first rule that holds, with what the value rests on."""
    rule = next(rule for rule in RULES if rule.holds(evidence))
    unique = dict.fromkeys(rests)
    if rule.code == "exact":
        unique[NOISE] = None
    verdict = rule.verdict
    if verdict == "identified" and unique:
        verdict = "given"
    given = tuple(unique) if verdict == "given" else ()
    return Judgement(verdict, rule.code, rule.says(evidence), given, float(evidence.contraction))


def _meet(interval: Interval | None, low: float, high: float) -> bool:
    """Whether an interval has anything from `low` to `high`; an open end reaches everywhere."""
    left, right = interval or (None, None)
    return (left is None or left <= high) and (right is None or low <= right)


class _Linear(NamedTuple):
    """Of free parameters and derived quantities to first order: `contraction` (quantities,), zero
    of what nothing moves; squared correlation `shares` with each parameter (quantities, free);
    whether the standard error rests on the contact time (quantities,).
    """

    contraction: FloatArray
    shares: FloatArray
    timed: BoolArray


def _linear(problem: Problem, first: FirstOrder, derived: Sequence[Quantity]) -> _Linear:
    """Free parameters and derived quantities to first order, in this order."""
    prior = problem.prior
    factor = first.proposal.factor
    tiny = np.finfo(float).tiny
    following = gradients(problem, first.proposal.centre, derived)
    moves = np.concatenate([np.eye(len(problem.free)), following])
    variance = np.sum((moves @ factor) ** 2, axis=1)
    before = np.sum((moves * prior.width) ** 2, axis=1)
    contraction = np.where(before > 0.0, 1.0 - variance / np.maximum(before, tiny), 0.0)
    product = np.maximum(np.outer(variance, np.sum(factor**2, axis=1)), tiny)
    shares = np.minimum((moves @ factor @ factor.T) ** 2 / product, 1.0)
    if problem.contact_time is None:
        return _Linear(contraction, shares, np.zeros(len(moves), np.bool_))
    places = [problem.free.index(name) for name in first.names]
    along = (moves[:, places] * first.sds) @ first.root
    time = first.slopes[first.residual.size] @ first.root
    # The covariance without a row (Sherman and Morrison).
    more = (along @ time) ** 2 / (1.0 - time @ time)
    timed = more > (RESTS**2 - 1.0) * np.sum(along**2, axis=1)
    return _Linear(contraction, shares, timed)


def _rests(problem: Problem, linear: _Linear, k: int) -> list[str]:
    """What the scene measured, and a determined value is given: its error is twice as large without
    the contact time; it moves by its own error, with the constant held, as what is stated of ball
    or camera moves by two sds.
    """
    rests = [CONTACT_TIME] if linear.timed[k] else []
    for m, item in enumerate(problem.prior.parameters):
        share = linear.shares[k, m]
        moved = 4.0 * share * (1.0 - linear.contraction[m])
        if item.measured and m != k and moved > 1.0 - share:
            rests.append(f"the prior of {item.spec.name}")
    return rests


def _acting(first: FirstOrder, name: str) -> str:
    """In how many impacts a parameter acts, where these are not all that were tested."""
    if name not in first.names:
        return ""
    slopes = first.slopes[: first.residual.size, first.names.index(name)]
    acting = np.unique(first.rows[np.abs(slopes) > ACTS]).size
    impacts = np.unique(first.rows).size
    return "" if acting == impacts else f" It acts in {acting} of {impacts} impacts."


def qualified(
    within: Mapping[str, Judgement],
    tested: Adequacy,
    rests: Mapping[str, tuple[str, ...]],
) -> dict[str, Judgement]:
    """Final: `conditional` where the model fails or a found pattern moves a value by its sd;
    `given` what it rests on, and `model` where that could not be tested.
    """
    from msgspec.structs import replace

    final = {}
    for name, judgement in within.items():
        if judgement.verdict not in ("identified", "given"):
            final[name] = judgement
            continue
        moved = tested.moved.get(name, 0.0)
        doubt = ""
        if tested.answer == "does not describe":
            doubt = "But the model does not describe the data: this holds only if it is right."
        elif moved > MOVED:
            doubt = f"But a pattern of the residuals moves it by {fixed(moved, 1)} of its sds."
        if doubt:
            reason = f"{judgement.reason} {doubt}"
            final[name] = replace(judgement, verdict="conditional", reason=reason, given=())
            continue
        given = [*judgement.given, *rests.get(name, ())]
        if tested.answer == "undecided":
            given.append(MODEL)
        verdict = "given" if given else "identified"
        final[name] = replace(judgement, verdict=verdict, given=tuple(dict.fromkeys(given)))
    return final
