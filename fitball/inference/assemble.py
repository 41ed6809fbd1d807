"""From numbers and judgements to estimates, and the headline of a fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from msgspec.structs import asdict

from fitball.base.errors import Note
from fitball.base.priors import ParameterSpec
from fitball.base.text import listed
from fitball.base.values import FloatArray
from fitball.inference.forward import Draws
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.inference.problem.fall import FALL_SPECS
from fitball.inference.problem.problem import COMMON_PARAMETERS, Problem
from fitball.inference.schema import Adequacy, Estimate, Judgement, Mode
from fitball.inference.summary import summarise
from fitball.models.specs import BALL_PARAMETERS

# The sentence of each verdict on a first screen, in this order.
_SENTENCES = (
    ("identified", "The data determine {}."),
    ("given", "They determine {} only under the model assumptions listed below."),
    ("conditional", "Values of {} hold only under a condition that their reasons name."),
    ("one-sided", "They limit {} on one side."),
    ("prior-dominated", "They do not determine {}: the value is that of the prior."),
    ("extrapolated", "Nothing was measured near {}."),
)
# The headline speaks of the physics: noise, ball and camera are means to it.
_OF_INTEREST = ("model", "level", "derived")


def estimates(
    problem: Problem,
    draws: Draws,
    judged: Mapping[str, Judgement],
) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    """The estimates of all parameters, fixed ones too, and those of derived quantities, by name."""

    def estimate(
        spec: ParameterSpec,
        kind: str,
        sampled: FloatArray,
        point: float,
        prior: str = "",
        source: str = "",
    ) -> Estimate:
        """The estimate of a quantity from its draws (draws,) and its value at the best fit."""
        judgement = judged[spec.name]
        return Estimate(
            **asdict(summarise(sampled, point)),
            name=spec.name,
            kind=kind,
            unit=spec.unit,
            meaning=spec.meaning,
            prior=prior,
            prior_source=source,
            contraction=judgement.contraction,
            verdict=judgement.verdict,
            rule=judgement.rule,
            reason=judgement.reason,
            given=judgement.given,
            open_side=judgement.open_side,
        )

    parameters = dict[str, Estimate]()
    derived = dict[str, Estimate]()
    for fitted in problem.parameters:
        name = fitted.spec.name
        if fitted.fixed is None:
            prior = fitted.prior.text
            sampled = draws.values[name]
        else:
            prior = f"fixed: {fitted.why}"
            sampled = np.empty(0)
        parameters[name] = estimate(
            fitted.spec,
            _kind(name),
            sampled,
            draws.point[name],
            prior,
            fitted.prior.source,
        )
    for quantity in problem.derived:
        spec = quantity.spec
        point = float(quantity.rule(draws.best)[0])
        held = judged[spec.name].verdict == "fixed"
        sampled = np.empty(0) if held else quantity.rule(draws.values)
        derived[spec.name] = estimate(spec, "derived", sampled, point)
    return parameters, derived


def _kind(name: str) -> str:
    """The kind of a parameter: model, level, noise, camera or ball."""
    base = name.partition("[")[0]
    if base in BALL_PARAMETERS:
        return "ball"
    if base in CAMERA_SPECS or base in FALL_SPECS:
        return "camera"
    if name in COMMON_PARAMETERS:
        return "noise"
    return "level" if "[" in name else "model"


def notes_of_best_outside(reported: Sequence[Estimate]) -> list[Note]:
    """The note (`best-outside`) that best values lie outside of the intervals of the draws, if any
    do: a high peak of the posterior may hold little of it. A value that is limited on one side, or
    not determined, is left out, for its best value is often at a bound.
    """
    names = [
        f"{estimate.name} ({f'{estimate.point:.3g} {estimate.unit}'.strip()})"
        for estimate in reported
        if estimate.verdict in ("identified", "given", "conditional")
        and estimate.kind in _OF_INTEREST
        and np.isfinite(estimate.q975 - estimate.q025)
        and not estimate.q025 <= estimate.point <= estimate.q975
    ]
    if not names:
        return []
    text = (
        f"Best values outside of their 95 % intervals: {listed(names, most=8)}. The best fit is a "
        "narrow peak that holds little of the posterior: use medians and draws, not best values."
    )
    return [Note("best-outside", text)]


def headline(
    tested: Adequacy,
    reported: Sequence[Estimate],
    modes: Sequence[Mode] = (),
) -> str:
    """The headline of a fit: the sentence of its adequacy, one on the modes of its posterior if
    there are several, and one for each verdict that a quantity of interest has.
    """
    sentences = [tested.sentence]
    if modes:
        sentences.append(f"The posterior has {len(modes)} separate solutions.")
    for verdict, words in _SENTENCES:
        names = [
            estimate.name
            for estimate in reported
            if estimate.verdict == verdict and estimate.kind in _OF_INTEREST
        ]
        if names:
            sentences.append(words.format(listed(names, most=8)))
    return " ".join(sentences)
