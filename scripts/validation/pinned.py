"""Which parameters does the likelihood of a design pin, at a truth? Asked without fitting any table.

A table without noise, at the design's incidence and with the true noise known, has the expected profile likelihood
of all tables of that design (the Asimov data set of Cowan, Cranmer, Gross and Vitells 2011, section 3); that of a
table a hundred times as long is a hundred times as steep. No prior takes part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitball.inference.identifiability.profile import DROP_95, profile_contraction, profiles
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter
from fitball.inference.problem.problem import Problem
from fitball.inference.results.evidence import End, Profile

# Contraction from which a table is said to pin a parameter (half the prior's sd), and that which a table `LONGER`
# times as long must miss for it to be beyond any table.
PINNED, BEYOND = 0.75, 0.2
LONGER = 100.0


def pinned(problem: Problem, truth: Mapping[str, float]) -> dict[str, bool | None]:
    """For each free parameter of a `problem` whether its likelihood pins it at a `truth` (by name, in SI).

    True where the expected profile, without the scene's contact time, is closed on both sides and leaves, times the
    prior, less than half of the prior's sd: to call that prior-dominated is a mistake. False where even with a
    hundred times the rows, and the scene's contact time, it is open on both sides or leaves the prior as wide as it
    was: to call that identified is one. None in between, where neither is.
    """
    table = _without_noise(problem, truth)
    alone = profiles(table, [truth], scene=False).by_name
    sure = {
        parameter.name
        for parameter in problem.free
        if (
            _noise_pinned(problem, parameter)
            if parameter.name in NOISE_SPECS
            else parameter.name in alone and _is_pinned(alone[parameter.name], parameter)
        )
    }
    rest = [name for name in alone if name not in sure]
    beside = profiles(table, [truth], names=rest).by_name if rest and table.contact_time is not None else alone
    lost = {item.name for item in problem.free if item.name in rest and _is_beyond(beside.get(item.name), item)}
    return {name: True if name in sure else False if name in lost else None for name in problem.free_names}


def _without_noise(problem: Problem, truth: Mapping[str, float]) -> Problem:
    """The table and the scene's contact time as the model has them, the true noise held."""
    held = tuple(
        replace(item, fixed=truth[item.name]) if item.free and item.name in NOISE_SPECS else item
        for item in problem.parameters
    )
    rebound = problem.rebound(np.array([[truth[name] for name in problem.free_names]]))
    made = tuple(replace(one, observed=one.predict(rebound)[0]) for one in problem.observables)
    time = problem.contact_time
    if time is not None:
        time = (float(rebound.contact_time.mean()), time[1])
    return replace(problem, parameters=held, observables=made, contact_time=time)


def _is_pinned(profile: Profile, parameter: Parameter) -> bool:
    return not any(profile.open_sides) and profile_contraction(profile, parameter.prior) >= PINNED


def _is_beyond(profile: Profile | None, parameter: Parameter) -> bool:
    if profile is None:
        return False
    longer = replace(profile, drop=LONGER * profile.drop)
    still = [
        end is End.RANGE or (end is not End.CLOSED and longer.drop[side] < DROP_95)
        for end, side in zip(profile.ends, (0, -1), strict=True)
    ]
    return all(still) or profile_contraction(longer, parameter.prior) < BEYOND


def _noise_pinned(problem: Problem, parameter: Parameter) -> bool:
    """By the expected information of a noise, 2 n of its logarithm, the parameters' share of the rows taken off."""
    count = sum(one.observed.size for one in problem.observables if one.noise == parameter.name)
    every = sum(one.observed.size for one in problem.observables)
    spent = sum(name not in NOISE_SPECS for name in problem.free_names) * count / every
    variance = 0.5 / max(count - spent, 1e-9)
    return parameter.prior.variance >= PINNED * (parameter.prior.variance + variance)
