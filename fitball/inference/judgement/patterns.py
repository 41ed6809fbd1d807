"""Shapes over the impacts of a table in which residuals would lie if something were wrong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fitball.base.values import FloatArray
from fitball.inference.problem.problem import Problem
from fitball.models.types import regime_name

# Rows from which bends and drifts are tested: fewer leave a line and its noise little freedom.
# Products of columns take twice as many. Chosen by hand.
LEAST_ROWS_OF_BEND = 7
# Rows of a group, and rows outside of it, from which it is tested. Chosen by hand.
LEAST_ROWS_OF_GROUP = 3
# Groups of a column at most, for them to be tested: all tests share one chance, and each further
# one takes of the others. Chosen by hand.
MOST_GROUPS = 40
# Share of the variance of a line along the rows that labels explain which are listed in order.
# Chosen by hand: they then explain more of it than what is left.
SHARE_IN_ORDER = 0.5
# Difference of the incident state over its size that is rounding of units.
UNIT_ROUNDING = 1e-9


def covariates(problem: Problem) -> dict[str, FloatArray]:
    """The columns (impacts,) of the incident state by name, in SI, that differ between impacts, as
    if all balls flew to one side.
    """
    states = problem.rows.states.forwards
    columns = {"v_y1": states.v_y1}
    if problem.forward.model.tangential:
        speed, angle = states.polar()
        columns = {"theta_1": angle, "v_1": speed, "omega_1": states.omega_1}
    return {
        name: values
        for name, values in columns.items()
        if np.ptp(values) > UNIT_ROUNDING * np.abs(values).max()
    }


def trends(problem: Problem) -> Iterator[tuple[str, FloatArray]]:
    """Lines, bends and products of the incident state, each with its name and its shape (impacts,).
    A bend is what a line of the same column leaves of its square.
    """
    count = len(problem.rows.y)
    straight = dict[str, FloatArray]()
    for name, values in covariates(problem).items():
        scaled = (values - values.mean()) / np.ptp(values)
        different = np.unique(scaled.round(6)).size
        degree = min(different - 1, 2 if count >= LEAST_ROWS_OF_BEND else 1)
        powers, _ = np.linalg.qr(np.vander(scaled, degree + 1, increasing=True))
        straight[name] = powers[:, 1]
        yield f"trend with {name}", powers[:, 1]
        if degree > 1:
            yield f"curved trend with {name}", powers[:, 2]
    if count < 2 * LEAST_ROWS_OF_BEND:
        return
    for first, second in combinations(straight, 2):
        yield f"interaction of {first} and {second}", straight[first] * straight[second]


def groups_of(
    problem: Problem,
    x: Annotated[FloatArray, "coordinates"],
) -> Iterator[tuple[str, str, FloatArray]]:
    """Column and label of each group, and which impacts are in it (impacts,), as 1 and 0. Regimes
    of contact with the parameters at `x` are groups too; empty cells are none.
    """
    labels = dict[str, NDArray[np.str_]]()
    for name, texts in problem.table.labels.items():
        if name != "id":
            labels[name] = np.array(texts)
    if problem.forward.model.tangential:
        regimes = problem.rebounds(problem.values(x[None])).regime[0]
        codes, which = np.unique(regimes, return_inverse=True)
        labels["regime"] = np.array([regime_name(int(code)) for code in codes])[which]
    for column, cell_texts in labels.items():
        groups, sizes = np.unique(cell_texts, return_counts=True)
        if not 2 <= groups.size <= MOST_GROUPS:
            continue
        for group, size in zip(groups, sizes, strict=True):
            if group and LEAST_ROWS_OF_GROUP <= size <= cell_texts.size - LEAST_ROWS_OF_GROUP:
                yield column, str(group), (cell_texts == group).astype(np.float64)


class Drift(NamedTuple):
    """A shape (impacts,) along the rows with its name; of a `column` of labels where what it goes
    along is how these are listed.
    """

    text: str
    shape: FloatArray
    column: str = ""


def drifts(problem: Problem) -> Iterator[Drift]:
    """A line along the rows, where there are enough of them. Where labels are listed in order it
    is parted: what changes from label to label is no drift, and one within labels remains.
    """
    count = len(problem.rows.y)
    if count < LEAST_ROWS_OF_BEND:
        return
    line = np.arange(float(count)) - 0.5 * (count - 1)
    column, between = _in_order(problem.table.labels, line)
    if not column:
        yield Drift("drift along the rows", line)
        return
    yield Drift(f"trend in {column} as listed", between, column)
    yield Drift(f"drift along the rows of each {column}", line - between)


def _in_order(labels: Mapping[str, Sequence[str]], line: FloatArray) -> tuple[str, FloatArray]:
    """The column whose labels explain most of a line along the rows (impacts,), with its means over
    these labels (impacts,); "" where none explains the larger part.
    """
    column = ""
    between = np.zeros(line.size)
    most = SHARE_IN_ORDER
    for name, texts in labels.items():
        groups, which = np.unique(np.array(texts), return_inverse=True)
        if name == "id" or not 2 <= groups.size <= line.size // 2:
            continue
        means = np.bincount(which, line) / np.bincount(which)
        share = float(np.sum(means[which] ** 2) / np.sum(line**2))
        if share > most:
            column, between, most = name, means[which], share
    return column, between


def slip_shape(problem: Problem) -> Annotated[FloatArray, "impacts"]:
    """The roots of the slip speeds before impact [(m/s)^(1/2)], less their mean."""
    states = problem.rows.states
    slip = states.v_x1 - problem.forward.model.ball.radius * states.omega_1
    root = np.sqrt(np.abs(slip))
    return np.asarray(root - root.mean())
