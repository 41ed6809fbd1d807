"""Book-keeping of a contact: packed phase sequences and the friction-cone test, as kernels."""

from __future__ import annotations

from fitball.models.kernels.compiled import compiled
from fitball.models.types import MAX_PACKED_PHASES, PHASE_BITS, Phase

SLIDE_FORWARD = int(Phase.SLIDE_FORWARD)
SLIDE_BACKWARD = int(Phase.SLIDE_BACKWARD)
GRIP = int(Phase.GRIP)
HOLD = int(Phase.HOLD)
FREE = int(Phase.FREE)

# Relative distance to the edge of the friction cone that rounding of the forces alone can make.
TIE = 1e-13


@compiled
def append_phase(regime: int, count: int, phase: int) -> int:
    """Append a phase to a packed sequence that already holds `count` phases."""
    if count >= MAX_PACKED_PHASES:
        return regime
    return regime | (phase << (PHASE_BITS * count))


@compiled
def slide_phase(direction: float) -> int:
    """The phase of slip in `direction`."""
    return SLIDE_FORWARD if direction > 0.0 else SLIDE_BACKWARD


@compiled
def cone_margin(friction: float, friction_slope: float, limit: float, limit_slope: float) -> float:
    """Positive when `|friction| <= limit` now and just after, negative when not.

    At the edge itself, to rounding, the rates decide: that is where contact starts (both vanish), and where
    a phase hands over to the next.
    """
    margin = limit - abs(friction)
    noise = TIE * (limit + abs(friction))
    if margin > noise or margin < -noise:
        return margin
    if friction > noise:
        return limit_slope - friction_slope
    if friction < -noise:
        return limit_slope + friction_slope
    return limit_slope - abs(friction_slope)
