"""The likelihood of a table whose incident states were measured with errors; see `incident` and `kinks`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from fitball.inference import kinks
from fitball.inference.channels import Channel
from fitball.inference.incident import IncidentErrors, channel_slopes, spread_by_input, whitened
from fitball.inference.parameters import TAILS
from fitball.inference.scatter import log_density
from fitball.models.types import Rebound
from fitball.values import FloatArray, Impacts

if TYPE_CHECKING:
    from fitball.inference.posterior import Problem

Columns = Mapping[str, FloatArray]
# Stands for the spread of a measurement that is not there: its square is finite, its inverse nothing.
UNKNOWN = 1e150
# Angle [rad] by which a velocity noise of 1 m/s turns a rebound of some 10 m/s.
TURN = 0.1


def marginal_terms(
    problem: Problem, incident: IncidentErrors, values: FloatArray, rebound: Rebound
) -> Mapping[str, FloatArray]:
    """Log density of each measurement given those before it, channel name -> (draws, impacts).

    Near a change of regime only their sum over an impact is meant: it stands in the first channel.
    """
    columns = problem.all_values(values)
    rows = np.arange(len(problem.impacts))
    z, sds = standardised(problem, columns, rebound, problem.impacts, rows, incident.covariance)
    tails = columns[TAILS][:, None] if TAILS in columns else None
    names = [channel.name for channel in problem.channels]
    terms = {name: _density(one, sd, tails) for name, one, sd in zip(names, z, sds, strict=True)}
    _correct_kinks(problem, incident, columns, rebound, terms)
    return terms


def _density(z: FloatArray, sd: FloatArray, tails: FloatArray | None) -> FloatArray:
    """Log density of a whitened measurement; 0 where there is none."""
    return np.where(sd < UNKNOWN, log_density(z, tails) - np.log(sd), 0.0)


def incident_sds(problem: Problem, columns: Columns, rebound: Rebound) -> Mapping[str, FloatArray | float]:
    """What incident errors alone make each channel scatter by (draws, impacts), to first order; 0 without them."""
    if problem.incident is None:
        return {channel.name: 0.0 for channel in problem.channels}
    slopes = problem.slopes_like(columns, problem.impacts, np.arange(len(problem.impacts)))
    return {
        channel.name: np.sqrt(
            np.einsum("dik,ikl,dil->di", found, problem.incident.covariance, found, optimize=True).clip(0.0)
        )
        for channel in problem.channels
        for found in (channel_slopes(channel, rebound, slopes),)
    }


def standardised(
    problem: Problem,
    columns: Columns,
    rebound: Rebound,
    impacts: Impacts,
    rows: NDArray[np.int64],
    covariance: FloatArray,
) -> tuple[list[FloatArray], list[FloatArray]]:
    """Whitened deviations of the table's `rows` from rebounds of `impacts` near them, first order about these.

    `covariance` (impacts, 3, 3); returns those (draws, impacts) of each channel, and their conditional sds. What was
    not measured has the deviation zero and the sd `UNKNOWN`, which takes part in nothing.
    """
    slopes = problem.slopes_like(columns, impacts, rows)
    by_channel = np.stack([channel_slopes(channel, rebound, slopes) for channel in problem.channels], axis=2)
    gaps, spreads = [], []
    for channel in problem.channels:
        observed, sd = channel.over(len(problem.impacts))
        cut = replace(channel, observed=observed[rows], sd=None if sd is None else sd[rows], rows=None)
        gap = cut.observed - cut.predict(rebound)
        if problem.offsets is not None:
            gap = gap - problem.offsets.take(rows).offset(columns, channel.name)
        noise = columns[channel.noise][:, None] if channel.noise is not None else 0.0
        missing = np.isnan(cut.observed)
        gaps.append(np.where(missing, 0.0, gap))
        spreads.append(np.where(missing, UNKNOWN, np.broadcast_to(cut.spread(noise, rebound), gap.shape)))
    return whitened(gaps, spreads, spread_by_input(by_channel, covariance))


def _correct_kinks(
    problem: Problem, incident: IncidentErrors, columns: Columns, rebound: Rebound, terms: dict[str, FloatArray]
) -> None:
    root = kinks.roots(incident.covariance)
    direction = kinks.crossings(
        lambda impacts, rows: problem.rebound_like(columns, impacts, rows), problem.impacts, root, rebound
    )
    near = np.any(np.abs(direction) > 0.0, axis=-1)
    first, *others = terms
    for draw in np.flatnonzero(near.any(axis=1)):
        rows = np.flatnonzero(near[draw])
        one = {name: column[draw : draw + 1] for name, column in columns.items()}
        terms[first][draw, rows] = _mixture(problem, one, rows, root[rows], direction[draw, rows])
        for name in others:
            terms[name][draw, rows] = 0.0


def _mixture(
    problem: Problem, one: Columns, rows: NDArray[np.int64], root: FloatArray, direction: FloatArray
) -> FloatArray:
    """Log density (rows,) of all measurements of the table's `rows` for one draw, its incident errors split."""
    centres, _ = kinks.parts()
    across = _across(problem, one, rows, root, direction)
    along = np.einsum("pij,pj->pi", root, across)
    narrow = kinks.narrowed(root, across)
    moves = centres[:, None, None] * along
    repeated = np.tile(rows, centres.size)
    flat = moves.reshape(-1, 3)
    # A part beyond the court's plane has no impact: its weight is lost, as that of states that cannot be.
    possible = problem.impacts.v_y1[repeated] + flat[:, 1] > 0.0
    kept = repeated[possible]
    impacts = kinks.shifted(problem.impacts, flat[possible], kept)
    rebound = problem.rebound_like(one, impacts, kept)
    covariance = np.tile(narrow, (centres.size, 1, 1))[possible]
    z, sds = standardised(problem, one, rebound, impacts, kept, covariance)
    tails = one[TAILS][:, None] if TAILS in one else None
    density = np.sum([_density(a, b, tails) for a, b in zip(z, sds, strict=True)], axis=0)[0]
    density = np.where(rebound.status[0] == 0, density, -np.inf)
    all_parts = np.full(repeated.size, -np.inf)
    all_parts[possible] = density
    return kinks.mixed(all_parts.reshape(centres.size, rows.size))


def _across(
    problem: Problem, one: Columns, rows: NDArray[np.int64], root: FloatArray, towards: FloatArray
) -> FloatArray:
    """Directions (rows, 3), in principal axes, across the boundaries that lie `towards` (rows, 3) somewhere.

    The rebound is continuous, so that its derivative jumps by a matrix of rank one whose rows point across.
    """
    moves = np.einsum("pij,pj->pi", root, kinks.REACH * towards)
    beyond = kinks.shifted(problem.impacts, moves, rows)
    here = problem.impacts.take(rows)
    slopes = []
    for impacts in (here, beyond):
        rebound = problem.rebound_like(one, impacts, rows)
        found = problem.slopes_like(one, impacts, rows)
        # In units of any noise: only the direction of the jump is wanted.
        by_channel = [
            channel_slopes(channel, rebound, found)[0] / _typical_noise(channel, one) for channel in problem.channels
        ]
        slopes.append(np.stack(by_channel, axis=1))
    jump = np.einsum("pci,pij->pcj", slopes[1] - slopes[0], root)
    # Where the other side has no derivative the way that was looked is all that is known.
    known = np.isfinite(jump).all(axis=(1, 2))
    across = towards.copy()
    across[known] = np.linalg.svd(jump[known])[2][:, 0]
    return across


def _typical_noise(channel: Channel, one: Columns) -> float:
    size = float(np.median(channel.sd)) if channel.sd is not None else float(one[str(channel.noise)][0])
    return TURN * size if channel.name == "theta_2" and channel.sd is None else size
