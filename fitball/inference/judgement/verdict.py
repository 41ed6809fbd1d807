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
from fitball.inference.effort import PROFILED
from fitball.inference.judgement.first_order import FirstOrder, gradients
from fitball.inference.problem.problem import Problem, base_of
from fitball.inference.schema import Adequacy, Interval, Judgement, PointFit, Profile, Verdict

# Contraction below which the data add next to nothing; degrees of freedom at and below which the
# variance of a noise, scaled inverse chi-square, has no mean.
NEGLIGIBLE = 0.2
LEAST_FREEDOM = 2.0
# Ratio of standard errors without and with the scene's contact time from which a value rests on
# that; share of its variance from which a quantity moves with a parameter; sds by which a pattern
# moves what is conditional.
RESTS = 2.0
SHARED = 0.5
MOVED = 1.0
# Change of a rebound, in sds of its noise for an sd of the prior, below which a parameter does not
# act.
ACTS = 1e-3
CONTACT_TIME = "contact_time"
MODEL = "model"
NOISE = "the prior of the noise"
ANCHOR = "It is the value at 10 m/s, where no vertical speed was measured."
BEYOND = "Nothing was measured there: the value follows from the laws of the model."


class Seen(NamedTuple):
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


RULES: tuple[tuple[str, Verdict, Callable[[Seen], bool], Callable[[Seen], str]], ...] = (
    (
        "traded",
        "prior-dominated",
        lambda n: bool(n.traded),
        lambda n: (
            f"The data determine it only in combination with {listed(n.traded)}; its own value is "
            "its prior's."
        ),
    ),
    (
        "no-maximum",
        "prior-dominated",
        lambda n: n.missing and np.isfinite(n.freedom),
        lambda _: (
            "The model can reproduce the measurements all but exactly: the size of this noise is "
            "its prior's."
        ),
    ),
    (
        "no-freedom",
        "prior-dominated",
        lambda n: n.freedom <= LEAST_FREEDOM,
        lambda n: (
            f"Its measurements have {fixed(n.freedom, 1)} degrees of freedom left, too few for a "
            "noise."
        ),
    ),
    (
        "open",
        "prior-dominated",
        lambda n: all(n.sides),
        lambda n: f"Its profile likelihood is open on both sides.{n.acting}",
    ),
    (
        "open-part",
        "prior-dominated",
        lambda n: bool(n.open),
        lambda n: f"It depends on {listed(n.open)}, which the data do not determine.",
    ),
    (
        "bounded",
        "one-sided",
        lambda n: any(n.sides),
        lambda n: f"The data give only a bound{n.ends}.{n.acting}",
    ),
    (
        "bounded-part",
        "one-sided",
        lambda n: bool(n.bounded),
        lambda n: f"It depends on {listed(n.bounded)}, for which the data give only a bound.",
    ),
    (
        "held-off",
        "prior-dominated",
        lambda n: not n.within,
        lambda n: f"Priors keep it outside of what the data allow{n.ends}.",
    ),
    (
        "unchanged",
        "prior-dominated",
        lambda n: n.contraction < NEGLIGIBLE,
        lambda n: (
            "The data reduce the variance of its prior by "
            f"{percent(max(n.contraction, 0.0))}.{n.acting}"
        ),
    ),
    ("extrapolated", "extrapolated", lambda n: bool(n.extrapolated), lambda n: n.extrapolated),
    (
        "exact",
        "given",
        lambda n: n.missing,
        lambda _: (
            "The model can reproduce the measurements all but exactly: how well they determine it "
            "follows from "
            "the prior of the noise."
        ),
    ),
    ("determined", "identified", lambda _: True, lambda n: f"The data determine it{n.ends}."),
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
    far = anchored(problem.forward, problem.calibrated)
    noises = problem.noises
    missing = not found and len(problem.rows.y) <= PROFILED
    linear = _linear(problem, first, derived)
    for k, item in enumerate(problem.prior.parameters):
        name = item.spec.name
        profile = found.get(item.spec.name)
        interval = None if profile is None else profile.interval_95
        value = point.optima[0][name]
        given = _rests(problem, linear, k)
        if name not in noises and not _meet(
            interval,
            *item.prior.quantile(np.array([0.025, 0.975])),
        ):
            given.append(f"the prior of {name}")
        anchor = name in far and LAWS[base_of(name)] in problem.free
        seen = Seen(
            item.spec,
            linear.contraction[k],
            interval,
            missing,
            name in noises or _meet(interval, value, value),
            () if CONTACT_TIME in given else first.traded.get(name, ()),
            first.freedom.get(name, np.inf),
            _acting(first, name),
            ANCHOR * anchor,
        )
        judged[name] = _judged(seen, given)
    for k, quantity in enumerate(derived, start=len(problem.free)):
        judged[quantity.spec.name] = _judged_derived(problem, quantity, linear, k, judged, missing)
    return judged


def _judged_derived(
    problem: Problem,
    quantity: Quantity,
    linear: _Linear,
    k: int,
    judged: Mapping[str, Judgement],
    missing: bool,
) -> Judgement:
    """A derived quantity, which is row `k` of the linearisation, by the verdicts `judged` of the
    parameters that have a share in it.
    """
    names = tuple(
        name for name, share in zip(problem.free, linear.shares[k], strict=True) if share > SHARED
    )
    undetermined, bounded = (
        tuple(name for name in names if judged[name].verdict == kind)
        for kind in ("prior-dominated", "one-sided")
    )
    given = [
        *_rests(problem, linear, k),
        *(condition for name in names for condition in judged[name].given),
    ]
    seen = Seen(
        quantity.spec,
        linear.contraction[k],
        missing=missing,
        extrapolated=BEYOND * quantity.extrapolated,
        open=undetermined,
        bounded=bounded,
    )
    return _judged(seen, given)


def _judged(seen: Seen, given: Iterable[str]) -> Judgement:
    """By the first rule that holds."""
    rule, verdict, _, words = next(row for row in RULES if row[2](seen))
    unique = tuple(dict.fromkeys([*given, *[NOISE] * (rule == "exact")]))
    if verdict == "identified" and unique:
        verdict = "given"
    return Judgement(
        verdict,
        rule,
        words(seen),
        unique if verdict == "given" else (),
        float(seen.contraction),
    )


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
    prior = problem.prior
    factor = first.proposal.factor
    tiny = np.finfo(float).tiny
    moves = np.concatenate(
        [np.eye(len(problem.free)), gradients(problem, first.proposal.centre, derived)]
    )
    variance = np.sum((moves @ factor) ** 2, axis=1)
    before = np.sum((moves * prior.width) ** 2, axis=1)
    contraction = np.where(before > 0.0, 1.0 - variance / np.maximum(before, tiny), 0.0)
    product = np.outer(variance, np.sum(factor**2, axis=1))
    shares = np.minimum((moves @ factor @ factor.T) ** 2 / np.maximum(product, tiny), 1.0)
    if problem.contact_time is None:
        return _Linear(contraction, shares, np.zeros(len(moves), np.bool_))
    along = (moves[:, [problem.free.index(name) for name in first.names]] * first.sds) @ first.root
    time = first.slopes[first.residual.size] @ first.root
    # The covariance without a row (Sherman and Morrison).
    more = (along @ time) ** 2 / (1.0 - time @ time)
    return _Linear(contraction, shares, more > (RESTS**2 - 1.0) * np.sum(along**2, axis=1))


def _rests(problem: Problem, linear: _Linear, k: int) -> list[str]:
    """What the scene measured, and a determined value is given: its error is twice as large without
    the contact time; it moves by its own error, with the constant held, as what is stated of ball
    or camera moves by two sds.
    """
    given = [CONTACT_TIME] * bool(linear.timed[k])
    for m, item in enumerate(problem.prior.parameters):
        share = linear.shares[k, m]
        if item.measured and m != k and 4.0 * share * (1.0 - linear.contraction[m]) > 1.0 - share:
            given.append(f"the prior of {item.spec.name}")
    return given


def _acting(first: FirstOrder, name: str) -> str:
    """In how many impacts a parameter acts, where these are not all that were tested."""
    if name not in first.names:
        return ""
    seen = np.abs(first.slopes[: first.residual.size, first.names.index(name)]) > ACTS
    acting, impacts = (np.unique(first.rows[rows]).size for rows in (seen, ...))
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
    for name, one in within.items():
        moved = tested.moved.get(name, 0.0)
        given = tuple(
            dict.fromkeys(
                [*one.given, *rests.get(name, ()), *[MODEL] * (tested.answer == "undecided")]
            )
        )
        words = ""
        if tested.answer == "does not describe":
            words = "But the model does not describe the data: this holds only if it is right."
        elif moved > MOVED:
            words = f"But a pattern of the residuals moves it by {fixed(moved, 1)} of its sds."
        if one.verdict not in ("identified", "given"):
            final[name] = one
        elif words:
            final[name] = replace(
                one,
                verdict="conditional",
                reason=f"{one.reason} {words}",
                given=(),
            )
        else:
            final[name] = replace(one, verdict="given" if given else "identified", given=given)
    return final
