"""The hand-written ends of a Python port: what calls the kernel, and the self-test."""

from __future__ import annotations

# How a kernel is called, by its convention (see `models.capabilities`); arrays are lists, and a dictionary stands for
# the one of two dimensions.
CALLS = {
    "impulse": """
    status, v_x2, v_y2, omega_2, phases = THE_KERNEL(ROW, v_x1, v_y1, omega_1)
    contact_time, without_twist = None, 0
""",
    "two-mass": """
    scratch = Scratch([0.0] * SERIES_SIZE, [0.0] * SERIES_SIZE, [0.0] * SERIES_SIZE, {})
    solved, without_twist = THE_KERNEL(ROW, CODES, v_x1, v_y1, omega_1, THE_COR, scratch), 0
    if solved.status:
        solved, without_twist = THE_KERNEL(ROW, RIGID, v_x1, v_y1, omega_1, THE_COR, scratch), WITHOUT_TWIST
    status, v_x2, v_y2, omega_2 = solved.status, solved.v_x2, solved.v_y2, solved.omega_2
    contact_time, phases = solved.contact_time, solved.regime
""",
    "thesis": """
    row = (*ROW[:4], EPS_10 + EPS_SLOPE * (v_y1 - ANCHOR), *ROW[5:])
    found = THE_KERNEL(row, CODES[0], THE_COR, v_x1, v_y1, omega_1)
    status, v_x2, v_y2, omega_2, contact_time, phases = found
    without_twist = WITHOUT_TWIST if status else 0
    if status:
        push, inertia = (1.0 + THE_COR) * v_y1, ROW[9] / (ROW[7] * ROW[8] * ROW[8])
        stop, limit = (v_x1 - ROW[8] * omega_1) * inertia / (1.0 + inertia), ROW[3] * push
        lost = min(max(stop, -limit), limit)
        v_x2, v_y2, omega_2 = v_x1 - lost, THE_COR * v_y1, omega_1 + lost / (inertia * ROW[8])
        status, contact_time, phases = 0, None, 1 if stop > limit else 2 if stop < -limit else 3
""",
}

FACE = '''
def regime_name(phases):
    """A packed sequence of phases in words, first phase first."""
    words = []
    while phases:
        words.append(PHASES[phases & 7])
        phases >>= 3
    return "-".join(words)


def solve(v_x1, v_y1, omega_1, SIGNATURE):
    """Return what `rebound` does, phases packed."""
    if not (math.isfinite(v_x1) and math.isfinite(omega_1) and 0.0 <= v_y1 < math.inf):
        raise ValueError("expected finite numbers, and v_y1 >= 0 towards the court")
    extrapolated = 0
CLAMP_COR
    at_end = min(max(v_y1, V_Y1_LOW), V_Y1_HIGH)
    scale = v_y1 / at_end
    if scale != 1.0:
        extrapolated |= BEYOND_SPEEDS
    # So slow towards the court that friction changes nothing else.
    grazes = v_y1 <= max(GRAZING_SHARE * (abs(v_x1) + RADIUS * abs(omega_1)), TINY_SPEED)
    given = (0.0, at_end, 0.0) if grazes else (v_x1 / scale, at_end, omega_1 / scale)
    v_x2, v_y2, omega_2, contact_time, phases, without_twist = fitted(*givenCOR_ARGUMENT)
    if grazes:
        return v_x1, v_y2 * scale, omega_1, contact_time, 0, extrapolated
    return v_x2 * scale, v_y2 * scale, omega_2 * scale, contact_time, phases, extrapolated | without_twist


def fitted(v_x1, v_y1, omega_1, SIGNATURE):
    """The fitted model as it is."""
CALL_THE_KERNEL
    if status:
        raise ValueError(REASONS[status])
    return v_x2, v_y2, omega_2, contact_time, phases, without_twist


def rebound(v_x1, v_y1, omega_1, SIGNATURE):
    """Return (v_x2, v_y2, omega_2, contact_time or None, regime, extrapolated).

    Speeds [m/s], spin [rad/s], time [s]; the regime in words. `extrapolated` is 0 where the model is used as it was
    fitted, else a sum of BEYOND_SPEEDS (v_y1 outside of the valid range: restitution and offset stay what they are at
    its nearer end), BEYOND_RESTITUTION (a given cor that the model does not solve was taken as the nearest it does)
    and WITHOUT_TWIST (the model has no solution for this impact: the ball is taken as rigid).

    Raises ValueError for numbers that are not finite, or v_y1 < 0. `v_x1` is along the court in the direction of
    travel; a ball that flies the other way is its mirror image: give -v_x1 and -omega_1, and turn v_x2 and omega_2
    round.
    """
    v_x2, v_y2, omega_2, contact_time, phases, extrapolated = solve(v_x1, v_y1, omega_1, SIGNATURE)
    return v_x2, v_y2, omega_2, contact_time, regime_name(phases), extrapolated
'''

# What becomes of the restitution that a model is told.
CLAMP_COR = """
    if not math.isfinite(cor):
        raise ValueError("expected a finite cor")
    cor, told = min(max(cor, COR_LOW), COR_HIGH), cor
    if cor != told:
        extrapolated |= BEYOND_RESTITUTION
"""

SELF_TEST = '''
def self_test():
    """Return (largest difference over the golden impacts, whether every regime agrees).

    Speeds and R*omega count relative to the incident speed of the ball and its surface, the time to itself.
    """
    worst, same = 0.0, True
    for incident, expected, phases in GOLDEN:
        found = solve(*incident)
        speed = math.sqrt(incident[0] ** 2 + incident[1] ** 2 + (RADIUS * incident[2]) ** 2)
        errors = [weight * abs(found[k] - expected[k]) / speed for k, weight in enumerate((1.0, 1.0, RADIUS))]
        if expected[3] is not None:
            errors.append(abs(found[3] - expected[3]) / expected[3])
        same = same and found[4] == phases and not any(math.isnan(error) for error in errors)
        worst = max(worst, *errors)
    return worst, same


if __name__ == "__main__":
    difference, agree = self_test()
    passed = agree and difference <= TOLERANCE
    print(f"{MODEL}: {len(GOLDEN)} golden impacts, largest relative difference {difference:.1e}:",
          "passed" if passed else "FAILED")
    raise SystemExit(0 if passed else 1)
'''
