"""What incidences that were measured again say: how far measurements repeat, apart from what the model does.

Within rows of one incidence nothing but errors and balls differs. Their scatter, the pure error, is held against the
stated errors, and against what is left of residuals: the test of lack of fit (Draper and Smith 1998, section 2.1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc

from fitball.inference.adequacy.refit import Refit
from fitball.inference.adequacy.words import size_words
from fitball.inference.likelihood.cells import cells
from fitball.inference.problem.problem import Problem
from fitball.inference.results import sentences
from fitball.inference.results.results import PointFit
from fitball.observables import INCIDENT_UNITS
from fitball.values import FloatArray

# Degrees of freedom from which repeats are spoken of.
LEAST_FREEDOM = 4
# Probability below which scatter and misfit are there; the multiple of stated errors that is no rounding.
SURE, LARGER = 0.01, 1.2
# Share of a state's size within which two are equal where nothing is known of how they were printed.
ROUNDING = 1e-9
# The multiple of stated errors from which a scatter matters although nothing was measured again.
MUCH = 2.0


@dataclass(frozen=True)
class Repeats:
    """The pure error of one column in SI beside its residual sd and stated error (None where there is none), with
    their degrees of freedom; `scatter` and `misfit` are the probabilities of so much more than stated, and of so much
    more residual than pure error (None where nothing else is left).
    """

    column: str
    pure: float
    residual: float
    stated: float | None
    freedom: float
    scatter: float | None
    misfit: float | None


def same_incidence(problem: Problem) -> NDArray[np.int64]:
    """A number for each row (impacts,), the same where the incidence is: within its printed digits, or within its
    errors, and at the same levels of what differs between surfaces, balls or places.
    """
    given = problem.impacts
    state = np.stack([given.v_x1, given.v_y1, given.omega_1], axis=1)
    steps = [2.0 * problem.table.resolution.get(name, 0.0) for name in INCIDENT_UNITS]
    tolerance = np.maximum(np.array(steps) * (1.0 - ROUNDING), ROUNDING * np.abs(state).max(axis=0))
    # Printed numbers are equal or a whole step apart.
    near = np.tile(0.5 * tolerance, (len(state), 1))
    if problem.errors is not None:
        near = np.maximum(near, np.sqrt(np.diagonal(problem.errors.incident, axis1=1, axis2=2)))
    levels = np.stack([np.zeros(len(state), dtype=np.int64), *(item.index for item in problem.pooling)], axis=1)
    order = np.lexsort(state.T[::-1])
    sorted_v, number = state[order, 0], np.full(len(state), -1)
    for place, row in enumerate(order):
        if number[row] < 0:
            last = np.searchsorted(sorted_v, sorted_v[place] + near[row, 0], side="right")
            some = order[place:last]
            alike = np.all(np.abs(state[some] - state[row]) <= near[row], axis=1)
            alike &= np.all(levels[some] == levels[row], axis=1) & (number[some] < 0)
            number[some[alike]] = row
    return number


def repeats_of(problem: Problem, point: PointFit, fit: Refit) -> tuple[int, tuple[Repeats, ...]]:
    """How many incidences were measured again, and what each column says where enough were."""
    number = same_incidence(problem)
    again = np.unique(number, return_counts=True)[1]
    found: list[Repeats] = []
    if int(np.sum(again - 1)) >= LEAST_FREEDOM:
        at = problem.to_coordinates(problem.free_rows([point.values]))
        sds = np.exp(cells(problem, at).log_sd[0])
        for k, item in enumerate(problem.observables):
            rows, places = fit.rows(k), fit.places[k]
            stated = None
            if item.sd is not None and not problem.uncertain:
                stated = float(np.median(item.sd))
            left = float(np.sum(1.0 - fit.leverage[rows]))
            one = _column(item.name, fit.measured[rows], number[places], left, float(np.median(sds[rows])), stated)
            found += [] if one is None else [one]
    return int(np.sum(again > 1)), tuple(found)


def _column(
    name: str, z: FloatArray, number: NDArray[np.int64], left: float, size: float, stated: float | None
) -> Repeats | None:
    """Of residuals `z` (rows,) in units of a spread of typical `size`, with `left` degrees of freedom."""
    _names, place, counts = np.unique(number, return_inverse=True, return_counts=True)
    freedom = float(np.sum(counts - 1))
    if freedom < LEAST_FREEDOM or left <= 0.0:
        return None
    means = np.bincount(place, z) / counts
    inside, whole = float(np.sum((z - means[place]) ** 2)), float(np.sum(z**2))
    rest, misfit = left - freedom, None
    if rest >= 1.0 and inside > 0.0:
        misfit = float(fdtrc(rest, freedom, max(whole - inside, 0.0) / rest / (inside / freedom)))
    pure = size * float(np.sqrt(inside / freedom))
    scatter = None if stated is None else float(chdtrc(freedom, freedom * (pure / stated) ** 2))
    return Repeats(name, pure, size * float(np.sqrt(whole / left)), stated, freedom, scatter, misfit)


def repeats_words(problem: Problem, point: PointFit, fit: Refit) -> tuple[str, ...]:
    """What repeats say, in sentences; where none were measured and columns scatter far beyond their stated errors,
    that only repeats would separate balls from model.
    """
    count, found = repeats_of(problem, point, fit)
    if not found:
        far = far_beyond(problem, point)
        return (sentences.NO_REPEATS.format(columns=sentences.listed(far)),) if far else ()
    worse: list[str] = []
    share = SURE / len(found)
    freedom = f"{max(item.freedom for item in found):.0f}"
    lines = [(sentences.REPEATED if count > 1 else sentences.REPEATED_ONE).format(count=count, freedom=freedom)]
    for item in found:
        known = {"column": item.column, "pure": size_words(item.column, item.pure)}
        known |= {"left": size_words(item.column, item.residual)}
        if item.stated is None or item.scatter is None:
            words = sentences.REPEATS
        else:
            known |= {"stated": size_words(item.column, item.stated)}
            words = sentences.REPEATS_STATED
            if item.scatter < share and item.pure > LARGER * item.stated:
                worse.append(item.column)
        lines.append(words.format_map(known))
        if item.misfit is not None and item.misfit < share:
            lines.append(sentences.LACK_OF_FIT.format_map(known))
    if worse:
        lines.append(sentences.IMPACTS_SCATTER.format(columns=sentences.listed(worse)))
    return tuple(lines)


def far_beyond(problem: Problem, point: PointFit) -> Sequence[str]:
    """Columns whose scatter is far above their stated errors."""
    columns = problem.all_values(problem.free_rows([point.values]))
    return [
        item.name
        for item in problem.observables
        if item.scatters
        and item.sd is not None
        and float(np.median(item.scatter(columns[str(item.noise)][:, None], point.rebound)))
        > MUCH * np.median(item.sd)
    ]
