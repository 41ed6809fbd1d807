"""Balls that fly either way, and straight down, by solvers of balls that fly towards positive v_x.

The offset `eps` of the normal force lies ahead in the direction of travel, so that a ball and its
mirror image leave as mirror images. Straight down there is no direction: with `r = |v_x1|/(v_y1 tan
2 deg)` and the odd polynomial `s(r) = (15 r - 10 r^3 + 3 r^5)/8`, which reaches 1 without slope and
curvature, what acts is `eps s(r)` ahead where `r < 1`, else `eps`.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated, NamedTuple, TypeVar

import numpy as np

from fitball.base.columns import MIRRORED
from fitball.base.values import Ball, FloatArray, Impacts
from fitball.models.types import Rebound

# A number, or an array of them.
Number = TypeVar("Number", float, FloatArray)

# Outputs and courses that have the other sign for the mirror image.
TURNED = (*MIRRORED, "v_x", "omega_core", "omega_shell", "twist", "slip", "friction_force")
# Parameters that are an offset of the normal force, or proportional to one.
OFFSETS = ("eps_10", "eps_slope", "offset")
# The least v_x1/v_y1 at which all of the offset acts. At 2 degrees from the vertical a ball moves
# about as far during its contact as the offset is long: 2 mm at 12 m/s.
FULL_OFFSET = math.tan(math.radians(2.0))


class Travel(NamedTuple):
    """Impacts as their mirror images that fly `forwards`, towards positive v_x; the `side` to which
    each flies, 1 or -1; the `share` of the offset that acts. Arrays are shaped as the impacts.
    """

    forwards: Impacts
    side: FloatArray
    share: FloatArray


def travel_of(impacts: Impacts) -> Travel:
    """How balls travel."""
    forwards = impacts.forwards
    share = np.ones(forwards.v_x1.shape)
    steep = forwards.v_x1 < FULL_OFFSET * forwards.v_y1
    share[steep] = offset_share(forwards.v_x1[steep] / (FULL_OFFSET * forwards.v_y1[steep]))
    return Travel(forwards, impacts.side, share)


def offset_share(r: Number) -> Number:
    """The share of the offset that acts at `r` from 0 to 1."""
    return r * (15.0 - r * r * (10.0 - 3.0 * r * r)) / 8.0


def with_share(
    names: Sequence[str],
    values: Annotated[FloatArray, "draws parameters"],
    share: Annotated[FloatArray, "draws 1"],
) -> Annotated[FloatArray, "draws parameters"]:
    """The `values` of the parameters `names` where a `share` of the offset acts."""
    is_offset = np.isin(names, OFFSETS)
    return np.where(is_offset, share * values, values)


def turn_back(arrays: Mapping[str, FloatArray], side: FloatArray) -> None:
    """Turn arrays (..., impacts) of mirror images by name, in place, to the `side` to which each
    ball flies: those that a mirror turns.
    """
    if (side < 0.0).any():
        for name, array in arrays.items():
            if name in TURNED:
                array *= side


def bounced(
    solve: Callable[..., Rebound],
    ball: Ball,
    names: Sequence[str],
    values: Annotated[FloatArray, "draws parameters"],
    impacts: Impacts,
    cor: Annotated[FloatArray, "..."] | None,
) -> Rebound:
    """Rebounds (draws, impacts) of balls that fly either way, by the solver `solve` of balls that
    fly towards positive v_x. The arguments are those of `Model.evaluate`; all rebounds come from
    here.
    """
    # The usual case, in a tenth of the time.
    if (impacts.v_x1 >= FULL_OFFSET * impacts.v_y1).all():
        return solve(ball, names, values, impacts, cor)
    travel = travel_of(impacts)
    shape = (len(values), len(impacts))
    steep = np.zeros(shape, np.bool_)
    if not {*OFFSETS}.isdisjoint(names):
        steep = np.broadcast_to(travel.share < 1.0, shape)
    draw, at = np.nonzero(steep)

    def picked(array: FloatArray) -> FloatArray:
        """Those of an array for all draws, or for each, that are steep, each as a draw."""
        return np.broadcast_to(array, shape)[draw, at][:, None]

    def solve_steep() -> Rebound:
        """Steep impacts, each as a draw of its own with the offset that acts there."""
        less = with_share(names, values[draw], picked(travel.share))
        states = map(picked, vars(travel.forwards).values())
        return solve(ball, names, less, Impacts(*states), None if cor is None else picked(cor))

    if steep.all():
        arrays = {name: array.reshape(shape) for name, array in vars(solve_steep()).items()}
        rebound = Rebound(**arrays)
    else:
        rebound = solve(ball, names, values, travel.forwards, cor)
        if at.size:
            for name, array in vars(solve_steep()).items():
                vars(rebound)[name][draw, at] = array[:, 0]
    turn_back(vars(rebound), travel.side)
    return rebound
