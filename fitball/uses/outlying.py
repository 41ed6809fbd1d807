"""Values that lie apart from the others, by name: which balls of a lot."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from fitball.base.values import BoolArray, FloatArray

# Fewest values of which one can lie apart.
LEAST_VALUES = 5
# Of so many values one at most is called outlying.
_VALUES_OF_ONE = 5
# The probability by which one value or more of a normal sample is called outlying.
_LEVEL = 0.05


def outlying(values: Annotated[FloatArray, "values"]) -> Annotated[BoolArray, "values"]:
    """Which values of a sample that is normal otherwise are outliers, by the generalized extreme
    studentized deviate test (Rosner 1983, Technometrics 25, 165) at 5 %; with one it is the test of
    Grubbs.
    """
    from scipy.special import stdtrit

    count = len(values)
    found = np.zeros(count, np.bool_)
    if count < LEAST_VALUES:
        return found
    left = np.arange(count)
    taken = list[int]()
    outliers = 0
    for _ in range(count // _VALUES_OF_ONE):
        away = np.abs(values[left] - values[left].mean())
        sd = float(values[left].std(ddof=1))
        if not sd > 0.0:
            break
        farthest = int(np.argmax(away))
        size = left.size
        t = float(stdtrit(size - 2, 1.0 - _LEVEL / (2.0 * size)))
        limit = (size - 1) * t / np.sqrt((size - 2 + t**2) * size)
        taken.append(int(left[farthest]))
        if away[farthest] > limit * sd:
            outliers = len(taken)
        left = np.delete(left, farthest)
    found[taken[:outliers]] = True
    return found
