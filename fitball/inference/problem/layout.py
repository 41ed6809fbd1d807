"""A problem as arrays, laid out once: what a compiled density reads instead of names and classes.

Values of a draw stand in one row: the free parameters, then the fixed ones, then the constants of the kernel's own
row. Impacts are sorted into blocks that share all levels of pooled parameters; measured cells are sorted into
segments, those of one column within one block.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.models.model import KernelCall
from fitball.models.specs import BALL_PARAMETERS
from fitball.models.types import OUTPUTS
from fitball.values import FloatArray

Places = NDArray[np.int64]
# What a cell measures: an output of the model by its place, or one of these.
SPEED, ANGLE = len(OUTPUTS), len(OUTPUTS) + 1
MEASURES = {**{name: place for place, name in enumerate(OUTPUTS)}, "v_2": SPEED, "theta_2": ANGLE}
NOWHERE = -1


class Transform(NamedTuple):
    """Coordinates (free,) and their joint prior: as `JointPrior` has them; `rest` are the values after the free."""

    log: NDArray[np.bool_]
    low: FloatArray
    high: FloatArray
    centre: FloatArray
    precision: FloatArray
    constant: float
    rest: FloatArray


class Levels(NamedTuple):
    """Blocks of impacts: block `k` is those from `first[k]` to `first[k + 1]`. Of each pooled parameter its place
    among the values, that of its spread, those of its levels (blocks, pooled), whether its logarithm is pooled, and
    its bounds.
    """

    first: Places
    common: Places
    spread: Places
    place: NDArray[np.int64]
    log: NDArray[np.bool_]
    low: FloatArray
    high: FloatArray


class KernelRow(NamedTuple):
    """Where each number of a kernel's row stands among the values. The last three are those of the ball; where any of
    them is sampled its inertia follows from the place `inertia_ratio`, else that is `NOWHERE`. The kernel is the
    `algebraic` one, or that of the two-mass compositions with its `codes`.
    """

    source: Places
    inertia_ratio: int
    algebraic: bool
    codes: Places


class Incident(NamedTuple):
    """Incident states in the order of the blocks, each (impacts,); NaN for a restitution that was not measured."""

    v_x1: FloatArray
    v_y1: FloatArray
    omega_1: FloatArray
    cor: FloatArray


class Cells(NamedTuple):
    """Segment `k` holds the cells from `first[k]` to `first[k + 1]`, block `b` the segments from `segments[b]`.

    Of a segment: what it measures, the place of its noise among the values (`NOWHERE`: stated cell by cell), whether
    that is `turned` by the rebound speed. Of a cell: its impact within the block, what was observed, the stated sd,
    the place of the bias of its group. `freedom` is the place of Student's degrees of freedom, `NOWHERE` if normal.
    """

    segments: Places
    first: Places
    measure: Places
    noise: Places
    turned: NDArray[np.bool_]
    impact: Places
    observed: FloatArray
    sd: FloatArray
    bias: Places
    freedom: int


class Layout(NamedTuple):
    """All of a problem; `contact_time` is the value and sd [s] that the scene knows, the sd 0 if none."""

    transform: Transform
    levels: Levels
    row: KernelRow
    incident: Incident
    cells: Cells
    contact_time: tuple[float, float]


def laid_out(problem: Problem, call: KernelCall) -> Layout:
    """The layout of a problem whose model makes this `call` of the two-mass or the algebraic kernel, for whatever
    values, and whose measured columns are among `MEASURES`.
    """
    fixed = [parameter for parameter in problem.parameters if not parameter.free]
    names = [parameter.name for parameter in (*problem.free, *fixed)]
    row, constants = _kernel_row(problem, names, call)
    low, high = problem.prior.limits
    centre, precision, constant = problem.prior.shape
    rest = np.array([*(parameter.fixed for parameter in fixed), *constants], dtype=np.float64)
    logs = np.array([parameter.prior.log for parameter in problem.free], dtype=np.bool_)
    order, first, keys = _blocks(problem)
    return Layout(
        Transform(logs, low, high, centre, precision, constant, rest),
        _levels(problem, names, first, keys),
        row,
        _incident(problem, order),
        _cells(problem, names, order, first),
        problem.contact_time or (0.0, 0.0),
    )


def _kernel_row(problem: Problem, names: Sequence[str], call: KernelCall) -> tuple[KernelRow, list[float]]:
    """The row, and the constants that stand behind the values of `names`."""
    source: list[int] = []
    constants: list[float] = []
    given = {**dict(zip(call.columns, call.row, strict=True)), "inertia_ratio": problem.model.ball.inertia_ratio}
    for column, constant in given.items():
        if column in problem.model_names:
            source.append(names.index(column))
        else:
            source.append(len(names) + len(constants))
            constants.append(constant)
    own_ball = not set(BALL_PARAMETERS).isdisjoint(problem.model_names)
    ratio = source.pop() if own_ball else NOWHERE
    row = KernelRow(_places(source[: len(call.row)]), ratio, call.convention == "impulse", _places(call.codes))
    return row, constants


def _levels(problem: Problem, names: Sequence[str], first: Places, keys: Sequence[Sequence[int]]) -> Levels:
    pooled = problem.pooling
    place = [
        [names.index(item.place_name(item.labels[k])) for item, k in zip(pooled, key, strict=True)] for key in keys
    ]
    return Levels(
        first,
        _places([names.index(item.parameter) for item in pooled]),
        _places([names.index(item.spread_name) for item in pooled]),
        _places(place).reshape(len(keys), len(pooled)),
        np.array([item.log for item in pooled], dtype=np.bool_),
        np.array([item.bounds[0] for item in pooled], dtype=np.float64),
        np.array([item.bounds[1] for item in pooled], dtype=np.float64),
    )


def _blocks(problem: Problem) -> tuple[Places, Places, Sequence[Sequence[int]]]:
    """Impacts sorted by the levels they share, where each block begins (and the last ends), and its levels."""
    count = len(problem.impacts)
    if not problem.pooling:
        return np.arange(count), _places([0, count]), [()]
    keys = np.stack([pooling.index for pooling in problem.pooling], axis=1)
    distinct, which, sizes = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(which.ravel(), kind="stable")
    return order, _places([0, *np.cumsum(sizes)]), [tuple(map(int, key)) for key in distinct]


def _incident(problem: Problem, order: Places) -> Incident:
    impacts = problem.impacts.take(order)
    cor = np.full(len(order), np.nan) if impacts.cor is None else impacts.cor
    cor.flags.writeable = False
    # As the kernels take them elsewhere: for another kind of array they would be compiled again.
    return Incident(impacts.v_x1, impacts.v_y1, impacts.omega_1, cor)


def _cells(problem: Problem, names: Sequence[str], order: Places, first: Places) -> Cells:
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    segments, ends, heads, parts = [0], [0], [], []
    for begin, end in pairwise(first):
        for observable in problem.observables:
            where = place[observable.places(order.size)]
            mine = np.flatnonzero((where >= begin) & (where < end))
            if mine.size:
                parts.append(_segment(problem, names, observable, mine, where[mine] - begin))
                noise = NOWHERE if observable.sd is not None else names.index(str(observable.noise))
                heads.append((MEASURES[observable.name], noise, observable.turned))
                ends.append(ends[-1] + mine.size)
        segments.append(len(heads))
    measure, noise_of, turned = zip(*heads, strict=True)
    impact, observed, sd, bias = (np.concatenate(column) for column in zip(*parts, strict=True))
    own = problem.noise.parameters
    return Cells(
        _places(segments), _places(ends), _places(measure), _places(noise_of), np.array(turned, dtype=np.bool_),
        impact, observed, sd, bias, names.index(own[0].name) if own else NOWHERE,
    )  # fmt: skip


def _segment(
    problem: Problem, names: Sequence[str], observable: Observable, mine: Places, impact: Places
) -> tuple[Places, FloatArray, FloatArray, Places]:
    """Impact, observed, stated sd and place of the bias of the entries `mine` of a column."""
    sd = np.ones(mine.size) if observable.sd is None else observable.sd[mine]
    bias = np.full(mine.size, NOWHERE)
    if problem.group_bias is not None:
        labels = problem.group_bias.index[observable.places(len(problem.impacts))[mine]]
        of_label = [
            names.index(problem.group_bias.name(observable.name, label)) for label in problem.group_bias.labels
        ]
        bias = _places(of_label)[labels]
    return impact, observable.observed[mine], np.asarray(sd, dtype=np.float64), bias


def _places(numbers: Sequence[object]) -> Places:
    return np.array(numbers, dtype=np.int64)
