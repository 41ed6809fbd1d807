"""One impact through time: the forward kernel with the contact cut short."""

from typing import NamedTuple

from fitball.base.values import FloatArray, Impacts, IntArray
from fitball.models.kernels.batch import COURSES, moments
from fitball.models.kernels.contact import Flags


class History(NamedTuple):
    """At `time` (times,) [s] after landing the `phase` (times,) and courses (times,) by name, SI:
    compression `y` and its rate `v_y`, `v_x`, spins `omega_core`, `omega_shell`, `twist`, `slip`
    of the contact point, `normal_force`, `friction_force`.

    With normal=momentum the shell stops at landing, with an impulse that takes no time: courses
    begin after it. Where a phase ends, they are those of the next. At release the core picks the
    shell up, and with spin=mean they end with one spin.
    """

    time: FloatArray
    phase: IntArray
    courses: dict[str, FloatArray]


def followed(row: FloatArray, flags: Flags, impact: Impacts, times: FloatArray) -> History:
    """Courses of one impact (1,) that has an answer, at the parameters of a kernel's `row`
    (COLUMNS,) under the choices `flags`, at `times` (times,) within the contact [s].
    """
    v_x1 = impact.v_x1.item()
    v_y1 = impact.v_y1.item()
    omega_1 = impact.omega_1.item()
    courses, phase, _status = moments(row, flags, v_x1, v_y1, omega_1, times)
    return History(times, phase, dict(zip(COURSES, courses, strict=True)))
