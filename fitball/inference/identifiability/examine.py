"""All evidence at all parameters, and the verdicts they add up to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from fitball.inference.identifiability.active_impacts import active_impacts
from fitball.inference.identifiability.derived import extrapolated, extrapolated_words
from fitball.inference.identifiability.eigendirections import eigendirections
from fitball.inference.identifiability.fisher import information_evidence
from fitball.inference.identifiability.posterior_verdict import Judgement, judge
from fitball.inference.identifiability.power_scaling import power_evidence
from fitball.inference.identifiability.profile import coverage, profiles
from fitball.inference.identifiability.scene_share import contraction_alone, touched_by_scene
from fitball.inference.identifiability.several_fits import several_fits
from fitball.inference.identifiability.traded import LOOKS, traded
from fitball.inference.identifiability.verdict import combine
from fitball.inference.likelihood.force import noise_held
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import (
    LEFT_OUT,
    ContractionEvidence,
    Evidence,
    Identifiability,
    Profiles,
)
from fitball.inference.results.results import PointFit, Posterior, Verdict, thinned
from fitball.scheduling.engine import Engine
from fitball.values import FloatArray

# Rows up to which profiles are made unasked: ten seconds or so.
PROFILED = 300
# Draws over which derivatives are taken.
DERIVED = 200


def profile_all(
    problem: Problem,
    point: PointFit,
    optima: Sequence[Mapping[str, float]],
    report: Callable[[str], None] = lambda _stage: None,
    engine: Engine | None = None,
) -> tuple[Profiles, Profiles]:
    """Profiles of all free parameters, and, without the scene's contact time, of those that it touches; the search
    begins at `optima`, each all parameters by name in SI. Tables of many rows are left out unless there is an
    `engine`, which runs a task for each parameter.
    """
    problem = noise_held(problem, point.values)
    if len(problem.impacts) > PROFILED and engine is None:
        nothing = Profiles(point.log_likelihood, problem.contact_time is not None, {}, LEFT_OUT)
        return nothing, nothing
    whole = profiles(problem, optima, report=lambda stage: report(f"profiles {stage}"), engine=engine)
    touched = touched_by_scene(problem, information_evidence(problem, _coordinates(problem, point)))
    if not touched or whole.missing:
        return whole, Profiles(whole.log_likelihood, False, {}, whole.missing)
    alone = profiles(
        problem,
        optima,
        names=touched,
        scene=False,
        report=lambda stage: report(f"profiles without scene {stage}"),
        engine=engine,
    )
    return whole, alone


def with_profiles(
    problem: Problem, point: PointFit, identifiability: Identifiability, engine: Engine
) -> Identifiability:
    """The same evidence with profiles computed now by `engine`; verdicts stay as they were."""
    whole, alone = profile_all(problem, point, point.optima, engine=engine)
    evidence = {
        name: replace(seen, profile=whole.by_name.get(name), alone=alone.by_name.get(name))
        for name, seen in identifiability.evidence.items()
    }
    return replace(identifiability, evidence=evidence, profiles_missing=whole.missing)


def examine(
    problem: Problem,
    point: PointFit,
    profiled: tuple[Profiles, Profiles],
    posterior: Posterior | None,
    correlation: FloatArray | None,
    regimes: Sequence[Mapping[str, float]],
    optima: Sequence[Mapping[str, float]] = (),
) -> tuple[Identifiability, dict[str, Judgement]]:
    """Look at every parameter in every way there is, and judge; without a posterior from profile and information.

    `regimes` are the probabilities of each impact's phase sequences, empty without a posterior; `optima` those that
    searches found, from which several fits are looked for.
    """
    at = _coordinates(problem, point)
    information = information_evidence(problem, at)
    bases: dict[str, Judgement] = {}
    powers, draws = {}, at[None, :]
    if posterior is not None:
        draws = problem.to_coordinates(thinned(posterior, DERIVED))
    held_by_others = traded(problem, draws[:: -(-len(draws) // LOOKS)])
    if posterior is not None and correlation is not None:
        alone = contraction_alone(problem, information, profiled[1].by_name, held_by_others)
        bases = judge(problem, posterior, correlation, alone, held_by_others)
        powers = power_evidence(problem, posterior)
    active = active_impacts(problem, draws, regimes)
    evidence, judgements, beyond = {}, {}, extrapolated(problem)
    several = several_fits(noise_held(problem, point.values), optima or point.optima)
    for parameter in problem.parameters:
        if not parameter.free:
            held = f"held at its value: {parameter.fixed_because}"
            judgements[parameter.name] = Judgement(None, Verdict.FIXED, held)
            continue
        base = bases.get(parameter.name)
        contraction = None
        if base is not None and base.contraction is not None:
            contraction = ContractionEvidence(base.contraction, base.open_sides)
        seen = Evidence(
            profile=profiled[0].by_name.get(parameter.name),
            alone=profiled[1].by_name.get(parameter.name),
            information=information.get(parameter.name),
            contraction=contraction,
            power=powers.get(parameter.name),
            active_impacts=active.get(parameter.name),
        )
        judgements[parameter.name] = combine(
            problem,
            parameter,
            base,
            seen,
            value=point.values[parameter.name],
            many=profiled[0].missing == LEFT_OUT,
            traded=held_by_others.get(parameter.name),
            agreed=parameter.name in several.agree,
        )
        if parameter.name in beyond:
            judged = judgements[parameter.name]
            reason = f"{extrapolated_words(problem)}; {judged.reason}"
            judgements[parameter.name] = replace(judged, verdict=Verdict.EXTRAPOLATED, reason=reason)
        evidence[parameter.name] = seen
    return Identifiability(
        evidence, eigendirections(problem, at), profiled[0].missing, coverage(problem), several.words
    ), judgements


def _coordinates(problem: Problem, point: PointFit) -> FloatArray:
    values = np.array([[point.values[name] for name in problem.free_names]])
    at: FloatArray = problem.to_coordinates(values)[0]
    return at
