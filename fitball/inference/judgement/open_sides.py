"""On which side a quantity is open that is made of values which are limited on one side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitball.inference.derived import Quantity
from fitball.inference.forward import Values
from fitball.inference.schema import Estimate, Side

# Share of a value by which it is raised to see the sign of a slope.
LITTLE_MORE = 1e-6


def side_with(side: Side, sign: float) -> Side:
    """The side on which a quantity is open with a parameter that is open on a `side`, by the sign
    of their correlation.
    """
    if sign >= 0.0 or not side:
        return side
    return "below" if side == "above" else "above"


def open_sides(quantity: Quantity, parents: Sequence[Estimate], best: Values) -> set[Side]:
    """The sides on which one-sided `parents` leave a quantity open that is derived from them, with
    the `best` values (1,) of parameters by name, in SI; "" where a parent is no parameter.
    """
    point = quantity.rule(best)[0]
    sides = set[Side]()
    for parent in parents:
        if parent.verdict != "one-sided":
            continue
        if parent.name not in best:
            sides.add("")
            continue
        value = best[parent.name]
        more = quantity.rule({**best, parent.name: value + LITTLE_MORE * np.abs(value)})[0]
        sides.add(side_with(parent.open_side, float(more - point)))
    return sides
