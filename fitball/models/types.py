"""What a model returns: rebounds with the status and the phases of each."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.errors import ParameterError
from fitball.base.values import FloatArray, IntArray


class Phase(IntEnum):
    """Motion of the contact point; digits of a packed regime."""

    SLIDE_FORWARD = 1
    SLIDE_BACKWARD = 2
    GRIP = 3
    HOLD = 4
    FREE = 5


class Status(IntEnum):
    """Why an impact has no answer; REASONS has the sentences, which say what to do."""

    OK = 0
    COR_OUT_OF_RANGE = 1
    COR_EXCEEDS_MASS_RATIO = 2
    TORSION_TOO_SOFT = 3
    TOO_MANY_PHASES = 4
    LEVEL_OUT_OF_BOUNDS = 5
    NO_IMPACT = 6
    NO_ANSWER = 7
    NO_INERTIA = 8
    REBOUND_FALLS = 9


REASONS: dict[Status, str] = {
    Status.OK: "",
    Status.COR_OUT_OF_RANGE: "COR must be above 0 and at most 1. Change cor_10",
    Status.COR_EXCEEDS_MASS_RATIO: "with normal=momentum COR cannot exceed mass_ratio. Use a "
    "larger mass_ratio, or normal=total",
    Status.TORSION_TOO_SOFT: "with torsion=matched the torsional frequency cannot be below the "
    "vertical one. Use a larger k_theta, or torsion=free",
    Status.TOO_MANY_PHASES: "core and shell oscillate too fast to be followed. Use a mass_ratio "
    "further from 1, or a smaller k_theta",
    Status.LEVEL_OUT_OF_BOUNDS: "a parameter is outside its bounds on a surface or ball. Use a "
    "narrower prior there",
    Status.NO_IMPACT: "the ball does not move towards the court. v_y1 must be positive; check it "
    "and its error",
    Status.NO_ANSWER: "your function gives a number that is not finite. Use priors within which "
    "it has an answer",
    Status.NO_INERTIA: "core or shell has no inertia. Use a mass_ratio below 1, or inertia=table",
    Status.REBOUND_FALLS: "v_y2 would fall with v_y1. cor_slope must be above -cor_10/(10 m/s)",
}
# Phases in words, of regimes in tables and figures.
PHASE_NAMES = {
    Phase.SLIDE_FORWARD: "slide",
    Phase.SLIDE_BACKWARD: "slide back",
    Phase.GRIP: "grip",
    Phase.HOLD: "hold",
    Phase.FREE: "free",
}
# Bits of a phase in a packed regime, which has the first phase in its lowest bits.
PHASE_BITS = 3


@dataclass(frozen=True, eq=False)
class Rebound:
    """Rebounds, each array (draws, impacts), SI: velocity, spin, `contact_time`; time, path and
    turn between the flights (gaps; NaN without a time axis, as `contact_time`); the packed
    `regime`. Numbers are NaN where `status` is not OK.
    """

    v_x2: FloatArray
    v_y2: FloatArray
    omega_2: FloatArray
    contact_time: FloatArray
    gap_time: FloatArray
    gap_path: FloatArray
    gap_turn: FloatArray
    regime: IntArray
    status: IntArray

    def column(self, name: str) -> FloatArray:
        """A rebound column (draws, impacts), SI: an output, or a function of the velocity."""
        formula = COLUMNS[name].formula
        if formula is not None:
            return formula(self.v_x2, self.v_y2)
        output: FloatArray = getattr(self, name)
        return output

    def answers(self, name: str) -> FloatArray:
        """A rebound column (draws, impacts), NaN where there is no answer."""
        return np.asarray(np.where(self.status == Status.OK, self.column(name), np.nan))


def regime_name(regime: int) -> str:
    """A packed regime in words: `slide, grip, slide back`. Raises ParameterError (`regime`)."""
    phases = []
    mask = (1 << PHASE_BITS) - 1
    rest = int(regime)
    while rest > 0:
        phases.append(rest & mask)
        rest >>= PHASE_BITS
    if rest < 0 or not all(phase in PHASE_NAMES for phase in phases):
        raise ParameterError(
            f"read regime {regime}: expected a packed regime of a rebound",
            "regime",
        )
    return ", ".join(PHASE_NAMES[Phase(phase)] for phase in phases)
