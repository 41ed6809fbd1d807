"""What of a parameter is known only through the scene's contact time."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from fitball.inference.identifiability.profile_ends import LEVELS, profile_contraction
from fitball.inference.problem.parameters import Parameter, Prior
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import Evidence, InformationEvidence, Profile

# Loss of contraction without the scene's contact time from which a parameter is said to rest on it, and the
# contraction by table and priors alone below which it is not the table that fixes it.
RESTS_ON_SCENE = 0.1
NOT_ALONE = 0.5


def touched_by_scene(problem: Problem, information: Mapping[str, InformationEvidence]) -> list[str]:
    """Names of the parameters whose standard error the scene's contact time changes."""
    if problem.contact_time is None:
        return []
    names = []
    for name, look in information.items():
        alone = look.error_without_scene
        if look.error is not None and (alone is None or alone > (1.0 + RESTS_ON_SCENE) * look.error):
            names.append(name)
    return names


def contraction_alone(
    problem: Problem,
    information: Mapping[str, InformationEvidence],
    alone: Mapping[str, Profile],
    traded: Collection[str] = (),
) -> dict[str, float]:
    """The contraction by table and priors alone of each parameter that the scene touches: to first order, or by its
    profile `alone` without the scene where that says more (at a bound the first order means little). Nothing of those
    that are `traded`: there it is the priors of others.
    """
    parameters = {parameter.name: parameter for parameter in problem.free}
    found = {}
    for name in touched_by_scene(problem, information):
        if name in traded:
            found[name] = 0.0
            continue
        found[name] = within_support(information[name].contraction_without_scene, parameters[name].prior)
        if name in alone:
            found[name] = max(found[name], profile_contraction(alone[name], parameters[name].prior))
    return found


def within_support(contraction: float, prior: Prior) -> float:
    """A contraction to first order, against a normal prior that ends nowhere, as that of a prior with its ends: by
    the variance that a normal likelihood of the same precision, about the prior's median, leaves of it.
    """
    levels = (np.arange(LEVELS) + 0.5) / LEVELS
    coordinate = prior.coordinate(prior.quantile(levels))
    unit = prior.width if prior.normal else prior.width / 12.0**0.5
    away = (coordinate - np.median(coordinate)) / unit
    weight = np.exp(-0.5 * contraction / (1.0 - contraction) * away**2)
    mean = np.average(away, weights=weight)
    return 1.0 - float(np.average((away - mean) ** 2, weights=weight) / np.var(away))


def known_by_scene(problem: Problem, parameter: Parameter, evidence: Evidence, traded: bool) -> bool:
    """Without a posterior: whether it is the scene's contact time that closes a profile, and not the table."""
    if evidence.information is None or not (traded or rests_on_scene(evidence)):
        return False
    alone = {} if evidence.alone is None else {parameter.name: evidence.alone}
    names = (parameter.name,) if traded else ()
    found = contraction_alone(problem, {parameter.name: evidence.information}, alone, names)
    return found.get(parameter.name, np.inf) < NOT_ALONE


def rests_on_scene(evidence: Evidence) -> bool:
    """Whether the profile without the scene's contact time is open although it is closed with it."""
    if evidence.alone is None or evidence.profile is None:
        return False
    return any(evidence.alone.open_sides) and not all(evidence.profile.open_sides)


def scene_words(problem: Problem) -> str:
    """What the scene knows of the contact time."""
    if problem.contact_time is None:
        return "the scene"
    value, sd = problem.contact_time
    return f"the scene's contact time ({1e3 * value:.3g} +- {1e3 * sd:.2g} ms)"
