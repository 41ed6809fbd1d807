"""Simulated tables of many designs, right and misread: columns in SI by name, and what they were misread by."""

from __future__ import annotations

import numpy as np

import fitball
from fitball.data.misreading import flipped
from fitball.values import Ball

TENNIS = Ball()
TWO_MASS = {
    "mass_ratio": 0.87, "k_y": 1.9e4, "k_theta": 15.0, "mu": 0.55, "eps_10": 2.5e-3, "eps_slope": 0.0,
    "cor_10": 0.775, "cor_slope": -0.0145,
}  # fmt: skip


def sphere(mass, radius, ratio):
    return Ball(mass, radius, ratio * mass * radius**2)


def grip_slip(mu, e_x, offset, cor, slope=-0.01):
    return "grip-slip", {"mu": mu, "e_x": e_x, "offset": offset, "cor_10": cor, "cor_slope": slope}


# Rows, speeds [m/s], angles to the court [deg], spins [rad/s], noise [m/s] and [rad/s], ball, model and parameters.
TWO = ("two-mass", TWO_MASS)
GRIPPING = ("two-mass", TWO_MASS | {"mu": 0.9})
SLIDING = ("two-mass", TWO_MASS | {"mass_ratio": 0.92, "mu": 0.45})
BOUNCY = grip_slip(0.6, 0.1, 2e-3, 0.78)
TABLE_TENNIS, GOLF, BASKET = sphere(2.7e-3, 0.02, 2 / 3), sphere(0.0459, 0.02135, 0.4), sphere(0.62, 0.12, 0.62)
SUPER, SQUASH = sphere(0.045, 0.0225, 0.4), sphere(0.024, 0.02, 0.55)
DESIGNS = {
    "wide": (30, (14, 20), (15, 75), (-250, 250), (0.25, 10), TENNIS, TWO),
    "all grip": (30, (14, 20), (45, 75), (-250, 250), (0.25, 10), TENNIS, GRIPPING),
    "all slide": (30, (18, 24), (14, 19), (-250, 0), (0.25, 10), TENNIS, SLIDING),
    "one angle": (30, (14, 20), (39, 41), (-250, 250), (0.25, 10), TENNIS, TWO),
    "without spin": (30, (14, 20), (15, 75), (-8, 8), (0.25, 10), TENNIS, TWO),
    "backspin": (30, (14, 20), (15, 75), (-400, -100), (0.25, 10), TENNIS, TWO),
    "three rows": (3, (14, 20), (15, 75), (-250, 250), (0.25, 10), TENNIS, TWO),
    "two rows": (2, (14, 20), (15, 75), (-250, 250), (0.25, 10), TENNIS, TWO),
    "steep": (30, (14, 18), (75, 89), (-20, 20), (0.25, 10), TENNIS, TWO),
    "dropped": (12, (3, 8), (90, 90), (0, 0), (0.1, 5), TENNIS, BOUNCY),
    "dropped with spin": (12, (3, 8), (90, 90), (-200, 200), (0.1, 5), TENNIS, BOUNCY),
    "slow": (30, (2, 5), (25, 80), (-60, 60), (0.1, 4), TENNIS, BOUNCY),
    "noisy": (30, (14, 20), (15, 75), (-250, 250), (2, 60), TENNIS, TWO),
    "very noisy": (30, (14, 20), (15, 75), (-250, 250), (4, 150), TENNIS, TWO),
    "long": (8000, (14, 20), (15, 75), (-250, 250), (0.25, 10), TENNIS, grip_slip(0.55, 0.1, 2e-3, 0.76)),
    "slippery": (30, (14, 20), (15, 75), (-250, 250), (0.25, 10), TENNIS, grip_slip(0.08, 0.3, 0.0, 0.8)),
    "rolling": (30, (14, 20), (15, 75), (-250, 250), (0.25, 10), TENNIS, grip_slip(0.55, 0.0, 0.0, 0.75)),
    "table tennis": (30, (3, 15), (15, 75), (-800, 800), (0.1, 10), TABLE_TENNIS, grip_slip(0.25, 0.1, 0.0, 0.85)),
    "golf": (30, (8, 25), (30, 60), (-900, -200), (0.2, 20), GOLF, grip_slip(0.35, 0.1, 0.0, 0.6)),
    "basketball": (30, (3, 9), (25, 80), (-20, 20), (0.1, 1), BASKET, grip_slip(0.8, 0.2, 2e-3, 0.75)),
    "superball": (30, (3, 9), (25, 80), (-200, 200), (0.1, 5), SUPER, grip_slip(0.8, 0.6, 0.0, 0.88)),
    "squash": (30, (8, 40), (15, 75), (-250, 250), (0.4, 15), SQUASH, grip_slip(0.8, 0.0, 1e-3, 0.4, -0.003)),
    "grazing": (30, (15, 30), (3, 8), (-50, 50), (0.25, 10), TENNIS, grip_slip(0.55, 0.1, 2e-3, 0.76)),
}


def table(design, seed):
    """A table of a design, well read, and its ball."""
    count, speeds, angles, spins, (velocity_sd, spin_sd), ball, (model, values) = DESIGNS[design]
    rng = np.random.default_rng([seed, list(DESIGNS).index(design)])
    speed, angle = rng.uniform(*speeds, count), np.radians(rng.uniform(*angles, count))
    values = values | {"mu": values["mu"] * np.exp(0.2 * rng.normal())}
    impacts = fitball.impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(*spins, count))
    rebound = fitball.model(model, ball=ball).rebound(values, impacts)
    noise = rng.normal(size=(3, count)) * [[velocity_sd], [velocity_sd], [spin_sd]]
    return {
        "v_x1": impacts.v_x1, "v_y1": impacts.v_y1, "omega_1": impacts.omega_1,
        "v_x2": rebound.v_x2 + noise[0], "v_y2": np.abs(rebound.v_y2 + noise[1]),
        "omega_2": rebound.omega_2 + noise[2],
    }, ball  # fmt: skip


def polar(columns):
    """Speeds and angles instead of components."""
    turned = {name: values for name, values in columns.items() if name.startswith("omega")}
    for end in "12":
        x, y = columns[f"v_x{end}"], columns[f"v_y{end}"]
        turned |= {f"v_{end}": np.hypot(x, y), f"theta_{end}": np.arctan2(y, x)}
    return turned


def spinless(columns):
    """Without any spin."""
    return {name: values for name, values in columns.items() if not name.startswith("omega")}


def times(factor, *names):
    """What a wrong unit does: numbers that are `factor` times too large."""
    return lambda columns: {name: values * (factor if name in names else 1.0) for name, values in columns.items()}


def negated(*names):
    return times(-1.0, *names)


def from_normal(*names):
    def turned(columns):
        return {name: flipped(name, values) if name in names else values for name, values in polar(columns).items()}

    return turned


def exchanged(*pairs):
    other = dict(pairs) | {two: one for one, two in pairs}
    return lambda columns: {other.get(name, name): values for name, values in columns.items()}


SPINS, SPEEDS, ANGLES = ("omega_1", "omega_2"), ("v_x1", "v_y1", "v_x2", "v_y2"), ("theta_1", "theta_2")
RPM, REV, KMH, MPH = 30.0 / np.pi, 0.5 / np.pi, 3.6, 1.0 / 0.44704
# How a table is misread -> words that must be among those said of it.
MISREADINGS = {
    "both spins": (negated(*SPINS), "with omega_1 and omega_2 negated"),
    "incident spin": (negated("omega_1"), "with omega_1 negated"),
    "rebound spin": (negated("omega_2"), "with omega_2 negated"),
    "v_x of both": (negated("v_x1", "v_x2"), "with v_x1 and v_x2 negated"),
    "v_x of the rebound": (negated("v_x2"), "with v_x2 negated"),
    "v_y towards the court": (negated("v_y1"), "with v_y1 negated"),
    "rpm": (times(RPM, *SPINS), "with omega_1 and omega_2 in rpm"),
    "rebound rpm": (times(RPM, "omega_2"), "with omega_2 in rpm"),
    "rev/s": (times(REV, *SPINS), "with omega_1 and omega_2 in rev/s"),
    "deg/s": (times(180.0 / np.pi, *SPINS), "with omega_1 and omega_2 in deg/s"),
    "km/h": (times(KMH, *SPEEDS), "with v_x1, v_y1, v_x2 and v_y2 in km/h"),
    "mph": (times(MPH, *SPEEDS), "with v_x1, v_y1, v_x2 and v_y2 in mph"),
    "rebound mph": (times(MPH, "v_x2", "v_y2"), "with v_x2 and v_y2 in mph"),
    "mph and rpm": (
        lambda columns: times(MPH, *SPEEDS)(times(RPM, *SPINS)(columns)), "in mph instead of m/s and omega_1"
    ),
    "both spins, in rpm": (times(-RPM, *SPINS), "omega_2 negated and omega_1 and omega_2 in rpm instead of rad/s"),
    "from the normal": (from_normal(*ANGLES), "with theta_1 and theta_2 measured from the normal"),
    "incident from the normal": (from_normal("theta_1"), "with theta_1 measured from the normal"),
    "radians": (lambda columns: times(np.pi / 180.0, *ANGLES)(polar(columns)), "with theta_1 and theta_2 in rad"),
    "ends": (
        exchanged(*((f"{name}1", f"{name}2") for name in ("v_x", "v_y", "omega_"))),
        "with incidence and rebound swapped",
    ),
    "components": (exchanged(("v_x1", "v_y1"), ("v_x2", "v_y2")), "v_x1 and v_y1 and v_x2 and v_y2 swapped"),
    "spins exchanged": (exchanged(("omega_1", "omega_2")), "with omega_1 and omega_2 swapped"),
}  # fmt: skip
UNITS = dict.fromkeys((*SPEEDS, "v_1", "v_2"), "m/s") | dict.fromkeys(SPINS, "rad/s") | dict.fromkeys(ANGLES, "deg")
