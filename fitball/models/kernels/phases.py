"""Book-keeping of a contact: packed phase sequences, the log of its pieces, and the friction cone `|F_x| <= mu F`.

The cone is not in the thesis, whose ball rolls to the end of the contact once it has begun to.
"""

from __future__ import annotations

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.quantities import Piece, Series
from fitball.models.types import MAX_PACKED_PHASES, PHASE_BITS, Phase
from fitball.values import FloatArray

SLIDE_FORWARD = int(Phase.SLIDE_FORWARD)
SLIDE_BACKWARD = int(Phase.SLIDE_BACKWARD)
GRIP = int(Phase.GRIP)
HOLD = int(Phase.HOLD)
FREE = int(Phase.FREE)
# In place of a phase: the friction cone decides which one follows.
UNDECIDED = 0

# Columns of the phase log, one row a piece; terms are 0, and the length idle, where there is no series.
PIECE_PHASE, PIECE_ENDING, PIECE_SIDE, PIECE_TIME, PIECE_TERMS, PIECE_LENGTH, PIECE_SIZE = range(7)
# Endings: the series reached its length (in a log also: nothing at all, where an event comes at once), the normal
# force ended, slip came to zero or friction to the edge of its cone, a hold gave way to grip.
UNFINISHED, FORCE_ENDED, EVENT, RESUMED = range(4)

# Relative distance to the edge of the friction cone that rounding of the forces alone can make.
CONE_ROUNDING = 1e-13


@inner
def append_phase(regime: int, count: int, phase: int) -> int:
    """Append a phase to a packed sequence that already holds `count` phases."""
    if count >= MAX_PACKED_PHASES:
        return regime
    return regime | (phase << (PHASE_BITS * count))


@inner
def slide_phase(direction: float) -> int:
    """The phase of slip in `direction`."""
    return SLIDE_FORWARD if direction > 0.0 else SLIDE_BACKWARD


@inner
def cone_margin(friction: float, friction_slope: float, limit: float, limit_slope: float) -> float:
    """Positive when `|friction| <= limit` now and just after, negative when not.

    At the edge itself, to rounding, the rates decide: that is where contact starts (both vanish), and where
    a phase hands over to the next.
    """
    margin = limit - abs(friction)
    noise = CONE_ROUNDING * (limit + abs(friction))
    if margin > noise or margin < -noise:
        return margin
    if friction > noise:
        return limit_slope - friction_slope
    if friction < -noise:
        return limit_slope + friction_slope
    return limit_slope - abs(friction_slope)


@inner
def log_piece(phase_log: FloatArray, place: int, piece: Piece) -> None:
    """Write a piece into its row of the log."""
    at_once = piece.ending != FORCE_ENDED and not piece.time > 0.0
    phase_log[place, PIECE_PHASE], phase_log[place, PIECE_SIDE] = piece.phase, piece.side
    phase_log[place, PIECE_ENDING] = UNFINISHED if at_once else piece.ending
    phase_log[place, PIECE_TIME] = piece.time
    phase_log[place, PIECE_TERMS], phase_log[place, PIECE_LENGTH] = piece.series.terms, piece.series.length


@inlined
def logged_piece(phase_log: FloatArray, place: int) -> Piece:
    """Read a piece from its row of the log."""
    row = phase_log[place]
    series = Series(int(row[PIECE_TERMS]), row[PIECE_LENGTH])
    return Piece(int(row[PIECE_PHASE]), int(row[PIECE_ENDING]), row[PIECE_SIDE], row[PIECE_TIME], series)
