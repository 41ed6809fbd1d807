"""How far balls, or positions on a court, differ from each other, told apart from measurement noise: values."""

from __future__ import annotations

from dataclasses import dataclass

from fitball.inference.results.pace_rating import Spread


@dataclass(frozen=True)
class Level:
    """One label: so many `impacts`, their `mean` as measured, and `value`, what it is beyond their noise."""

    label: str
    impacts: int
    mean: float
    value: Spread


@dataclass(frozen=True)
class Variation:
    """A quantity over the labels of a `column`: standard deviations `between` labels and `within` one, and `levels`.

    Where repeats cannot tell the two apart `missing` says why, and there are no levels.
    """

    column: str
    between: Spread | None
    within: Spread | None
    levels: tuple[Level, ...]
    missing: str
