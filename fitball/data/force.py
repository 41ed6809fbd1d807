"""The duration of a contact, from a record of its force."""

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
_PULSE = 0.05
# Share of the peak below which a record must begin and end, or the pulse is cut off.
_CUT = 0.2
# Fewest forces that show a width and a skewness.
_FEWEST = 5


def contact_time(t: FloatArray, force: FloatArray) -> float:
    """Duration of contact [s] of a record of force (times,) [N] over time `t` (times,) [s], by the
    rms width of the pulse: a threshold is too short by some 3 %, which makes a stiffness 6 % too
    large. Raises ParameterError (`force-record`).
    """
    t = np.asarray(t, dtype=np.float64)
    force = np.asarray(force, dtype=np.float64)
    if not _is_record(t, force):
        words = (
            "expected five or more forces at rising times, with a positive pulse that begins "
            "and ends within them"
        )
        raise ParameterError(f"contact_time: {words}", "force-record")
    above = np.flatnonzero(force > _PULSE * force.max())
    # Noise far away would count by its distance.
    edge = max((above[-1] - above[0]) // 10, 1)
    within = slice(max(above[0] - edge, 0), above[-1] + edge + 1)
    impulse = np.gradient(t)[within] * force[within]
    from_mean = t[within] - impulse @ t[within] / impulse.sum()
    weight = impulse / impulse.sum()
    rms = float(np.sqrt(weight @ from_mean**2))
    skewness = weight @ from_mean**3 / rms**3
    return rms * float(np.interp(skewness, _SKEWNESS, _WIDTHS))


def _is_record(t: FloatArray, force: FloatArray) -> bool:
    """Whether these are forces at rising times, with a pulse that begins and ends within them."""
    if t.ndim != 1 or t.shape != force.shape or t.size < _FEWEST:
        return False
    if not np.all(np.diff(t) > 0.0) or not np.isfinite(force).all():
        return False
    return bool(max(force[0], force[-1]) < _CUT * force.max())
