"""Modes of a posterior: what each says, and which maxima of the search hold the mass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Annotated

import numpy as np

from fitball.base.errors import Note
from fitball.base.numbers import FEWEST_DRAWS, Unit
from fitball.base.priors import ParameterSpec
from fitball.base.text import listed
from fitball.base.values import FloatArray, IntArray
from fitball.inference.forward import Draws
from fitball.inference.problem.problem import COMMON_PARAMETERS, Problem, base_of
from fitball.inference.sampling.convergence import Mixing
from fitball.inference.sampling.parts import Parts, centrality, parts_of
from fitball.inference.schema import Diagnostics, Mode, PointFit, Posterior, Summary
from fitball.inference.search.best_fit import point_of
from fitball.inference.search.objective import Objective, descend
from fitball.inference.summary import summarise

# Share of a mode's draws that lie nearer to its middle than a maximum that holds its mass: of those
# of usual posteriors it is below 0.02, of narrow peaks beside the mass above 0.8.
CENTRAL = 0.5
# Quantities of a mode that its note names.
NAMED_QUANTITIES = 3


def parts_of_posterior(
    problem: Problem,
    point: PointFit,
    posterior: Posterior,
    diagnostics: Diagnostics,
) -> Parts:
    """The parts of the draws with gaps between them."""
    maxima = np.stack([problem.coordinates(values) for values in point.optima])
    return parts_of(_coordinates(problem, posterior), maxima, _effective(diagnostics))


def _effective(diagnostics: Diagnostics) -> float:
    """The effective sample size of the parameter that has the smallest."""
    return min(diagnostics.ess_bulk.values())


def with_mass_first(
    problem: Problem,
    point: PointFit,
    posterior: Posterior,
    parts: Parts,
) -> PointFit:
    """The maxima of the search, first that of each mode, of the largest share first, and then all
    others. Of a mode it is the highest that lies in the middle of its draws, which may be one that
    a search from there reaches: a higher, narrow peak may hold little of the posterior.
    """
    maxima = np.stack([problem.coordinates(values) for values in point.optima])
    heights = np.array(point.log_posterior)
    draws = _coordinates(problem, posterior).reshape(-1, len(problem.free))
    labels = parts.of(draws)
    first = list[int]()
    for part in range(len(parts.ranks)):
        inside = draws[labels == part]
        k = _central(inside, maxima, np.flatnonzero(parts.of(maxima) == part))
        if k is None:
            middle = inside[centrality(inside, inside).argmin()]
            reached, cost, _ = descend(Objective(problem), middle[None])
            added = np.concatenate([maxima, reached])
            k = _central(inside, added, np.array([len(maxima)]))
            if k is not None and parts.of(reached)[0] == part:
                maxima = added
                heights = np.append(heights, -cost)
            else:
                # There is no other: the highest of this part, if it has any.
                k = next(iter(np.flatnonzero(parts.of(maxima) == part).tolist()), None)
        if k is not None:
            first.append(k)
    order = [*first, *(k for k in range(len(maxima)) if k not in first)]
    if order == list(range(len(point.optima))):
        return point
    return point_of(problem, maxima[order], heights[order])


def _central(
    draws: FloatArray,
    maxima: FloatArray,
    candidates: IntArray,
) -> int | None:
    """The first of the candidates, indices of maxima, that lies in the middle of draws, if any."""
    if not candidates.size:
        return None
    within = candidates[centrality(draws, maxima[candidates]) < CENTRAL]
    return int(within[0]) if within.size else None


def _coordinates(
    problem: Problem, posterior: Posterior
) -> Annotated[FloatArray, "ensembles steps walkers coordinates"]:
    """The coordinates of all draws."""
    values = posterior.values
    flat = values.reshape(-1, values.shape[-1])
    return problem.prior.coordinate(flat).reshape(values.shape)


def modes_of(
    problem: Problem,
    point: PointFit,
    posterior: Posterior | None,
    diagnostics: Diagnostics | None,
    draws: Draws,
    parts: Parts,
) -> tuple[Mode, ...]:
    """What each mode says of all free parameters and derived quantities, that of the largest share
    first; none if there is one only, or no posterior with diagnostics.
    """
    if posterior is None or diagnostics is None or not parts.splits:
        return ()
    effective = _effective(diagnostics)
    labels = parts.of(_coordinates(problem, posterior).reshape(-1, len(problem.free)))
    by_chain = labels.reshape(posterior.values.shape[:-1])
    sampled = np.stack([draws.values[name] for name in problem.free], axis=1)
    of_draws = parts.of(problem.prior.coordinate(sampled))
    maxima = np.stack([problem.coordinates(values) for values in point.optima])
    of_maxima = parts.of(maxima)
    modes = []
    for part in range(len(parts.ranks)):
        inside = {name: values[of_draws == part] for name, values in draws.values.items()}
        peak = next(iter(np.flatnonzero(of_maxima == part).tolist()), None)
        best = None if peak is None else point.optima[peak]
        share, error = _share(by_chain == part, effective)
        modes.append(Mode(share, error, _summaries(problem, inside, best)))
    return tuple(modes)


def _share(
    inside: Annotated[FloatArray, "ensembles steps walkers"],
    effective: float,
) -> tuple[float, float]:
    """The share of the draws that are inside, and its Monte Carlo error, by as many draws as are
    `effective`: weighted draws that were drawn again look independent. Walkers that seldom change
    modes leave fewer.
    """
    share = float(inside.mean())
    indicator = inside[..., None].astype(np.float64)
    of_chains = Mixing(("inside",), indicator).ess_bulk["inside"]
    fewer = min(effective, of_chains)
    return share, float(np.sqrt(share * (1.0 - share) / fewer))


def _summaries(
    problem: Problem,
    draws: Mapping[str, FloatArray],
    best: Mapping[str, float] | None,
) -> dict[str, Summary]:
    """The summary of each quantity by draws of a mode, with its value at the `best` values of the
    mode; NaN where no search reached any.
    """
    columns = {name: draws[name] for name in problem.free}
    points = dict.fromkeys(columns, np.nan)
    if best is not None:
        points = {name: best[name] for name in columns}
    at_best = None if best is None else {name: np.array([value]) for name, value in best.items()}
    for quantity in problem.derived:
        name = quantity.spec.name
        columns[name] = quantity.rule(draws)
        points[name] = np.nan if at_best is None else float(quantity.rule(at_best)[0])
    return {name: summarise(column, points[name]) for name, column in columns.items()}


def differing(modes: Sequence[Mode]) -> list[str]:
    """The quantities in which modes differ, those that are farthest apart first. Of two modes that
    differ neither has its median in the 95 % interval of the other.
    """
    apart = dict[str, float]()
    for one, other in combinations(modes, 2):
        for name, here in one.summaries.items():
            there = other.summaries[name]
            inside = here.q025 <= there.median <= here.q975 or (
                there.q025 <= here.median <= there.q975
            )
            width = here.half + there.half
            if not inside and width > 0.0:
                distance = abs(here.median - there.median) / width
                apart[name] = max(apart.get(name, 0.0), distance)
    return sorted(apart, key=lambda name: -apart[name])


def doubts_of(problem: Problem, modes: Sequence[Mode]) -> dict[str, str]:
    """For each quantity in which modes differ, a sentence that says so."""
    specs = _specs(problem)
    doubts = {}
    for name in differing(modes):
        values = [f"{_value(specs[name], mode, name)} ({share(mode)})" for mode in modes]
        doubts[name] = f"But the posterior has {len(modes)} solutions: {', '.join(values)}."
    return doubts


def notes_of(problem: Problem, modes: Sequence[Mode]) -> Iterator[Note]:
    """Notes (`modes`) on the modes, one for all and one for each, with its share and the values in
    which it differs most.
    """
    if not modes:
        return
    text = (
        f"The posterior has {len(modes)} separate solutions. Best values, residual tests and "
        "curves of the best fit are those of the first."
    )
    yield Note("modes", text)
    specs = _specs(problem)
    physical = [name for name in differing(modes) if base_of(name) not in COMMON_PARAMETERS]
    for k, mode in enumerate(modes, 1):
        values = [
            f"{name} {_value(specs[name], mode, name)}" for name in physical[:NAMED_QUANTITIES]
        ]
        named = f": {listed(values)}" if values else ""
        yield Note("modes", f"Solution {k}, {share(mode)} of the posterior{named}.")


def share(mode: Mode) -> str:
    """The share of a mode with its Monte Carlo error, `18 ± 2 %`."""
    return f"{100.0 * mode.share:.0f} ± {max(100.0 * mode.error, 1.0):.0f} %"


def _specs(problem: Problem) -> dict[str, ParameterSpec]:
    """The specifications of all parameters and derived quantities by name."""
    specs = {parameter.spec.name: parameter.spec for parameter in problem.parameters}
    return specs | {quantity.spec.name: quantity.spec for quantity in problem.derived}


def _value(spec: ParameterSpec, mode: Mode, name: str) -> str:
    """The median and the 95 % interval of a quantity in a mode, as text."""
    unit = spec.display_unit
    return unit.with_unit(value_in_mode(unit, mode, name))


def value_in_mode(unit: Unit, mode: Mode, name: str) -> str:
    """`0.96 [0.82, 1.21]` of a quantity in a mode, which has its share of the effective draws."""
    summary = mode.summaries[name]
    draws = mode.share * FEWEST_DRAWS
    return unit.with_interval(summary.median, summary.q025, summary.q975, draws)
