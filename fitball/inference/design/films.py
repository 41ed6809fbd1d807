"""A film as a way of measuring planned impacts: the errors that its frames leave, row by row, as a table of tracked
impacts states them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitball.data.table import Covariance
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.row_errors import errors_from
from fitball.models.types import Rebound
from fitball.tracks.frames import NINE
from fitball.tracks.precision import nine_covariance
from fitball.tracks.simulate import Film
from fitball.values import FloatArray

# Standard deviation, in SI, of what a film does not determine: so wide that it says nothing.
NOTHING = 1e4


def as_filmed(planned: Problem, film: Film, rebound: Rebound) -> Problem:
    """The problem of planned impacts with the errors of a film, for `rebound` (draws, impacts) of draws.

    Errors of rows are those at the median rebound over draws. An impact that is seen in too few frames, and spins
    without a mark, have errors beyond any value.
    """
    names = ("v_x2", "v_y2", "omega_2", "contact_time", "gap_time", "gap_path", "gap_turn")
    middle = {name: _median(getattr(rebound, name)) for name in names}
    known = np.isfinite(np.array(list(middle.values()))).all(axis=0)
    usual = {name: np.where(known, values, 1.0) for name, values in middle.items()}
    count = len(planned.impacts)
    typical = replace(rebound.each(lambda array: array[0]), **usual)
    found = np.full((count, len(NINE), len(NINE)), np.nan)
    rows = np.flatnonzero(known)
    if rows.size:
        found[rows] = nine_covariance(planned.impacts.take(rows), typical.take(rows), film, planned.scene.ball)
    lost = ~np.isfinite(np.diagonal(found, axis1=1, axis2=2))
    found = np.where(lost[:, :, None] | lost[:, None, :], 0.0, found)
    found[:, range(len(NINE)), range(len(NINE))] += np.where(lost, NOTHING**2, 0.0)
    return replace(planned, errors=errors_from(Covariance(NINE, found), NINE[3:]))


def _median(values: FloatArray) -> FloatArray:
    """Over the draws that have a value; NaN where none has."""
    some = np.isfinite(values).any(axis=0)
    return np.where(some, np.nanmedian(np.where(some, values, 0.0), axis=0), np.nan)
