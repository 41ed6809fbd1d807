"""The duration of a contact, from a record of its force."""

from __future__ import annotations

from typing import Annotated, Literal, NamedTuple, overload

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.errors import ParameterError
from fitball.base.values import BoolArray, FloatArray

# Skewness of the pulse of a spring and damper on a court, x'' + 2 z x' + x = 0 from x = 0, x' = 1,
# force x + 2 z x', for dampings z of 0, 0.02, 0.05, 0.1, 0.15, 0.2 (restitution 1 to 0.57).
_SKEWNESS = (0.0, 0.0130, 0.0383, 0.0913, 0.1517, 0.2156)
# Widths of these pulses, from touch to where the force vanishes, over their rms widths. The first
# is 2/sqrt(1 - 8/pi^2), of half a sine.
_WIDTHS = (4.5952, 4.5406, 4.4723, 4.3889, 4.3359, 4.3068)
# Fewest forces that show a width and a skewness.
_LEAST_FORCES = 5
# Fewest forces of a pulse. Half sines with eight come out wrong by up to 3 %, with four by 13 %,
# and the noise does not show it.
_LEAST_OF_PULSE = 8.0
# Share of the peak below which a record must begin and end, or the pulse is cut off.
_SHARE_AT_ENDS = 0.2
# Share of the peak from which another pulse is no noise and no rebound of the plate.
_SECOND_PULSE_SHARE = 0.2
# Share of the peak that an undershoot or an oscillation may have: half sines of 5 ms whose tail
# rings or falls below rest by this much come out wrong by 2 to 3 %.
_TAIL_SHARE = 0.05
# What noise alone reaches in some thousand samples, in its sds.
_NOISE_REACH = 5.0
# Forces are averaged over this share of the pulse before its ends are sought and its tail is looked
# at: single forces are noise.
_SMOOTHED_SHARE = 0.1
# Share of the peak from which a force belongs to the pulse: less may be a drift of the level.
_PULSE_SHARE = 0.05
# What is below that share is followed down to the level at rest, at most by the pulse's length over
# this on each side: forces far away would count by their distance.
_MARGIN = 10
# A pull is no pulse, an undershoot is smaller: how much deeper than high a record must be.
_PULL = 1.5
# Peaks below so many sds of the noise are noise.
_LEAST_PEAK = 6.0
# A flat top is clipped where it is longer than that of a half sine in steps of the record by this.
_FLAT = 2.0
# How often the level at rest and the pulse, each of which needs the other, are found anew.
_ROUNDS = 4
# The tail is what follows within this many lengths of the pulse: plates ring, amplifiers recover.
_TAIL_LENGTHS = 3.0
# Swings on either side of rest from which a tail is an oscillation, and no undershoot.
_LEAST_SWINGS = 2
# What records have in place of seconds, and their factors.
_OTHER_TIMES = {"ms": 1e-3, "us": 1e-6}
# Sd of normal noise over its median distance from the median.
_NORMAL_SD = 1.4826
# Sd of a median over that of a mean of as many normal numbers.
_MEDIAN_SD = 1.2533


class _Pulse(NamedTuple):
    """A pulse within a record (times,): its rows, the level at rest [N], the sd of the noise around
    it [N], and from sample to sample; how many rows of rest the level is the median of.
    """

    rows: slice
    level: float
    noise: float
    white_noise: float
    at_rest: int


@overload
def contact_time(
    t: Annotated[FloatArray, "times"],
    force: Annotated[FloatArray, "times"],
    *,
    return_sd: Literal[False] = ...,
) -> float: ...


@overload
def contact_time(
    t: Annotated[FloatArray, "times"],
    force: Annotated[FloatArray, "times"],
    *,
    return_sd: Literal[True],
) -> tuple[float, float]: ...


def contact_time(
    t: Annotated[FloatArray, "times"],
    force: Annotated[FloatArray, "times"],
    *,
    return_sd: bool = False,
) -> float | tuple[float, float]:
    """Duration of contact [s], from a record of the `force` [N] over rising times `t` [s].

    The pulse is the stretch around the largest force, outwards to the level at rest. That level is
    the median of the rest of the record, and is taken off. The duration follows from the rms width
    of the pulse and its skewness. A threshold of the force would make it some 3 % too short, and a
    stiffness 6 % too large.

    With `return_sd` its standard deviation [s] comes too, from the noise of the record at rest
    (white noise, to first order; JCGM 100:2008, Eq. 10).

    Example:
        >>> import fitball
        >>> import numpy as np
        >>> t = np.linspace(0.0, 0.007, 71)
        >>> pulse = 900.0 * np.sin(np.pi * (t - 0.001) / 0.005)
        >>> force = np.where((t > 0.001) & (t < 0.006), pulse, 0.0)
        >>> round(fitball.contact_time(t, force), 4)
        0.005

    Raises:
        ParameterError: The record has less than five forces, times that do not rise or are no
            seconds, no whole positive pulse, few forces in it, two pulses, or a tail that rings or
            undershoots (`force-record`).
    """
    t = np.asarray(t, dtype=np.float64)
    force = np.asarray(force, dtype=np.float64)
    _refuse_no_record(t, force)
    pulse = _pulse(force)
    _refuse_other_signals(t, force, pulse)
    moments = _moments(t[pulse.rows], force[pulse.rows] - pulse.level)
    duration = _duration(moments)
    _refuse_other_times(duration)
    _refuse_few_forces(t[pulse.rows], duration)
    return (duration, _sd(moments, pulse)) if return_sd else duration


class _Moments(NamedTuple):
    """Moments of a pulse over time: the `weight` of a unit of force at each time (times,) [1/N],
    times `from_mean` (times,) [s], the `rms` width [s], the skewness.
    """

    weight: FloatArray
    from_mean: FloatArray
    rms: float
    skewness: float


def _moments(t: FloatArray, force: FloatArray) -> _Moments:
    """The moments of a pulse of a force [N] above rest at times (times,)."""
    spacing = np.gradient(t)
    weight = spacing / (spacing @ force)
    share = weight * force
    from_mean = t - share @ t
    rms = float(np.sqrt(share @ from_mean**2))
    return _Moments(weight, from_mean, rms, float(share @ from_mean**3) / rms**3)


def _duration(moments: _Moments) -> float:
    """The duration [s] of a pulse with such moments."""
    return moments.rms * float(np.interp(moments.skewness, _SKEWNESS, _WIDTHS))


def _sd(moments: _Moments, pulse: _Pulse) -> float:
    """The sd [s] of the duration of a pulse, from the noise of each force and of the level at rest,
    which all forces share.
    """
    weight, from_mean, rms, skewness = moments
    # Derivatives by each force (times,) of the rms width and the skewness: both are ratios of sums.
    of_rms = weight * (from_mean**2 - rms**2) / (2.0 * rms)
    of_third = weight * (from_mean**3 - skewness * rms**3 - 3.0 * rms**2 * from_mean)
    of_skewness = of_third / rms**3 - 3.0 * skewness * of_rms / rms
    width = float(np.interp(skewness, _SKEWNESS, _WIDTHS))
    slopes = width * of_rms + rms * _slope_of_width(skewness) * of_skewness
    of_level = _MEDIAN_SD / np.sqrt(pulse.at_rest)
    return float(pulse.noise * np.hypot(np.linalg.norm(slopes), of_level * slopes.sum()))


def _slope_of_width(skewness: float) -> float:
    """The slope of the width over the skewness, zero beyond the ends of the table."""
    index = int(np.searchsorted(_SKEWNESS, skewness))
    if index in (0, len(_SKEWNESS)):
        return 0.0
    rise = _WIDTHS[index] - _WIDTHS[index - 1]
    return rise / (_SKEWNESS[index] - _SKEWNESS[index - 1])


def _pulse(force: FloatArray) -> _Pulse:
    """The pulse of a record (times,), its level at rest and the noise there.

    Raises:
        ParameterError: The pulse begins before the record or ends after it, is clipped, or is no
            more than noise (`force-record`).
    """
    # Of a short record the pulse may be the larger part, but most of what is low is at rest.
    halfway = 0.5 * (force.min() + force.max())
    level = float(np.median(force[force <= halfway]))
    inside = np.zeros(force.size, dtype=np.bool_)
    for _ in range(_ROUNDS):
        inside = _stretch(force - level)
        if inside.all():
            break
        level = float(np.median(force[~inside]))
    peak = force.max() - level
    at_rest = force[~inside] - level
    # From sample to sample noise differs, which a plate or an amplifier hardly does.
    white_noise = _normal_sd(np.diff(at_rest)) / np.sqrt(2.0)
    if peak < _LEAST_PEAK * white_noise:
        raise _refusal(
            f"the largest force is {peak / white_noise:.1f} sds of the noise above rest",
            "a pulse above the noise",
        )
    largest_at_ends = max(force[0], force[-1]) - level
    if inside.all() or largest_at_ends > _SHARE_AT_ENDS * peak:
        raise _refusal(
            "the pulse begins before the record or ends after it",
            "a record that begins and ends at rest",
        )
    rows = np.flatnonzero(inside)
    _refuse_clipped(force, level, rows.size)
    pulse_rows = slice(rows[0], rows[-1] + 1)
    return _Pulse(pulse_rows, level, _normal_sd(at_rest), white_noise, at_rest.size)


def _normal_sd(noise: FloatArray) -> float:
    """The sd [N] of normal noise (times,) about zero, from its median size: a pulse in it does not
    count.
    """
    return _NORMAL_SD * float(np.median(np.abs(noise))) if noise.size else 0.0


def _stretch(from_rest: FloatArray) -> BoolArray:
    """Which rows (times,) belong to the pulse around the largest force: outwards to where the
    force, smoothed, falls to the level at rest.
    """
    top = int(np.argmax(from_rest))
    half = _connected(from_rest > 0.5 * from_rest[top], top)
    smooth = _smoothed(from_rest, int(half.sum()))
    rows = np.flatnonzero(_connected(smooth > _PULSE_SHARE * from_rest[top], top))
    margin = max(rows.size // _MARGIN, 1)
    inside = _connected(smooth > 0.0, top)
    inside[: max(rows[0] - margin, 0)] = False
    inside[rows[-1] + margin + 1 :] = False
    return inside


def _smoothed(from_rest: FloatArray, length: int) -> FloatArray:
    """Forces (times,) averaged over a share of a pulse of `length` rows."""
    window = int(_SMOOTHED_SHARE * length) // 2 * 2 + 1
    return np.convolve(from_rest, np.full(window, 1.0 / window), mode="same")


def _refuse_clipped(force: FloatArray, level: float, length: int) -> None:
    """Raise ParameterError (`force-record`) where a pulse of `length` rows has a flat top that the
    steps of the record do not explain.
    """
    steps = np.diff(np.unique(force))
    angle = np.arccos(1.0 - min(float(steps.min()) / (force.max() - level), 1.0))
    expected = 2.0 * angle / np.pi * length
    flat = int(_connected(force >= force.max(), int(np.argmax(force))).sum())
    if flat > _LEAST_FORCES + _FLAT * expected:
        raise _refusal(
            f"{flat} forces in a row are the largest, as where the amplifier is at its limit",
            "a record in a larger range of forces",
        )


def _connected(above: BoolArray, top: int) -> BoolArray:
    """Which rows (times,) are connected with row `top` through rows that are `above`."""
    below = np.flatnonzero(~above)
    index = np.searchsorted(below, top)
    first = below[index - 1] + 1 if index else 0
    end = below[index] if index < below.size else above.size
    inside = np.zeros(above.size, dtype=np.bool_)
    inside[first:end] = True
    return inside


def _refuse_no_record(t: FloatArray, force: FloatArray) -> None:
    """Raise ParameterError (`force-record`) where these are no forces at rising times, or the
    largest force is a pull.
    """
    if t.ndim != 1 or t.shape != force.shape or t.size < _LEAST_FORCES:
        raise _refusal(
            f"read shapes {t.shape} of times and {force.shape} of forces",
            "five or more forces, and as many times",
        )
    if not (np.isfinite(force).all() and np.isfinite(t).all()):
        raise _refusal("a force or a time is no number", "a number in each sample")
    if not np.all(np.diff(t) > 0.0):
        raise _refusal("the times do not rise", "times in rising order, each once")
    if np.ptp(force) <= 0.0:
        raise _refusal("all forces are equal", "a pulse of the force")
    ends = 0.5 * (force[0] + force[-1])
    if ends - force.min() > _PULL * (force.max() - ends):
        raise _refusal(
            "the pulse is negative",
            "a positive pulse: pass -force",
        )


def _refuse_other_signals(t: FloatArray, force: FloatArray, pulse: _Pulse) -> None:
    """Raise ParameterError (`force-record`) for a second pulse, a tail that rings, or one that
    undershoots.
    """
    times = t[pulse.rows]
    from_rest = _smoothed(force - pulse.level, times.size)
    length = times[-1] - times[0]
    peak = from_rest[pulse.rows].max()
    outside = np.ones(t.size, dtype=np.bool_)
    outside[pulse.rows] = False
    noise_reach = _NOISE_REACH * min(pulse.white_noise, pulse.noise)
    least = max(_TAIL_SHARE * peak, noise_reach)
    tail = outside & (t > times[-1]) & (t < times[-1] + _TAIL_LENGTHS * length)
    swings = _swings(from_rest[tail], least)
    if len(swings) >= _LEAST_SWINGS:
        raise _refusal(
            "the force oscillates after the pulse, as where the plate rings",
            "a record filtered below the frequency of the plate, or of a stiffer plate",
        )
    if swings and swings[0] < 0:
        raise _refusal(
            f"the force falls {-from_rest[tail].min() / peak:.0%} of the peak below rest after "
            "the pulse",
            "a charge amplifier with a longer time constant, a record corrected for it, or a "
            "filter at a higher frequency",
        )
    second = max(_SECOND_PULSE_SHARE * peak, noise_reach)
    others = t[outside & (from_rest > second)]
    if others.size:
        raise _refusal(
            f"there is a second pulse at {others[0]:.4g} s beside that at {times[0]:.4g} s",
            "one pulse: pass the part of the record that has it",
        )


def _swings(tail: FloatArray, least: float) -> list[int]:
    """Signs of the swings of a tail (times,) of at least that size, each once."""
    signs = np.sign(tail[np.abs(tail) > least]).astype(int)
    turned = np.flatnonzero(np.diff(signs)) + 1
    return [int(signs[row]) for row in (0, *turned)] if signs.size else []


def _refuse_other_times(duration: float) -> None:
    """Raise ParameterError (`force-record`) for a duration that no contact has."""
    shortest, longest = COLUMNS["contact_time"].limits
    if shortest <= duration <= longest:
        return
    expected = f"{shortest:g} to {longest:g} s"
    for unit, factor in _OTHER_TIMES.items():
        if shortest <= factor * duration <= longest:
            expected += f"; if the times are in {unit}, pass {factor:g}*t"
            break
    raise _refusal(f"the pulse lasts {duration:.3g} s", expected)


def _refuse_few_forces(t: FloatArray, duration: float) -> None:
    """Raise ParameterError (`force-record`) where too few forces at times (times,) show a pulse of
    this duration [s].
    """
    count = duration / float(np.median(np.diff(t)))
    if count < _LEAST_OF_PULSE:
        raise _refusal(
            f"the pulse has {count:.0f} forces in {duration:.3g} s",
            f"{_LEAST_OF_PULSE:.0f} or more: record at a higher rate",
        )


def _refusal(read: str, expected: str) -> ParameterError:
    """A ParameterError (`force-record`): what was read, what is expected."""
    return ParameterError(f"contact_time: {read}; expected {expected}", "force-record")
