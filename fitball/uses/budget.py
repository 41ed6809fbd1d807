"""Uncertainty budgets of a fit's results, as the Guide to the Expression of Uncertainty in
Measurement (GUM, JCGM 100:2008) has them, checked by a Monte Carlo of the whole (JCGM 101:2008).

Of type A is the scatter of what was measured, of type B what is known otherwise: priors, a stated
contact time, constants that are held. The posterior sd of a result is shared out between scatter,
priors and contact time by the linearisation of the fit. A held constant contributes its standard
uncertainty, stated or that of a rectangular distribution over its tolerance, times the change of a
refit by one unit. Sources are taken as independent.

The Monte Carlo draws all constants together. At each drawing the best fit is searched anew, and
draws of the posterior move with it; results are computed of these with the constants as drawn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from weakref import WeakKeyDictionary

import numpy as np

from fitball.base.selection import evenly_spread
from fitball.base.values import DataFrame, FloatArray
from fitball.data.table import ImpactTable
from fitball.inference.effort import Effort
from fitball.inference.fitted import Fitted
from fitball.inference.judgement.constants import Moved, moves_of_constants
from fitball.inference.judgement.first_order import FirstOrder, first_order, slopes_of_all
from fitball.inference.problem.problem import Problem
from fitball.inference.schema import Posterior
from fitball.inference.search.objective import Objective, descend
from fitball.uses.groups import DETERMINED_VERDICTS
from fitball.uses.lab_budget import measured_rows
from fitball.uses.sources import DRAWINGS, Budget, Source, combined, hypercube, rows_of_result

# Kinds of results that have a budget.
_KINDS = ("model", "level", "derived")
# Results with a budget.
_MOST_RESULTS = 12
# Draws of the posterior at each drawing of the constants.
_DRAWS = 96
# Most bounces of a Monte Carlo; with more impacts it has fewer drawings.
_MOST_BOUNCES = 400_000
# Fewest drawings by which it says something.
_FEWEST_DRAWINGS = 24
# What the next step of a search may promise at its end: half the square of so many sds, here 0.045.
_CONVERGED = 1e-3
# Rounds without such a gain after which a search ends: it creeps along a kink. By all rounds the
# standard uncertainties of Wang's tables are the same to 0.6 %.
_PATIENCE = 3

# By table the frame of the posterior of a fit: page and workbook ask for the same.
_MADE: WeakKeyDictionary[ImpactTable, tuple[Posterior | None, DataFrame]] = WeakKeyDictionary()


def budgets(fit: Fitted) -> DataFrame:
    """A row a result and source, in SI: `result`, its `unit`; `source`, `value`, `uncertainty`,
    `source_unit`, `type` (A or B), `distribution`, `sensitivity`, `contribution`, `share` of the
    variance; on a last row, source "combined", are `value` and, without constants, `uncertainty` of
    the result; there `contribution` is the combined standard uncertainty, `expanded` that times
    COVERAGE, `monte_carlo` that of a Monte Carlo of the whole (NaN: none), and whether the result
    is `linear`. Laboratory results come first. Empty without a posterior. Made once of each fit.
    """
    import pandas as pd

    made = _MADE.get(fit.run.table)
    if made is not None and made[0] is fit.posterior:
        return made[1]
    heads = ["result", "unit", "source", "value", "uncertainty", "source_unit", "type"]
    heads += ["distribution", "sensitivity", "contribution", "share", "expanded", "monte_carlo"]
    heads += ["linear"]
    rows = [*measured_rows(fit), *_rows(fit)] if fit.posterior is not None else []
    frame = pd.DataFrame(rows, columns=heads)
    _MADE[fit.run.table] = fit.posterior, frame
    return frame


def _rows(fit: Fitted) -> Iterator[dict[str, object]]:
    """The rows of all results."""
    problem = fit.problem
    first = first_order(problem, fit.point)
    derived = problem.derived
    names = [*first.names, *(quantity.spec.name for quantity in derived)]
    estimates = {estimate.name: estimate for estimate in fit.reported}
    chosen = [
        k
        for k, name in enumerate(names)
        if name in estimates
        and estimates[name].kind in _KINDS
        and estimates[name].verdict in DETERMINED_VERDICTS
        and estimates[name].sd > 0.0
    ][:_MOST_RESULTS]
    if not chosen:
        return
    along = _in_si(fit, first, slopes_of_all(problem, first, derived))[chosen]
    sds = np.array([estimates[names[k]].sd for k in chosen])
    moved = list(moves_of_constants(problem, first, derived))
    sources = [
        *_sources_of_fit(fit, first, along, sds),
        *(_source_of_constant(entry, along, entry.directly[chosen]) for entry in moved),
    ]
    by_drawing = _monte_carlo(fit, first, [names[k] for k in chosen], sds, moved)
    for k, (place, sd) in enumerate(zip(chosen, sds.tolist(), strict=True)):
        name = names[place]
        unit = fit.quantity(name).spec.unit
        value = estimates[name].median
        whole = Budget(name, unit, value, sd, combined(sources, k), float(by_drawing[k]))
        yield from rows_of_result(whole, sources, k)


def _in_si(
    fit: Fitted,
    first: FirstOrder,
    along: FloatArray,
) -> FloatArray:
    """The slopes of all quantities (quantities, parameters), those of parameters in SI too."""
    problem = fit.problem
    centre = first.proposal.centre
    rates = np.ones(len(along))
    for k, name in enumerate(first.names):
        place = problem.free.index(name)
        step = np.zeros(len(centre))
        step[place] = 1e-4 * first.sds[k]
        above = problem.values((centre + step)[None])[name][0]
        below = problem.values((centre - step)[None])[name][0]
        # From sds of the prior in the coordinate to SI.
        rates[k] = (above - below) / 2e-4
    return along * rates[:, None]


def _sources_of_fit(
    fit: Fitted,
    first: FirstOrder,
    along: FloatArray,
    sds: FloatArray,
) -> Iterator[Source]:
    """The sources of the posterior sds (results,): each measured column, contact time, priors."""
    directions = along @ first.root
    total = np.linalg.norm(directions, axis=1)
    lengths = (first.slopes @ first.root) @ directions.T
    squares = (lengths / total) ** 2
    # Of a long table some rows stand for all.
    count = first.residual.size
    squares[:count] /= first.share
    values = fit.draws.best
    for k, column in enumerate(first.columns):
        share = squares[:count][first.column == k].sum(axis=0)
        observable = fit.problem.observables[k]
        sd = float(fit.summary["point"].get(observable.noise, np.nan))
        if observable.noise in values:
            sd = float(values[observable.noise][0])
        name = f"scatter of {column}"
        normal = "normal" if fit.problem.forward.noise.name == "normal" else "student-t"
        yield Source(name, 0.0, sd, observable.column.unit, "A", normal, np.sqrt(share) * sds)
    begin = count
    if fit.problem.contact_time is not None:
        time, error = fit.problem.contact_time
        contribution = np.sqrt(squares[count]) * sds
        yield Source("contact time of the scene", time, error, "s", "B", "normal", contribution)
        begin += 1
    for k, name in enumerate(first.names):
        # A row of the Cholesky factor of their curvature is that of one prior, but for levels.
        contribution = np.sqrt(squares[begin + k]) * sds
        parameter = fit.parameters[name]
        place = fit.problem.free.index(name)
        plain = fit.problem.prior.plain[place]
        sd = float(first.sds[k]) if plain else np.nan
        yield Source(
            f"prior of {name}", parameter.point, sd, parameter.unit, "B", "prior", contribution
        )


def _source_of_constant(moved: Moved, along: FloatArray, directly: FloatArray) -> Source:
    """A held constant as a source."""
    held = moved.held
    sensitivity = along @ moved.coordinates + directly
    spec_unit = unit_of_constant(held.name)
    return Source(
        held.name,
        held.value,
        held.uncertainty,
        spec_unit,
        "B",
        "normal" if held.sd > 0.0 else "rectangular",
        sensitivity * held.uncertainty,
    )


def unit_of_constant(name: str) -> str:
    """The SI unit of a held constant of ball or camera."""
    from fitball.inference.problem.camera import CAMERA_SPECS
    from fitball.models.specs import SPECS

    return {**SPECS, **CAMERA_SPECS}[name.partition("[")[0]].unit


def _monte_carlo(
    fit: Fitted,
    first: FirstOrder,
    names: Sequence[str],
    sds: FloatArray,
    moved: Sequence[Moved],
) -> FloatArray:
    """The standard uncertainties of results (results,) by drawing all constants together; NaN where
    there are too many impacts, and where the best fit of a drawing was not found.
    """
    problem = fit.problem
    drawings = min(DRAWINGS, _MOST_BOUNCES // (_DRAWS * len(problem.rows.y)))
    if not moved:
        return sds
    if drawings < _FEWEST_DRAWINGS:
        return np.full(len(names), np.nan)
    quantities = [fit.quantity(name) for name in names]
    free = np.stack([fit.draws.values[name] for name in problem.free], axis=1)
    q = problem.prior.coordinate(free[evenly_spread(len(free), _DRAWS)])
    places = [problem.free.index(name) for name in first.names]
    centre = problem.coordinates(fit.point.optima[0])
    shares = hypercube(len(moved), drawings, Effort().stream("budget"))
    drawn = np.stack([entry.held.values(row) for entry, row in zip(moved, shares, strict=True)])
    results = []
    for values in drawn.T.tolist():
        posed = problem
        begin = centre.copy()
        for entry, value in zip(moved, values, strict=True):
            posed = posed.with_constant(entry.held.name, value)
            begin[places] += entry.coordinates * (value - entry.held.value) * first.sds
        by_name = posed.values(q + (_refitted(posed, begin) - centre))
        results.append([quantity.rule(by_name) for quantity in quantities])
    found = np.array(results)
    by_name = problem.values(q)
    here = np.stack([quantity.rule(by_name) for quantity in quantities]).var(axis=1)
    # The variance of few draws is that of the same draws here, that of all of them is better known.
    within = sds**2 * found.var(axis=2).mean(axis=0) / here
    return np.asarray(np.sqrt(within + found.mean(axis=2).var(axis=0)))


def _refitted(posed: Problem, begin: FloatArray) -> FloatArray:
    """The best coordinates (coordinates,) of a problem, searched for from a place near to them; NaN
    where the model has no answer. A search that ends at a kink of the model counts.
    """
    x, cost, _ = descend(Objective(posed), begin[None], _CONVERGED, patience=_PATIENCE)
    return np.asarray(np.where(np.isfinite(cost)[:, None], x, np.nan)[0])
