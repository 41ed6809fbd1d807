"""A posterior with uncertain incident states that costs one bounce an impact in place of seven.

How far predictions at sigma points lie from that at the stated state changes little over a
posterior: there it is linear in the coordinates. Draws teach it by least squares. The density so
learnt takes the place of the exact one in searches, profiles and sampling; the exact one weighs
what they give.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np

from fitball.base.selection import evenly_spread
from fitball.base.values import FloatArray
from fitball.inference.density import row_blocks, sigma_points
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.row_errors import LearntOffsets

# Draws that teach: some ten for each coordinate of most problems.
TEACHING_DRAWS = 400
# Draws for each coordinate below which slopes are not known.
DRAWS_A_COORDINATE = 3


def learnt(problem: Problem, draws: Annotated[FloatArray, "draws coordinates"]) -> Problem:
    """The problem with offsets of sigma points that draws teach; an earlier lesson is forgotten.

    It is the problem itself, with its exact density, where no state is uncertain or too few draws
    have a rebound at all sigma points.
    """
    exact = unlearnt(problem)
    errors = exact.rows.errors
    if errors is None or not errors.axes.any():
        return exact
    used = np.flatnonzero([name not in exact.noises for name in exact.free])
    if len(draws) <= DRAWS_A_COORDINATE * len(used):
        return exact
    q = draws[evenly_spread(len(draws), TEACHING_DRAWS)]
    values = exact.values(q)
    blocks = []
    possible = np.ones(len(q), dtype=np.bool_)
    for block in row_blocks(exact, len(q)):
        at = sigma_points(block, values)
        possible &= at.answered.all(axis=(1, 2)) & at.possible.all(axis=1)
        blocks.append(at.points - at.centre[:, None])
    if possible.sum() <= DRAWS_A_COORDINATE * len(used):
        return exact
    offsets = np.concatenate(blocks, axis=2)[possible]
    taught = q[possible][:, used]
    centre = taught.mean(axis=0)
    at_centre = offsets.mean(axis=0)
    away = (offsets - at_centre).reshape(len(taught), -1)
    # Scaled, since scales of coordinates differ by powers of ten.
    spread = taught.std(axis=0)
    scale = np.where(spread > 0.0, spread, 1.0)
    slopes = np.linalg.lstsq((taught - centre) / scale, away, rcond=None)[0]
    slopes = (slopes / scale[:, None]).reshape(len(used), *at_centre.shape)
    law = LearntOffsets(
        used,
        taught.min(axis=0),
        taught.max(axis=0),
        centre,
        at_centre,
        slopes,
    )
    return replace(exact, rows=replace(exact.rows, learnt=law))


def unlearnt(problem: Problem) -> Problem:
    """The problem with its exact density."""
    if problem.rows.learnt is None:
        return problem
    return replace(problem, rows=replace(problem.rows, learnt=None))


def with_offsets_of(
    problem: Problem,
    law: Problem,
    x: Annotated[FloatArray, "coordinates"],
) -> Problem:
    """A variant of a problem with the offsets that the learnt `law` of another has at coordinates
    `x`, whatever the variant's own: good enough to look where its maximum is. The rows of both are
    the same. It is the variant itself where nothing was learnt.
    """
    learnt_offsets = law.rows.learnt
    if learnt_offsets is None:
        return problem
    nothing = np.empty(0)
    offsets = LearntOffsets(
        np.empty(0, dtype=np.int64),
        nothing,
        nothing,
        nothing,
        learnt_offsets.offsets(x[None])[0],
        np.empty((0, *learnt_offsets.at_centre.shape)),
    )
    return replace(problem, rows=replace(problem.rows, learnt=offsets))
