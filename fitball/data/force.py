"""The duration of a contact, from a record of its force."""

from typing import Annotated

import numpy as np

from fitball.base.errors import ParameterError
from fitball.base.values import FloatArray

# Skewness of the pulse of a spring and damper on a court, x'' + 2 z x' + x = 0 from x = 0, x' = 1,
# force x + 2 z x', for dampings z of 0, 0.02, 0.05, 0.1, 0.15, 0.2 (restitution 1 to 0.57).
_SKEWNESS = (0.0, 0.0130, 0.0383, 0.0913, 0.1517, 0.2156)
# Widths of these pulses, from touch to where the force vanishes, over their rms widths. The first
# is 2/sqrt(1 - 8/pi^2), of half a sine.
_WIDTHS = (4.5952, 4.5406, 4.4723, 4.3889, 4.3359, 4.3068)
# Share of the peak from which a force belongs to the pulse: less may be noise.
_PULSE_SHARE = 0.05
# Share of the peak below which a record must begin and end, or the pulse is cut off.
_SHARE_AT_ENDS = 0.2
# Fewest forces that show a width and a skewness.
_LEAST_FORCES = 5
# The pulse is widened on each side by its length over this: its ends are below the share, but noise
# far away would count by its distance.
_MARGIN = 10


def contact_time(t: Annotated[FloatArray, "times"], force: Annotated[FloatArray, "times"]) -> float:
    """Duration of contact [s], from a record of the `force` [N] over rising times `t` [s].

    The duration follows from the rms width of the pulse and its skewness. A threshold of the force
    would make it some 3 % too short, and a stiffness 6 % too large.

    Example:
        >>> import fitball
        >>> import numpy as np
        >>> t = np.linspace(0.0, 0.007, 71)
        >>> pulse = 900.0 * np.sin(np.pi * (t - 0.001) / 0.005)
        >>> force = np.where((t > 0.001) & (t < 0.006), pulse, 0.0)
        >>> round(fitball.contact_time(t, force), 4)
        0.005

    Raises:
        ParameterError: The record has less than five forces, times that do not rise, or no whole
            pulse (`force-record`).
    """
    t = np.asarray(t, dtype=np.float64)
    force = np.asarray(force, dtype=np.float64)
    if not _is_record(t, force):
        words = (
            "expected five or more forces at rising times, with a positive pulse that begins "
            "and ends within them"
        )
        raise ParameterError(f"contact_time: {words}", "force-record")
    pulse = _pulse(force)
    times = t[pulse]
    impulse = np.gradient(t)[pulse] * force[pulse]
    mean = impulse @ times / impulse.sum()
    from_mean = times - mean
    weight = impulse / impulse.sum()
    rms = float(np.sqrt(weight @ from_mean**2))
    skewness = weight @ from_mean**3 / rms**3
    return rms * float(np.interp(skewness, _SKEWNESS, _WIDTHS))


def _pulse(force: FloatArray) -> slice:
    """The rows of a record (times,) that belong to its pulse, with a margin on each side."""
    above = np.flatnonzero(force > _PULSE_SHARE * force.max())
    first = above[0]
    last = above[-1]
    margin = max((last - first) // _MARGIN, 1)
    return slice(max(first - margin, 0), last + margin + 1)


def _is_record(t: FloatArray, force: FloatArray) -> bool:
    """Whether these are forces at rising times, with a pulse that begins and ends within them."""
    if t.ndim != 1 or t.shape != force.shape:
        return False
    if t.size < _LEAST_FORCES or not np.isfinite(force).all():
        return False
    if not np.all(np.diff(t) > 0.0):
        return False
    largest_at_ends = max(force[0], force[-1])
    return bool(largest_at_ends < _SHARE_AT_ENDS * force.max())
