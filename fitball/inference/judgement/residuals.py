"""Residuals of a fit, and the t test of a pattern in them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, NamedTuple

import numpy as np
from scipy.special import stdtr

from fitball.base.columns import MIRRORED_DEVIATIONS
from fitball.base.values import FloatArray
from fitball.inference.judgement.first_order import FirstOrder
from fitball.inference.problem.problem import Problem

# Chance that any test objects to data that the model describes, by convention.
OBJECTION_CHANCE = 0.05
# Root mean square, in noises, below which a pattern is no exception: in long tables patterns are
# significant that are far below the noise. Chosen by hand.
SMALLEST_PATTERN = 0.1
# Share of the square of a pattern, and of a variance, that a refit must leave: of less the error of
# the linearisation may be as large. Chosen by hand.
REMAINING_SHARE = 0.02
# Correlation from which two patterns are one, of which the first is tested. Chosen by hand.
SAME_PATTERN = 0.98
# Degrees of freedom that rounding leaves: a ratio to them stays finite.
ROUNDED_FREEDOM = 1e-9


class FitResiduals(NamedTuple):
    """The residuals of a fit, of a long table those of its thinned rows: `scaled` (measurements,)
    over the noise that their column shows, and the degrees of `freedom` (columns,) of each column.
    """

    problem: Problem
    first: FirstOrder
    scaled: Annotated[FloatArray, "measurements"]
    freedom: Annotated[FloatArray, "columns"]

    def of_measurements(
        self,
        cell_values: Annotated[FloatArray, "impacts columns"],
    ) -> Annotated[FloatArray, "measurements"]:
        """The values (measurements,) of cells (impacts, columns) that were measured."""
        return np.asarray(cell_values[self.first.rows, self.first.column])

    def measured(self, column: str) -> str:
        """What was measured for a column: itself, or the height or time that it was made from."""
        fall = self.problem.fall
        return column if fall is None else fall.measured(column)

    def sides(self, column: str) -> Annotated[FloatArray, "impacts"]:
        """The signs by which deviations in a column are those of balls that fly to one side."""
        side = self.problem.rows.states.side
        return side if column in MIRRORED_DEVIATIONS else np.ones(side.shape)

    @property
    def studentised(self) -> Annotated[FloatArray, "measurements"]:
        """The scaled residuals (measurements,), each over its own sd after a refit; zero where a
        refit leaves next to nothing.
        """
        variance = 1.0 - np.sum(self.first.basis**2, axis=1)
        studentised = self.scaled / np.sqrt(np.maximum(variance, REMAINING_SHARE))
        return np.where(variance > REMAINING_SHARE, studentised, 0.0)


class PatternTest(NamedTuple):
    """A test of residuals: its `kind`, `column` ("": all) and `pattern` in words; the chance `p`,
    for itself or among all tests; the share of the variance `explained`; the root mean square
    `size` of the pattern in noises; the deviations in its `direction` (measurements,), if it has
    one.
    """

    kind: str
    column: str
    pattern: str
    p: float
    explained: float = 0.0
    size: float = 1.0
    direction: FloatArray = np.empty(0)

    @property
    def found(self) -> bool:
        """Whether the pattern is an exception: surely there, and not small."""
        return self.p < OBJECTION_CHANCE and self.size >= SMALLEST_PATTERN


def residuals_of(problem: Problem, first: FirstOrder) -> FitResiduals:
    """The residuals of a linearisation, over the noise that those of each column show."""
    impacts, rows = np.unique(first.rows, return_inverse=True)
    count = len(first.columns)
    variance = 1.0 - np.sum(first.basis**2, axis=1)
    freedom = np.maximum(np.bincount(first.column, variance, count), ROUNDED_FREEDOM)
    square = np.bincount(first.column, first.residual**2, count)
    scale = np.sqrt(square / freedom)
    scaled = first.residual / np.where(scale > 0.0, scale, 1.0)[first.column]
    return FitResiduals(problem.take(impacts), first._replace(rows=rows), scaled, freedom)


def tested_pattern(
    fit: FitResiduals,
    kind: str,
    column: str,
    text: str,
    direction: Annotated[FloatArray, "measurements"],
    tested: list[FloatArray],
) -> Iterator[PatternTest]:
    """The t test of a pattern of deviations `direction` (measurements,).

    There is none where a refit leaves too little of the pattern, or where it is one of those
    `tested`, unit vectors (measurements,), to which it is added otherwise.
    """
    first = fit.first
    after = first.after_refit(direction)
    before = float(np.linalg.norm(direction))
    length = float(np.linalg.norm(after))
    if before <= 0.0 or length**2 < REMAINING_SHARE * before**2:
        return
    unit = after / length
    # A refit spreads a pattern over columns, each of a noise that is known to its own degree (Welch
    # 1947).
    along = float(unit @ fit.scaled)
    weight = np.bincount(first.column, unit**2, fit.freedom.size)
    others = np.maximum(fit.freedom - weight, ROUNDED_FREEDOM)
    freedom = float(1.0 / np.sum(weight**2 / others))
    if freedom <= 1.0:
        return
    if tested and float(np.abs(np.stack(tested) @ unit).max()) > SAME_PATTERN:
        return
    tested.append(unit)
    rest = np.bincount(first.column, (fit.scaled - unit * along) ** 2, fit.freedom.size)
    variance = float(np.sum(weight * rest / others))
    square = along**2 / max(variance, np.finfo(float).tiny)
    p = 2.0 * float(stdtr(freedom, -np.sqrt(square)))
    share = square / (square + freedom)
    # The number of measurements in which the pattern is large.
    rows = np.sum(direction**2) ** 2 / np.sum(direction**4)
    size = abs(along) / float(rows) ** 0.5
    deviations = direction * (float(unit @ first.residual) / length)
    yield PatternTest(kind, column, text, p, share, size, deviations)
