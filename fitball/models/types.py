"""What a model returns: rebounds with the status and the phases of each."""

from dataclasses import dataclass
from enum import IntEnum
from typing import Annotated

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.errors import ParameterError
from fitball.base.values import FloatArray, IntArray


class Phase(IntEnum):
    """Motion of the contact point: the octal digits of a packed regime."""

    SLIDE_FORWARD = 1
    SLIDE_BACKWARD = 2
    GRIP = 3
    HOLD = 4
    FREE = 5


class Status(IntEnum):
    """Why an impact has no answer. REASONS has the sentences, which say what to do."""

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
# Bits of a phase in a packed regime, which has the first phase in its lowest bits: enough for five
# phases and none.
PHASE_BITS = 3


@dataclass(frozen=True, eq=False)
class Rebound:
    """Rebounds of a model, each array (draws, impacts), or (impacts,) of a single parameter set.

    `v_x2` and `v_y2` are the velocity along the court and away from it [m/s], `omega_2` is the spin
    [rad/s], topspin positive. The contact lasts `contact_time` [s]. Between the flights before and
    after it lie `gap_time` [s], `gap_path` [m] and `gap_turn` [rad]. These four are NaN of a model
    without a time axis. `regime` packs the phases (`regime_name`). `status` is zero for an answer;
    elsewhere numbers are NaN.

    Example:
        >>> import fitball
        >>> brody = fitball.model("brody")
        >>> parameters = {"mu": 0.5, "cor_10": 0.75, "cor_slope": 0.0}
        >>> after = brody.rebound(parameters, fitball.impacts([30.0, 5.0], 10.0))
        >>> after.v_y2.tolist()
        [7.5, 7.5]
        >>> [fitball.regime_name(code) for code in after.regime]
        ['slide', 'grip']
    """

    v_x2: Annotated[FloatArray, "... impacts"]
    v_y2: Annotated[FloatArray, "... impacts"]
    omega_2: Annotated[FloatArray, "... impacts"]
    contact_time: Annotated[FloatArray, "... impacts"]
    gap_time: Annotated[FloatArray, "... impacts"]
    gap_path: Annotated[FloatArray, "... impacts"]
    gap_turn: Annotated[FloatArray, "... impacts"]
    regime: Annotated[IntArray, "... impacts"]
    status: Annotated[IntArray, "... impacts"]

    def column(self, name: str) -> Annotated[FloatArray, "... impacts"]:
        """The rebound column `name` in SI: an output, or a function of the velocity, as `v_2`.

        Example:
            >>> import fitball
            >>> model = fitball.model("brody")
            >>> parameters = {"mu": 0.5, "cor_10": 0.75, "cor_slope": 0.0}
            >>> after = model.rebound(parameters, fitball.impacts(0.0, 8.0))
            >>> after.column("v_2").round(6).tolist()
            [6.0]
        """
        formula = COLUMNS[name].formula
        if formula is not None:
            return formula(self.v_x2, self.v_y2)
        output: FloatArray = getattr(self, name)
        return output

    def answers(self, name: str) -> Annotated[FloatArray, "... impacts"]:
        """The rebound column `name` in SI, NaN where the model has no answer.

        Example:
            >>> import fitball
            >>> model = fitball.model("brody")
            >>> parameters = {"mu": 0.5, "cor_10": [0.75, 0.0], "cor_slope": 0.0}
            >>> after = model.rebound(parameters, fitball.impacts(0.0, 8.0))
            >>> after.answers("v_y2").tolist()
            [[6.0], [nan]]
        """
        return np.asarray(np.where(self.status == Status.OK, self.column(name), np.nan))


def regime_name(regime: int) -> str:
    """A packed `regime` of a rebound in words, the first phase first.

    Raises:
        ParameterError: the number is no packed regime (`regime`).

    Example:
        >>> import fitball
        >>> fitball.regime_name(0o231)
        'slide, grip, slide back'
    """
    phases = []
    mask = (1 << PHASE_BITS) - 1
    remaining = int(regime)
    while remaining > 0:
        phases.append(remaining & mask)
        remaining >>= PHASE_BITS
    if remaining < 0 or not all(phase in PHASE_NAMES for phase in phases):
        raise ParameterError(
            f"read regime {regime}: expected a packed regime of a rebound",
            "regime",
        )
    return ", ".join(PHASE_NAMES[Phase(phase)] for phase in phases)
