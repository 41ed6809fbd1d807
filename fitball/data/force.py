"""The duration of a contact, from a record of its force."""

import numpy as np

from fitball.base.errors import ParameterError
from fitball.base.values import FloatArray

# Widths of the force of a spring and damper on a court, from touch to where it vanishes, over its
# rms width, by the skewness of the pulse: x'' + 2 z x' + x = 0 from x = 0, x' = 1, force x + 2 z
# x', for dampings z of 0, 0.02, 0.05, 0.1, 0.15, 0.2 (restitution 1 to 0.57). The first is 2/sqrt(1
# - 8/pi^2), of half a sine.
_SKEWNESS = (0.0, 0.0130, 0.0383, 0.0913, 0.1517, 0.2156)
_WIDTHS = (4.5952, 4.5406, 4.4723, 4.3889, 4.3359, 4.3068)
# Shares of the peak from which a force belongs to the pulse, and below which a record must begin
# and end.
_PULSE = 0.05
_CUT = 0.2


def contact_time(t: FloatArray, force: FloatArray) -> float:
    """Duration of contact [s] of a record of force [N] over time [s], by the rms width of the
    pulse: a threshold is too short by some 3 %, which makes a stiffness 6 % too large. Raises
    ParameterError (`force-record`).
    """
    t = np.asarray(t, dtype=np.float64)
    force = np.asarray(force, dtype=np.float64)
    rising = (
        t.ndim == 1 and t.shape == force.shape and t.size > 4 and bool(np.all(np.diff(t) > 0.0))
    )
    if not (rising and np.isfinite(force).all() and max(force[0], force[-1]) < _CUT * force.max()):
        words = (
            "expected five or more forces at rising times, with a positive pulse that begins "
            "and ends within them"
        )
        raise ParameterError(f"contact_time: {words}", "force-record")
    above = np.flatnonzero(force > _PULSE * force.max())
    # Noise far away would count by its distance.
    edge = max((above[-1] - above[0]) // 10, 1)
    within = slice(max(above[0] - edge, 0), above[-1] + edge + 1)
    weight = np.gradient(t)[within] * force[within]
    from_mean = t[within] - weight @ t[within] / weight.sum()
    weight = weight / weight.sum()
    rms = float(np.sqrt(weight @ from_mean**2))
    return rms * float(np.interp(weight @ from_mean**3 / rms**3, _SKEWNESS, _WIDTHS))
