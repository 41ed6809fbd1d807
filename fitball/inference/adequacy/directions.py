"""Patterns that residuals may have: trends over what is known of the incidence, biases of groups."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fitball.inference.adequacy.refit import EVERY, Refit
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import PointFit
from fitball.models.types import regime_name
from fitball.values import FloatArray

# Rows from which a trend may bend, and two quantities act together.
BENDS, TOGETHER = 7, 12
# Rows that a group must have, and groups that are looked at.
LEAST_IN_GROUP, MOST_GROUPS = 3, 40
# Degrees of freedom of a noise from which its residuals can be looked at.
LEAST_FREEDOM = 2.0
# A pattern of whose square less is left by a refit cannot be told from parameters.
LEFT = 0.02
# Patterns whose remains agree so well are one.
SAME = 0.98
LABELS = ("group", "surface", "ball", "location")
# What a pattern is a pattern of, and those that are no knowledge of the incidence.
WHOLE_TABLE, ROWS = "all rows", "the order of rows"
# What a column does there, and what a parameter does.
FAULTS = {"bias": "is biased in", "row": "a drift", "group": "a bias of", "regime": "a bias of"}
CHANGES = {"row": ("drift", "drifts"), "group": ("level", "differs for")}
# The correlation from which rows count as in the order of a quantity.
IN_ORDER = 0.9
POWERS = ("a trend over", "a bend over")


@dataclass(frozen=True)
class Direction:
    """A pattern in one `column` (its number, or `EVERY`): `kind` trend, bend, together, bias, row, group or regime,
    drift or level of a parameter, `over` what, in `words`; `shape` (measurements of the column,) of root mean square
    one. A refit takes off what the basis has of it, `taken` (rank,), and leaves `length` times what `left` gives.

    Of the measurements of all columns nothing is kept: patterns are many, and rows may be.
    """

    kind: str
    column: int
    over: str
    words: str
    shape: FloatArray
    taken: FloatArray
    length: float

    def left(self, fit: Refit) -> FloatArray:
        """What a refit leaves of it (measurements,), of length one."""
        whole = -(fit.own @ self.taken)
        whole[fit.rows(self.column)] += self.shape
        return np.asarray(whole / self.length)

    def along(self, fit: Refit, residual: FloatArray, taken: FloatArray) -> FloatArray:
        """How much of `left` is in residuals (tables, measurements), (tables,); `taken` (tables, rank) is what the
        basis has of these.
        """
        return np.asarray((residual[:, fit.rows(self.column)] @ self.shape - taken @ self.taken) / self.length)


def overlap(fit: Refit, one: Direction, other: Direction) -> float:
    """The product of what a refit leaves of each."""
    mine, its = fit.rows(one.column), fit.rows(other.column)
    first, last = max(mine.start, its.start), min(mine.stop, its.stop)
    whole = 0.0
    if first < last:
        common = [item.shape[first - own.start : last - own.start] for item, own in ((one, mine), (other, its))]
        whole = float(common[0] @ common[1])
    return _remains(fit, whole, one.taken, other.taken) / (one.length * other.length)


def _remains(fit: Refit, whole: float, one: FloatArray, other: FloatArray) -> float:
    # The basis is orthonormal with the rows of priors, which are none of the measurements.
    return whole - 2.0 * float(one @ other) + float(one @ fit.gram @ other)


def direction(fit: Refit, column: int, kind: str, over: str, words: str, shape: FloatArray) -> Direction | None:
    """The pattern of that `shape` (measurements of the column,); None where a refit leaves too little of it."""
    taken = fit.own[fit.rows(column)].T @ shape
    square = float(shape @ shape)
    remains = _remains(fit, square, taken, taken)
    if square <= 0.0 or remains < LEFT * square:
        return None
    return Direction(kind, column, over, words, shape, taken, float(np.sqrt(remains)))


def covariates(problem: Problem) -> dict[str, FloatArray]:
    """What is known of each incidence by name, (impacts,) in SI, where it differs between impacts."""
    impacts = problem.impacts
    known = {"v_y1": impacts.v_y1}
    if problem.model.tangential:
        known = {
            "theta_1": impacts.angle,
            "v_1": impacts.speed,
            "omega_1": impacts.omega_1,
        }
    return {name: column for name, column in known.items() if np.ptp(column) > 1e-9 * np.abs(column).max()}


def _groups(problem: Problem, point: PointFit) -> Iterator[tuple[str, str, str, FloatArray]]:
    labels = {kind: np.array(problem.table.labels[kind]) for kind in LABELS if kind in problem.table.labels}
    if problem.model.tangential:
        labels["regime"] = np.array([regime_name(int(code)) for code in point.rebound.regime[0]])
    for kind, column in labels.items():
        names, sizes = np.unique(column, return_counts=True)
        if 2 <= names.size <= MOST_GROUPS:
            for name, size in zip(names, sizes, strict=True):
                if size >= LEAST_IN_GROUP and column.size - size >= LEAST_IN_GROUP:
                    inside = _sized((column == name).astype(float))
                    yield ("regime" if kind == "regime" else "group"), kind, f"{kind} {name}", inside


def directions(problem: Problem, point: PointFit, fit: Refit) -> list[Direction]:
    """All patterns that can be told from parameters and from each other: in single columns, then what friction and
    restitution that drift or differ between groups do to all columns.
    """
    groups, drift = list(_groups(problem, point)), list(_drift(problem))
    whole = "bias", WHOLE_TABLE, WHOLE_TABLE, np.ones(len(problem.impacts))
    shapes = [*_trends(problem), whole, *drift, *groups]
    kept: list[Direction] = []

    def keep(column: int, kind: str, over: str, words: str, shape: FloatArray) -> None:
        size = float(np.sqrt(np.mean(shape**2)))
        found = None if size <= 0.0 else direction(fit, column, kind, over, words, shape / size)
        if found is not None and all(abs(overlap(fit, found, other)) <= SAME for other in kept):
            kept.append(found)

    for column in range(len(fit.columns)):
        if fit.freedom[fit.noise_of(column)] > LEAST_FREEDOM:
            for kind, over, words, shape in shapes:
                keep(column, kind, over, f"{FAULTS.get(kind, '')} {words}".lstrip(), shape[fit.places[column]])
    if np.all(fit.freedom > LEAST_FREEDOM):
        rows = np.concatenate(fit.places)
        for kind, over, words, shape in (*drift, *groups):
            for name, effect in fit.effects.items() if kind != "regime" else ():
                changes, verb = CHANGES[kind]
                keep(EVERY, changes, over, f"{name} {verb} {words}", effect * shape[rows])
    return kept


def _drift(problem: Problem) -> Iterator[tuple[str, str, str, FloatArray]]:
    """A trend over the order of the rows, which is mostly that of measuring."""
    count = len(problem.impacts)
    if count >= BENDS:
        row = np.arange(count) - 0.5 * (count - 1)
        like = " and ".join(
            name for name, column in covariates(problem).items() if abs(np.corrcoef(row, column)[0, 1]) >= IN_ORDER
        )
        yield "row", ROWS, f"along the rows{like and f' (in the order of {like})'}", _sized(np.asarray(row))


def _trends(problem: Problem) -> Iterator[tuple[str, str, str, FloatArray]]:
    known = covariates(problem)
    count = len(problem.impacts)
    straight = {}
    for name, column in known.items():
        levels = np.unique(np.round(column / np.ptp(column), 6)).size
        degree = min(levels - 1, 1 + (count >= BENDS))
        # Orthogonal to all lower powers over the impacts of the table.
        powers = np.linalg.qr(np.vander((column - column.mean()) / np.ptp(column), degree + 1, increasing=True))[0]
        for power in range(1, degree + 1):
            kind = "trend" if power == 1 else "bend"
            yield kind, name, f"{POWERS[power - 1]} {name}", _sized(powers[:, power])
        straight[name] = _sized(powers[:, 1])
    names = list(known)
    for k, one in enumerate(names):
        for other in names[k + 1 :]:
            product = straight[one] * straight[other]
            if count >= TOGETHER and np.ptp(product) > 0.0:
                over = f"{one} and {other}"
                yield "together", over, f"{over} together", _sized(product - product.mean())


def _sized(shape: FloatArray) -> FloatArray:
    return np.asarray(shape / np.sqrt(np.mean(shape**2)))
