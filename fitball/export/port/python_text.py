"""The hand-written ends of a Python port: what calls the kernel, and the self-test."""

from __future__ import annotations

# How a kernel is called, by its convention (see `models.capabilities`); arrays are lists, and a dictionary stands for
# the one of two dimensions.
CALLS = {
    "impulse": """
    status, v_x2, v_y2, omega_2, phases = THE_KERNEL(ROW, v_x1, v_y1, omega_1)
    contact_time = None
""",
    "two-mass": """
    scratch = Scratch([0.0] * SERIES_SIZE, [0.0] * SERIES_SIZE, [0.0] * SERIES_SIZE, {})
    solved = THE_KERNEL(ROW, CODES, v_x1, v_y1, omega_1, THE_COR, scratch)
    status, v_x2, v_y2, omega_2 = solved.status, solved.v_x2, solved.v_y2, solved.omega_2
    contact_time, phases = solved.contact_time, solved.regime
""",
    "thesis": """
    row = (*ROW[:4], EPS_10 + EPS_SLOPE * (v_y1 - ANCHOR), *ROW[5:])
    found = THE_KERNEL(row, CODES[0], THE_COR, v_x1, v_y1, omega_1)
    status, v_x2, v_y2, omega_2, contact_time, phases = found
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
    """Return (v_x2, v_y2, omega_2, contact_time or None, phases packed); see `rebound`."""
    if not (math.isfinite(v_x1) and math.isfinite(omega_1) and 0.0 < v_y1 < math.inf):
        raise ValueError("expected finite numbers, and v_y1 > 0 towards the court")
CALL_THE_KERNEL
    if status:
        raise ValueError(REASONS[status])
    return v_x2, v_y2, omega_2, contact_time, phases


def rebound(v_x1, v_y1, omega_1, SIGNATURE):
    """Return (v_x2, v_y2, omega_2, contact_time or None, regime).

    Speeds [m/s], spin [rad/s], time [s]; the regime in words. Raises ValueError for an impact that the model cannot
    evaluate, with the reason, and ArithmeticError where numbers overflow.
    """
    v_x2, v_y2, omega_2, contact_time, phases = solve(v_x1, v_y1, omega_1, SIGNATURE)
    return v_x2, v_y2, omega_2, contact_time, regime_name(phases)
'''

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
