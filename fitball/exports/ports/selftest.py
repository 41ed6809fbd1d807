"""The self-test of a port, in the kernels' restricted Python: golden impacts in the plane, on a
slope, and in a step between two flights.
"""

import math

from fitball.exports.ports.flight import Flight, Plane, step
from fitball.exports.ports.offered import Parameters, Vector, cross, dot, plus, rebound, rebound_3d
from fitball.models.kernels.contact import OK

# Numbers of a golden impact: its level, state and rebound, and the packed regime.
WIDTH = 12
# The step in which a golden ball bounces [s], the share of it before that, gravity [m/s^2], and the
# height of the plane [m].
STEP = 0.02
SHARE_BEFORE = 0.4
GRAVITY = 9.81
HEIGHT = 0.75
# As of SOLVED, a port has its own: a parameter set for each surface and ball, numbers of the golden
# impacts, WIDTH for each of IMPACTS.
LEVELS: list[Parameters] = []
GOLDEN: list[float] = []
IMPACTS = 0


def self_test() -> float:
    """The largest difference from the golden impacts, relative: of speeds and R omega to the
    incident speed of the ball and its surface, of times to themselves, of what lies between the
    flights to that speed times that time.
    """
    worst = 0.0
    for k in range(IMPACTS):
        at = WIDTH * k
        worst = larger(worst, error_in_plane(at))
        worst = larger(worst, error_in_space(at))
        worst = larger(worst, error_of_step(at))
    return worst


def error_in_plane(at: int) -> float:
    """The difference from the golden impact whose numbers begin there."""
    row = LEVELS[int(GOLDEN[at])]
    found = rebound(GOLDEN[at + 1], GOLDEN[at + 2], GOLDEN[at + 3], row)
    radius = row.ball_radius
    speed = golden_speed(at)
    worst = larger(0.0, (found.v_x2 - GOLDEN[at + 4]) / speed)
    worst = larger(worst, (found.v_y2 - GOLDEN[at + 5]) / speed)
    worst = larger(worst, radius * (found.omega_2 - GOLDEN[at + 6]) / speed)
    time = GOLDEN[at + 7]
    between = GOLDEN[at + 8]
    # A rigid ball has none.
    if time > 0.0:
        worst = larger(worst, (found.contact_time - time) / time)
        worst = larger(worst, (found.gap_time - between) / between)
        worst = larger(worst, (found.gap_path - GOLDEN[at + 9]) / (speed * between))
        worst = larger(worst, radius * (found.gap_turn - GOLDEN[at + 10]) / (speed * between))
    if found.status != OK or found.regime != GOLDEN[at + 11]:
        worst = math.inf
    return worst


def golden_speed(at: int) -> float:
    """The incident speed of ball and surface of the golden impact whose numbers begin there."""
    v_x = GOLDEN[at + 1]
    v_y = GOLDEN[at + 2]
    surface = LEVELS[int(GOLDEN[at])].ball_radius * GOLDEN[at + 3]
    return math.sqrt(v_x * v_x + v_y * v_y + surface * surface)


def error_in_space(at: int) -> float:
    """The difference from the same impact on a slope."""
    row = LEVELS[int(GOLDEN[at])]
    up = Vector(2.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0)
    travel = Vector(1.0 / 3.0, 2.0 / 3.0, -2.0 / 3.0)
    none = Vector(0.0, 0.0, 0.0)
    axis = cross(up, travel)
    speed = golden_speed(at)
    before = plus(plus(none, GOLDEN[at + 1], travel), -GOLDEN[at + 2], up)
    spatial = rebound_3d(before, plus(none, GOLDEN[at + 3], axis), up, row)
    velocity = plus(plus(spatial.velocity, -GOLDEN[at + 4], travel), -GOLDEN[at + 5], up)
    spin = plus(spatial.spin, -GOLDEN[at + 6], axis)
    worst = larger(0.0, math.sqrt(dot(velocity, velocity)) / speed)
    return larger(worst, row.ball_radius * math.sqrt(dot(spin, spin)) / speed)


def error_of_step(at: int) -> float:
    """The difference from two flights by formula, and what lies between them, in one step."""
    row = LEVELS[int(GOLDEN[at])]
    v_x = GOLDEN[at + 1]
    v_y = GOLDEN[at + 2]
    omega = GOLDEN[at + 3]
    radius = row.ball_radius
    speed = golden_speed(at)
    up = Vector(2.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0)
    travel = Vector(1.0 / 3.0, 2.0 / 3.0, -2.0 / 3.0)
    none = Vector(0.0, 0.0, 0.0)
    axis = cross(up, travel)
    before = plus(plus(none, v_x, travel), -v_y, up)
    early = SHARE_BEFORE * STEP
    late = STEP - early - GOLDEN[at + 8]
    fall = v_y * early - 0.5 * GRAVITY * early * early
    begin = plus(none, HEIGHT + radius + fall, up)
    falling = plus(before, GRAVITY * early, up)
    turning = plus(none, omega, axis)
    flight = step(
        Flight(begin, falling, turning, none, 0.0, 0, OK, False),
        plus(none, -GRAVITY, up),
        STEP,
        Plane(plus(none, 3.0, up), HEIGHT, none),
        row,
    )
    way = v_x * early + GOLDEN[at + 9] + GOLDEN[at + 4] * late
    rise = GOLDEN[at + 5] * late - 0.5 * GRAVITY * late * late
    angle = omega * early + GOLDEN[at + 10] + GOLDEN[at + 6] * late
    ended = plus(plus(none, HEIGHT + radius + rise, up), way, travel)
    missed = plus(flight.position, -1.0, ended)
    turned = plus(flight.turn, -angle, axis)
    along = plus(flight.velocity, -GOLDEN[at + 4], travel)
    velocity = plus(along, GRAVITY * late - GOLDEN[at + 5], up)
    worst = larger(0.0, math.sqrt(dot(missed, missed)) / (speed * STEP))
    worst = larger(worst, radius * math.sqrt(dot(turned, turned)) / (speed * STEP))
    worst = larger(worst, math.sqrt(dot(velocity, velocity)) / speed)
    if flight.bounces != 1 or flight.ahead > 0.0:
        worst = math.inf
    return worst


def larger(worst: float, difference: float) -> float:
    """The larger of two differences; one that is no number is the largest."""
    return (
        worst
        if abs(difference) <= worst
        else (math.inf if difference != difference else abs(difference))
    )
