"""The slow solution as an oracle of one composition."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitball.models.oracle.expm import STEPS_PER_POLE_TIME
from fitball.models.oracle.oracle import DOUBLE, oracle_rebound, oracle_rebound_mp
from fitball.models.oracle.phases import Equations
from fitball.models.oracle.setup import arrange
from fitball.models.types import Closures, Phase, Rebound, Status
from fitball.values import Ball, Impacts


@dataclass(frozen=True)
class TwoMassOracle:
    """The independent integration (matrix exponentials, events by bisection) of a two-mass ball."""

    closures: Closures
    ball: Ball

    def steps(self, parameters: Mapping[str, float], impacts: Impacts) -> float:
        """See `Oracle.steps`: so many times the time of the fastest pole."""
        most = 0.0
        for index in range(len(impacts)):
            arranged = arrange(DOUBLE, self.closures, self.ball, parameters, impacts, index)
            if isinstance(arranged, Status):
                continue
            for phase in (Phase.SLIDE_FORWARD, Phase.GRIP):
                poles = np.linalg.eigvals(np.array(Equations(arranged).matrix(phase), dtype=np.float64))
                most = max(most, float(np.max(np.abs(poles))) * float(arranged.loaded) * STEPS_PER_POLE_TIME)
        return most

    def rebound(self, parameters: Mapping[str, float], impacts: Impacts, digits: int | None = None) -> Rebound:
        """See `Oracle.rebound`."""
        if digits is None:
            return oracle_rebound(self.closures, self.ball, parameters, impacts)
        return oracle_rebound_mp(self.closures, self.ball, parameters, impacts, digits)
