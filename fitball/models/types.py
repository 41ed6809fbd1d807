"""What a bounce model is made of (closures) and what it returns (rebound, regimes)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, Literal, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from fitball.errors import ModelError, ParameterError, suggestion
from fitball.kinds import checked
from fitball.values import FloatArray

Release = Literal["zero_displacement", "zero_force"]
Normal = Literal["inner", "momentum", "total"]
Offset = Literal["grip", "contact"]
Spin = Literal["shell", "mean"]
Inertia = Literal["table", "tied"]
Torsion = Literal["matched", "free", "rigid"]
Cor = Literal["measured", "mean", "line", "saturating"]
# The thesis knows no other; an impulse has no need of the first two.
ThesisCor = Literal["measured", "mean", "line"]
ImpulseCor = Literal["line", "saturating"]
Damping = Literal["given", "chapter_three", "chapter_five"]


def check_options(closures: Closures | ThesisClosures | ImpulseClosures) -> None:
    """Raise ModelError for a closure that has no such option."""
    for closure, known in options_of(type(closures)).items():
        value = getattr(closures, closure)
        if value not in known:
            raise ModelError(f"unknown option '{value}' of closure {closure}: {suggestion(str(value), known)}")


def options_of(kind: type[Closures | ThesisClosures | ImpulseClosures]) -> dict[str, tuple[str, ...]]:
    """The options that each closure of a model has."""
    hints = get_type_hints(kind)
    return {closure.name: get_args(hints[closure.name]) for closure in fields(kind)}


@dataclass(frozen=True)
class Closures:
    """The named options that compose a two-mass model; one value each.

    `torsion = "rigid"` is the limit of infinite torsional stiffness. It is what is left of the model
    when no spin was measured, and costs no transition search.
    """

    release: Release
    normal: Normal
    offset: Offset
    spin: Spin
    inertia: Inertia
    torsion: Torsion
    cor: Cor

    def __post_init__(self) -> None:
        check_options(self)


@dataclass(frozen=True)
class ThesisClosures:
    """The choices within the thesis's own computation.

    `damping`: `c_y` is given, or follows from the restitution as in Chapter III or as in Chapter V.
    """

    damping: Damping
    inertia: Inertia
    cor: ThesisCor

    def __post_init__(self) -> None:
        check_options(self)


@dataclass(frozen=True)
class ImpulseClosures:
    """The one choice of the algebraic models: the law of the restitution."""

    cor: ImpulseCor

    def __post_init__(self) -> None:
        check_options(self)


class Phase(IntEnum):
    """The motion of the contact point; the digits of a packed regime sequence."""

    SLIDE_FORWARD = 1
    SLIDE_BACKWARD = 2
    GRIP = 3
    HOLD = 4
    FREE = 5


# As kernels have them.
SLIDE_FORWARD, SLIDE_BACKWARD, GRIP, HOLD, FREE = (int(phase) for phase in Phase)


class Status(IntEnum):
    """Outcome of one impact; everything but OK leaves NaN in that impact's outputs, with this reason."""

    OK = 0
    COR_OUT_OF_RANGE = 1
    COR_EXCEEDS_MASS_RATIO = 2
    TORSION_TOO_SOFT = 3
    TOO_MANY_PHASES = 4
    DAMPING_OUT_OF_RANGE = 5
    RESONANCE = 6
    NO_INERTIA = 7
    TOO_RAPID = 8
    LEVEL_OUT_OF_BOUNDS = 9
    NO_IMPACT = 10
    REBOUND_FALLS = 11
    NO_ANSWER = 12


STATUS_REASON = {
    Status.OK: "",
    Status.COR_OUT_OF_RANGE: "the coefficient of restitution is outside (0, 1] at this impact speed",
    Status.COR_EXCEEDS_MASS_RATIO: (
        "the coefficient of restitution exceeds mass_ratio: with normal = momentum the core cannot return that fast"
    ),
    Status.TORSION_TOO_SOFT: (
        "k_theta is too small for torsion = matched: the undamped torsional frequency is below the vertical one"
    ),
    Status.DAMPING_OUT_OF_RANGE: (
        "the vertical damping is supercritical, or its formula needs a restitution outside (0, 1]"
    ),
    Status.RESONANCE: "the torsional spring is in resonance with the vertical motion",
    Status.NO_INERTIA: (
        "core or shell has no inertia, as with mass_ratio = 1 and inertia = tied; use inertia = table or "
        "torsion = rigid"
    ),
    Status.TOO_RAPID: (
        "core and shell oscillate too fast to follow during one contact: use torsion = rigid, or "
        "a mass_ratio further from 1"
    ),
    Status.LEVEL_OUT_OF_BOUNDS: "a parameter is outside its bounds on one of the surfaces or balls",
    Status.NO_IMPACT: "the uncertainty of the incident state includes motion away from the court, without an impact",
    Status.REBOUND_FALLS: (
        "cor_slope is below -cor_10/(10 m/s), where v_y2 would fall with v_y1: cor = saturating excludes that"
    ),
    Status.NO_ANSWER: "the function of the model gives a number that is not finite",
    Status.TOO_MANY_PHASES: "the contact point changes between slip and grip too often for the solver",
}

PHASE_SYMBOL = {
    Phase.SLIDE_FORWARD: "slide",
    Phase.SLIDE_BACKWARD: "slide back",
    Phase.GRIP: "grip",
    Phase.HOLD: "hold",
    Phase.FREE: "free",
}
PHASE_BITS = 3
MAX_PACKED_PHASES = 20


def unpack_regime(code: int) -> tuple[Phase, ...]:
    """The phase sequence behind a packed code, first phase first (at most MAX_PACKED_PHASES)."""
    phases = []
    while code:
        phases.append(Phase(code & 7))
        code >>= PHASE_BITS
    return tuple(phases)


@checked
def regime_name(code: int) -> str:
    """A packed phase sequence in words, such as `slide-grip-slide back`.

    >>> ball = {"mu": 0.5, "e_x": 0.1, "offset": 0.003, "cor_10": 0.75, "cor_slope": -0.014}
    >>> fitball.regime_name(fitball.model("grip-slip").rebound(ball, fitball.impacts(15.0, 6.0)).regime[0])
    'slide'
    """
    try:
        return "-".join(PHASE_SYMBOL[phase] for phase in unpack_regime(int(code)))
    except ValueError:
        raise ParameterError(f"code = {code}: expected a packed sequence of phases, as in a rebound") from None


@dataclass(frozen=True)
class Rebound:
    """Rebound states, each array of shape (impacts,) or (draws, impacts).

    `v_x2`, `v_y2` [m/s] (`v_y2 > 0` away from the court), `omega_2` [rad/s], `contact_time` [s] (NaN
    for models without a time axis). `gap_time` [s], `gap_path` [m], `gap_turn` [rad]: by how much the flights before
    and after, each followed to the height of contact, differ in time, place along the court, and angle of the shell
    (NaN for models without `has_gaps`). `regime`: packed phase sequences (see `regime_name`), `status` values of
    `Status`.
    """

    v_x2: FloatArray
    v_y2: FloatArray
    omega_2: FloatArray
    contact_time: FloatArray
    gap_time: FloatArray
    gap_path: FloatArray
    gap_turn: FloatArray
    regime: NDArray[np.int64]
    status: NDArray[np.int8]

    def each(self, change: Callable[[NDArray[Any]], NDArray[Any]]) -> Rebound:
        """The rebounds whose arrays `change` makes of these."""
        return Rebound(*(change(getattr(self, field.name)) for field in fields(self)))

    def take(self, impacts: NDArray[np.int64]) -> Rebound:
        """Those of some of the impacts."""
        return self.each(lambda array: array[..., impacts])

    @staticmethod
    def joined(parts: Sequence[Rebound], axis: int) -> Rebound:
        """Rebounds of several batches as one, along draws (`axis` 0) or impacts (1)."""
        return Rebound(
            *(np.concatenate([getattr(part, column.name) for part in parts], axis=axis) for column in fields(Rebound))
        )


# What a model gives, in the order in which kernels and derivatives have it; all else of a rebound says how it came.
OUTPUTS = tuple(column.name for column in fields(Rebound) if column.name not in ("regime", "status"))


def no_rebound(shape: tuple[int, int]) -> Rebound:
    """Rebounds, (draws, impacts), of a model that gives none: NaN, without an answer."""
    unknown = {name: np.full(shape, np.nan) for name in OUTPUTS}
    status = np.full(shape, Status.NO_ANSWER, dtype=np.int8)
    return Rebound(**unknown, regime=np.zeros(shape, dtype=np.int64), status=status)
