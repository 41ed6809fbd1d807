"""The difference of two scores by left-out impacts, and when it is more than luck."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitball.values import FloatArray

# Below this many impacts a leave-one-out score says nothing: the standard error of five differences is not one.
FEW = 6
# Differences of elpd within two standard errors, or below 4, tell two models apart only by luck (Sivula, Magnusson,
# Matamoros and Vehtari 2020, who also find the standard error too small on few observations).
SURE_ERRORS = 2.0
SURE_SIZE = 4.0


@dataclass(frozen=True)
class ElpdDifference:
    """Difference of two totals of log predictive density with its standard error over impacts."""

    value: float
    se: float

    @property
    def sure(self) -> bool:
        """Whether the difference is more than luck."""
        return abs(self.value) > max(SURE_ERRORS * self.se, SURE_SIZE)


def elpd_difference(one: FloatArray, other: FloatArray) -> ElpdDifference:
    """Score of `one` minus that of `other`, each (impacts,); its standard error by the impacts' differences."""
    gaps = one - other
    return ElpdDifference(float(gaps.sum()), float(np.sqrt(gaps.size) * np.std(gaps, ddof=1)))
