"""The swings of both oscillators of each lane, at any time and by sums of times."""

from __future__ import annotations

from fitball.models.kernels.compiled import inlined, inner
from fitball.models.kernels.dual import choose
from fitball.models.kernels.lanes.elementary import exp, sin_cos
from fitball.models.kernels.lanes.vector import LaneArray, Lanes, Mask, any_of
from fitball.models.kernels.oscillator import SMALL_DECAY, SMALL_PHASE, joined_swing, short_phase, short_swing
from fitball.models.kernels.quantities import Basis, Oscillator, Oscillators, Swing

# Places that a basis takes in an array.
BASIS = 7


@inlined
def swing_lanes(o: Oscillator[Lanes], t: Lanes) -> Swing[Lanes]:
    """`swing_at` of lanes with `damped_squared > 0`, whose fast exponential is idle."""
    envelope = exp(-o.decay * t)
    sine, cosine = sin_cos(o.frequency * t)
    return Swing(envelope * cosine, envelope * sine / o.frequency, envelope, envelope)


@inlined
def swing_of_any(o: Oscillator[Lanes], t: Lanes) -> Swing[Lanes]:
    """`swing_at` of lanes of either sign of `damped_squared`, not zero."""
    swing = swing_lanes(o, t)
    overdamped = o.damped_squared < 0.0
    if any_of(overdamped):
        pole = o.decay + o.frequency
        slow, fast = exp(-o.natural_squared / pole * t), exp(-pole * t)
        pair = Swing(0.5 * (slow + fast), 0.5 * (slow - fast) / o.frequency, slow, fast)
        x = o.damped_squared * t * t
        cosine, sine = short_phase(x)
        near = Swing(swing.envelope * cosine, swing.envelope * t * sine, swing.envelope * 1.11, swing.envelope)
        swing = chosen_swing(overdamped, chosen_swing(x < -SMALL_PHASE, pair, near), swing)
    return swing


@inner
def basis_lanes(oscillators: Oscillators[Lanes], t: Lanes) -> Basis[Lanes]:
    """`basis_at` of lanes whose vertical motion is underdamped."""
    torsion, vertical = oscillators.torsion, oscillators.vertical
    rise = swing_lanes(vertical, t)
    if any_of((torsion.frequency < vertical.frequency) | (torsion.frequency > vertical.frequency)):
        return Basis(swing_of_any(torsion, t), rise)
    # Matched joints that slide: sine and cosine are the same.
    envelope = exp(-torsion.decay * t)
    sine, cosine = sin_cos(vertical.frequency * t)
    return Basis(Swing(envelope * cosine, envelope * sine / vertical.frequency, envelope, envelope), rise)


@inlined
def added_swing(o: Oscillator[Lanes], first: Swing[Lanes], second: Swing[Lanes]) -> Swing[Lanes]:
    """The swing at the sum of two times."""
    joined = joined_swing(o, first, second.cosine, second.sine)
    return Swing(joined.cosine, joined.sine, first.envelope * second.envelope, first.fast * second.fast)


@inlined
def added_basis(oscillators: Oscillators[Lanes], first: Basis[Lanes], second: Basis[Lanes]) -> Basis[Lanes]:
    """The basis at the sum of two times."""
    return Basis(
        added_swing(oscillators.torsion, first.torsion, second.torsion),
        added_swing(oscillators.vertical, first.vertical, second.vertical),
    )


@inlined
def is_short(o: Oscillator[Lanes], t: Lanes) -> Mask:
    """Where `short_swing` serves."""
    return (abs(o.decay * t) <= SMALL_DECAY) & (abs(o.damped_squared * t * t) <= SMALL_PHASE)


@inlined
def shifted_basis(oscillators: Oscillators[Lanes], basis: Basis[Lanes], step: Lanes, t: Lanes) -> Basis[Lanes]:
    """The basis a step of either sign later, at `t`: afresh in lanes that go far, whatever their neighbours do."""
    torsion, vertical = oscillators.torsion, oscillators.vertical
    c, s = short_swing(torsion, step)
    u, v = short_swing(vertical, step)
    shifted = Basis(joined_swing(torsion, basis.torsion, c, s), joined_swing(vertical, basis.vertical, u, v))
    far = ~(is_short(torsion, step) & is_short(vertical, step))
    if any_of(far):
        shifted = chosen_basis(far, basis_lanes(oscillators, t), shifted)
    return shifted


@inner
def put_basis(array: LaneArray, place: int, basis: Basis[Lanes]) -> None:
    """Write a basis into `BASIS` places of an array."""
    torsion, vertical = basis.torsion, basis.vertical
    array[place], array[place + 1], array[place + 2] = torsion.cosine, torsion.sine, torsion.envelope
    array[place + 3], array[place + 4], array[place + 5] = vertical.cosine, vertical.sine, vertical.envelope
    array[place + 6] = torsion.fast


@inner
def get_basis(array: LaneArray, place: int) -> Basis[Lanes]:
    """Read it from there."""
    envelope = array[place + 5]
    return Basis(
        Swing(array[place], array[place + 1], array[place + 2], array[place + 6]),
        Swing(array[place + 3], array[place + 4], envelope, envelope),
    )


@inlined
def chosen_swing(mask: Mask, first: Swing[Lanes], second: Swing[Lanes]) -> Swing[Lanes]:
    """The first where the mask holds, else the second."""
    return Swing(
        choose(mask, first.cosine, second.cosine),
        choose(mask, first.sine, second.sine),
        choose(mask, first.envelope, second.envelope),
        choose(mask, first.fast, second.fast),
    )


@inlined
def chosen_basis(mask: Mask, first: Basis[Lanes], second: Basis[Lanes]) -> Basis[Lanes]:
    """The first where the mask holds, else the second."""
    return Basis(
        chosen_swing(mask, first.torsion, second.torsion), chosen_swing(mask, first.vertical, second.vertical)
    )
