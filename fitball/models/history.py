"""One impact through time: the forward kernel with the contact cut short."""

from typing import Annotated, NamedTuple

from fitball.base.values import FloatArray, Impacts, IntArray
from fitball.models.kernels.batch import COURSES, moments
from fitball.models.kernels.contact import Flags


class History(NamedTuple):
    """One impact at the times `time` [s] after landing: the `phase`, and the courses by name, SI.

    Courses are compression `y` and its rate `v_y`, velocity along the court `v_x`, spins
    `omega_core` and `omega_shell`, `twist` between them, `slip` of the contact point,
    `normal_force` and `friction_force`.

    With normal=momentum the shell stops at landing, with an impulse that takes no time: courses
    begin after it. Where a phase ends, they are those of the next. At release the core picks the
    shell up, and with spin=mean they end with one spin.
    """

    time: Annotated[FloatArray, "times"]
    phase: Annotated[IntArray, "times"]
    courses: dict[str, Annotated[FloatArray, "times"]]


def followed(
    row: Annotated[FloatArray, "columns"],
    flags: Flags,
    impact: Impacts,
    times: Annotated[FloatArray, "times"],
) -> History:
    """The courses of one impact (1,) that has an answer, at `times` [s] within the contact.

    `row` has the parameters in the order of TWO_MASS_COLUMNS, SI; `flags` are the choices.
    """
    v_x1 = impact.v_x1.item()
    v_y1 = impact.v_y1.item()
    omega_1 = impact.omega_1.item()
    courses, phase, _status = moments(row, flags, v_x1, v_y1, omega_1, times)
    return History(times, phase, dict(zip(COURSES, courses, strict=True)))
